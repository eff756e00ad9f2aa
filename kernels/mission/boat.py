"""The boat: where its strategy sends it, how it gets there, and how it rides the sea."""

import taichi as ti

from kernels.flow import airy, current
from kernels.mission.columns import BoatColumn, Parameter, Strategy
from kernels.planning import global_search, objectives, receding_horizon
from kernels.shallow_water import packing
from kernels.types import Level, vec2


@ti.func
def destination(
    p: ti.template(),
    link: ti.template(),
    options: ti.template(),
    boat: ti.template(),
    estimate: ti.template(),
    reach,
    w,
) -> vec2:
    """Where the strategy would have the boat, by where the AUVs are now; no farther than `reach` (m) for any `fim`."""
    num_auvs = estimate.shape[1]
    goal = vec2(p[Parameter.hold_x], p[Parameter.hold_y])
    if ti.static(options.strategy == Strategy.centroid):
        goal = vec2(0.0, 0.0)
        for k in range(num_auvs):
            goal += vec2(estimate[w, k, 0], estimate[w, k, 1]) / num_auvs
    elif ti.static(options.strategy == Strategy.fim_greedy):
        best = global_search.greedy(
            estimate,
            w,
            num_auvs,
            link,
            options.form,
            boat[w, BoatColumn.x],
            boat[w, BoatColumn.y],
            reach,
            p[Parameter.width],
            p[Parameter.length],
        )
        goal = vec2(best[0], best[1])
    elif ti.static(options.strategy != Strategy.hold):
        best = global_search.plan(
            estimate,
            w,
            num_auvs,
            link,
            options.form,
            boat[w, BoatColumn.goal_x],
            boat[w, BoatColumn.goal_y],
            p[Parameter.width],
            p[Parameter.length],
        )
        goal = vec2(best[0], best[1])
    return goal


@ti.func
def ahead(
    p: ti.template(),
    link: ti.template(),
    options: ti.template(),
    boat: ti.template(),
    estimate: ti.template(),
    track: ti.template(),
    w,
) -> vec2:
    """The goal of `fim-horizon`."""
    outlook = receding_horizon.Outlook(
        criterion=ti.static(objectives.objective_of(options.form)),
        variance=p[Parameter.current_variance],
        correlation_time=p[Parameter.correlation_time],
        top_speed=p[Parameter.top_speed],
        step=p[Parameter.step],
        steps=ti.cast(p[Parameter.horizon], ti.i32),
    )
    here = vec2(boat[w, BoatColumn.x], boat[w, BoatColumn.y])
    last = vec2(boat[w, BoatColumn.goal_x], boat[w, BoatColumn.goal_y])
    best = receding_horizon.plan(track, estimate, w, link, outlook, here, last, p[Parameter.width], p[Parameter.length])
    return vec2(best[0], best[1])


@ti.func
def head_for(p: ti.template(), boat: ti.template(), goal: vec2, w):
    """Make a place the boat's goal, the nearest point of the area where it is outside."""
    boat[w, BoatColumn.goal_x] = ti.min(ti.max(goal[0], 0.0), p[Parameter.width])
    boat[w, BoatColumn.goal_y] = ti.min(ti.max(goal[1], 0.0), p[Parameter.length])


@ti.func
def plan(
    p: ti.template(),
    link: ti.template(),
    options: ti.template(),
    boat: ti.template(),
    estimate: ti.template(),
    track: ti.template(),
    w,
):
    """Let the strategy choose the boat's goal, from estimated positions only."""
    if ti.static(options.strategy == Strategy.fim_horizon):
        head_for(p, boat, ahead(p, link, options, boat, estimate, track, w), w)
    else:
        reach = p[Parameter.top_speed] * p[Parameter.step]
        head_for(p, boat, destination(p, link, options, boat, estimate, reach, w), w)


@ti.func
def move(p: ti.template(), boat: ti.template(), w):
    """The reachable point nearest to the goal: top speed through the water, while the water carries the boat."""
    dt = p[Parameter.step]
    x = boat[w, BoatColumn.x]
    y = boat[w, BoatColumn.y]
    drift = p[Parameter.drifts] * dt * vec2(boat[w, BoatColumn.current_x], boat[w, BoatColumn.current_y])
    wanted = vec2(boat[w, BoatColumn.goal_x] - x, boat[w, BoatColumn.goal_y] - y) - drift
    reach = p[Parameter.top_speed] * dt
    far = wanted.norm()
    if far > reach:
        wanted *= reach / far
    boat[w, BoatColumn.x] = ti.min(ti.max(x + drift[0] + wanted[0], 0.0), p[Parameter.width])
    boat[w, BoatColumn.y] = ti.min(ti.max(y + drift[1] + wanted[1], 0.0), p[Parameter.length])
    boat[w, BoatColumn.moved_x] = boat[w, BoatColumn.x] - x
    boat[w, BoatColumn.moved_y] = boat[w, BoatColumn.y] - y


@ti.func
def ride(
    p: ti.template(),
    boat: ti.template(),
    eta: ti.template(),
    U: ti.template(),
    V: ti.template(),
    unit_x,
    unit_y,
    wave: ti.template(),
    stream: ti.template(),
    bed: ti.template(),
    lane: ti.template(),
    cells_x,
    cells_y,
    vortices: ti.template(),
    w,
):
    """Elevation and slope of the sea under the boat, long and short waves, and the velocity of the water there."""
    x = boat[w, BoatColumn.x]
    y = boat[w, BoatColumn.y]
    surface = packing.sample(
        eta,
        lane[w],
        x,
        y,
        p[Parameter.width] / cells_x,
        p[Parameter.length] / cells_y,
        cells_x,
        cells_y,
    )
    storm = airy.motion(wave, lane[w], Level.surface, x, y)
    water = current.velocity(
        p, vortices, stream, Level.surface, U, V, unit_x, unit_y, bed, lane[w], cells_x, cells_y, w, x, y
    )
    boat[w, BoatColumn.elevation] = surface[0] + storm[0]
    boat[w, BoatColumn.slope_x] = surface[1] + storm[1]
    boat[w, BoatColumn.slope_y] = surface[2] + storm[2]
    boat[w, BoatColumn.current_x] = water[0] + storm[3]
    boat[w, BoatColumn.current_y] = water[1] + storm[4]
