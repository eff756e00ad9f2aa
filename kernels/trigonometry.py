"""Sine and cosine of half a turn and e^{−x} by polynomials, without branches, for numbers and for vectors of them.

`ti.sin`, `ti.cos` and `ti.exp` are function calls for each number; these stay in registers. An angle is given in turns,
so that reducing it to |t| ≤ ½ is exact: cos 2πt = 1 − 2 sin² πt and sin 2πt = 2 sin πt cos πt.
"""

import math

import taichi as ti

from usvauv.kernels.functions import func

TWO_PI = 2.0 * math.pi
LARGEST = 40.0  # exponent, beyond which e^{−x} counts as e^{−40}


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
