"""Fixes of real systems: their sentences, bad lines, the place and the scatter of AUVs by them."""

import json
import math
from functools import reduce

import numpy as np
import pytest

from tests.usvauv_env.made_traces import synthetic_trace
from usvauv.cli.planning.fix_log import Fixes, auvs_of_log, estimate, read_log
from usvauv.cli.planning.sentences import BadLine, Boat, Geographic, Heading, Relative, parse
from usvauv.env import Scenario
from usvauv.env.exchange import export_trace
from usvauv.env.site.place import LocalFrame
from usvauv.kernels.errors import UserError

HERE = LocalFrame(8.87, 50.02)


def signed(body: str) -> str:
    return f"${body}*{reduce(lambda total, character: total ^ ord(character), body, 0):02X}"


def position(x: float, y: float) -> tuple[str, str]:
    """A place near `HERE` as NMEA writes it."""
    longitude, latitude = (float(value) for value in HERE.to_geographic(np.array(x), np.array(y)))
    return (
        f"{int(latitude):02d}{60 * (latitude % 1):010.7f},N",
        f"{int(longitude):03d}{60 * (longitude % 1):010.7f},E",
    )


@pytest.fixture
def scenario():
    return Scenario.load("extreme")


class TestSentences:
    @pytest.mark.parametrize(
        ("line", "said"),
        [
            # As in PosiView's description of Ranger 2, and as logged from a submersible: with their checksums.
            (
                "$PSONLLD,153005.253,24,A,50.02495,8.873323,425.3,,,,,,,,*3e",
                Geographic(55805.253, "24", 50.02495, 8.873323, 425.3),
            ),
            (
                "$PSONLLD,170004.53,ALVIN 914,A,28.8114807,-87.80925696,1951.156,13.96,13.96,0.00,2.62,,,,*6F",
                Geographic(61204.53, "ALVIN 914", 28.8114807, -87.80925696, 1951.156),
            ),
            # The example of NavDP's manual, whose checksum is not its own.
            (
                "$PSIMSSB,085405.61,B42,A,,C,H,M,134.5,114.5,120.0,,,,",
                Relative(32045.61, "B42", 134.5, 114.5, 120, True),
            ),
            (signed("PSIMSSB,000001.00,B01,A,,C,N,F,3.0,4.0,9.0,0.1,N,,"), Relative(1, "B01", 4, 3, 9)),
            (signed("PSIMSSB,000001.00,B01,A,,C,E,F,3.0,4.0,9.0,0.1,N,,"), Relative(1, "B01", 3, 4, 9)),
            (
                signed("PTSAG,#00012,101500.500,03,06,2019,02,5001.5000,N,00852.2500,W,F,0301.5,1,9999.0"),
                Geographic(36900.5, "02", 50.025, -8.87083333333, 301.5),
            ),
            (
                signed("PTSAG,#00012,101500.500,03,06,2019,02,5001.5000,S,00852.2500,E,F,0301.5,2,0299.0"),
                Geographic(36900.5, "02", -50.025, 8.87083333333, 299),
            ),
            (
                "+++AT:103:USBLLONG,1458.79,1457.31,3,1.0,2.0,-30.0,12.5,-7.25,-31.0,0.01,0.02,1.5,20500,-25,190,0.03",
                Relative(1457.31, "3", 12.5, -7.25, 31),
            ),
            (signed("INGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,"), Boat(48.1173, 11.5166666667)),
            (signed("HEHDT,90.0,T"), Heading(math.pi / 2)),
        ],
    )
    def test_fields_are_where_the_maker_says(self, line, said):
        found = parse(line)
        assert type(found) is type(said)
        assert found == pytest.approx(said) if isinstance(said, Boat | Heading) else True
        for value, expected in zip(found, said, strict=True):
            assert value == (expected if isinstance(expected, str) else pytest.approx(expected, abs=1e-9))

    @pytest.mark.parametrize(
        "line",
        [
            "",
            "# started",
            signed("GPVTG,0.0,T,,M,0.0,N,0.0,K"),
            signed("PSONLLD,153005.253,24,V,50.02495,8.873323,425.3,,,,,,,,"),
            signed("PSIMSSB,000001.00,B01,V,,C,N,F,3.0,4.0,9.0,0.1,N,,"),
            signed("PTSAG,#00012,101500.500,03,06,2019,02,5001.5000,N,00852.2500,W,0,0301.5,1,9999.0"),
        ],
    )
    def test_others_and_fixes_that_are_not_valid_are_passed_over(self, line):
        assert parse(line) is None

    @pytest.mark.parametrize(
        ("line", "problem"),
        [
            ("$PSONLLD,153005.253,24,A,50.02496,8.873323,425.3,,,,,,,,*3e", "checksum 3e, the sentence has 3D"),
            ("$PSONLLD,153005.253,24,A,50.02495,8.873323,425.3,,,,,,,,", "no checksum"),
            (signed("PSONLLD,153005.253,24,A,50.02495,,425.3,,,,,,,,"), "a field is missing"),
            (signed("PSONLLD,153005.253,24,A,nan,8.8,425.3,,,,,,,,"), "a field is missing"),
            (signed("PSIMSSB,000001.00,B01,A,,U,E,F,3.0,4.0,9.0,0.1,N,,"), "coordinates U, orientation E"),
            ("USBLLONG,1,2,3", "a field is missing"),
        ],
    )
    def test_what_is_wrong_with_a_line(self, line, problem):
        with pytest.raises(BadLine, match=problem):
            parse(line)


