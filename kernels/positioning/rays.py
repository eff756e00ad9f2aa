"""Sound rays between an array and a source, through layers in which the speed of sound is linear in depth.

Direct ray between two depths at the horizontal range R. With t = tan θ at the fastest depth between them, of speed c_m,
every cosine is w = A/√(1 + t²), A = √(1 + k t²), k = 1 − c²/c_m² ≥ 0, and

    r(t) = t Σ h (c₁ + c₂)/(c_m (A₁ + A₂)),   dr/dt = Σ h (c₁ + c₂)/(c_m A₁ A₂ (A₁ + A₂)).

r(t) increases and is concave, so Newton's method from any point left of the root converges to it without overshoot.
t = R/(vertical distance), the straight line's, is left of the root. Beyond the range of the ray that is horizontal at
the fastest depth `layered_water.turning_ray` looks for a ray that turns.

Source: Fang and Chen, "A fast and robust two-point ray tracing method in layered media with constant or linearly
varying layer velocity", Geophysical Prospecting 67 (2019), for t as the unknown.
"""
# pyright: reportAttributeAccessIssue=false
# (the members of Taichi's structs exist only while a kernel is compiled)

import taichi as ti
import torch

from usvauv.kernels.functions import func, kernel
from usvauv.kernels.positioning.layered_water import (
    DEPTH,
    EXCESS,
    GRADIENT,
    REFERENCE,
    Ray,
    along_arc,
    artanh_ratio,
    excess_in_layer,
    layer_at,
    layer_time,
    sound_speed,
    turning_ray,
)
from usvauv.kernels.types import array1, array2, vec2, vec3

FLATTEST = 1e5  # tan θ at which a ray counts as horizontal
ROUNDS = 60  # at most, of Newton's method; 2 or 3 are usual, near the last direct ray t grows by half in each
LEAST = 1e-12  # cos² θ where a ray that is followed is horizontal
ARCS = 4  # at most, that a ray is followed through, times the number of depths


@ti.dataclass
class Arrival:
    """The first arrival at an array, scaled so that a straight ray at the reference speed c gives the geometry."""

    direction: vec3  # c times the slowness vector, towards the source along the ray; its length is c/c(array)
    slant_range: ti.f32  # c τ, m
    exists: ti.i32  # 0: no ray; then direction and range are those of the straight line


@func
def stretch(e: ti.f32, fastest: ti.f32, u: ti.f32) -> ti.f32:
    """A = √(1 + k t²), the ratio of cos θ at the speed c to that at the fastest depth.

    Speeds are minus REFERENCE; u = t/c_m.
    """
    return ti.sqrt(1.0 + (fastest - e) * (2.0 * REFERENCE + fastest + e) * u * u)


@func
def range_and_slope(
    layers: ti.template(), first: ti.i32, last: ti.i32, shallow: ti.f32, deep: ti.f32, fastest: ti.f32, u: ti.f32
) -> vec2:
    """Horizontal range r (m) of the ray with t = u c_m at the fastest depth, and dr/dt (m).

    The depths lie in the layers first and last.
    """
    reached = 0.0
    slope = 0.0
    z = shallow
    e1 = excess_in_layer(layers, first, shallow)
    A1 = stretch(e1, fastest, u)
    for i in range(first, last + 1):
        below = ti.min(layers[i + 1, DEPTH], deep)
        e2 = excess_in_layer(layers, i, below)
        A2 = stretch(e2, fastest, u)
        part = (below - z) * (2.0 * REFERENCE + e1 + e2) / (A1 + A2)
        reached += part
        slope += part / (A1 * A2)
        z = below
        e1 = e2
        A1 = A2
    return vec2(reached * u, slope / (REFERENCE + fastest))


