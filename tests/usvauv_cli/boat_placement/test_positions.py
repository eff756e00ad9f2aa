"""Positions of `usvauv plan` in degrees: against the ellipsoid's radii of curvature, and wrong forms."""

import json
import math

import pytest

from usvauv.env import Scenario
from usvauv.env.site.positions import angle, auv_position, coordinates
from usvauv.env.world.mission_parameters import fixed_vortices
from usvauv.env.world.strategy_choice import StrategyChoice
from usvauv.kernels.errors import UserError

CORNER = {"water.latitude": 22.51, "water.longitude": 114.02}
PLACED = Scenario.load("extreme", [f"{name}={value}" for name, value in CORNER.items()])
PLAIN = Scenario.load("extreme")
OPTIONS = [part for name, value in CORNER.items() for part in ("--set", f"{name}={value}")]


def metres(latitude: float, longitude: float) -> tuple[float, float]:
    """x and y from the corner by WGS84's radii of curvature there; good to millimetres over 200 m."""
    a, f = 6378137.0, 1 / 298.257223563
    e2 = f * (2 - f)
    sin = math.sin(math.radians(CORNER["water.latitude"]))
    N, M = a / math.sqrt(1 - e2 * sin**2), a * (1 - e2) / (1 - e2 * sin**2) ** 1.5
    along = math.radians(longitude - CORNER["water.longitude"])
    return N * math.sqrt(1 - sin**2) * along, M * math.radians(latitude - CORNER["water.latitude"])


def test_a_boat_holds_a_point_in_degrees():
    """As a strategy of the command line and of the scenario; for each boat its own."""
    expected = metres(22.5101, 114.0203)
    assert StrategyChoice.parse("hold:22.5101N,114.0203E", PLACED).numbers == pytest.approx(expected, abs=1e-2)
    given = Scenario.load("extreme", [*(f"{name}={value}" for name, value in CORNER.items()), "boat.count=2"])
    own = given.model_copy(
        update={"boat": given.boat.model_copy(update={"strategy": "hold:22°30.606'N,114.0203E,22.5111N,114.0205E"})}
    )
    both = StrategyChoice.parse(None, own).numbers
    assert both == pytest.approx([*expected, *metres(22.5111, 114.0205)], abs=1e-2)
    with pytest.raises(UserError, match=r"usv '22.5101N,114.0203E': the scenario has no place on Earth"):
        StrategyChoice.parse("hold:22.5101N,114.0203E", PLAIN)
    with pytest.raises(UserError, match=r"usv '23N,114.0203E': outside the area"):
        StrategyChoice.parse("hold:23N,114.0203E", PLACED)


@pytest.mark.parametrize(
    ("text", "degrees"),
    [
        ("22.5101N,114.0203E,100", (22.5101, 114.0203)),
        ("22°30.62'N,114.0203°E,100", (22 + 30.62 / 60, 114.0203)),
        ("22°30'37.2\"N,114°1'13.2\"E,100", (22 + 30 / 60 + 37.2 / 3600, 114 + 1 / 60 + 13.2 / 3600)),
    ],
)
def test_forms_of_degrees(text, degrees):
    x, y, depth = auv_position(text, PLACED)
    assert (x, y) == pytest.approx(metres(*degrees), abs=0.01)
    assert depth == 100


def test_south_and_west_are_negative():
    place = Scenario.load("extreme", ["water.latitude=-33.861", "water.longitude=-70.5"])
    x, y, _ = auv_position("33.86S,70.499W,50", place)
    assert (x, y) == pytest.approx((92.5, 110.9), abs=0.2)  # 0.001° of longitude × cos 33.86°, and of latitude
    assert angle("--auv", "", "70.499W", "EW") == -70.499


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("22.5101N,114.0203S,100", ["'114.0203S' is not a longitude"]),
        ("22°60'N,114.0203E,100", ["minutes and seconds below 60"]),
        ("22.5101N,114.0203E", ["expected 22.5101N,114.0203E,Z", "metres"]),
    ],
)
def test_wrong_forms_are_one_line(text, parts):
    with pytest.raises(UserError) as caught:
        auv_position(text, PLACED)
    message = str(caught.value)
    assert message.startswith(f"--auv {text!r}: ")
    assert "\n" not in message
    for part in parts:
        assert part in message


