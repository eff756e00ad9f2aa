"""From a start uphill: damped Newton steps of the boat's place inside a region.

The region is the area cut by a disc round a place in it. A step ends at the disc's rim; from there it goes along the
rim, and along a border of the area where that holds it. Near the top the values of neighbouring places differ by less
than single precision can tell, so there the Newton step is taken at its word.
"""

import taichi as ti

from kernels.planning.objectives import log_objective

MAX_EVALUATIONS = 60
ROUNDING = 4e-7  # of ln of an objective, relative to 1 + its size
SMALL_GAIN = 1e-6  # below it a Newton step needs no proof
LEAST_DAMPING = 1e-6

vec2 = ti.types.vector(2, ti.f32)
vec3 = ti.types.vector(3, ti.f32)
vec6 = ti.types.vector(6, ti.f32)

Region = ti.types.struct(
    width=ti.f32,  # the box [0, width] × [0, length], m
    length=ti.f32,
    x=ti.f32,  # a place in it, m
    y=ti.f32,
    reach=ti.f32,  # greatest distance from that place, m
)


@ti.func
def clamp(x, y, region: Region) -> vec2:
    """The place in the box nearest to (x, y)."""
    return vec2(ti.min(ti.max(x, 0.0), region.width), ti.min(ti.max(y, 0.0), region.length))


@ti.func
def clip(x, y, region: Region) -> vec2:
    """A place in the region near (x, y)."""
    place = clamp(x, y, region)
    centre = vec2(region.x, region.y)
    way = place - centre
    if way.norm_sqr() > region.reach * region.reach:
        place = centre + way * (region.reach / way.norm())
    return place


@ti.func
def newton_step(f: vec6, x, y, region: Region) -> vec2:
    """A Newton step uphill, the Hessian shifted where it is not negative definite; out of the box it may lead."""
    g_x = f[1]
    g_y = f[2]
    h_xx = f[3]
    h_xy = f[4]
    h_yy = f[5]
    # A coordinate held by the border takes no part in the step.
    if (x <= 0.0 and g_x < 0.0) or (x >= region.width and g_x > 0.0):
        g_x = 0.0
        h_xy = 0.0
        h_xx = h_yy
    if (y <= 0.0 and g_y < 0.0) or (y >= region.length and g_y > 0.0):
        g_y = 0.0
        h_xy = 0.0
        h_yy = h_xx
    mean = 0.5 * (h_xx + h_yy)
    spread = ti.sqrt(0.25 * (h_xx - h_yy) * (h_xx - h_yy) + h_xy * h_xy)
    curvature = ti.abs(mean) + spread
    top = mean + spread
    shift = 1e-12
    if top > -1e-4 * curvature:
        shift += top + ti.max(ti.abs(top), 1e-4 * curvature)
    h_xx -= shift
    h_yy -= shift
    return vec2(h_xy * g_y - h_yy * g_x, h_xy * g_x - h_xx * g_y) / (h_xx * h_yy - h_xy * h_xy)


@ti.func
def along_circle(f: vec6, x, y, outward: vec2, region: Region) -> vec2:
    """A Newton step uphill along the circle that bounds the reach; none where it would leave the box."""
    slope = f[2] * outward[0] - f[1] * outward[1]
    tangent = vec2(-outward[1], outward[0])
    if slope < 0.0:
        slope = -slope
        tangent = -tangent
    step = vec2(0.0, 0.0)
    to_side = (x <= 0.0 and tangent[0] < 0.0) or (x >= region.width and tangent[0] > 0.0)
    to_end = (y <= 0.0 and tangent[1] < 0.0) or (y >= region.length and tangent[1] > 0.0)
    if not (to_side or to_end):
        bend = (
            f[3] * tangent[0] * tangent[0]
            + 2.0 * f[4] * tangent[0] * tangent[1]
            + f[5] * tangent[1] * tangent[1]
            - (f[1] * outward[0] + f[2] * outward[1]) / region.reach
        )
        step = tangent * ti.min(slope / ti.max(ti.abs(bend), 1e-12), region.reach)
    return step


@ti.func
def next_place(f: vec6, x, y, damping, longest, region: Region, limited: ti.template()) -> vec3:
    """Where a damped step from a place in the region leads inside it, and the gain by the slope."""
    place = vec2(x, y)
    step = damping * newton_step(f, x, y, region)
    length = step.norm()
    if length > longest:
        step *= longest / length
    target = place + step
    along = False
    if ti.static(limited):
        centre = vec2(region.x, region.y)
        radius = place - centre
        distance = radius.norm()
        if (target - centre).norm_sqr() > region.reach * region.reach:
            outward = radius / ti.max(distance, 1e-20)
            along = distance > 0.9999 * region.reach and step.dot(outward) >= 0.0
            if along:
                step = damping * along_circle(f, x, y, outward, region)
                radius += step
                target = centre + radius * (region.reach / ti.max(radius.norm(), 1e-20))
            else:  # as far as the circle
                a = step.norm_sqr()
                b = radius.dot(step)
                c = ti.min(distance * distance - region.reach * region.reach, 0.0)
                target = place + step * ((ti.sqrt(b * b - a * c) - b) / a)
    target = clamp(target[0], target[1], region)
    if not along:
        step = target - place
    # Along the circle the slope is that of the arc, whose bend the step has reckoned with.
    return vec3(target[0], target[1], f[1] * step[0] + f[2] * step[1])


@ti.func
def climb(
    estimate: ti.template(),
    w,
    num_auvs,
    link: ti.template(),
    form: ti.template(),
    log_scale,
    sharpness,
    bias: ti.template(),
    start: vec2,
    best: vec3,
    near,
    longest,
    region: Region,
    limited: ti.template(),
) -> vec3:
    """The local maximum uphill of a start in the region, (x, y, `log_objective`).

    `limited` tells whether the region is smaller than the box. No step is longer than `longest` (m). A climb whose next
    step leads up to within the distance √near (m) of `best`, a maximum found earlier, ends there as that maximum.
    """
    x = start[0]
    y = start[1]
    x_new = x
    y_new = y
    f = vec6(-1e30, 0.0, 0.0, 0.0, 0.0, 0.0)
    damping = 1.0
    evaluations = 0
    climbing = True
    while climbing:
        f_new = log_objective(estimate, w, num_auvs, link, form, log_scale, sharpness, bias, x_new, y_new)
        evaluations += 1
        if f_new[0] > f[0] - ROUNDING * (1.0 + ti.abs(f[0])):
            x = x_new
            y = y_new
            f = f_new
            damping = ti.min(2.0 * damping, 1.0)
        else:
            damping *= 0.3
        there = next_place(f, x, y, damping, longest, region, limited)
        x_new = there[0]
        y_new = there[1]
        climbing = damping > LEAST_DAMPING and evaluations < MAX_EVALUATIONS
        if there[2] <= SMALL_GAIN * damping:
            climbing = False
            if there[2] > 0.0:
                x = x_new
                y = y_new
                f[0] += 0.5 * there[2]
        elif f[0] <= best[2] and (vec2(x_new, y_new) - vec2(best[0], best[1])).norm_sqr() < near:
            climbing = False
            x = best[0]
            y = best[1]
            f[0] = best[2]
    return vec3(x, y, f[0])
