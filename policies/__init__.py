"""Policies: heuristics, learned policies, and their training.

>>> from usvauv import policies
>>> from usvauv.env import Scenario, World
>>> world = World(Scenario.load("extreme"))
>>> policy = policies.load("straight:1.4", world)
>>> action = policy.act(world.reset())

Public: the names below; the registries of `usvauv.policies.heuristics`, `usvauv.policies.algorithms` and
`usvauv.policies.frames`; `usvauv.policies.guidance`, helpers for your own policy; `usvauv.policies.export` and
`usvauv.policies.training`.
"""

from usvauv.policies.checkpoint import read_history, read_run
from usvauv.policies.config import TrainingConfig
from usvauv.policies.learned import LearnedPolicy
from usvauv.policies.loading import about, acting, available, check, default, load, load_learned, named, trained
from usvauv.policies.policy import Policy, PolicyError
from usvauv.policies.training.exploration import TrainingWorld
from usvauv.policies.training.figures import evaluated, figures_of_merit
from usvauv.policies.training.saving import resume
from usvauv.policies.training.trainer import Trainer
from usvauv.policies.training.training_run import TrainingRun

__all__ = [
    "LearnedPolicy",
    "Policy",
    "PolicyError",
    "Trainer",
    "TrainingConfig",
    "TrainingRun",
    "TrainingWorld",
    "about",
    "acting",
    "available",
    "check",
    "default",
    "evaluated",
    "figures_of_merit",
    "load",
    "load_learned",
    "named",
    "read_history",
    "read_run",
    "resume",
    "trained",
]
