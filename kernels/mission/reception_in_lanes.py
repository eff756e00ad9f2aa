"""Fixes of sixteen AUVs side by side, where many worlds step together: those of `usvauv.kernels.mission.reception`.

Vectors stay in registers. An AUV's fix does not depend on the AUVs beside it, and is the same bit for bit as one alone.
"""

import taichi as ti

from usvauv.kernels.functions import LANE_BITS, LANES, func
from usvauv.kernels.mission.columns import BoatColumn, Draw, ReceptionColumn
from usvauv.kernels.mission.reception import ArrayPose, Fix, array_pose, displacement, fixed_offset, write_fix
from usvauv.kernels.mission.worlds import WORLDS_PER_BLOCK, number_drawn, place_drawn
from usvauv.kernels.positioning import acoustic_link, usbl
from usvauv.kernels.trigonometry import circle
from usvauv.kernels.types import select, vec2, vec3


@func
def boat_of(worlds: ti.template(), w, k):
    """The boat that fixes AUV k."""
    b = 0
    if ti.static(worlds.program.fleet):
        b = ti.cast(worlds.auv.fix_boat[w, k], ti.i32)
    return b


@func
def of_boats(worlds: ti.template(), w: ti.template(), b: ti.template(), c: ti.template()):
    """A vector of column c of boats b of worlds w."""
    return ti.Vector([worlds.boat[w[lane], b[lane], c] for lane in ti.static(range(LANES))])


@func
def numbers_drawn(
    worlds: ti.template(), w: ti.template(), index: ti.template(), draw: ti.template(), count: ti.template()
):
    """The first `count` vectors of a draw's normal numbers."""
    first, each = place_drawn(worlds, draw)
    place = [first + each * index[lane] for lane in ti.static(range(LANES))]
    return [
        ti.Vector([number_drawn(worlds, w[lane], place[lane], part) for lane in ti.static(range(LANES))])
        for part in ti.static(range(count))
    ]


