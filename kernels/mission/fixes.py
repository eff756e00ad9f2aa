"""The fixes of a mission: what the array on a boat receives of an AUV, and what the boats then know of it."""

import math

import taichi as ti

from kernels import random
from kernels.mission import navigation, serving
from kernels.mission.columns import AuvColumn, BoatColumn, Draw, EstimateColumn, Parameter, Refraction, Sensor
from kernels.mission.worlds import Worlds, address, key, normals, uniforms
from kernels.positioning import acoustic_link, coded_pulse, rays, reflections, tracker, usbl, validation, waveform
from kernels.positioning.validation import Expectation
from kernels.types import mat3, vec2, vec3, vec4, vec6

DEPLOYMENT_VARIANCE = 1e-4  # of the place where an AUV is deployed, m²


@ti.dataclass
class ArrayPose:
    """The array on its wave, and what is known of it.

    Attributes:
        boat: index of the boat that has it.
        axes: of the array in the world's frame, see `usbl.array_axes`.
        measured: the same as the sensors of attitude and heading have them.
        displaced: error of the array's position, m.
        slowness: slowness of sound over that which fixes are computed with.
        effort: speed of the boat through the water over its top speed.
    """

    boat: ti.i32
    axes: mat3
    measured: mat3
    displaced: vec2
    slowness: ti.f32
    effort: ti.f32


@ti.dataclass
class Arrival:
    """A signal on its way to the array.

    Attributes:
        offset: from array to AUV, m.
        body: direction of the AUV in the array's true frame.
        slant_range: straight distance, m.
        path: the distance that the sound's delay stands for, m.
        loss: of `acoustic_link.further_loss`, dB.
    """

    offset: vec3
    body: vec3
    slant_range: ti.f32
    path: ti.f32
    loss: ti.f32


@ti.dataclass
class Signal:
    """What the array measures of a signal: phase differences and residual in rad modulo one turn, slant range in m."""

    phase: vec2
    residual: ti.f32
    slant_range: ti.f32
    amplitude: ti.f32


@ti.dataclass
class Fix:
    """A fix: `place` in m, `covariance` (xx, xy, yy) of its own errors in m², and `usbl`'s `flags`."""

    place: vec2
    covariance: vec3
    flags: ti.i32


@ti.func
def array_pose(worlds: ti.template(), w, b) -> ArrayPose:
    """Pose of the array of boat b in this step, the same for all AUVs.

    Errors of mounting, heading, lever arm and speed of sound last for an episode, those of pitch and roll are new in
    each step, that of the boat's position is a Gauss–Markov process.
    """
    p = ti.static(worlds.p)
    boat = ti.static(worlds.boat)
    slope = p[Parameter.tilt] * vec2(boat[w, b, BoatColumn.slope_x], boat[w, b, BoatColumn.slope_y])
    angles = usbl.attitude(slope)
    noise = normals(worlds, w, Draw.attitude, b)
    lasting = random.normals(address(worlds, w, 0, Draw.calibration, b), key(worlds, w))
    lever = random.normals(address(worlds, w, 0, Draw.lever_arm, b), key(worlds, w))
    error = p[Parameter.attitude_error] * vec2(noise[0], noise[1])
    error += p[Parameter.alignment_error] * vec2(lasting[0], lasting[1])
    gnss = vec2(boat[w, b, BoatColumn.gnss_x], boat[w, b, BoatColumn.gnss_y])
    return ArrayPose(
        boat=b,
        axes=usbl.array_axes(angles),
        measured=usbl.turned(usbl.array_axes(angles + error), p[Parameter.heading_error] * lasting[2]),
        displaced=gnss + p[Parameter.lever_arm_error] * vec2(lever[0], lever[1]),
        slowness=1.0 / (1.0 + p[Parameter.sound_speed_error] * lasting[3]),
        effort=boat[w, b, BoatColumn.effort],
    )


