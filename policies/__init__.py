"""Policies: heuristics, learned ones, and how they are learned.

>>> import policies
>>> from usvauv_env import Scenario, World
>>> world = World(Scenario.load("extreme"))
>>> policy = policies.load("straight:1.4", world)
>>> action = policy.act(world.reset())

From outside: the names below; the registries of `policies.heuristics`, `policies.algorithms` and `policies.frames`;
`policies.guidance` for a policy of one's own, `policies.export` and `policies.training` for what their names say.
"""

from policies.checkpoint import read_history, read_run
from policies.config import TrainingConfig
from policies.evaluation import evaluate
from policies.learned import LearnedPolicy
from policies.loading import acting, available, check, default, load, load_learned, named, trained
from policies.policy import Policy, PolicyError
from policies.training import Seeds, Trainer, TrainingWorld

__all__ = [
    "LearnedPolicy",
    "Policy",
    "PolicyError",
    "Seeds",
    "Trainer",
    "TrainingConfig",
    "TrainingWorld",
    "acting",
    "available",
    "check",
    "default",
    "evaluate",
    "load",
    "load_learned",
    "named",
    "read_history",
    "read_run",
    "trained",
]
