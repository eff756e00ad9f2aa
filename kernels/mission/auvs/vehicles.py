"""Vehicles with dynamics: commands from the mission's actions, motion in a mission step, and the water round them.

Before the mission's kernel takes a step, `move` moves all vehicles through it: LANES side by side as in
`usvauv.kernels.vehicles.vehicle`, in substeps of the autopilot and the body. The array `body` (`BodyColumn`) has the
result, from which `usvauv.kernels.mission.auvs.motion` sets the AUVs' positions. Before an episode `move` deploys them:
level at cruise speed, with random headings and bodies. At the end of a step `sense` writes the water at each vehicle,
which the next step treats as linear in place and time.

Vehicles have Fossen's axes, north, east, down; the world has east, north, up. `turned` converts between them.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import taichi as ti

from usvauv.kernels import random
from usvauv.kernels.flow import at_depth
from usvauv.kernels.flow.current import grid_sample, grid_slopes
from usvauv.kernels.functions import func, kernel
from usvauv.kernels.mission.auvs import motion
from usvauv.kernels.mission.columns import Action, AuvColumn, BodyColumn, Draw, KeyColumn, Parameter
from usvauv.kernels.mission.worlds import Numbers
from usvauv.kernels.transcendental import TWO_PI
from usvauv.kernels.types import array1, array2, array3, index2, mask1, mat3, vec2, vec3, vec4
from usvauv.kernels.vehicles.definition import Vehicle
from usvauv.kernels.vehicles.kinematics import axes
from usvauv.kernels.vehicles.vehicle import (
    LANES,
    Actuators,
    Body,
    Command,
    Memory,
    Surroundings,
    blocks,
    load,
    store,
)

LEAST_ALTITUDE = 5.0  # m above the bed, of a vehicle that cruises by depth
HALF_PI = 0.25 * TWO_PI


class Motion(NamedTuple):
    """What `move` is compiled for.

    Attributes:
        advance, control, trim, drive: of the `Vehicle`.
        action: of `Action`.
        battery: their batteries end.
        turning: of the `Vehicle`, m.
    """

    advance: Callable[..., Any]
    control: Callable[..., Any]
    trim: Callable[..., Any]
    drive: Callable[..., Any]
    action: int
    battery: bool
    turning: float

    @classmethod
    def of(cls, vehicle: Vehicle, action: int, battery: bool) -> "Motion":
        """The motion of a vehicle, for an action of `Action`, with batteries that end or not."""
        functions = vehicle.advance, vehicle.control, vehicle.trim, vehicle.drive
        return cls(*functions, action, battery, float(vehicle.turning))


@func
def turned(vector: vec3) -> vec3:
    """A vector with components (east, north, up) as (north, east, down), or the other way."""
    return vec3(vector[1], vector[0], -vector[2])


@func
def turned_angle(angle):
    """An angle anticlockwise from east as one clockwise from north, or the other way, rad."""
    return HALF_PI - angle


@func
def turned_gradient(gradient: mat3) -> mat3:
    """∂(component)/∂(place) with both in the other axes of `turned`."""
    axes = mat3([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    return axes @ gradient @ axes


@func
def inwards(p: ti.template(), here: vec2, course: vec2, drift: vec2, radius: ti.f32) -> vec2:
    """A course (unit vector) turned away from the border where a circle of a radius (m) would cross it.

    A vehicle whose course has the component n towards a border at the distance m comes 1 − √(1 − n²) radii nearer
    before it is parallel to it; so n is at most √(1 − (1 − m/radius)²), with m less half a radius as a margin, in which
    the course leads back. `drift` (m over ground while it turns by a radian) counts as lost distance. Along the border
    it goes on where it went, but out of corners.
    """
    way = course
    for axis in ti.static(range(2)):
        other = ti.static(1 - axis)
        side = p[Parameter.width + axis]
        sign = ti.select(here[axis] > 0.5 * side, 1.0, -1.0)
        gap = ti.select(sign > 0.0, side - here[axis], here[axis])
        share = (gap - ti.max(sign * drift[axis], 0.0)) / radius - 0.5
        if share < 1.0:
            most = ti.max(share, -0.9)
            if share > 0.0:
                most = ti.sqrt(share * (2.0 - share))
            if sign * way[axis] > most:
                along = ti.select(way[other] < 0.0, -1.0, 1.0)
                room = ti.select(along > 0.0, p[Parameter.width + other] - here[other], here[other])
                if room < radius:
                    along = -along
                way[axis] = sign * most
                way[other] = along * ti.sqrt(1.0 - most * most)
    return way


@func
def commanded(
    motion_of: ti.template(),
    p: ti.template(),
    auv: ti.template(),
    body: ti.template(),
    action: ti.template(),
    w,
    k,
    n,
) -> vec4:
    """Commands of AUV k's action: heading (clockwise from north), speed, depth and altitude; or as it is."""
    asked = vec4(0.0)
    if ti.static(motion_of.action == Action.fins):
        for c in ti.static(range(3)):
            asked[c] = ti.math.clamp(action[w, k, c], -1.0, 1.0)
    else:
        velocity = motion.water_velocity(p, action[w, k, 0], action[w, k, 1])
        speed = velocity.norm()
        here = vec2(auv[w, k, AuvColumn.x], auv[w, k, AuvColumn.y])
        current = vec2(body[n, BodyColumn.east], body[n, BodyColumn.north])
        radius = ti.static(2.0 * motion_of.turning)  # the autopilot takes its time
        course = inwards(p, here, velocity / speed, radius / speed * current, radius)
        asked[0] = turned_angle(ti.atan2(course[1], course[0]))
        asked[1] = speed
        asked[2] = p.cruise
        asked[3] = ti.max(p.altitude, LEAST_ALTITUDE)
        if ti.static(motion_of.action == Action.vector_depth):
            share = ti.math.clamp(0.5 * (action[w, k, 2] + 1.0), 0.0, 1.0)
            asked[2] = p.depth_min + share * (p.depth_max - p.depth_min)
        elif p.altitude > 0.0:
            asked[2] = body[n, BodyColumn.bed]
            asked[3] = p.altitude
    return asked


