"""What a model of an AUV is: functions on LANES vehicles at a time, a table of numbers, and the state they share.

Inside the functions of a vehicle axes are those of Fossen (2021), "Handbook of Marine Craft Hydrodynamics and Motion
Control": body axes x forward, y to starboard, z down; the frame of reference north, east, down. The world outside has
x east, y north, z up, and headings anticlockwise from east. A number of a vehicle is a vector of LANES numbers here, so
that a function reads like that of one vehicle; where its value decides, `ti.select` takes the place of `if`.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import taichi as ti

from usvauv.kernels.registry import Registry

LANES = 16
lanes = ti.types.vector(LANES, ti.f32)


@ti.dataclass
class Body:
    """State of LANES vehicles.

    Attributes:
        north, east: displacement over ground since the beginning of the mission step, m.
        depth: below the mean surface, m.
        q0, q1, q2, q3: attitude, the unit quaternion that turns body axes into north, east, down.
        u, v, w: velocity relative to the water, body axes, m/s.
        p, q, r: angular velocity, body axes, rad/s.
        rudder, stern: angles of the fins, rad; a positive rudder turns to starboard, a positive stern plane dives.
        propeller: revolutions a second.
        energy: electrical energy since the beginning of the mission step, J.
    """

    north: lanes
    east: lanes
    depth: lanes
    q0: lanes
    q1: lanes
    q2: lanes
    q3: lanes
    u: lanes
    v: lanes
    w: lanes
    p: lanes
    q: lanes
    r: lanes
    rudder: lanes
    stern: lanes
    propeller: lanes
    energy: lanes


@ti.dataclass
class Surroundings:
    """The water around LANES vehicles in a mission step, linear in place and time from where and when it began.

    Attributes:
        north, east, down: velocity of the water at the vehicle's place at the beginning, m/s.
        nn, ne, nd, en, ee, ed, dn, de, dd: its gradient, ∂(first)/∂(second), 1/s.
        rate_n, rate_e, rate_d: ∂/∂t of it at a fixed place, m/s².
        bed: depth of the bed below the mean surface at that place, m.
        bed_n, bed_e: its slopes.
        mass, drag, fins: factors on the vehicle's mass and inertia, damping, and lift of the fins; 1 for the model.
    """

    north: lanes
    east: lanes
    down: lanes
    nn: lanes
    ne: lanes
    nd: lanes
    en: lanes
    ee: lanes
    ed: lanes
    dn: lanes
    de: lanes
    dd: lanes
    rate_n: lanes
    rate_e: lanes
    rate_d: lanes
    bed: lanes
    bed_n: lanes
    bed_e: lanes
    mass: lanes
    drag: lanes
    fins: lanes


@ti.dataclass
class Command:
    """What an autopilot is to do.

    Attributes:
        heading: clockwise from north, rad.
        speed: through the water, m/s.
        depth: m, at or above `altitude` over the bed.
        altitude: least height above the bed, m.
    """

    heading: lanes
    speed: lanes
    depth: lanes
    altitude: lanes


@ti.dataclass
class Actuators:
    """What the actuators are told: angles in rad, revolutions a second."""

    rudder: lanes
    stern: lanes
    propeller: lanes


@ti.dataclass
class Memory:
    """What an autopilot remembers from one substep to the next; all 0 as an episode begins.

    Attributes:
        heading, depth, pitch, speed: of its reference filters.
        heading_integral, depth_integral, speed_integral: of its integrators.
        begun: 0 before the first substep.
    """

    heading: lanes
    depth: lanes
    pitch: lanes
    speed: lanes
    heading_integral: lanes
    depth_integral: lanes
    speed_integral: lanes
    begun: lanes


class Vehicle(NamedTuple):
    """A model of an AUV. `table` below is a 1-D array argument of a kernel, from `table_of`.

    Attributes:
        numbers: names and defaults of its numbers in SI units, as its section of a scenario has them.
        table_of: those numbers → what the functions read, (N,) float32.
        advance: (table, body, actuators, surroundings, dt) → Body, one substep of dt s; position, attitude,
            velocities, actuators with their lags and limits, energy.
        control: (table, body, memory, command, surroundings, depth_error, dt) → (Actuators, Memory), the autopilot;
            `depth_error` is what its depth sensor adds, m.
        trim: (table, speed, depth, heading) → Body, level and straight at a speed through the water (m/s).
        drive: (table, rudder, stern, propeller) → Actuators, what numbers in [−1, 1] tell the actuators: shares of
            their limits.
        substep: longest dt, s.
        turning: radius of its turning circle, m, by which it keeps away from the area's border.
    """

    numbers: Mapping[str, float]
    table_of: Callable[[Mapping[str, float]], np.ndarray]
    advance: Callable[..., Any]
    control: Callable[..., Any]
    trim: Callable[..., Any]
    drive: Callable[..., Any]
    substep: float
    turning: float


vehicles: Registry[Vehicle] = Registry("vehicle", form=Vehicle)
