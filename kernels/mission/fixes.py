"""The fixes of a mission: what the array on the boat receives of an AUV, and what the boat then knows of it."""

import taichi as ti

from kernels import random
from kernels.mission.columns import AuvColumn, BoatColumn, Draw, EstimateColumn, Parameter, Refraction
from kernels.mission.worlds import address, normals, uniforms
from kernels.positioning import rays, tracker, usbl, waveform
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
        length: of the direction in the measurement, see `usbl.located`.
    """

    body: vec3
    slant_range: ti.f32
    path: ti.f32
    length: ti.f32


@ti.dataclass
class Bearing:
    """What the array measures of a tone: `direction` in the world's frame, `slant_range` in m, `usbl`'s `flags`."""

    direction: vec3
    slant_range: ti.f32
    flags: ti.i32


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
def receive(worlds: ti.template(), arrival: Arrival, axes: mat3, draw: random.uint4, k) -> Bearing:
    """What the array measures of a tone of AUV k; `axes` are the array's as measured, `draw` addresses the noise."""
    link = ti.static(worlds.link)
    phase = vec2(0.0, 0.0)
    measured = arrival.path
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
        measured += tone[waveform.RANGE_ERROR]
        amplitude = tone[waveform.AMPLITUDE]
    else:
        noise = random.normals(draw, worlds.key_low, worlds.key_high)
        tone = usbl.measure(link, k, arrival.body, arrival.slant_range, arrival.path, noise)
        phase = vec2(usbl.wrap(tone.phase[0]), usbl.wrap(tone.phase[1]))
        measured = tone.slant_range
        amplitude = tone.amplitude
    true_phase = link[k, usbl.KAPPA] * vec2(arrival.body[0], arrival.body[1])
    found = usbl.located(link, k, true_phase, phase, amplitude, axes, arrival.length)
    return Bearing(direction=found.vector, slant_range=measured, flags=found.flags)


@ti.func
def measure(worlds: ti.template(), offset: vec3, elevation, attitude: ArrayAttitude, draw: random.uint4, k) -> vec4:
    """The offset (m) from boat to AUV k that a fix gives, and its flags.

    Args:
        offset: the true one, m. elevation: of the sea under the boat, m. draw: address of the noise.
    """
    layers = ti.static(worlds.layers)
    refraction = ti.static(worlds.program.refraction)
    S = ti.max(offset.norm(), 1e-3)
    c = worlds.p[Parameter.sound_speed]
    direction = offset / S
    path = S
    length = 1.0
    flags = 0
    if ti.static(refraction != Refraction.none):
        ray = rays.refracted(layers, -elevation, -elevation, offset, c)
        direction = ray.direction
        path = ray.slant_range
        if ray.exists == 0:
            flags = usbl.NO_RAY
        if ti.static(refraction == Refraction.corrected):
            length = c / rays.sound_speed(layers, -elevation)
    arrival = Arrival(body=attitude.axes @ direction, slant_range=S, path=path, length=length)
    bearing = receive(worlds, arrival, attitude.measured, draw, k)
    found = bearing.slant_range * bearing.direction
    if ti.static(refraction == Refraction.corrected):
        below = vec3(bearing.direction[0], bearing.direction[1], -1.0)  # whence all sound comes to the surface
        found = rays.follow(layers, -elevation, below, bearing.slant_range, c)
    if flags == 0:
        flags = bearing.flags
    return vec4(found[0], found[1], found[2], ti.cast(flags, ti.f32))


@ti.func
def take_fix(worlds: ti.template(), attitude: ArrayAttitude, w, k):
    """Fix AUV k from the boat on its wave, and update the estimate of its position.

    The fix that is there at the end of a step was received `latency` earlier, of a tone that had left the AUV S/c
    before. Without a tracker the estimate is the last fix that the receiver could use, which is one that was detected
    and has a real depth; it cannot tell a wrapped one from any other.
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
    draw = address(worlds, w, worlds.clock[w, 1], Draw.fix, k)
    found = measure(worlds, offset, boat[w, BoatColumn.elevation], attitude, draw, k)
    flags = ti.cast(found[3], ti.i32)
    if p[Parameter.packet_loss] > 0.0:
        u = uniforms(worlds, w, Draw.loss, k)
        if u[0] < p[Parameter.packet_loss]:
            flags = usbl.LOST
    # The receiver evaluates the covariance at the offset that it measured.
    measured = vec3(found[0], found[1], found[2])
    sigma = usbl.phase_deviation(worlds.link, k, measured.norm())
    covariance = usbl.horizontal_covariance(worlds.link, k, measured, attitude.axes, p[Parameter.attitude_error], sigma)
    fix = here + vec2(found[0], found[1])
    auv[w, k, AuvColumn.fix_x] = fix[0]
    auv[w, k, AuvColumn.fix_y] = fix[1]
    auv[w, k, AuvColumn.fix_flags] = ti.cast(flags, ti.f32)
    auv[w, k, AuvColumn.covariance_xx] = covariance[0]
    auv[w, k, AuvColumn.covariance_xy] = covariance[1]
    auv[w, k, AuvColumn.covariance_yy] = covariance[2]
    usable = (flags & usbl.DETECTED) != 0 and (flags & usbl.NO_DEPTH) == 0
    if ti.static(worlds.program.tracker):
        track = ti.static(worlds.track)
        if usable:
            lag = age * track[w, k, tracker.ADRIFT]
            water = vec2(track[w, k, tracker.WATER_X], track[w, k, tracker.WATER_Y])
            tracker.update(track, w, k, fix, covariance, lag, lag * water)
        fix = vec2(track[w, k, tracker.X], track[w, k, tracker.Y])
        covariance = vec3(track[w, k, tracker.XX], track[w, k, tracker.XY], track[w, k, tracker.YY])
        usable = True
    if usable:
        estimate[w, k, EstimateColumn.x] = fix[0]
        estimate[w, k, EstimateColumn.y] = fix[1]
        estimate[w, k, EstimateColumn.covariance_xx] = covariance[0]
        estimate[w, k, EstimateColumn.covariance_xy] = covariance[1]
        estimate[w, k, EstimateColumn.covariance_yy] = covariance[2]
    estimate[w, k, EstimateColumn.separation] = -z
    error = vec2(estimate[w, k, EstimateColumn.x], estimate[w, k, EstimateColumn.y]) - there
    auv[w, k, AuvColumn.position_error] = error.norm()


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
