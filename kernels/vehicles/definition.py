"""Definition of a vehicle: its numbers and the functions of its motion. `vehicle` has what these are written with."""

from collections.abc import Callable, Mapping
from typing import Annotated, Any, NamedTuple

import numpy as np

from usvauv.kernels.limits import Quantity
from usvauv.kernels.registry import Registry


class Vehicle(NamedTuple):
    """A model of an AUV. `table` below is a 1-D array argument of a kernel, from `table_of`.

    Attributes:
        numbers: its numbers by name, of which its section of a scenario is made; a plugin's are set in
            `vehicle_parameters`.
        table_of: names → values, all of `numbers` → what the functions read, (N,) float32.
        advance: (table, body, actuators, surroundings, dt) → Body, one substep of dt s; position, attitude,
            velocities, actuators with their lags and limits, energy.
        control: (table, body, memory, command, surroundings, depth_error, dt) → (Actuators, Memory), the autopilot;
            `depth_error` is what its depth sensor adds, m.
        trim: (table, speed, depth, heading) → Body, level and straight at a speed through the water (m/s); fields that
            are left out are 0.
        drive: (table, rudder, stern, propeller) → Actuators, what numbers in [−1, 1] tell the actuators: shares of
            their limits.
        substep: (names → values, variation) → longest dt, s, for all of `numbers` and a vehicle whose mass, drag and
            fins differ from the model's by up to the share `variation`: short enough for its fastest motion. A
            ValueError names a number for which none is.
        turning: radius of its turning circle, m, by which it keeps away from the area's border.
    """

    numbers: Mapping[str, Quantity]
    table_of: Annotated[Callable[[Mapping[str, float]], np.ndarray], "numbers"]
    advance: Annotated[Callable[..., Any], "table, body, actuators, surroundings, dt"]
    control: Annotated[Callable[..., Any], "table, body, memory, command, surroundings, depth_error, dt"]
    trim: Annotated[Callable[..., Any], "table, speed, depth, heading"]
    drive: Annotated[Callable[..., Any], "table, rudder, stern, propeller"]
    substep: Annotated[Callable[[Mapping[str, float], float], float], "numbers, variation"]
    turning: float


vehicles: Registry[Vehicle] = Registry("vehicle", form=Vehicle, shipped={"torpedo": "usvauv.kernels.vehicles.torpedo"})
