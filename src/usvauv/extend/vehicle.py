"""Models of an AUV.

Registries, and the class of their items:

- `vehicles`, `Vehicle`: a model: `Quantity`, a number of it; `Body`, `Surroundings`, `Command`, `Memory` and
  `Actuators`, which its functions take and return, `LANES` vehicles at a time in vectors `lanes`; `positive`,
  `velocity_of_water`
"""

from usvauv.kernels.limits import Quantity
from usvauv.kernels.vehicles.definition import Vehicle, vehicles
from usvauv.kernels.vehicles.kinematics import velocity_of_water
from usvauv.kernels.vehicles.vehicle import (
    LANES,
    Actuators,
    Body,
    Command,
    Memory,
    Surroundings,
    lanes,
    positive,
)

__all__ = [
    "LANES",
    "Actuators",
    "Body",
    "Command",
    "Memory",
    "Quantity",
    "Surroundings",
    "Vehicle",
    "lanes",
    "positive",
    "vehicles",
    "velocity_of_water",
]
