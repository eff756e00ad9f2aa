"""Tracking as a published environment has it, for comparison: no water, AUVs that know where they are and how deep
their targets, five rudders.

In each step an AUV turns by its rudder, one of five, of which only the same or a neighbour may follow, and a normal
error; then it goes straight. It takes the rudder that turns it most nearly to the course of its action. The turn of a
rudder and the error are those of UTracking, fitted to a Tethys LRAUV at 1 m/s and steps of 30 s (mttga, JaxLrauv).
"""

from dataclasses import replace
from typing import Annotated

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.mission.auvs.motion import move_to, travelling_power
from usvauv.kernels.mission.columns import Draw, Range, StateColumns, Turn
from usvauv.kernels.mission.draws import normals, uniforms
from usvauv.kernels.mission.tasks import tracking
from usvauv.kernels.mission.tasks.task import tasks
from usvauv.kernels.mission.tasks.tracking import TRACKING
from usvauv.kernels.mission.tasks.tracking_columns import PairColumn
from usvauv.kernels.mission.tasks.tracking_numbers import PLAIN
from usvauv.kernels.mission.tasks.tracking_outlook import MOST, TURN
from usvauv.kernels.transcendental import TWO_PI, wrapped
from usvauv.kernels.types import vec2

OFFSET, ERROR = -0.0005, 0.02  # rad in a step without a rudder: mean turn, standard deviation


class HelmColumn(StateColumns):
    """Course of an AUV and its last rudder, (W, K, ·)."""

    course: Turn  # rad anticlockwise from east
    rudder: Annotated[int, Range(-MOST, MOST, whole=True)]


@func
def assign(worlds: ti.template(), w, k):
    """Begin as `tracking` does, AUV k on a random course."""
    tracking.assign(worlds, w, k)
    worlds.task_auv.course[w, k] = TWO_PI * (uniforms(worlds, w, Draw.speed, k)[0] - 0.5)
    worlds.task_auv.rudder[w, k] = 0.0


@func
def move(worlds: ti.template(), w, k, a0, a1):
    """One step of AUV k, which turns towards the course of its action and goes straight, but not across the border."""
    p, auv, helm = ti.static(worlds.p, worlds.auv, worlds.task_auv)
    wanted, course, last = ti.atan2(a1, a0), helm.course[w, k], ti.cast(helm.rudder[w, k], ti.i32)
    rudder, least = last, 1e9
    for n in range(3):
        candidate = ti.min(ti.max(last + n - 1, -MOST), MOST)
        off = ti.abs(wrapped(course + TURN * candidate + OFFSET - wanted))
        if off < least - 1e-6:
            rudder, least = candidate, off
    course = wrapped(course + TURN * rudder + OFFSET + ERROR * normals(worlds, w, Draw.speed, k)[0])
    velocity = p.speed_max * vec2(ti.cos(course), ti.sin(course))
    there = vec2(auv.x[w, k], auv.y[w, k]) + p.step * velocity
    inside = vec2(ti.min(ti.max(there[0], 0.0), p.width), ti.min(ti.max(there[1], 0.0), p.length))
    if inside[0] != there[0] or inside[1] != there[1]:
        auv.border[w, k] = 1.0
    move_to(worlds, w, k, inside, velocity)
    auv.velocity_x[w, k] = velocity[0]
    auv.velocity_y[w, k] = velocity[1]
    auv.power[w, k] = travelling_power(p, p.speed_max)
    auv.closed[w, k] = 0.0
    helm.course[w, k] = course
    helm.rudder[w, k] = ti.cast(rudder, ti.f32)


TRACKING_PLAIN = replace(
    TRACKING,
    assign=assign,
    move=move,
    auv_columns=HelmColumn,
    pair_columns=PairColumn,
    boat_columns=None,
    parameters=PLAIN,
    observation=("track", "outlook"),
)
tasks.register("tracking-plain", TRACKING_PLAIN)
