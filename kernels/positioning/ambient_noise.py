"""Laws of the noise at a hydrophone: of the sea, of rain, of the boat itself.

A law of the ambient noise is a function (frequency in Hz, shipping activity from 0 to 1, wind speed in m/s) → noise
density in dB re 1 µPa²/Hz, called from Python when a scenario's constants are computed. Rain and the boat add to it:
`total_level` adds powers. `docs/acoustics.md` compares the laws with published tables.

Sources: Coates, "Underwater Acoustic Systems" (1990); Hodges, "Underwater Acoustics: Analysis, Design and Performance
of Sonar" (2010), chapter 7, doi 10.1002/9780470665244 (rain); Ross, "Mechanics of Underwater Noise" (1976), and
MacGillivray and de Jong, "A reference spectrum model for estimating source levels of marine shipping based on
automated identification system data", J. Mar. Sci. Eng. 9 (2021) 369, doi 10.3390/jmse9040369 (vessels).
"""

import math
from collections.abc import Callable

import numpy as np
import taichi as ti

from usvauv.kernels.positioning.sonar_equation import log10, power_of_10
from usvauv.kernels.registry import Registry

# Density of the noise of rain of 1 mm/h, dB re 1 µPa²/Hz, at frequencies in Hz; straight lines over log f between them.
RAIN_FREQUENCIES = (1e3, 2e3, 5e3, 1e4, 2e4, 5.02e4, 1e5)
RAIN_LEVELS = (52.9, 51.8, 49.0, 46.3, 43.2, 38.0, 34.1)

NoiseLaw = Callable[[float, float, float], float]
ambient_noise_laws: Registry[NoiseLaw] = Registry("ambient noise law")


@ti.pyfunc
def coates(f: ti.f32, shipping: ti.f32, wind: ti.f32) -> ti.f32:
    """Turbulence, shipping, wind and thermal noise by Coates, dB re 1 µPa²/Hz."""
    F = f / 1000.0
    log_F = log10(F)
    turbulence = 17.0 - 30.0 * log_F
    ships = 40.0 + 20.0 * (shipping - 0.5) + 26.0 * log_F - 60.0 * log10(F + 0.03)
    waves = 50.0 + 7.5 * ti.sqrt(wind) + 20.0 * log_F - 40.0 * log10(F + 0.4)
    thermal = -15.0 + 20.0 * log_F
    return 10.0 * log10(
        power_of_10(turbulence / 10.0)
        + power_of_10(ships / 10.0)
        + power_of_10(waves / 10.0)
        + power_of_10(thermal / 10.0)
    )


ambient_noise_laws.register("coates", coates)


def rain_noise(frequency: float, rate: float) -> float:
    """Noise density of rain, L = L₁(f) + 15.4 x − 2 x², x = log10 of the rate in mm/h: a fit to Hodges' table.

    The peak that small drops have at about 14 kHz as long as the wind is below some 2 m/s is not in it.

    Args:
        frequency: 1 to 100 kHz, Hz; outside as at the nearer end.
        rate: at most 200 mm/h; 1 is light, 10 heavy, 100 a cloudburst.

    Returns:
        dB re 1 µPa²/Hz; −∞ without rain.
    """
    if rate <= 0.0:
        return -math.inf
    x = math.log10(rate)
    level = float(np.interp(math.log(frequency), np.log(RAIN_FREQUENCIES), RAIN_LEVELS))
    return level + 15.4 * x - 2.0 * x**2


def boat_noise(
    frequency: float,
    speed: float,
    level: float,
    reference_frequency: float,
    reference_speed: float,
    speed_slope: float = 60.0,
    frequency_slope: float = -20.0,
) -> float:
    """Noise density of the boat's own propulsion at its array, by power laws of speed and frequency.

    Ross's 60 log10 of the speed and 20 dB less a decade of frequency are those of ships with cavitating propellers far
    above the spectrum's peak at some 50 Hz. Motors add tones that no such law has.

    Args:
        frequency: at least 1 kHz, Hz.
        speed: through the water, m/s.
        level: at the array, at `reference_frequency` (Hz) and `reference_speed` (m/s, above 0), dB re 1 µPa²/Hz.
        speed_slope: dB a decade of speed.
        frequency_slope: dB a decade of frequency.

    Returns:
        dB re 1 µPa²/Hz; −∞ at rest.
    """
    if speed <= 0.0:
        return -math.inf
    faster = speed_slope * math.log10(speed / reference_speed)
    return level + faster + frequency_slope * math.log10(frequency / reference_frequency)


def total_level(*levels: float) -> float:
    """Level of the sum of the powers of independent noises, dB; −∞ stands for none."""
    power = sum(10.0 ** (level / 10.0) for level in levels)
    return 10.0 * math.log10(power) if power > 0.0 else -math.inf
