"""Where a boat goes, and which AUV it interrogates.

Registries, and the class of their items:

- `boat_strategies`, `BoatStrategy`: a boat's goal: `Strategy`, its functions; `serves`, whether it serves an AUV
- `schedules`, a function: how urgent it is that a boat interrogates an AUV (worlds, w, b, k) → number
"""

from usvauv.kernels.mission.boats.boat_motion import serves
from usvauv.kernels.mission.boats.boat_strategies import BoatStrategy, Strategy, boat_strategies
from usvauv.kernels.mission.choices import schedules

__all__ = ["BoatStrategy", "Strategy", "boat_strategies", "schedules", "serves"]
