"""Dead reckoning of the AUVs, and the two filters of it and of the fixes: the AUV's and the boat's.

An AUV adds up displacements: over ground by a Doppler velocity log, or through the water. Its velocity has a white
error and a bias, a Gauss–Markov process, of log and compass together. A reply carries the displacement since the last
reply that the boat has heard, an interrogation the boat's filter as of that reply. So

- the boat's filter (`track`) is at the time of the last reply heard. A new reply moves it by the displacement that it
  carries; then its fix updates it. In between the boat takes the AUV's velocity as a Gauss–Markov process of the
  variance s² and the memory τ, so that after the time t

      x̂ = x + v τ (1 − e^{−t/τ}),   variance of its error s² τ² (2t/τ − 3 + 4 e^{−t/τ} − e^{−2t/τ});

- the AUV's filter (`own`) is the boat's of the last interrogation heard, moved on by what the AUV has measured since.

Both are filters of `usvauv.kernels.positioning.tracker`, whose current here is the water's, or the log's bias reversed.

Source: Gelb, "Applied Optimal Estimation" (1974), §3.6 and §4.5, for integrated Gauss–Markov processes.
"""

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.mission import motion
from usvauv.kernels.mission.columns import AuvColumn, Draw, EstimateColumn, ExchangeColumn, Parameter, Sensor
from usvauv.kernels.mission.worlds import normals
from usvauv.kernels.positioning import tracker
from usvauv.kernels.types import vec2, vec3


@func
def own_position(worlds: ti.template(), w, k) -> vec2:
    """Where AUV k takes itself to be, m: by its own filter, or where it has none as the boat has it."""
    found = vec2(worlds.estimate[w, k, EstimateColumn.x], worlds.estimate[w, k, EstimateColumn.y])
    if ti.static(worlds.program.sensor != Sensor.none):
        found = vec2(worlds.own[w, k, tracker.X], worlds.own[w, k, tracker.Y])
    return found


@func
def begin_filter(worlds: ti.template(), track: ti.template(), w, k):
    """Begin a filter at the estimate of AUV k, in an unknown current."""
    estimate = ti.static(worlds.estimate)
    covariance = vec3(0.0)
    for c in ti.static(range(3)):
        covariance[c] = estimate[w, k, EstimateColumn.covariance_xx + c]
    x = estimate[w, k, EstimateColumn.x]
    y = estimate[w, k, EstimateColumn.y]
    tracker.begin(track, w, k, x, y, covariance, worlds.p[Parameter.current_variance])


@func
def begin(worlds: ti.template(), w, k):
    """Begin both filters where AUV k is deployed."""
    begin_filter(worlds, worlds.track, w, k)
    begin_filter(worlds, worlds.own, w, k)
    noise = normals(worlds, w, Draw.navigation, k)
    for c in ti.static(range(len(ExchangeColumn.names))):
        worlds.exchange[w, k, c] = 0.0
    for axis in ti.static(range(2)):
        worlds.exchange[w, k, ExchangeColumn.bias_x + axis] = worlds.p[Parameter.velocity_bias] * noise[axis]


@func
def gnss_change(worlds: ti.template(), time) -> ti.f32:
    """Variance per axis (m²) of the change in some time (s) of the boat's error of its own position."""
    p = ti.static(worlds.p)
    return 2.0 * p[Parameter.gnss_error] ** 2 * (1.0 - ti.exp(-time / p[Parameter.gnss_time]))


@func
def move_filter(worlds: ti.template(), track: ti.template(), w, k, way: vec3, time):
    """Move a filter by a displacement (m) measured in some time (s); `way[2]` is the part of it with the current.

    It follows the positions that fixes without noise would show, which change with the error of the boat's own.
    """
    p = ti.static(worlds.p)
    variance = p[Parameter.current_variance]
    tau = p[Parameter.correlation_time]
    tracker.drift(track, w, k, vec2(way[0], way[1]), way[2], variance, tau)
    tracker.spread(track, w, k, p[Parameter.velocity_walk] * way[2] + gnss_change(worlds, time))
    if time != way[2]:
        tracker.renew(track, w, k, time - way[2], variance, tau)


@func
def reckon(worlds: ti.template(), w, k):
    """Measure the displacement of AUV k in the step it has made, and move its own filter by it."""
    p = ti.static(worlds.p)
    auv = ti.static(worlds.auv)
    exchange = ti.static(worlds.exchange)
    step = p[Parameter.step]
    moved = vec2(auv[w, k, AuvColumn.moved_x], auv[w, k, AuvColumn.moved_y])
    adrift = step
    if ti.static(worlds.program.sensor == Sensor.water):
        adrift *= motion.drifted(worlds, w, k)
        moved = adrift * vec2(auv[w, k, AuvColumn.water_x], auv[w, k, AuvColumn.water_y])
    noise = normals(worlds, w, Draw.navigation, k)
    memory = p[Parameter.bias_memory]
    fresh = p[Parameter.velocity_bias] * ti.sqrt(1.0 - memory * memory)
    walk = ti.sqrt(p[Parameter.velocity_walk] * adrift)
    for axis in ti.static(range(2)):
        column = ti.static(ExchangeColumn.bias_x + axis)
        exchange[w, k, column] = memory * exchange[w, k, column] + fresh * noise[axis]
        measured = moved[axis] + adrift * exchange[w, k, column] + walk * noise[2 + axis]
        exchange[w, k, ExchangeColumn.step_x + axis] = measured
        exchange[w, k, ExchangeColumn.way_x + axis] = exchange[w, k, ExchangeColumn.way_x + axis] + measured
    exchange[w, k, ExchangeColumn.step_adrift] = adrift
    exchange[w, k, ExchangeColumn.adrift] = exchange[w, k, ExchangeColumn.adrift] + adrift
    exchange[w, k, ExchangeColumn.elapsed] = exchange[w, k, ExchangeColumn.elapsed] + step
    way = vec3(exchange[w, k, ExchangeColumn.step_x], exchange[w, k, ExchangeColumn.step_y], adrift)
    move_filter(worlds, worlds.own, w, k, way, step)


