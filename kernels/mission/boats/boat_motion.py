"""How boats move, and which boat serves which AUV.

Each AUV is served by the boat nearest to its estimated position: that boat plans for it, and interrogates it if AUVs
are interrogated one at a time. Another boat takes over if it is nearer by more than the share `HYSTERESIS`. With one
boat none of this is compiled.
"""

import math
from typing import Any

import taichi as ti

from usvauv.kernels.flow import airy, current
from usvauv.kernels.functions import func
from usvauv.kernels.mission.auvs.vehicles import turned_angle
from usvauv.kernels.mission.columns import BoatColumn, Draw, Parameter
from usvauv.kernels.mission.draws import normals
from usvauv.kernels.taichi_internals import Expr
from usvauv.kernels.types import Level, vec2, vec3
from usvauv.kernels.vehicles import otter
from usvauv.kernels.vehicles.otter import HullColumn

HYSTERESIS = 0.1  # of the distance to the boat that serves an AUV
LLOYD_ITERATIONS = 8


@func
def serving_boat(worlds: ti.template(), w, k) -> ti.i32:
    """Index of the boat that serves AUV k."""
    b = 0
    if ti.static(worlds.program.fleet):
        b = ti.cast(worlds.estimate.served_by[w, k], ti.i32)
    return b


@func
def serves(worlds: ti.template(), w, b, k) -> bool:
    """Whether boat b serves AUV k."""
    found = True
    if ti.static(worlds.program.fleet):
        found = serving_boat(worlds, w, k) == b
    return found


@func
def num_served(worlds: ti.template(), w, b) -> ti.i32:
    """Number of AUVs that boat b serves."""
    count = worlds.estimate.shape[1]
    if ti.static(worlds.program.fleet):
        count = 0
        for k in range(worlds.estimate.shape[1]):
            count += ti.cast(serves(worlds, w, b, k), ti.i32)
    return count


@func
def boat_place(worlds: ti.template(), w, b) -> vec2:
    """Where boat b is, m."""
    return vec2(worlds.boat.x[w, b], worlds.boat.y[w, b])


@func
def goal_place(worlds: ti.template(), w, b) -> vec2:
    """Where boat b is under way to, m."""
    return vec2(worlds.boat.goal_x[w, b], worlds.boat.goal_y[w, b])


@func
def estimated_place(worlds: ti.template(), w, k) -> vec2:
    """Where AUV k is estimated, m."""
    return vec2(worlds.estimate.x[w, k], worlds.estimate.y[w, k])


@func
def centre_of_served(worlds: ti.template(), w, b) -> vec2:
    """Mean of the estimated positions of the AUVs that boat b serves; where it serves none, its own place, m."""
    count = num_served(worlds, w, b)
    mean = vec2(0.0, 0.0)
    for k in range(worlds.estimate.shape[1]):
        if serves(worlds, w, b, k):
            mean += estimated_place(worlds, w, k) / count
    if count == 0:
        mean = boat_place(worlds, w, b)
    return mean


@func
def assign_boats(worlds: ti.template(), w, hysteresis):
    """Decide which boat serves each AUV from now on; `hysteresis` is a share of the distance to the present one."""
    if ti.static(worlds.program.fleet):
        for k in range(worlds.estimate.shape[1]):
            here = estimated_place(worlds, w, k)
            best = serving_boat(worlds, w, k)
            least = (1.0 - hysteresis) * (boat_place(worlds, w, best) - here).norm()
            for b in range(worlds.boat.shape[1]):
                distance = (boat_place(worlds, w, b) - here).norm()
                if distance < least:
                    best = b
                    least = distance
            worlds.estimate.served_by[w, k] = ti.cast(best, ti.f32)


@func
def put_boat(worlds: ti.template(), w, b, place: vec2):
    """Put boat b at a place, m."""
    worlds.boat.x[w, b] = place[0]
    worlds.boat.y[w, b] = place[1]


