"""The paper's printed values, the runs compared with them, and their presentation: conventions, settings and runs,
tables in Markdown, the style of figures.

The paper is Xu, Xie, Wang, Ding, Zhang, "USV-AUV collaboration framework for underwater tasks under extreme sea
conditions", ICASSP 2025.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from usvauv.cli.sweep.run_folder import Evaluate, Piece
from usvauv.env.accuracy.fix_errors import best_variance, median_of_normals
from usvauv.env.record.metrics import episode_metrics, position_error
from usvauv.env.record.recorder import record
from usvauv.env.render.figures import Figure
from usvauv.env.render.style import Ground
from usvauv.env.scenario import Scenario
from usvauv.env.storage.result_tables import write_rows
from usvauv.env.world.strategy_choice import StrategyChoice
from usvauv.env.world.world import World
from usvauv.policies import checkpoint, loading
from usvauv.policies.config import TrainingConfig
from usvauv.policies.inputs import digests

FIGURES = ("sdr", "ec", "arps")  # sum data rate, energy consumption, average reward per time step
CONDITIONS = {"ISC": "paper-ideal", "ESC": "paper-extreme"}  # ideal and extreme sea, and our scenarios for them
PHYSICAL = "extreme"  # our own scenario, set beside the paper's in Fig. 4
# Method and condition → figure → value and what stands behind its ±. The baseline has one row only.
TABLE_2 = {
    ("ddpg", "ISC"): {"sdr": (6.63, 0.97), "ec": (73.72, 1.11), "arps": (-80.70, 6.94)},
    ("ddpg", "ESC"): {"sdr": (6.35, 1.57), "ec": (77.23, 0.89), "arps": (-82.28, 7.41)},
    ("sac", "ISC"): {"sdr": (5.97, 2.66), "ec": (111.57, 13.23), "arps": (-87.86, 13.10)},
    ("sac", "ESC"): {"sdr": (5.58, 2.35), "ec": (117.76, 17.30), "arps": (-89.58, 15.22)},
    ("baseline", None): {"sdr": (5.93, 3.51), "ec": (112.30, 10.56), "arps": (-87.95, 12.08)},
}
# Positioning error by the boat's strategy, m, read off the figure to one digit.
FIG_4B = {"fim": 2e-3, "hold:100,100": 3e-3, "hold:0,0": 1e-1}

RESULTS = "reproduction"  # folder of tables and figures, beside the page and linked relative to it
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
- **SDR** is the sum of the data rate over an episode's services, Mbit/s; **EC** the mean over AUVs of energy divided by
  the time not hovering, W; **ARPS** the mean over steps of the reward summed over AUVs. Services are also given.
- **± of ours** is the sample standard deviation over episodes, pooled over the runs. The paper does not define its ±.
- **ISC** is `paper-ideal`, **ESC** is `paper-extreme`: Table 1's tide and reference [4]'s three vortices, whose current
  is below 0.05 m/s. So the two conditions hardly differ.
- **Environmental generalisation** is interpreted as training in one condition and testing in both. The rows compared
  with the paper's are trained in ISC; those trained in ESC are in the table of all tests.
- **The policy of a run** is the one with the highest ARPS among its evaluations before and during training, on worlds
  used for neither training nor tests. It acts without exploration. Tests are paired: every method has the same worlds.
- **Training** differs from the demonstration's (networks of width 128, one update per step, learning rate 1e-3, γ 0.97,
  τ 1e-3, batch 64, a replay of 20000, exploration 0.8 falling to 0.1, one world): many worlds are stepped together,
  returns are of n steps, and the network has inputs in the target's frame and steers through an autopilot (`frame`).
- **Baseline [4]** is MAISAC: independent SAC with learned temperature, learning rate 3e-4, γ 0.99, τ 0.01. Its energy
  includes the current, but it neither observes the current (no Eq. 4) nor has Eq. 5 in its training reward, and the
  boat is held at (100, 100), without Eq. 3. It is tested under the full reward, like all others; ARPS without Eq. 5 is
  also given.
- **SAC for data** is trained with the reward terms of our own scenarios with other weights, power at four tenths of its
  price there; it shows another trade-off between data and energy.
- **Heuristics** (`straight`, `crab`) travel at the constant speed recorded in the scenario.
"""

HEURISTICS = ("straight", "crab", "random")
STRATEGIES = ("fim", "hold:100,100", "hold:0,0", "centroid")
BOUND = "bound"
OVER_TIME = "over-time.csv"  # of a run of `fix_errors`, beside its rows


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