class TestReading:
    def test_fixes_relative_to_the_boat_are_added_to_it(self, tmp_path, scenario):
        water = scenario.water.model_copy(update={"latitude": HERE.latitude, "longitude": HERE.longitude})
        boat = signed("GPGGA,000000,{},{},1,08,0.9,5,M,46.9,M,,".format(*position(100, 60)))
        starboard = signed("PSIMSSB,000001.00,B01,A,,C,H,F,30.0,7.0,90.0,0.1,N,,")
        path = tmp_path / "log.txt"
        path.write_text("\n".join([boat, signed("HEHDT,90.0,T"), starboard]))
        (fixes,), placed, bad = read_log(path, scenario.model_copy(update={"water": water}))
        assert not bad
        assert placed.water == water
        np.testing.assert_allclose(fixes.places, [[107, 30]], atol=1e-3)  # it heads east: starboard is south

    def test_the_area_is_laid_around_a_log_in_degrees(self, tmp_path, scenario):
        path = tmp_path / "log.txt"
        path.write_text(
            "\n".join(signed(f"PSONLLD,00000{i}.0,7,A,{50 + 1e-5 * i:.6f},8.0,90.0,,,,,,,,") for i in range(5))
        )
        (fixes,), placed, _ = read_log(path, scenario)
        np.testing.assert_allclose(fixes.places[2], [scenario.area.width / 2, scenario.area.length / 2], atol=0.01)
        assert np.diff(fixes.places[:, 1]) == pytest.approx(1.1124, rel=1e-3)  # 1e-5° of a meridian
        assert placed.water.latitude == pytest.approx(50, abs=0.01)

    def test_time_goes_on_after_midnight(self, tmp_path, scenario):
        path = tmp_path / "log.txt"
        path.write_text(
            "\n".join(
                signed(f"PSONLLD,{time},7,A,50.0,8.0,90.0,,,,,,,,") for time in ("235959.0", "000000.5", "000002.0")
            )
        )
        assert np.diff(read_log(path, scenario)[0][0].time).tolist() == [1.5, 1.5]

    def test_bad_lines_are_named_by_number_in_one_line(self, tmp_path, scenario):
        path = tmp_path / "log.csv"
        rows = ["1,a,5,5,90", "2,a,5,x,90", "3,a,5,5,nan", "4,a,5,5,90", "5,a,5", "6,a,,5,90", "7,a,5,5,90"]
        path.write_text("\n".join(["time,auv,x,y,depth", *rows]))
        (fixes,), _, bad = read_log(path, scenario)
        assert fixes.time.tolist() == [1, 4, 7]
        reason = "a number is missing or none"
        assert bad == [f"--log {path}: 4 bad lines left out: 3: {reason}; 4: {reason}; 6: {reason} and 1 more"]

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("", "no fix in it: expected CSV with a header or sentences of a USBL system"),
            ("hello\n", "no fix in it"),
            ("time,auv,x,y\n1,a,2,3\n", "no column depth; it needs time, auv, depth and x, y or latitude, longitude"),
            ("time,auv,depth\n", "no column latitude, longitude"),
            ("time,world,auv,x,y,depth\n1,0,a,2,3,9\n1,1,a,2,3,9\n", "several episodes"),
            (
                signed("PSIMSSB,000001.00,B01,A,,C,N,F,3.0,4.0,9.0,0.1,N,,"),
                "line 1: a fix relative to the boat, and no",
            ),
            (
                "time,auv,x,y,depth\n1,a,2,3,900\n",
                "AUV 'a' is at x = 2.0 m, y = 3.0 m, depth 900.0 m, outside the area",
            ),
        ],
    )
    def test_refusals(self, tmp_path, scenario, text, message):
        path = tmp_path / "log"
        path.write_text(text)
        with pytest.raises(UserError) as error:
            auvs_of_log(path, scenario)
        assert message in str(error.value)
        assert str(error.value).startswith(f"--log {path}: ")


