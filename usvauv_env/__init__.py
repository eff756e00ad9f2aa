"""The simulator: scenarios, sites and seas, the batched world, its records, pictures and environments (`interfaces`).

Public: the names below, `plugins.load`, and the names that the subpackages' docstrings list. Importing this package
registers the Gymnasium environments; each name is imported at its first use, so that scenarios need no Taichi.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from gymnasium.envs.registration import register

if TYPE_CHECKING:
    from usvauv.env.interfaces.pettingzoo_env import parallel_env
    from usvauv.env.record.evaluation import run_episodes
    from usvauv.env.record.metrics import EpisodeMetrics
    from usvauv.env.record.trace import Trace, TraceError
    from usvauv.env.scenario import Scenario, ScenarioError
    from usvauv.env.world.world import World

__all__ = [
    "EpisodeMetrics",
    "Scenario",
    "ScenarioError",
    "Trace",
    "TraceError",
    "World",
    "parallel_env",
    "run_episodes",
]

_MODULES = {
    "EpisodeMetrics": "usvauv.env.record.metrics",
    "Scenario": "usvauv.env.scenario",
    "ScenarioError": "usvauv.env.scenario",
    "Trace": "usvauv.env.record.trace",
    "TraceError": "usvauv.env.record.trace",
    "World": "usvauv.env.world.world",
    "parallel_env": "usvauv.env.interfaces.pettingzoo_env",
    "run_episodes": "usvauv.env.record.evaluation",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'usvauv.env' has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)


register(
    id="usvauv/DataCollection-v0",
    entry_point="usvauv.env.interfaces.gymnasium_env:DataCollectionEnv",
    vector_entry_point="usvauv.env.interfaces.gymnasium_env:DataCollectionVectorEnv",
)
