"""The world of usvauv: scenario, batched world, trace and metrics, and its Gymnasium and PettingZoo faces."""

from gymnasium.envs.registration import register

from usvauv_env.faces.pettingzoo_env import parallel_env
from usvauv_env.record.trace import Trace, TraceError
from usvauv_env.scenario import Scenario, ScenarioError
from usvauv_env.world.world import World

__all__ = ["Scenario", "ScenarioError", "Trace", "TraceError", "World", "parallel_env"]

register(
    id="usvauv/DataCollection-v0",
    entry_point="usvauv_env.faces.gymnasium_env:DataCollectionEnv",
    vector_entry_point="usvauv_env.faces.gymnasium_env:DataCollectionVectorEnv",
)
