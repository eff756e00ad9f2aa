"""Logs of real systems: their tables, the boat's way in them, what is no AUV, place and scatter of AUVs by them."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

from tests.usvauv_cli.boat_placement.test_sentences import signed
from tests.usvauv_env.record.made_traces import synthetic_trace
from usvauv.cli.boat_placement.fix_log import Fixes, auvs_of_log, estimate, read_log
from usvauv.env import Scenario
from usvauv.env.exchange import export_trace
from usvauv.env.site.place import LocalFrame
from usvauv.kernels.errors import UserError

HERE = LocalFrame(8.87, 50.02)


def gga(time: str, east: float = 0.0) -> str:
    """The boat at 60° N, so many metres east of 5° E."""
    return signed(f"GPGGA,{time},6000.0,N,005{east / 55802 * 60:010.7f},E,1,08,0.9,5,M,46.9,M,,")


def hipap(time: str, north: float, east: float, depth: float = 60.0, name: str = "M03", up: str = "N") -> str:
    return signed(f"PSIMSSB,{time},{name},A,,C,{up},F,{north},{east},{depth},1.4,T,0.03,")


def at(second: int) -> str:
    """A time of the day some seconds after 14:37."""
    return f"14{37 + second // 60}{second % 60:02d}"


def usbllong(said: float, measured: float, east: float) -> str:
    return f"+++AT:103:USBLLONG,{said},{measured},3,1,2,-30,{east},-7.25,-31.0,0,0,1.5,20500,-25,190,0.03"


def position(x: float, y: float) -> tuple[str, str]:
    """A place near `HERE` as NMEA writes it."""
    longitude, latitude = (float(value) for value in HERE.to_geographic(np.array(x), np.array(y)))
    return (
        f"{int(latitude):02d}{60 * (latitude % 1):010.7f},N",
        f"{int(longitude):03d}{60 * (longitude % 1):010.7f},E",
    )


def turned(north: float, east: float, heading: float) -> tuple[float, float]:
    """Starboard and ahead of a boat with a heading in degrees."""
    sin, cos = math.sin(math.radians(heading)), math.cos(math.radians(heading))
    return cos * east - sin * north, sin * east + cos * north


@pytest.fixture
def scenario():
    return Scenario.load("extreme")


@pytest.fixture
def read(tmp_path, scenario):
    """Read lines, text or bytes as a log."""

    def read(log, *beacons):
        path = tmp_path / "log"
        text = log if isinstance(log, str | bytes) else "\n".join(log)
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        found = read_log(path, scenario, beacons)
        return found._replace(warnings=[line.removeprefix(f"--log {path}: ") for line in found.warnings])

    return read


class TestReading:
    def test_fixes_relative_to_the_boat_are_added_to_it(self, tmp_path, scenario):
        water = scenario.water.model_copy(update={"latitude": HERE.latitude, "longitude": HERE.longitude})
        boat = signed("GPGGA,000000,{},{},1,08,0.9,5,M,46.9,M,,".format(*position(100, 60)))
        starboard = signed("PSIMSSB,000001.00,B01,A,,C,H,F,30.0,7.0,90.0,0.1,N,,")
        path = tmp_path / "log.txt"
        path.write_text("\n".join([boat, signed("HEHDT,90.0,T"), starboard]))
        log = read_log(path, scenario.model_copy(update={"water": water}))
        assert not log.warnings
        assert log.scenario.water == water
        np.testing.assert_allclose(log.fixes[0].places, [[107, 30]], atol=1e-3)  # it heads east: starboard is south

    def test_the_area_is_laid_around_a_log_in_degrees(self, read, scenario):
        log = read(signed(f"PSONLLD,00000{i}.0,7,A,{50 + 1e-5 * i:.6f},8.0,90.0,,,,,,,,") for i in range(5))
        places = log.fixes[0].places
        np.testing.assert_allclose(places[2], [scenario.area.width / 2, scenario.area.length / 2], atol=0.01)
        assert np.diff(places[:, 1]) == pytest.approx(1.1124, rel=1e-3)  # 1e-5° of a meridian
        assert log.scenario.water.latitude == pytest.approx(50, abs=0.01)

    @pytest.mark.parametrize(
        "log",
        [
            [signed(f"PSONLLD,13200{i}.0,7,A,-16.5,{179.99995 * (-1) ** i},50.0,,,,") for i in range(10)],
            ["time,auv,latitude,longitude,depth", *(f"{i},7,-16.5,{179.99995 + i % 2 * 1e-4},50" for i in range(10))],
            [
                signed("GPGGA,132000,1630.0,S,17959.997,E,1,08,0.9,5,M,46.9,M,,"),
                *(hipap(f"1320{i:02d}", 0, 0, 50) for i in range(11)),
                signed("GPGGA,132010,1630.0,S,17959.997,W,1,08,0.9,5,M,46.9,M,,"),
            ],
        ],
        ids=["both signs", "beyond 180", "the boat"],
    )
    def test_both_sides_of_180_degrees_are_one_place(self, read, log):
        found = read(log)
        assert np.ptp(found.fixes[0].places, axis=0) == pytest.approx([10.68, 0], abs=0.1)
        assert found.fixes[0].places.mean(axis=0) == pytest.approx([100, 100], abs=6)
        assert -180 <= found.scenario.water.longitude <= 180

    @pytest.mark.parametrize(
        ("times", "steps"),
        [
            (("235959.0", "000000.5", "000002.0"), [1.5, 1.5]),
            (("235959.0", "000000.2", "235959.6", "000000.9"), [1.2, -0.6, 1.3]),
            (("000000.2", "235959.6", "000000.9"), [-0.6, 1.3]),
            (("060000.0", "200000.0", "190000.0"), [14 * 3600, -3600]),
            (("100000.0", "110000.0", "080000.0"), [3600, 21 * 3600]),  # of two days
        ],
    )
    def test_time_goes_on_after_midnight_and_a_line_may_be_late(self, read, times, steps):
        log = read(signed(f"PSONLLD,{time},7,A,50.0,8.0,90.0,,,,,,,,") for time in times)
        assert np.diff(log.fixes[0].time) == pytest.approx(steps)

    @pytest.mark.parametrize("newest", [86_000, 90_000])
    def test_a_table_from_the_newest_fix_to_the_oldest(self, read, newest):
        """Over 16 hours, or also over midnight."""
        log = read(["time,auv,x,y,depth", *(f"{(newest - 3000 * i) % 86400},a,50,60,40" for i in range(20))])
        assert np.diff(log.fixes[0].time).tolist() == [-3000] * 19

    def test_bad_lines_are_named_by_number_in_one_line(self, read):
        rows = ["1,a,5,5,90", "2,a,5,x,90", "3,a,5,5,nan", "4,a,5,5,90", "5,a,5", "6,,5,5,90", "7,a,5,5,90"]
        log = read(["time,auv,x,y,depth", *rows])
        assert log.fixes[0].time.tolist() == [1, 4, 7]
        assert log.left_out == {"bad line": 4}
        assert log.warnings == [
            "4 bad lines left out: 3: y 'x' is not a number of at most 1e+20; 4: depth 'nan' is not a number of at most"
            " 1e+20; 6: 3 fields, the header has 5 and 1 more"
        ]

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("", "no fix in it: expected CSV with a header (time, auv, depth and x, y or latitude, longitude, in s or"),
            ("time,auv,x,y\n1,a,2,3\n", "no column depth; it needs time, auv, depth and x, y or latitude, longitude"),
            ("time,auv,x,y,Depth (ft)\n1,a,2,3,90\n", "no column depth; it needs time, auv, depth and x, y"),
            ("time,auv,x,X,y,depth\n", "column x is there twice"),
            ("time,world,auv,x,y,depth\n1,0,a,2,3,9\n1,1,a,2,3,9\n", "several episodes"),
            ("time;auv;x;y;depth\n1;a;2;3,5;9\n", "line 2: y '3,5' has a decimal comma; numbers have a decimal point"),
            ("time,auv,x,y,depth\n1,a,2,0,3,9\n", "line left out: 2: 6 fields, the header has 5"),
            (
                "time,auv,x,y,depth\n2026-05-01T12:00:00Z,a,2,3,9\n5.5,a,2,3,9\n",
                "line 3: time '5.5' is a number, those before are a date with an offset from UTC",
            ),
            (
                "time,auv,x,y,depth\n2026-05-01T12:00Z,a,2,3,9\n2026-05-01T12:01,a,2,3,9\n",
                "line 3: time '2026-05-01T12:01' is a date without an offset from UTC, those before are a date with an",
            ),
            (hipap("000001", 3, 4, 9), "1: a fix relative to the boat, and no $--GGA"),
            (
                "\n".join([gga("000000"), hipap("000001", 3, 4, 9, up="H")]),
                "2: a fix relative to the boat, and no $--HDT",
            ),
            (
                "time,auv,x,y,depth\n1,a,2,3,900\n",
                "AUV 'a' is at x = 2.0 m, y = 3.0 m, depth 900.0 m, outside the area",
            ),
            ("time,auv,x,y,depth\n1,a,2,3,-60\n", "left out: 1 × 'a', above the surface, depth -60.0 m"),
        ],
    )
    def test_refusals(self, tmp_path, scenario, text, message):
        path = tmp_path / "log"
        path.write_text(text)
        with pytest.raises(UserError) as error:
            auvs_of_log(path, scenario)
        assert message in str(error.value)
        assert str(error.value).startswith(f"--log {path}: ")

    def test_what_is_no_file_of_use(self, scenario):
        for path, message in (("/dev/zero", "larger than 32 MiB"), ("/", "cannot be read: Is a directory")):
            with pytest.raises(UserError, match=f"--log {path}: {message}"):
                read_log(Path(path), scenario)


class TestTables:
    @pytest.mark.parametrize(
        ("header", "row"),
        [
            ('"time","auv","x","y","depth"', '{0},"a",{1},60,40'),
            ('"","time","auv","x","y","depth"', '"{0}",{0},"a",{1},60,40'),  # R's write.csv
            ("sep=;\nTime;AUV;X;Y;Depth", "{0};a;{1};60;40"),  # Excel
            ("Time (s)\tAUV\tX [m]\tY [m]\tDepth", "{0}\ta\t{1}\t60\t40"),
            ("time..s.,auv,x..m.,y_m,Depth.m.", "{0},a,{1},60,40"),  # R's make.names
            ("time,AUV (name),x [m],y,depth (ft),depth (m positive down)", "{0},a,{1},60,131,40"),
            ("time,auv,x,x (sd),y,y (m),depth,Depth_m", "{0},a,{1},7,60,7,40,7"),  # those without a unit
            ("time   auv  x     y    depth", "{0}      a    {1}   60   40"),
            ("# time,auv,x,y,depth", "{0},a,{1},60,40"),  # NumPy's savetxt
            ("Exported on Monday\n\ntime,auv,x,y,depth,note", "{0},a,{1},60,40,"),
        ],
    )
    @pytest.mark.parametrize(("encoding", "ending"), [("utf-8", "\n"), ("utf-8-sig", "\r"), ("utf-16", "\r\n")])
    def test_headers_as_programs_write_them(self, read, header, row, encoding, ending):
        lines = [*header.split("\n"), *(row.format(i, 50 + i / 2) for i in range(1, 6)), ",,,,", ""]
        log = read(ending.join(lines).encode(encoding))
        (fixes,) = log.fixes
        assert (fixes.name, fixes.time.tolist(), log.warnings) == ("a", [1, 2, 3, 4, 5], [])
        assert fixes.places.tolist() == [[50 + i / 2, 60] for i in range(1, 6)]

    @pytest.mark.parametrize(
        "times",
        [
            ("2026-05-01T23:59:59Z", "2026-05-02T00:00:00.5Z", "2026-05-02T02:00:02+02:00"),
            ("2026-05-01 23:59:59.000000000", "2026-05-02 00:00:00.500000000", "2026-05-02 00:00:02.000000000"),
            ("20260501T235959Z", "20260502T000000.5Z", "20260502T000002Z"),
            ("23:59:59", "00:00:00.5", "00:00:02"),
            ("01:59:59+02:00", "02:00:00.5+02:00", "02:00:02+02:00"),
        ],
    )
    def test_times_are_dates_or_of_the_day(self, read, times):
        log = read(["Time (UTC);auv;x;y;depth", *(f"{time};a;50;60;40" for time in times), "2026-05-01;a;50;60;40"])
        assert np.diff(log.fixes[0].time) == pytest.approx([1.5, 1.5], abs=1e-6)
        assert log.warnings == ["1 bad line left out: 5: time '2026-05-01' is neither s nor like 2026-05-01T12:00:00Z"]

    @pytest.mark.parametrize("log", ["table", "sentences"])
    def test_a_fix_that_is_logged_again_changes_nothing(self, read, log):
        """As by two ports, or in a file that is there twice: beside its copy a fix has no scatter."""
        places = np.random.default_rng(0).normal([40, 20], 0.5, (30, 2)).round(3)
        if log == "table":
            lines = [f"{i},a,{x},{y},40" for i, (x, y) in enumerate(places)]
        else:
            lines = [hipap(at(i), x, y) for i, (x, y) in enumerate(places)]
        first = ["time,auv,x,y,depth"] if log == "table" else [gga(at(i)) for i in (0, 10, 20, 30) for _ in (0, 1)]
        once, again = read([*first, *lines]), read([*first, *(line for line in lines for _ in (0, 1)), *lines])
        assert estimate(again.fixes[0]) == estimate(once.fixes[0])
        assert estimate(once.fixes[0]).noise == pytest.approx(0.7, abs=0.2)
        assert (once.left_out, again.left_out) == ({}, {"logged again": 60})


class TestBoat:
    def test_its_way_is_interpolated(self, read):
        """It runs 5 m/s and says so each 10 s; the AUV lies still, also after its last position."""
        times = [at(i) for i in range(90)]
        log = read(
            line
            for i, time in enumerate(times)
            for line in [*[gga(time, 5 * i)] * (i % 10 == 0), hipap(time, 0, 40 - 5 * i)]
        )
        assert (len(log.fixes[0].time), log.left_out, log.warnings) == (90, {}, [])
        assert np.ptp(log.fixes[0].places, axis=0) == pytest.approx([0, 0], abs=0.1)

    @pytest.mark.parametrize(("east", "turn", "what"), [(25, 0, "position"), (0, 10, "heading")])
    def test_two_instruments_for_one_thing_are_told(self, read, east, turn, what):
        lines = [gga("143700"), gga("143700", east), signed("HEHDT,45.0,T"), signed(f"GPHDT,{45 + turn},T")]
        log = read([*lines, hipap("143700", 20, 40, up="H")])
        assert log.warnings == [f"the boat's {what} jumps 1 times, as if it came from two instruments; keep one"]

    def test_a_clock_of_the_modems_own_is_set_by_the_boats(self, read):
        log = read(
            line
            for i in range(40)
            for line in [*[gga(f"1230{i:02d}", 5 * i)] * (i % 10 == 0), usbllong(7000 + i, 6999 + i, 100 - 5 * (i - 1))]
        )
        assert np.ptp(log.fixes[0].places, axis=0) == pytest.approx([0, 0], abs=0.1)
        middle = np.median(5 * (np.arange(40) - 1))  # of the boat's places at the times of the fixes, m east of 5° E
        assert log.scenario.water.longitude == pytest.approx(5 + (middle - 100) / 55802, abs=2e-6)

    def test_headings_are_interpolated_over_north(self, read):
        log = read(
            line
            for i in range(0, 20, 5)
            for line in [
                gga(f"1230{i:02d}"),
                signed(f"HEHDT,{(350 + i) % 360},T"),
                *(hipap(f"1230{i + j:02d}", *turned(40, 20, 350 + i + j), up="H") for j in range(5)),
            ]
        )
        assert np.ptp(log.fixes[0].places, axis=0) == pytest.approx([0, 0], abs=0.1)

    def test_headings_keep_their_time_where_fixes_are_logged_late(self, read):
        """The boat turns by 3° a second, and a fix is logged two seconds after it is made."""
        log = read(
            line
            for i in range(2, 60)
            for line in [
                gga(at(i)),
                *(signed(f"HEHDT,{3 * (i + part):.2f},T") for part in (0.25, 0.5)),
                hipap(at(i - 2), *turned(40, 20, 3 * (i - 2)), up="H"),
            ]
        )
        assert abs(log.fixes[0].places[2:] - [120, 140]).max() < 0.1

    @pytest.mark.parametrize(
        ("lines", "left_out"),
        [
            ([gga("000000")], "position is up to 52629 s older"),
            ([gga("143900")], "position is up to 120 s later"),
            ([gga("143635"), gga("143645", 100)], "position is up to 24 s older"),  # it went 100 m in the last 10 s
            (
                [gga("143500"), signed("HEHDT,45.0,T"), gga("143502"), gga("143700"), gga("143710")],
                "heading is up to 128 s older",
            ),
        ],
    )
    def test_what_is_too_old_is_refused_with_its_age(self, read, lines, left_out):
        up = "H" if "HDT" in "".join(lines) else "N"
        with pytest.raises(UserError, match=f"no fix in it: left out: .* × the boat's {left_out} than the fix"):
            read([*lines, *(hipap(f"1437{i:02d}", 20, 40, up=up) for i in range(10))])

    def test_a_turning_boat_is_not_where_it_went_half_a_minute_ago(self, read):
        east = [100 + 50 * math.cos(i / 30) for i in range(90)]
        log = read(
            line for i in range(90) for line in [*[gga(at(i), east[i])] * (i % 30 == 0), hipap(at(i), 0, -east[i])]
        )
        assert log.left_out == {"the boat's position is up to 29 s older than the fix": 19}

    @pytest.mark.parametrize("off", [-18, 18])
    def test_a_clock_that_is_not_that_of_the_positions_is_told(self, read, off):
        log = read(line for i in range(60) for line in [gga(at(60 + i), 2 * i), hipap(at(60 + i + off), 0, 0)])
        assert re.match(r"fixes are logged 1[78] s off the times of \$--GGA beside them: is one ", log.warnings[-1])

    def test_a_position_that_seems_to_hold_is_told_by_its_age(self, read):
        log = read([gga("143700"), *(hipap(f"1437{i:02d}", 20, 40) for i in range(27))])
        assert log.warnings == ["the boat's position is up to 26 s from the time of a fix"]
        assert len(log.fixes[0].time) == 27


class TestBeacons:
    AUV = tuple(hipap(f"1437{i:02d}", 20, 40) for i in range(9))

    @pytest.mark.parametrize(
        ("more", "reason"),
        [
            ([signed(f"PSIMSSB,14370{i},M03,A,NRy,C,N,F,0,0,0,20.0,T,0.01,") for i in range(8)], "error code 'NRy'"),
            ([hipap(f"14370{i}", 0, 0, 0) for i in range(8)], "at 0, 0, 0"),
            ([hipap(f"14370{i}", 1.2, -0.4, 4.5, "B01") for i in range(8)], "'B01', at the boat, depth 4.5 m"),
            ([hipap(f"14370{i}", 35, -20, 0.3, "B01") for i in range(8)], "'B01', at the surface, depth 0.3 m"),
            ([signed(f"PSONLLD,14370{i},R/V Ida,A,60.0,5.1,3.0,,,,") for i in range(8)], "'R/V Ida', the ship"),
            ([signed(f"PSONLLD,14370{i},Ida,A,60.0,5.0,3.0,,,,") for i in range(8)], "'Ida', at the boat, depth 3.0 m"),
            (
                [signed(f"PTSAG,#1,14370{i},1,6,2020,0,6000.0,N,00500.1,E,F,5.8,1,9999") for i in range(8)],
                "'0', the ship",
            ),
        ],
    )
    def test_what_is_no_auv_is_left_out_and_counted(self, read, more, reason):
        log = read([gga("143700"), gga("143705"), *self.AUV, *more])
        assert [fixes.name for fixes in log.fixes] == ["M03"]
        assert log.left_out == {reason: 8}
        assert f"left out: 8 × {reason}" in log.warnings

    def test_an_auv_under_the_boat_is_one(self, read):
        log = read([gga("143700"), *(hipap(f"14370{i}", 0.3, 0.2, 45) for i in range(5))])
        assert len(log.fixes[0].time) == 5

    @pytest.mark.parametrize("order", [1, -1], ids=["oldest first", "newest first"])
    def test_where_an_auv_is_last_decides(self, read, order):
        depths = {"dives": range(0, 60, 5), "comes up": range(55, -1, -5)}
        rows = [f"{i},{name},50,60,{max(z - 30, 0)}" for name, way in depths.items() for i, z in enumerate(way)]
        log = read(["time,auv,x,y,depth", *rows[::order]])
        assert [fixes.name for fixes in log.fixes] == ["dives"]
        assert log.left_out == {"'comes up', at the surface, depth 0.0 m": 12}

    def test_beacons_are_picked(self, read):
        rows = ["time,auv,x,y,depth", *(f"{i},M{k:02d},{50 + k},60,{k}" for k in range(66) for i in range(3))]
        with pytest.raises(UserError, match=r"65 beacons, at most 64 .* --beacon NAME.*'M00' \(3\), 'M01' \(3\)"):
            read(rows)
        with pytest.raises(UserError, match="no fix of --beacon 'M3'; beacons and their fixes: 'M00'"):
            read(rows, "M03", "M3")
        assert [fixes.name for fixes in read(rows, "M03", "M00").fixes] == ["M00", "M03"]  # also at the surface


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
    def test_json_and_table_say_what_is_left_out(self, plan, tmp_path):
        names = ["Ω水中😀" * 20, "surfaced"]
        rows = [f"{i},{name},{50 + i},60,{40 * (name[0] == 'Ω')}" for name in names for i in range(5)]
        (tmp_path / "log.csv").write_text("\n".join(["time,auv,x,y,depth", *rows]), encoding="utf-8")
        code, out, err = plan("--log", "log.csv", "--json", "plan.json")
        assert (code, err) == (0, "warning: --log log.csv: left out: 5 × 'surfaced', at the surface, depth 0.0 m\n")
        said = json.loads((tmp_path / "plan.json").read_text())
        assert [auv["name"] for auv in said["log"]] == names[:1]
        assert [auv["name"] for auv in said["auvs"]] == names[:1]
        assert said["left_out"] == {"'surfaced', at the surface, depth 0.0 m": 5}
        assert (tmp_path / "plan.png").exists()
        assert "Ω水中😀" in out
        code, _, err = plan("--auv", "60,80,100", "--beacon", "a")
        assert (code, err) == (2, "error: --beacon: selects AUVs of a log; needs --log\n")

    def test_from_a_simulated_run_to_a_place_for_the_boat(self, run_usvauv, tmp_path):
        trace = synthetic_trace(steps=60)
        export_trace(trace, "csv", tmp_path)
        code, out, _ = run_usvauv("plan", "--log", "fixes.csv", "--json", "-")
        assert code == 0
        said = json.loads(out)
        for k, (found, auv) in enumerate(zip(said["log"], said["auvs"], strict=True)):
            assert (found["age"], found["uncertainty"]) == (0, found["accuracy"])
            assert (found["fixes"], found["used"]) == (60, 7)
            assert math.dist((auv["x"], auv["y"]), trace.auv_position[-1, 0, k]) < 3
            assert found["noise"] == pytest.approx(np.sqrt(0.13), rel=0.5)
        assert 0 < said["optimum"]["x"] < trace.scenario.area.width

    def test_old_fixes_are_uncertain_and_very_old_ones_left_out(self, plan, tmp_path):
        """AUVs of up to 2 m/s that were last heard 0, 20 and 300 s before the end, in 200 m."""
        rows = [
            f"{t},{name},{place},90"
            for name, last, place in (("now", 400, "60,60"), ("lately", 380, "120,80"), ("lost", 100, "150,150"))
            for t in range(last - 9, last + 1)
        ]
        (tmp_path / "log.csv").write_text("\n".join(["time,auv,x,y,depth", *rows]))
        code, _, err = plan("--log", "log.csv", "--json", "plan.json")
        assert code == 0
        assert "left out 'lost' (300 s)" in err
        now, lately = json.loads((tmp_path / "plan.json").read_text())["log"]
        assert (now["name"], now["age"], lately["name"], lately["age"]) == ("now", 0, "lately", 20)
        assert now["uncertainty"] < 0.1
        assert 0.8 * 40 < lately["uncertainty"] < 40  # of at most 2 m/s × 20 s
        code, _, err = plan("--log", "log.csv", "--beacon", "lost")
        assert code == 2
        assert "no AUV is left: 'lost' (300 s)" in err


def test_auvs_have_the_depths_of_the_log_whatever_the_scenarios_cruise_depth(plan, tmp_path):
    """`extreme` has AUVs at 100 m, which water of 60 m does not allow."""
    rows = "".join(f"{time},a,100,80,30\n{time},b,50,20,40\n" for time in range(4))
    (tmp_path / "fixes.csv").write_text(f"time,auv,x,y,depth\n{rows}")
    places = []
    for settings in ([], ["--set", "auv.depth=35"]):
        code, stdout, stderr = plan("--log", "fixes.csv", "--set", "area.depth=60", *settings, "--json", "-")
        assert code == 0, stderr
        result = json.loads(stdout)
        assert [auv["depth"] for auv in result["auvs"]] == [30, 40]
        places.append(result["optimum"])
    assert places[0] == places[1]
    assert plan("--log", "fixes.csv", "--set", "area.depth=60", "--set", "auv.depth=70")[0] == 2
