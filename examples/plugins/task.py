"""A task: AUVs visit waypoints one after the other. `usvauv eval ideal --plugin task.py --set task=survey`"""

import taichi as ti

from usvauv.extend.task import (
    Metric,
    Quantity,
    RewardTerm,
    Task,
    distance_to_target,
    rewards,
    task_metrics,
    tasks,
    travel,
)
from usvauv.extend.world import Draw, ObservationTerm, observation_terms, uniforms


@ti.func
def place(worlds: ti.template(), w):
    for i in range(worlds.node.shape[1]):
        u = uniforms(worlds, w, Draw.node, i)
        worlds.node.x[w, i] = u[0] * worlds.p.width
        worlds.node.y[w, i] = u[1] * worlds.p.length


@ti.func
def assign(worlds: ti.template(), w, k):
    worlds.auv.target[w, k] = ti.cast(k % worlds.node.shape[1], ti.f32)


@ti.func
def move(worlds: ti.template(), w, k, a0, a1):
    before = distance_to_target(worlds, w, k)
    travel(worlds, w, k, a0, a1)
    after = distance_to_target(worlds, w, k)
    worlds.auv.closed[w, k] = before - after
    if after < worlds.task_parameters.radius:
        worlds.auv.delivered[w, k] = 1.0


@ti.func
def update(worlds: ti.template(), w):
    """Waypoints stay as they are."""


@ti.func
def finish(worlds: ti.template(), w):
    for k in range(worlds.auv.shape[1]):
        if worlds.auv.delivered[w, k] > 0.0:
            following = ti.cast(worlds.auv.target[w, k], ti.i32) + worlds.auv.shape[1]
            worlds.auv.target[w, k] = ti.cast(following % worlds.node.shape[1], ti.f32)


@ti.func
def visit(worlds: ti.template(), w, k, weight):
    return weight * worlds.auv.delivered[w, k]


@ti.func
def distance_left(worlds: ti.template(), w, k, first):
    worlds.observation[w, k, first] = distance_to_target(worlds, w, k) / worlds.p.diagonal


tasks.register(
    "survey",
    Task(
        place=place,
        assign=assign,
        move=move,
        update=update,
        finish=finish,
        # A weight of None is that of the scenario's section `reward`.
        reward_terms=(RewardTerm("distance", rewards.distance, None), RewardTerm("visit", visit, 10.0)),
        parameters=(("radius", Quantity(5.0, 0.1, 1000.0, "distance at which a waypoint is reached, m")),),
        observation=("distance_left",),
    ),
)
observation_terms.register(
    "distance_left", ObservationTerm(distance_left, lambda num_auvs: ["distance to the waypoint"], "D", 0.0, 1.0)
)
task_metrics.register("visits", Metric("survey", lambda trace: trace.delivered.sum(axis=(0, 2))))
