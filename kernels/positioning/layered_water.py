"""Water in layers in which the speed of sound is linear in depth: the table of layers, arcs, and rays that turn.

Along a ray Snell's law keeps the horizontal slowness ξ = sin θ/c, θ from the vertical. In a layer of gradient g the
ray is an arc of a circle. Where it crosses a thickness h in which the speed changes by g h = c₂ − c₁, with the
cosines wᵢ = √(1 − ξ²cᵢ²) at its sides,

    r = (w₁ − w₂)/(ξ g) = ξ h (c₁ + c₂)/(w₁ + w₂),
    τ = (artanh w₁ − artanh w₂)/g = h Q artanh(q)/q,
    q = (c₂ − c₁) Q,   Q = (c₁ + c₂)(1 + w₁w₂)/((w₁ + w₂)(c₁² + w₁²c₂²)).

The forms on the right do not cancel for g → 0 or near the vertical: all terms are positive. An arc that turns where
c = 1/ξ and comes back to the depth at which it began has r = 2 w₁/(ξ|g|) and τ = 2 artanh(w₁)/|g|.

Depths are positive downwards from the mean surface, negative on a wave's crest; speeds above the first and below the
last depth of a table are those at its ends. Speeds are kept as the excess over a constant: near a turning point
cosines follow from small differences of speed, which single precision then has to 2 µm/s and not to 0.1 mm/s.

Rays with one turning point, below or above both ends, and the last direct rays before the horizontal one. With the
speed c_t = 1/ξ at the turning point and A(c) = √(c_t² − c²) = c_t cos θ, each end of the ray contributes

    ρ = A_b/|g| + Σ h (c₁ + c₂)/(A₁ + A₂)

to its range: half of the turning arc in its layer, of gradient g, that begins at the depth b, and the layers crossed
between b and the end. c_t exceeds the fastest speed M on the way to b by x², x being the unknown: in all
A² = (M − c + x²)(c_t + c) only positive numbers are added, and the range is smooth in x up to x = 0.

The first term grows with x, the sum falls, so their sum need not be monotone. Between x₁ and x₂, however, it lies
between arc(x₁) + Σ(x₂) and arc(x₂) + Σ(x₁). Intervals that cannot hold the range are skipped, others are halved (in
log x) until the range is bracketed in one of ratio WIDE, or until one of ratio FINE brackets nothing: such an
interval can hold only a pair of rays of nearly the same path, whose range is within about 10⁻⁴ of a caustic's.

A direct ray that is horizontal to within 1e-5 where it is fastest is found in the same way, without an arc.

Source: Jensen, Kuperman, Porter, Schmidt, "Computational Ocean Acoustics" (2011), §3.3.
"""
# pyright: reportAttributeAccessIssue=false
# (the members of Taichi's structs exist only while a kernel is compiled)

import numpy as np
import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.types import vec2

# Columns of the table of layers, one row a depth; a layer extends from its row to the next.
DEPTH = 0  # m
EXCESS = 1  # speed minus REFERENCE, m/s
GRADIENT = 2  # of the layer below, 1/s

REFERENCE = 1500.0  # m/s
BEYOND = 2e4  # m, thickness of the end layers of constant speed

DIRECT, BELOW, ABOVE = 0, 1, 2  # where a ray turns
NEVER = 1e30  # s
FLAT = 6e-4  # x at the end of the direct rays that are searched, √(m/s)
SMALL = (
    3e-3  # x below which a range is as good as linear: no two speeds of a table differ by less than x² but by rounding
)
WIDE = 1.2  # ratio of the ends of an interval in which a root is sought
FINE = 1.01  # ratio of the ends of an interval that is given up
ROUNDS = 1000  # at most, of the search in one layer
STEPS = 60  # at most, towards a root
ROUNDING = 1e-6  # of a range, relative


