"""Currents of superposed Lamb–Oseen vortices (Eq. 8, with the sign of V_y that makes the printed vorticity its curl).

    V_x = −Γ (y − y0)/(2π r²) (1 − e^{−r²/δ²}),   V_y = +Γ (x − x0)/(2π r²) (1 − e^{−r²/δ²}),
    ϖ = ∂V_y/∂x − ∂V_x/∂y = Γ/(π δ²) e^{−r²/δ²},  ∇·V = 0.

A vortex is four numbers (x0, y0, Γ, δ): centre (m), circulation (m²/s, positive anticlockwise), core radius (m).
Its peak speed is 0.6382 Γ/(2πδ) at r = 1.1209 δ. Source: Lamb, "Hydrodynamics" (6th ed.), §334a.

In a pattern that repeats with the period L in x and y (`Eddies.period`) a vortex stands for all its images, on the
uniform vorticity −Γ/L² without which a periodic field cannot be. In complex form, with z = x + iy from the vortex to
the nearest image, |x|, |y| ≤ L/2:

    u − iv = Γ/(2πi) (ζ(z) − π z̄/L²),   ζ(z) = 1/z − Σ_k c_k z^{4k−1}/L^{4k},

where ζ is Weierstrass' function of the square lattice; the pole has the factor of the core above. Of its series, with
the Eisenstein sums G_4k = Σ' (m + in)^{−4k} for c_k, four terms would be off by 4.4e-3 Γ/(2πL) in the square's corners;
fitted to ζ on the square's edge in the uniform norm, where the error of an analytic function is greatest, four are off
by 1.3e-4 at most, and by twice that the velocity jumps where the nearest image changes. Sums over the circle's other
multiples vanish by symmetry, as does the constant that a lattice without this symmetry adds to π z̄/L². The vorticity is
that of the core less Γ/L², the divergence 0, whatever the c_k. Images' cores are left out, an error
of e^{−(L/2δ)²} of the velocity.
A velocity's gradient has ζ′, the same series with (4k − 1) c_k, and of the pole's factor T = (1 − e^{−r²/δ²})/r² the
derivative 2x ((e^{−r²/δ²}/δ² − T)/r²), likewise in y.
Source: Weiss and McWilliams (1991), doi 10.1063/1.858014; Whittaker and Watson, "A Course of Modern Analysis", ch. XX.
"""

import math
from typing import Any, NamedTuple

import taichi as ti
import torch

from usvauv.kernels.functions import func, kernel
from usvauv.kernels.types import Columns, array3

PLACES = 8  # places side by side
IMAGES = 3.15120262, 4.25286493, 3.82483015, 2.82903353  # c_k of ζ
SLOPES = tuple((4 * k + 3) * c for k, c in enumerate(IMAGES))  # (4k − 1) c_k of ζ′
FAR = 16.0  # r²/δ² from which on 1 − e^{−r²/δ²} counts as that at 16, within 2e-7 of 1
LEAST = 1e-18  # added to r², so that something divided by it is a number

places = ti.types.vector(PLACES, ti.f32)


class Pattern(NamedTuple):
    """What a function needs of `Eddies` to compute a velocity.

    Attributes:
        repeats: whether there is a period; compiled into kernels.
        scale: by which `induced` measures lengths: 1/L, 1/m; 1 without a period.
        share: velocity over what `induced` gives: 1/(2πL), 1/m; 1/(2π) without a period.
        cruise: as of `Eddies`.
    """

    repeats: bool
    scale: Any
    share: Any
    cruise: Any = 1.0


