"""Rules of the data-collection task that the start of an episode and every step share."""

import taichi as ti

from kernels import airy, current, random
from kernels.layout import AuvColumn, BoatColumn, EstimateColumn, Level, NodeColumn, Parameter, vec2


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
def choose_target(p: ti.template(), auv: ti.template(), node: ti.template(), estimate: ti.template(), w, k):
    """Give AUV k the free node with the largest λ b/C − α d, d from its measured position.

    Its present target, the node it has just emptied, is not free: lying at no distance it would win again at once, and
    empty services would be counted without end.
    """
    best = -1
    best_value = -1e30
    for i in range(node.shape[1]):
        free = True
        for j in range(auv.shape[1]):
            if ti.cast(auv[w, j, AuvColumn.target], ti.i32) == i:
                free = False
        if free:
            dx = node[w, i, NodeColumn.x] - estimate[w, k, EstimateColumn.x]
            dy = node[w, i, NodeColumn.y] - estimate[w, k, EstimateColumn.y]
            value = node[w, i, NodeColumn.rate] * node[w, i, NodeColumn.backlog] / p[Parameter.buffer] - p[
                Parameter.distance_weight
            ] * ti.sqrt(dx * dx + dy * dy)
            if value > best_value:
                best = i
                best_value = value
    if best < 0:  # more AUVs than nodes: share the nearest by index
        best = k % node.shape[1]
    auv[w, k, AuvColumn.target] = ti.cast(best, ti.f32)


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
    """Write what AUV k observes; the layout is documented in `usvauv_env.world.World`.

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
