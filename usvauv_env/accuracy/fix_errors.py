"""Predicted quality of a fix of an AUV from a place of the boat: its error by cause, and its probability."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from usvauv.env.record.trace import Trace
from usvauv.env.scenario.scenario import Scenario
from usvauv.env.site.site import Site
from usvauv.env.world import mission_parameters
from usvauv.kernels import runtime
from usvauv.kernels.planning import objectives, search
from usvauv.kernels.planning.information import FIX, MEASUREMENTS, tilted_batch
from usvauv.kernels.positioning import acoustic_link, rays, usbl
from usvauv.kernels.positioning.acoustic_link import KAPPA

LARGEST_VARIANCE = 1e16  # m²; an axis of more than 10⁸ m is unbounded
ROUNDING = 1e-3  # relative, of variances in single precision
LEAST_GOOD = 0.9  # probability of a good fix from which on an AUV counts as located
ERRORS = {
    "pitch and roll": acoustic_link.ATTITUDE,
    "alignment": acoustic_link.ALIGNMENT,
    "heading": acoustic_link.HEADING,
    "speed of sound": acoustic_link.SOUND_SPEED,
    "lever arm": acoustic_link.POSITION,
    "boat's position": acoustic_link.POSITION,
}
COLUMNS = sorted(set(ERRORS.values()))
SUM = "all"
QUIET = 300.0  # dB by which noise is lowered to leave it out

Position = tuple[float, float, float]  # x, y and depth, m


@dataclass(frozen=True)
class FixError:
    """Predicted quality of one fix of an AUV.

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


