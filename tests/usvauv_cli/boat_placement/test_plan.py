"""`usvauv plan`: optimum, errors and probabilities as drawn fixes have them, remedies, JSON, figure, bad input."""

import functools
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.links import TILTING, TILTING_OPTIONS
from usvauv.env import Scenario
from usvauv.env.accuracy.fix_errors import predict
from usvauv.env.site.site import Site
from usvauv.env.world.mission_parameters import link_table
from usvauv.kernels.planning import objectives, search
from usvauv.kernels.positioning import acoustic_link, usbl

TEAM = ["--auv", "60,80,100", "--auv", "150,120,40"]
POSITIONS = [(60.0, 80.0, 100.0), (150.0, 120.0, 40.0)]
PLACE_KEYS = {"x", "y", "latitude", "longitude", "log_objective", "rms", "mean", "located", "errors", "budget"}
ERROR_KEYS = {
    *("range", "major", "minor", "angle", "good"),
    *("detected", "good_if_detected", "wrapped", "direct_ray", "signal_excess"),
}


def planner(objective: str, measurement: str) -> list[str]:
    return [f"--set=planner.objective={objective}", f"--set=planner.measurement={measurement}"]


def link(scenario, count, depth, *changes):
    team = f"auv.count={count}", f"auv.depth={depth}"
    return torch.from_numpy(link_table(Site(Scenario.load(scenario, [*TILTING, *team, *changes]))))


@pytest.fixture
def plan(run_usvauv):
    """Run `usvauv plan` with a simple link in an empty folder: exit code, stdout, stderr."""
    return functools.partial(run_usvauv, "plan", *TILTING_OPTIONS)


class TestOptimum:
    @pytest.mark.parametrize(("objective", "measurement"), [("d", "fix"), ("a", "phase")])
    def test_is_that_of_the_planner(self, solve, device, objective, measurement):
        result = solve(*TEAM, *planner(objective, measurement), "--compare", "20,180")
        code = objectives.objective_code(measurement, objective)
        table, points = link("extreme", 2, 70).to(device), torch.tensor([POSITIONS], device=device)
        expected = search.plan_batch(table, points, code=code)[0].tolist()
        best = result["optimum"]
        assert [best["x"], best["y"]] == pytest.approx(expected[:2], abs=1e-4)
        assert best["log_objective"] == pytest.approx(expected[2], abs=1e-4)
        boat = torch.tensor([[20.0, 180.0]], device=device)
        there = objectives.log_objective_batch(table, points, boat, code=code)[0, 0].item()
        assert result["compare"][0]["log_objective"] == pytest.approx(there, abs=1e-4)
        assert result["compare"][0]["log_objective"] < best["log_objective"]
        assert result["centroid"]["log_objective"] <= best["log_objective"] + 1e-5

    def test_default_is_the_scenarios(self, solve):
        result = solve("paper-extreme", *TEAM)
        assert (result["objective"], result["measurement"]) == ("sum", "phase")
        result = solve(*TEAM)
        assert (result["objective"], result["measurement"]) == ("d", "fix")

    def test_one_auv_is_located_best_from_above(self, solve):
        best = solve("--auv", "31,171,80")["optimum"]
        assert (best["x"], best["y"]) == pytest.approx((31, 171), abs=1e-2)
        assert best["errors"][0]["range"] == pytest.approx(80, abs=1e-3)


