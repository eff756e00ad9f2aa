"""Water in layers in which the speed of sound is linear in depth: the table of layers, and arcs of rays in one layer.

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

Source: Jensen, Kuperman, Porter, Schmidt, "Computational Ocean Acoustics" (2011), §3.3.
"""
# pyright: reportAttributeAccessIssue=false
# (the members of Taichi's structs exist only while a kernel is compiled)

import numpy as np
import taichi as ti

from usvauv.kernels.types import vec2

# Columns of the table of layers, one row a depth; a layer extends from its row to the next.
DEPTH = 0  # m
EXCESS = 1  # speed minus REFERENCE, m/s
GRADIENT = 2  # of the layer below, 1/s

REFERENCE = 1500.0  # m/s
BEYOND = 2e4  # m, thickness of the end layers of constant speed


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


@ti.func
def layer_at(layers: ti.template(), depth: ti.f32) -> ti.i32:
    """Row of the layer in which a depth (m) lies."""
    row = 0
    for i in range(1, layers.shape[0] - 1):
        if layers[i, DEPTH] <= depth:
            row = i
    return row


@ti.func
def excess_in_layer(layers: ti.template(), i: ti.i32, depth: ti.f32) -> ti.f32:
    """Speed of sound minus REFERENCE (m/s) at a depth (m) in the layer i, at its lower side exactly the next row's."""
    e = layers[i, EXCESS] + layers[i, GRADIENT] * (depth - layers[i, DEPTH])
    if depth >= layers[i + 1, DEPTH]:
        e = layers[i + 1, EXCESS]
    return e


@ti.func
def sound_speed(layers: ti.template(), depth: ti.f32) -> ti.f32:
    """Speed of sound (m/s) at a depth (m)."""
    return REFERENCE + excess_in_layer(layers, layer_at(layers, depth), depth)


@ti.func
def artanh_ratio(q: ti.f32) -> ti.f32:
    """artanh(q)/q for |q| < 1."""
    x = q * q
    ratio = 1.0 + x * (1.0 / 3.0 + x * (0.2 + x * (1.0 / 7.0 + x / 9.0)))
    if x > 0.04:
        ratio = 0.5 * ti.log((1.0 + q) / (1.0 - q)) / q
    return ratio


@ti.func
def layer_time(h: ti.f32, e1: ti.f32, e2: ti.f32, w1: ti.f32, w2: ti.f32) -> ti.f32:
    """Travel time τ (s) through a layer of thickness h (m) with the excess speeds and cosines at its sides."""
    c1 = REFERENCE + e1
    c2 = REFERENCE + e2
    Q = (c1 + c2) * (1.0 + w1 * w2) / ((w1 + w2) * (c1 * c1 + w1 * w1 * c2 * c2))
    return h * Q * artanh_ratio((e2 - e1) * Q)


@ti.func
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
