"""The array on a boat: its pose, its reception of an AUV's signal and the position that it measures.

`reply_worth` predicts what a reply is worth.
"""

import math

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.mission.boats import boat_motion
from usvauv.kernels.mission.columns import (
    AuvColumn,
    BoatColumn,
    Draw,
)
from usvauv.kernels.mission.replies import expected_reply
from usvauv.kernels.mission.worlds import normals
from usvauv.kernels.positioning import acoustic_link, rays, usbl
from usvauv.kernels.positioning.layered_water import sound_speed
from usvauv.kernels.positioning.sonar import magnitude
from usvauv.kernels.types import mat3, select, vec2, vec3, vec4


@ti.dataclass
class ArrayPose:
    """The array's true pose on the waves, and its measured one.

    Attributes:
        boat: index of the boat that has it.
        axes: of the array in the world's frame, see `usbl.array_axes`.
        measured: the same as the sensors of attitude and heading have them.
        displaced: error of the array's position, m.
        slowness: slowness of sound over that which fixes are computed with.
        effort: speed of the boat through the water over its top speed.
        heading: rad anticlockwise from east.
    """

    boat: ti.i32
    axes: mat3
    measured: mat3
    displaced: vec2
    slowness: ti.f32
    effort: ti.f32
    heading: ti.f32


@ti.dataclass
class Fix:
    """A fix: `place` in m, `covariance` (xx, xy, yy) of its own errors in m², and `usbl`'s `flags`."""

    place: vec2
    covariance: vec3
    flags: ti.i32


@func
def height(worlds: ti.template(), w, b, k):
    """Height of AUV k over boat b on its wave as the boat has it, m: negative. A vehicle tells its depth by replies."""
    depth = worlds.p.separation_boat + worlds.boat.elevation[w, b]
    if ti.static(worlds.program.vehicle):
        depth += worlds.body.told_depth[w, k]
    return -depth


@func
def true_height(worlds: ti.template(), w, b, k):
    """Height of AUV k over boat b on its wave, m: negative."""
    above = worlds.p.separation_boat + worlds.boat.elevation[w, b]
    return -above - worlds.auv.depth_error[w, k]


@func
def turned_by(way: vec2, angle: ti.f32) -> vec2:
    """A vector after a turn anticlockwise."""
    c, s = ti.cos(angle), ti.sin(angle)
    return vec2(c * way[0] - s * way[1], s * way[0] + c * way[1])


@func
def draw_lasting_errors(worlds: ti.template(), w, b):
    """Draw the errors of boat b that last for an episode: of mounting, heading, lever arm and speed of sound."""
    p = ti.static(worlds.p)
    boat = ti.static(worlds.boat)
    lasting = normals(worlds, w, Draw.calibration, b)
    lever = normals(worlds, w, Draw.lever_arm, b)
    for axis in ti.static(range(2)):
        boat[w, b, BoatColumn.mounting_pitch + axis] = p.alignment_error * lasting[axis]
        boat[w, b, BoatColumn.arm_ahead + axis] = p.lever_arm_error * lever[axis]
    boat.turn[w, b] = p.heading_error * lasting[2]
    boat.slowness[w, b] = 1.0 / (1.0 + p.sound_speed_error * lasting[3])


@func
def displacement(worlds: ti.template(), w, b) -> vec2:
    """Error of the position of boat b's array, m."""
    boat = ti.static(worlds.boat)
    arm = vec2(boat.arm_ahead[w, b], boat.arm_left[w, b])
    if ti.static(worlds.program.otter):
        arm = turned_by(arm, boat_motion.boat_heading(worlds, w, b))
    return vec2(boat.gnss_x[w, b], boat.gnss_y[w, b]) + arm


@func
def array_pose(worlds: ti.template(), w, b) -> ArrayPose:
    """Pose of the array of boat b in this step, the same for all AUVs.

    Errors of pitch and roll are new in each step, that of the boat's position is a Gauss–Markov process, for the others
    see `draw_lasting_errors`. Mounting, lever arm, pitch and roll turn with an Otter; the array of a point heads east.
    """
    p = ti.static(worlds.p)
    boat = ti.static(worlds.boat)
    slope = p.tilt * vec2(boat.slope_x[w, b], boat.slope_y[w, b])
    heading = 0.0
    if ti.static(worlds.program.otter):
        heading = boat_motion.boat_heading(worlds, w, b)
        slope = turned_by(slope, -heading)
    angles = usbl.attitude(slope)
    noise = normals(worlds, w, Draw.attitude, b)
    error = p.attitude_error * vec2(noise[0], noise[1])
    error += vec2(boat.mounting_pitch[w, b], boat.mounting_roll[w, b])
    axes = usbl.array_axes(angles)
    if ti.static(worlds.program.otter):
        axes = usbl.turned(axes, heading)
    return ArrayPose(
        boat=b,
        axes=axes,
        measured=usbl.turned(usbl.array_axes(usbl.tilted(angles, error)), heading + boat.turn[w, b]),
        displaced=displacement(worlds, w, b),
        slowness=boat.slowness[w, b],
        effort=boat.effort[w, b],
        heading=heading,
    )


