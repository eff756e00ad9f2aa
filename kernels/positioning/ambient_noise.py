"""Laws of the ambient noise of the sea.

A law is a function (frequency in Hz, shipping activity from 0 to 1, wind speed in m/s) → noise density in dB re
1 µPa²/Hz, called from Python when a scenario's constants are computed.
"""

from collections.abc import Callable

import taichi as ti

from kernels.positioning.sonar_equation import log10, power_of_10
from kernels.registry import Registry

NoiseLaw = Callable[[float, float, float], float]
ambient_noise_laws: Registry[NoiseLaw] = Registry("ambient noise law")


@ti.pyfunc
def coates(f: ti.f32, shipping: ti.f32, wind: ti.f32) -> ti.f32:
    """Turbulence, shipping, wind and thermal noise: Coates, "Underwater Acoustic Systems" (1990)."""
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
