"""Numbers that are computed from a scenario: the rate of its data link and the wind."""

import pytest

from usvauv.env import Scenario
from usvauv.env.site.site import Site
from usvauv.env.world import tables
from usvauv.kernels.positioning.sonar import wind_of_growing_sea


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
    nodes = {"source_power": 0.1, "frequency": 24000, "bandwidth": 8000, **changes}
    acoustics = {"spreading": 17, "water_temperature": 12, "shipping": 0.3, "wind": 9, "rain": 6}
    sections = {"area": {"depth": 140}, "auv": {"depth": 60}, "acoustics": acoustics, "nodes": nodes}
    assert tables.reference_rate(Site(Scenario.from_dict(sections))) == pytest.approx(rate / 1e6, rel=1e-3)


def test_wind():
    """As given, or that of the storm, up to a bound."""

    def wind(height, **acoustics):
        storm = {"spectrum": "pm", "significant_height": height} if height else {}
        return tables.wind(Site(Scenario.from_dict({"storm": storm, "acoustics": acoustics})))

    assert wind(3, wind=9) == 9.0
    assert [wind(h, wind="storm") for h in (3, 14, 0)] == [wind_of_growing_sea(3, 11), tables.STRONGEST, 0.0]
