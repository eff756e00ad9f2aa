"""The fixes of a mission, and the boats' estimates of the AUVs' positions."""

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.mission import boat_motion, motion, navigation
from usvauv.kernels.mission.columns import AuvColumn, BoatColumn, BodyColumn, Draw, EstimateColumn, Parameter, Sensor
from usvauv.kernels.mission.reception import (
    ArrayPose,
    array_pose,
    common_covariance,
    covariance_at,
    height,
    measure,
    true_height,
)
from usvauv.kernels.mission.worlds import normals, uniforms
from usvauv.kernels.positioning import tracker, usbl
from usvauv.kernels.positioning.usbl import Expectation
from usvauv.kernels.types import vec2, vec3

DEPLOYMENT_VARIANCE = 1e-4  # of the place where an AUV is deployed, m²


@ti.dataclass
class Fix:
    """A fix: `place` in m, `covariance` (xx, xy, yy) of its own errors in m², and `usbl`'s `flags`."""

    place: vec2
    covariance: vec3
    flags: ti.i32


@func
def away(worlds: ti.template(), w, b, k) -> vec3:
    """From boat b to where AUV k is estimated, m."""
    x = worlds.estimate[w, k, EstimateColumn.x] - worlds.boat[w, b, BoatColumn.x]
    y = worlds.estimate[w, k, EstimateColumn.y] - worlds.boat[w, b, BoatColumn.y]
    return vec3(x, y, height(worlds, w, b, k))


@func
def boat_before(worlds: ti.template(), w, b, age) -> vec2:
    """Where boat b was `age` seconds before the end of the step, m."""
    boat = ti.static(worlds.boat)
    share = age / worlds.p[Parameter.step]
    moved = vec2(boat[w, b, BoatColumn.moved_x], boat[w, b, BoatColumn.moved_y])
    return vec2(boat[w, b, BoatColumn.x], boat[w, b, BoatColumn.y]) - share * moved


@func
def no_fix(worlds: ti.template(), w, k):
    """No fix of AUV k is due in this step."""
    worlds.auv[w, k, AuvColumn.fix_flags] = ti.cast(usbl.SILENT, ti.f32)


@func
def make_fix(
    worlds: ti.template(), pose: ArrayPose, w, k, here: vec2, there: vec2, expected: Expectation, lost: ti.i32
) -> Fix:
    """Fix AUV k, which was `there` when its signal left, from its boat `here`, m; `lost`: no signal comes."""
    auv = ti.static(worlds.auv)
    offset = vec3(there[0] - here[0], there[1] - here[1], true_height(worlds, w, pose.boat, k))
    found = measure(worlds, offset, pose, expected, w, k)
    flags = ti.cast(found[3], ti.i32)
    if lost:
        flags = usbl.LOST
    if ti.static(worlds.program.vehicle):
        if flags & usbl.DETECTED:
            read = auv[w, k, AuvColumn.depth_error] + worlds.body[w, k, BodyColumn.sensor_error]
            worlds.body[w, k, BodyColumn.told_depth] = read
    measured = vec3(found[0], found[1], found[2])
    covariance = covariance_at(worlds, pose, k, measured)
    common = common_covariance(worlds, pose, k, measured)
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


@func
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
        separation=-height(worlds, w, b, k),
    )


@func
def take_fix(worlds: ti.template(), pose: ArrayPose, w, k):
    """Fix AUV k from the boat on its wave, and update the estimate of its position.

    The fix that is there at the end of a step was received `latency` earlier, of a tone that had left the AUV S/c
    before. Without a tracker the estimate is the last fix that the receiver could use (`usbl.usable`); one farther away
    than the AUV can have gone since is not used, see `usvauv.kernels.positioning.usbl`.
    """
    p = ti.static(worlds.p)
    auv = ti.static(worlds.auv)
    here = boat_before(worlds, w, pose.boat, p[Parameter.latency])
    there = vec2(auv[w, k, AuvColumn.x], auv[w, k, AuvColumn.y])
    z = height(worlds, w, pose.boat, k)
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
        set_estimate_from_track(worlds, w, k)
    else:
        expected = expect(worlds, w, pose.boat, k, here, worlds.estimate[w, k, EstimateColumn.age])
        fix = make_fix(worlds, pose, w, k, here, then, expected, lost)
        set_estimate_from_fix(worlds, w, k, fix, expected, here)
    finish(worlds, pose, w, k)


@func
def take_fixes(worlds: ti.template(), w, b):
    """Fix the AUVs that boat b serves."""
    pose = array_pose(worlds, w, b)
    for k in range(worlds.auv.shape[1]):
        if boat_motion.serves(worlds, w, b, k):
            take_fix(worlds, pose, w, k)


@func
def take_reply(worlds: ti.template(), pose: ArrayPose, w, k, there: vec2, age, lost: ti.i32):
    """Fix AUV k by a reply that left `there` (m) and arrived `age` seconds before the end of the step, or did not."""
    here = boat_before(worlds, w, pose.boat, age)
    if ti.static(worlds.program.sensor != Sensor.none):
        expected = expect(worlds, w, pose.boat, k, here, worlds.p[Parameter.step] + age)
        fix = make_fix(worlds, pose, w, k, here, there, expected, lost)
        if fix.flags & usbl.DETECTED:  # what the reply carries is there, whatever its fix is worth
            navigation.read_reply(worlds, w, k)
            update_track(worlds, w, k, fix, 0.0, vec2(0.0, 0.0))
    else:
        expected = expect(worlds, w, pose.boat, k, here, worlds.estimate[w, k, EstimateColumn.age])
        fix = make_fix(worlds, pose, w, k, here, there, expected, lost)
        set_estimate_from_fix(worlds, w, k, fix, expected, here)