@func
def receive_filter(worlds: ti.template(), w, k):
    """AUV k takes the boat's filter from an interrogation, and moves it on by what it has measured since."""
    exchange = ti.static(worlds.exchange)
    for c in ti.static(range(tracker.COLUMNS)):
        worlds.own[w, k, c] = worlds.track[w, k, c]
    way = vec3(
        exchange[w, k, ExchangeColumn.way_x],
        exchange[w, k, ExchangeColumn.way_y],
        exchange[w, k, ExchangeColumn.adrift],
    )
    move_filter(worlds, worlds.own, w, k, way, exchange[w, k, ExchangeColumn.elapsed])


@func
def write_reply(worlds: ti.template(), w, k, age):
    """What the reply of AUV k carries that has left `age` seconds before the end of this step."""
    exchange = ti.static(worlds.exchange)
    share = age / worlds.p[Parameter.step]
    for c in ti.static(range(3)):  # way_x, way_y, adrift
        last = exchange[w, k, ExchangeColumn.step_x + c]
        exchange[w, k, ExchangeColumn.sent_way_x + c] = exchange[w, k, ExchangeColumn.way_x + c] - share * last
        if ti.static(c < 2):
            exchange[w, k, ExchangeColumn.sent_velocity_x + c] = last / worlds.p[Parameter.step]
    exchange[w, k, ExchangeColumn.sent_elapsed] = exchange[w, k, ExchangeColumn.elapsed] - age
    exchange[w, k, ExchangeColumn.sent_heads_for] = worlds.auv[w, k, AuvColumn.target]
    exchange[w, k, ExchangeColumn.sent_hovers] = worlds.auv[w, k, AuvColumn.hover]


@func
def read_reply(worlds: ti.template(), w, k):
    """The boat moves its filter of AUV k to the time when the reply left that it now has."""
    exchange = ti.static(worlds.exchange)
    way = vec3(
        exchange[w, k, ExchangeColumn.sent_way_x],
        exchange[w, k, ExchangeColumn.sent_way_y],
        exchange[w, k, ExchangeColumn.sent_adrift],
    )
    move_filter(worlds, worlds.track, w, k, way, exchange[w, k, ExchangeColumn.sent_elapsed])
    rejected = worlds.track[w, k, tracker.REJECTED_AGE]
    worlds.track[w, k, tracker.REJECTED_AGE] = rejected + exchange[w, k, ExchangeColumn.sent_elapsed]
    for c in ti.static(range(3)):
        exchange[w, k, ExchangeColumn.way_x + c] = exchange[w, k, ExchangeColumn.way_x + c] - way[c]
        if ti.static(c < 2):
            exchange[w, k, ExchangeColumn.velocity_x + c] = exchange[w, k, ExchangeColumn.sent_velocity_x + c]
    exchange[w, k, ExchangeColumn.heads_for] = exchange[w, k, ExchangeColumn.sent_heads_for]
    exchange[w, k, ExchangeColumn.hovers] = exchange[w, k, ExchangeColumn.sent_hovers]
    passed = exchange[w, k, ExchangeColumn.sent_elapsed]
    exchange[w, k, ExchangeColumn.elapsed] = exchange[w, k, ExchangeColumn.elapsed] - passed


@func
def extrapolate(worlds: ti.template(), w, k):
    """Where the boat expects AUV k at the end of this step, without its systematic errors."""
    p = ti.static(worlds.p)
    estimate = ti.static(worlds.estimate)
    exchange = ti.static(worlds.exchange)
    track = ti.static(worlds.track)
    tau = p[Parameter.velocity_memory]
    f, spreading = tracker.decayed(exchange[w, k, ExchangeColumn.elapsed] / tau)
    reach = tau * f
    A = tracker.position_block(track, w, k)
    B = tracker.cross_block(track, w, k)
    C = tracker.current_block(track, w, k)
    A += reach * (B + B.transpose()) + reach * reach * C
    spread = p[Parameter.velocity_variance] * tau * tau * spreading
    for axis in ti.static(range(2)):
        velocity = exchange[w, k, ExchangeColumn.velocity_x + axis] + track[w, k, tracker.CURRENT_X + axis]
        estimate[w, k, EstimateColumn.x + axis] = track[w, k, tracker.X + axis] + reach * velocity
    estimate[w, k, EstimateColumn.covariance_xx] = A[0, 0] + spread
    estimate[w, k, EstimateColumn.covariance_xy] = 0.5 * (A[0, 1] + A[1, 0])
    estimate[w, k, EstimateColumn.covariance_yy] = A[1, 1] + spread
