"""Sonar equation and the laws that it takes: absorption, ambient noise, loss in bubbles, wind over a sea.

Levels are in dB re 1 µPa, frequencies in Hz, also where the source's fit takes kHz. Functions that are callable from
kernels (in f32) are callable from Python too (in double precision); the others are called from Python when tables are
made. `docs/acoustics.md` compares the laws with published tables.

A law of absorption is a function (frequency in Hz, `SeaWater`) → absorption coefficient α in dB/km, one of ambient
noise a function (frequency in Hz, shipping activity from 0 to 1, wind speed in m/s) → noise density in dB re 1 µPa²/Hz.
Rain and the boat add to it: `total_level` adds powers.

Sources

- Absorption: Thorp, J. Acoust. Soc. Am. 42 (1967) 270, doi 10.1121/1.1910566; Francois and Garrison, ibid. 72 (1982)
  896, doi 10.1121/1.388170, and 1879, doi 10.1121/1.388673; Ainslie and McColm, ibid. 103 (1998) 1671, doi
  10.1121/1.421258.
- Noise: Coates, "Underwater Acoustic Systems" (1990); Hodges, "Underwater Acoustics: Analysis, Design and Performance
  of Sonar" (2010), chapter 7, doi 10.1002/9780470665244 (rain); Ross, "Mechanics of Underwater Noise" (1976), and
  MacGillivray and de Jong, J. Mar. Sci. Eng. 9 (2021) 369, doi 10.3390/jmse9040369 (vessels).
- Bubbles: "APL-UW High-Frequency Ocean Environmental Acoustic Models Handbook", APL-UW TR 9407 (1994), Eqs. 28a and 28b
  of part II; with an exponential profile over depth, as public implementations have it of Dahl, APL-UW (1994), DTIC
  ADA290312.
- Wind: Pierson and Moskowitz, J. Geophys. Res. 69 (1964) 5181, doi 10.1029/JZ069i024p05181; Toba, J. Oceanogr. Soc.
  Japan 28 (1972) 109, doi 10.1007/BF02109772; Wu, J. Geophys. Res. 87 (1982) 9704, doi 10.1029/JC087iC12p09704.
"""

import math

import numpy as np
import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.positioning.laws import SeaWater, absorption_laws, ambient_noise_laws
from usvauv.kernels.types import select

LN10 = 2.302585092994046
LOG10_OF_E = 0.4342944819032518
LOG2_OF_10 = 3.321928094887362

# Density of the noise of rain of 1 mm/h, dB re 1 µPa²/Hz, at frequencies in Hz; straight lines over log f between them.
RAIN_FREQUENCIES = (1e3, 2e3, 5e3, 1e4, 2e4, 5.02e4, 1e5)
RAIN_LEVELS = (52.9, 51.8, 49.0, 46.3, 43.2, 38.0, 34.1)

BREAKING = 6.0  # m/s, the wind from which waves break
LAYER_PER_WIND = 0.07  # s, e-folding depth of the bubbles over the wind

TYPICAL = 100.0  # m, of a slant range
LN_TYPICAL, ROOT_OF_TYPICAL = math.log(TYPICAL), TYPICAL**0.25
LEAST_EXPONENT, LARGEST_EXPONENT = -7.0, 23.0  # of `exponential`

GRAVITY = 9.81  # m/s²
KARMAN = 0.4  # of the logarithmic profile of the wind
PHILLIPS, DECAY = 0.0081, 0.74  # S = α g² ω⁻⁵ exp(−β (g/(U ω))⁴), Pierson and Moskowitz
TOBA = 0.062  # g Hs/u*² = B (g Ts/u*)^(3/2)
PEAK_OVER_SIGNIFICANT_PERIOD = 1.05  # of wind waves, Tp/Ts


@ti.pyfunc
def log10(value: ti.f32) -> ti.f32:
    """Decimal logarithm."""
    return ti.log(value) * LOG10_OF_E


@ti.pyfunc
def power_of_10(exponent: ti.f32) -> ti.f32:
    """10 raised to a real exponent."""
    return ti.exp(exponent * LN10)


@func
def magnitude(v):
    """|v|; Taichi has none of vectors in registers."""
    return select(v > 0.0, v, 0.0 - v)


@func
def logarithm_of_range(S):
    """ln(S/`TYPICAL`) of a number or a vector, within 1e-6 before rounding for S from 1 m to 20 km, by the series of
    8 artanh.
    """
    root = ti.sqrt(ti.sqrt(S))
    t = (root - ROOT_OF_TYPICAL) / (root + ROOT_OF_TYPICAL)
    q = t * t
    square = q * q
    low, high = 7.9999837 + q * 2.66787028, 1.57483998 + q * 1.36413519
    return t * (low + square * (high + square * (-0.02002157 + q * 2.33784286)))


