"""The task of keeping station: every AUV holds its place in a formation, whatever the current does."""

import taichi as ti

from kernels import random
from kernels.mission import common
from kernels.mission.columns import AuvColumn, Draw, NodeColumn, Parameter, RewardTerm

TWO_PI = 6.283185307179586


@ti.func
def place_stations(p: ti.template(), node: ti.template(), key_low, key_high, w, episode):
    """Spread the stations of a new episode evenly over a circle about the area's centre, turned at random."""
    u = random.uniforms(common.address(p, w, episode, 0, Draw.node, 0), key_low, key_high)
    count = node.shape[1]
    for i in range(count):
        angle = TWO_PI * (u[0] + i / count)
        node[w, i, NodeColumn.x] = 0.5 * p[Parameter.width] + p[Parameter.formation_radius] * ti.cos(angle)
        node[w, i, NodeColumn.y] = 0.5 * p[Parameter.length] + p[Parameter.formation_radius] * ti.sin(angle)
        node[w, i, NodeColumn.kind] = 0.0
        node[w, i, NodeColumn.rate] = 0.0
        node[w, i, NodeColumn.backlog] = 0.0


@ti.func
def move(p: ti.template(), auv: ti.template(), node: ti.template(), reward_terms: ti.template(), w, k, a0, a1):
    """One step of AUV k; its distance term is raw here: minus the distance to its station, m."""
    common.forget_last_step(auv, w, k)
    common.travel(p, auv, w, k, a0, a1)
    reward_terms[w, k, RewardTerm.distance] = -common.distance_to_target(auv, node, w, k)


@ti.func
def take_station(auv: ti.template(), w, k):
    """AUV k holds station k."""
    auv[w, k, AuvColumn.target] = ti.cast(k, ti.f32)
