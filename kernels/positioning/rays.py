"""Sound rays through layers in which the speed of sound is linear in depth: arcs of circles, in closed form.

Along a ray Snell's law keeps the horizontal slowness ξ = sin θ/c, θ from the vertical. Where a ray crosses a layer of
thickness h and gradient g = (c₂ − c₁)/h, with wᵢ = cos θᵢ = √(1 − ξ²cᵢ²) at its sides,

    r = (w₁ − w₂)/(ξ g) = ξ h (c₁ + c₂)/(w₁ + w₂),
    τ = (artanh w₁ − artanh w₂)/g = h Q artanh(q)/q,
    q = (c₂ − c₁) Q,   Q = (c₁ + c₂)(1 + w₁w₂)/((w₁ + w₂)(c₁² + w₁²c₂²)).

The forms on the right do not cancel for g → 0 or near the vertical: all terms are positive.

Eigenray between two depths at the horizontal range R. With t = tan θ at the fastest depth between them, where c = c_m,
every cosine is w = A/√(1 + t²), A = √(1 + k t²), k = 1 − c²/c_m² ≥ 0, and

    r(t) = t Σ h (c₁ + c₂)/(c_m (A₁ + A₂)),   dr/dt = Σ h (c₁ + c₂)/(c_m A₁ A₂ (A₁ + A₂)).

r(t) increases and is concave, so Newton's method from any point left of the root converges to it without overshoot.
t = R/(vertical distance), the straight line's, is left of the root. Rays that turn between source and array are not
covered: beyond the range of the ray that is horizontal at the fastest depth there is "no direct ray".

Depths are positive downwards from the mean surface, negative on a wave's crest; speeds above the first and below the
last depth of a table are those at its ends.

Sources: Jensen, Kuperman, Porter, Schmidt, "Computational Ocean Acoustics" (2011), §3.3, for the arcs; Fang and Chen,
"A fast and robust two-point ray tracing method in layered media with constant or linearly varying layer velocity",
Geophysical Prospecting 67 (2019), for t as the unknown.
"""
# pyright: reportAttributeAccessIssue=false
# (the members of Taichi's structs exist only while a kernel is compiled)

import numpy as np
import taichi as ti
import torch

from kernels.types import array1, array2, vec2, vec3

# Columns of the table of layers, one row a depth; a layer extends from its row to the next.
DEPTH = 0  # m
SPEED = 1  # m/s
GRADIENT = 2  # of the layer below, 1/s
COLUMNS = 3

BEYOND = 2e4  # m, thickness of the end layers of constant speed
FLATTEST = 1e5  # tan θ at which a ray counts as horizontal
ROUNDS = 60  # at most, of Newton's method; 2 or 3 are usual, near the last direct ray t grows by half in each


