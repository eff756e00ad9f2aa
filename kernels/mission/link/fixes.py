"""Fixes: the pose of a boat's array, and the position that it measures by a signal that arrives.

Errors of pitch and roll are new in each step, that of the boat's position is a Gauss–Markov process, those of mounting,
heading, lever arm and speed of sound last for an episode. Mounting, lever arm, pitch and roll turn with an Otter; the
array of a point heads east.

Functions on blocks are for numbers and for vectors of several AUVs, see `usvauv.kernels.mission.blocks`.
"""

import math

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.mission.blocks import for_auvs, normal_numbers, put, take, together
from usvauv.kernels.mission.boats import boat_motion
from usvauv.kernels.mission.columns import BoatColumn, Draw, ReceptionColumn
from usvauv.kernels.mission.draws import normals
from usvauv.kernels.positioning import acoustic_link, rays, usbl
from usvauv.kernels.positioning.layered_water import sound_speed
from usvauv.kernels.positioning.sonar import magnitude
from usvauv.kernels.transcendental import circle
from usvauv.kernels.types import select, vec2, vec3


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
        c, s = circle(boat_motion.boat_heading(worlds, w, b))
        arm = vec2(c * arm[0] - s * arm[1], s * arm[0] + c * arm[1])
    return vec2(boat.gnss_x[w, b], boat.gnss_y[w, b]) + arm


@func
def heading_of(worlds: ti.template(), w: ti.template(), b: ti.template()):
    """Headings of boats b, rad anticlockwise from east."""
    if ti.static(worlds.program.otter):
        return together([boat_motion.boat_heading(worlds, w[n], b[n]) for n in ti.static(range(len(w)))])
    else:  # noqa: RET505 - Taichi reads one of both
        return 0.0


@func
def as_seen(worlds: ti.template(), offset, heading):
    """An offset (m) in the axes of its boat: ahead, to the left and up."""
    if ti.static(worlds.program.otter):
        c, s = circle(heading)
        return c * offset[0] + s * offset[1], c * offset[1] - s * offset[0], offset[2]
    else:  # noqa: RET505
        return offset


@func
def as_it_heads(worlds: ti.template(), covariance, heading):
    """A covariance xx, xy, yy in the axes of a boat in those of the world."""
    if ti.static(worlds.program.otter):
        c, s = circle(heading)
        xx, xy, yy = covariance
        return (
            c * c * xx - 2.0 * c * s * xy + s * s * yy,
            c * s * (xx - yy) + (c * c - s * s) * xy,
            s * s * xx + 2.0 * c * s * xy + c * c * yy,
        )
    else:  # noqa: RET505
        return covariance


@func
def turned_with_boat(worlds: ti.template(), level: ti.template(), heading):
    """Numbers of the axes of an array on a boat that heads there, see `usbl.Axes`."""
    if ti.static(worlds.program.otter):
        return usbl.turned_numbers(level, circle(heading))
    else:  # noqa: RET505
        return level


@func
def tilt_of(worlds: ti.template(), w: ti.template(), b: ti.template(), heading):
    """Cosine and sine of pitch and of roll of the arrays of boats b on their waves, see `usbl.attitude`."""
    p = ti.static(worlds.p)
    slope = p.tilt * take(worlds.boat, w, b, BoatColumn.slope_x), p.tilt * take(worlds.boat, w, b, BoatColumn.slope_y)
    seen = as_seen(worlds, (slope[0], slope[1], 0.0), heading)
    return usbl.attitude((seen[0], seen[1]))


@func
def common_errors(worlds: ti.template(), link: ti.template(), row, offset, level: ti.template(), heading):
    """Covariance xx, xy, yy in m² of the errors that the fixes of a boat have in common, at an offset from it, m.

    `level` are the axes of its array as if it headed east.
    """
    seen = as_seen(worlds, offset, heading)
    return as_it_heads(worlds, usbl.common_covariance(link, row, seen, level), heading)


@func
def heard_from(worlds: ti.template(), link: ti.template(), row, body, path, error, measured: ti.template(), length):
    """Direction x, y, z from which an AUV is heard, the distance measured, m, and the fix's flags.

    Args:
        link, row: link table and the AUV's row.
        body: the true direction in the array's frame. path: the distance that the sound's delay stands for, m.
        error: standard deviation of a phase difference, rad, and normal numbers as of `usbl.measure`.
        measured: the array's axes as its sensors have them. length: as of `usbl.located`.
    """
    sigma, normal, residual_noise = error
    x, y, residual, distance, amplitude = usbl.measure(link, row, body, path, sigma, normal, residual_noise)
    kappa = link[row, acoustic_link.KAPPA]
    phase = usbl.wrap(x), usbl.wrap(y)
    found = usbl.located(link, row, (kappa * body[0], kappa * body[1]), phase, amplitude, measured, length)
    flags = found[3]
    if ti.static(worlds.program.turns):
        longest = length * kappa
        lacking = select(magnitude(residual) > 0.5 * math.pi, 1.0, 0.0)
        beyond = select(phase[0] * phase[0] + phase[1] * phase[1] > longest * longest, 1.0, 0.0)
        flags += ti.static(float(usbl.AMBIGUOUS)) * (lacking + beyond - lacking * beyond)
    return found[0], found[1], found[2], distance, flags