@ti.func
def sounds(worlds: ti.template(), pose: ArrayPose, arrival: Arrival, w, k):
    """What the hydrophones receive of a coded pulse, as `coded_pulse.sounds` has it.

    The array lies at its depth below the surface as it is there; it and the AUVs rise and sink over a level bottom.
    """
    p = ti.static(worlds.p)
    boundaries = reflections.Boundaries(
        array_depth=p[Parameter.array_depth],
        water_depth=p[Parameter.water_depth] + worlds.boat[w, pose.boat, BoatColumn.elevation],
        roughness=p[Parameter.roughness],
        density=p[Parameter.bottom_density],
        speed=p[Parameter.bottom_speed],
        absorption=p[Parameter.bottom_absorption],
    )
    z = -worlds.boat[w, pose.boat, BoatColumn.elevation]
    direct = arrival.path / pose.slowness
    speed = p[Parameter.sound_speed]
    bent = ti.static(reflections.Profile(worlds.layers, worlds.mirrored_layers, z, speed, direct))
    around = ti.static(surroundings(worlds, boundaries, bent))
    body = arrival.path * arrival.body
    return coded_pulse.sounds(worlds.pulses, worlds.link, k, body, arrival.path, arrival.offset, pose.axes, around)


def surroundings(worlds: Worlds, boundaries, profile: reflections.Profile) -> reflections.Surroundings:
    """What an array hears reflected."""
    if not worlds.program.multipath:
        return reflections.Surroundings()
    if worlds.program.refraction == Refraction.none:
        return reflections.Surroundings(boundaries)
    return reflections.Surroundings(boundaries, profile)


@ti.func
def sample(worlds: ti.template(), pose: ArrayPose, arrival: Arrival, sigma, draw: random.uint4, w, k) -> vec6:
    """The sampled signal of AUV k as the receiver measures it, columns of `waveform`."""
    link = ti.static(worlds.link)
    measured = vec6(0.0)
    if ti.static(worlds.program.coded):
        heard = sounds(worlds, pose, arrival, w, k)
        noise = ti.static(worlds.pulse_noise)
        coded_pulse.draw(noise, w, draw, key(worlds, w))
        energy = 1.0 / (sigma * sigma)
        measured = coded_pulse.measure(worlds.pulses, link, k, arrival.path, energy, heard, noise, w)
    else:
        stream = random.philox(draw, key(worlds, w))
        at = arrival.path * arrival.body
        measured = waveform.measure(link, k, at, arrival.path, sigma, stream, waveform.PROJECTED)
    return measured


@ti.func
def receive(worlds: ti.template(), pose: ArrayPose, arrival: Arrival, w, k) -> Signal:
    """What the array measures of a signal of AUV k."""
    link = ti.static(worlds.link)
    draw = address(worlds, w, worlds.clock[w, 1], Draw.fix, k)
    sigma = acoustic_link.phase_deviation(link, k, arrival.slant_range, arrival.loss)
    phase = vec2(0.0, 0.0)
    residual = 0.0
    slant_range = arrival.path
    amplitude = 0.0
    if ti.static(worlds.program.waveform):
        measured = sample(worlds, pose, arrival, sigma, draw, w, k)
        phase = vec2(measured[waveform.PHASE_X], measured[waveform.PHASE_Y])
        residual = measured[waveform.RESIDUAL]
        slant_range += measured[waveform.RANGE_ERROR]
        amplitude = measured[waveform.AMPLITUDE]
    else:
        body = arrival.body
        if ti.static(worlds.program.multipath):
            heard = sounds(worlds, pose, arrival, w, k)
            disturbed = coded_pulse.disturbance(worlds.pulses, link, k, heard)
            body += vec3(disturbed[0], disturbed[1], 0.0) / link[k, acoustic_link.KAPPA]
            slant_range += disturbed[2]
            sigma = ti.min(sigma / ti.max(disturbed[3], 1e-6), acoustic_link.LARGEST_DEVIATION)
        noise = random.normals(draw, key(worlds, w))
        residual_noise = 0.0
        if ti.static(worlds.program.turns):
            residual_noise = normals(worlds, w, Draw.residual, k)[0]
        measured = usbl.measure(link, k, body, slant_range, sigma, noise, residual_noise)
        phase = vec2(usbl.wrap(measured.phase[0]), usbl.wrap(measured.phase[1]))
        residual = measured.residual
        slant_range = measured.slant_range
        amplitude = measured.amplitude
    return Signal(phase=phase, residual=residual, slant_range=slant_range, amplitude=amplitude)


