"""What is measured of targets in the task of tracking, and how the AUVs' filters use it.

Observers are the AUVs, and the boats where these listen (`boat_listens`): with an omnidirectional receiver at the hull
in the band of the targets' transmitters, apart from the array that locates AUVs. Every `interval` seconds each observer
within `range_most` hears each target, unless the signal is lost. With a `signal_excess` SE at 1 m it is also lost where
it fades below the threshold: by Rayleigh fading it is heard with the probability exp(−10^(−E/10)),
E = SE − 20 log10 r − α r/1000 (Urick, "Principles of Underwater Sound" (1983), §2).

The observer then measures its slant range, its bearing or both, with normal errors. It sends what it measured and its
own position, with the covariance of that, to the AUVs within `message_range`; each receives the message or not. A boat
knows its position. The messages take the acoustic channel one after another, each for `message_time`, when the exchange
under way is over, and the boats wait with the next one. What is in them counts at once.
"""

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.mission.columns import Draw, Schedule
from usvauv.kernels.mission.draws import normals, uniforms
from usvauv.kernels.mission.tasks import tracking_places
from usvauv.kernels.mission.tasks.tracking_places import believed_place
from usvauv.kernels.mission.worlds import Worlds
from usvauv.kernels.positioning.sonar import path_loss, power_of_10
from usvauv.kernels.tracking import bearings, ranges
from usvauv.kernels.transcendental import wrapped
from usvauv.kernels.types import vec2, vec3


def boats_may_listen(worlds: Worlds) -> bool:
    """Whether a scenario can let boats listen; called while the kernel is compiled."""
    return worlds.program.task.boat_columns is not None


@func
def observers(worlds: ti.template()):
    """Number of those that hear targets: the AUVs, and numbered after them the boats where these listen."""
    found = worlds.auv.shape[1]
    if ti.static(boats_may_listen(worlds)):
        if worlds.task_parameters.boat_listens > 0.0:
            found += worlds.boat.shape[1]
    return found


@func
def place_of(worlds: ti.template(), w, j) -> vec3:
    """Where observer j is, x, y and depth, m; a boat's receiver is at its hull."""
    found, b = vec3(0.0), j - worlds.auv.shape[1]
    if b < 0:
        found = vec3(worlds.auv.x[w, j], worlds.auv.y[w, j], worlds.p.cruise + worlds.auv.depth_error[w, j])
    else:
        found = vec3(worlds.boat.x[w, b], worlds.boat.y[w, b], 0.0 - worlds.boat.elevation[w, b])
    return found


@func
def assumed_place(worlds: ti.template(), w, j) -> vec3:
    """Where observer j takes itself to be; a boat knows it."""
    found = place_of(worlds, w, j)
    if j < worlds.auv.shape[1]:
        here = believed_place(worlds, w, j)
        found = vec3(here[0], here[1], found[2])
    return found


@func
def measure(worlds: ti.template(), w, j, i) -> vec3:
    """Whether observer j hears target i, 0 or 1, and the slant range and the bearing that it measures then."""
    given = ti.static(worlds.task_parameters)
    found, here = vec3(0.0), place_of(worlds, w, j)
    away = vec2(worlds.node.x[w, i] - here[0], worlds.node.y[w, i] - here[1])
    slant = vec3(away[0], away[1], worlds.task_node.depth[w, i] - here[2]).norm()
    index = j * worlds.node.shape[1] + i
    u = uniforms(worlds, w, Draw.range_loss, index)
    lost = given.range_loss
    if given.signal_excess > 0.0:
        excess = given.signal_excess - path_loss(slant, 20.0, given.absorption)
        lost = 1.0 - (1.0 - lost) * ti.exp(0.0 - power_of_10(-0.1 * excess))
    if slant <= given.range_most and u[0] >= lost:
        found[0] = 1.0
        noise = normals(worlds, w, Draw.range, index)
        if given.ranges > 0.0:
            found[1] = ti.max(slant + given.range_noise * noise[0], 1e-3)
        if given.bearing_noise > 0.0:
            found[2] = wrapped(ti.atan2(away[1], away[0]) + given.bearing_noise * noise[1])
    return found


@func
def note(worlds: ti.template(), w, j, i, signal: vec3):
    """Keep what observer j measured of target i, `measure`."""
    b = j - worlds.auv.shape[1]
    if b < 0:
        write(worlds.task_pair, w, j, i, signal)
    elif ti.static(boats_may_listen(worlds)):
        write(worlds.task_boat, w, b, i, signal)


@func
def write(memory: ti.template(), w, k, i, signal: vec3):
    """Write the columns of a measurement."""
    memory.heard[w, k, i] = signal[0]
    memory.measured[w, k, i] = signal[1]
    memory.bearing[w, k, i] = signal[2]


@func
def noted(worlds: ti.template(), w, j, i) -> vec3:
    """What observer j measured of target i in this step, `measure`."""
    pair = ti.static(worlds.task_pair)
    found, b = vec3(0.0), j - worlds.auv.shape[1]
    if b < 0:
        found = vec3(pair.heard[w, j, i], pair.measured[w, j, i], pair.bearing[w, j, i])
    elif ti.static(boats_may_listen(worlds)):
        boat = ti.static(worlds.task_boat)
        found = vec3(boat.heard[w, b, i], boat.measured[w, b, i], boat.bearing[w, b, i])
    return found


@func
def take_channel(worlds: ti.template(), w):
    """The messages of all who have heard a target take the channel, see `usvauv.kernels.mission.link.channel`."""
    if ti.static(worlds.program.schedule != Schedule.every_step):
        free = ti.static(worlds.tally.channel_free)
        for j in range(observers(worlds)):
            heard = 0.0
            for i in range(worlds.node.shape[1]):
                heard = ti.max(heard, noted(worlds, w, j, i)[0])
            if heard > 0.0:
                free[w] = ti.max(free[w], 0.0) + worlds.task_parameters.message_time


@func
def receives(worlds: ti.template(), w, k, j) -> bool:
    """Whether AUV k has what observer j has measured in this step."""
    given = ti.static(worlds.task_parameters)
    auvs, there = worlds.auv.shape[1], place_of(worlds, w, j)
    away = vec2(there[0] - worlds.auv.x[w, k], there[1] - worlds.auv.y[w, k])
    u = uniforms(worlds, w, Draw.message, ti.select(j < auvs, k * auvs + j, j * auvs + k))
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
    """Update AUV k's filter of target i, `f`, by what it has of the observers; `senders`: of the AUVs."""
    given = ti.static(worlds.task_parameters)
    for j in range(observers(worlds)):
        signal, received = noted(worlds, w, j, i), senders >> j & 1 != 0
        if j >= worlds.auv.shape[1]:
            received = receives(worlds, w, k, j)
        if received and signal[0] > 0.0:
            here = assumed_place(worlds, w, j)
            if given.ranges > 0.0:
                variance = given.range_noise * given.range_noise
                covariance = tracking_places.assumed(worlds, w, k, i, j, f)
                moved = ranges.observe_range(f, here, covariance, signal[1], variance)
                tracking_places.move(worlds, w, k, i, j, moved)
            if given.bearing_noise > 0.0:
                variance = given.bearing_noise * given.bearing_noise
                covariance = tracking_places.assumed(worlds, w, k, i, j, f)
                moved = bearings.observe_bearing(f, here, covariance, signal[2], variance, given.range_most)
                tracking_places.move(worlds, w, k, i, j, moved)
