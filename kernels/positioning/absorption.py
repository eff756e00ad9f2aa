"""Laws of the absorption of sound in sea water.

A law is a function (frequency in Hz, `Water`) → absorption coefficient α in dB/km, called from Python, in double
precision, when tables are made. Kernels call `thorp` alone, which takes no water. `docs/acoustics.md` compares them.

Sources: Thorp, "Analytic description of the low-frequency attenuation coefficient", J. Acoust. Soc. Am. 42 (1967) 270,
doi 10.1121/1.1910566; Francois and Garrison, "Sound absorption based on ocean measurements", parts I and II, ibid. 72
(1982) 896, doi 10.1121/1.388170, and 1879, doi 10.1121/1.388673; Ainslie and McColm, "A simplified formula for viscous
and chemical absorption in sea water", ibid. 103 (1998) 1671, doi 10.1121/1.421258.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import taichi as ti

from usvauv.kernels.registry import Registry


class Water(NamedTuple):
    """Sea water, as far as it absorbs sound.

    Attributes:
        temperature: °C.
        salinity: practical, 1.
        ph: pH on the NBS scale, 1.
        depth: below the surface, m; for a path its mean.
    """

    temperature: float = 10.0
    salinity: float = 35.0
    ph: float = 8.0
    depth: float = 0.0


AbsorptionLaw = Callable[[float, Water], float]
absorption_laws: Registry[AbsorptionLaw] = Registry("absorption law")


@ti.pyfunc
def thorp(f: ti.f32) -> ti.f32:
    """Thorp's absorption coefficient α at frequency f (Hz), dB/km; fitted for about 100 Hz to 50 kHz, at 4 °C."""
    F = (f / 1000.0) * (f / 1000.0)
    return 0.11 * F / (1.0 + F) + 44.0 * F / (4100.0 + F) + 2.75e-4 * F + 0.003


def relaxation(f: float, corner: float) -> float:
    """Absorption of a relaxation of the frequency `corner` over its absorption per kHz far below; both in kHz."""
    return corner * f**2 / (corner**2 + f**2)


def francois_garrison(frequency: float, water: Water) -> float:
    """Absorption by boric acid, magnesium sulphate and water, part II, Eqs. 1 to 8.

    Args:
        frequency: 200 Hz to 1 MHz.
        water: to 5 % for −2 to 22 °C, salinity 30 to 35 and to 3500 m, from 10 to 500 kHz; above 500 kHz, where
            magnesium sulphate matters less, for 0 to 30 °C, salinity 0 to 40 and to 10 km.

    Returns:
        α, dB/km.
    """
    T, S, ph, z = water
    f = frequency / 1000.0
    kelvin = T + 273.0
    c = 1412.0 + 3.21 * T + 1.19 * S + 0.0167 * z  # speed of sound, m/s

    boric = 8.86 / c * 10.0 ** (0.78 * ph - 5.0)
    boric_corner = 2.8 * math.sqrt(S / 35.0) * 10.0 ** (4.0 - 1245.0 / kelvin)

    sulphate = 21.44 * S / c * (1.0 + 0.025 * T) * (1.0 - 1.37e-4 * z + 6.2e-9 * z**2)
    sulphate_corner = 8.17 * 10.0 ** (8.0 - 1990.0 / kelvin) / (1.0 + 0.0018 * (S - 35.0))

    if T <= 20.0:
        viscous = 4.937e-4 - 2.59e-5 * T + 9.11e-7 * T**2 - 1.5e-8 * T**3
    else:
        viscous = 3.964e-4 - 1.146e-5 * T + 1.45e-7 * T**2 - 6.5e-10 * T**3
    viscous *= 1.0 - 3.83e-5 * z + 4.9e-10 * z**2

    return boric * relaxation(f, boric_corner) + sulphate * relaxation(f, sulphate_corner) + viscous * f**2


def ainslie_mccolm(frequency: float, water: Water) -> float:
    """The same three terms with fewer constants: within 10 % of Francois and Garrison.

    Args:
        frequency: 100 Hz to 1 MHz.
        water: −6 to 35 °C, salinity 5 to 50, pH 7.7 to 8.3 and to 7 km, each with the others at 10 °C, 35, 8 and 0 m.

    Returns:
        α, dB/km.
    """
    T, S, ph, z = water
    f = frequency / 1000.0
    kilometres = z / 1000.0

    boric = 0.106 * math.exp((ph - 8.0) / 0.56)
    sulphate = 0.52 * (1.0 + T / 43.0) * (S / 35.0) * math.exp(-kilometres / 6.0)
    viscous = 4.9e-4 * math.exp(-(T / 27.0 + kilometres / 17.0))
    boric_corner = 0.78 * math.sqrt(S / 35.0) * math.exp(T / 26.0)
    sulphate_corner = 42.0 * math.exp(T / 17.0)

    return boric * relaxation(f, boric_corner) + sulphate * relaxation(f, sulphate_corner) + viscous * f**2


absorption_laws.register("thorp", lambda frequency, water: thorp(frequency))
absorption_laws.register("francois-garrison", francois_garrison)
absorption_laws.register("ainslie-mccolm", ainslie_mccolm)