class TestEstimate:
    @pytest.fixture(params=[0.0, 1.5], ids=["lies still", "runs"])
    def speed(self, request):
        return request.param

    def fixes(self, seed: int, speed: float, outliers: float = 0.0, count: int = 200) -> tuple[Fixes, np.ndarray]:
        random = np.random.default_rng(seed)
        time = np.cumsum(random.uniform(0.5, 3, count))
        heading = np.repeat(random.uniform(0, 2 * np.pi, -(-count // 40)), 40)[:count]  # turns each 40 fixes
        way = np.cumsum(speed * np.diff(time, prepend=0)[:, None] * np.stack([np.cos(heading), np.sin(heading)], 1), 0)
        measured = way + random.normal(0, (0.5, 0.2), (count, 2))
        measured += (random.random(count) < outliers)[:, None] * random.normal(0, 50, (count, 2))
        return Fixes("a", time, measured, np.full(count, 90.0)), way

    def test_the_accuracy_is_that_of_the_place(self, speed):
        found = [(estimate(fixes), way) for fixes, way in (self.fixes(seed, speed) for seed in range(300))]
        errors = [(auv.x - way[-1, 0]) ** 2 + (auv.y - way[-1, 1]) ** 2 for auv, way in found]
        expected = [auv.accuracy**2 for auv, _ in found]
        assert np.mean(errors) == pytest.approx(np.mean(expected), rel=0.2)

    def test_outliers_change_little(self, speed):
        found = [(estimate(fixes), way) for fixes, way in (self.fixes(seed, speed, 0.05) for seed in range(60))]
        errors = [math.hypot(auv.x - way[-1, 0], auv.y - way[-1, 1]) for auv, way in found]
        assert np.median(errors) < 0.6
        assert np.quantile(errors, 0.9) < 1.5
        assert np.mean([auv.noise for auv, _ in found]) < 1.35 * np.hypot(0.5, 0.2)


class TestCommand:
    def test_from_a_simulated_run_to_a_place_for_the_boat(self, run_usvauv, tmp_path):
        trace = synthetic_trace(steps=60)
        export_trace(trace, "csv", tmp_path)
        code, out, _ = run_usvauv("plan", "--log", "fixes.csv", "--json", "-")
        assert code == 0
        said = json.loads(out)
        for k, (found, auv) in enumerate(zip(said["log"], said["auvs"], strict=True)):
            assert (found["fixes"], found["used"]) == (60, 7)
            assert math.dist((auv["x"], auv["y"]), trace.auv_position[-1, 0, k]) < 3
            assert found["noise"] == pytest.approx(np.sqrt(0.13), rel=0.5)
        assert 0 < said["optimum"]["x"] < trace.scenario.area.width
