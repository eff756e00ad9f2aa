"""`usvauv plan` where fixes are not to be had: probabilities, what warnings say, and that remedies work."""

import functools
import math
import re

import pytest
import torch

from tests.links import TILTING, TILTING_OPTIONS
from usvauv.env import Scenario
from usvauv.env.planning.fix_errors import FixError
from usvauv.env.planning.plan import reason
from usvauv.env.site.site import Site
from usvauv.env.world.tables import link_table
from usvauv.kernels.positioning import usbl

WIDE = ["--set", "area.width=2000", "--set", "area.length=2000"]
FAR = ["--auv", "60,80,100", "--auv", "1500,1200,90", *WIDE]
DEAF = ["--auv", "20,20,100", "--set", "acoustics.source_level=60"]
BROAD = ["--auv", "20,20,100", "--auv", "199,199,100", "--set", "usbl.spacing=0.08"]
FLAT = ["--auv", "20,20,3", "--auv", "190,180,2"]
SHADOW = ["--set", "acoustics.sound_speed_profile=[[0,1500],[200,1400]]", "--set", "acoustics.path=transponder"]
SHADOW += ["--set", "acoustics.source_level=190", *WIDE]


@pytest.fixture
def plan(run_usvauv):
    """Run `usvauv plan` with a simple link in an empty folder: exit code, stdout, stderr."""
    return functools.partial(run_usvauv, "plan", *TILTING_OPTIONS)


class TestProbabilities:
    @pytest.mark.parametrize(
        ("place", "settings"),
        [
            ("170,20", ["usbl.spacing=0.06"]),
            ("170,170", ["usbl.spacing=0.071"]),
            ("180,20", ["usbl.spacing=0.06", "acoustics.source_level=151"]),
            ("199,20", ["acoustics.source_level=151", "usbl.spacing=0.04"]),
            ("199,199", ["acoustics.source_level=155", "usbl.spacing=0.02"]),
        ],
    )
    def test_are_the_shares_of_drawn_fixes(self, solve, device, place, settings):
        changes = [part for setting in settings for part in ("--set", setting)]
        error = solve("--auv", "20,20,20", "--compare", place, *changes)["compare"][0]["errors"][0]
        x, y = map(float, place.split(","))
        draws = 40_000
        noise = torch.randn((draws, 6), generator=torch.Generator().manual_seed(5)).to(device)
        table = link_table(Site(Scenario.load("extreme", [*TILTING, "auv.count=1", "auv.depth=20", *settings])))
        offset = noise.new_tensor([20.0 - x, 20.0 - y, -20.0]).expand(draws, 3).contiguous()
        index = torch.zeros(draws, dtype=torch.int32, device=device)
        level = offset.new_zeros(draws, 2)
        flags = usbl.fixes(torch.from_numpy(table).to(device), index, offset, level, noise)[2].cpu().numpy()
        detected = flags & usbl.DETECTED > 0
        # Predictions take phases as independent of the amplitude.
        for name, drawn in (
            ("detected", detected),
            ("good_if_detected", flags[detected] == usbl.DETECTED),
            ("wrapped", flags[detected] & usbl.WRAPPED > 0),
            ("good", flags == usbl.DETECTED),
        ):
            assert error[name] == pytest.approx(drawn.mean(), abs=0.02), name
        assert error["good"] == pytest.approx(error["detected"] * error["good_if_detected"])

    @pytest.mark.parametrize("law", ["density", "demonstration"])
    def test_signal_excess_is_in_decibels_of_the_source(self, solve, law):
        """A tone that much fainter is detected every second time."""
        loud = ["--auv", "20,20,100", "--set", f"acoustics.noise_law={law}", "--set"]
        excess = solve(*loud, "acoustics.source_level=162")["optimum"]["errors"][0]["signal_excess"]
        fainter = solve(*loud, f"acoustics.source_level={162 - excess!r}")["optimum"]["errors"][0]
        assert excess > 5
        assert fainter["signal_excess"] == pytest.approx(0, abs=1e-4)
        assert fainter["detected"] == pytest.approx(0.5, abs=1e-3)

    def test_nothing_is_detected_of_the_faintest_tones(self, solve):
        error = solve(*DEAF)["optimum"]["errors"][0]
        assert error["signal_excess"] < -40
        assert (error["detected"], error["good"]) == (0, 0)

    @pytest.mark.parametrize("share", [0.97, 1.03])
    def test_direct_rays_end_where_the_last_arc_does(self, solve, share):
        """In c = 1500 − z/2 rays are circles of 3000 m; the one that is level at the array is the last."""
        depth, radius = 80.0, 3000.0
        farthest = math.sqrt(radius**2 - (radius - depth) ** 2)
        there = ["--auv", f"0,0,{depth}", "--compare", f"{share * farthest},0", *SHADOW]
        error = solve(*there)["compare"][0]["errors"][0]
        assert error["direct_ray"] is (share < 1)
        assert (error["detected"] > 0.99) is (share < 1)

    def test_the_reason_is_the_largest_loss(self):
        def error(detected: float, good: float, wrapped: float, ray: bool = True) -> FixError:
            return FixError(100.0, 1.0, 1.0, 0.0, detected * good, detected, good, wrapped, ray, 0.0)

        assert reason(error(0.3, 0.9, 0.1)) == "undetected"
        assert reason(error(0.8, 0.3, 0.6)) == "wrapped"
        assert reason(error(0.8, 0.3, 0.1)) == "no depth"
        assert reason(error(0.0, 0.9, 0.1, ray=False)) == "no ray"