@func
def partition(worlds: ti.template(), w):
    """Split the AUVs among the boats by their places, and put each boat in the middle of its AUVs (k-means).

    The first boat begins at the first AUV and each other one at the AUV that is farthest from the boats before it;
    then Lloyd's iteration, Lloyd (1982), doi:10.1109/TIT.1982.1056489.
    """
    if ti.static(worlds.program.fleet):
        for b in range(worlds.boat.shape[1]):
            farthest = 0
            largest = -1.0
            for k in range(worlds.estimate.shape[1]):
                nearest = 1e30
                for other in range(b):
                    nearest = ti.min(nearest, (boat_place(worlds, w, other) - estimated_place(worlds, w, k)).norm())
                if nearest > largest:
                    largest = nearest
                    farthest = k
            put_boat(worlds, w, b, estimated_place(worlds, w, farthest))
        for _ in range(LLOYD_ITERATIONS):
            assign_boats(worlds, w, 0.0)
            for b in range(worlds.boat.shape[1]):
                put_boat(worlds, w, b, centre_of_served(worlds, w, b))


LARGEST = 1e12  # m, of a goal
CONTROL_TIME = 10.0  # s, in which a boat with a lag makes good 63 % of an error of place, so that it follows the waves
LEAST_HEADWAY = 0.25  # of its top speed over ground, below which a boat gives an AUV up
DRIFT_TIME = 30.0  # s, over which it takes the mean of the velocity with which it is carried


def is_vec2(value: Any) -> bool:
    """Whether what a Taichi function returned is one."""
    return isinstance(value, Expr) and value.is_tensor() and value.get_shape() == (2,)


@func
def set_goal(worlds: ti.template(), w, b, goal):
    """Make a place the goal of boat b; outside the area, the area's nearest point.

    A goal that is no place stays in its columns, which ends the run; the boat itself stays in the area.
    """
    ti.static_assert(is_vec2(goal), "start and goal of a boat strategy return a vec2")
    for axis in ti.static(range(2)):
        side = worlds.p[Parameter.width + axis]
        worlds.boat[w, b, BoatColumn.goal_x + axis] = ti.min(ti.max(goal[axis], 0.0), side)
        if not (ti.abs(goal[axis]) <= LARGEST):
            worlds.boat[w, b, BoatColumn.goal_x + axis] = ti.math.nan


@func
def clear_boats(worlds: ti.template(), w):
    """Clear what is known of the boats of the last episode, and split the AUVs among them."""
    for b in range(worlds.boat.shape[1]):
        for c in range(worlds.boat.shape[2]):
            worlds.boat[w, b, c] = 0.0
    partition(worlds, w)


@func
def put_at_goal(worlds: ti.template(), w, b):
    """Put boat b where its strategy begins."""
    boat = ti.static(worlds.boat)
    boat.x[w, b] = ti.min(ti.max(boat.goal_x[w, b], 0.0), worlds.p.width)
    boat.y[w, b] = ti.min(ti.max(boat.goal_y[w, b], 0.0), worlds.p.length)
    if ti.static(worlds.program.otter):
        for c in ti.static(range(len(HullColumn.names))):
            worlds.hull[w, b, c] = 0.0


@func
def command_to(worlds: ti.template(), w, b, way: vec2) -> vec2:
    """Velocity through the water that leads boat b with a lag to its goal, which is `way` (m) from it, m/s.

    It has learned d, the drift's mean over `DRIFT_TIME`. Where it would come to rest over ground, x + T (v + d) with
    the response time T and its velocity through the water v, moves with c + d, so that the command

        c = (goal − x − T (v + d)), shortened by the dead band, over the control time, less d,

    |c| at most the top speed, leads to its goal without overshoot, however long T and the step are.
    """
    p = ti.static(worlds.p)
    boat = ti.static(worlds.boat)
    learned = learned_drift(worlds, w, b)
    velocity = vec2(boat.water_x[w, b], boat.water_y[w, b])
    ahead = way - p.response_time * (velocity + learned)
    asked = ti.max(1.0 - p.dead_band / ti.max(ahead.norm(), 1e-6), 0.0) / p.control_time
    command = asked * ahead - learned
    speed = command.norm()
    if speed > p.top_speed:
        command *= p.top_speed / speed
    return command


