"""The fixes of a mission: what the array on the boat receives of an AUV, and what the boat then knows of it."""

import math

import taichi as ti

from kernels import random
from kernels.mission.columns import AuvColumn, BoatColumn, Draw, EstimateColumn, Parameter, Refraction
from kernels.mission.worlds import address, normals, uniforms
from kernels.positioning import rays, tracker, usbl, validation, waveform
from kernels.positioning.validation import Expectation
from kernels.types import mat3, vec2, vec3, vec4

DEPLOYMENT_VARIANCE = 1e-4  # of the place where an AUV is deployed, m²


@ti.dataclass
class ArrayAttitude:
    """The array on its wave.

    Attributes:
        axes: of the array in the world's frame, see `usbl.array_axes`.
        measured: the same as the attitude sensor has them.
    """

    axes: mat3
    measured: mat3


@ti.dataclass
class Arrival:
    """A tone on its way to the array.

    Attributes:
        body: direction of the AUV in the array's true frame.
        slant_range: straight distance, m.
        path: the distance that the sound's delay stands for, m.
    """

    body: vec3
    slant_range: ti.f32
    path: ti.f32


@ti.dataclass
class Tone:
    """What the array measures of a tone: phase differences and residual in rad modulo one turn, slant range in m."""

    phase: vec2
    residual: ti.f32
    slant_range: ti.f32
    amplitude: ti.f32


@ti.func
def array_attitude(worlds: ti.template(), w) -> ArrayAttitude:
    """Attitude of the array in this step, the same for all AUVs."""
    p = ti.static(worlds.p)
    slope = p[Parameter.tilt] * vec2(worlds.boat[w, BoatColumn.slope_x], worlds.boat[w, BoatColumn.slope_y])
    angles = usbl.attitude(slope)
    noise = normals(worlds, w, Draw.attitude, 0)
    error = p[Parameter.attitude_error] * vec2(noise[0], noise[1])
    return ArrayAttitude(axes=usbl.array_axes(angles), measured=usbl.array_axes(angles + error))


@ti.func
def receive(worlds: ti.template(), arrival: Arrival, w, k) -> Tone:
    """What the array measures of a tone of AUV k."""
    link = ti.static(worlds.link)
    draw = address(worlds, w, worlds.clock[w, 1], Draw.fix, k)
    phase = vec2(0.0, 0.0)
    residual = 0.0
    slant_range = arrival.path
    amplitude = 0.0
    if ti.static(worlds.program.waveform):
        tone = waveform.measure(
            link,
            k,
            arrival.path * arrival.body,
            arrival.path,
            draw,
            worlds.key_low,
            worlds.key_high,
            waveform.PROJECTED,
        )
        phase = vec2(tone[waveform.PHASE_X], tone[waveform.PHASE_Y])
        residual = tone[waveform.RESIDUAL]
        slant_range += tone[waveform.RANGE_ERROR]
        amplitude = tone[waveform.AMPLITUDE]
    else:
        noise = random.normals(draw, worlds.key_low, worlds.key_high)
        residual_noise = 0.0
        if ti.static(worlds.program.turns):
            residual_noise = normals(worlds, w, Draw.residual, k)[0]
        tone = usbl.measure(link, k, arrival.body, arrival.slant_range, arrival.path, noise, residual_noise)
        phase = vec2(usbl.wrap(tone.phase[0]), usbl.wrap(tone.phase[1]))
        residual = tone.residual
        slant_range = tone.slant_range
        amplitude = tone.amplitude
    return Tone(phase=phase, residual=residual, slant_range=slant_range, amplitude=amplitude)


@ti.func
def locate(worlds: ti.template(), w, direction: vec3, slant_range) -> vec3:
    """The offset (m) from the array of what is heard from a direction, by the rays that the receiver reckons with."""
    found = slant_range * direction
    if ti.static(worlds.program.refraction == Refraction.corrected):
        z = -worlds.boat[w, BoatColumn.elevation]
        horizontal = vec2(direction[0], direction[1])
        found = rays.follow(worlds.layers, z, horizontal, slant_range, worlds.p[Parameter.sound_speed])
    return found


@ti.func
def covariance_at(worlds: ti.template(), attitude: ArrayAttitude, k, offset: vec3) -> vec3:
    """Covariance (xx, xy, yy) in m² of a fix at the offset that the receiver measured."""
    sigma = usbl.phase_deviation(worlds.link, k, offset.norm())
    error = worlds.p[Parameter.attitude_error]
    return usbl.horizontal_covariance(worlds.link, k, offset, attitude.axes, error, sigma)


