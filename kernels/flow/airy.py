"""Short waves: a directional sea of Airy (linear, any depth) waves on water of constant depth h.

    η = Σ a cos θ,   θ = k·x − ω t + φ,   ω² = g k tanh(k h),
    (u, v) = Σ a ω C (k_x, k_y)/k cos θ,   C = cosh(k (z + h))/sinh(k h),
    w      = Σ a ω D sin θ,                D = sinh(k (z + h))/sinh(k h),

the gradient of a potential: no divergence, no rotation, no flow through the bed, and at z = 0 w = η_t and u_t = −g η_x.
Linear theory puts the surface at z = 0. For a floating body the velocity there is, to second order,

    u + η u_z,   (u_z, v_z) = Σ a ω D (k_x, k_y) cos θ,

so that it drifts with the whole Stokes drift Σ a² ω k cosh 2kh/(2 sinh² kh): Σ a² ω k C²/2 from horizontal motion, also
at constant depth, and Σ a² ω k/2 from vertical motion. Sources: Dean and Dalrymple, "Water Wave Mechanics for
Engineers and Scientists" (1991), §3.4 and §4.4; van den Bremer and Breivik (2018), doi 10.1098/rsta.2017.0104 (drift).

A sea is an array `wave` (seas, groups, columns, LANES): LANES components stand side by side, one column each of

    TURNS_X, TURNS_Y    k/2π, 1/m
    PHASE               (φ − ω t0)/2π, reduced to one turn in double precision by `set_phases`
    FREQUENCY           ω/2π, Hz
    HEAVE, TILT         a times what a boat follows of elevation and of slope, m; a where it follows all of them
    LEVEL + 2 n         2π a ω C/k at the n-th of some levels z, m²/s
    LEVEL + 2 n + 1     a ω D there, m/s

so that no kernel evaluates a hyperbolic function. Kernels add what the phases lose in the time since t0, at most
`PHASES_LAST`, so that single precision loses nothing with time. Angles are in turns:
reducing one to ±½ is then exact, and two polynomials give its cosine and sine. With these, and with vectors of LANES
numbers, a component takes a fifth of the time with `ti.cos` and `ti.sin`.
"""

from collections.abc import Sequence

import numpy as np
import taichi as ti
import torch

from usvauv.kernels.functions import LANES, func, kernel
from usvauv.kernels.transcendental import TWO_PI, half_cosine, half_sine, lanes, narrowed
from usvauv.kernels.types import array1, double1, vec4

TURNS_X, TURNS_Y, PHASE, FREQUENCY, HEAVE, TILT, LEVEL = range(7)
PHASES_LAST = 16.0  # s; in single precision a wave of 1 Hz keeps its phase so long within 1e-6 of a turn
STILL = 1e-5  # m/s, which is not felt

vec8 = ti.types.vector(8, ti.f32)
waves = ti.types.ndarray(dtype=lanes, ndim=3)
double_lanes = ti.types.ndarray(dtype=ti.types.vector(LANES, ti.f64), ndim=2)


@func
def total(v: lanes) -> ti.f32:
    """Sum of the lanes, half upon half, each half in one instruction where vectors stay in registers."""
    eight = vec8([v[n] for n in ti.static(range(8))]) + vec8([v[n + 8] for n in ti.static(range(8))])
    four = vec4([eight[n] for n in ti.static(range(4))]) + vec4([eight[n + 4] for n in ti.static(range(4))])
    return (four[0] + four[2]) + (four[1] + four[3])


@func
def angle(wave: ti.template(), since: ti.template(), sea: ti.i32, n: ti.i32, x: ti.f32, y: ti.f32) -> lanes:
    """θ/2π of group n of a sea at (x, y), between −½ and ½; arguments as of `motion`."""
    turns = wave[sea, n, TURNS_X] * x + wave[sea, n, TURNS_Y] * y
    turns = turns + (wave[sea, n, PHASE] - since[0] * wave[sea, n, FREQUENCY])
    return turns - ti.floor(turns + 0.5)


@func
def motion(
    wave: ti.template(), since: ti.template(), sea: ti.i32, groups: ti.i32, level: ti.template(), x: ti.f32, y: ti.f32
) -> vec8:
    """Surface, velocity and its shear (η, η_x, η_y, u, v, w, u_z, v_z) of a sea at (x, y), in m, 1, m/s and 1/s.

    The surface is as a boat follows it.
    What a caller does not use of it is not computed.

    Args:
        wave: an argument of type `waves`.
        since: (1,), time since t0, s.
        sea: index of the sea.
        groups: of its components, the first of which move the water; see `felt`.
        level: index of the level at which the velocity is wanted, known when compiled.
        x, y: position, m.
    """
    eta, eta_x, eta_y = lanes(0.0), lanes(0.0), lanes(0.0)
    u, v, w = lanes(0.0), lanes(0.0), lanes(0.0)
    u_z, v_z = lanes(0.0), lanes(0.0)
    for n in range(groups):
        kx = wave[sea, n, TURNS_X]
        ky = wave[sea, n, TURNS_Y]
        tilt = wave[sea, n, TILT]
        t = angle(wave, since, sea, n, x, y)
        s = half_sine(t)
        cosine = 1.0 - 2.0 * s * s
        sine = 2.0 * s * half_cosine(t)
        along = wave[sea, n, LEVEL + 2 * level] * cosine
        eta += wave[sea, n, HEAVE] * cosine
        eta_x = eta_x - tilt * sine * kx
        eta_y = eta_y - tilt * sine * ky
        u += along * kx
        v += along * ky
        w += wave[sea, n, LEVEL + 2 * level + 1] * sine
        shear = wave[sea, n, LEVEL + 2 * level + 1] * cosine
        u_z += shear * kx
        v_z += shear * ky
    return vec8(
        total(eta),
        TWO_PI * total(eta_x),
        TWO_PI * total(eta_y),
        total(u),
        total(v),
        total(w),
        TWO_PI * total(u_z),
        TWO_PI * total(v_z),
    )