@func
def deviation_at(worlds: ti.template(), k, offset: vec3, noise) -> ti.f32:
    """Standard deviation of a phase difference (rad) at an offset, m; `noise` as of `acoustic_link.phase_deviation`."""
    return acoustic_link.phase_deviation(worlds.link, k, offset.norm(), offset[2], noise)


@func
def covariance_at(worlds: ti.template(), pose: ArrayPose, k, offset: vec3, sigma) -> vec3:
    """Covariance (xx, xy, yy) in m² of a fix's own errors at the offset that the receiver measured.

    `sigma` as of `deviation_at`.
    """
    seen, axes = as_heading_east(worlds, pose, offset)
    return as_it_heads(worlds, pose, usbl.horizontal_covariance(worlds.link, k, seen, axes, sigma))


@func
def common_covariance(worlds: ti.template(), pose: ArrayPose, k, offset: vec3) -> vec3:
    """Covariance (xx, xy, yy) in m² of the errors that the fixes of a boat have in common, at an offset from it, m."""
    seen, axes = as_heading_east(worlds, pose, offset)
    return as_it_heads(worlds, pose, usbl.systematic_covariance(worlds.link, k, seen, axes))


@func
def as_heading_east(worlds: ti.template(), pose: ArrayPose, offset: vec3):
    """An offset and the array's axes turned with the boat until it heads east, as the covariances of `usbl` have it."""
    seen = offset
    axes = pose.axes
    if ti.static(worlds.program.otter):
        flat = turned_by(vec2(offset[0], offset[1]), -pose.heading)
        seen = vec3(flat[0], flat[1], offset[2])
        axes = usbl.turned(axes, -pose.heading)
    return seen, axes


@func
def as_it_heads(worlds: ti.template(), pose: ArrayPose, covariance: vec3) -> vec3:
    """A covariance (xx, xy, yy) turned back from east to the boat's heading."""
    found = covariance
    if ti.static(worlds.program.otter):
        c, s = ti.cos(pose.heading), ti.sin(pose.heading)
        found[0] = c * c * covariance[0] - 2.0 * c * s * covariance[1] + s * s * covariance[2]
        found[1] = c * s * (covariance[0] - covariance[2]) + (c * c - s * s) * covariance[1]
        found[2] = s * s * covariance[0] + 2.0 * c * s * covariance[1] + c * c * covariance[2]
    return found


@func
def heard_from(worlds: ti.template(), link: ti.template(), k, body, path, error, measured: ti.template(), length):
    """Direction x, y, z from which AUV k is heard, the distance measured, m, and the fix's flags.

    For numbers and for vectors of several AUVs.

    Args:
        link: link table, (K, COLUMNS).
        body: the true direction in the array's frame. path: the distance that the sound's delay stands for, m.
        error: standard deviation of a phase difference, rad, and normal numbers as of `usbl.measure`.
        measured: the array's axes as its sensors have them. length: as of `usbl.located`.
    """
    sigma, normal, residual_noise = error
    x, y, residual, distance, amplitude = usbl.measure(link, k, body, path, sigma, normal, residual_noise)
    kappa = link[k, acoustic_link.KAPPA]
    phase = usbl.wrap(x), usbl.wrap(y)
    found = usbl.located(link, k, (kappa * body[0], kappa * body[1]), phase, amplitude, measured, length)
    flags = found[3]
    if ti.static(worlds.program.turns):
        longest = length * kappa
        lacking = select(magnitude(residual) > 0.5 * math.pi, 1.0, 0.0)
        beyond = select(phase[0] * phase[0] + phase[1] * phase[1] > longest * longest, 1.0, 0.0)
        flags += ti.static(float(usbl.AMBIGUOUS)) * (lacking + beyond - lacking * beyond)
    return found[0], found[1], found[2], distance, flags


@func
def fixed_offset(
    worlds: ti.template(), link: ti.template(), k, offset, axes: ti.template(), measured: ti.template(), error
):
    """The offset x, y, z (m) that a fix of AUV k gives where sound goes straight, and the fix's flags.

    For numbers and for vectors of several AUVs.

    Args:
        link: link table, (K, COLUMNS).
        offset: the true one, m. axes, measured: of the array.
        error: slowness of sound as in `ArrayPose`, noise as of `acoustic_link.phase_deviation`, normal numbers and that
            of the residual as of `usbl.measure`.
    """
    slowness, noise, normal, residual_noise = error
    far = usbl.length(offset)
    S = select(far > 1e-3, far, 1e-3)
    # Where sound is slower than supposed, it comes later and less across the array.
    body = usbl.in_frame(axes, (slowness * offset[0] / S, slowness * offset[1] / S, slowness * offset[2] / S))
    sigma = acoustic_link.phase_deviation(link, k, S, offset[2], noise)
    x, y, z, distance, flags = heard_from(
        worlds, link, k, body, slowness * S, (sigma, normal, residual_noise), measured, 1.0
    )
    return distance * x, distance * y, distance * z, flags


