"""A boat: how it gets to its goal, and how it rides the sea."""

import taichi as ti

from usvauv.kernels.flow import airy, current
from usvauv.kernels.mission import serving
from usvauv.kernels.mission.columns import BoatColumn, Draw, Parameter
from usvauv.kernels.mission.worlds import normals
from usvauv.kernels.types import Level, vec2

LARGEST = 1e12  # m, of a goal


@ti.func
def set_goal(worlds: ti.template(), w, b, goal: vec2):
    """Make a place the goal of boat b; outside the area, the area's nearest point.

    A goal that is no place stays in its columns, which ends the run; the boat itself stays in the area.
    """
    for axis in ti.static(range(2)):
        side = worlds.p[Parameter.width + axis]
        worlds.boat[w, b, BoatColumn.goal_x + axis] = ti.min(ti.max(goal[axis], 0.0), side)
        if not (ti.abs(goal[axis]) <= LARGEST):
            worlds.boat[w, b, BoatColumn.goal_x + axis] = ti.math.nan


@ti.func
def place(worlds: ti.template(), w):
    """Put the boats where their strategy begins, each with AUVs of its own."""
    boat = ti.static(worlds.boat)
    for b in range(boat.shape[1]):
        for c in range(boat.shape[2]):
            boat[w, b, c] = 0.0
    serving.split(worlds, w)
    for b in range(boat.shape[1]):
        set_goal(worlds, w, b, worlds.program.strategy.start(worlds, w, b))
        boat[w, b, BoatColumn.x] = ti.min(ti.max(boat[w, b, BoatColumn.goal_x], 0.0), worlds.p[Parameter.width])
        boat[w, b, BoatColumn.y] = ti.min(ti.max(boat[w, b, BoatColumn.goal_y], 0.0), worlds.p[Parameter.length])
    serving.allot(worlds, w, 0.0)


@ti.func
def move(worlds: ti.template(), w, b):
    """Go to the reachable point nearest to the goal: top speed through the water, while the water carries the boat."""
    p = ti.static(worlds.p)
    boat = ti.static(worlds.boat)
    dt = p[Parameter.step]
    x = boat[w, b, BoatColumn.x]
    y = boat[w, b, BoatColumn.y]
    drift = p[Parameter.drifts] * dt * vec2(boat[w, b, BoatColumn.current_x], boat[w, b, BoatColumn.current_y])
    wanted = vec2(boat[w, b, BoatColumn.goal_x] - x, boat[w, b, BoatColumn.goal_y] - y) - drift
    reach = p[Parameter.top_speed] * dt
    distance = wanted.norm()
    boat[w, b, BoatColumn.effort] = ti.min(distance / reach, 1.0)
    if distance > reach:
        wanted *= reach / distance
    boat[w, b, BoatColumn.x] = ti.min(ti.max(x + drift[0] + wanted[0], 0.0), p[Parameter.width])
    boat[w, b, BoatColumn.y] = ti.min(ti.max(y + drift[1] + wanted[1], 0.0), p[Parameter.length])
    boat[w, b, BoatColumn.moved_x] = boat[w, b, BoatColumn.x] - x
    boat[w, b, BoatColumn.moved_y] = boat[w, b, BoatColumn.y] - y


@ti.func
def ride(worlds: ti.template(), w, b):
    """Store elevation and slope of the sea under boat b, long and short waves, and the water's velocity there."""
    boat = ti.static(worlds.boat)
    water = ti.static(worlds.water)
    x = boat[w, b, BoatColumn.x]
    y = boat[w, b, BoatColumn.y]
    dx = water.width / water.nx
    dy = water.length / water.ny
    surface = current.long_wave_surface(water.eta, water.sea_index[w], x, y, dx, dy, water.nx, water.ny)
    storm = airy.motion(water.wave, water.sea_index[w], Level.surface, x, y)
    velocity = current.velocity(water, Level.surface, w, x, y)
    boat[w, b, BoatColumn.elevation] = surface[0] + storm[0]
    boat[w, b, BoatColumn.slope_x] = surface[1] + storm[1]
    boat[w, b, BoatColumn.slope_y] = surface[2] + storm[2]
    boat[w, b, BoatColumn.current_x] = velocity[0] + storm[3]
    boat[w, b, BoatColumn.current_y] = velocity[1] + storm[4]


@ti.func
def locate(worlds: ti.template(), w, b):
    """The error of the boat's own position: a Gauss–Markov process, in its stationary state from the start."""
    p = ti.static(worlds.p)
    memory = p[Parameter.gnss_memory]
    if worlds.clock[w, 1] == 0:
        memory = 0.0
    noise = normals(worlds, w, Draw.gnss, b)
    new = p[Parameter.gnss_error] * ti.sqrt(1.0 - memory * memory)
    for axis in ti.static(range(2)):
        column = ti.static(BoatColumn.gnss_x + axis)
        worlds.boat[w, b, column] = memory * worlds.boat[w, b, column] + new * noise[axis]
