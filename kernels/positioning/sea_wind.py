"""The wind over a sea, from its waves: the wind 10 m above the surface, which laws of noise and of bubbles take.

Sources: Pierson and Moskowitz, "A proposed spectral form for fully developed wind seas based on the similarity theory
of S. A. Kitaigorodskii", J. Geophys. Res. 69 (1964) 5181, doi 10.1029/JZ069i024p05181; Toba, "Local balance in the
air-sea boundary processes I", J. Oceanogr. Soc. Japan 28 (1972) 109, doi 10.1007/BF02109772; Wu, "Wind-stress
coefficients over sea surface from breeze to hurricane", J. Geophys. Res. 87 (1982) 9704, doi 10.1029/JC087iC12p09704.
"""

import math

import numpy as np

GRAVITY = 9.81  # m/s²
KARMAN = 0.4  # of the logarithmic profile of the wind
PHILLIPS, DECAY = 0.0081, 0.74  # S = α g² ω⁻⁵ exp(−β (g/(U ω))⁴), Pierson and Moskowitz
TOBA = 0.062  # g Hs/u*² = B (g Ts/u*)^(3/2)
PEAK_OVER_SIGNIFICANT_PERIOD = 1.05  # of wind waves, Tp/Ts


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


def height_of_developed_sea(wind: float) -> float:
    """Significant height Hs (m) of the sea that `wind_of_developed_sea` gives a wind (m/s) at 10 m, to some 0.1 %."""
    aloft = wind * (1.0 + math.sqrt(drag(wind)) / KARMAN * math.log(19.5 / 10.0))
    return 2.0 * math.sqrt(PHILLIPS / DECAY) * aloft**2 / GRAVITY


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
