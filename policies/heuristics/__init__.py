"""Policies without learning.

Public: `heuristics`, the classes by name, and `Heuristic`, the base class of a new one.
"""

from usvauv.kernels.registry import Registry
from usvauv.policies.heuristics.passing import Loiter, Pass
from usvauv.policies.heuristics.random_actions import Random
from usvauv.policies.heuristics.tracking import Circle, Tree
from usvauv.policies.heuristics.travel import Clear, Crab, Helm, Keep, Pace, Straight
from usvauv.policies.policy import Heuristic, PolicyError

heuristics: Registry[type[Heuristic]] = Registry("policy", PolicyError, Heuristic)
heuristics.register("straight", Straight)
heuristics.register("helm", Helm)
heuristics.register("crab", Crab)
heuristics.register("pace", Pace)
heuristics.register("clear", Clear)
heuristics.register("loiter", Loiter)
heuristics.register("pass", Pass)
heuristics.register("keep", Keep)
heuristics.register("circle", Circle)
heuristics.register("tree", Tree)
heuristics.register("random", Random)

__all__ = ["Heuristic", "heuristics"]