@kernel
def set_phases(start: double_lanes, frequency: double_lanes, clock: double1, wave: waves, serial: ti.template()):
    """Make a time t0 of all seas' phases; `serial`: the calling thread does it all.

    The old phases are read because Vulkan brings only what a kernel reads to the device, and takes the whole array
    back.

    Args:
        start, frequency: φ/2π and ω/2π (Hz), each (seas, groups). clock: (1,), t0, s.
    """
    ti.loop_config(serialize=serial)
    for sea in range(wave.shape[0]):
        for n in range(wave.shape[1]):
            turns = start[sea, n] - clock[0] * frequency[sea, n]
            wave[sea, n, PHASE] = 0.0 * wave[sea, n, PHASE] + narrowed(turns - ti.floor(turns))


@kernel
def _sample(
    wave: waves,
    since: array1,
    level: ti.template(),
    points: ti.types.ndarray(dtype=ti.f32, ndim=3),
    out: ti.types.ndarray(dtype=ti.f32, ndim=3),
):
    for sea, n in ti.ndrange(points.shape[0], points.shape[1]):
        moved = motion(wave, since, sea, wave.shape[1], level, points[sea, n, 0], points[sea, n, 1])
        for c in ti.static(range(8)):
            out[sea, n, c] = moved[c]


def sample(wave: torch.Tensor, since: torch.Tensor, points: torch.Tensor, level: int) -> torch.Tensor:
    """`motion` at many points of many seas.

    Args:
        wave: (seas, groups, columns, LANES) float32. since: (1,) float32, time since t0 of its phases, s.
        points: (seas, P, 2) float32, m.
        level: index of the level of the velocity.

    Returns:
        (seas, P, 8) float32: η (m), η_x, η_y, u, v, w (m/s), u_z, v_z (1/s).
    """
    out = points.new_empty((*points.shape[:2], 8))
    _sample(wave, since, level, points.contiguous(), out)
    return out


def wavenumber(omega: np.ndarray, depth: float, gravity: float) -> np.ndarray:
    """The k ≥ 0 with ω² = g k tanh(k h), to round-off, rad/m.

    Newton's method for y tanh y = ω² h/g from Eckart's approximation, which is at most 6 % off.

    Args:
        omega: angular frequency ω ≥ 0, rad/s.
        depth: h, m.
        gravity: g, m/s².
    """
    x = np.asarray(omega, np.float64) ** 2 * depth / gravity
    y = x / np.sqrt(np.tanh(np.maximum(x, 1e-300)))
    for _ in range(6):
        tanh = np.tanh(y)
        y = y - (y * tanh - x) / np.maximum(tanh + y * (1 - tanh**2), 1e-300)
    return y / depth


def decay(k: np.ndarray, z: float, depth: float) -> tuple[np.ndarray, np.ndarray]:
    """C and D at the level z, −h ≤ z ≤ 0, as (e^{kz} ± e^{−k(z + 2h)})/(1 − e^{−2kh}): no exponential overflows."""
    down, up = np.exp(k * z), np.exp(-k * (z + 2 * depth))
    return (down + up) / -np.expm1(-2 * k * depth), (down - up) / -np.expm1(-2 * k * depth)


def pack(
    amplitude: np.ndarray,
    k: np.ndarray,
    direction: np.ndarray,
    omega: np.ndarray,
    *,
    depth: float,
    levels: Sequence[float],
    followed: tuple[np.ndarray | float, np.ndarray | float] = (1.0, 1.0),
    more: Sequence[np.ndarray] = (),
) -> np.ndarray:
    """The array `wave` with phases of 0, (seas, groups, LEVEL + 2 len(levels), LANES) float32.

    The last group is filled up with components of no amplitude.

    Args:
        amplitude, k, direction, omega: a (m), k > 0 (rad/m), direction of travel (rad from x towards y) and ω (rad/s),
            each (seas, N).
        depth: h, m.
        levels: heights z at which velocities are wanted, −h ≤ z ≤ 0, m.
        followed: shares of elevation and slope that a boat follows, each (seas, N), 1.
        more: further columns, each (seas, N).
    """
    columns = [k * np.cos(direction) / TWO_PI, k * np.sin(direction) / TWO_PI, np.zeros_like(k)]
    columns += [omega / TWO_PI, *(amplitude * share for share in followed)]
    for z in levels:
        C, D = decay(k, z, depth)
        columns += [TWO_PI * amplitude * omega * C / k, amplitude * omega * D]
    columns += more
    return np.ascontiguousarray(group(np.stack(columns, axis=1)).swapaxes(1, 2), np.float32)


def felt(packed: np.ndarray, level: int) -> np.ndarray:
    """Groups of each sea in what `pack` returns that move the water at a level, (seas,) int32: all up to the last.

    Those after it, as a rule of the shortest waves, move it by less than `STILL` all together.
    """
    speed = packed[:, :, LEVEL + 2 * level] * np.hypot(packed[:, :, TURNS_X], packed[:, :, TURNS_Y])
    those_after = speed.sum(axis=2)[:, ::-1].cumsum(axis=1)
    return np.count_nonzero(those_after >= STILL, axis=1).astype(np.int32)


def group(components: np.ndarray) -> np.ndarray:
    """(…, N) numbers as (…, groups, LANES), filled up with zeros."""
    groups = -(-components.shape[-1] // LANES)
    padded = np.zeros((*components.shape[:-1], groups * LANES))
    padded[..., : components.shape[-1]] = components
    return padded.reshape(*components.shape[:-1], groups, LANES)