@ti.func
def whole_turns(worlds: ti.template(), tone: Tone, length, attitude: ArrayAttitude, expected: Expectation, w, k):
    """Phase differences of a tone of AUV k with the turns that they most probably lack, and 1 where others are near.

    See `kernels.positioning.validation`. `length` as of `usbl.located`.
    """
    link = ti.static(worlds.link)
    odd = usbl.odd_turns(tone.residual)
    most = validation.most_turns(link, k, length)
    kappa = length * link[k, usbl.KAPPA]
    phase = tone.phase
    best = validation.NO_CANDIDATE
    second = validation.NO_CANDIDATE
    for m in range(-most, most + 1):
        for n in range(-most, most + 1):
            candidate = tone.phase + 2.0 * math.pi * vec2(m, n)
            if ((m + n) & 1) == odd and candidate.norm_sqr() <= kappa * kappa:
                found = usbl.located(link, k, candidate, candidate, tone.amplitude, attitude.measured, length)
                offset = locate(worlds, w, found.vector, tone.slant_range)
                sigma = usbl.phase_deviation(link, k, offset.norm())
                covariance = covariance_at(worlds, attitude, k, offset)
                badness = validation.badness(link, k, expected, offset, covariance, sigma)
                if badness < best:
                    second = best
                    best = badness
                    phase = candidate
                elif badness < second:
                    second = badness
    return phase, ti.cast(second - best < validation.GATE, ti.i32)


@ti.func
def measure(worlds: ti.template(), offset: vec3, attitude: ArrayAttitude, expected: Expectation, w, k) -> vec4:
    """The offset (m) from boat to AUV k that a fix gives, and its flags.

    Args:
        offset: the true one, m. expected: the one that the receiver expects.
    """
    layers = ti.static(worlds.layers)
    link = ti.static(worlds.link)
    refraction = ti.static(worlds.program.refraction)
    S = ti.max(offset.norm(), 1e-3)
    direction = offset / S
    path = S
    length = 1.0
    flags = 0
    if ti.static(refraction != Refraction.none):
        c = worlds.p[Parameter.sound_speed]
        z = -worlds.boat[w, BoatColumn.elevation]
        ray = rays.refracted(layers, z, offset, c)
        direction = ray.direction
        path = ray.slant_range
        if ray.exists == 0:
            flags = usbl.NO_RAY
        if ti.static(refraction == Refraction.corrected):
            length = c / rays.sound_speed(layers, z)
    body = attitude.axes @ direction
    tone = receive(worlds, Arrival(body=body, slant_range=S, path=path), w, k)
    phase = tone.phase
    ambiguous = 0
    if ti.static(worlds.program.turns):
        phase, ambiguous = whole_turns(worlds, tone, length, attitude, expected, w, k)
    true_phase = link[k, usbl.KAPPA] * vec2(body[0], body[1])
    found = usbl.located(link, k, true_phase, phase, tone.amplitude, attitude.measured, length)
    place = locate(worlds, w, found.vector, tone.slant_range)
    if flags == 0:
        flags = found.flags | usbl.AMBIGUOUS * ambiguous
    return vec4(place[0], place[1], place[2], ti.cast(flags, ti.f32))


@ti.func
def expect(worlds: ti.template(), w, k, here: vec2, lag, carried: vec2) -> Expectation:
    """Where the receiver at `here` (m) expects AUV k; `lag` and `carried` as of `tracker.Fix`."""
    estimate = ti.static(worlds.estimate)
    place = vec2(estimate[w, k, EstimateColumn.x], estimate[w, k, EstimateColumn.y])
    covariance = vec3(0.0)
    for j in ti.static(range(3)):
        covariance[j] = estimate[w, k, EstimateColumn.covariance_xx + j]
    reach = worlds.p[Parameter.auv_speed] * estimate[w, k, EstimateColumn.age]
    if ti.static(worlds.program.tracker):
        place, covariance = tracker.earlier(worlds.track, w, k, lag, carried)
    separation = worlds.p[Parameter.separation_boat] + worlds.boat[w, BoatColumn.elevation]
    return Expectation(place=place - here, covariance=covariance, reach=reach, separation=separation)