@func
def fixed_along_ray(worlds: ti.template(), pose: ArrayPose, w, k, offset: vec3, error):
    """`fixed_offset` where the speed of sound changes with depth: the receiver follows the ray back."""
    slowness, noise, normal, residual_noise = error
    layers = ti.static(worlds.layers)
    link = ti.static(worlds.link)
    c = worlds.p.sound_speed
    depth = -worlds.boat.elevation[w, pose.boat]
    ray = rays.refracted(layers, depth, depth, offset, c)
    body = slowness * (pose.axes @ ray.direction)
    sigma = acoustic_link.phase_deviation(link, k, ti.max(offset.norm(), 1e-3), offset[2], noise)
    length = c / sound_speed(layers, depth)
    x, y, _, distance, flags = heard_from(
        worlds, link, k, body, slowness * ray.slant_range, (sigma, normal, residual_noise), pose.measured, length
    )
    flags = select(ray.exists == 0, ti.static(float(usbl.NO_RAY)), flags)
    found = rays.follow(layers, depth, vec3(x, y, -1.0), distance, c)
    return found[0], found[1], found[2], flags


@func
def make_fix(worlds: ti.template(), pose: ArrayPose, w, k, here: vec2, there: vec2, lost: ti.i32) -> Fix:
    """Fix AUV k, which was `there` when its signal left, from its boat `here`, m; `lost`: no signal comes."""
    auv = ti.static(worlds.auv)
    link = ti.static(worlds.link)
    offset = vec3(there[0] - here[0], there[1] - here[1], true_height(worlds, w, pose.boat, k))
    noise = acoustic_link.noise_ratio(link[k, acoustic_link.OWN_NOISE], pose.effort)
    residual = 0.0
    if ti.static(worlds.program.turns):
        residual = normals(worlds, w, Draw.residual, k)[0]
    error = pose.slowness, noise, normals(worlds, w, Draw.fix, k), residual
    found = vec4(0.0)
    if ti.static(worlds.program.refraction):
        x, y, z, mark = fixed_along_ray(worlds, pose, w, k, offset, error)
        found = vec4(x, y, z, mark)
    else:
        x, y, z, mark = fixed_offset(worlds, link, k, offset, pose.axes, pose.measured, error)
        found = vec4(x, y, z, mark)
    flags = ti.cast(found[3], ti.i32)
    if lost:
        flags = usbl.LOST
    if ti.static(worlds.program.vehicle):
        if flags & usbl.DETECTED:
            read = auv.depth_error[w, k] + worlds.body.sensor_error[w, k]
            worlds.body.told_depth[w, k] = read
    measured = vec3(found[0], found[1], found[2])
    own = covariance_at(worlds, pose, k, measured, deviation_at(worlds, k, measured, noise))
    common = common_covariance(worlds, pose, k, measured)
    place = here + pose.displaced + vec2(found[0], found[1])
    return write_fix(worlds, w, k, pose.boat, there, place, own, common, flags)


@func
def write_fix(
    worlds: ti.template(), w, k, boat, there: vec2, place: vec2, own: vec3, common: vec3, flags: ti.i32
) -> Fix:
    """Write a fix of AUV k by a boat; `own` and `common`: covariances of the errors new in it and common to fixes."""
    auv = ti.static(worlds.auv)
    for c in ti.static(range(2)):
        auv[w, k, AuvColumn.fix_x + c] = place[c]
        auv[w, k, AuvColumn.heard_x + c] = there[c]
    auv.fix_flags[w, k] = ti.cast(flags, ti.f32)
    auv.fix_boat[w, k] = ti.cast(boat, ti.f32)
    for c in ti.static(range(3)):
        auv[w, k, AuvColumn.covariance_xx + c] = own[c] + common[c]
    covariance = own
    if ti.static(worlds.program.fleet):
        # Errors common to a boat's fixes differ from boat to boat.
        covariance += common
    return Fix(place=place, covariance=covariance, flags=flags)


@func
def reply_worth(worlds: ti.template(), w, b, k) -> ti.f32:
    """Variance per axis (m²) by which a reply of AUV k is expected to improve its estimate by boat b: P a²/(a + r).

    P is the probability that it is heard from where the boat takes the AUV to be, a the variance of that place, r the
    variance of the fix.
    """
    estimate = ti.static(worlds.estimate)
    a = 0.5 * (estimate.covariance_xx[w, k] + estimate.covariance_yy[w, k])
    dx = estimate.x[w, k] - worlds.boat.x[w, b]
    dy = estimate.y[w, k] - worlds.boat.y[w, b]
    expected = expected_reply(worlds, k, vec3(dx, dy, height(worlds, w, b, k)), 1.0, a)
    return expected[0] * a * a / (a + expected[1])
