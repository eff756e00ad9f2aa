"""From a scenario to the kernels' numbers: those that are computed, beside the same by hand from numbers all unlike."""

import math

import numpy as np
import pytest

from usvauv.env import Scenario
from usvauv.env.site.site import Site
from usvauv.env.world import mission_parameters
from usvauv.env.world.strategy_choice import StrategyChoice
from usvauv.kernels.mission.columns import Parameter
from usvauv.kernels.positioning.sonar import (
    wind_of_growing_sea,
)

NUMBERS = {
    "area": {"width": 300, "length": 250, "depth": 140},
    "mission": {"step": 0.5},
    "auv": {"count": 3, "depth": 60, "hover_radius": 11, "speed_max": 2.5},
    "nodes": {
        "count": 12, "arrival_rates": [2, 3, 7], "payload": 4, "source_power": 0.1, "frequency": 24000,
        "bandwidth": 8000, "rate_law": "shannon",
    },
    "acoustics": {
        "sound_speed": 1480, "sound_speed_error": 5, "spreading": 17, "water_temperature": 12, "water_salinity": 34,
        "ph": 7.9, "shipping": 0.3, "wind": 9, "rain": 6,
    },
    "usbl": {
        "gnss_correlation_time": 30, "periods": 40, "carrier_min": 13000, "pulse_length": 0.02, "lever_arm_error": 0.4,
        "gnss_error": 0.3, "attitude_error": 0.01, "alignment_error": 0.02, "heading_error": 0.03,
    },
    "navigation": {"velocity_noise": 0.3, "velocity_bias": 0.2, "bias_correlation_time": 90},
    "reference": {"straight_speed": 1.6},
    "boat": {"noise_level": 55, "top_speed": 3},
}  # fmt: skip


def site(**changes: dict) -> Site:
    """The site of `NUMBERS`, with changes by section."""
    return Site(Scenario.from_dict({name: NUMBERS.get(name, {}) | changes.get(name, {}) for name in NUMBERS | changes}))


def packed(place: Site) -> dict[str, float]:
    numbers = mission_parameters.pack_parameters(place, mission_parameters.link_table(place))
    assert numbers.dtype == np.float32
    return dict(zip(Parameter.names, numbers.tolist(), strict=True))


@pytest.mark.parametrize("demonstration", [False, True])
def test_rate_of_the_demonstration(demonstration):
    """Its law has 10^SNR in place of 10^(SNR/10), its separation the AUVs' depth, not their height."""
    law = {"nodes": {"rate_law": "demonstration"}} if demonstration else {}
    apart = {"auv": {"separation": "demonstration"}}
    found = packed(site(**law, **apart))
    slant = math.hypot(60, 11)
    snr = found["data_level"] - 17 * math.log10(slant) - found["data_absorption"] * slant / 1000
    assert snr > 10
    rate = 8e-3 * (snr / (1 if demonstration else 10)) * math.log2(10)
    assert found["reference_rate"] == pytest.approx(rate, rel=0.02)


@pytest.mark.parametrize(
    ("changes", "rate"),
    [
        ({"rate_law": "modem"}, 16e3),
        ({"rate_law": "modem", "rate_max": 9000}, 9e3),
        ({"rate_law": "modem", "source_power": 1e-4}, 8e3),
        ({"rate_law": "modem", "source_power": 1e-6}, 1e-3),
        ({"rate_law": "optical", "rate_max": 1e7, "attenuation": 0.05}, 1e7),
        ({"rate_law": "optical", "rate_max": 1e7, "attenuation": 0.4}, 1e-3),
    ],
)
def test_rate_of_a_modem_and_of_light(changes, rate):
    """80 m away in a band of 8 kHz; a dead link has the rate that no mission is long enough for."""
    assert packed(site(nodes=NUMBERS["nodes"] | changes))["reference_rate"] == pytest.approx(rate / 1e6, rel=1e-3)


class TestSound:
    def test_speed_of_a_profile(self):
        """The way over the time, z/∫dz/c, down to the AUVs at 60 m, where it is 0.5 m/s slower a metre."""
        place = site(acoustics={"sound_speed_profile": ((0, 1500), (140, 1430))})
        assert mission_parameters.sound_speed(place) == pytest.approx(30 / math.log(1500 / 1470))
        assert program(place).refraction
        assert mission_parameters.sound_speed(site()) == 1480.0
        assert not program(site()).refraction


def program(place: Site):
    strategy = StrategyChoice.parse(None, place.scenario).strategy
    return mission_parameters.program(place, strategy, mission_parameters.link_table(place))


class TestWindAndNoise:
    def test_wind(self):
        storm = {"spectrum": "pm", "significant_height": 3}
        blown = {"acoustics": {"wind": "storm"}}
        assert mission_parameters.wind(site(storm=storm)) == 9.0
        assert mission_parameters.wind(site(storm=storm, **blown)) == wind_of_growing_sea(3, 11)
        steep = {**storm, "significant_height": 14}
        assert mission_parameters.wind(site(storm=steep, **blown)) == mission_parameters.STRONGEST
        assert mission_parameters.wind(site(**blown)) == 0.0
