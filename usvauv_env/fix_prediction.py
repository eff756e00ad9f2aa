"""What to expect of one fix of an AUV from a place of the boat: its error, and whether it comes at all."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from usvauv.kernels.planning.information import MEASUREMENTS, tilted_batch
from usvauv.kernels.positioning import acoustic_link, fix_probability, rays, usbl

LARGEST_VARIANCE = 1e16  # m²; an axis of more than 10⁸ m is unbounded
ROUNDING = 1e-3  # relative, of variances in single precision
LEAST_GOOD = 0.9  # probability of a good fix from which on an AUV counts as located

Position = tuple[float, float, float]  # x, y and depth, m


@dataclass(frozen=True)
class FixError:
    """What to expect of one fix of an AUV.

    Attributes:
        range: slant range, m.
        major, minor: standard deviations of a good fix along the axes of the horizontal error ellipse, m; None:
            unbounded, as that of phases alone where the AUV lies in the array's plane.
        angle: of the major axis, rad, anticlockwise from east; None where an axis is unbounded.
        good: probability that the fix is good, the product of the next two.
        detected: probability that the tone is detected; 0 without a direct ray.
        good_if_detected: probability that a fix that is detected is good: no phase has wrapped, the depth is real.
        wrapped: probability that a phase of a fix that is detected has wrapped.
        direct_ray: whether a direct ray of sound leads from the AUV to the array; always, without a profile.
        signal_excess: of the tone expected over the detection threshold, dB; some −80 stands for all below.
    """

    range: float
    major: float | None
    minor: float | None
    angle: float | None
    good: float
    detected: float
    good_if_detected: float
    wrapped: float
    direct_ray: bool
    signal_excess: float

    @property
    def located(self) -> bool:
        """Whether fixes are good often enough to rely on."""
        return self.good >= LEAST_GOOD


def predict(
    link: torch.Tensor,
    layers: torch.Tensor | None,
    auvs: Sequence[Position],
    boat: tuple[float, float],
    measurement: str,
    slope: tuple[float, float],
) -> list[FixError]:
    """What to expect of one fix of every AUV from a boat.

    Args:
        link: (K, acoustic_link.COLUMNS) float32, of `usvauv.kernels.positioning.acoustic_link.link_table`.
        layers: of `usvauv.kernels.positioning.rays`, to tell whether there is a direct ray; None: always.
        auvs: position of each.
        boat: x and y, m.
        measurement: "fix" or "phase".
        slope: ∂η/∂x and ∂η/∂y of the surface that the array lies on.
    """
    count = len(auvs)
    away = [[x - boat[0], y - boat[1], -depth] for x, y, depth in auvs]
    offset = torch.tensor(away, dtype=torch.float32, device=link.device)
    index = torch.arange(count, dtype=torch.int32, device=link.device)
    slopes = offset.new_tensor(slope).expand(count, 2).contiguous()
    code = MEASUREMENTS.index(measurement)
    covariance, information, cosines = (
        part.double().cpu().numpy() for part in tilted_batch(link, index, offset, slopes, measurement=code)
    )
    sigma, excess, detected, good = reception(link, index, offset, slopes)
    rayed = np.ones(count, bool) if layers is None else direct_rays(layers, offset)
    detected = np.where(rayed, detected, 0.0)
    wrapped = np.nan_to_num(
        wrap_probability(link[:, acoustic_link.KAPPA, None].double().cpu().numpy() * cosines, sigma)
    )
    return [
        FixError(
            offset[k].double().norm().item(),
            *ellipse(covariance[k], information[k]),
            good=float(detected[k] * good[k]),
            detected=float(detected[k]),
            good_if_detected=float(good[k]),
            wrapped=float(wrapped[k]),
            direct_ray=bool(rayed[k]),
            signal_excess=float(excess[k]),
        )
        for k in range(count)
    ]


def reception(
    link: torch.Tensor, auv: torch.Tensor, offset: torch.Tensor, slope: torch.Tensor
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """How n tones are received along straight rays; arguments as for `fix_probability.good_probability`.

    The signal excess is the level over that at which a tone's expected amplitude is the detection threshold. With
    a = √8/σ, which grows by 20 log10 with the level (twice as fast under the demonstration's noise law), this amplitude
    is √(a² + 7), see `usvauv.kernels.positioning.usbl`.

    Returns:
        Four (n,) float64: standard deviation of the phase differences, rad; signal excess, dB; probability that the
        tone is detected; and that a fix that is detected is good.
    """
    sigma = usbl.fixes(link, auv, offset, slope, offset.new_zeros((len(offset), 5)))[0][:, 3]
    sigma = sigma.double().cpu().numpy()
    row = link[auv.long()].double().cpu().numpy()
    needed = np.sqrt(row[:, acoustic_link.THRESHOLD] - 7)
    excess = 20 * np.log10(math.sqrt(8) / sigma / needed) / row[:, acoustic_link.NOISE_EXPONENT]
    detected, good = (part.cpu().numpy() for part in fix_probability.good_probability(link, auv, offset, slope))
    return sigma, excess, detected, np.nan_to_num(good)  # an AUV at the array itself is in no direction


def wrap_probability(phase: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Probability that one of two normal phase differences leaves (−π, π], (K,), for expected ones (K, 2), rad."""
    inside = torch.special.ndtr(torch.from_numpy((math.pi - phase) / sigma[:, None]))
    inside -= torch.special.ndtr(torch.from_numpy((-math.pi - phase) / sigma[:, None]))
    return 1 - inside.prod(dim=1).numpy()


def direct_rays(layers: torch.Tensor, offset: torch.Tensor) -> np.ndarray:
    """Whether a direct ray leads to an array at the mean surface from offsets below it, (n, 3), m: (n,)."""
    ends = torch.stack([torch.zeros_like(offset[:, 2]), -offset[:, 2], offset[:, :2].norm(dim=1)], dim=1)
    return rays.eigenrays(layers, ends.contiguous())[:, 4].cpu().numpy() > 0


def ellipse(
    covariance: np.ndarray, information: np.ndarray
) -> tuple[float, float, float] | tuple[None, float | None, None]:
    """Standard deviations along the major and minor axis (m) and angle of the major axis (rad), see `FixError`.

    Args:
        covariance, information: (3,) xx, xy, yy in m² and 1/m², each accurate in its larger eigenvalue.
    """
    strength = _larger_eigenvalue(information)
    minor = 1 / math.sqrt(strength) if 1 / LARGEST_VARIANCE < strength < math.inf else None
    variance = _larger_eigenvalue(covariance)
    if minor is None or not minor**2 * (1 - ROUNDING) <= variance < LARGEST_VARIANCE:
        return None, minor, None
    axes = np.linalg.eigh(covariance[[0, 1, 1, 2]].reshape(2, 2))[1]
    return math.sqrt(variance), minor, math.atan2(axes[1, 1], axes[0, 1]) % math.pi


def _larger_eigenvalue(matrix: np.ndarray) -> float:
    """The larger eigenvalue of (xx, xy, yy); NaN where an entry is not finite."""
    if not np.isfinite(matrix).all():
        return math.nan
    return float(np.linalg.eigvalsh(matrix[[0, 1, 1, 2]].reshape(2, 2))[1])