@func
def eigenray(layers: ti.template(), shallow: ti.f32, deep: ti.f32, R: ti.f32, surface: ti.f32) -> Ray:
    """The ray between two depths (m), the deeper one second, at the horizontal range R (m): see `turning_ray`.

    By reciprocity either end may be the source. No ray turns above the depth `surface` (m).
    """
    bottom = ti.max(deep, shallow + 1e-3)
    first = layer_at(layers, shallow)
    last = layer_at(layers, bottom)
    upper = excess_in_layer(layers, first, shallow)
    fastest = ti.max(upper, excess_in_layer(layers, last, bottom))
    for i in range(first + 1, last + 1):
        fastest = ti.max(fastest, layers[i, EXCESS])
    per_speed = 1.0 / (REFERENCE + fastest)
    t = R / (bottom - shallow)
    step = t
    rounds = 0
    while step > 1e-4 * t and t < FLATTEST and rounds < ROUNDS:
        reached = range_and_slope(layers, first, last, shallow, bottom, fastest, t * per_speed)
        step = (R - reached[0]) / reached[1]
        t += step
        rounds += 1
    ray = Ray(slowness=0.0, upper_cosine=1.0, lower_cosine=1.0, time=0.0, exists=1)
    if t < FLATTEST:
        norm = 1.0 / ti.sqrt(1.0 + t * t)
        z = shallow
        e1 = upper
        w1 = stretch(e1, fastest, t * per_speed) * norm
        ray.upper_cosine = w1
        for i in range(first, last + 1):
            below = ti.min(layers[i + 1, DEPTH], bottom)
            e2 = excess_in_layer(layers, i, below)
            w2 = stretch(e2, fastest, t * per_speed) * norm
            ray.time += layer_time(below - z, e1, e2, w1, w2)
            z = below
            e1 = e2
            w1 = w2
        ray.slowness = t * norm * per_speed
        ray.lower_cosine = w1
    else:
        ray = turning_ray(layers, shallow, bottom, R, surface, fastest)
    return ray


@func
def refracted(layers: ti.template(), depth: ti.f32, surface: ti.f32, offset: vec3, c: ti.f32) -> Arrival:
    """The first arrival at an array from a source.

    Args:
        layers: `layered_water.layer_table`.
        depth: of the array, m; on a wave of elevation η it is −η.
        surface: depth above which no ray turns, m.
        offset: source minus array, m, z upwards: negative for a source below.
        c: reference speed, m/s, by which the array converts phases to cosines and delays to metres.
    """
    R = ti.sqrt(offset[0] * offset[0] + offset[1] * offset[1])
    source = depth - offset[2]
    ray = eigenray(layers, ti.min(depth, source), ti.max(depth, source), R, surface)
    S = ti.max(offset.norm(), 1e-3)
    arrival = Arrival(direction=offset / S, slant_range=S, exists=ray.exists)
    if ray.exists:
        across = c * ray.slowness / ti.max(R, 1e-6)
        along = -c / sound_speed(layers, depth) * ray.upper_cosine
        if source < depth:
            along = c / sound_speed(layers, depth) * ray.lower_cosine
        arrival.direction = vec3(across * offset[0], across * offset[1], along)
        arrival.slant_range = c * ray.time
    return arrival


