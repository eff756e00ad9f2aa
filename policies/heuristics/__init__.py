"""Policies without learning, one idea a file.

From outside: `HEURISTICS`, the classes by name, and `Heuristic`, what a new one derives from.
"""

from kernels.registry import Registry
from policies.heuristics.clear import Clear
from policies.heuristics.constant_speed import Crab, Straight
from policies.heuristics.heuristic import Heuristic
from policies.heuristics.keep import Keep
from policies.heuristics.pace import Pace
from policies.heuristics.random import Random
from policies.heuristics.zermelo import Zermelo
from policies.policy import PolicyError

HEURISTICS: Registry[type[Heuristic]] = Registry("policy", PolicyError, Heuristic)
HEURISTICS.register("straight", Straight)
HEURISTICS.register("crab", Crab)
HEURISTICS.register("pace", Pace)
HEURISTICS.register("clear", Clear)
HEURISTICS.register("zermelo", Zermelo)
HEURISTICS.register("keep", Keep)
HEURISTICS.register("random", Random)

__all__ = ["HEURISTICS", "Heuristic"]
