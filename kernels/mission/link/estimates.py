"""The boats' estimates of AUVs: by fixes alone, or by fixes and what replies say of dead reckoning.

See `usvauv.kernels.mission.auvs.reckoning` for dead reckoning and `usvauv.kernels.positioning.tracker` for the filter.
"""

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.mission.auvs import reckoning
from usvauv.kernels.mission.blocks import for_auvs, put, take
from usvauv.kernels.mission.boats import boat_motion
from usvauv.kernels.mission.columns import (
    AuvColumn,
    BoatColumn,
    EstimateColumn,
    ReceptionColumn,
    Schedule,
)
from usvauv.kernels.mission.link import channel, fixes
from usvauv.kernels.mission.link.channel import boat_before
from usvauv.kernels.mission.link.replies import height
from usvauv.kernels.positioning import tracker, usbl
from usvauv.kernels.positioning.usbl import Expectation
from usvauv.kernels.types import vec2, vec3

DEPLOYMENT_VARIANCE = 1e-4  # of the place where an AUV is deployed, m²


@func
def common_errors(
    worlds: ti.template(), w: ti.template(), k: ti.template(), b: ti.template(), link: ti.template(), row
):
    """Covariance xx, xy, yy (m²) of what fixes of AUVs k by boats b have in common, where the AUVs are estimated."""
    estimate, boat = ti.static(worlds.estimate, worlds.boat)
    x = take(estimate, w, k, EstimateColumn.x) - take(boat, w, b, BoatColumn.x)
    y = take(estimate, w, k, EstimateColumn.y) - take(boat, w, b, BoatColumn.y)
    z = 0.0 - take(estimate, w, k, EstimateColumn.separation)
    heading = fixes.heading_of(worlds, w, b)
    level = usbl.axis_numbers(fixes.tilt_of(worlds, w, b, heading))
    return fixes.common_errors(worlds, link, row, (x, y, z), ti.static(usbl.Axes(level)), heading)


@func
def add_to_covariance(worlds: ti.template(), w: ti.template(), k: ti.template(), count, link: ti.template(), row):
    """Add `common_errors` to the covariances of the estimates of the first `count` AUVs k of worlds w."""
    b = [boat_motion.serving_boat(worlds, w[n], k[n]) for n in ti.static(range(len(w)))]
    common = common_errors(worlds, w, k, b, link, row)
    first = ti.static(EstimateColumn.covariance_xx)
    sums = [take(worlds.estimate, w, k, first + c) + common[c] for c in ti.static(range(3))]
    put(worlds.estimate, w, k, count, first, sums)


@func
def expect(worlds: ti.template(), w, k, here: vec2) -> Expectation:
    """Where a boat, `here` (m), expects AUV k by the last estimate of it."""
    estimate = ti.static(worlds.estimate)
    covariance = vec3(0.0)
    for j in ti.static(range(3)):
        covariance[j] = estimate[w, k, EstimateColumn.covariance_xx + j]
    return Expectation(
        place=vec2(estimate.x[w, k], estimate.y[w, k]) - here,
        covariance=covariance,
        reach=worlds.p.auv_speed * estimate.age[w, k],
    )


@func
def use_fix(worlds: ti.template(), w, k):
    """Update the track or the estimate of AUV k by the fix of this step."""
    auv = ti.static(worlds.auv)
    reception = ti.static(worlds.reception)
    boat = ti.cast(auv.fix_boat[w, k], ti.i32)
    here = boat_before(worlds, w, boat, reception.arrived[w, k])
    place = here + fixes.displacement(worlds, w, boat) + vec2(reception.measured_x[w, k], reception.measured_y[w, k])
    flags = ti.cast(reception.flags[w, k], ti.i32)
    own, common = vec3(0.0), vec3(0.0)
    for c in ti.static(range(3)):
        own[c] = reception[w, k, ReceptionColumn.own_xx + c]
        common[c] = reception[w, k, ReceptionColumn.common_xx + c]
        auv[w, k, AuvColumn.covariance_xx + c] = own[c] + common[c]
    for c in ti.static(range(2)):
        auv[w, k, AuvColumn.fix_x + c] = place[c]
    auv.fix_flags[w, k] = ti.cast(flags, ti.f32)
    if ti.static(worlds.program.vehicle):
        if flags & usbl.DETECTED:
            worlds.body.told_depth[w, k] = auv.depth_error[w, k] + worlds.body.sensor_error[w, k]
    if ti.static(worlds.program.fleet):
        own += common  # errors common to a boat's fixes differ from boat to boat
    if ti.static(worlds.program.reckoning):
        if flags & usbl.DETECTED:  # the reply's contents are received even if its fix is not usable
            reckoning.read_reply(worlds, w, k)
            update_track(worlds, w, k, flags, place, own)
    else:
        set_estimate_from_fix(worlds, w, k, here, place, own, flags)


