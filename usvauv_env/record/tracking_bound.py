"""Least error with which a moving target can be tracked from ranges or bearings: the posterior Cramér–Rao bound.

The target's velocity is nearly constant. In a step T,

    v ← v + w,   x ← x + T v,   w ~ N(0, q² I),   so that s = (x, v) ← F s + noise of the covariance Q,

as in `usvauv.kernels.tracking.range_filter` between turns. No estimator has a mean squared error below J⁻¹, where

    J ← (Q + F J⁻¹ Fᵀ)⁻¹ + E[information of the step's measurements],

the expectation over the ways of target and observers. A target that turns besides is harder to track, so that the bound
holds for it too, but is not reached.

Of one observer at the horizontal distance r in the direction u, e across it, and at a known difference of depth h,

    range of deviation σ:     r²/(r² + h²) u uᵀ/σ²,
    bearing of deviation σ:   e eᵀ/(r² σ²).

Of N ranges of the same σ, tr J = N/σ² wherever observers are, so that det J ≤ N²/(4σ⁴), with equality where J is a
multiple of the identity: directions φ with Σ e^{2iφ} = 0, as N ≥ 3 equally spaced ones, or two at right angles; the rms
error is then 2σ/√N. Ranges do not get better near the target as long as h ≪ r; bearings do, their rms error is 2σr/√N.

Of a target of unknown depth, ranges from observers spaced so at the surface have J = (r²/2, r²/2, h²) N/((r² + h²) σ²)
on the diagonal. Its determinant is greatest, and the trace of its inverse least, at r = √2 h.

Source: Tichavský, Muravchik and Nehorai, "Posterior Cramér–Rao bounds for discrete-time nonlinear filtering", IEEE
Trans. Signal Processing 46 (1998), doi 10.1109/78.668800, Eq. 21 with linear motion.
"""

import numpy as np

Array = np.ndarray


def range_information(observers: Array, target: Array, deviation: float, depth: float | Array = 0.0) -> Array:
    """Information of one range on a target's place, 1/m².

    Args:
        observers: (..., n) places, m; n = 2, or 3 with the depth where that of the target is not known.
        target: (..., n), m.
        deviation: σ of the (slant) range, m.
        depth: known difference of depth, h, m, where n = 2; broadcast to (...).

    Returns:
        (..., n, n); 0 where the observer is straight above a target of known depth.
    """
    way = target - observers
    squared = (way**2).sum(-1) + np.square(depth)
    share = np.divide(1, squared, where=squared > 0, out=np.zeros_like(squared)) / deviation**2
    return share[..., None, None] * way[..., :, None] * way[..., None, :]


def bearing_information(observers: Array, target: Array, deviation: float) -> Array:
    """Information of one bearing of the deviation σ (rad) on a target's horizontal position, 1/m²; see
    `range_information`. An observer straight above the target, where it has none, is not allowed.
    """
    way = target - observers
    across = np.stack([-way[..., 1], way[..., 0]], -1) / (way**2).sum(-1)[..., None]
    return across[..., :, None] * across[..., None, :] / deviation**2


def tracking_bound(information: Array, start: Array, step: float, walk: float) -> Array:
    """Posterior Cramér–Rao bound of a target's position, velocity and, where it is not known, depth after each step.

    Args:
        information: (T, n, n) of all measurements of a step, summed over observers and averaged over runs, 1/m². One of
            which a share is lost counts with the probability that it arrives. n = 2, or 3 where depth is not known.
        start: (n + 2, n + 2) covariance of position (m), velocity (m/s) and depth (m) before the first step, positive
            definite.
        step: T, s. walk: q, m/s.

    Returns:
        (T, n + 2, n + 2) least covariance of the errors; the root of the first two diagonal numbers' sum is the rms
        error of the position, m. Leading axes of `information`, as (R, T, n, n) of single runs, stay.
    """
    steps, size = information.shape[-3], len(start)
    F, Q = np.eye(size), np.zeros((size, size))
    F[:4, :4] = np.kron([[1.0, step], [0.0, 1.0]], np.eye(2))
    Q[:4, :4] = walk**2 * np.kron([[step**2, step], [step, 1.0]], np.eye(2))
    place = np.array([0, 1, 4])[: information.shape[-1]]
    bounds = np.empty((*information.shape[:-3], steps, size, size))
    covariance = np.broadcast_to(start, (*information.shape[:-3], size, size))
    for n in range(steps):
        J = np.linalg.inv(F @ covariance @ F.T + Q)
        J[..., place[:, None], place] += information[..., n, :, :]
        covariance = np.linalg.inv(J)
        bounds[..., n, :, :] = covariance
    return bounds


def rms(bound: Array) -> Array:
    """Root mean square error of the position, m, of covariances (..., 4, 4) or (..., 2, 2)."""
    return np.sqrt(bound[..., 0, 0] + bound[..., 1, 1])
