"""What all tasks share: where a random draw is, how an AUV travels and what it observes."""

import math

import taichi as ti

from kernels import random
from kernels.flow import airy, current
from kernels.mission import vehicle
from kernels.mission.columns import (
    BEAM_ANGLE,
    BEAM_CELL,
    BEAMS,
    PROFILE_POINTS,
    AuvColumn,
    BoatColumn,
    EstimateColumn,
    NodeColumn,
    Parameter,
)
from kernels.types import Level, vec2

COSINE, SINE = math.cos(BEAM_ANGLE), math.sin(BEAM_ANGLE)


@ti.func
def address(p: ti.template(), w, episode, step, draw, index):
    """Counter of a random draw: the world's own index, its episode, its mission step, and what the draw is for."""
    return random.uint4(
        ti.cast(w + ti.cast(p[Parameter.first_world], ti.i32), ti.u32),
        ti.cast(episode, ti.u32),
        ti.cast(step, ti.u32),
        ti.cast(draw * 65536 + index, ti.u32),
    )


@ti.func
def distance_to_target(auv: ti.template(), node: ti.template(), w, k):
    """True horizontal distance from AUV k to its target, m."""
    target = ti.cast(auv[w, k, AuvColumn.target], ti.i32)
    return vec2(
        node[w, target, NodeColumn.x] - auv[w, k, AuvColumn.x], node[w, target, NodeColumn.y] - auv[w, k, AuvColumn.y]
    ).norm()


@ti.func
def travel(p: ti.template(), auv: ti.template(), w, k, a0, a1):
    """Move AUV k for one step as commanded and with the water; a move across the border is refused."""
    velocity = vehicle.water_velocity(p, a0, a1)
    auv[w, k, AuvColumn.water_x] = velocity[0]
    auv[w, k, AuvColumn.water_y] = velocity[1]
    auv[w, k, AuvColumn.power] = vehicle.travelling_power(velocity.norm())
    x = auv[w, k, AuvColumn.x]
    y = auv[w, k, AuvColumn.y]
    current = vec2(auv[w, k, AuvColumn.current_x], auv[w, k, AuvColumn.current_y])
    moved = vec2(x, y) + p[Parameter.step] * (velocity + current)
    inside = moved[0] >= 0.0 and moved[0] <= p[Parameter.width]
    inside = inside and moved[1] >= 0.0 and moved[1] <= p[Parameter.length]
    if inside:
        auv[w, k, AuvColumn.x] = moved[0]
        auv[w, k, AuvColumn.y] = moved[1]
        auv[w, k, AuvColumn.moved_x] = moved[0] - x
        auv[w, k, AuvColumn.moved_y] = moved[1] - y
    else:
        auv[w, k, AuvColumn.border] = 1.0


@ti.func
def forget_last_step(auv: ti.template(), w, k):
    """Clear what AUV k did in the step before."""
    auv[w, k, AuvColumn.moved_x] = 0.0
    auv[w, k, AuvColumn.moved_y] = 0.0
    auv[w, k, AuvColumn.border] = 0.0
    auv[w, k, AuvColumn.service_rate] = 0.0
    auv[w, k, AuvColumn.delivered] = 0.0
    auv[w, k, AuvColumn.hovering] = 0.0


@ti.func
def observe(
    p: ti.template(),
    auv: ti.template(),
    node: ti.template(),
    boat: ti.template(),
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
    estimate: ti.template(),
    observation: ti.template(),
    w,
    k,
):
    """Write what AUV k observes; the layout is documented in `usvauv_env.world.world.World`.

    The water's velocity at the AUV is kept: it carries the AUV during the coming step.
    """
    scale = 1.0 / p[Parameter.diagonal]
    x = estimate[w, k, EstimateColumn.x]
    y = estimate[w, k, EstimateColumn.y]
    slot = 0
    for j in range(auv.shape[1]):
        if j != k:
            observation[w, k, slot] = (estimate[w, j, EstimateColumn.x] - x) * scale
            observation[w, k, slot + 1] = (estimate[w, j, EstimateColumn.y] - y) * scale
            slot += 2
    target = ti.cast(auv[w, k, AuvColumn.target], ti.i32)
    observation[w, k, slot] = (node[w, target, NodeColumn.x] - x) * scale
    observation[w, k, slot + 1] = (node[w, target, NodeColumn.y] - y) * scale
    observation[w, k, slot + 2] = x * scale
    observation[w, k, slot + 3] = y * scale
    observation[w, k, slot + 4] = auv[w, k, AuvColumn.border]
    observation[w, k, slot + 5] = boat[w, BoatColumn.overflowing] / node.shape[1]
    true_x = auv[w, k, AuvColumn.x]
    true_y = auv[w, k, AuvColumn.y]
    storm = airy.motion(wave, lane[w], Level.cruise, true_x, true_y)
    here = vec2(storm[3], storm[4])
    here += current.velocity(
        p, vortices, stream, Level.cruise, U, V, unit_x, unit_y, bed, lane[w], cells_x, cells_y, w, true_x, true_y
    )
    auv[w, k, AuvColumn.current_x] = here[0]
    auv[w, k, AuvColumn.current_y] = here[1]
    if p[Parameter.observed_current] > 0.5:
        observation[w, k, slot + 6] = here.norm()
    if p[Parameter.observed_current] > 1.5:
        observation[w, k, slot + 7] = here[0]
        observation[w, k, slot + 8] = here[1]
    if p[Parameter.observed_current] > 2.5:
        towards = vec2(observation[w, k, 2 * auv.shape[1] - 2], observation[w, k, 2 * auv.shape[1] - 1])
        bearing = vec2(1.0, 0.0)
        if towards.norm() > 1e-9:
            bearing = towards.normalized()
        for point in range(PROFILE_POINTS):
            side = point % BEAMS - 1
            reach = BEAM_CELL * (point // BEAMS + 1)
            cosine = ti.select(side == 0, 1.0, COSINE)
            sine = side * SINE
            there_x = true_x + reach * (cosine * bearing[0] - sine * bearing[1])
            there_y = true_y + reach * (sine * bearing[0] + cosine * bearing[1])
            there = current.steady(
                vortices, stream, Level.cruise, w, there_x, there_y, p[Parameter.width], p[Parameter.length]
            )
            observation[w, k, slot + 9 + 2 * point] = there[0]
            observation[w, k, slot + 10 + 2 * point] = there[1]
