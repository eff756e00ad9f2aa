"""What a reply of an AUV would be worth: whether the boat would hear it, and how good its fix would be."""

import taichi as ti

from usvauv.kernels.mission.columns import BoatColumn, EstimateColumn, Parameter
from usvauv.kernels.positioning import acoustic_link
from usvauv.kernels.types import vec2, vec3

LOGISTIC = 1.702  # 1/(1 + e^{−1.702 x}) is the normal distribution function within 0.01


@ti.func
def reply(worlds: ti.template(), k, offset: vec3, effort, spread) -> vec2:
    """Probability that a reply of AUV k is heard, and the variance per axis (m²) of its fix.

    Args:
        offset: from the boat to where the AUV is foreseen, m. effort: the boat's speed over its top speed.
        spread: variance per axis of that place, m².
    """
    link = ti.static(worlds.link)
    S = offset.norm()
    loss = acoustic_link.further_loss(link, k, offset, effort)
    sigma = acoustic_link.phase_deviation(link, k, S, loss)
    strength = 2.8284271 / sigma  # √(8 E/N0)
    root = ti.sqrt(strength * strength + 7.0)
    slope = strength * offset.xy.norm() / (S * S)  # of that root with the horizontal distance, 1/m
    margin = (root - acoustic_link.detection_threshold(link, k)) / ti.sqrt(1.0 + slope * slope * spread)
    kept = 1.0 - worlds.p[Parameter.packet_loss]
    across = sigma * S / link[k, acoustic_link.KAPPA]
    tilted = link[k, acoustic_link.ATTITUDE] * S * S
    return vec2(kept * kept / (1.0 + ti.exp(-LOGISTIC * margin)), across * across + tilted)


@ti.func
def worth(worlds: ti.template(), w, b, k) -> ti.f32:
    """Variance per axis (m²) that a reply of AUV k is expected to take off what boat b knows: P a²/(a + r).

    P is the probability that it is heard from where the boat takes the AUV to be, a the variance of that place, r the
    variance of the fix.
    """
    estimate = ti.static(worlds.estimate)
    a = 0.5 * (estimate[w, k, EstimateColumn.covariance_xx] + estimate[w, k, EstimateColumn.covariance_yy])
    dx = estimate[w, k, EstimateColumn.x] - worlds.boat[w, b, BoatColumn.x]
    dy = estimate[w, k, EstimateColumn.y] - worlds.boat[w, b, BoatColumn.y]
    z = -(worlds.p[Parameter.separation_boat] + worlds.boat[w, b, BoatColumn.elevation])
    expected = reply(worlds, k, vec3(dx, dy, z), 1.0, a)
    return expected[0] * a * a / (a + expected[1])
