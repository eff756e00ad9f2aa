"""The fixes of a mission: what the array on the boat hears of an AUV, and what the boat then knows of it."""

import taichi as ti

from kernels import random
from kernels.mission import common
from kernels.mission.columns import AuvColumn, BoatColumn, Draw, EstimateColumn, Parameter, Refraction
from kernels.positioning import rays, tracker, usbl, waveform
from kernels.positioning.usbl import mat3, vec4
from kernels.types import vec2, vec3

DEPLOYED = 1e-4  # variance of the place where an AUV is put, m²


@ti.dataclass
class Posture:
    """The array on its wave.

    Attributes:
        axes: of the array in the world's frame, see `usbl.array_axes`.
        measured: the same as the attitude sensor has them.
    """

    axes: mat3
    measured: mat3


@ti.func
def posture(p: ti.template(), boat: ti.template(), w, episode, now, key_low, key_high) -> Posture:
    """How the array lies in this step, which is the same for all AUVs."""
    slope = p[Parameter.tilt] * vec2(boat[w, BoatColumn.slope_x], boat[w, BoatColumn.slope_y])
    angles = usbl.attitude(slope)
    noise = random.normals(common.address(p, w, episode, now, Draw.attitude, 0), key_low, key_high)
    error = p[Parameter.attitude_error] * vec2(noise[0], noise[1])
    return Posture(axes=usbl.array_axes(angles), measured=usbl.array_axes(angles + error))


@ti.func
def hear(
    link: ti.template(),
    options: ti.template(),
    body: vec3,
    S,
    path,
    axes: mat3,
    length,
    address: random.uint4,
    key_low,
    key_high,
    k,
):
    """Direction and slant range (m) that an array measures, `usbl.located`'s first three and the range, and its flags.

    Args:
        body: direction of the AUV in the array's true frame. S: slant range, m. path: the same by the sound's delay.
        axes: the array's axes as measured. length: of the direction, see `usbl.located`.
        address: of the draws.
    """
    phase = vec2(0.0, 0.0)
    measured = path
    amplitude = 0.0
    if ti.static(options.waveform):
        tone = waveform.measure(link, k, path * body, path, address, key_low, key_high, waveform.PROJECTED)
        phase = vec2(tone[waveform.PHASE_X], tone[waveform.PHASE_Y])
        measured += tone[waveform.RANGE_ERROR]
        amplitude = tone[waveform.AMPLITUDE]
    else:
        tone = usbl.measure(link, k, body, S, path, random.normals(address, key_low, key_high))
        phase = vec2(usbl.wrap(tone[0]), usbl.wrap(tone[1]))
        measured = tone[2]
        amplitude = tone[3]
    true_phase = link[k, usbl.KAPPA] * vec2(body[0], body[1])
    found = usbl.located(link, k, true_phase, phase, amplitude, axes, length)
    return vec3(found[0], found[1], found[2]), measured, ti.cast(found[3], ti.i32)


@ti.func
def measure(
    p: ti.template(),
    link: ti.template(),
    layers: ti.template(),
    options: ti.template(),
    offset: vec3,
    elevation,
    array: Posture,
    address: random.uint4,
    key_low,
    key_high,
    k,
) -> vec4:
    """The offset (m) from boat to AUV k that a fix gives, and its flags.

    Args:
        offset: the true one, m. elevation: of the sea under the boat, m. address: of the draws.
    """
    S = ti.max(offset.norm(), 1e-3)
    c = p[Parameter.sound_speed]
    direction = offset / S
    path = S
    length = 1.0
    flags = 0
    if ti.static(options.refraction != Refraction.none):
        arrival = rays.refracted(layers, -elevation, offset, c)
        direction = arrival.direction
        path = arrival.slant_range
        if arrival.exists == 0:
            flags = usbl.NO_RAY
        if ti.static(options.refraction == Refraction.corrected):
            length = c / rays.sound_speed(layers, -elevation)
    body = array.axes @ direction
    found, measured, seen = hear(link, options, body, S, path, array.measured, length, address, key_low, key_high, k)
    place = measured * found
    if ti.static(options.refraction == Refraction.corrected):
        place = rays.follow(layers, -elevation, vec2(found[0], found[1]), measured, c)
    if flags == 0:
        flags = seen
    return vec4(place[0], place[1], place[2], ti.cast(flags, ti.f32))


