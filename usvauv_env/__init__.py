"""The world of usvauv: scenarios, sites and seas, the batched world, its record, pictures and faces.

From outside: the names below, `plugins.load`, and what the rooms' own pages name. Importing it registers the Gymnasium
environments.
"""

# Before torch: while Taichi is imported, it looks through all modules that are, again and again.
from usvauv.kernels import runtime  # noqa: F401

# isort: split

from gymnasium.envs.registration import register

from usvauv.env.faces.pettingzoo_env import parallel_env
from usvauv.env.record.evaluation import evaluate
from usvauv.env.record.metrics import EpisodeMetrics
from usvauv.env.record.trace import Trace, TraceError
from usvauv.env.scenario import Scenario, ScenarioError
from usvauv.env.world.world import World

__all__ = ["EpisodeMetrics", "Scenario", "ScenarioError", "Trace", "TraceError", "World", "evaluate", "parallel_env"]

register(
    id="usvauv/DataCollection-v0",
    entry_point="usvauv.env.faces.gymnasium_env:DataCollectionEnv",
    vector_entry_point="usvauv.env.faces.gymnasium_env:DataCollectionVectorEnv",
)