@func
def fix_side_by_side(worlds: ti.template(), n):
    """Fix the AUVs of the worlds of iteration n by the replies that arrive in this step."""
    count = worlds.auv.shape[1]
    many = count * ti.min(WORLDS_PER_BLOCK, worlds.clock.shape[0] - WORLDS_PER_BLOCK * n)
    each = 1.0 / count
    for part in range((many + LANES - 1) // LANES):
        last = many - 1  # fills the lanes up
        place = [ti.min(LANES * part + lane, last) for lane in ti.static(range(LANES))]
        after = [ti.cast((place[lane] + 0.5) * each, ti.i32) for lane in ti.static(range(LANES))]
        w = [WORLDS_PER_BLOCK * n + after[lane] for lane in ti.static(range(LANES))]
        k = [place[lane] - count * after[lane] for lane in ti.static(range(LANES))]
        fix_each(worlds, w, k, WORLDS_PER_BLOCK // LANES * count * n + part, part % worlds.links.shape[0])


@func
def fix_each(worlds: ti.template(), w: ti.template(), k: ti.template(), group, row):
    """Fix AUVs k of worlds w, which are a group of `worlds.reception` and have a row of `worlds.links`."""
    p = ti.static(worlds.p)
    link, reception = ti.static(worlds.links, worlds.reception)
    b = [boat_of(worlds, w[lane], k[lane]) for lane in ti.static(range(LANES))]
    slope_x = p.tilt * of_boats(worlds, w, b, BoatColumn.slope_x)
    slope_y = p.tilt * of_boats(worlds, w, b, BoatColumn.slope_y)
    angles = usbl.attitude((slope_x, slope_y))
    noise = numbers_drawn(worlds, w, b, Draw.attitude, 2)
    pitch = p.attitude_error * noise[0] + of_boats(worlds, w, b, BoatColumn.mounting_pitch)
    roll = p.attitude_error * noise[1] + of_boats(worlds, w, b, BoatColumn.mounting_roll)
    true_axes = usbl.axis_numbers(angles)
    axes = ti.static(usbl.Axes(true_axes))
    level_axes = usbl.axis_numbers(usbl.tilted(angles, (pitch, roll)))
    turned_axes = usbl.turned_numbers(ti.static(usbl.Axes(level_axes)), circle(of_boats(worlds, w, b, BoatColumn.turn)))
    measured = ti.static(usbl.Axes(turned_axes))

    offset = [reception[group, ReceptionColumn.offset_x + c] for c in ti.static(range(3))]
    effort = of_boats(worlds, w, b, BoatColumn.effort)
    own_noise = acoustic_link.noise_ratio(link[row, acoustic_link.OWN_NOISE], effort)
    residual = noise[0]
    if ti.static(worlds.program.turns):
        residual = numbers_drawn(worlds, w, k, Draw.residual, 1)[0]
    slowness = of_boats(worlds, w, b, BoatColumn.slowness)
    error = slowness, own_noise, numbers_drawn(worlds, w, k, Draw.fix, 4), residual
    x, y, z, flags = fixed_offset(worlds, link, row, offset, axes, measured, error)
    found = x, y, z
    sigma = acoustic_link.phase_deviation(link, row, usbl.length(found), z, own_noise)
    own = usbl.fix_covariance(link, row, found, axes, sigma)
    common = usbl.common_covariance(link, row, found, axes)
    lost = reception.lost[group]
    reception.flags[group] = select(lost > 0.5, ti.static(float(usbl.LOST)), flags)
    for c in ti.static(range(3)):
        reception[group, ReceptionColumn.offset_x + c] = found[c]
        reception[group, ReceptionColumn.own_xx + c] = own[c]
        reception[group, ReceptionColumn.common_xx + c] = common[c]
    for c in ti.static(range(4)):
        reception[group, ReceptionColumn.pitch_cosine + c] = angles[c]


@func
def store_reply(worlds: ti.template(), w, k, c: ti.template(), number):
    """Write a number of a reply of AUV k, column c of `ReceptionColumn`."""
    n = w * worlds.auv.shape[1] + k
    worlds.reception[n >> LANE_BITS, c][n & (LANES - 1)] = number


@func
def load_reply(worlds: ti.template(), w, k, c: ti.template()) -> ti.f32:
    """A number of a reply of AUV k, column c of `ReceptionColumn`."""
    n = w * worlds.auv.shape[1] + k
    return worlds.reception[n >> LANE_BITS, c][n & (LANES - 1)]


@func
def read_fix(worlds: ti.template(), w, k, boat, here: vec2) -> Fix:
    """The fix of AUV k by a boat, `here` (m), that `fix_side_by_side` has made, written as others are."""
    first = ti.static(ReceptionColumn.offset_x)
    numbers = [load_reply(worlds, w, k, first + c) for c in ti.static(range(ReceptionColumn.flags + 1 - first))]
    there = vec2(worlds.auv.heard_x[w, k], worlds.auv.heard_y[w, k])
    place = here + displacement(worlds, w, boat) + vec2(numbers[0], numbers[1])
    own, common = vec3(numbers[3], numbers[4], numbers[5]), vec3(numbers[6], numbers[7], numbers[8])
    return write_fix(worlds, w, k, boat, there, place, own, common, ti.cast(numbers[9], ti.i32))


@func
def pose_as_read(worlds: ti.template(), w, b) -> ArrayPose:
    """The pose of boat b's array, of which `finish` needs the true axes: a single boat's are those of all fixes."""
    pose = ArrayPose(boat=b)
    if ti.static(worlds.program.fleet):
        pose = array_pose(worlds, w, b)
    else:
        first = ti.static(ReceptionColumn.pitch_cosine)
        angles = [load_reply(worlds, w, 0, first + c) for c in ti.static(range(4))]
        pose = ArrayPose(boat=b, axes=usbl.array_axes(angles))
    return pose
