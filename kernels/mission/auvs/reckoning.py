"""Dead reckoning by AUVs and boats.

An AUV sums displacements: over ground by a Doppler velocity log, or through the water. Its measured
velocity has a white error and a bias, a Gauss–Markov process, of log and compass together. A reply contains the
displacement since the last reply that the boat has received, an interrogation the state of the boat's filter as of that
reply. So

- the boat's filter (`track`) is at the time of the last reply received. A new reply moves it by the displacement that
  it contains; then its fix updates it. In between the boat models the AUV's velocity as a Gauss–Markov process with the
  variance s² and the memory τ, so that after the time t

      x̂ = x + v τ (1 − e^{−t/τ}),   variance of its error s² τ² (2t/τ − 3 + 4 e^{−t/τ} − e^{−2t/τ});

- the AUV's own position and current (`own`) are that state from the last interrogation received, moved by the
  displacement that the AUV has measured since.

The filter is one of `usvauv.kernels.positioning.tracker`, whose current here is the water's, or the log's bias
reversed.

Source: Gelb, "Applied Optimal Estimation" (1974), §3.6 and §4.5, for integrated Gauss–Markov processes.
"""

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.mission.auvs.motion import distance_to_target, drifted, target_of
from usvauv.kernels.mission.columns import Draw, EstimateColumn, ExchangeColumn, Sensor
from usvauv.kernels.mission.draws import normals
from usvauv.kernels.positioning import tracker
from usvauv.kernels.types import vec2, vec3


@func
def own_position(worlds: ti.template(), w, k) -> vec2:
    """AUV k's own position estimate, m: by dead reckoning, or without it the boat's."""
    found = vec2(worlds.estimate.x[w, k], worlds.estimate.y[w, k])
    if ti.static(worlds.program.reckoning):
        found = vec2(worlds.own[w, k, tracker.X], worlds.own[w, k, tracker.Y])
    return found


@func
def moved_on(track: ti.template(), w, k, reach, noise) -> vec3:
    """Covariance (xx, xy, yy) of AUV k's position in a filter after its current has moved it by `reach` s, m²."""
    A, B, C = tracker.position_block(track, w, k), tracker.cross_block(track, w, k), tracker.current_block(track, w, k)
    A += reach * (B + B.transpose()) + reach * reach * C
    return vec3(A[0, 0] + noise, 0.5 * (A[0, 1] + A[1, 0]), A[1, 1] + noise)


@func
def modelled(worlds: ti.template(), w, k) -> vec3:
    """Covariance of AUV k's position in the boat's filter now, by its model of the AUV's velocity, m²."""
    p = ti.static(worlds.p)
    tau = p.velocity_memory
    f, spreading = tracker.decayed(worlds.exchange.elapsed[w, k] / tau)
    return moved_on(worlds.track, w, k, tau * f, p.velocity_variance * tau * tau * spreading)


@func
def own_covariance(worlds: ti.template(), w, k) -> vec3:
    """Covariance (xx, xy, yy) of AUV k's own position estimate, m².

    By dead reckoning that of the state which it last had from the boat, moved on by the time since as by
    `tracker.drift`, and of the errors that fixes have in common, which the boat's estimate has besides its filter.
    """
    estimate = ti.static(worlds.estimate)
    found = vec3(estimate.covariance_xx[w, k], estimate.covariance_xy[w, k], estimate.covariance_yy[w, k])
    if ti.static(worlds.program.reckoning):
        p = ti.static(worlds.p)
        age, tau = worlds.own[w, k, tracker.AGE], p.correlation_time
        f, spreading = tracker.decayed(age / tau)
        noise = p.current_variance * tau * tau * spreading + p.velocity_walk * age
        found += moved_on(worlds.own, w, k, tau * f, noise) - modelled(worlds, w, k)
    return found


@func
def begin_filter(worlds: ti.template(), w, k):
    """Begin the boat's filter of AUV k at the estimate of it, in an unknown current."""
    estimate = ti.static(worlds.estimate)
    covariance = vec3(0.0)
    for c in ti.static(range(3)):
        covariance[c] = estimate[w, k, EstimateColumn.covariance_xx + c]
    x = estimate.x[w, k]
    y = estimate.y[w, k]
    tracker.begin(worlds.track, w, k, x, y, covariance, worlds.p.current_variance)


