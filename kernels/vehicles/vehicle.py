"""State and functions that models of AUVs share, for LANES vehicles at a time; `definition` says what a model is.

Inside the functions of a vehicle axes are those of Fossen (2021), "Handbook of Marine Craft Hydrodynamics and Motion
Control": body axes x forward, y to starboard, z down; the frame of reference north, east, down. The world outside has
x east, y north, z up, and headings anticlockwise from east. A vehicle's number is a vector of LANES numbers here, so
that a function reads as for one vehicle. Kernels are compiled under `runtime.vectors_in_registers`, where vectors
have no negation (write 0 − x), no comparison, no `ti.select`, no `abs` and no transcendental functions. There are
`magnitude` and `positive` below, ti.min, ti.max, ti.sqrt and ti.floor; a loop over ti.static(range(LANES)) does the
rest, slowly.
"""

import taichi as ti

from usvauv.kernels.functions import LANES as LANES
from usvauv.kernels.functions import func
from usvauv.kernels.transcendental import lanes as lanes

TINY = 1e-12
THIRD = 1 / 3  # a product takes a tenth of a division's time
blocks = ti.types.ndarray(dtype=lanes, ndim=2)


@func
def magnitude(x: lanes) -> lanes:
    """|x|."""
    return ti.max(x, 0.0 - x)


@func
def positive(x: lanes) -> lanes:
    """1 where x is above 1e-30, 0 where it is not above 0: a share that takes the place of a condition."""
    return ti.min(ti.max(x * 1e30, 0.0), 1.0)


@func
def cross_flow(v, h):
    """∫ |v + h s| (v + h s) ds and ∫ s |v + h s| (v + h s) ds over s from −1 to 1, exactly; numbers or vectors, m/s.

    For a hull of length L with h = r L/2 they are 2/L times ∫ |v + x r| (v + x r) dx and 4/L² times
    ∫ x |v + x r| (v + x r) dx. With V = max(|v|, |h|), s = |v|/V and t = |h|/V they are 2 v V (1 + s² t²/3) and
    h V (½ + s² − s⁴/6), s = min(|v/h|, 1) being where the flow changes side: |v| v L in pure sway and |r| r L⁴/32 in
    pure yaw.
    """
    V, H = ti.max(v, 0.0 - v), ti.max(h, 0.0 - h)
    large = ti.max(V, H)
    share = 1.0 / ti.max(large, TINY)
    s, t = V * share, H * share
    s2, t2 = s * s, t * t
    return 2.0 * v * large * (1.0 + THIRD * s2 * t2), h * large * (0.5 + s2 - 0.5 * THIRD * s2 * s2)


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
        time: since the beginning of the mission step, s.
        surfaced, grounded: 1 if it has touched the surface or the bed since the beginning of the mission step.
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
    time: lanes
    surfaced: lanes
    grounded: lanes


@ti.dataclass
class Surroundings:
    """The water around LANES vehicles in a mission step, linear in place and time from where and when it began.

    Attributes:
        north, east, down: velocity of the water at the vehicle's place at the beginning, m/s.
        nn, ne, nd, en, ee, ed, dn, de, dd: its gradient, ∂(first)/∂(second), 1/s.
        rate_n, rate_e, rate_d: ∂/∂t of it at a fixed place, m/s².
        depth: of the vehicle at the beginning, m.
        bed: depth of the bed below the mean surface at that place, m.
        bed_n, bed_e: its slopes.
        mass, drag, fins: factors on mass, inertia and displaced water (it stays trimmed), on damping, and on the
            forces of the fins; 1 for the model.
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
    depth: lanes
    bed: lanes
    bed_n: lanes
    bed_e: lanes
    mass: lanes
    drag: lanes
    fins: lanes


@ti.dataclass
class Command:
    """Commands to an autopilot.

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
    """Commands to the actuators: angles in rad, revolutions per second."""

    rudder: lanes
    stern: lanes
    propeller: lanes


@ti.dataclass
class Memory:
    """An autopilot's state from one substep to the next; all 0 as an episode begins.

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


@func
def load(block: ti.template(), g, kind: ti.template(), rows: ti.template()):
    """A structure of LANES vehicles from rows of block g, its fields in their order; 0 where the row is −1."""
    return kind(**{name: block[g, row] for name, row in ti.static(zip(kind.members, rows, strict=True)) if row >= 0})


@func
def store(block: ti.template(), g, structure, rows: ti.template()):
    """What `load` reads; nothing where the row is −1."""
    for i, value in ti.static(enumerate(structure.entries.values())):
        if ti.static(rows[i] >= 0):
            block[g, rows[i]] = value