def layer_table(depth: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Table of layers (N + 2, COLUMNS), float32, from increasing depths (N,), m, and the speeds (N,) there, m/s."""
    z = np.concatenate([[depth[0] - BEYOND], depth, [depth[-1] + BEYOND]])
    c = np.concatenate([speed[:1], speed, speed[-1:]]).astype(float)
    gradient = np.append(np.diff(c) / np.diff(z), 0.0)
    return np.stack([z, c, gradient], axis=1).astype(np.float32)


@ti.dataclass
class Ray:
    """A direct ray between two depths."""

    slowness: ti.f32  # ξ, s/m
    upper_cosine: ti.f32  # cos θ at the shallower end
    lower_cosine: ti.f32  # and at the deeper
    time: ti.f32  # τ, s
    exists: ti.i32  # 0: no direct ray, the other numbers are undefined


@ti.dataclass
class Arrival:
    """A direct arrival at an array, scaled so that a straight ray at the reference speed c gives the geometry."""

    direction: vec3  # c times the slowness vector, towards the source along the ray; its length is c/c(array)
    slant_range: ti.f32  # c τ, m
    exists: ti.i32  # 0: no direct ray; then direction and range are those of the straight line


@ti.func
def layer_at(layers: ti.template(), depth: ti.f32) -> ti.i32:
    """Row of the layer in which a depth (m) lies."""
    row = 0
    for i in range(1, layers.shape[0] - 1):
        if layers[i, DEPTH] <= depth:
            row = i
    return row


@ti.func
def speed_in_layer(layers: ti.template(), i: ti.i32, depth: ti.f32) -> ti.f32:
    """Speed of sound (m/s) at a depth (m) in the layer i, at its lower side exactly that of the next row."""
    c = layers[i, SPEED] + layers[i, GRADIENT] * (depth - layers[i, DEPTH])
    if depth >= layers[i + 1, DEPTH]:
        c = layers[i + 1, SPEED]
    return c


@ti.func
def sound_speed(layers: ti.template(), depth: ti.f32) -> ti.f32:
    """Speed of sound (m/s) at a depth (m)."""
    return speed_in_layer(layers, layer_at(layers, depth), depth)


@ti.func
def stretch(c: ti.f32, fastest: ti.f32, t: ti.f32) -> ti.f32:
    """A = √(1 + k t²), the ratio of cos θ at the speed c to that at the fastest depth."""
    u = t / fastest
    return ti.sqrt(1.0 + (fastest - c) * (fastest + c) * u * u)


@ti.func
def range_and_slope(
    layers: ti.template(), first: ti.i32, last: ti.i32, shallow: ti.f32, deep: ti.f32, fastest: ti.f32, t: ti.f32
) -> vec2:
    """Horizontal range r (m) of the ray with t = tan θ at the fastest depth, and dr/dt (m).

    The depths lie in the layers first and last.
    """
    reached = 0.0
    slope = 0.0
    z = shallow
    c1 = speed_in_layer(layers, first, shallow)
    A1 = stretch(c1, fastest, t)
    for i in range(first, last + 1):
        below = ti.min(layers[i + 1, DEPTH], deep)
        c2 = speed_in_layer(layers, i, below)
        A2 = stretch(c2, fastest, t)
        part = (below - z) * (c1 + c2) / (A1 + A2)
        reached += part
        slope += part / (A1 * A2)
        z = below
        c1 = c2
        A1 = A2
    return vec2(reached * t / fastest, slope / fastest)


@ti.func
def artanh_ratio(q: ti.f32) -> ti.f32:
    """artanh(q)/q for |q| < 1."""
    x = q * q
    ratio = 1.0 + x * (1.0 / 3.0 + x * (0.2 + x * (1.0 / 7.0 + x / 9.0)))
    if x > 0.04:
        ratio = 0.5 * ti.log((1.0 + q) / (1.0 - q)) / q
    return ratio


@ti.func
def layer_time(h: ti.f32, c1: ti.f32, c2: ti.f32, w1: ti.f32, w2: ti.f32) -> ti.f32:
    """Travel time τ (s) through a layer of thickness h (m) with the speeds and cosines at its sides."""
    Q = (c1 + c2) * (1.0 + w1 * w2) / ((w1 + w2) * (c1 * c1 + w1 * w1 * c2 * c2))
    return h * Q * artanh_ratio((c2 - c1) * Q)


@ti.func
def eigenray(layers: ti.template(), shallow: ti.f32, deep: ti.f32, R: ti.f32) -> Ray:
    """The direct ray between two depths (m), the deeper one second, at the horizontal range R (m).

    By reciprocity either end may be the source.
    """
    bottom = ti.max(deep, shallow + 1e-3)
    first = layer_at(layers, shallow)
    last = layer_at(layers, bottom)
    upper = speed_in_layer(layers, first, shallow)
    fastest = ti.max(upper, speed_in_layer(layers, last, bottom))
    for i in range(first + 1, last + 1):
        fastest = ti.max(fastest, layers[i, SPEED])
    t = R / (bottom - shallow)
    step = t
    rounds = 0
    while step > 1e-4 * t and t < FLATTEST and rounds < ROUNDS:
        reached = range_and_slope(layers, first, last, shallow, bottom, fastest, t)
        step = (R - reached[0]) / reached[1]
        t += step
        rounds += 1
    norm = 1.0 / ti.sqrt(1.0 + t * t)
    time = 0.0
    z = shallow
    c1 = upper
    w1 = stretch(c1, fastest, t) * norm
    upper_cosine = w1
    for i in range(first, last + 1):
        below = ti.min(layers[i + 1, DEPTH], bottom)
        c2 = speed_in_layer(layers, i, below)
        w2 = stretch(c2, fastest, t) * norm
        time += layer_time(below - z, c1, c2, w1, w2)
        z = below
        c1 = c2
        w1 = w2
    return Ray(
        slowness=t * norm / fastest, upper_cosine=upper_cosine, lower_cosine=w1, time=time, exists=ti.i32(t < FLATTEST)
    )


@ti.func
def refracted(layers: ti.template(), depth: ti.f32, offset: vec3, c: ti.f32) -> Arrival:
    """The direct arrival at an array from a source.

    Args:
        layers: `layer_table`.
        depth: of the array, m; on a wave of elevation η it is −η.
        offset: source minus array, m, z upwards: negative for a source below.
        c: reference speed, m/s, by which the array converts phases to cosines and delays to metres.
    """
    R = ti.sqrt(offset[0] * offset[0] + offset[1] * offset[1])
    source = depth - offset[2]
    ray = eigenray(layers, ti.min(depth, source), ti.max(depth, source), R)
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


@ti.func
def follow(layers: ti.template(), depth: ti.f32, across: vec2, slant_range: ti.f32, c: ti.f32) -> vec3:
    """Offset (m) from array to source, by tracing the ray down: the inverse of `refracted` for a source below.

    A ray that turns is traced as if its layer had no end, so that the result stays finite for noisy directions near the
    horizontal.

    Args:
        layers, depth, c: as in `refracted`.
        across: horizontal part of the direction, shortened to that of a horizontal arrival if it is longer.
        slant_range: c τ, m.
    """
    first = layer_at(layers, depth)
    c1 = speed_in_layer(layers, first, depth)
    measured = across.norm()
    xi = ti.min(measured / c, 1.0 / c1)
    w1 = ti.sqrt(ti.max((1.0 - xi * c1) * (1.0 + xi * c1), 0.0))
    time = slant_range / c
    z = depth
    r = 0.0
    for i in range(first, layers.shape[0] - 1):
        if time > 0.0:
            h = layers[i + 1, DEPTH] - z
            c2 = layers[i + 1, SPEED]
            s2 = xi * c2
            crossed = False
            if s2 < 1.0:
                w2 = ti.sqrt((1.0 - s2) * (1.0 + s2))
                tau = layer_time(h, c1, c2, w1, w2)
                if tau < time:
                    crossed = True
                    r += xi * h * (c1 + c2) / (w1 + w2)
                    time -= tau
                    z += h
                    c1 = c2
                    w1 = w2
            if not crossed:
                end = along_arc(layers[i, GRADIENT], c1, xi * c1, w1, time)
                r += end[0]
                z += end[1]
                time = 0.0
    to_metres = r / ti.max(measured, 1e-9)
    return vec3(to_metres * across[0], to_metres * across[1], depth - z)


@ti.func
def along_arc(g: ti.f32, c: ti.f32, s: ti.f32, w: ti.f32, time: ti.f32) -> vec2:
    """Horizontal range and depth (m) gained in a time (s) inside a layer of gradient g, from speed c, sin θ, cos θ.

    tan(θ/2) grows as exp(g τ), which gives both without cancellation.
    """
    x = g * time
    growth = 1.0 + x * (0.5 + x * (1.0 / 6.0 + x * (1.0 / 24.0 + x * (1.0 / 120.0 + x / 720.0))))  # (exp x − 1)/x
    if ti.abs(x) > 0.2:
        growth = (ti.exp(x) - 1.0) / x
    E = 1.0 + x * growth
    T = s / (1.0 + w)
    reach = c * time * growth / (1.0 + T * T * E * E)
    return vec2(reach * T * (1.0 + E), reach * (1.0 - T * T * E))


@ti.kernel
def _eigenrays(layers: array2, ends: array2, out: array2):
    for n in range(ends.shape[0]):
        ray = eigenray(layers, ends[n, 0], ends[n, 1], ends[n, 2])
        out[n, 0] = ray.slowness
        out[n, 1] = ray.upper_cosine
        out[n, 2] = ray.lower_cosine
        out[n, 3] = ray.time
        out[n, 4] = ti.f32(ray.exists)


def eigenrays(layers: torch.Tensor, ends: torch.Tensor) -> torch.Tensor:
    """`eigenray` for many ends (n, 3): shallow and deep depth and horizontal range, m; all float32.

    Returns:
        (n, 5): ξ (s/m), cos θ at the shallow and at the deep end, travel time (s), and 1 where the ray exists, else 0.
    """
    out = torch.empty((ends.shape[0], 5), dtype=torch.float32, device=ends.device)
    _eigenrays(layers, ends, out)
    return out


@ti.kernel
def _arrivals(layers: array2, depth: array1, offset: array2, c: ti.f32, out: array2):
    for n in range(offset.shape[0]):
        arrival = refracted(layers, depth[n], vec3(offset[n, 0], offset[n, 1], offset[n, 2]), c)
        for j in ti.static(range(3)):
            out[n, j] = arrival.direction[j]
        out[n, 3] = arrival.slant_range
        out[n, 4] = ti.f32(arrival.exists)


def arrivals(layers: torch.Tensor, depth: torch.Tensor, offset: torch.Tensor, c: float) -> torch.Tensor:
    """`refracted` for many arrays at depths (n,) and offsets (n, 3), m: (n, 5) direction, range (m), existence."""
    out = torch.empty((offset.shape[0], 5), dtype=torch.float32, device=offset.device)
    _arrivals(layers, depth, offset, c, out)
    return out


@ti.kernel
def _positions(layers: array2, depth: array1, arrival: array2, c: ti.f32, out: array2):
    for n in range(arrival.shape[0]):
        source = follow(layers, depth[n], vec2(arrival[n, 0], arrival[n, 1]), arrival[n, 3], c)
        for j in ti.static(range(3)):
            out[n, j] = source[j]


def positions(layers: torch.Tensor, depth: torch.Tensor, arrival: torch.Tensor, c: float) -> torch.Tensor:
    """`follow` for many arrivals (n, 5) of `arrivals` at arrays at depths (n,), m: (n, 3) offsets, m."""
    out = torch.empty((arrival.shape[0], 3), dtype=torch.float32, device=arrival.device)
    _positions(layers, depth, arrival, c, out)
    return out