@ti.func
def locate(worlds: ti.template(), pose: ArrayPose, w, direction: vec3, slant_range) -> vec3:
    """The offset (m) from the array of what is heard from a direction, by the rays that the receiver reckons with."""
    found = slant_range * direction
    if ti.static(worlds.program.refraction == Refraction.corrected):
        z = -worlds.boat[w, pose.boat, BoatColumn.elevation]
        below = vec3(direction[0], direction[1], -1.0)
        found = rays.follow(worlds.layers, z, below, slant_range, worlds.p[Parameter.sound_speed])
    return found


@ti.func
def covariance_at(worlds: ti.template(), pose: ArrayPose, k, offset: vec3) -> vec3:
    """Covariance (xx, xy, yy) in m² of a fix's own errors at the offset that the receiver measured."""
    loss = acoustic_link.further_loss(worlds.link, k, offset, pose.effort)
    sigma = acoustic_link.phase_deviation(worlds.link, k, offset.norm(), loss)
    return usbl.horizontal_covariance(worlds.link, k, offset, pose.axes, sigma)


@ti.func
def whole_turns(worlds: ti.template(), signal: Signal, length, pose: ArrayPose, expected: Expectation, w, k):
    """Phase differences of a signal of AUV k with the turns that they most probably lack, and 1 where others are near.

    See `kernels.positioning.validation`. `length` as of `usbl.located`.
    """
    link = ti.static(worlds.link)
    odd = usbl.odd_turns(signal.residual)
    most = validation.most_turns(link, k, length)
    kappa = length * link[k, acoustic_link.KAPPA]
    phase = signal.phase
    best = validation.NO_CANDIDATE
    second = validation.NO_CANDIDATE
    for m in range(-most, most + 1):
        for n in range(-most, most + 1):
            candidate = signal.phase + 2.0 * math.pi * vec2(m, n)
            if ((m + n) & 1) == odd and candidate.norm_sqr() <= kappa * kappa:
                found = usbl.located(link, k, candidate, candidate, signal.amplitude, pose.measured, length)
                offset = locate(worlds, pose, w, found.vector, signal.slant_range)
                loss = acoustic_link.further_loss(link, k, offset, pose.effort)
                sigma = acoustic_link.phase_deviation(link, k, offset.norm(), loss)
                covariance = covariance_at(worlds, pose, k, offset)
                badness = validation.badness(link, k, expected, offset, covariance, sigma)
                if badness < best:
                    second = best
                    best = badness
                    phase = candidate
                elif badness < second:
                    second = badness
    return phase, ti.cast(second - best < validation.GATE, ti.i32)


@ti.func
def measure(worlds: ti.template(), offset: vec3, pose: ArrayPose, expected: Expectation, w, k) -> vec4:
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
        z = -worlds.boat[w, pose.boat, BoatColumn.elevation]
        ray = rays.refracted(layers, z, z, offset, c)
        direction = ray.direction
        path = ray.slant_range
        if ray.exists == 0:
            flags = usbl.NO_RAY
        if ti.static(refraction == Refraction.corrected):
            length = c / rays.sound_speed(layers, z)
    # Where sound is slower than supposed, it comes later and less across the array.
    body = pose.slowness * (pose.axes @ direction)
    loss = acoustic_link.further_loss(link, k, offset, pose.effort)
    arrival = Arrival(offset=offset, body=body, slant_range=S, path=pose.slowness * path, loss=loss)
    signal = receive(worlds, pose, arrival, w, k)
    phase = signal.phase
    ambiguous = 0
    if ti.static(worlds.program.turns):
        phase, ambiguous = whole_turns(worlds, signal, length, pose, expected, w, k)
    true_phase = link[k, acoustic_link.KAPPA] * vec2(body[0], body[1])
    found = usbl.located(link, k, true_phase, phase, signal.amplitude, pose.measured, length)
    place = locate(worlds, pose, w, found.vector, signal.slant_range)
    if flags == 0:
        flags = found.flags | usbl.AMBIGUOUS * ambiguous
    return vec4(place[0], place[1], place[2], ti.cast(flags, ti.f32))