class TestRms:
    def test_is_that_of_the_auvs_located(self, solve, plan, tmp_path):
        result = solve(*FAR)
        best = result["optimum"]
        near, far = sorted(best["errors"], key=lambda error: error["range"])
        assert (best["located"], far["good"]) == (1, 0)
        assert best["rms"] == pytest.approx(math.hypot(near["major"], near["minor"]))
        code, stdout, stderr = plan(*FAR, "--compare", "0,0")
        assert f"a fix is {best['rms']:.2f} m off (rms, 1 of 2 AUVs located)" in " ".join(stdout.split())
        assert (code, stderr.count("\n")) == (0, 1)
        assert (tmp_path / "plan.png").exists()

    def test_is_none_where_nobody_is(self, solve, plan):
        assert solve(*DEAF)["optimum"]["rms"] is None
        code, stdout, stderr = plan(*DEAF)
        assert (code, stderr.count("\n")) == (0, 1)
        assert "the AUV is not located from there" in " ".join(stdout.split())
        assert "(rms" not in stdout

    def test_nothing_is_said_where_all_are_located(self, plan):
        code, stdout, stderr = plan("--auv", "60,80,100", "--auv", "150,120,40")
        assert (code, stderr) == (0, "")
        assert "m off (rms)" in " ".join(stdout.split())


class TestRemedies:
    @pytest.mark.parametrize(
        ("arguments", "parts"),
        [
            (FAR, ["AUV 1 not", "0.0% of fixes good (least 90%)", "not detected", "dB below the threshold at 1813 m"]),
            (DEAF, ["AUV 1 not", "more than 30 dB below", "neither 30 dB more nor a nearer boat alone would"]),
            (BROAD, ["AUV 2 not", "a phase has wrapped in 100.0%", "usbl.spacing=", "now 0.08"]),
            (FLAT, ["AUV 1 not", "no real depth"]),
            (["--auv", "0,0,50", "--auv", "1900,0,50", *SHADOW], ["AUVs 1, 2 not", "no direct ray"]),
        ],
    )
    def test_warnings_name_auvs_reason_and_limit(self, solve, arguments, parts):
        (line,) = solve(*arguments)["warnings"]
        for part in (*parts, "located from the optimum", "would change it"):
            assert part in line

    def test_a_line_for_each_reason(self, solve):
        close = ["--auv", "20,20,100", "--auv", "25,20,100", "--auv", "30,20,100"]
        far, aside = ["--auv", "1999,1999,100"], ["--auv", "220,20,100"]
        lines = solve(*close, *aside, *far, *WIDE, "--set", "usbl.spacing=0.08")["warnings"]
        assert [re.search(r"AUVs? ([\d, ]+) not", line)[1] for line in lines] == ["5", "4"]
        assert ["not detected" in line for line in lines] == [True, False]

    @pytest.mark.parametrize("more", [["--objective", "a"], ["--set", "acoustics.source_level=185"]])
    def test_the_source_level_is_the_least_that_does(self, solve, more):
        """At the same place: the optimum can move a little with the level."""
        result = solve(*FAR, *more)
        level = int(re.search(r"acoustics\.source_level=(\d+)", result["warnings"][0])[1])
        place = f"{result['optimum']['x']!r},{result['optimum']['y']!r}"
        located = [
            solve(*FAR, *more, "--compare", place, "--set", f"acoustics.source_level={source}")["compare"][0]["located"]
            for source in (level - 1, level)
        ]
        assert located[0] < located[1] == 2

    def test_half_a_wavelength_ends_wrapping(self, solve):
        (line,) = solve(*BROAD)["warnings"]
        spacing = float(re.search(r"usbl\.spacing=([\d.]+)", line)[1])
        assert spacing == pytest.approx(1500 / 18000 / 2, abs=1e-4)
        assert solve(*BROAD, "--set", f"usbl.spacing={spacing}")["warnings"] == []

    @pytest.mark.parametrize(
        ("arguments", "auv"),
        [(FAR, (60, 80)), (FLAT, (20, 20)), (["--auv", "0,0,50", "--auv", "1900,0,50", *SHADOW], (0, 0))],
    )
    def test_a_boat_within_the_distance_locates_the_auv(self, solve, arguments, auv):
        (line,) = solve(*arguments)["warnings"]
        distance = int(re.search(r"the boat within (\d+) m", line)[1])
        at = [f"{auv[0] + share * distance},{auv[1]}" for share in (0.5, 1, 1.1)]
        compare = solve(*arguments, *(part for place in at for part in ("--compare", place)))["compare"]
        good = [place["errors"][0]["good"] for place in compare]
        assert min(good[:2]) >= 0.9 > good[2]


def test_tables_fit_a_hundred_columns(plan):
    big = ["--set", "area.width=20000", "--set", "area.length=20000", "--objective", "a"]
    for arguments in (["--auv", "60,80,100"], ["--auv", "10060,80,100", "--auv", "15000,12000,90", *big]):
        stdout = plan(*arguments, "--compare", "199,199")[1]
        table = [line for line in stdout.splitlines() if not line.startswith(("Boat", "written"))]
        assert max(map(len, table)) <= 100
        assert "…" not in stdout