@func
def exponential(x):
    """eˣ of a number or a vector, within 3e-6 for x from LEAST_EXPONENT to LARGEST_EXPONENT, and as for the nearer of
    these outside.
    """
    bounded = select(x > LEAST_EXPONENT, x, LEAST_EXPONENT)
    v = select(bounded < LARGEST_EXPONENT, bounded, LARGEST_EXPONENT) * (1.0 / 32.0)
    square = v * v
    low, high = 1.00000001 + v * 0.999999755, 0.499998866 + v * 0.166680823
    root = low + square * (high + square * (0.0416716776 + v * 0.00814047506 + square * 0.00177116073))
    for _ in ti.static(range(5)):
        root *= root
    return root


@ti.pyfunc
def thorp(f: ti.f32) -> ti.f32:
    """Thorp's absorption coefficient α at frequency f (Hz), dB/km; fitted for about 100 Hz to 50 kHz, at 4 °C."""
    F = (f / 1000.0) * (f / 1000.0)
    return 0.11 * F / (1.0 + F) + 44.0 * F / (4100.0 + F) + 2.75e-4 * F + 0.003


def relaxation(f: float, corner: float) -> float:
    """Absorption of a relaxation of the frequency `corner` over its absorption per kHz far below; both in kHz."""
    return corner * f**2 / (corner**2 + f**2)


def francois_garrison(frequency: float, water: SeaWater) -> float:
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


def ainslie_mccolm(frequency: float, water: SeaWater) -> float:
    """Absorption by the same three terms with fewer constants: within 10 % of Francois and Garrison.

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


@ti.pyfunc
def path_loss(r: ti.f32, spreading: ti.f32, alpha: ti.f32) -> ti.f32:
    """TL = k log10 r + α r/1000 over the range r (m), dB; below 1 m as at 1 m.

    `spreading` is k, dB a decade of range: 20 spherical, 10 cylindrical, 15 between them; `alpha` is α, dB/km.
    """
    R = ti.max(r, 1.0)
    return spreading * log10(R) + 0.001 * alpha * R


@ti.pyfunc
def noise_level(density: ti.f32, bandwidth: ti.f32) -> ti.f32:
    """NL of a noise density (dB re 1 µPa²/Hz) taken as constant over a band of `bandwidth` Hz, dB re 1 µPa."""
    return density + 10.0 * log10(bandwidth)


@ti.pyfunc
def acoustic_source_level(power: ti.f32) -> ti.f32:
    """Source level of an omnidirectional source of `power` W: 10 log10 P + 170.77, dB re 1 µPa at 1 m."""
    return 10.0 * log10(power) + 170.77


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


def drag(wind: float) -> float:
    """Drag coefficient of the sea surface for a wind (m/s) at 10 m, Wu (1982); for 1 to 50 m/s."""
    return 1e-3 * (0.8 + 0.065 * wind)


def wind_of_developed_sea(significant_height: float) -> float:
    """Wind over a sea that grows no more: Hs = 2 √(α/β) U²/g = 0.21 U²/g of Pierson and Moskowitz.

    Their U is the wind at 19.5 m, which the logarithmic profile converts to 10 m. They measured in winds of 20 to 40
    knots, Hs of 2 to 9 m. Gales seldom last until the sea is fully developed; `wind_of_growing_sea` is for these.

    Args:
        significant_height: Hs, m.

    Returns:
        Wind speed at 10 m, m/s.
    """
    wind = math.sqrt(GRAVITY * significant_height / (2.0 * math.sqrt(PHILLIPS / DECAY)))
    # The drag of the wind at 19.5 m stands for that of the wind at 10 m; together they differ by some 0.1 %.
    return wind / (1.0 + math.sqrt(drag(wind)) / KARMAN * math.log(19.5 / 10.0))


def wind_of_growing_sea(significant_height: float, peak_period: float) -> float:
    """Wind that makes a sea of height Hs and peak period Tp grow, by Toba's 3/2-power law and the drag of Wu.

    Other relations of Hs, Tp and wind amplify errors more: that of Hasselmann et al. (1976) has U ∝ Hs³ Tp⁻⁵, Toba's
    u* ∝ Hs² Tp⁻³.

    Args:
        significant_height: Hs, m.
        peak_period: Tp, s; of wind waves, whose steepness 2π Hs/(g Tp²) is 0.02 to 0.06. Swell needs no wind.

    Returns:
        Wind speed at 10 m, m/s; good to about a quarter.
    """
    period = peak_period / PEAK_OVER_SIGNIFICANT_PERIOD
    friction_velocity = (significant_height / TOBA) ** 2 / (GRAVITY * period**3)
    # u*² = (0.8 + 0.065 U) 10⁻³ U² has one positive root, and its other two have negative real parts.
    return float(np.roots([0.065, 0.8, 0.0, -1e3 * friction_velocity**2]).real.max())
