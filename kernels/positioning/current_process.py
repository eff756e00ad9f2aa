"""The current at a moving AUV as an Ornstein–Uhlenbeck process, for the tracker.

The current of a moving AUV is not an Ornstein–Uhlenbeck process but a sum of eddies it passes through, orbital motion
and long waves, each smooth. For a filter with the memory m only its mean square increment D(m) matters. So the model is
the random walk with that increment, q = D(m)/m, at the filter's own memory m = (R t_fix/q)^¼: that of the stationary
filter, whose characteristic polynomial is s⁴ + q/(R t_fix). σ² is the variance of all parts and τ = 2σ²/q; σ² bounds
the variance of the current while fixes are lost. See `ornstein_uhlenbeck`.

Source: Uhlenbeck and Ornstein (1930), doi 10.1103/PhysRev.36.823.
"""

import math
from collections.abc import Sequence

import numpy as np

from usvauv.kernels.flow import airy

FOREVER = 1e9  # s, correlation time of a current that does not change


def eddies(
    count: int, circulation: tuple[float, float], core_radius: tuple[float, float], area: float, speed: float
) -> tuple[float, float]:
    """Variance per axis (m²/s²) and frequency (rad/s) of the current along a path through random Lamb–Oseen vortices.

    Of N vortices with |Γ| and δ uniform between limits and centres spread over an area a, the vorticity has the mean
    square N E[Γ²] E[1/δ²]/(2π a), and a quarter of that is the mean square per axis of the change of velocity a metre.
    The variance is that within a disc of the same area round each, N E[Γ²] (ln(a/(πδ²)) + 0.5772 − ln 2)/(8π a).

    Args:
        count: N. circulation, core_radius: limits of |Γ| (m²/s) and δ (m). area: m².
        speed: of the AUV over ground, m/s.
    """
    low, high = circulation
    strength = count * (low * low + low * high + high * high) / 3.0 / area
    delta2 = core_radius[0] * core_radius[1]  # 1/E[1/δ²]
    variance = strength * max(math.log(area / (math.pi * delta2)) + 0.5772 - math.log(2.0), 0.1) / (8.0 * math.pi)
    change = speed * speed * strength / (8.0 * math.pi * delta2)
    return variance, math.sqrt(change / variance) if variance > 0.0 else 0.0


def orbital_motion(
    omega: np.ndarray, S: np.ndarray, significant_height: float, z: float, depth: float, gravity: float
) -> tuple[float, float]:
    """Variance per axis (m²/s²) and mean square frequency's root (rad/s) of the orbital velocity of short waves at z.

    Args:
        omega, S: frequencies (rad/s), evenly spaced, and spectral density up to a factor, (n,).
        significant_height: Hs = 4 √m0, m. z: level, −h ≤ z ≤ 0, m. depth: h, m. gravity: g, m/s².
    """
    orbital = (omega * airy.decay(airy.wavenumber(omega, depth, gravity), z, depth)[0]) ** 2 * S
    variance = 0.5 * (significant_height / 4.0) ** 2 * orbital.sum() / S.sum()
    return float(variance), float(math.sqrt((omega**2 * orbital).sum() / orbital.sum()))


def standing_waves(
    rms: float, modes: int, length: float, depth: float, gravity: float, drag: float, duration: float
) -> tuple[float, float]:
    """Variance per axis (m²/s²) and frequency (rad/s) of the current in shallow standing waves, a mission's mean.

    Mean kinetic energy equals mean potential energy, half of that at the crests: g rms²/(4h) per axis. All numbers of
    half waves from 0 to `modes` are equally likely in both axes, so (π/L)² modes (2 modes + 1)/3 is the mean of k².
    Under linear drag r energy decays as e^{−rt}.

    Args:
        rms: elevation at the crests, m. length: L of the area, m. depth: h, m. gravity: g, m/s².
        drag: r, 1/s. duration: of the mission, s.
    """
    left = -math.expm1(-drag * duration) / (drag * duration) if drag > 0.0 else 1.0
    k = math.pi / length * math.sqrt(modes * (2.0 * modes + 1.0) / 3.0)
    return 0.25 * gravity / depth * rms * rms * left, k * math.sqrt(gravity * depth)


def ornstein_uhlenbeck(
    parts: Sequence[tuple[float, float]], fix_variance: float, interval: float
) -> tuple[float, float]:
    """The current's variance σ² (m²/s²) and correlation time τ (s) for the tracker.

    D(m) = Σ 2 s² (1 − e^{−(ωm)²/2}) over the parts; q = D(m)/m with the memory m = (R t_fix/q)^¼, by bisection.

    Args:
        parts: variance s² per axis (m²/s²) and root mean square frequency ω (rad/s) of each part of the current.
        fix_variance: R per axis, m². interval: t_fix, s, between fixes.
    """
    variance = float(sum(s2 for s2, _ in parts))

    def walk(m: float) -> float:
        return sum(-2.0 * s2 * math.expm1(-0.5 * (omega * m) ** 2) for s2, omega in parts) / m

    low, high = 1e-3, 1e6
    for _ in range(80):
        m = math.sqrt(low * high)
        # m⁴ q(m) = m³ D(m) grows with m.
        low, high = (m, high) if m**4 * walk(m) < fix_variance * interval else (low, m)
    q = walk(low)
    return variance, 2.0 * variance / q if q > 0.0 else FOREVER
