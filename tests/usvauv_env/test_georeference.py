"""The grid mapping of files against PROJ, and the clock."""

import numpy as np
import pytest
from pyproj import CRS, Transformer

from usvauv.env import Scenario
from usvauv.env.site import georeference
from usvauv.env.site.cf import OceanError
from usvauv.env.site.local_frame import LocalFrame
from usvauv.env.site.site import Site


@pytest.mark.parametrize("latitude", [-85.0, -33.0, 0.0, 22.51, 80.0])
@pytest.mark.parametrize("form", ["cf", "wkt"])
def test_proj_has_the_same_plane(latitude, form):
    """Places by PROJ from what a file says agree to 0.1 mm with those by the frame."""
    frame = LocalFrame(114.02, latitude)
    attributes = georeference.grid_mapping(frame)
    wkt = attributes.pop("crs_wkt")
    there = Transformer.from_crs(CRS.from_wkt(wkt) if form == "wkt" else CRS.from_cf(attributes), 4326, always_xy=True)
    x, y = np.meshgrid(np.linspace(0, 20000, 5), np.linspace(0, 20000, 5))
    np.testing.assert_allclose(there.transform(x, y), frame.to_geographic(x, y), rtol=0, atol=1e-9)


def test_start_of_a_mission():
    def start(*changes: str) -> str:
        return Site(Scenario.load("ideal", changes)).start

    assert start() == ""
    assert start("water.start=2026-11-01T06:00:00+02:00") == "2026-11-01T04:00:00"
    assert start("water.start=2026-11-01T06:00:00.25") == "2026-11-01T06:00:00.250000"
    with pytest.raises(OceanError, match=r"start = 'soon'; allowed: ISO 8601"):
        start("water.start=soon")


def test_clock_there_and_back():
    units = georeference.clock("2026-11-01T04:00:00", "it")["units"]
    assert units == "seconds since 2026-11-01 04:00:00"
    assert georeference.start_of(units) == "2026-11-01T04:00:00"
    assert georeference.start_of(georeference.clock("", "it")["units"]) == ""
