"""Prediction of replies: whether the boat receives one, and the accuracy of its fix.

The formulas are for numbers and for vectors of several AUVs alike, without function calls, which vectors do not have.
"""

from typing import Any, NamedTuple

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.positioning import acoustic_link
from usvauv.kernels.positioning.sonar import LN10, LN_TYPICAL, exponential, logarithm_of_range

LOGISTIC = 1.702  # 1/(1 + e^{−1.702 x}) is the normal distribution function within 0.01
NEVER = 3e38  # an excess that no signal has


class Signal(NamedTuple):
    """What is expected of the signals of an AUV at some height, or vectors of that, see `expected_signal`.

    Attributes:
        squared_height: of the AUV over the boat, m².
        level: logarithm of √(8 E/N0) at the slant range `sonar.TYPICAL` without the losses that follow, which are of
            that, too.
        spreading: with the logarithm of the range.
        absorption: with the range, 1/m.
        bubbles, most_bubbles: with the range, 1/m, and the most.
        threshold: least amplitude.
        phases: variance of a fix over the squared range and that of the amplitude's inverse.
        attitude: variance of a fix over the squared range by the attitude's error, rad².
        own_noise: of the boat at top speed over that of the sea.
        exponent: of the noise, `acoustic_link.NOISE_EXPONENT`.
    """

    squared_height: Any
    level: Any
    spreading: Any
    absorption: Any
    bubbles: Any
    most_bubbles: Any
    threshold: Any
    phases: Any
    attitude: Any
    own_noise: Any
    exponent: Any


SIGNAL = len(Signal._fields)


@func
def height(worlds: ti.template(), w, b, k):
    """Height of AUV k over boat b on its wave as the boat has it, m: negative. A vehicle tells its depth by replies."""
    depth = worlds.p.separation_boat + worlds.boat.elevation[w, b]
    if ti.static(worlds.program.vehicle):
        depth += worlds.body.told_depth[w, k]
    return -depth


@func
def true_height(worlds: ti.template(), w, b, k):
    """Height of AUV k over boat b on its wave, m: negative."""
    above = worlds.p.separation_boat + worlds.boat.elevation[w, b]
    return -above - worlds.auv.depth_error[w, k]


@func
def signal_of(worlds: ti.template(), k, height):
    """The numbers of `Signal` of AUV k, which is at a height over the boat, m."""
    link = ti.static(worlds.link)
    each_db = 0.05 * LN10 * link[k, acoustic_link.NOISE_EXPONENT]
    along = each_db * link[k, acoustic_link.PATHS]
    at_1m = 0.5 * ti.log(8.0 / link[k, acoustic_link.VARIANCE]) + each_db * link[k, acoustic_link.RATIO_AT_1M]
    spreading = along * link[k, acoustic_link.SPREADING] / LN10
    kappa = link[k, acoustic_link.KAPPA]
    return ti.Vector(
        [
            height * height,
            at_1m - spreading * LN_TYPICAL,
            spreading,
            0.001 * along * link[k, acoustic_link.ABSORPTION],
            along * link[k, acoustic_link.BUBBLES] / ti.max(ti.abs(height), 1e-3),
            along * acoustic_link.MOST_BUBBLES,
            acoustic_link.detection_threshold(link, k),
            8.0 / (kappa * kappa),
            link[k, acoustic_link.ATTITUDE],
            link[k, acoustic_link.OWN_NOISE],
            link[k, acoustic_link.NOISE_EXPONENT],
        ]
    )


@func
def left_by_noise(signal: ti.template(), effort):
    """Share of the energy that the boat's own noise leaves; `effort` is its speed over its top speed."""
    left = 1.0 / acoustic_link.noise_ratio(signal.own_noise, effort)
    return ti.select(signal.exponent > 1.5, left * left, left)


@func
def expected_signal(signal: ti.template(), flat, left):
    """Amplitude of an AUV's signal over the noise above the threshold, square of its slope, variance of its fix, and
    8 E/N0 in the noise of the sea only.

    The amplitude's standard deviation is 1, its slope that with the horizontal distance, 1/m; the variance is per axis,
    m².

    Args:
        signal: `Signal`. flat: squared horizontal distance from the boat to the AUV's predicted position, m².
        left: of `left_by_noise`.
    """
    squared = flat + signal.squared_height
    S = ti.sqrt(squared)
    path = ti.select(S > 1.0, S, 1.0)
    level = signal.level - signal.spreading * logarithm_of_range(path) - signal.absorption * path
    bubbles = signal.bubbles * S
    bubbles = ti.select(bubbles < signal.most_bubbles, bubbles, signal.most_bubbles)
    root = exponential(level - bubbles)
    in_the_sea = root * root
    energy = left * root * root  # 8 E/N0
    amplitude = ti.sqrt(energy + 7.0)
    inverse = 1.0 / (energy * squared * squared)
    slope = (energy * inverse) * (energy * flat)
    variance = squared * (signal.phases * (inverse * squared * squared) + signal.attitude)
    return amplitude - signal.threshold, slope, variance, in_the_sea


@func
def heard_both_ways(worlds: ti.template(), above, energy):
    """Excess of a reply's amplitude over the threshold, or at the AUV that of its interrogation if it is less.

    The AUV hears with one hydrophone, and in the sea's noise only. Both are received with the probability of the lesser
    one: where it is near 0.8, the other has nearly 1.

    Args:
        above: of the reply. energy: 8 E/N0 in the sea's noise, both of `expected_signal`.
    """
    request = ti.sqrt(0.25 * energy + 1.0) - ti.sqrt(worlds.p.request_threshold)
    return ti.select(request < above, request, above)


@func
def excess_for(worlds: ti.template(), probability) -> ti.f32:
    """Excess of an amplitude over the threshold in its standard deviations from which on a reply is received with a
    probability; NEVER where it never is.

    The standard deviation is √(1 + slope² σ²) where the AUV's place has one of σ, m.
    """
    kept = 1.0 - worlds.p.packet_loss
    odds = kept * kept / probability - 1.0
    excess = NEVER
    if odds > 0.0:
        excess = -ti.log(odds) / LOGISTIC
    return excess
