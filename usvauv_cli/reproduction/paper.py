"""What the paper prints: Xu, Xie, Wang, Ding, Zhang, "USV-AUV collaboration framework for underwater tasks under
extreme sea conditions", ICASSP 2025.
"""

from __future__ import annotations

FIGURES = ("sdr", "ec", "arps")
"""Sum data rate, energy consumption, average reward per time step."""

CONDITIONS = {"ISC": "paper-ideal", "ESC": "paper-extreme"}
"""The paper's ideal and extreme sea conditions, and our scenarios for them."""

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


def printed(method: str, condition: str) -> dict[str, tuple[float, float]]:
    """The row of Table 2 to set beside a method tested in a condition; empty where there is none."""
    return TABLE_2.get((method, condition)) or TABLE_2.get((method, None), {})