class TestFixesThatFail:
    """Eight AUVs in 600 m, of which a boat hears those within some 200 m."""

    SCATTERED = "60,80 110,140 95,60 480,90 520,150 300,560 580,580 30,570"

    @pytest.fixture
    def solve(self, run_usvauv):
        def solve(*places):
            auvs = (word for place in places for word in ("--auv", f"{place},100"))
            code, out, _ = run_usvauv("plan", "wide", *auvs, "--json", "-")
            assert code == 0
            return json.loads(out)

        return solve

    def test_probability_is_that_of_fixes(self, device):
        """The planner's probability, from its objective of one AUV, against that of the predicted errors."""
        weak = torch.from_numpy(link_table(Site(Scenario.load("wide", ["auv.count=1"])))).to(device)
        sure = weak.clone()
        sure[:, acoustic_link.CERTAIN] = 0.0
        places = torch.linspace(0, 400, 41)
        boats = torch.stack([places, torch.zeros(41)], 1).to(device)
        auv = torch.tensor([[[0.0, 0.0, -100.0]]], device=device).repeat(41, 1, 1)
        code = objectives.objective_code("fix", "d")
        value, good = (objectives.log_objective_batch(table, auv, boats, code=code)[:, 0] for table in (weak, sure))
        without = weak[0, acoustic_link.UNLOCATED]
        probability = ((value - without) / (good - without)).cpu().numpy()
        errors = [predict(weak, None, [(0.0, 0.0, 100.0)], (x, 0.0), "fix", (0.0, 0.0))[0] for x in places.tolist()]
        assert probability == pytest.approx([error.good for error in errors], abs=0.03)  # Φ as logistic

    def test_an_auv_out_of_range_moves_the_boat_no_more(self, solve):
        near = self.SCATTERED.split()[:3]
        alone, beside = solve(*near)["optimum"], solve(*near, "590,590")["optimum"]
        assert (beside["x"], beside["y"]) == pytest.approx((alone["x"], alone["y"]), abs=0.5)
        assert beside["errors"][-1]["good"] < 0.01

    def test_hears_no_fewer_than_the_centroid(self, solve):
        result = solve(*self.SCATTERED.split())
        assert (result["optimum"]["located"], result["centroid"]["located"]) == (3, 1)
        assert result["verdict"] == "3 of 8 AUVs are located instead of 1"

    def test_the_verdict_where_all_are_heard(self, solve):
        assert solve("260,300", "330,310")["verdict"] == "errors are within 2%, the place hardly matters"


class TestErrors:
    @pytest.mark.parametrize(
        ("measurement", "attitude_error", "slope"),
        [("fix", 0.0, (0.0, 0.0)), ("fix", 0.004, (0.2, -0.1)), ("phase", 0.004, (0.2, -0.1))],
    )
    def test_ellipses_are_those_of_drawn_fixes(self, solve, device, measurement, attitude_error, slope):
        """200,000 fixes by the kernel; for phases alone each is moved along its direction to the known depth."""
        options = [f"--set=planner.measurement={measurement}", "--set", f"usbl.attitude_error={attitude_error}"]
        options += ["--slope", f"{slope[0]},{slope[1]}"]
        result = solve(*TEAM, *options, "--compare", "100,20")
        draws = 200_000
        noise = torch.randn(draws, 5, generator=torch.Generator().manual_seed(3)).to(device)
        table = link("extreme", 2, 70, f"usbl.attitude_error={attitude_error}").to(device)
        for place in (result["optimum"], result["centroid"], result["compare"][0]):
            total = 0.0
            for k, ((x, y, depth), error) in enumerate(zip(POSITIONS, place["errors"], strict=True)):
                offset = torch.tensor([x - place["x"], y - place["y"], -depth], device=device)
                index = torch.full((draws,), k, dtype=torch.int32, device=device)
                many = offset.expand(draws, 3).contiguous()
                slopes = torch.tensor(slope, device=device).expand(draws, 2).contiguous()
                estimate = usbl.fixes(table, index, many, slopes, noise)[0].double().cpu().numpy()
                horizontal = estimate[:, :2]
                if measurement == "phase":
                    horizontal = horizontal * (-depth / estimate[:, 2:3])
                variances, axes = np.linalg.eigh(np.cov(horizontal.T))
                total += variances.sum()
                assert error["minor"] == pytest.approx(math.sqrt(variances[0]), rel=0.01)
                assert error["major"] == pytest.approx(math.sqrt(variances[1]), rel=0.01)
                assert error["range"] == pytest.approx(offset.norm().item(), rel=1e-5)
                if error["major"] > 1.1 * error["minor"]:
                    along = [math.cos(error["angle"]), math.sin(error["angle"])]
                    assert abs(np.dot(along, axes[:, 1])) > 0.999
            assert place["rms"] == pytest.approx(math.sqrt(total / 2), rel=0.01)

    @pytest.mark.parametrize(
        ("objective", "measure", "measurement"),
        [("d", "mean", "fix"), ("a", "rms", "phase"), pytest.param("a", "rms", "fix", marks=pytest.mark.slow)],
    )
    def test_no_place_has_a_smaller_error_than_the_best(self, solve, objective, measure, measurement):
        """Of all causes, for unequal depths; contours show the same error."""
        auvs = [argument for auv in ("40,80,100", "150,120,25", "120,30,60") for argument in ("--auv", auv)]
        places = [f"--compare={x},{y}" for x in range(10, 200, 45) for y in range(10, 200, 45)]
        loud = ("--set", "acoustics.source_level=210")  # so that all fixes are good
        result = solve(*auvs, *places, *loud, *planner(objective, measurement))
        best = result["optimum"]
        for place in (result["centroid"], *result["compare"]):
            assert best[measure] < place[measure]
            ratio = math.exp((best["log_objective"] - place["log_objective"]) / (4 * 3 if objective == "d" else 2))
            assert place[measure] / best[measure] == pytest.approx(ratio, rel=1e-3)

    def test_an_auv_in_the_plane_of_the_array_has_no_bounded_error(self, plan, solve, tmp_path):
        """From (50, 100) it is 50 m east and 50 m below, in the plane of an array that falls by 1 in 1 to the east."""
        phases = ["--auv", "100,100,50", "--compare", "50,100", "--slope=-1,0", "--set=planner.measurement=phase"]
        there = solve(*phases)["compare"][0]
        assert there["rms"] is None
        assert (there["errors"][0]["major"], there["errors"][0]["angle"]) == (None, None)
        code, stdout, stderr = plan(*phases, "--out", "plan.png")
        assert (code, stderr) == (0, "")
        assert "none" in stdout
        assert "nan" not in stdout.lower()
        assert (tmp_path / "plan.png").exists()