@func
def cruise_depth(worlds: ti.template(), x, y):
    """Depth at which a vehicle is deployed at (x, y), m."""
    p = ti.static(worlds.p)
    bed = grid_sample(worlds.water.bed, 0, 0, x, y, p.width, p.length)
    depth = ti.min(p.cruise, bed - LEAST_ALTITUDE)
    if p.altitude > 0.0:
        depth = bed - p.altitude
    return ti.max(depth, 0.0)


@func
def place(worlds: ti.template(), w, k):
    """Put the vehicle of AUV k at its depth where it has been deployed, which the boat knows."""
    depth = cruise_depth(worlds, worlds.auv.x[w, k], worlds.auv.y[w, k])
    below = depth - worlds.p.cruise
    worlds.body.depth[w, k] = depth
    worlds.auv.depth_error[w, k] = below
    worlds.body.told_depth[w, k] = below


@func
def attitude(body: ti.template(), w, k) -> vec4:
    """Cosine and sine of the heading (anticlockwise from east), pitch (nose up) and roll (starboard down), rad, of the
    vehicle of AUV k.
    """
    q0, q1 = body.q0[w, k], body.q1[w, k]
    q2, q3 = body.q2[w, k], body.q3[w, k]
    course = vec2(q1 * q2 + q0 * q3, 0.5 - (q2 * q2 + q3 * q3)).normalized(1e-9)
    pitch = ti.asin(ti.math.clamp(2.0 * (q0 * q2 - q3 * q1), -1.0, 1.0))
    roll = ti.atan2(2.0 * (q2 * q3 + q0 * q1), 1.0 - 2.0 * (q1 * q1 + q2 * q2))
    return vec4(course[0], course[1], pitch, roll)


