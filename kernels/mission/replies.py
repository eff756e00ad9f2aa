"""Prediction of replies: the probability that the boat receives one, and the accuracy of its fix."""

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.mission.columns import Parameter
from usvauv.kernels.positioning import acoustic_link
from usvauv.kernels.types import vec2, vec3

LOGISTIC = 1.702  # 1/(1 + e^{−1.702 x}) is the normal distribution function within 0.01
NEVER = 3e38  # an excess that no signal has


@func
def expected_signal(worlds: ti.template(), k, offset: vec3, loss, spread) -> vec2:
    """Excess of the amplitude of AUV k's signal over the threshold in its standard deviations, and the variance per
    axis (m²) of its fix.

    Args:
        offset: from the boat to the AUV's predicted position, m. loss: as of `phase_deviation`, dB.
        spread: variance per axis of that place, m².
    """
    link = ti.static(worlds.link)
    S = offset.norm()
    sigma = acoustic_link.phase_deviation(link, k, S, loss)
    strength = 2.8284271 / sigma  # √(8 E/N0)
    root = ti.sqrt(strength * strength + 7.0)
    slope = strength * offset.xy.norm() / (S * S)  # of that root with the horizontal distance, 1/m
    margin = (root - acoustic_link.detection_threshold(link, k)) / ti.sqrt(1.0 + slope * slope * spread)
    across = sigma * S / link[k, acoustic_link.KAPPA]
    tilted = link[k, acoustic_link.ATTITUDE] * S * S
    return vec2(margin, across * across + tilted)


@func
def expected_reply(worlds: ti.template(), k, offset: vec3, effort, spread) -> vec2:
    """Probability that a reply of AUV k is received, and the variance per axis (m²) of its fix.

    Args:
        offset, spread: as of `expected_signal`. effort: the boat's speed over its top speed.
    """
    loss = acoustic_link.loss_in_bubbles(worlds.link, k, offset)
    loss += acoustic_link.loss_in_own_noise(worlds.link, k, effort)
    signal = expected_signal(worlds, k, offset, loss, spread)
    kept = 1.0 - worlds.p[Parameter.packet_loss]
    return vec2(kept * kept / (1.0 + ti.exp(-LOGISTIC * signal[0])), signal[1])


@func
def excess_for(worlds: ti.template(), probability) -> ti.f32:
    """Excess of `expected_signal` from which on a reply is received with a probability; NEVER where it never is."""
    kept = 1.0 - worlds.p[Parameter.packet_loss]
    odds = kept * kept / probability - 1.0
    excess = NEVER
    if odds > 0.0:
        excess = -ti.log(odds) / LOGISTIC
    return excess
