"""Policies: heuristics, learned policies, and their training.

>>> from usvauv import policies
>>> from usvauv.env import Scenario, World
>>> world = World(Scenario.load("extreme"))
>>> policy = policies.load("straight:1.4", world)
>>> action = policy.act(world.reset())

Public: the names below, each imported at its first use; the registries of `usvauv.policies.heuristics`,
`usvauv.policies.algorithms` and `usvauv.policies.frames`; `usvauv.policies.guidance`, helpers for your own policy;
`usvauv.policies.export` and `usvauv.policies.training`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from usvauv.policies.checkpoint import read_history, read_run
    from usvauv.policies.config import TrainingConfig
    from usvauv.policies.learned import LearnedPolicy
    from usvauv.policies.loading import acting, available, check, default, load, load_learned, named
    from usvauv.policies.names import PolicyError, about, trained
    from usvauv.policies.policy import Policy
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

_MODULES = {
    **dict.fromkeys(("read_history", "read_run"), "checkpoint"),
    "TrainingConfig": "config",
    "LearnedPolicy": "learned",
    **dict.fromkeys(("acting", "available", "check", "default", "load", "load_learned", "named"), "loading"),
    **dict.fromkeys(("PolicyError", "about", "trained"), "names"),
    "Policy": "policy",
    "TrainingWorld": "training.exploration",
    **dict.fromkeys(("evaluated", "figures_of_merit"), "training.figures"),
    "resume": "training.saving",
    "Trainer": "training.trainer",
    "TrainingRun": "training.training_run",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'usvauv.policies' has no attribute {name!r}")
    return getattr(import_module(f"usvauv.policies.{_MODULES[name]}"), name)
