"""A scenario: every number of a simulation, with its unit, range, default and meaning, in sections.

All values are SI: metres, seconds, radians, watts, hertz. `fields` reads, `scenario` checks and writes the whole; a
section's field, in `sea` or `team`, is the one place where its number is described: comments of files and the
reference are made of it.
"""

from usvauv.env.scenario.fields import ScenarioError
from usvauv.env.scenario.scenario import Scenario

__all__ = ["Scenario", "ScenarioError"]
