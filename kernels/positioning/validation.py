"""Validation of a fix by what the receiver expects: its gate, and the whole turns of its phases.

Gate. An innovation ν with the covariance P + R has νᵀ(P + R)⁻¹ν distributed as χ² of two degrees of freedom, beyond
GATE with the probability e^(−GATE/2) = 10⁻³. Without a tracker the AUV can have gone `reach` from its last estimate in
any direction; of ν only what exceeds that counts.

Turns. A phase difference is measured modulo 2π. With κ > π the directions φ + 2π(m, n), |φ + 2π(m, n)| ≤ κ, are all
possible, m + n even or odd as the mean phases of the two pairs say (`usbl.odd_turns`). Of these candidates that with
the least

    min(νᵀ(P + R)⁻¹ν, 2 GATE) + (ρ − √(S² − z²))²/σ_ρ²,   σ_ρ² = S² (σ²/κ² + ε² + DEPTH_TOLERANCE²),

is taken: −2 ln of its likelihood, bounded in the first term, so that an AUV that is not where it is expected is found
by the second, by its horizontal distance ρ, which follows from its slant range S and its depth z below the array. The
receiver knows z. Where the next candidate is not worse by GATE at least, a likelihood ratio of 10³, the fix is
ambiguous and is not used.

Sources: Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to Tracking and Navigation" (2001), doi
10.1002/0471221279, §5.4 (normalised innovation squared); Bar-Shalom and Fortmann, "Tracking and Data Association"
(1988), §4 (validation gate); Teunissen, "The least-squares ambiguity decorrelation adjustment" (1995), doi
10.1007/BF00863419 (integer least squares); Verhagen and Teunissen, "The ratio test for future GNSS ambiguity
resolution" (2013), doi 10.1007/s10291-012-0299-z (best candidate against the second).
"""

import math

import numpy as np
import taichi as ti

from usvauv.kernels.positioning import acoustic_link
from usvauv.kernels.types import mat2, vec2, vec3

GATE = -2.0 * math.log(1e-3)
DEPTH_TOLERANCE = 0.01  # of the slant range: bent rays, and the error of the AUV's depth
NO_CANDIDATE = 1e30


@ti.dataclass
class Expectation:
    """Where the receiver expects an AUV.

    Attributes:
        place: horizontal offset from the array, m.
        covariance: of that, (xx, xy, yy), m².
        reach: how far from there it can have gone, m.
        separation: vertical distance to the array, m.
    """

    place: vec2
    covariance: vec3
    reach: ti.f32
    separation: ti.f32


@ti.func
def squared_innovation(expected: Expectation, fix: vec2, covariance: vec3) -> ti.f32:
    """Normalised innovation squared of a fix (m) with its covariance (xx, xy, yy) in m², beyond the reach."""
    innovation = fix - expected.place
    innovation *= ti.max(1.0 - expected.reach / ti.max(innovation.norm(), 1e-6), 0.0)
    C = expected.covariance + covariance
    return innovation.dot(mat2([[C[0], C[1]], [C[1], C[2]]]).inverse() @ innovation)


@ti.func
def cost(link: ti.template(), k: ti.i32, expected: Expectation, offset: vec3, covariance: vec3, sigma: ti.f32):
    """−2 ln of the bounded likelihood of a candidate for the fix of AUV k.

    Args:
        link: `acoustic_link.link_table`.
        offset: from array to AUV by this candidate, m. covariance: of its horizontal part, m².
        sigma: standard deviation of a phase difference, rad.
    """
    squared = squared_innovation(expected, vec2(offset[0], offset[1]), covariance)
    S2 = offset.norm_sqr()
    distance = ti.sqrt(ti.max(S2 - expected.separation * expected.separation, 0.0))
    error = vec2(offset[0], offset[1]).norm() - distance
    phase = sigma / link[k, acoustic_link.KAPPA]
    variance = S2 * (phase * phase + link[k, acoustic_link.ATTITUDE] + DEPTH_TOLERANCE * DEPTH_TOLERANCE)
    return ti.min(squared, 2.0 * GATE) + error * error / variance


@ti.func
def most_turns(link: ti.template(), k: ti.i32, length: ti.f32) -> ti.i32:
    """Largest number of turns that can be missing of a phase difference of AUV k; `length` as of `usbl.located`."""
    return ti.cast(ti.floor(0.5 * length * link[k, acoustic_link.KAPPA] / math.pi + 0.5), ti.i32)


def turns_possible(link: np.ndarray) -> bool:
    """Whether noise, or an array wider than half a wavelength, can wrap a detected fix into another real direction.

    With κ < π that takes noise of 2 (π − κ). Six standard deviations at the threshold of detection count as possible.
    """
    sigma = np.sqrt(8.0 / link[:, acoustic_link.THRESHOLD])
    return bool((link[:, acoustic_link.KAPPA] > math.pi - 3.0 * sigma).any())