@func
def along_a_line(
    worlds: ti.template(), link: ti.template(), row, offset, axes: ti.template(), measured: ti.template(), error
):
    """The offset x, y, z (m) that a fix gives where sound goes straight, and the fix's flags.

    Args:
        link, row: link table and the AUV's row.
        offset: the true one, m. axes, measured: of the array, true and as its sensors have them.
        error: slowness of sound over that which fixes are computed with, noise as of `acoustic_link.phase_deviation`,
            normal numbers and that of the residual as of `usbl.measure`.
    """
    slowness, noise, normal, residual_noise = error
    far = usbl.length(offset)
    S = select(far > 1e-3, far, 1e-3)
    # Where sound is slower than supposed, it comes later and less across the array.
    body = usbl.in_frame(axes, (slowness * offset[0] / S, slowness * offset[1] / S, slowness * offset[2] / S))
    sigma = acoustic_link.phase_deviation(link, row, S, offset[2], noise)
    x, y, z, distance, flags = heard_from(
        worlds, link, row, body, slowness * S, (sigma, normal, residual_noise), measured, 1.0
    )
    return distance * x, distance * y, distance * z, flags


@func
def along_a_ray(
    worlds: ti.template(), link: ti.template(), row, offset, depth, axes: ti.template(), measured: ti.template(), error
):
    """`along_a_line` where the speed of sound changes with depth: the receiver, at `depth`, m, follows the ray."""
    slowness, noise, normal, residual_noise = error
    layers = ti.static(worlds.layers)
    c = worlds.p.sound_speed
    way = vec3(offset[0], offset[1], offset[2])
    ray = rays.refracted(layers, depth, depth, way, c)
    along = usbl.in_frame(axes, ray.direction)
    body = slowness * along[0], slowness * along[1], slowness * along[2]
    sigma = acoustic_link.phase_deviation(link, row, ti.max(way.norm(), 1e-3), way[2], noise)
    length = c / sound_speed(layers, depth)
    x, y, _, distance, flags = heard_from(
        worlds, link, row, body, slowness * ray.slant_range, (sigma, normal, residual_noise), measured, length
    )
    flags = select(ray.exists == 0, ti.static(float(usbl.NO_RAY)), flags)
    found = rays.follow(layers, depth, vec3(x, y, -1.0), distance, c)
    return found[0], found[1], found[2], flags


@func
def fixed_offset(
    worlds: ti.template(), link: ti.template(), row, offset, depth, axes: ti.template(), measured: ti.template(), error
):
    """The offset x, y, z (m) that a fix gives, and its flags; arguments as of `along_a_line` and `along_a_ray`."""
    if ti.static(worlds.program.refraction):
        return along_a_ray(worlds, link, row, offset, depth, axes, measured, error)
    else:  # noqa: RET505 - Taichi reads one of both
        return along_a_line(worlds, link, row, offset, axes, measured, error)


@func
def boat_of(worlds: ti.template(), w, k):
    """The boat that fixes AUV k."""
    b = 0
    if ti.static(worlds.program.fleet):
        b = ti.cast(worlds.auv.fix_boat[w, k], ti.i32)
    return b


@func
def fix_auvs(worlds: ti.template(), w: ti.template(), k: ti.template(), count, link: ti.template(), row):
    """Fix the first `count` AUVs k of worlds w by the signals that have arrived; for the others it means nothing."""
    p = ti.static(worlds.p)
    boat = ti.static(worlds.boat)
    b = [boat_of(worlds, w[n], k[n]) for n in ti.static(range(len(w)))]
    heading = heading_of(worlds, w, b)
    tilt = tilt_of(worlds, w, b, heading)
    noise = normal_numbers(worlds, w, b, Draw.attitude, 2)
    pitch = p.attitude_error * noise[0] + take(boat, w, b, BoatColumn.mounting_pitch)
    roll = p.attitude_error * noise[1] + take(boat, w, b, BoatColumn.mounting_roll)
    level_numbers = usbl.axis_numbers(tilt)
    level = ti.static(usbl.Axes(level_numbers))
    as_measured = usbl.axis_numbers(usbl.tilted(tilt, (pitch, roll)))
    axes_numbers = turned_with_boat(worlds, level, heading)
    axes = ti.static(usbl.Axes(axes_numbers))
    turn = heading + take(boat, w, b, BoatColumn.turn)
    measured_numbers = usbl.turned_numbers(ti.static(usbl.Axes(as_measured)), circle(turn))
    measured = ti.static(usbl.Axes(measured_numbers))

    offset = [take(worlds.reception, w, k, ReceptionColumn.x + c) for c in ti.static(range(3))]
    loudness = acoustic_link.noise_ratio(link[row, acoustic_link.OWN_NOISE], take(boat, w, b, BoatColumn.effort))
    if ti.static(worlds.program.messages):
        loudness += take(worlds.reception, w, k, ReceptionColumn.interference)
    residual = noise[0]
    if ti.static(worlds.program.turns):
        residual = normal_numbers(worlds, w, k, Draw.residual, 1)[0]
    slowness = take(boat, w, b, BoatColumn.slowness)
    error = slowness, loudness, normal_numbers(worlds, w, k, Draw.fix, 4), residual
    depth = 0.0 - take(boat, w, b, BoatColumn.elevation)
    x, y, z, flags = fixed_offset(worlds, link, row, offset, depth, axes, measured, error)
    found = x, y, z
    sigma = acoustic_link.phase_deviation(link, row, usbl.length(found), z, loudness)
    seen = as_seen(worlds, found, heading)
    own = as_it_heads(worlds, usbl.fix_covariance(link, row, seen, level, sigma), heading)
    common = common_errors(worlds, link, row, found, level, heading)
    lost = take(worlds.reception, w, k, ReceptionColumn.lost)
    flags = select(lost != 0.0, ti.static(float(usbl.LOST)), flags)
    fixed = (x, y, own[0], own[1], own[2], common[0], common[1], common[2], flags)
    put(worlds.reception, w, k, count, ReceptionColumn.measured_x, fixed)


@func
def fix(worlds: ti.template(), n):
    """Fix the AUVs of the worlds of iteration n."""
    for_auvs(worlds, fix_auvs, n)