class Eddies(NamedTuple):
    """How the vortices of a world fill the water. By default without end, alike at all depths.

    Attributes:
        period: L of the pattern in x and y, m; 0: the vortices have no images.
        centre: of the square of side L that holds the vortices, m.
        cruise: velocity at cruise depth over that at the surface, 1.
        column: velocity with which the vortices carry one another over that at the surface, 1.
        carried: velocity (x, y) with which a uniform current carries vortices that move one another, m/s.
    """

    period: float = 0.0
    centre: tuple[float, float] = (0.0, 0.0)
    cruise: float = 1.0
    column: float = 1.0
    carried: tuple[float, float] = (0.0, 0.0)

    @property
    def pattern(self) -> Pattern:
        """For kernels."""
        length = self.period or 1.0
        return Pattern(self.period > 0, 1.0 / length, 0.5 / math.pi / length, self.cruise)


ENDLESS = Eddies()


class Vortex(Columns):
    """A vortex, (W, V, 4)."""

    x: int  # centre, m
    y: int
    Gamma: int  # circulation, m²/s
    delta: int  # core radius, m


@func
def core(t):
    """n = 1 − e^{−16t} for t ≥ 0, within 4e-7 of itself: a polynomial for 1 − e^{−t}, and n(2t) = n(t) (2 − n(t)).

    Pairs of its terms do not wait for one another (Estrin's scheme).
    """
    t = ti.min(t, 1.0)
    t2 = t * t
    high = (0.166605221 - t * 0.0414065988) + t2 * (0.00782370753 - t * 0.000907157727)
    n = t * ((0.999999921 - t * 0.499994584) + t2 * high)
    for _ in ti.static(range(4)):
        n *= 2.0 - n
    return n


@func
def images(x, y, real, r4, c: ti.template()):
    """Real and imaginary part of Σ_k c_k z^{4k−2} for z = x + iy, with x² − y² and |z|⁴, |x|, |y| ≤ ½.

    The polynomial in q = z⁴ is summed by Horner's rule for real coefficients, b_k = c_k + 2 Re(q) b_{k+1} −
    |q|² b_{k+2} (Knuth, "Seminumerical Algorithms", §4.6.4).
    """
    imaginary = (x + x) * y  # of z², as `real`
    size = r4 * r4
    half = imaginary * imaginary
    q = r4 - (half + half)
    q2 = q + q
    b3 = ti.static(c[2]) + q2 * ti.static(c[3])
    b2 = ti.static(c[1]) + q2 * b3 - size * ti.static(c[3])
    series, turned = ti.static(c[0]) + q * b2 - size * b3, (real + real) * imaginary * b2
    return real * series - imaginary * turned, real * turned + imaginary * series


@func
def induced(x, y, width2, repeats: ti.template()):
    """2πL times the velocity (m/s) at (x, y) from a vortex of circulation 1 m²/s.

    Numbers or vectors of numbers, without branches. A vortex adds exactly 0 at its centre.

    Args:
        x, y: over L. width2: `FAR` δ²/L². repeats: of `Pattern`.
    """
    if ti.static(repeats):
        x, y = x - ti.floor(x + 0.5), y - ti.floor(y + 0.5)
    x2, y2 = x * x, y * y
    r2 = x2 + y2 + LEAST
    turn = core(r2 * (1.0 / width2)) / r2  # numbers side by side with one `width2` share the division by it
    u, v = x, y
    if ti.static(repeats):
        turn = math.pi - turn
        real, imaginary = images(x, y, x2 - y2, r2 * r2, IMAGES)
        u, v = (turn - real) * y - x * imaginary, y * imaginary - (turn + real) * x
    else:
        u, v = (0.0 - turn) * y, turn * x
    return u, v


@func
def induced_gradient(x, y, width2, repeats: ti.template()):
    """2πL² times u_x = −v_y, u_y and v_x (1/s) of what `induced` gives; arguments as there."""
    if ti.static(repeats):
        x, y = x - ti.floor(x + 0.5), y - ti.floor(y + 0.5)
    x2, y2 = x * x, y * y
    r2 = x2 + y2 + LEAST
    inverse = 1.0 / r2
    scale = 1.0 / width2
    n = core(r2 * scale)
    turn = n * inverse
    change = 2.0 * inverse * (FAR * scale * (1.0 - n) - turn)
    u_x, u_y, v_x = (0.0 - x) * y * change, (0.0 - turn) - y2 * change, turn + x2 * change
    if ti.static(repeats):
        real, imaginary = images(x, y, x2 - y2, r2 * r2, SLOPES)
        u_x, u_y, v_x = u_x - imaginary, u_y - real + math.pi, v_x - real - math.pi
    return u_x, u_y, v_x