@ti.func
def separation(worlds: ti.template(), w, b):
    """Height of the AUVs over boat b on its wave, m: negative."""
    return -(worlds.p[Parameter.separation_boat] + worlds.boat[w, b, BoatColumn.elevation])


@ti.func
def away(worlds: ti.template(), w, b, k) -> vec3:
    """From boat b to where AUV k is estimated, m."""
    x = worlds.estimate[w, k, EstimateColumn.x] - worlds.boat[w, b, BoatColumn.x]
    y = worlds.estimate[w, k, EstimateColumn.y] - worlds.boat[w, b, BoatColumn.y]
    return vec3(x, y, separation(worlds, w, b))


@ti.func
def boat_before(worlds: ti.template(), w, b, age) -> vec2:
    """Where boat b was `age` seconds before the end of the step, m."""
    boat = ti.static(worlds.boat)
    share = age / worlds.p[Parameter.step]
    moved = vec2(boat[w, b, BoatColumn.moved_x], boat[w, b, BoatColumn.moved_y])
    return vec2(boat[w, b, BoatColumn.x], boat[w, b, BoatColumn.y]) - share * moved


@ti.func
def no_fix(worlds: ti.template(), w, k):
    """No fix of AUV k is due in this step."""
    worlds.auv[w, k, AuvColumn.fix_flags] = ti.cast(usbl.SILENT, ti.f32)


@ti.func
def make_fix(
    worlds: ti.template(), pose: ArrayPose, w, k, here: vec2, there: vec2, expected: Expectation, lost: ti.i32
) -> Fix:
    """Fix AUV k, which was `there` when its signal left, from its boat `here`, m; `lost`: no signal comes."""
    auv = ti.static(worlds.auv)
    offset = vec3(there[0] - here[0], there[1] - here[1], separation(worlds, w, pose.boat))
    found = measure(worlds, offset, pose, expected, w, k)
    flags = ti.cast(found[3], ti.i32)
    if lost:
        flags = usbl.LOST
    measured = vec3(found[0], found[1], found[2])
    covariance = covariance_at(worlds, pose, k, measured)
    common = usbl.systematic_covariance(worlds.link, k, measured, pose.axes)
    place = here + pose.displaced + vec2(found[0], found[1])
    for c in ti.static(range(2)):
        auv[w, k, AuvColumn.fix_x + c] = place[c]
        auv[w, k, AuvColumn.heard_x + c] = there[c]
    auv[w, k, AuvColumn.fix_flags] = ti.cast(flags, ti.f32)
    auv[w, k, AuvColumn.fix_boat] = ti.cast(pose.boat, ti.f32)
    for c in ti.static(range(3)):
        auv[w, k, AuvColumn.covariance_xx + c] = covariance[c] + common[c]
    if ti.static(worlds.program.fleet):
        # What fixes of one boat have in common differs from boat to boat.
        covariance += common
    return Fix(place=place, covariance=covariance, flags=flags)


@ti.func
def expect(worlds: ti.template(), w, b, k, here: vec2, age) -> Expectation:
    """Where boat b, `here` (m), expects AUV k by the estimate of it, which was made `age` seconds ago."""
    estimate = ti.static(worlds.estimate)
    covariance = vec3(0.0)
    for j in ti.static(range(3)):
        covariance[j] = estimate[w, k, EstimateColumn.covariance_xx + j]
    return Expectation(
        place=vec2(estimate[w, k, EstimateColumn.x], estimate[w, k, EstimateColumn.y]) - here,
        covariance=covariance,
        reach=worlds.p[Parameter.auv_speed] * age,
        separation=-separation(worlds, w, b),
    )