def test_the_other_side_of_the_earth_is_not_in_the_area():
    """Points there project along the plane's normal into the area too."""
    equator = Scenario.load("extreme", ["water.latitude=0", "water.longitude=10"])
    assert auv_position("0.001N,10.001E,50", equator)
    with pytest.raises(UserError, match="outside the area"):
        auv_position("0.001N,170.001W,50", equator)


def test_degrees_without_a_side_are_said_in_a_line(plan):
    code, stdout, stderr = plan("--auv", "22.510,114.020,100", "--json", "-")
    line = "--auv: metres are expected and these look like degrees, which have a side: 22.5101N,114.0203E"
    assert (code, stderr) == (0, f"warning: {line}\n")
    assert json.loads(stdout)["warnings"] == [line]
    code, stdout, stderr = plan("--auv", "-33.8568,151.2153,100")
    assert (code, stdout, stderr.count("\n")) == (2, "", 1)
    assert "outside the area" in stderr
    assert "look like degrees" in stderr


class TestResult:
    def test_has_both(self, plan):
        there = ["--auv", "22.5101N,114.0203E,100", "--auv", "22.5115N,114.0212E,90", "--compare", "22.511N,114.021E"]
        result = json.loads(plan(*there, *OPTIONS, "--json", "-")[1])
        auv, compare = result["auvs"][1], result["compare"][0]
        assert (auv["latitude"], auv["longitude"]) == pytest.approx((22.5115, 114.0212), abs=1e-9)
        assert (compare["latitude"], compare["longitude"]) == pytest.approx((22.511, 114.021), abs=1e-9)
        for place in (auv, compare, result["optimum"], result["centroid"]):
            assert metres(place["latitude"], place["longitude"]) == pytest.approx((place["x"], place["y"]), abs=0.01)
        stdout = plan(*there, *OPTIONS)[1]
        best = coordinates(result["optimum"]["latitude"], result["optimum"]["longitude"])
        assert f"({best})" in stdout.splitlines()[0]
        assert f"optimum   {best}" in stdout
        assert "AUV 2     22.511500N,114.021200E" in stdout

    def test_longitudes_are_at_most_180(self, plan):
        west = ["--set", "water.latitude=32.5", "--set", "water.longitude=242.5"]
        result = json.loads(plan("--auv", "32.501N,117.499W,100", *west, "--json", "-")[1])
        assert result["auvs"][0]["longitude"] == pytest.approx(-117.499)
        assert coordinates(-33.5, -70.25) == "33.500000S,70.250000W"
        assert coordinates(0.0, 180.25) == coordinates(0.0, -179.75) == "0.000000N,179.750000W"


@pytest.mark.parametrize("text", ["22.5101N,114.0203E", "22.5101N,114.0303E"])
def test_centres_of_vortices(text, tmp_path):
    """As `hold` has them, also outside the area, where `hold` refuses them; a file keeps them as they are given."""
    centres = f'current.centres=["{text}", [60, 80]]'
    scenario = Scenario.load("extreme", [*(f"{name}={value}" for name, value in CORNER.items()), centres])
    expected = metres(22.5101, float(text[9:17]))
    assert fixed_vortices(scenario)[:, :2].ravel() == pytest.approx([*expected, 60.0, 80.0], abs=0.05)
    path = tmp_path / "mine.toml"
    path.write_text(scenario.to_toml(), encoding="utf-8")
    assert Scenario.load(path) == scenario


@pytest.mark.parametrize(
    ("centre", "placed", "said"),
    [
        ("22.51N,114.03E", False, "current.centres '22.51N,114.03E': the scenario has no place on Earth"),
        ("22.51,114.03", True, "current.centres '22.51,114.03': '22.51' is not a latitude"),
        ("24.51N,114.03E", True, "current.centres '24.51N,114.03E': is 221 km from the area's corner; at most 100 km"),
    ],
)
def test_centres_refused(centre, placed, said):
    place = [f"{name}={value}" for name, value in CORNER.items()] if placed else []
    with pytest.raises(UserError, match=said):
        fixed_vortices(Scenario.load("extreme", [*place, f'current.centres=["{centre}"]']))