class TestOutput:
    def test_json_has_the_documented_keys(self, solve, tmp_path):
        result = solve(*TEAM, "--compare", "0,0", "--compare", "200,200")
        assert set(result) == {
            *("scenario", "verdict", "objective", "measurement", "slope", "area", "auvs"),
            *("optimum", "centroid", "compare", "warnings"),
        }
        assert result["area"] == {"width": 200, "length": 200, "depth": 120}
        unplaced = {"latitude": None, "longitude": None}
        assert result["auvs"][1] == {"name": "2", "x": 150, "y": 120, "depth": 40, "carrier": 18000} | unplaced
        assert (result["centroid"]["x"], result["centroid"]["y"]) == (105, 100)
        assert [(place["x"], place["y"]) for place in result["compare"]] == [(0, 0), (200, 200)]
        for place in (result["optimum"], result["centroid"], *result["compare"]):
            assert set(place) == PLACE_KEYS
            assert [set(error) for error in place["errors"]] == [ERROR_KEYS, ERROR_KEYS]
        assert not list(tmp_path.iterdir())  # --json - alone writes no file

    def test_the_docs_explain_the_keys(self):
        text = (Path(__file__).parents[3] / "docs" / "export.md").read_text()
        for key in PLACE_KEYS | ERROR_KEYS | {"optimum", "centroid", "compare", "carrier", "depth", "warnings"}:
            assert f"`{key}`" in text

    def test_table_and_files(self, plan, tmp_path):
        name = "name=Cost $5_a^{ $ % & # 海 🌊 مرحبا"  # neither mathematics nor a warning of letters
        code, stdout, stderr = plan(*TEAM, "--compare", "12,34", "--json", "plan.json", "--set", name)
        assert stderr == ""
        result = json.loads((tmp_path / "plan.json").read_text())
        assert code == 0
        for part in (f"x = {result['optimum']['x']:.2f} m", "centroid", "12.00", "34.00", "major m", "plan.png"):
            assert part in stdout
        for error in result["compare"][0]["errors"]:
            assert f"{error['major']:.3f}" in stdout
        assert sorted(path.name for path in tmp_path.iterdir()) == ["plan.json", "plan.png"]


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        ([], ["--auv", "X,Y,Z"]),
        (["--auv", "60,80,nan"], ["nan", "depth"]),
        (["--auv", "60,80,121"], ["--auv '60,80,121'", "120 m", "area.depth"]),
        (["--auv", "9,9,9"] * 65, ["65", "at most 64"]),
        ([*TEAM, "--slope", "0.1,2"], ["--slope '0.1,2'", "between -1 and 1"]),
        ([*TEAM, "--json", "missing/plan.json"], ["missing", "does not exist"]),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(refused, tmp_path, arguments, parts):
    said = refused("plan", *arguments)
    assert [part for part in parts if part not in said] == []
    assert not list(tmp_path.iterdir())


