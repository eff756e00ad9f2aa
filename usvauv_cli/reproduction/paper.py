"""What the paper prints, and how ours is set beside it: conventions, tables of Markdown, the look of figures.

The paper is Xu, Xie, Wang, Ding, Zhang, "USV-AUV collaboration framework for underwater tasks under extreme sea
conditions", ICASSP 2025.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from usvauv.env.render.plain_matplotlib import Figure
from usvauv.env.render.style import Ground

FIGURES = ("sdr", "ec", "arps")
"""Sum data rate, energy consumption, average reward per time step."""

CONDITIONS = {"ISC": "paper-ideal", "ESC": "paper-extreme"}
"""The paper's ideal and extreme sea conditions, and our scenarios for them."""

PHYSICAL = "extreme"
"""Our own scenario, set beside the paper's in Fig. 4."""

TABLE_2 = {
    ("ddpg", "ISC"): {"sdr": (6.63, 0.97), "ec": (73.72, 1.11), "arps": (-80.70, 6.94)},
    ("ddpg", "ESC"): {"sdr": (6.35, 1.57), "ec": (77.23, 0.89), "arps": (-82.28, 7.41)},
    ("sac", "ISC"): {"sdr": (5.97, 2.66), "ec": (111.57, 13.23), "arps": (-87.86, 13.10)},
    ("sac", "ESC"): {"sdr": (5.58, 2.35), "ec": (117.76, 17.30), "arps": (-89.58, 15.22)},
    ("baseline", None): {"sdr": (5.93, 3.51), "ec": (112.30, 10.56), "arps": (-87.95, 12.08)},
}
"""Table 2: method and condition → figure → value and what stands behind its ±. The baseline has one row only."""

FIG_4B = {"fim": 2e-3, "hold:100,100": 3e-3, "hold:0,0": 1e-1}
"""Fig. 4(b): positioning error by the boat's strategy, m, read off the figure to one digit."""

RESULTS = "reproduction"  # folder of tables and figures, beside the page and linked relative to it
METHODS = ("ddpg", "sac", "td3", "baseline", "data")  # in the order of their colours
TITLES = {"sdr": "Sum data rate (SDR), Mbit/s", "ec": "Energy consumption (EC), W", "arps": "Reward per step (ARPS)"}
WIDTH = 9.6  # inches

# Subject; what the paper (P) or its demonstration (D) has; fields of the scenario that hold what was done here.
CONVENTIONS = (
    ("noise of a fix against SNR", "D: amplitude 10^(−SNR/10), which is 10^(−SNR/20)", ("acoustics.noise_law",)),
    ("positioning signal", "P: an echo of 135 dB", ("acoustics.path", "acoustics.source_level", "usbl.signal")),
    ("fixes", "P: of all AUVs in each step", ("channel.schedule", "navigation.sensor")),
    ("data rate", "D: B log2(1 + 10^SNR) with SNR in dB, about ten times Shannon's", ("nodes.rate_law",)),
    ("carrier and bandwidth of the data link, Hz", "D: 20 kHz, 1 kHz", ("nodes.frequency", "nodes.bandwidth")),
    ("vertical separation", "D: 100 m, boat to AUV (plus elevation) and AUV to node", ("auv.separation", "auv.depth")),
    ("distance in the reward", "P, D: minus the distance to the target", ("reward.distance_form", "reward.distance")),
    ("a service ends the value horizon", "D: yes; so serving pays in spite of it", ("reward.service_terminates",)),
    ("reward of a service", "D: 12 in every second of it", ("reward.service", "reward.service_form")),
    ("proximity", "D: paid once a pair", ("reward.proximity_form",)),
    ("hovering time that EC leaves out", "D: the services' exact length", ("nodes.hovering_time",)),
    ("weight of the power, 1/W", "D: 0.085", ("reward.power",)),
    ("weight of Eq. 5", "P: none is given", ("reward.collaboration",)),
    ("action", "D: heading and speed, with a jump at ±π", ("auv.action",)),
    ("current observed (Eq. 4)", "P: its speed", ("observation.current",)),
    ("information maximised", "P: det of the sum over AUVs (Eq. 2)", ("planner.objective",)),
    ("measurement in it", "P: two phase differences, one noise", ("planner.measurement", "planner.noise")),
    ("boat", "D: is at once where it is wanted", ("boat.top_speed", "boat.drifts")),
    ("tide of Table 1", "P: 5 m in 12 h; flat to 2 µm over 200 m", ("sea.regular_amplitude", "sea.regular_period")),
    ("time step of the sea, s", "P: 10", ("sea.update_interval",)),
    ("steps and length of an episode, s", "D: 1 and 1000", ("mission.step", "mission.duration")),
    ("target rule", "D: slant distance; of the two best nodes the lower index that is free", ("nodes.target_rule",)),
    ("λ of the nodes", "D: drawn once; here for each episode", ("nodes.arrival_rates",)),
    ("AUVs and nodes", "P: 2; D: 30", ("auv.count", "nodes.count")),
)