def _seen_from(
    boat: tuple[float, float], auvs: Sequence[Position], slope: tuple[float, float], link: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Row of the link table (n,), offset from the boat (n, 3), m, and slope of the surface (n, 2) of n AUVs."""
    away = [[x - boat[0], y - boat[1], -depth] for x, y, depth in auvs]
    offset = torch.tensor(away, dtype=torch.float32, device=link.device)
    row = torch.arange(len(auvs), dtype=torch.int32, device=link.device) % len(link)
    return row, offset, offset.new_tensor(slope).expand(len(auvs), 2).contiguous()


def predict(
    link: torch.Tensor,
    layers: torch.Tensor | None,
    auvs: Sequence[Position],
    boat: tuple[float, float],
    measurement: str,
    slope: tuple[float, float],
) -> list[FixError]:
    """Predicted quality of one fix of every AUV from a boat.

    Args:
        link: (K, acoustic_link.COLUMNS) float32, of `usvauv.kernels.positioning.acoustic_link.link_table`.
        layers: of `usvauv.kernels.positioning.rays`, to tell whether there is a direct ray; None: always.
        auvs: position of each.
        boat: x and y, m.
        measurement: "fix" or "phase".
        slope: ∂η/∂x and ∂η/∂y of the surface that the array lies on.
    """
    count = len(auvs)
    index, offset, slopes = _seen_from(boat, auvs, slope, link)
    code = MEASUREMENTS.index(measurement)
    covariance, information, cosines = (
        part.double().cpu().numpy() for part in tilted_batch(link, index, offset, slopes, measurement=code)
    )
    sigma, excess, detected, good = reception(link, index, offset, slopes)
    rayed = np.ones(count, bool) if layers is None else direct_rays(layers, offset)
    detected = np.where(rayed, detected, 0.0)
    wrapped = np.nan_to_num(wrap_probability(link[index.long(), KAPPA, None].double().cpu().numpy() * cosines, sigma))
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
    """How n signals are received along straight rays; arguments as for `usbl.fixes`.

    The signal excess is the level over that at which a signal's expected amplitude is the detection threshold. With
    a = √8/σ, which grows by 20 log10 with the level (twice as fast under the demonstration's noise law), this amplitude
    is √(a² + 7), see `usvauv.kernels.positioning.usbl`. A detected fix is good where it has not wrapped and has a real
    depth: the probability that normal phase differences lie inside the square |φ_x|, |φ_y| < π and the circle |φ| < κ,
    by Gauss–Legendre quadrature along x.

    Returns:
        Four (n,) float64: standard deviation of the phase differences, rad; signal excess, dB; probability that the
        signal is detected; and that a fix that is detected is good, 0 for an AUV at the array itself.
    """
    sigma = usbl.fixes(link, auv, offset, slope, offset.new_zeros((len(offset), 5)))[0][:, 3].double()
    row = link.double()[auv.long()]
    threshold = row[:, acoustic_link.THRESHOLD]
    strength = math.sqrt(8.0) / sigma
    detected = torch.special.ndtr(torch.sqrt(strength**2 + 7) - torch.sqrt(threshold))
    relative = (strength / torch.sqrt(threshold - 7)).cpu().numpy()
    excess = 20 * np.log10(relative) / row[:, acoustic_link.NOISE_EXPONENT].cpu().numpy()

    x, y, z = offset.double().unbind(1)
    pitch = torch.atan(slope[:, 0].double())
    roll = torch.atan(slope[:, 1].double() * pitch.cos())
    up = z * pitch.cos() - x * pitch.sin()
    S = offset.double().norm(dim=1)
    kappa = row[:, KAPPA]
    centre = kappa / S * torch.stack([x * pitch.cos() + z * pitch.sin(), y * roll.cos() + up * roll.sin()])
    node, weight = np.polynomial.legendre.leggauss(64)
    node, weight = (torch.from_numpy(part).to(offset.device)[:, None] for part in (node, weight))
    half = kappa.clamp(max=math.pi)
    low = ((-half - centre[0]) / sigma).clamp(-8, 8)
    high = ((half - centre[0]) / sigma).clamp(-8, 8)
    n = low + (high - low) * 0.5 * (1 + node)
    top = torch.sqrt((kappa**2 - (centre[0] + sigma * n) ** 2).clamp(min=0)).clamp(max=math.pi)
    within = torch.special.ndtr((top - centre[1]) / sigma) - torch.special.ndtr((-top - centre[1]) / sigma)
    density = torch.exp(-0.5 * n * n) / math.sqrt(2 * math.pi)
    good = (0.5 * (high - low) * weight * density * within).sum(0).clamp(max=1.0)
    return sigma.cpu().numpy(), excess, detected.cpu().numpy(), np.nan_to_num(good.cpu().numpy())


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


def error_budget(
    scenario: Scenario,
    link: torch.Tensor,
    auvs: Sequence[Position],
    boat: tuple[float, float],
    measurement: str,
    slope: tuple[float, float],
) -> dict[str, list[float]]:
    """Horizontal rms error (m) of a good fix of each AUV, by cause: "noise", `ERRORS` and `SUM`.

    Args:
        link: of `usvauv.env.world.mission_parameters.link_table`.
        auvs, boat, measurement, slope: as for `predict`.
    """

    def rms(changed: torch.Tensor) -> list[float]:
        index, offset, slopes = _seen_from(boat, auvs, slope, link)
        code = MEASUREMENTS.index(measurement)
        variance = tilted_batch(changed, index, offset, slopes, measurement=code)[0].double()
        return (variance[:, 0] + variance[:, 2]).sqrt().tolist()

    exact = link.clone()
    exact[:, COLUMNS] = 0.0
    found = {"noise": rms(exact)}
    exact[:, acoustic_link.RATIO_AT_1M] += QUIET
    shares = {"lever arm": scenario.usbl.lever_arm_error, "boat's position": scenario.usbl.gnss_error}
    without = rms(exact)
    for name, column in ERRORS.items():
        alone = exact.clone()
        alone[:, column] = link[:, column] if name not in shares else shares[name] ** 2
        found[name] = [math.sqrt(max(a * a - b * b, 0.0)) for a, b in zip(rms(alone), without, strict=True)]
    found[SUM] = rms(link)
    return found


def best_variance(trace: Trace) -> np.ndarray:
    """Variance per horizontal axis of fixes from the best place at every moment, (T, W, K), m²: the mean of both axes'.

    What no path of the boat can beat: a fix's error is taken as normal with the covariance J⁻¹ of the whole fix (phases
    and delay, all errors) by a level array at the place that is D-optimal for the true positions. Where fixes have no
    errors in common it is the bound of a single fix: a tracker, which remembers, can be better, and a moving AUV whose
    sound takes time is worse.
    """
    scenario = trace.scenario
    link = torch.from_numpy(mission_parameters.link_table(Site(scenario))).to(runtime.start().device)
    steps, worlds, auvs = trace.power.shape
    surface = np.take_along_axis(trace.boat_surface[..., 0], trace.served_by.astype(np.intp), axis=-1)
    separation = scenario.auv.depth + surface
    layout = np.concatenate([trace.auv_position, separation[..., None]], -1).reshape(-1, auvs, 3).astype(np.float32)
    points = torch.from_numpy(layout).to(link.device)
    width, length = scenario.area.width, scenario.area.length
    code = objectives.objective_code("fix", "d")
    best = search.plan_batch(link, points, code=code, width=width, length=length)[:, None, :2]
    away = torch.cat([points[..., :2] - best, -points[..., 2:]], -1).reshape(-1, 3).contiguous()
    index = torch.arange(auvs, dtype=torch.int32, device=link.device).repeat(steps * worlds)
    covariance, _, _ = tilted_batch(link, index, away, torch.zeros_like(away[:, :2]), measurement=FIX)
    return covariance[:, [0, 2]].double().mean(1).cpu().numpy().reshape(steps, worlds, auvs)


def median_of_normals(variance: np.ndarray) -> float:
    """Median length of plane normal vectors of the variances per axis (n,): ½ = mean(1 − exp(−m²/2v))."""
    low, high = 0.0, 10 * float(np.sqrt(variance.max()))
    for _ in range(60):
        m = (low + high) / 2
        low, high = (m, high) if np.mean(-np.expm1(-0.5 * m * m / variance)) < 0.5 else (low, m)
    return m