@func
def sense(worlds: ti.template(), w, k, at_surface: vec2, slopes: vec3):
    """Write the water and the bed at the vehicle of AUV k, and the current there; arguments as of `at_depth.around`."""
    body = ti.static(worlds.body)
    water = ti.static(worlds.water)
    x = worlds.auv.x[w, k]
    y = worlds.auv.y[w, k]
    found = at_depth.around(water, w, x, y, body.depth[w, k], at_surface, slopes)
    velocity = turned(found.velocity)
    rate = turned(found.rate)
    gradient = turned_gradient(found.gradient)
    for i in ti.static(range(3)):
        body[w, k, BodyColumn.north + i] = velocity[i]
        body[w, k, BodyColumn.rate_n + i] = rate[i]
        for j in ti.static(range(3)):
            body[w, k, BodyColumn.nn + 3 * i + j] = gradient[i, j]
    bed = grid_slopes(water.bed, 0, 0, x, y, water.width, water.length)
    body.bed[w, k] = bed[0]
    body.bed_e[w, k] = bed[1]
    body.bed_n[w, k] = bed[2]
    worlds.auv.current_x[w, k] = found.velocity[0]
    worlds.auv.current_y[w, k] = found.velocity[1]


COLUMNS = len(BodyColumn.names)
COMMAND = COLUMNS  # row of a block where a command begins, behind the columns of `BodyColumn`
AWAKE = COMMAND + 4  # where batteries end: 1, or 0 where that of a vehicle is spent
ROWS = AWAKE + 1
OF_A_STEP = "north", "east", "energy", "time", "surfaced", "grounded"  # begin at 0 in each mission step
BODY = tuple(-1 if name in OF_A_STEP else getattr(BodyColumn, name) for name in Body.members)
MEMORY = tuple(getattr(BodyColumn, f"memory_{name}") for name in Memory.members)
SURROUNDINGS = tuple(getattr(BodyColumn, name) for name in Surroundings.members)


@func
def over_ground(body: Body):
    """North and east component of the velocity through the water, m/s."""
    axis = axes(body)
    north = axis.x.x * body.u + axis.y.x * body.v + axis.z.x * body.w
    east = axis.x.y * body.u + axis.y.y * body.v + axis.z.y * body.w
    return north, east


@func
def integrate(motion_of: ti.template(), table: ti.template(), step: ti.f32, substeps: ti.i32, block: ti.template(), g):
    """Move the vehicles of a block through a mission step (s) in some substeps.

    One whose battery is spent turns its propeller off and its fins to zero, and glides until the water stops it.
    """
    body = load(block, g, Body, BODY)
    memory = load(block, g, Memory, MEMORY)
    around = load(block, g, Surroundings, SURROUNDINGS)
    command = load(block, g, Command, ti.static(range(COMMAND, COMMAND + 4)))
    sensor_error = block[g, BodyColumn.sensor_error]
    told = motion_of.drive(table, command.heading, command.speed, command.depth)
    north, east = over_ground(body)
    through_north, through_east = 0.5 * north, 0.5 * east
    share = 1.0 / substeps
    dt = step * share
    for _ in range(substeps):
        if ti.static(motion_of.action != Action.fins):
            told, memory = motion_of.control(table, body, memory, command, around, sensor_error, dt)
        if ti.static(motion_of.battery):
            awake = block[g, AWAKE]
            told = Actuators(rudder=awake * told.rudder, stern=awake * told.stern, propeller=awake * told.propeller)
        body = motion_of.advance(table, body, told, around, dt)
        north, east = over_ground(body)
        through_north += north
        through_east += east
    store(block, g, body, BODY)
    store(block, g, memory, MEMORY)
    block[g, BodyColumn.way_x] = body.east
    block[g, BodyColumn.way_y] = body.north
    block[g, BodyColumn.water_x] = share * (through_east - 0.5 * east)
    block[g, BodyColumn.water_y] = share * (through_north - 0.5 * north)
    block[g, BodyColumn.power] = body.energy / step
    if ti.static(motion_of.battery):
        block[g, BodyColumn.power] = block[g, AWAKE] * body.energy / step
    block[g, BodyColumn.touched] = body.surfaced + 2.0 * body.grounded


