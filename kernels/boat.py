"""The boat: where its strategy sends it, how it gets there, how it rides the sea, and the fixes it takes."""

import taichi as ti

from kernels import airy, c_grid, current, fisher, random, usbl
from kernels.layout import AuvColumn, BoatColumn, Level, Parameter, Strategy, vec2, vec3


@ti.func
def plan(p: ti.template(), link: ti.template(), boat: ti.template(), estimate: ti.template(), w):
    """The strategy's goal for the boat, from estimated positions only."""
    strategy = ti.cast(p[Parameter.strategy], ti.i32)
    goal = vec2(p[Parameter.hold_x], p[Parameter.hold_y])
    num_auvs = estimate.shape[1]
    if strategy == Strategy.centroid:
        goal = vec2(0.0, 0.0)
        for k in range(num_auvs):
            goal += vec2(estimate[w, k, 0], estimate[w, k, 1]) / num_auvs
    elif strategy == Strategy.fim:
        best = fisher.plan(
            estimate,
            w,
            num_auvs,
            link,
            ti.cast(p[Parameter.information_form], ti.i32),
            boat[w, BoatColumn.goal_x],
            boat[w, BoatColumn.goal_y],
            p[Parameter.width],
            p[Parameter.length],
        )
        goal = vec2(best[0], best[1])
    boat[w, BoatColumn.goal_x] = ti.min(ti.max(goal[0], 0.0), p[Parameter.width])
    boat[w, BoatColumn.goal_y] = ti.min(ti.max(goal[1], 0.0), p[Parameter.length])


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
    surface = c_grid.sample(
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


@ti.func
def take_fix(
    p: ti.template(),
    link: ti.template(),
    auv: ti.template(),
    boat: ti.template(),
    estimate: ti.template(),
    counter,
    attitude_counter,
    key_low,
    key_high,
    w,
    k,
):
    """USBL fix of AUV k from the boat on its wave: measured position, its predicted covariance and its true error."""
    z = -(p[Parameter.separation_boat] + boat[w, BoatColumn.elevation])
    offset = vec3(auv[w, k, AuvColumn.x] - boat[w, BoatColumn.x], auv[w, k, AuvColumn.y] - boat[w, BoatColumn.y], z)
    slope = p[Parameter.tilt] * vec2(boat[w, BoatColumn.slope_x], boat[w, BoatColumn.slope_y])
    noise = random.normals(counter, key_low, key_high)
    tilt = random.normals(attitude_counter, key_low, key_high)
    deviation = p[Parameter.attitude_error]
    measured = usbl.fix(link, k, offset, slope, deviation, vec2(noise[0], noise[1]), noise[2], vec2(tilt[0], tilt[1]))
    spread = usbl.horizontal_covariance(link, k, offset, slope, deviation, measured[3])
    estimate[w, k, 0] = boat[w, BoatColumn.x] + measured[0]
    estimate[w, k, 1] = boat[w, BoatColumn.y] + measured[1]
    estimate[w, k, 2] = -z
    auv[w, k, AuvColumn.covariance_xx] = spread[0]
    auv[w, k, AuvColumn.covariance_xy] = spread[1]
    auv[w, k, AuvColumn.covariance_yy] = spread[2]
    error = vec2(measured[0] - offset[0], measured[1] - offset[1])
    auv[w, k, AuvColumn.fix_error] = error.norm()