@func
def offset_to_target_from_estimate(worlds: ti.template(), w, k) -> vec2:
    """From AUV k's own position estimate to its target, over the area's diagonal; near it by homing."""
    target = target_of(worlds, w, k)
    here = own_position(worlds, w, k)
    if ti.static(worlds.program.reckoning):
        if distance_to_target(worlds, w, k) <= worlds.p.homing_range:
            here = vec2(worlds.auv.x[w, k], worlds.auv.y[w, k])
    way = vec2(worlds.node.x[w, target], worlds.node.y[w, target]) - here
    if ti.static(worlds.program.task.way):
        way = worlds.program.task.way(worlds, w, k)
    return way / worlds.p.diagonal


@func
def copy_state(worlds: ti.template(), w, k):
    """AUV k takes the state of the boat's filter, as of the last reply that this has."""
    for c in ti.static(range(tracker.AGE)):
        worlds.own[w, k, c] = worlds.track[w, k, c]
    worlds.own[w, k, tracker.AGE] = worlds.exchange.elapsed[w, k]


@func
def begin_reckoning(worlds: ti.template(), w, k):
    """Begin to reckon where AUV k is deployed."""
    begin_filter(worlds, w, k)
    noise = normals(worlds, w, Draw.navigation, k)
    for c in ti.static(range(len(ExchangeColumn.names))):
        worlds.exchange[w, k, c] = 0.0
    copy_state(worlds, w, k)
    for axis in ti.static(range(2)):
        worlds.exchange[w, k, ExchangeColumn.bias_x + axis] = worlds.p.velocity_bias * noise[axis]


@func
def gnss_change(worlds: ti.template(), time) -> ti.f32:
    """Variance per axis (m²) of the change in some time (s) of the boat's error of its own position."""
    p = ti.static(worlds.p)
    return 2.0 * p.gnss_error**2 * tracker.decayed(time / p.gnss_time)[0]


@func
def move_filter(worlds: ti.template(), w, k, way: vec3, time):
    """Move the boat's filter by a displacement (m) measured in some time (s), `way[2]` of it with the current.

    It follows the positions that fixes without noise would show, which change with the error of the boat's own.
    """
    p = ti.static(worlds.p)
    variance = p.current_variance
    tau = p.correlation_time
    tracker.drift(worlds.track, w, k, vec2(way[0], way[1]), way[2], variance, tau)
    tracker.spread(worlds.track, w, k, p.velocity_walk * way[2] + gnss_change(worlds, time))
    if time != way[2]:
        tracker.renew(worlds.track, w, k, time - way[2], variance, tau)


@func
def reckon(worlds: ti.template(), w, k):
    """Measure the displacement of AUV k in the step it has made, and reckon on."""
    p = ti.static(worlds.p)
    auv = ti.static(worlds.auv)
    exchange = ti.static(worlds.exchange)
    step = p.step
    moved = vec2(auv.moved_x[w, k], auv.moved_y[w, k])
    moves = 1.0
    adrift = step
    if ti.static(worlds.program.sensor == Sensor.water):
        moves = drifted(worlds, w, k)
        adrift *= moves
        moved = adrift * vec2(auv.water_x[w, k], auv.water_y[w, k])
    noise = normals(worlds, w, Draw.navigation, k)
    memory = p.bias_memory
    fresh = p.velocity_bias * ti.sqrt(1.0 - memory * memory)
    walk = ti.sqrt(p.velocity_walk * adrift)
    for axis in ti.static(range(2)):
        column = ti.static(ExchangeColumn.bias_x + axis)
        exchange[w, k, column] = memory * exchange[w, k, column] + fresh * noise[axis]
        moved[axis] += adrift * exchange[w, k, column] + walk * noise[2 + axis]
        exchange[w, k, ExchangeColumn.step_x + axis] = moved[axis]
        exchange[w, k, ExchangeColumn.way_x + axis] = exchange[w, k, ExchangeColumn.way_x + axis] + moved[axis]
    exchange.step_adrift[w, k] = adrift
    exchange.adrift[w, k] = exchange.adrift[w, k] + adrift
    exchange.elapsed[w, k] = exchange.elapsed[w, k] + step
    tracker.drift_state(worlds.own, w, k, moved, p.current_change, moves * p.correlation_time)
    worlds.own[w, k, tracker.AGE] = worlds.own[w, k, tracker.AGE] + step


