"""The world of usvauv: scenario, batched world, trace and metrics."""

from usvauv_env.scenario import Scenario, ScenarioError
from usvauv_env.trace import Trace, TraceError
from usvauv_env.world import World

__all__ = ["Scenario", "ScenarioError", "Trace", "TraceError", "World"]
