"""Policies without learning, one idea a file.

From outside: `HEURISTICS`, the classes by name, and `Heuristic`, what a new one derives from.
"""

from policies.heuristics.constant_speed import Crab, Straight
from policies.heuristics.heuristic import Heuristic
from policies.heuristics.keep import Keep
from policies.heuristics.pace import Pace
from policies.heuristics.random import Random
from policies.heuristics.zermelo import Zermelo

HEURISTICS: dict[str, type[Heuristic]] = {
    "straight": Straight,
    "crab": Crab,
    "pace": Pace,
    "zermelo": Zermelo,
    "keep": Keep,
    "random": Random,
}

__all__ = ["HEURISTICS", "Heuristic"]
