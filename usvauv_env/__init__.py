"""The simulator: scenarios, sites and seas, the batched world, its records, pictures and environments (`interfaces`).

Public: the names below, `plugins.load`, and the names that the subpackages' docstrings list. Importing this package
registers the Gymnasium environments.
"""

# Before torch: while Taichi is imported, it repeatedly searches all modules imported so far.
from usvauv.kernels import runtime  # noqa: F401

# isort: split

from gymnasium.envs.registration import register

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

register(
    id="usvauv/DataCollection-v0",
    entry_point="usvauv.env.interfaces.gymnasium_env:DataCollectionEnv",
    vector_entry_point="usvauv.env.interfaces.gymnasium_env:DataCollectionVectorEnv",
)