@ti.func
def take_fix(worlds: ti.template(), pose: ArrayPose, w, k):
    """Fix AUV k from the boat on its wave, and update the estimate of its position.

    The fix that is there at the end of a step was received `latency` earlier, of a tone that had left the AUV S/c
    before. Without a tracker the estimate is the last fix that the receiver could use (`usbl.usable`); one farther away
    than the AUV can have gone since is not used, see `kernels.positioning.validation`.
    """
    p = ti.static(worlds.p)
    auv = ti.static(worlds.auv)
    here = boat_before(worlds, w, pose.boat, p[Parameter.latency])
    there = vec2(auv[w, k, AuvColumn.x], auv[w, k, AuvColumn.y])
    z = separation(worlds, w, pose.boat)
    range_now = ti.sqrt((there - boat_before(worlds, w, pose.boat, 0.0)).norm_sqr() + z * z)
    age = p[Parameter.latency] + p[Parameter.propagates] * range_now / p[Parameter.sound_speed]
    then = there - age / p[Parameter.step] * vec2(auv[w, k, AuvColumn.moved_x], auv[w, k, AuvColumn.moved_y])
    lost = 0
    if p[Parameter.packet_loss] > 0.0:
        u = uniforms(worlds, w, Draw.loss, k)
        lost = ti.cast(u[0] < p[Parameter.packet_loss], ti.i32)
    if ti.static(worlds.program.tracker):
        expected = expect(worlds, w, pose.boat, k, here, 0.0)
        track = ti.static(worlds.track)
        lag = age * track[w, k, tracker.ADRIFT]
        carried = lag * vec2(track[w, k, tracker.WATER_X], track[w, k, tracker.WATER_Y])
        place, covariance = tracker.earlier(track, w, k, lag, carried)
        expected.place = place - here
        expected.covariance = covariance
        fix = make_fix(worlds, pose, w, k, here, then, expected, lost)
        update_track(worlds, w, k, fix, lag, carried)
        know_track(worlds, w, k)
    else:
        expected = expect(worlds, w, pose.boat, k, here, worlds.estimate[w, k, EstimateColumn.age])
        fix = make_fix(worlds, pose, w, k, here, then, expected, lost)
        know_fix(worlds, w, k, fix, expected, here)
    finish(worlds, pose, w, k)


@ti.func
def take_fixes(worlds: ti.template(), w, b):
    """Fix the AUVs that boat b serves."""
    pose = array_pose(worlds, w, b)
    for k in range(worlds.auv.shape[1]):
        if serving.serves(worlds, w, b, k):
            take_fix(worlds, pose, w, k)


@ti.func
def take_reply(worlds: ti.template(), pose: ArrayPose, w, k, there: vec2, age, lost: ti.i32):
    """Fix AUV k by a reply that left `there` (m) and arrived `age` seconds before the end of the step, or did not."""
    here = boat_before(worlds, w, pose.boat, age)
    if ti.static(worlds.program.sensor != Sensor.none):
        expected = expect(worlds, w, pose.boat, k, here, worlds.p[Parameter.step] + age)
        fix = make_fix(worlds, pose, w, k, here, there, expected, lost)
        if fix.flags & usbl.DETECTED:  # what the reply carries is there, whatever its fix is worth
            navigation.hear(worlds, w, k)
            update_track(worlds, w, k, fix, 0.0, vec2(0.0, 0.0))
    else:
        expected = expect(worlds, w, pose.boat, k, here, worlds.estimate[w, k, EstimateColumn.age])
        fix = make_fix(worlds, pose, w, k, here, there, expected, lost)
        know_fix(worlds, w, k, fix, expected, here)


@ti.func
def update_track(worlds: ti.template(), w, k, fix: Fix, lag, carried: vec2):
    """Update the track of AUV k by a fix that can be used; `lag` and `carried` as of `tracker.Fix`."""
    p = ti.static(worlds.p)
    track = ti.static(worlds.track)
    if usbl.usable(fix.flags):
        taken = tracker.Fix(place=fix.place, covariance=fix.covariance, lag=lag, carried=carried)
        tracker.update(track, w, k, taken, p[Parameter.current_variance], p[Parameter.auv_speed])
        if track[w, k, tracker.REJECTIONS] > 0.0:
            worlds.auv[w, k, AuvColumn.fix_flags] = ti.cast(fix.flags | usbl.REJECTED, ti.f32)