@func
def learned_drift(worlds: ti.template(), w, b) -> vec2:
    """Velocity with which water and wind have carried boat b in the mean of the last `DRIFT_TIME`, m/s."""
    return vec2(worlds.boat.drift_x[w, b], worlds.boat.drift_y[w, b])


@func
def expected_drift(worlds: ti.template(), w, b, time) -> vec2:
    """Velocity with which water and wind will carry boat b after some time (s), m/s.

    The leeway lasts; the remainder of the learned drift is of eddies, which the boat leaves in `DRIFT_TIME`.
    """
    leeway = vec2(worlds.p.leeway_x, worlds.p.leeway_y)
    return leeway + ti.exp(-time / DRIFT_TIME) * (learned_drift(worlds, w, b) - leeway)


@func
def can_approach(worlds: ti.template(), w, b, place: vec2) -> bool:
    """Whether boat b makes good `LEAST_HEADWAY` of its top speed over ground towards a place, in its present drift."""
    drift = learned_drift(worlds, w, b)
    way = place - boat_place(worlds, w, b)
    ahead = way / ti.max(way.norm(), 1e-6)
    top = worlds.p.top_speed
    along = ahead.dot(drift)
    across = drift.norm_sqr() - along * along
    return across < top * top and along + ti.sqrt(ti.max(top * top - across, 0.0)) >= LEAST_HEADWAY * top


@func
def has_moved(worlds: ti.template(), w, b, velocity: vec2, drift: vec2):
    """Note the velocity of boat b through the water at the end of a step, and learn from the drift in it, m/s."""
    boat = ti.static(worlds.boat)
    for axis in ti.static(range(2)):
        learned = boat[w, b, BoatColumn.drift_x + axis]
        learned = drift[axis] + worlds.p.drift_memory * (learned - drift[axis])
        boat[w, b, BoatColumn.water_x + axis] = velocity[axis]
        boat[w, b, BoatColumn.drift_x + axis] = learned


@func
def way_through_water(worlds: ti.template(), w, b, way: vec2, drift: vec2) -> vec2:
    """How far a point with a lag gets through the water in a step, m; its velocity and estimate of the drift follow.

    Its velocity through the water v follows the command c of `command_to` with the response time T, T dv/dt = c − v,
    exactly over the step, in which c is constant; so its thrust gives an acceleration of at most the top speed over T
    from rest.

    Args:
        way: to the goal, m.
        drift: velocity with which water and wind carry it, m/s.
    """
    p = ti.static(worlds.p)
    command = command_to(worlds, w, b, way)
    lacking = vec2(worlds.boat.water_x[w, b], worlds.boat.water_y[w, b]) - command
    memory = p.response_memory
    has_moved(worlds, w, b, command + memory * lacking, drift)
    return p.step * command + p.response_time * (1.0 - memory) * lacking


@func
def turn_towards(worlds: ti.template(), heading, way: vec2, longest) -> vec2:
    """By how much an Otter of some heading (rad) turns until it can go some way (m), and the time of that, s.

    It turns on the spot at the greatest rate of its autopilot, for `longest` (s) at most; planners reckon so.
    """
    rate = worlds.otter[otter.Number.turn_rate]
    angle = otter.wrap(ti.atan2(way[1], way[0]) - heading)
    time = ti.min(ti.abs(angle) / rate, longest)
    return vec2(ti.math.sign(angle) * rate * time, time)