WIDE = ["--set", "area.width=2000", "--set", "area.length=2000"]
FAR = ["--auv", "60,80,100", "--auv", "1500,1200,90", *WIDE]
APART = ["--auv", "60,80,100", "--auv", "800,680,90", *WIDE]
DEAF = ["--auv", "20,20,100", "--set", "acoustics.source_level=60"]
BROAD = ["--auv", "20,20,100", "--auv", "199,199,100", "--set", "usbl.spacing=0.08"]
FLAT = ["--auv", "20,20,3", "--auv", "190,180,2"]
SHADOW = ["--set", "acoustics.sound_speed_profile=[[0,1500],[200,1400]]", "--set", "acoustics.path=transponder"]
SHADOW += ["--set", "acoustics.source_level=190", *WIDE]


class TestProbabilities:
    @pytest.mark.parametrize(
        ("place", "settings"),
        [
            ("170,20", ["usbl.spacing=0.06"]),
            ("180,20", ["usbl.spacing=0.06", "acoustics.source_level=151"]),
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
        excess = solve(*loud, "acoustics.source_level=162")["centroid"]["errors"][0]["signal_excess"]
        fainter = solve(*loud, f"acoustics.source_level={162 - excess!r}")["centroid"]["errors"][0]
        assert excess > 5
        assert fainter["signal_excess"] == pytest.approx(0, abs=1e-4)
        assert fainter["detected"] == pytest.approx(0.5, abs=1e-3)

    @pytest.mark.parametrize("share", [0.97, 1.03])
    def test_direct_rays_end_where_the_last_arc_does(self, solve, share):
        """In c = 1500 − z/2 rays are circles of 3000 m; the one that is level at the array is the last."""
        depth, radius = 80.0, 3000.0
        farthest = math.sqrt(radius**2 - (radius - depth) ** 2)
        there = ["--auv", f"0,0,{depth}", "--compare", f"{share * farthest},0", *SHADOW]
        error = solve(*there)["compare"][0]["errors"][0]
        assert error["direct_ray"] is (share < 1)
        assert (error["detected"] > 0.99) is (share < 1)


class TestRemedies:
    @pytest.mark.parametrize(
        ("arguments", "parts"),
        [
            (FAR, ["AUV 1 not", "0.0% of fixes good (least 90%)", "not detected", "dB below the threshold at 1827 m"]),
            (DEAF, ["AUV 1 not", "more than 30 dB below", "neither 30 dB more nor a nearer boat alone would"]),
            (BROAD, ["AUV 1 not", "a phase has wrapped in 100.0%", "usbl.spacing=", "now 0.08"]),
            (FLAT, ["AUV 1 not", "no real depth"]),
            (["--auv", "0,0,50", "--auv", "1900,0,50", *SHADOW], ["AUVs 1, 2 not", "no direct ray"]),
        ],
    )
    def test_warnings_name_auvs_reason_and_limit(self, solve, arguments, parts):
        (line,) = solve(*arguments)["warnings"]
        for part in (*parts, "located from the optimum", "would change it"):
            assert part in line

    @pytest.mark.parametrize("more", [["--set=planner.objective=a"]])
    def test_the_source_level_is_the_least_that_does(self, solve, more):
        """At the same place: the optimum can move a little with the level."""
        result = solve(*APART, *more)
        level = int(re.search(r"acoustics\.source_level=(\d+)", result["warnings"][0])[1])
        place = f"{result['optimum']['x']!r},{result['optimum']['y']!r}"
        located = [
            solve(*APART, *more, "--compare", place, "--set", f"acoustics.source_level={source}")["compare"][0][
                "located"
            ]
            for source in (level - 1, level)
        ]
        assert located[0] < located[1] == 2

    def test_half_a_wavelength_ends_wrapping(self, solve):
        (line,) = solve(*BROAD)["warnings"]
        spacing = float(re.search(r"usbl\.spacing=([\d.]+)", line)[1])
        assert spacing == pytest.approx(1500 / 15000 / 2, abs=2e-4)
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