@func
def receive_state(worlds: ti.template(), w, k):
    """AUV k takes the filter's state from an interrogation, and moves it on by what it has measured since."""
    exchange = ti.static(worlds.exchange)
    copy_state(worlds, w, k)
    way = vec2(exchange.way_x[w, k], exchange.way_y[w, k])
    adrift = exchange.adrift[w, k]
    held = exchange.elapsed[w, k] - adrift
    tau = worlds.p.correlation_time
    tracker.drift_state(worlds.own, w, k, way, tracker.decayed(adrift / tau)[0], tau)
    if held != 0.0:
        rho = ti.exp(-held / tau)
        for c in ti.static((tracker.CURRENT_X, tracker.CURRENT_Y)):
            worlds.own[w, k, c] = rho * worlds.own[w, k, c]


@func
def write_reply(worlds: ti.template(), w, k, age):
    """Contents of the reply of AUV k that has left `age` seconds before the end of this step."""
    exchange = ti.static(worlds.exchange)
    share = age / worlds.p.step
    for c in ti.static(range(3)):  # way_x, way_y, adrift
        last = exchange[w, k, ExchangeColumn.step_x + c]
        exchange[w, k, ExchangeColumn.sent_way_x + c] = exchange[w, k, ExchangeColumn.way_x + c] - share * last
        if ti.static(c < 2):
            exchange[w, k, ExchangeColumn.sent_velocity_x + c] = last / worlds.p.step
    exchange.sent_elapsed[w, k] = exchange.elapsed[w, k] - age
    exchange.sent_heads_for[w, k] = worlds.auv.target[w, k]
    exchange.sent_hovers[w, k] = worlds.auv.hover[w, k]


@func
def read_reply(worlds: ti.template(), w, k):
    """The boat moves its filter of AUV k to the time when the reply left that it now has."""
    exchange = ti.static(worlds.exchange)
    way = vec3(
        exchange.sent_way_x[w, k],
        exchange.sent_way_y[w, k],
        exchange.sent_adrift[w, k],
    )
    move_filter(worlds, w, k, way, exchange.sent_elapsed[w, k])
    rejected = worlds.track[w, k, tracker.REJECTED_AGE]
    worlds.track[w, k, tracker.REJECTED_AGE] = rejected + exchange.sent_elapsed[w, k]
    for c in ti.static(range(3)):
        exchange[w, k, ExchangeColumn.way_x + c] = exchange[w, k, ExchangeColumn.way_x + c] - way[c]
        if ti.static(c < 2):
            exchange[w, k, ExchangeColumn.velocity_x + c] = exchange[w, k, ExchangeColumn.sent_velocity_x + c]
    exchange.heads_for[w, k] = exchange.sent_heads_for[w, k]
    exchange.hovers[w, k] = exchange.sent_hovers[w, k]
    passed = exchange.sent_elapsed[w, k]
    exchange.elapsed[w, k] = exchange.elapsed[w, k] - passed


@func
def extrapolate(worlds: ti.template(), w, k):
    """Where the boat expects AUV k at the end of this step, without its systematic errors."""
    p = ti.static(worlds.p)
    estimate = ti.static(worlds.estimate)
    exchange = ti.static(worlds.exchange)
    track = ti.static(worlds.track)
    tau = p.velocity_memory
    reach = tau * tracker.decayed(exchange.elapsed[w, k] / tau)[0]
    covariance = modelled(worlds, w, k)
    for axis in ti.static(range(2)):
        velocity = exchange[w, k, ExchangeColumn.velocity_x + axis] + track[w, k, tracker.CURRENT_X + axis]
        estimate[w, k, EstimateColumn.x + axis] = track[w, k, tracker.X + axis] + reach * velocity
    for c in ti.static(range(3)):
        estimate[w, k, EstimateColumn.covariance_xx + c] = covariance[c]