@func
def current(vortex: ti.template(), w: ti.i32, x, y, pattern: ti.template()):
    """Velocity (u, v) in m/s at the surface at (x, y) in world w: numbers, or vectors of numbers.

    Args:
        vortex: of shape (W, V, 4).
        x, y: m. pattern: of the vortices.
    """
    scale, share = pattern.scale, pattern.share
    x, y = x * scale, y * scale
    u, v = 0.0 * x, 0.0 * y
    for n in range(vortex.shape[1]):
        delta = vortex[w, n, Vortex.delta] * scale
        x_n, y_n = vortex[w, n, Vortex.x] * scale, vortex[w, n, Vortex.y] * scale
        along_x, along_y = induced(x - x_n, y - y_n, FAR * delta * delta, pattern.repeats)
        u += vortex[w, n, Vortex.Gamma] * along_x
        v += vortex[w, n, Vortex.Gamma] * along_y
    return share * u, share * v


@func
def current_and_gradient(vortex: ti.template(), w: ti.i32, x, y, pattern: ti.template()):
    """`current`, and u_x = −v_y, u_y and v_x of it, 1/s."""
    scale, share = pattern.scale, pattern.share
    x, y = x * scale, y * scale
    u, v, u_x, u_y, v_x = 0.0 * x, 0.0 * x, 0.0 * x, 0.0 * x, 0.0 * x
    for n in range(vortex.shape[1]):
        delta = vortex[w, n, Vortex.delta] * scale
        x_n, y_n = vortex[w, n, Vortex.x] * scale, vortex[w, n, Vortex.y] * scale
        along_x, along_y = induced(x - x_n, y - y_n, FAR * delta * delta, pattern.repeats)
        stretch, turn_x, turn_y = induced_gradient(x - x_n, y - y_n, FAR * delta * delta, pattern.repeats)
        Gamma = vortex[w, n, Vortex.Gamma]
        u += Gamma * along_x
        v += Gamma * along_y
        u_x += Gamma * stretch
        u_y += Gamma * turn_x
        v_x += Gamma * turn_y
    slope = scale * share
    return share * u, share * v, slope * u_x, slope * u_y, slope * v_x


@kernel
def _sample_current(
    vortex: array3,
    points: array3,
    out: array3,
    repeats: ti.template(),
    scale: ti.f32,
    share: ti.f32,
):
    for w, g in ti.ndrange(points.shape[0], (points.shape[1] + PLACES - 1) // PLACES):
        x, y = places(0.0), places(0.0)
        for n in ti.static(range(PLACES)):
            point = ti.min(g * PLACES + n, points.shape[1] - 1)
            x[n], y[n] = points[w, point, 0], points[w, point, 1]
        u, v = current(vortex, w, x, y, ti.static(Pattern(repeats, scale, share)))
        for n in ti.static(range(PLACES)):
            point = ti.min(g * PLACES + n, points.shape[1] - 1)
            out[w, point, 0], out[w, point, 1] = u[n], v[n]


def sample_current(vortex: torch.Tensor, points: torch.Tensor, period: float = 0.0) -> torch.Tensor:
    """Velocity at many points at the surface.

    Args:
        vortex: (W, V, 4) float32, rows (x0, y0, Γ, δ) in m, m, m²/s, m; V may be 0.
        points: (W, P, 2) float32, positions in m.
        period: of `Eddies`, m.

    Returns:
        (W, P, 2) float32, (V_x, V_y) in m/s.
    """
    out = torch.zeros_like(points)
    if vortex.shape[1]:
        _sample_current(vortex.contiguous(), points.contiguous(), out, *Eddies(period).pattern[:3])
    return out
