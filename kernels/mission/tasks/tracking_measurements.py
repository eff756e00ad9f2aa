"""What AUVs measure of targets in the task of tracking, and how their filters use it.

Every `interval` seconds each AUV within `range_most` hears each target, unless the signal is lost. With a
`signal_excess` SE at 1 m it is also lost where it fades below the threshold: by Rayleigh fading it is heard with the
probability exp(−10^(−E/10)), E = SE − 20 log10 r − α r/1000 (Urick, "Principles of Underwater Sound" (1983), §2).

The AUV then measures its slant range, its bearing or both, with normal errors. It sends what it measured and its own
position, with the covariance of that, to the others within `message_range`; each receives the message or not. The
messages take the acoustic channel one after another, each for `message_time`, when the exchange under way is over, and
the boats wait with the next one. What is in them counts at once.
"""

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.mission.columns import Draw, Schedule
from usvauv.kernels.mission.tasks import tracking_places
from usvauv.kernels.mission.tasks.tracking_places import believed_place
from usvauv.kernels.mission.worlds import normals, uniforms
from usvauv.kernels.positioning.sonar import path_loss, power_of_10
from usvauv.kernels.tracking import bearings, ranges
from usvauv.kernels.trigonometry import wrapped
from usvauv.kernels.types import vec2, vec3


@func
def depth_of(worlds: ti.template(), w, k):
    """Depth of AUV k, m."""
    return worlds.p.cruise + worlds.auv.depth_error[w, k]


@func
def forget(worlds: ti.template(), w, k, i):
    """AUV k has no measurement of target i."""
    pair = ti.static(worlds.task_pair)
    pair.heard[w, k, i] = 0.0
    pair.measured[w, k, i] = 0.0
    pair.bearing[w, k, i] = 0.0


@func
def measure(worlds: ti.template(), w, k, i):
    """What AUV k measures of target i, if it hears it in this step."""
    given, pair = ti.static(worlds.task_parameters, worlds.task_pair)
    away = vec2(worlds.node.x[w, i] - worlds.auv.x[w, k], worlds.node.y[w, i] - worlds.auv.y[w, k])
    slant = vec3(away[0], away[1], worlds.task_node.depth[w, i] - depth_of(worlds, w, k)).norm()
    index = k * worlds.node.shape[1] + i
    u = uniforms(worlds, w, Draw.range_loss, index)
    lost = given.range_loss
    if given.signal_excess > 0.0:
        excess = given.signal_excess - path_loss(slant, 20.0, given.absorption)
        lost = 1.0 - (1.0 - lost) * ti.exp(0.0 - power_of_10(-0.1 * excess))
    if slant <= given.range_most and u[0] >= lost:
        pair.heard[w, k, i] = 1.0
        noise = normals(worlds, w, Draw.range, index)
        if given.ranges > 0.0:
            pair.measured[w, k, i] = ti.max(slant + given.range_noise * noise[0], 1e-3)
        if given.bearing_noise > 0.0:
            pair.bearing[w, k, i] = wrapped(ti.atan2(away[1], away[0]) + given.bearing_noise * noise[1])


@func
def take_channel(worlds: ti.template(), w):
    """The messages of all AUVs that have heard a target take the channel, see `usvauv.kernels.mission.link.channel`."""
    if ti.static(worlds.program.schedule != Schedule.every_step):
        pair, free = ti.static(worlds.task_pair, worlds.tally.channel_free)
        for k in range(worlds.auv.shape[1]):
            heard = 0.0
            for i in range(worlds.node.shape[1]):
                heard = ti.max(heard, pair.heard[w, k, i])
            if heard > 0.0:
                free[w] = ti.max(free[w], 0.0) + worlds.task_parameters.message_time


@func
def receives(worlds: ti.template(), w, k, j) -> bool:
    """Whether AUV k has what AUV j has measured in this step."""
    given = ti.static(worlds.task_parameters)
    away = vec2(worlds.auv.x[w, j] - worlds.auv.x[w, k], worlds.auv.y[w, j] - worlds.auv.y[w, k])
    u = uniforms(worlds, w, Draw.message, k * worlds.auv.shape[1] + j)
    return k == j or (away.norm() <= given.message_range and u[0] >= given.message_loss)


@func
def senders(worlds: ti.template(), w, k):
    """The AUVs, as bits, of which AUV k has what they have measured in this step."""
    found = ti.cast(0, ti.i64)
    for j in range(worlds.auv.shape[1]):
        if receives(worlds, w, k, j):
            found |= ti.cast(1, ti.i64) << j
    return found


@func
def use_measurements(worlds: ti.template(), w, k, i, senders, f: ti.template()):
    """Update AUV k's filter of target i, `f`, by what some AUVs have measured, `senders`."""
    given, pair = ti.static(worlds.task_parameters, worlds.task_pair)
    for j in range(worlds.auv.shape[1]):
        if senders >> j & 1 != 0 and pair.heard[w, j, i] > 0.0:
            place = believed_place(worlds, w, j)
            here = vec3(place[0], place[1], depth_of(worlds, w, j))
            if given.ranges > 0.0:
                r, variance = pair.measured[w, j, i], given.range_noise * given.range_noise
                covariance = tracking_places.assumed(worlds, w, k, i, j, f)
                moved = ranges.observe_range(f, here, covariance, r, variance)
                tracking_places.move(worlds, w, k, i, j, moved)
            if given.bearing_noise > 0.0:
                bearing, variance = pair.bearing[w, j, i], given.bearing_noise * given.bearing_noise
                covariance = tracking_places.assumed(worlds, w, k, i, j, f)
                moved = bearings.observe_bearing(f, here, covariance, bearing, variance, given.range_most)
                tracking_places.move(worlds, w, k, i, j, moved)