def layer_table(depth: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Table of layers (N + 2, 3), float32, from increasing depths (N,), m, and the speeds (N,) there, m/s."""
    z = np.concatenate([[depth[0] - BEYOND], depth, [depth[-1] + BEYOND]])
    c = np.concatenate([speed[:1], speed, speed[-1:]]).astype(float)
    gradient = np.append(np.diff(c) / np.diff(z), 0.0)
    return np.stack([z, c - REFERENCE, gradient], axis=1).astype(np.float32)


@ti.dataclass
class Ray:
    """The first arrival between two depths. Cosines are of the ray from the shallower end to the deeper, down positive.

    A ray that turns below both ends arrives at the deeper one upwards: `lower_cosine` is negative. One that turns above
    both leaves the shallower one upwards: `upper_cosine` is negative.
    """

    slowness: ti.f32  # ξ, s/m
    upper_cosine: ti.f32  # cos θ at the shallower end
    lower_cosine: ti.f32  # and at the deeper
    time: ti.f32  # τ, s
    exists: ti.i32  # 0: no ray, the other numbers are undefined


@func
def layer_at(layers: ti.template(), depth: ti.f32) -> ti.i32:
    """Row of the layer in which a depth (m) lies."""
    row = 0
    for i in range(1, layers.shape[0] - 1):
        if layers[i, DEPTH] <= depth:
            row = i
    return row


@func
def excess_in_layer(layers: ti.template(), i: ti.i32, depth: ti.f32) -> ti.f32:
    """Speed of sound minus REFERENCE (m/s) at a depth (m) in the layer i, at its lower side exactly the next row's."""
    e = layers[i, EXCESS] + layers[i, GRADIENT] * (depth - layers[i, DEPTH])
    if depth >= layers[i + 1, DEPTH]:
        e = layers[i + 1, EXCESS]
    return e


@func
def sound_speed(layers: ti.template(), depth: ti.f32) -> ti.f32:
    """Speed of sound (m/s) at a depth (m)."""
    return REFERENCE + excess_in_layer(layers, layer_at(layers, depth), depth)


@func
def artanh_ratio(q: ti.f32) -> ti.f32:
    """artanh(q)/q for |q| < 1."""
    x = q * q
    ratio = 1.0 + x * (1.0 / 3.0 + x * (0.2 + x * (1.0 / 7.0 + x / 9.0)))
    if x > 0.04:
        ratio = 0.5 * ti.log((1.0 + q) / (1.0 - q)) / q
    return ratio


@func
def layer_time(h: ti.f32, e1: ti.f32, e2: ti.f32, w1: ti.f32, w2: ti.f32) -> ti.f32:
    """Travel time τ (s) through a layer of thickness h (m) with the excess speeds and cosines at its sides."""
    c1 = REFERENCE + e1
    c2 = REFERENCE + e2
    Q = (c1 + c2) * (1.0 + w1 * w2) / ((w1 + w2) * (c1 * c1 + w1 * w1 * c2 * c2))
    return h * Q * artanh_ratio((e2 - e1) * Q)


@func
def along_arc(g: ti.f32, c: ti.f32, s: ti.f32, w: ti.f32, time: ti.f32) -> vec2:
    """Horizontal range and depth (m) gained in a time (s) inside a layer of gradient g, from speed c, sin θ, cos θ.

    tan(θ/2) grows as exp(g τ), which gives both without cancellation, through a turning point as well.
    """
    x = g * time
    growth = 1.0 + x * (0.5 + x * (1.0 / 6.0 + x * (1.0 / 24.0 + x * (1.0 / 120.0 + x / 720.0))))  # (exp x − 1)/x
    if ti.abs(x) > 0.2:
        growth = (ti.exp(x) - 1.0) / x
    E = 1.0 + x * growth
    T = s / (1.0 + w)
    reach = c * time * growth / (1.0 + T * T * E * E)
    return vec2(reach * T * (1.0 + E), reach * (1.0 - T * T * E))


@ti.dataclass
class Turn:
    """A family of rays of which x tells one from another."""

    shallow: ti.f32  # depths of the ends, m
    deep: ti.f32
    base: ti.f32  # depth at which the turning arc begins, m
    base_excess: ti.f32  # and the speed there minus REFERENCE, m/s
    radius: ti.f32  # 1/|g| in the layer of the arc, s; 0 without an arc
    record: ti.f32  # the fastest speed up to there minus REFERENCE, M, m/s


@func
def cosine_part(e: ti.f32, turn: Turn, xx: ti.f32) -> ti.f32:
    """A (m/s) where the speed is REFERENCE + e, for x² = xx."""
    return ti.sqrt((ti.max(turn.record - e, 0.0) + xx) * (2.0 * REFERENCE + turn.record + xx + e))


@func
def through_layers(layers: ti.template(), turn: Turn, xx: ti.f32, factor: ti.f32, arc: ti.f32, timed: ti.template()):
    """`arc` and what the layers that both legs cross add to it: of the time (s), or else of the range (m), for x² = xx.

    `factor` on A is ξ for the time and 1 for the range.
    """
    total = arc
    for leg in range(2):
        end = turn.shallow
        if leg == 1:
            end = turn.deep
        z = ti.min(end, turn.base)
        bottom = ti.max(end, turn.base)
        i = layer_at(layers, z)
        e1 = excess_in_layer(layers, i, z)
        w1 = factor * cosine_part(e1, turn, xx)
        while z < bottom:
            below = ti.min(layers[i + 1, DEPTH], bottom)
            e2 = excess_in_layer(layers, i, below)
            w2 = factor * cosine_part(e2, turn, xx)
            if ti.static(timed):
                total += layer_time(below - z, e1, e2, w1, w2)
            else:
                total += (below - z) * (2.0 * REFERENCE + e1 + e2) / ti.max(w1 + w2, 1e-9)
            z = below
            e1 = e2
            w1 = w2
            i += 1
    return total


@func
def ranges(layers: ti.template(), turn: Turn, x: ti.f32) -> vec2:
    """The two parts of the range (m): that of the turning arc, which grows with x, and that of layers crossed."""
    xx = x * x
    crossed = through_layers(layers, turn, xx, 1.0, 0.0, False)
    return vec2(2.0 * turn.radius * cosine_part(turn.base_excess, turn, xx), crossed)


@func
def travel_time(layers: ti.template(), turn: Turn, x: ti.f32) -> ti.f32:
    """Travel time (s) along the ray x > 0."""
    xx = x * x
    xi = 1.0 / (REFERENCE + turn.record + xx)
    w = xi * cosine_part(turn.base_excess, turn, xx)
    return through_layers(layers, turn, xx, xi, 2.0 * turn.radius * w * artanh_ratio(w), True)


@func
def bracketed(layers: ti.template(), turn: Turn, R: ti.f32, ends: vec2, misses: vec2) -> vec2:
    """x between two ends at which the range misses R (m) to either side, and by how much its own range misses it.

    False position (Illinois), and a halving every third step for ranges that grow without bound at one end.
    """
    a, b = ends[0], ends[1]
    fa, fb = misses[0], misses[1]
    x, f = a, fa
    if ti.abs(fb) < ti.abs(fa):
        x, f = b, fb
    last = 0
    steps = 0
    while (fa < 0.0) != (fb < 0.0) and ti.abs(f) > 3e-7 * R and b - a > 1e-7 * b and steps < STEPS:
        x = 0.5 * (a + b)
        if steps % 3 != 2:
            x = a + (b - a) * fa / (fa - fb)
        f = ranges(layers, turn, x).sum() - R
        if (f < 0.0) == (fa < 0.0):
            a, fa = x, f
            if last < 0:
                fb *= 0.5
            last = -1
        else:
            b, fb = x, f
            if last > 0:
                fa *= 0.5
            last = 1
        steps += 1
    return vec2(x, f)


@func
def first_in_layer(layers: ti.template(), turn: Turn, R: ti.f32, farthest: ti.f32) -> vec2:
    """x and travel time (s) of the first arrival at the range R (m) with x up to `farthest`; NEVER if there is none."""
    first = vec2(0.0, NEVER)
    slack = ROUNDING * R
    near = 0.0
    far = farthest
    at_near = ranges(layers, turn, near)
    at_far = ranges(layers, turn, far)
    rounds = 0
    while near < farthest and rounds < ROUNDS:
        rounds += 1
        miss = vec2(at_near.sum() - R, at_far.sum() - R)
        possible = at_near[0] + at_far[1] <= R + slack and at_far[0] + at_near[1] >= R - slack
        sought = miss.min() <= slack and miss.max() >= -slack
        ratio = far / ti.max(near, SMALL)
        if possible and ratio > (WIDE if sought else FINE):
            far = ti.sqrt(ti.max(near, SMALL) * far)
            at_far = ranges(layers, turn, far)
        else:
            if possible and sought:
                root = bracketed(layers, turn, R, vec2(near, far), miss)
                x = ti.max(root[0], 1e-9)
                time = travel_time(layers, turn, x) - root[1] / (REFERENCE + turn.record + x * x)
                if time < first[1]:
                    first = vec2(x, time)
            near = far
            at_near = at_far
            far = ti.min(ratio * ratio * far, farthest)
            at_far = ranges(layers, turn, far)
    return first


@func
def turning_ray(
    layers: ti.template(), shallow: ti.f32, deep: ti.f32, R: ti.f32, surface: ti.f32, fastest: ti.f32
) -> Ray:
    """The ray between two depths (m), the deeper one second, at a range R (m) that no steeper direct ray reaches.

    A direct ray comes first, then that of least travel time of those with one turning point: above both ends, but not
    above the depth `surface` (m), or below both; below the last depth of the table none turns.

    Args:
        fastest: speed between the ends, minus REFERENCE, m/s.
    """
    first = layer_at(layers, shallow)
    last = layer_at(layers, deep)
    best = Ray(slowness=0.0, upper_cosine=1.0, lower_cosine=1.0, time=NEVER, exists=0)
    direct = False
    for way in range(3):
        record = fastest
        i = last
        end = layers.shape[0] - 2
        step = 1
        if way == DIRECT:
            end = last + 1
        if way == ABOVE:
            i = first
            end = 0
            step = -1
        while i * step < end * step and not direct:
            base = deep
            limit = fastest
            radius = 0.0
            if way == BELOW:
                base = ti.max(layers[i, DEPTH], deep)
                limit = layers[i + 1, EXCESS]
            if way == ABOVE:
                base = ti.min(layers[i + 1, DEPTH], shallow)
                limit = excess_in_layer(layers, i, ti.min(ti.max(layers[i, DEPTH], surface), base))
            at_base = excess_in_layer(layers, i, base)
            record = ti.max(record, at_base)
            farthest = FLAT
            if way != DIRECT:
                farthest = ti.sqrt(ti.max(limit - record, 0.0))
                radius = 1.0 / ti.max(ti.abs(layers[i, GRADIENT]), 1e-9)
            if farthest > 0.0:
                turn = Turn(shallow=shallow, deep=deep, base=base, base_excess=at_base, radius=radius, record=record)
                found = first_in_layer(layers, turn, R, farthest)
                if found[1] < best.time:
                    xx = found[0] * found[0]
                    best.time = found[1]
                    best.exists = 1
                    best.slowness = 1.0 / (REFERENCE + record + xx)
                    upper = excess_in_layer(layers, first, shallow)
                    lower = excess_in_layer(layers, last, deep)
                    best.upper_cosine = best.slowness * cosine_part(upper, turn, xx)
                    best.lower_cosine = best.slowness * cosine_part(lower, turn, xx)
                    if way == BELOW:
                        best.lower_cosine *= -1.0
                    if way == ABOVE:
                        best.upper_cosine *= -1.0
                    direct = way == DIRECT
            record = ti.max(record, limit)
            i += step
    return best