@func
def follow(layers: ti.template(), depth: ti.f32, direction: vec3, slant_range: ti.f32, c: ti.f32) -> vec3:
    """Offset (m) from array to source, by tracing the ray back, through turning points as well: inverts `refracted`.

    An array in a plane measures the horizontal slowness and the travel time, but not whether the ray comes from below
    or from above; that is taken from the sign of the vertical part of the direction. The travel time alone says how
    far along the ray the source is, before or beyond a turning point.

    Args:
        layers, depth, c: as in `refracted`.
        direction: of the arrival. Its horizontal part is c times the slowness, shortened to that of a horizontal
            arrival if it is longer; of its vertical part only the sign counts, and 0 is from below.
        slant_range: c τ, m.
    """
    i = layer_at(layers, depth)
    e1 = excess_in_layer(layers, i, depth)
    across = vec2(direction[0], direction[1])
    measured = across.norm()
    xi = ti.min(measured / c, 1.0 / (REFERENCE + e1))
    s1 = xi * (REFERENCE + e1)
    ww = ti.max((1.0 - s1) * (1.0 + s1), LEAST)
    w1 = ti.sqrt(ww)
    way = 1
    if direction[2] > 0.0:
        way = -1
    time = slant_range / c
    z = depth
    r = 0.0
    rounds = 0
    while time > 0.0 and rounds < ARCS * layers.shape[0]:
        rounds += 1
        edge = i + (way + 1) // 2
        e2 = layers[edge, EXCESS]
        g = layers[i, GRADIENT] * way
        beyond = ww - xi * xi * (e2 - e1) * (2.0 * REFERENCE + e2 + e1)
        turns = beyond <= 0.0 and g > 0.0
        tau = 0.0
        reach = 0.0
        w2 = 0.0
        if turns:
            tau = 2.0 * w1 * artanh_ratio(w1) / g
            reach = 2.0 * w1 / (xi * g)
        else:
            h = ti.abs(layers[edge, DEPTH] - z)
            beyond = ti.max(beyond, LEAST)
            w2 = ti.sqrt(beyond)
            tau = layer_time(h, e1, e2, w1, w2)
            reach = xi * h * (2.0 * REFERENCE + e1 + e2) / (w1 + w2)
        if tau >= time:
            end = along_arc(g, REFERENCE + e1, xi * (REFERENCE + e1), w1, time)
            r += end[0]
            z += way * end[1]
            time = 0.0
        else:
            r += reach
            time -= tau
            if turns:
                way = -way
            else:
                z = layers[edge, DEPTH]
                e1 = e2
                ww = beyond
                w1 = w2
                i = ti.min(ti.max(i + way, 0), layers.shape[0] - 2)
    to_metres = r / ti.max(measured, 1e-9)
    return vec3(to_metres * across[0], to_metres * across[1], depth - z)


@kernel
def _eigenrays(layers: array2, ends: array2, surface: ti.f32, out: array2):
    for n in range(ends.shape[0]):
        ray = eigenray(layers, ends[n, 0], ends[n, 1], ends[n, 2], surface)
        out[n, 0] = ray.slowness
        out[n, 1] = ray.upper_cosine
        out[n, 2] = ray.lower_cosine
        out[n, 3] = ray.time
        out[n, 4] = ray.exists


def eigenrays(layers: torch.Tensor, ends: torch.Tensor, surface: float = 0.0) -> torch.Tensor:
    """`eigenray` for many ends (n, 3): shallow and deep depth and horizontal range, m; all float32.

    Returns:
        (n, 5): ξ (s/m), cos θ at the shallow and at the deep end, travel time (s), and 1 where the ray exists, else 0.
    """
    out = torch.empty((ends.shape[0], 5), dtype=torch.float32, device=ends.device)
    _eigenrays(layers, ends, surface, out)
    return out


@kernel
def _arrivals(layers: array2, depth: array1, offset: array2, c: ti.f32, surface: ti.f32, out: array2):
    for n in range(offset.shape[0]):
        arrival = refracted(layers, depth[n], surface, vec3(offset[n, 0], offset[n, 1], offset[n, 2]), c)
        for j in ti.static(range(3)):
            out[n, j] = arrival.direction[j]
        out[n, 3] = arrival.slant_range
        out[n, 4] = arrival.exists


def arrivals(
    layers: torch.Tensor, depth: torch.Tensor, offset: torch.Tensor, c: float, surface: float = 0.0
) -> torch.Tensor:
    """`refracted` for many arrays at depths (n,) and offsets (n, 3), m: (n, 5) direction, range (m), existence."""
    out = torch.empty((offset.shape[0], 5), dtype=torch.float32, device=offset.device)
    _arrivals(layers, depth, offset, c, surface, out)
    return out


@kernel
def _positions(layers: array2, depth: array1, arrival: array2, c: ti.f32, out: array2):
    for n in range(arrival.shape[0]):
        direction = vec3(arrival[n, 0], arrival[n, 1], arrival[n, 2])
        source = follow(layers, depth[n], direction, arrival[n, 3], c)
        for j in ti.static(range(3)):
            out[n, j] = source[j]


def positions(layers: torch.Tensor, depth: torch.Tensor, arrival: torch.Tensor, c: float) -> torch.Tensor:
    """`follow` for many arrivals (n, 5) of `arrivals` at arrays at depths (n,), m: (n, 3) offsets, m."""
    out = torch.empty((arrival.shape[0], 3), dtype=torch.float32, device=arrival.device)
    _positions(layers, depth, arrival, c, out)
    return out
