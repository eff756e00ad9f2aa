"""The task of keeping station: every AUV holds its place in a formation in any current."""

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.mission.auvs.motion import distance_to_target, travel
from usvauv.kernels.mission.columns import Draw
from usvauv.kernels.mission.draws import uniforms
from usvauv.kernels.mission.tasks import rewards
from usvauv.kernels.mission.tasks.task import SHIPPED, Task, tasks
from usvauv.kernels.transcendental import TWO_PI


@func
def place_stations(worlds: ti.template(), w):
    """Spread the stations of a new episode evenly over a circle about the area's centre, turned at random."""
    p = ti.static(worlds.p)
    node = ti.static(worlds.node)
    u = uniforms(worlds, w, Draw.node, 0)
    count = node.shape[1]
    for i in range(count):
        angle = TWO_PI * (u[0] + i / count)
        node.x[w, i] = 0.5 * p.width + p.formation_radius * ti.cos(angle)
        node.y[w, i] = 0.5 * p.length + p.formation_radius * ti.sin(angle)
        node.kind[w, i] = 0.0
        node.rate[w, i] = 0.0
        node.backlog[w, i] = 0.0
        node.tour[w, i] = 0.0
        node.successor[w, i] = 0.0


@func
def assign_station(worlds: ti.template(), w, k):
    """AUV k holds station k."""
    worlds.auv.target[w, k] = ti.cast(k, ti.f32)


@func
def move(worlds: ti.template(), w, k, a0, a1):
    """One step of AUV k."""
    travel(worlds, w, k, a0, a1)
    worlds.auv.closed[w, k] = -distance_to_target(worlds, w, k)


@func
def nothing(worlds: ti.template(), w):
    """Stations stay as they are."""


tasks.register(
    "station-keeping",
    Task(
        place=place_stations,
        assign=assign_station,
        move=move,
        update=nothing,
        finish=nothing,
        reward_terms=rewards.STANDARD,
        targets=SHIPPED["station-keeping"].targets,
        heuristic=SHIPPED["station-keeping"].heuristic,
    ),
)