STILL = 0.1  # m/s, of a command up to which an Otter keeps its heading
ASTERN = 0.5  # m/s, of a command up to which it goes astern rather than turn


@func
def boat_heading(worlds: ti.template(), w, b) -> ti.f32:
    """Heading of an Otter, rad anticlockwise from east."""
    return turned_angle(worlds.hull.heading[w, b])


@func
def reach(worlds: ti.template(), w, b) -> vec3:
    """Middle and radius of the disc of goals towards which boat b slows down, m; without lag the way of a step.

    Water and wind carry the middle along meanwhile. An Otter that turns by θ at the rate ω before it goes at top speed
    V gets as far in the time in which it turns round and slows down as in the direction θ the way of slowing down and
    (π − θ) V/ω. So half the greatest of these is what the middle lies ahead of it and the radius is longer.
    """
    p = ti.static(worlds.p)
    middle = boat_place(worlds, w, b) + p.control_time * learned_drift(worlds, w, b)
    radius = p.top_speed * p.control_time + p.dead_band
    if ti.static(worlds.program.otter):
        heading = boat_heading(worlds, w, b)
        ahead = 0.5 * math.pi * p.top_speed / worlds.otter[otter.Number.turn_rate]
        middle += ahead * vec2(ti.cos(heading), ti.sin(heading))
        radius += ahead
    for axis in ti.static(range(2)):
        middle[axis] = ti.math.clamp(middle[axis], 0.0, p[Parameter.width + axis])
    return vec3(middle[0], middle[1], radius)


@func
def integrate_hull(worlds: ti.template(), w, b, way: vec2, current: vec2) -> vec2:
    """How far an Otter gets through the water in a step, m; its hull, velocity and estimate of the drift follow.

    It turns into the direction of the command of `command_to` and goes at the part of its speed that is ahead; within
    the dead band the command stems the drift. Slow ones it obeys astern where that is nearer, the slowest with the
    heading that it has. Its measured drift is its velocity over ground minus the velocity ahead through the water.

    Args:
        way: to the goal, m. current: velocity of the water, m/s.
    """
    p = ti.static(worlds.p)
    table = ti.static(worlds.otter)
    command = command_to(worlds, w, b, way)
    speed = command.norm()
    air = vec2(p.wind_y, p.wind_x) - vec2(current[1], current[0])
    count = ti.ceil(p.step / table[otter.Number.substep] - 1e-3)
    dt = p.step / count
    hull = otter.boat8(0.0)
    for c in ti.static(range(len(HullColumn.names))):
        hull[c] = worlds.hull[w, b, c]
    moved = vec2(0.0, 0.0)
    sideways = vec2(0.0, 0.0)
    for _ in range(int(count)):
        heading = hull[HullColumn.heading]
        bow = vec2(ti.sin(heading), ti.cos(heading))
        along = command.dot(bow)
        course = heading
        if speed > STILL:
            course = ti.atan2(command[0], command[1])
            if speed < ASTERN and along < 0.0:
                course += math.pi
        if speed >= ASTERN:
            along = ti.max(along, 0.0)
        orders, hull = otter.steer(table, hull, course, along, dt)
        hull, step = otter.advance(table, hull, orders, air, dt)
        moved += vec2(step[1], step[0])
        sideways += dt * hull[HullColumn.v] * vec2(ti.cos(hull[HullColumn.heading]), -ti.sin(hull[HullColumn.heading]))
    for c in ti.static(range(len(HullColumn.names))):
        worlds.hull[w, b, c] = hull[c]
    c, s = ti.cos(hull[HullColumn.heading]), ti.sin(hull[HullColumn.heading])
    velocity = hull[HullColumn.u] * vec2(s, c) + hull[HullColumn.v] * vec2(c, -s)
    has_moved(worlds, w, b, velocity, current + sideways / p.step)
    return moved