@dataclass(frozen=True)
class Method:
    """A row of Table 2 that is learned."""

    key: str  # its name in files
    title: str  # its name in tables
    config: TrainingConfig  # the seed is replaced by each run's
    usv: str = "fim"  # the boat's strategy, while learning and while tested
    learning: tuple[str, ...] = ()  # changes of the scenario while learning
    testing: tuple[str, ...] = ()  # and while tested, so that the observation is the one the policy was trained with


_config = partial(TrainingConfig, num_worlds=128, batch=512)  # with which the tables were made
METHODS = (
    Method("ddpg", "DDPG", _config(algorithm="ddpg")),
    Method("sac", "SAC", _config(algorithm="sac")),
    Method("td3", "TD3", _config(algorithm="td3")),
    # MAISAC of the paper's reference [4]: independent SAC with a learned temperature, and neither Eq. 3 to 5.
    Method(
        "baseline",
        "Baseline [4]",
        _config(algorithm="sac", frame="target", learning_rate=3e-4, final_rate=1.0, gamma=0.99, tau=0.01),
        usv="hold:100,100",
        learning=("observation.current=none", "reward.collaboration=0"),
        testing=("observation.current=none",),
    ),
    # Another point of the front of data and energy: near the EC of the paper's SAC.
    Method(
        "data",
        "SAC for data",
        _config(algorithm="sac", shared=True, updates=2),
        learning=(
            "reward.distance_form=progress",
            "reward.service_terminates=false",
            "reward.service_form=completion",
            "reward.service=30",
            "reward.power=-0.0043",
            "reward.proximity=-0.3",
        ),
    ),
)


@dataclass(frozen=True)
class Settings:
    """Size of a reproduction."""

    methods: tuple[Method, ...] = METHODS  # the learned rows of Table 2
    seeds: tuple[int, ...] = (0, 1, 2, 3, 4)  # of the training runs; of the worlds of Fig. 4(b), too
    steps: int = 300_000  # world-steps of a training run
    evaluations: int = 10  # of a training run, besides one of the untrained policy
    judged: int = 32  # episodes in each
    # Of each policy in each condition it is tested in. Run number i is tested in episodes i·episodes to
    # (i+1)·episodes − 1 of `test_seed`, heuristics in all of them.
    episodes: int = 40
    test_seed: int = 2026  # of the worlds tested in, and of Fig. 4(a)'s
    fix_episodes: int = 10  # of Fig. 4(b), for each seed
    wide_episodes: int = 100  # of each strategy of the boat in `wide`, of `test_seed`
    overrides: tuple[str, ...] = ()  # changes of every scenario

    def method(self, key: str) -> Method:
        """The method of that key."""
        return next(method for method in self.methods if method.key == key)

    def scenario(self, name: str, changes: tuple[str, ...] = ()) -> Scenario:
        """A scenario with the changes of these settings."""
        return Scenario.load(name, [*self.overrides, *changes])


FULL = Settings()
QUICK = replace(
    FULL, seeds=(0, 1), steps=60_000, evaluations=4, judged=8, episodes=10, fix_episodes=4, wide_episodes=12
)


def learned(settings: Settings, method: str, trained_in: str, seed: int) -> Piece:
    """A training run, and the tests of its best policy in both conditions."""
    about = settings.method(method)
    config = asdict(replace(about.config, seed=seed))
    sizes = {"total": settings.steps, "evaluations": settings.evaluations, "judged": settings.judged}
    tests = _tests(settings, about.testing, settings.episodes, settings.seeds.index(seed))
    scenario = settings.scenario(trained_in, about.learning)
    return _piece(scenario, about.title, about.usv, tests, trained_in, _test, config | sizes, seed)


def heuristic(settings: Settings, policy: str) -> Piece:
    """The tests of a heuristic in both conditions."""
    scenario = settings.scenario(CONDITIONS["ISC"])
    tests = _tests(settings, (), settings.episodes * len(settings.seeds), 0)
    usv = StrategyChoice.parse(None, scenario).name
    return _piece(scenario, policy, usv, tests, "both conditions", _test)


def fix_errors(settings: Settings, name: str, usv: str) -> Piece:
    """Errors of positions by one strategy of the boat, AUVs steered by `straight`; by `fim` also the bound.

    The rows are median and 95th percentile of each episode over steps and AUVs, the table `OVER_TIME` median and
    quartiles over episodes and AUVs, in s and m. The bound has neither quartiles nor percentile.
    """
    evaluation = {"episodes": settings.fix_episodes * len(settings.seeds), "seeds": list(settings.seeds)}
    return _piece(settings.scenario(name), "straight", usv, evaluation, f"{name}, boat {usv}", _measure)