EXPLAINED = """\
- **SDR** is the sum over an episode's services of the data rate, Mbit/s; **EC** the mean over AUVs of energy over the
  time not hovering, W; **ARPS** the mean over steps of the reward summed over AUVs. Services are given beside them.
- **± of ours** is the sample standard deviation over episodes, pooled over the runs. The paper does not say what its ±
  is.
- **ISC** is `paper-ideal`, **ESC** is `paper-extreme`: Table 1's tide and reference [4]'s three vortices, whose current
  is below 0.05 m/s. So the two conditions hardly differ.
- **Environmental generalisation** is read as: trained in one condition, tested in both. The rows set beside the paper's
  are trained in ISC; those trained in ESC are in the table of all tests.
- **The policy of a run** is the one with the highest ARPS among its evaluations before and while learning, on worlds
  that it is neither trained nor tested in. It acts without exploration. Tests are paired: every method has the same
  worlds.
- **Learning** differs from the demonstration's (networks of width 128, one update a step, learning rate 1e-3, γ 0.97,
  τ 1e-3, batch 64, a replay of 20000, exploration 0.8 falling to 0.1, one world): many worlds are stepped together,
  returns are of n steps, and the network sees in the target's frame and steers through an autopilot (`frame`).
- **Baseline [4]** is MAISAC: independent SAC with learned temperature, learning rate 3e-4, γ 0.99, τ 0.01. The current
  is in its energy, but it neither observes it (no Eq. 4) nor has Eq. 5 in the reward it learns from, and the boat is
  held at (100, 100), without Eq. 3. It is tested under the full reward, like all others; ARPS without Eq. 5 stands
  beside.
- **SAC for data** learns from the reward terms of our own scenarios with other weights, power at four tenths of its
  price there; it shows another point between data and energy.
- **Heuristics** (`straight`, `crab`) travel at the constant speed recorded in the scenario.
"""


def printed(method: str, condition: str) -> dict[str, tuple[float, float]]:
    """The row of Table 2 to set beside a method tested in a condition; empty where there is none."""
    return TABLE_2.get((method, condition)) or TABLE_2.get((method, None), {})


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def rounded(value: float, digits: int = 2) -> str:
    """A number with a typographic minus sign."""
    return f"{round(value, digits) + 0.0:.{digits}f}".replace("-", "−")


def spread(centre: float, deviation: float, digits: int = 2) -> str:
    """Centre ± deviation."""
    return f"{rounded(centre, digits)} ± {rounded(deviation, digits)}"


def picture_pair(name: str, about: str) -> str:
    """A figure for light and for dark pages, with links to its other formats."""
    pair = (
        f'<picture><source media="(prefers-color-scheme: dark)" srcset="{RESULTS}/{name}-dark.png">'
        f'<img alt="{about}" src="{RESULTS}/{name}-light.png"></picture>'
    )
    return f"{pair}\n\nAs [PDF]({RESULTS}/{name}.pdf), as [CSV]({RESULTS}/{name}.csv)."


def titled_figure(height: float, title: str, about: str, ground: Ground) -> Figure:
    """An empty figure of a height in inches with a title and up to two lines below it, in its upper 1.1 inches."""
    figure = Figure(figsize=(WIDTH, height))
    left = 0.3 / WIDTH
    figure.text(left, 1 - 0.34 / height, title, fontsize=15, fontweight="bold", va="center")
    figure.text(left, 1 - 0.55 / height, about, color=ground.muted, fontsize=9.5, va="top", linespacing=1.4)
    return figure
