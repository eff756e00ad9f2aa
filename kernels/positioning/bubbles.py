"""Loss of sound in the bubbles that breaking waves leave below the surface.

Source: "APL-UW High-Frequency Ocean Environmental Acoustic Models Handbook", Technical Report APL-UW TR 9407 (1994),
Eqs. 28a and 28b of part II; with an exponential profile over depth, as public implementations have it of Dahl,
"Revisions and notes on a model for bubble attenuation in near-surface propagation", APL-UW (1994), DTIC ADA290312.
"""

import math

BREAKING = 6.0  # m/s, the wind from which waves break
LAYER_PER_WIND = 0.07  # s, e-folding depth of the bubbles over the wind


def vertical_bubble_loss(frequency: float, wind: float) -> float:
    """Loss on the way straight up through all bubbles to the surface, dB: half the handbook's, which counts both ways.

    Args:
        frequency: the fit is to data of 20 to 40 kHz, within 3 dB both ways, Hz.
        wind: at 10 m, m/s.
    """
    law = max(wind, BREAKING) ** 1.57 * math.exp(1.2 * min(wind - BREAKING, 0.0))
    return 0.63e-3 * law * (frequency / 1000.0) ** 0.85


def bubble_loss(frequency: float, wind: float, grazing: float, depth: float) -> float:
    """Loss of a ray that comes from below the bubbles to a receiver among them, one way.

    The attenuation decreases with depth as exp(−z/L), L = 0.07 U, and the ray is straight: the loss is
    `vertical_bubble_loss` times exp(−d/L)/sin θ.

    Args:
        frequency: as for `vertical_bubble_loss`, Hz.
        wind: at 10 m, m/s.
        grazing: angle θ between ray and surface, above 0, rad; below some 5° refraction in the bubbles matters.
        depth: d of the receiver below the surface over it, which the bubbles follow, m.

    Returns:
        dB.
    """
    if wind <= 0.0:
        return 0.0
    share = math.exp(-depth / (LAYER_PER_WIND * wind))
    return vertical_bubble_loss(frequency, wind) * share / math.sin(grazing)