def best(piece: Piece, folder: Path) -> dict[str, Any]:
    """JSON of the best policy of a training run: score, updates, commit and more."""
    return checkpoint.read(checkpoint.path_of(piece.place(folder), checkpoint.BEST), checkpoint.POLICY)[0]


def _tests(settings: Settings, changes: tuple[str, ...], count: int, number: int) -> dict[str, Any]:
    """Block number `number` of `count` episodes, in both conditions."""
    scenarios = [settings.scenario(name, changes).to_dict() for name in CONDITIONS.values()]
    about = {"episodes": count * len(scenarios), "seed": settings.test_seed, "first": number * count}
    return about | {"scenarios": scenarios}


def _piece(
    scenario: Scenario,
    policy: str,
    usv: str,
    evaluation: dict[str, Any],
    task: str,
    evaluate: Evaluate,
    training: dict[str, Any] | None = None,
    seed: int = 0,
) -> Piece:
    definition = {"scenario": scenario.to_dict(), "policy": policy, "training": training, "usv": usv, "seed": seed}
    definition |= {"evaluation": evaluation, "files": [*digests([scenario], [policy]).values()]}
    return Piece(definition=definition, method=policy, task=task, evaluate=evaluate)


def _test(definition: Mapping[str, Any], place: Path, step: Callable[[int], None]) -> list[dict[str, Any]]:
    """One row an episode: which run it tests, its metrics, and what Eq. 5's term adds to its arps."""
    wanted, about, policy = definition["evaluation"], {"run": "", "updates": ""}, definition["policy"]
    if definition["training"]:
        policy = checkpoint.path_of(place, checkpoint.BEST)
        updates = checkpoint.read(policy, checkpoint.POLICY)[0]["updates"]
        about = {"run": definition["seed"], "updates": updates}
    count, first, rows = wanted["episodes"] // len(wanted["scenarios"]), wanted["first"], []
    for of in wanted["scenarios"]:
        world = World(Scenario.from_dict(of), count, wanted["seed"], definition["usv"], first_world=first)
        act = loading.load(policy, world).act
        trace = record(world, act, definition["policy"], on_step=lambda _: step(count))
        term = trace.reward_terms[..., trace.reward_names.index("collaboration")]
        added = term.sum(axis=2, dtype=np.float64).mean(axis=0)
        for row, value in zip(episode_metrics(trace, first), added, strict=True):
            rows.append(about | row.columns() | {"collaboration": float(value)})
    return rows


def _measure(definition: Mapping[str, Any], place: Path, step: Callable[[int], None]) -> list[dict[str, Any]]:
    """See `fix_errors`."""
    seeds, usv = definition["evaluation"]["seeds"], definition["usv"]
    count, traces = definition["evaluation"]["episodes"] // len(seeds), []
    for seed in seeds:
        world = World(Scenario.from_dict(definition["scenario"]), count, seed, usv)
        act = loading.load(definition["policy"], world).act
        traces.append(record(world, act, definition["policy"], on_step=lambda _: step(count)))
    time, episodes = traces[0].time, [(trace.seed, world) for trace in traces for world in range(count)]

    error = np.concatenate([position_error(trace) for trace in traces], axis=1)
    at = [(usv, *row) for row in zip(time, *np.quantile(error, (0.5, 0.25, 0.75), axis=(1, 2)), strict=True)]
    of_episodes = zip(episodes, *np.quantile(error, (0.5, 0.95), axis=(0, 2)), strict=True)
    of = [(usv, *about, *row) for about, *row in of_episodes]
    if usv == "fim":
        variance, median = np.concatenate([best_variance(trace) for trace in traces], axis=1), median_of_normals
        at += [(BOUND, float(t), median(row.ravel()), "", "") for t, row in zip(time, variance, strict=True)]
        of += [(BOUND, *about, median(variance[:, w].ravel()), "") for w, about in enumerate(episodes)]
    columns = ("strategy", "time", "median", "lower_quartile", "upper_quartile")
    write_rows(place / OVER_TIME, columns, (dict(zip(columns, row, strict=True)) for row in at))
    return [dict(zip(("strategy", "seed", "episode", "median", "p95"), row, strict=True)) for row in of]
