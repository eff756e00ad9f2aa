"""Policies without learning.

Public: `HEURISTICS`, the classes by name, and `Heuristic`, the base class of a new one.
"""

from usvauv.kernels.registry import Registry
from usvauv.policies.heuristics.passing import Loiter, Pass
from usvauv.policies.heuristics.travel import Clear, Crab, Helm, Keep, Pace, Random, Straight
from usvauv.policies.policy import Heuristic, PolicyError

HEURISTICS: Registry[type[Heuristic]] = Registry("policy", PolicyError, Heuristic)
HEURISTICS.register("straight", Straight)
HEURISTICS.register("helm", Helm)
HEURISTICS.register("crab", Crab)
HEURISTICS.register("pace", Pace)
HEURISTICS.register("clear", Clear)
HEURISTICS.register("loiter", Loiter)
HEURISTICS.register("pass", Pass)
HEURISTICS.register("keep", Keep)
HEURISTICS.register("random", Random)

__all__ = ["HEURISTICS", "Heuristic"]
