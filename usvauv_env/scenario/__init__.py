"""A scenario: every number of a simulation, with its unit, range, default and meaning, in sections.

All values are in SI units: metres, seconds, radians, watts, hertz. `fields` reads files, `scenario` checks and writes
whole scenarios. Each number is described once, at its section's field in `environment` or `team`: comments in files and
the reference are generated from there.
"""

from usvauv.env.scenario.fields import ScenarioError
from usvauv.env.scenario.scenario import Scenario

__all__ = ["Scenario", "ScenarioError"]