@ti.func
def take(
    p: ti.template(),
    link: ti.template(),
    layers: ti.template(),
    options: ti.template(),
    auv: ti.template(),
    boat: ti.template(),
    array: Posture,
    estimate: ti.template(),
    track: ti.template(),
    episode,
    now,
    key_low,
    key_high,
    w,
    k,
):
    """Fix AUV k from the boat on its wave, and bring it into the estimate.

    The fix that is there at the end of a step was heard `latency` earlier, of a tone that had left the AUV S/c before.
    Without a tracker an estimate is the last fix that the receiver could use, which is one that was detected and has a
    real depth; a wrapped one looks like any other.
    """
    z = -(p[Parameter.separation_boat] + boat[w, BoatColumn.elevation])
    here = vec2(boat[w, BoatColumn.x], boat[w, BoatColumn.y])
    there = vec2(auv[w, k, AuvColumn.x], auv[w, k, AuvColumn.y])
    range_now = ti.sqrt((there - here).norm_sqr() + z * z)
    age = p[Parameter.latency] + p[Parameter.propagates] * range_now / p[Parameter.sound_speed]
    here -= p[Parameter.latency] / p[Parameter.step] * vec2(boat[w, BoatColumn.moved_x], boat[w, BoatColumn.moved_y])
    then = there - age / p[Parameter.step] * vec2(auv[w, k, AuvColumn.moved_x], auv[w, k, AuvColumn.moved_y])
    offset = vec3(then[0] - here[0], then[1] - here[1], z)
    elevation = boat[w, BoatColumn.elevation]
    address = common.address(p, w, episode, now, Draw.fix, k)
    found = measure(p, link, layers, options, offset, elevation, array, address, key_low, key_high, k)
    flags = ti.cast(found[3], ti.i32)
    if p[Parameter.packet_loss] > 0.0:
        u = random.uniforms(common.address(p, w, episode, now, Draw.loss, k), key_low, key_high)
        if u[0] < p[Parameter.packet_loss]:
            flags = usbl.LOST
    # The covariance is the receiver's: of what it measured.
    measured = vec3(found[0], found[1], found[2])
    sigma = usbl.phase_deviation(link, k, measured.norm())
    spread = usbl.horizontal_covariance(link, k, measured, array.axes, p[Parameter.attitude_error], sigma)
    fix = here + vec2(found[0], found[1])
    auv[w, k, AuvColumn.fix_x] = fix[0]
    auv[w, k, AuvColumn.fix_y] = fix[1]
    auv[w, k, AuvColumn.fix_flags] = ti.cast(flags, ti.f32)
    auv[w, k, AuvColumn.covariance_xx] = spread[0]
    auv[w, k, AuvColumn.covariance_xy] = spread[1]
    auv[w, k, AuvColumn.covariance_yy] = spread[2]
    usable = (flags & usbl.DETECTED) != 0 and (flags & usbl.NO_DEPTH) == 0
    if ti.static(options.tracker):
        if usable:
            lag = age * track[w, k, tracker.ADRIFT]
            water = vec2(track[w, k, tracker.WATER_X], track[w, k, tracker.WATER_Y])
            tracker.update(track, w, k, fix, spread, lag, lag * water)
        fix = vec2(track[w, k, tracker.X], track[w, k, tracker.Y])
        spread = vec3(track[w, k, tracker.XX], track[w, k, tracker.XY], track[w, k, tracker.YY])
        usable = True
    if usable:
        estimate[w, k, EstimateColumn.x] = fix[0]
        estimate[w, k, EstimateColumn.y] = fix[1]
        estimate[w, k, EstimateColumn.covariance_xx] = spread[0]
        estimate[w, k, EstimateColumn.covariance_xy] = spread[1]
        estimate[w, k, EstimateColumn.covariance_yy] = spread[2]
    estimate[w, k, EstimateColumn.separation] = -z
    error = vec2(estimate[w, k, EstimateColumn.x], estimate[w, k, EstimateColumn.y]) - there
    auv[w, k, AuvColumn.position_error] = error.norm()


@ti.func
def begin_track(p: ti.template(), estimate: ti.template(), track: ti.template(), w, k):
    """Track AUV k from where it was deployed, in an unknown current."""
    spread = vec3(DEPLOYED, 0.0, DEPLOYED)
    x = estimate[w, k, EstimateColumn.x]
    y = estimate[w, k, EstimateColumn.y]
    tracker.begin(track, w, k, x, y, spread, p[Parameter.current_variance])


@ti.func
def predict(p: ti.template(), auv: ti.template(), estimate: ti.template(), track: ti.template(), w, k):
    """Carry the track of AUV k through the step it has just made, by what it was commanded."""
    adrift = 1.0 - ti.max(auv[w, k, AuvColumn.hovering], auv[w, k, AuvColumn.border])
    water = vec2(auv[w, k, AuvColumn.water_x], auv[w, k, AuvColumn.water_y])
    tracker.carry(track, w, k, water, p[Parameter.step], adrift)
    estimate[w, k, EstimateColumn.x] = track[w, k, tracker.X]
    estimate[w, k, EstimateColumn.y] = track[w, k, tracker.Y]


@ti.func
def turn_to_next_step(
    p: ti.template(),
    auv: ti.template(),
    track: ti.template(),
    episode,
    now,
    key_low,
    key_high,
    w,
    k,
):
    """Make the track's current that of the coming step, and read the AUV's current meter if it has one."""
    tracker.renew(track, w, k, p[Parameter.step], p[Parameter.current_variance], p[Parameter.correlation_time])
    deviation = p[Parameter.current_reading]
    if deviation > 0.0:
        noise = random.normals(common.address(p, w, episode, now, Draw.reading, k), key_low, key_high)
        reading = vec2(auv[w, k, AuvColumn.current_x], auv[w, k, AuvColumn.current_y])
        reading += deviation * vec2(noise[0], noise[1])
        tracker.sense(track, w, k, reading, deviation * deviation)
