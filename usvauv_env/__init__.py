"""The world of usvauv: scenario, batched world, trace and metrics."""

from usvauv_env.scenario import Scenario, ScenarioError

__all__ = ["Scenario", "ScenarioError"]