@func
def draw(p: ti.template(), key: ti.template(), clock: ti.template(), state: ti.template(), w, k, n) -> vec4:
    """What a vehicle begins its episode with: as a command a heading, and the factors on its mass, drag and fins."""
    for c in range(COLUMNS):
        state[n, c] = 0.0
    place_of_draw = random.uint4(
        ti.cast(key[w, KeyColumn.world], ti.u32),
        ti.cast(clock[w, 0] + 1, ti.u32),
        ti.u32(0),
        ti.cast(Draw.vehicle * 65536 + k, ti.u32),
    )
    seed = random.uint2(ti.cast(key[w, KeyColumn.low], ti.u32), ti.cast(key[w, KeyColumn.high], ti.u32))
    u = random.uniforms(place_of_draw, seed)
    for c in ti.static(range(3)):
        state[n, BodyColumn.mass + c] = 1.0 + p.variation * (2.0 * u[1 + c] - 1.0)
    speed = 0.5 * (p.speed_min + p.speed_max)
    return vec4(TWO_PI * u[0], speed, p.cruise, 0.0)


@kernel
def move(
    deploys: ti.template(),
    serial: ti.template(),
    motion_of: ti.template(),
    substeps: ti.i32,
    p: array1,
    table: array1,
    key: index2,
    clock: index2,
    chosen: mask1,
    action: array3,
    auv: array3,
    state: array2,
    numbers: array3,
    block: blocks,
):
    """Deploy the vehicles of the worlds that are chosen (`deploys`), or move all through a mission step.

    Args:
        substeps: in a mission step. table: of the vehicle. state: (W·K, Y) the array `body` of the worlds.
        numbers, block: workspace of zeros (blocks, `ROWS`, LANES), LANES vehicles a block, as numbers and as lanes.
    """
    scenario = ti.static(Numbers.of(p, Parameter))
    ti.loop_config(serialize=serial, block_dim=1)
    for g in range(block.shape[0]):
        # Columns before `north` change in a step, those up to `way_x` are given, and the rest tell of the step.
        first, last = LANES * g, ti.min(LANES * (g + 1), state.shape[0])
        for n in range(first, last):
            w, k = n // auv.shape[1], n % auv.shape[1]
            asked = vec4(0.0)
            if ti.static(not deploys):
                asked = commanded(motion_of, scenario, auv, state, action, w, k, n)
            elif chosen[w] != 0:
                asked = draw(scenario, key, clock, state, w, k, n)
            for c in range(BodyColumn.way_x):
                numbers[g, c, n - first] = state[n, c]
            numbers[g, BodyColumn.sensor_error, n - first] = state[n, BodyColumn.sensor_error]
            for c in ti.static(range(4)):
                numbers[g, COMMAND + c, n - first] = asked[c]
            if ti.static(motion_of.battery):
                numbers[g, AWAKE, n - first] = ti.select(auv[w, k, AuvColumn.charge] > 0.0, 1.0, 0.0)
        if ti.static(not deploys):
            integrate(motion_of, table, scenario.step, substeps, block, g)
        else:
            asked = load(block, g, Command, ti.static(range(COMMAND, COMMAND + 4)))
            store(block, g, motion_of.trim(table, asked.speed, asked.depth, asked.heading), BODY)
        for n in range(first, last):
            if ti.static(not deploys) or chosen[n // auv.shape[1]] != 0:
                for c in range(BodyColumn.north):
                    state[n, c] = numbers[g, c, n - first]
                for c in range(BodyColumn.way_x, BodyColumn.sensor_error):
                    state[n, c] = numbers[g, c, n - first]
