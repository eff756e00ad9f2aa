"""Laws of absorption: published values, limits, monotony, and agreement where their authors state it."""

import math

import numpy as np
import pytest

from usvauv.kernels.positioning.sonar import (
    SeaWater,
    absorption_laws,
    ainslie_mccolm,
    francois_garrison,
    relaxation,
    thorp,
)

# Francois and Garrison's values as G. Jiménez Arranz lists them for checking (SEAWATER_PROPERTIES, 2017), pH 8, at the
# surface: °C, salinity, kHz, dB/km.
TABLE = [
    (0.0, 30.0, 1.0, 0.0610),
    (0.0, 35.0, 1.0, 0.0640),
    (10.0, 35.0, 1.0, 0.0600),
    (0.0, 30.0, 10.0, 1.12),
    (0.0, 35.0, 10.0, 1.29),
    (10.0, 35.0, 10.0, 0.963),
    (0.0, 30.0, 100.0, 21.0),
    (0.0, 35.0, 100.0, 23.4),
    (10.0, 35.0, 100.0, 33.6),
]
# Pure water, α/f² in 1e-15 s²/m (Np/m): Pinkerton, Proc. Phys. Soc. B 62 (1949) 129, doi 10.1088/0370-1301/62/2/307.
PINKERTON = [(0.0, 56.9), (10.0, 36.1), (20.0, 25.3), (30.0, 19.1)]
WATER_LAWS = (francois_garrison, ainslie_mccolm)
FREQUENCIES = np.geomspace(100.0, 1e6, 41)


@pytest.mark.parametrize(("kilohertz", "alpha"), [(1.0, 0.06900), (10.0, 1.18703), (20.0, 4.13384), (50.0, 17.46712)])
def test_thorp(kilohertz, alpha):
    """Thorp's sum worked out by hand, dB/km."""
    assert thorp(1000 * kilohertz) == pytest.approx(alpha, abs=2e-5)


@pytest.mark.parametrize(("temperature", "salinity", "kilohertz", "alpha"), TABLE)
def test_francois_garrison(temperature, salinity, kilohertz, alpha):
    """To the last of three digits."""
    assert francois_garrison(1000 * kilohertz, SeaWater(temperature, salinity)) == pytest.approx(alpha, rel=6e-3)


@pytest.mark.parametrize(
    "waters",
    [
        [SeaWater(temperature=T) for T in range(-6, 36)],
        [SeaWater(ph=ph) for ph in (7.7, 7.8, 7.9, 8.0, 8.1, 8.2, 8.3)],
        [SeaWater(salinity=S) for S in range(5, 51, 5)],
        [SeaWater(depth=z) for z in range(0, 7001, 500)],
    ],
    ids=["temperature", "pH", "salinity", "depth"],
)
def test_ainslie_mccolm_within_ten_percent(waters):
    """The authors' statement: 100 Hz to 1 MHz, each property over its range with the others at 10 °C, 35, 8, 0 m.

    Their ranges end where the difference reaches 10 %, to the whole percent.
    """
    ratio = np.array([ainslie_mccolm(f, water) / francois_garrison(f, water) for water in waters for f in FREQUENCIES])
    assert np.abs(ratio - 1).max() < 0.1051


def test_water_is_at_the_surface_unless_its_depth_is_said():
    assert SeaWater() == SeaWater(temperature=10.0, salinity=35.0, ph=8.0, depth=0.0)


def test_thorp_has_a_quarter_more_at_15_kilohertz_in_warm_water():
    assert thorp(15e3) / francois_garrison(15e3, SeaWater()) == pytest.approx(1.25, abs=0.02)


@pytest.mark.parametrize(("temperature", "coefficient"), PINKERTON)
@pytest.mark.parametrize(("law", "tolerance"), [(francois_garrison, 0.02), (ainslie_mccolm, 0.08)])
def test_pure_water(law, tolerance, temperature, coefficient):
    """Without salt, and at high frequencies with it: α ∝ f², in Np/m over Hz² as measured in pure water."""
    for salinity, f in ((0.0, 1e5), (35.0, 1e8)):
        neper = law(f, SeaWater(temperature, salinity)) / 1000 / (20 * math.log10(math.e))
        assert neper / f**2 == pytest.approx(coefficient * 1e-15, rel=tolerance)


def test_pressure_lowers_the_absorption_of_pure_water():
    """Francois and Garrison's 1 − 3.83e-5 z + 4.9e-10 z², worked out by hand for 5 km."""
    deep, shallow = (francois_garrison(1e6, SeaWater(salinity=0.0, depth=z)) for z in (5000.0, 0.0))
    assert deep / shallow == pytest.approx(0.82075)


def test_branches_of_pure_water_meet_at_20_degrees():
    below, above = (francois_garrison(1e6, SeaWater(T, 0.0)) for T in (20.0, 20.0 + 1e-9))
    assert above == pytest.approx(below, rel=2e-3)


class TestRelaxation:
    """At its relaxation frequency a process absorbs half of what it does far above."""

    def test_term(self):
        assert relaxation(70.0, 70.0) == pytest.approx(relaxation(7e4, 70.0) / 2, rel=1e-5)

    @pytest.mark.parametrize(("law", "corner"), [(francois_garrison, 1117.0), (ainslie_mccolm, 1146.0)])
    def test_boric_acid(self, law, corner):
        """2.8 · 10^(4 − 1245/283) kHz, and 0.78 e^(10/26) kHz; boric acid alone depends on pH."""
        at, above = (law(f, SeaWater(ph=8.3)) - law(f, SeaWater(ph=8.0)) for f in (corner, 1000 * corner))
        assert at / above == pytest.approx(0.5, abs=1e-3)

    @pytest.mark.parametrize(
        ("law", "corner", "above"), [(francois_garrison, 75900.0, 48.0), (ainslie_mccolm, 75630.0, 48.6)]
    )
    def test_magnesium_sulphate(self, law, corner, above):
        """8.17 · 10^(8 − 1990/283) kHz with 21.44 · 35/c · 1.25 dB/km/kHz; 42 e^(10/17) kHz with 0.52 (1 + 10/43)."""
        salt = [law(f, SeaWater()) - law(f, SeaWater(salinity=0.0)) for f in (corner, 1000 * corner)]
        boric = 0.12  # dB/km, constant far above its own frequency
        assert salt[1] == pytest.approx(above, rel=3e-3)
        assert (salt[0] - boric) / (salt[1] - boric) == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize("name", absorption_laws)
def test_more_at_higher_frequencies(name):
    assert np.all(np.diff([absorption_laws[name](f, SeaWater()) for f in FREQUENCIES]) > 0)


@pytest.mark.parametrize("law", WATER_LAWS)
def test_less_at_depth_and_in_fresh_water(law):
    for f in (1e4, 1e5, 1e6):
        assert np.all(np.diff([law(f, SeaWater(depth=z)) for z in range(0, 5000, 100)]) < 0)
        assert np.all(np.diff([law(f, SeaWater(salinity=S)) for S in range(41)]) > 0)


def test_names():
    assert list(absorption_laws) == ["thorp", "francois-garrison", "ainslie-mccolm"]
