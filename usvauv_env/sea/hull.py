"""What waves do to a floating hull: by how much it follows their elevation and slope, and the resistance that they add.

A hull with a water plane of length L and beam B, draught T, in a wave of amplitude a and wave number k, is taken as the
plane that fits the wave over the water plane best, times the dynamics of a box-shaped hull, alike in heave and pitch,

    κ q,   q = (1 − kT + i c/α³)/(1 − 2 kT α² + i c/α²),   c = (2 sin(½ kB α²) e^{−kTα²})²/(kB),   κ = e^{−kT}:

the Smith effect, added mass as large as the hull's own, and damping by the waves that it radiates, by Jensen, Mansour
and Olsen (2004), "Estimation of ship motions using closed-form expressions", doi 10.1016/S0029-8018(03)00108-2. There
α = 1 + Fn √(kL) in head seas, 1 at rest. Their forcing functions of heave and pitch are this plane where B is 0. The
Smith effect alone would be less by kT, which inertia makes up for: a hull much shorter than the waves follows them.

`motion` is that of a hull at rest, at a heading that is not known: the root mean square over all of them. So it has no
speed, no phase, no coupling of heave and pitch, and roll follows the slope without resonance. Waves shorter than the
hull, which would add at most 6 % to the variance of the tilt, are left out (`Scenario.shortest_wave`).

The added resistance is the energy that the hull radiates per way, by Gerritsma and Beukelman (1972), "Analysis of the
resistance increase in waves of a fast cargo ship", International Shipbuilding Progress 19(217), 285–293,

    R/a² = k/(2 ω_e) ∫ b' |V_z|² dx,   b' = ρ g² (2 sin(½ kB α²) e^{−kTα²})²/ω_e³,

with the vertical velocity V_z of each section relative to the wave's, ω_e = ω + kV, in head seas, which are the worst,
at any heading. It is a theory for slender hulls of any size, unlike formulas fitted to ships of 75 m and more. Model
tests confirm it at Froude numbers up to 0.3; fast boats are beyond. Reflection by the bow of waves shorter than half
the hull, slamming and wind are left out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from usvauv.kernels.vehicles.otter_numbers import SEA_WATER

HEADINGS = 32  # of a quarter turn, between which the water plane is symmetric
WAVES = 128  # for each factor of e, at which motion is computed, between which it is linear
SECTIONS = 16  # along the hull, of Gauss and Legendre
SMALL = 1e-2  # ½ kL from which on a function is not its series


class Hull(NamedTuple):
    """A hull: length, beam (over all hulls) and draught, m."""

    length: float
    beam: float
    draught: float

    def motion(self, k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Elevation and tilt at rest over elevation and slope of waves of wave numbers k > 0 (rad/m), each like k.

        The tilt has the direction of the slope.
        """
        if not k.size:
            return k, k
        first, last = np.floor(WAVES * np.log(k.min())), np.ceil(WAVES * np.log(k.max()))
        table = np.exp(np.arange(first, last + 1) / WAVES)  # the same whichever seas are together
        heading = (np.arange(HEADINGS) + 0.5) / HEADINGS * np.pi / 2
        along = 0.5 * self.length * np.outer(table, np.cos(heading))
        across = 0.5 * self.beam * np.outer(table, np.sin(heading))
        size = np.abs(self._dynamics(table, 1.0))
        heave = np.mean((_mean(along) * _mean(across)) ** 2, axis=1)
        pitch, roll = np.cos(heading) * _slope(along) * _mean(across), np.sin(heading) * _mean(along) * _slope(across)
        tilt = np.mean(pitch**2 + roll**2, axis=1)
        return np.interp(k, table, size * np.sqrt(heave)), np.interp(k, table, size * np.sqrt(tilt))

    def added_resistance(self, k: np.ndarray, omega: np.ndarray, speed: float, gravity: float) -> np.ndarray:
        """Mean added resistance in head seas over the square of the wave's amplitude, N/m², like k.

        Args:
            k, omega: of the waves, rad/m and rad/s. speed: through the water, m/s. gravity: g, m/s².
        """
        alpha = 1 + speed * np.sqrt(k / gravity)
        encounter = omega + k * speed
        x, weight = np.polynomial.legendre.leggauss(SECTIONS)
        x, weight = 0.5 * self.length * x, 0.5 * self.length * weight
        wave = np.exp(1j * np.outer(k, x))
        forced, half = self._dynamics(k, alpha), 0.5 * k * self.length
        heave, pitch = forced * _mean(half), 1j * k * forced * _slope(half)
        hull = encounter[:, None] * (heave[:, None] + np.outer(pitch, x)) + 1j * speed * pitch[:, None]
        relative = np.abs(hull - (omega * np.exp(-k * self.draught))[:, None] * wave)
        damping = SEA_WATER * gravity**2 * self._radiated(k, alpha) ** 2 / encounter**3
        return k / (2 * encounter) * damping * (relative**2 @ weight)

    def _radiated(self, k: np.ndarray, alpha: np.ndarray | float) -> np.ndarray:
        """Amplitude of the waves that a section radiates over that of its motion; for short waves at its greatest."""
        angle = np.minimum(0.5 * k * self.beam * np.square(alpha), np.pi / 2)
        return 2 * np.sin(angle) * np.exp(-k * self.draught * np.square(alpha))

    def _dynamics(self, k: np.ndarray, alpha: np.ndarray | float) -> np.ndarray:
        """κ q."""
        depth, damping = k * self.draught, self._radiated(k, alpha) ** 2 / (k * self.beam)
        alpha = np.asarray(alpha)
        forced = 1 - depth + 1j * damping / alpha**3
        return np.exp(-depth) * forced / (1 - 2 * depth * alpha**2 + 1j * damping / alpha**2)


def _mean(x: np.ndarray) -> np.ndarray:
    """Mean elevation of a wave over a length L, over its elevation in the middle; x = ½ kL."""
    return np.sinc(x / np.pi)


def _slope(x: np.ndarray) -> np.ndarray:
    """Slope of the line that fits it best over L, over that in the middle: 3 (sin x − x cos x)/x³."""
    large = np.maximum(np.abs(x), SMALL)
    return np.where(np.abs(x) < SMALL, 1 - x**2 / 10, 3 * (np.sin(large) - large * np.cos(large)) / large**3)