@func
def move_boat(worlds: ti.template(), w, b):
    """Go towards the goal through the water, while water and wind carry the boat.

    A point without a lag goes to the reachable point nearest to the goal, at most at top speed.
    """
    p = ti.static(worlds.p)
    boat = ti.static(worlds.boat)
    dt = p.step
    x = boat.x[w, b]
    y = boat.y[w, b]
    drift = p.drifts * dt * vec2(boat.current_x[w, b], boat.current_y[w, b])
    wanted = vec2(boat.goal_x[w, b] - x, boat.goal_y[w, b] - y)
    farthest = p.top_speed * dt
    distance = 0.0
    if ti.static(worlds.program.otter):
        wanted = integrate_hull(worlds, w, b, wanted, drift / dt)
        distance = wanted.norm()
    elif p.response_time > 0.0:
        drift += dt * vec2(p.leeway_x, p.leeway_y)
        wanted = way_through_water(worlds, w, b, wanted, drift / dt)
        distance = wanted.norm()
    else:
        wanted = wanted - drift
        distance = wanted.norm()
        if distance > farthest:
            wanted *= farthest / distance
        has_moved(worlds, w, b, wanted / dt, drift / dt)
    boat.effort[w, b] = ti.min(distance / farthest, 1.0)
    boat.x[w, b] = ti.min(ti.max(x + drift[0] + wanted[0], 0.0), p.width)
    boat.y[w, b] = ti.min(ti.max(y + drift[1] + wanted[1], 0.0), p.length)
    boat.moved_x[w, b] = boat.x[w, b] - x
    boat.moved_y[w, b] = boat.y[w, b] - y


@func
def ride_waves(worlds: ti.template(), w, b):
    """Store elevation and slope of the sea under boat b, long and short waves, and the storm's velocity there.

    That is, to second order, the one at its elevation: see `usvauv.kernels.flow.airy`.
    """
    boat = ti.static(worlds.boat)
    water = ti.static(worlds.water)
    x = boat.x[w, b]
    y = boat.y[w, b]
    dx = water.width / water.nx
    dy = water.length / water.ny
    surface = current.long_wave_surface(water.eta, water.sea_index[w], x, y, dx, dy, water.nx, water.ny)
    groups = water.wave.shape[1]
    storm = airy.motion(water.wave, water.since, water.sea_index[w], groups, Level.surface, x, y)
    boat.elevation[w, b] = surface[0] + storm[0]
    boat.slope_x[w, b] = surface[1] + storm[1]
    boat.slope_y[w, b] = surface[2] + storm[2]
    boat.current_x[w, b] = storm[3] + storm[0] * storm[6]
    boat.current_y[w, b] = storm[4] + storm[0] * storm[7]


@func
def drift_along(worlds: ti.template(), w, b, vortices: vec2):
    """Add what carries boat b besides the storm: vortices (m/s), real currents and long waves, at the surface."""
    boat = ti.static(worlds.boat)
    water = ti.static(worlds.water)
    place = boat_place(worlds, w, b)
    velocity = vortices + current.real_current(water, place[0], place[1], 0.0)
    velocity += current.long_wave_velocity(water, water.sea_index[w], place[0], place[1])
    boat.current_x[w, b] = boat.current_x[w, b] + velocity[0]
    boat.current_y[w, b] = boat.current_y[w, b] + velocity[1]


@func
def renew_gnss_error(worlds: ti.template(), w, b):
    """The error of the boat's own position: a Gauss–Markov process, in its stationary state from the start."""
    p = ti.static(worlds.p)
    memory = p.gnss_memory
    if worlds.clock[w, 1] == 0:
        memory = 0.0
    noise = normals(worlds, w, Draw.gnss, b)
    new = p.gnss_error * ti.sqrt(1.0 - memory * memory)
    for axis in ti.static(range(2)):
        column = ti.static(BoatColumn.gnss_x + axis)
        worlds.boat[w, b, column] = memory * worlds.boat[w, b, column] + new * noise[axis]