@ti.func
def take_fix(worlds: ti.template(), attitude: ArrayAttitude, w, k):
    """Fix AUV k from the boat on its wave, and update the estimate of its position.

    The fix that is there at the end of a step was received `latency` earlier, of a tone that had left the AUV S/c
    before. Without a tracker the estimate is the last fix that the receiver could use (`usbl.usable`); one farther away
    than the AUV can have gone since is not used, see `kernels.positioning.validation`.
    """
    p = ti.static(worlds.p)
    auv = ti.static(worlds.auv)
    boat = ti.static(worlds.boat)
    estimate = ti.static(worlds.estimate)
    z = -(p[Parameter.separation_boat] + boat[w, BoatColumn.elevation])
    here = vec2(boat[w, BoatColumn.x], boat[w, BoatColumn.y])
    there = vec2(auv[w, k, AuvColumn.x], auv[w, k, AuvColumn.y])
    range_now = ti.sqrt((there - here).norm_sqr() + z * z)
    age = p[Parameter.latency] + p[Parameter.propagates] * range_now / p[Parameter.sound_speed]
    here -= p[Parameter.latency] / p[Parameter.step] * vec2(boat[w, BoatColumn.moved_x], boat[w, BoatColumn.moved_y])
    then = there - age / p[Parameter.step] * vec2(auv[w, k, AuvColumn.moved_x], auv[w, k, AuvColumn.moved_y])
    offset = vec3(then[0] - here[0], then[1] - here[1], z)
    lag = 0.0
    water = vec2(0.0, 0.0)
    if ti.static(worlds.program.tracker):
        lag = age * worlds.track[w, k, tracker.ADRIFT]
        water = vec2(worlds.track[w, k, tracker.WATER_X], worlds.track[w, k, tracker.WATER_Y])
    expected = expect(worlds, w, k, here, lag, lag * water)
    found = measure(worlds, offset, attitude, expected, w, k)
    flags = ti.cast(found[3], ti.i32)
    if p[Parameter.packet_loss] > 0.0:
        u = uniforms(worlds, w, Draw.loss, k)
        if u[0] < p[Parameter.packet_loss]:
            flags = usbl.LOST
    covariance = covariance_at(worlds, attitude, k, vec3(found[0], found[1], found[2]))
    horizontal = vec2(found[0], found[1])
    fix = here + horizontal
    auv[w, k, AuvColumn.fix_x] = fix[0]
    auv[w, k, AuvColumn.fix_y] = fix[1]
    auv[w, k, AuvColumn.covariance_xx] = covariance[0]
    auv[w, k, AuvColumn.covariance_xy] = covariance[1]
    auv[w, k, AuvColumn.covariance_yy] = covariance[2]
    if ti.static(worlds.program.tracker):
        track = ti.static(worlds.track)
        if usbl.usable(flags):
            taken = tracker.Fix(place=fix, covariance=covariance, lag=lag, carried=lag * water)
            tracker.update(track, w, k, taken, p[Parameter.current_variance], p[Parameter.auv_speed])
            if track[w, k, tracker.REJECTIONS] > 0.0:
                flags |= usbl.REJECTED
        fix = vec2(track[w, k, tracker.X], track[w, k, tracker.Y])
        covariance = vec3(track[w, k, tracker.XX], track[w, k, tracker.XY], track[w, k, tracker.YY])
        know(worlds, w, k, fix, covariance)
    else:
        if usbl.usable(flags) and validation.squared_innovation(expected, horizontal, covariance) > validation.GATE:
            flags |= usbl.REJECTED
        if usbl.usable(flags):
            know(worlds, w, k, fix, covariance)
            estimate[w, k, EstimateColumn.age] = 0.0
        estimate[w, k, EstimateColumn.age] += p[Parameter.step]
    auv[w, k, AuvColumn.fix_flags] = ti.cast(flags, ti.f32)
    estimate[w, k, EstimateColumn.separation] = -z
    error = vec2(estimate[w, k, EstimateColumn.x], estimate[w, k, EstimateColumn.y]) - there
    auv[w, k, AuvColumn.position_error] = error.norm()


@ti.func
def know(worlds: ti.template(), w, k, place: vec2, covariance: vec3):
    """Write the estimate of AUV k's position (m) and its covariance (xx, xy, yy), m²."""
    estimate = ti.static(worlds.estimate)
    estimate[w, k, EstimateColumn.x] = place[0]
    estimate[w, k, EstimateColumn.y] = place[1]
    estimate[w, k, EstimateColumn.covariance_xx] = covariance[0]
    estimate[w, k, EstimateColumn.covariance_xy] = covariance[1]
    estimate[w, k, EstimateColumn.covariance_yy] = covariance[2]


@ti.func
def begin_track(worlds: ti.template(), w, k):
    """Track AUV k from where it was deployed, in an unknown current."""
    covariance = vec3(DEPLOYMENT_VARIANCE, 0.0, DEPLOYMENT_VARIANCE)
    x = worlds.estimate[w, k, EstimateColumn.x]
    y = worlds.estimate[w, k, EstimateColumn.y]
    tracker.begin(worlds.track, w, k, x, y, covariance, worlds.p[Parameter.current_variance])


@ti.func
def predict(worlds: ti.template(), w, k):
    """Carry the track of AUV k through the step it has just made, by its commanded velocity."""
    auv = ti.static(worlds.auv)
    adrift = 1.0 - ti.max(auv[w, k, AuvColumn.hovering], auv[w, k, AuvColumn.border])
    water = vec2(auv[w, k, AuvColumn.water_x], auv[w, k, AuvColumn.water_y])
    tracker.carry(worlds.track, w, k, water, worlds.p[Parameter.step], adrift)
    worlds.estimate[w, k, EstimateColumn.x] = worlds.track[w, k, tracker.X]
    worlds.estimate[w, k, EstimateColumn.y] = worlds.track[w, k, tracker.Y]


@ti.func
def prepare_next_step(worlds: ti.template(), w, k):
    """Make the track's current that of the coming step, and read the AUV's current meter if it has one."""
    p = ti.static(worlds.p)
    tracker.renew(
        worlds.track,
        w,
        k,
        p[Parameter.step],
        p[Parameter.current_variance],
        p[Parameter.correlation_time],
    )
    deviation = p[Parameter.current_reading]
    if deviation > 0.0:
        noise = normals(worlds, w, Draw.reading, k)
        reading = vec2(worlds.auv[w, k, AuvColumn.current_x], worlds.auv[w, k, AuvColumn.current_y])
        reading += deviation * vec2(noise[0], noise[1])
        tracker.sense(worlds.track, w, k, reading, deviation * deviation)