@func
def update_track(worlds: ti.template(), w, k, flags, place: vec2, covariance: vec3):
    """Update the track of AUV k by a fix, if it can be used."""
    p = ti.static(worlds.p)
    track = ti.static(worlds.track)
    if usbl.usable(flags):
        tracker.update(track, w, k, place, covariance, p.current_variance, p.auv_speed)
        if track[w, k, tracker.REJECTIONS] > 0.0:
            worlds.auv.fix_flags[w, k] = ti.cast(flags | usbl.REJECTED, ti.f32)


@func
def set_estimate_from_fix(worlds: ti.template(), w, k, here: vec2, place: vec2, covariance: vec3, flags):
    """The estimate of AUV k is the fix of this step, made from `here` (m), where it can be used.

    One farther away than the AUV can have gone since the last one is not used, see
    `usvauv.kernels.positioning.usbl`.
    """
    estimate = ti.static(worlds.estimate)
    auv = ti.static(worlds.auv)
    found = flags
    expected = expect(worlds, w, k, here)
    if usbl.usable(found) and usbl.squared_innovation(expected, place - here, covariance) > usbl.GATE:
        found |= usbl.REJECTED
    auv.fix_flags[w, k] = ti.cast(found, ti.f32)
    if usbl.usable(found):
        for c in ti.static(range(2)):
            estimate[w, k, EstimateColumn.x + c] = auv[w, k, AuvColumn.fix_x + c]
        for c in ti.static(range(3)):
            estimate[w, k, EstimateColumn.covariance_xx + c] = auv[w, k, AuvColumn.covariance_xx + c]
        estimate.age[w, k] = 0.0


@func
def fill_reply(worlds: ti.template(), w, k, age):
    """Contents of the reply of AUV k that left `age` seconds before the end of the step."""
    if ti.static(worlds.program.reckoning):
        reckoning.receive_state(worlds, w, k)
        reckoning.write_reply(worlds, w, k, age)


@func
def use_signal(worlds: ti.template(), w, k):
    """Contents and fix of the signals of AUV k in this step, in their order."""
    reception = ti.static(worlds.reception)
    left = reception.left[w, k]
    if left >= 0.0:
        fill_reply(worlds, w, k, left)
    if reception.arrived[w, k] >= 0.0:
        use_fix(worlds, w, k)
    left = reception.left_next[w, k]
    if left >= 0.0:
        fill_reply(worlds, w, k, left)


@func
def finish(worlds: ti.template(), w, k):
    """Complete the estimate of AUV k for this step, without the errors that all fixes by its boat have in common."""
    estimate = ti.static(worlds.estimate)
    estimate.age[w, k] = estimate.age[w, k] + worlds.p.step
    if ti.static(worlds.program.reckoning):
        reckoning.extrapolate(worlds, w, k)
    estimate.separation[w, k] = -height(worlds, w, boat_motion.serving_boat(worlds, w, k), k)
    error = vec2(estimate.x[w, k] - worlds.auv.x[w, k], estimate.y[w, k] - worlds.auv.y[w, k])
    worlds.auv.position_error[w, k] = error.norm()


@func
def estimate(worlds: ti.template(), w):
    """The boats use what they have heard in this step."""
    for k in range(worlds.auv.shape[1]):
        use_signal(worlds, w, k)
        finish(worlds, w, k)


@func
def add_common_errors(worlds: ti.template(), n):
    """Add to the estimates in the worlds of iteration n what fixes have in common, which no filter reduces.

    Filters renew their estimates in each step without it; a fix has it.
    """
    if ti.static(worlds.program.reckoning):
        for_auvs(worlds, add_to_covariance, n)


@func
def begin_estimate(worlds: ti.template(), w, k):
    """The boats know AUV k where it is deployed, and a first fix is taken, or the channel is free.

    A track follows the positions that fixes without noise would show, so the errors that fixes have in common are part
    of the covariance with which it begins.
    """
    estimate = ti.static(worlds.estimate)
    b = boat_motion.serving_boat(worlds, w, k)
    estimate.separation[w, k] = -height(worlds, w, b, k)
    common = common_errors(worlds, [w], [k], [b], worlds.link, k)
    estimate.covariance_xx[w, k] = common[0] + DEPLOYMENT_VARIANCE
    estimate.covariance_xy[w, k] = common[1]
    estimate.covariance_yy[w, k] = common[2] + DEPLOYMENT_VARIANCE
    if ti.static(worlds.program.reckoning):
        reckoning.begin_reckoning(worlds, w, k)
    if ti.static(worlds.program.schedule == Schedule.every_step):
        channel.receive_without_channel(worlds, w, k)
        fixes.fix_auvs(worlds, [w], [k], 1, worlds.link, k)
        use_fix(worlds, w, k)
    else:
        channel.begin_exchanges(worlds, w, k)
    finish(worlds, w, k)
    if ti.static(worlds.program.reckoning):
        add_to_covariance(worlds, [w], [k], 1, worlds.link, k)
