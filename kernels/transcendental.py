"""Transcendental functions by polynomials, without branches, for numbers and for vectors of them.

`ti.sin`, `ti.cos` and `ti.exp` are function calls for each number; these stay in registers. An angle is given in turns,
so that reducing it to |t| ≤ ½ is exact: cos 2πt = 1 − 2 sin² πt and sin 2πt = 2 sin πt cos πt.
"""

import math

import taichi as ti

from usvauv.kernels.functions import LANES, func
from usvauv.kernels.types import select

TWO_PI = 2.0 * math.pi
SHIFT = 12583039.0  # 1.5 · 2²³ + 127: the last bits of a number n plus this one are those of the exponent of 2ⁿ
LARGEST = 40.0  # exponent, beyond which e^{−x} counts as e^{−40}
lanes = ti.types.vector(LANES, ti.f32)


@func
def half_sine(t):
    """sin πt for |t| ≤ ½, within 6e-9 before rounding."""
    q = t * t
    return t * (3.14159264 + q * (-5.16770968 + q * (2.55006958 + q * (-0.59824123 + q * 0.07755864))))


@func
def half_cosine(t):
    """cos πt for |t| ≤ ½, within 5e-8 before rounding."""
    q = t * t
    return 0.99999995 + q * (-4.93479283 + q * (4.05841135 + q * (-1.33187657 + q * 0.21968961)))


@func
def decaying(x):
    """e^{−x} for x ≥ 0, within 1e-5 of itself up to x = 20; not below e^{−40}."""
    t = ti.min(x, LARGEST) * (1.0 / 64.0)
    t2 = t * t
    high = (1.0 / 24.0 - t * (1.0 / 120.0)) + t2 * (1.0 / 720.0)
    e = (1.0 - t) + t2 * ((0.5 - t * (1.0 / 6.0)) + t2 * high)
    for _ in ti.static(range(6)):
        e *= e
    return e


@func
def exponential(x):
    """eˣ of a vector in registers, within 2e-7 of itself; below −87 that of −87. The range as in Cephes' `expf`."""
    y = select(x < -87.0, lanes(-87.0), x)
    rounded = 1.44269504 * y + SHIFT
    n = rounded - SHIFT
    f = y - 0.693359375 * n + 2.12194440e-4 * n
    q = 1.6666665e-1 + f * (4.1665796e-2 + f * (8.3334519e-3 + f * (1.3981999e-3 + f * 1.9875691e-4)))
    bits = [ti.bit_cast(rounded[lane], ti.i32) for lane in ti.static(range(LANES))]
    power = [ti.bit_cast(bits[lane] << 23, ti.f32) for lane in ti.static(range(LANES))]
    return (1.0 + f + f * f * (0.5 + f * q)) * ti.Vector(power)


@func
def hyperbolic_tangent(x):
    """Hyperbolic tangent of a vector in registers, within 2e-7."""
    return 1.0 - 2.0 / (1.0 + exponential(2.0 * select(x > 20.0, lanes(20.0), x)))


@func
def circle(angle):
    """Cosine and sine of an angle, rad, within 1.5e-7 for |angle| ≤ 1."""
    turns = 0.15915494309189535 * angle
    t = turns - ti.floor(turns + 0.5)
    s = half_sine(t)
    return 1.0 - 2.0 * s * s, 2.0 * s * half_cosine(t)


@func
def wrapped(angle):
    """An angle, rad, within ±π."""
    return angle - TWO_PI * ti.floor(angle / TWO_PI + 0.5)


@func
def narrowed(v):
    """A vector of double precision in single precision, number by number: Taichi converts no vector in registers."""
    return ti.Vector([ti.cast(v[n], ti.f32) for n in ti.static(range(v.n))])