@func
def update_track(worlds: ti.template(), w, k, fix: Fix, lag, carried: vec2):
    """Update the track of AUV k by a fix that can be used; `lag` and `carried` as of `tracker.TrackFix`."""
    p = ti.static(worlds.p)
    track = ti.static(worlds.track)
    if usbl.usable(fix.flags):
        taken = tracker.TrackFix(place=fix.place, covariance=fix.covariance, lag=lag, carried=carried)
        tracker.update(track, w, k, taken, p[Parameter.current_variance], p[Parameter.auv_speed])
        if track[w, k, tracker.REJECTIONS] > 0.0:
            worlds.auv[w, k, AuvColumn.fix_flags] = ti.cast(fix.flags | usbl.REJECTED, ti.f32)


@func
def set_estimate_from_fix(worlds: ti.template(), w, k, fix: Fix, expected: Expectation, here: vec2):
    """The estimate of AUV k is the fix of this step, made from `here` (m), where it can be used."""
    estimate = ti.static(worlds.estimate)
    auv = ti.static(worlds.auv)
    flags = fix.flags
    if usbl.usable(flags) and usbl.squared_innovation(expected, fix.place - here, fix.covariance) > usbl.GATE:
        flags |= usbl.REJECTED
    auv[w, k, AuvColumn.fix_flags] = ti.cast(flags, ti.f32)
    if usbl.usable(flags):
        for c in ti.static(range(2)):
            estimate[w, k, EstimateColumn.x + c] = auv[w, k, AuvColumn.fix_x + c]
        for c in ti.static(range(3)):
            estimate[w, k, EstimateColumn.covariance_xx + c] = auv[w, k, AuvColumn.covariance_xx + c]
        estimate[w, k, EstimateColumn.age] = 0.0


@func
def set_estimate_from_track(worlds: ti.template(), w, k):
    """The estimate of AUV k is its track."""
    estimate = ti.static(worlds.estimate)
    track = ti.static(worlds.track)
    estimate[w, k, EstimateColumn.x] = track[w, k, tracker.X]
    estimate[w, k, EstimateColumn.y] = track[w, k, tracker.Y]
    estimate[w, k, EstimateColumn.covariance_xx] = track[w, k, tracker.XX]
    estimate[w, k, EstimateColumn.covariance_xy] = track[w, k, tracker.XY]
    estimate[w, k, EstimateColumn.covariance_yy] = track[w, k, tracker.YY]


@func
def finish(worlds: ti.template(), pose: ArrayPose, w, k):
    """Complete the estimate of AUV k for this step: with the errors that all fixes by its boat have in common."""
    estimate = ti.static(worlds.estimate)
    estimate[w, k, EstimateColumn.age] = estimate[w, k, EstimateColumn.age] + worlds.p[Parameter.step]
    if ti.static(worlds.program.sensor != Sensor.none):
        navigation.extrapolate(worlds, w, k)
    estimate[w, k, EstimateColumn.separation] = -height(worlds, w, pose.boat, k)
    place = vec2(estimate[w, k, EstimateColumn.x], estimate[w, k, EstimateColumn.y])
    if ti.static(worlds.program.tracker or worlds.program.sensor != Sensor.none):
        # Both are renewed in each step, without what fixes have in common.
        common = common_covariance(worlds, pose, k, away(worlds, w, pose.boat, k))
        for c in ti.static(range(3)):
            estimate[w, k, EstimateColumn.covariance_xx + c] = (
                estimate[w, k, EstimateColumn.covariance_xx + c] + common[c]
            )
    error = place - vec2(worlds.auv[w, k, AuvColumn.x], worlds.auv[w, k, AuvColumn.y])
    worlds.auv[w, k, AuvColumn.position_error] = error.norm()


@func
def begin_estimate(worlds: ti.template(), pose: ArrayPose, w, k):
    """The covariance with which the place where AUV k is deployed is known.

    A track follows the positions that fixes without noise would show, so the errors that fixes have in common are part
    of it.
    """
    covariance = common_covariance(worlds, pose, k, away(worlds, w, pose.boat, k))
    covariance += vec3(DEPLOYMENT_VARIANCE, 0.0, DEPLOYMENT_VARIANCE)
    for c in ti.static(range(3)):
        worlds.estimate[w, k, EstimateColumn.covariance_xx + c] = covariance[c]


@func
def predict(worlds: ti.template(), w, k):
    """Carry the track of AUV k through the step it has just made, by its velocity through the water."""
    auv = ti.static(worlds.auv)
    water = vec2(auv[w, k, AuvColumn.water_x], auv[w, k, AuvColumn.water_y])
    tracker.carry(worlds.track, w, k, water, worlds.p[Parameter.step], motion.drifted(worlds, w, k))
    tracker.spread(worlds.track, w, k, navigation.gnss_change(worlds, worlds.p[Parameter.step]))
    worlds.estimate[w, k, EstimateColumn.x] = worlds.track[w, k, tracker.X]
    worlds.estimate[w, k, EstimateColumn.y] = worlds.track[w, k, tracker.Y]


@func
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