@ti.func
def know_fix(worlds: ti.template(), w, k, fix: Fix, expected: Expectation, here: vec2):
    """The estimate of AUV k is the fix of this step, made from `here` (m), where it can be used."""
    estimate = ti.static(worlds.estimate)
    auv = ti.static(worlds.auv)
    flags = fix.flags
    if (
        usbl.usable(flags)
        and validation.squared_innovation(expected, fix.place - here, fix.covariance) > validation.GATE
    ):
        flags |= usbl.REJECTED
    auv[w, k, AuvColumn.fix_flags] = ti.cast(flags, ti.f32)
    if usbl.usable(flags):
        for c in ti.static(range(2)):
            estimate[w, k, EstimateColumn.x + c] = auv[w, k, AuvColumn.fix_x + c]
        for c in ti.static(range(3)):
            estimate[w, k, EstimateColumn.covariance_xx + c] = auv[w, k, AuvColumn.covariance_xx + c]
        estimate[w, k, EstimateColumn.age] = 0.0


@ti.func
def know_track(worlds: ti.template(), w, k):
    """The estimate of AUV k is its track."""
    estimate = ti.static(worlds.estimate)
    track = ti.static(worlds.track)
    estimate[w, k, EstimateColumn.x] = track[w, k, tracker.X]
    estimate[w, k, EstimateColumn.y] = track[w, k, tracker.Y]
    estimate[w, k, EstimateColumn.covariance_xx] = track[w, k, tracker.XX]
    estimate[w, k, EstimateColumn.covariance_xy] = track[w, k, tracker.XY]
    estimate[w, k, EstimateColumn.covariance_yy] = track[w, k, tracker.YY]


@ti.func
def finish(worlds: ti.template(), pose: ArrayPose, w, k):
    """What the boats know of AUV k at the end of the step, with the errors that fixes by its boat have in common."""
    estimate = ti.static(worlds.estimate)
    estimate[w, k, EstimateColumn.age] = estimate[w, k, EstimateColumn.age] + worlds.p[Parameter.step]
    if ti.static(worlds.program.sensor != Sensor.none):
        navigation.expect(worlds, w, k)
    z = separation(worlds, w, pose.boat)
    estimate[w, k, EstimateColumn.separation] = -z
    place = vec2(estimate[w, k, EstimateColumn.x], estimate[w, k, EstimateColumn.y])
    if ti.static(worlds.program.tracker or worlds.program.sensor != Sensor.none):
        # Both are renewed in each step, without what fixes have in common.
        common = usbl.systematic_covariance(worlds.link, k, away(worlds, w, pose.boat, k), pose.axes)
        for c in ti.static(range(3)):
            estimate[w, k, EstimateColumn.covariance_xx + c] = (
                estimate[w, k, EstimateColumn.covariance_xx + c] + common[c]
            )
    error = place - vec2(worlds.auv[w, k, AuvColumn.x], worlds.auv[w, k, AuvColumn.y])
    worlds.auv[w, k, AuvColumn.position_error] = error.norm()


@ti.func
def begin_estimate(worlds: ti.template(), pose: ArrayPose, w, k):
    """The covariance with which the place where AUV k is deployed is known.

    A track follows the positions that fixes without noise would show, so the errors that fixes have in common are part
    of it.
    """
    covariance = usbl.systematic_covariance(worlds.link, k, away(worlds, w, pose.boat, k), pose.axes)
    covariance += vec3(DEPLOYMENT_VARIANCE, 0.0, DEPLOYMENT_VARIANCE)
    for c in ti.static(range(3)):
        worlds.estimate[w, k, EstimateColumn.covariance_xx + c] = covariance[c]


@ti.func
def predict(worlds: ti.template(), w, k):
    """Carry the track of AUV k through the step it has just made, by its commanded velocity."""
    auv = ti.static(worlds.auv)
    adrift = 1.0 - ti.max(auv[w, k, AuvColumn.hovering], auv[w, k, AuvColumn.border])
    water = vec2(auv[w, k, AuvColumn.water_x], auv[w, k, AuvColumn.water_y])
    tracker.carry(worlds.track, w, k, water, worlds.p[Parameter.step], adrift)
    tracker.spread(worlds.track, w, k, navigation.gnss_change(worlds, worlds.p[Parameter.step]))
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
