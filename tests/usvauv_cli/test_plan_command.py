"""`usvauv plan`: the planner's optimum, errors as fixes have them, the JSON of the help, the figure, bad input."""

import functools
import json
import math

import numpy as np
import pytest
import torch
from matplotlib import image

from tests.links import TILTING, TILTING_OPTIONS
from usvauv.cli.planning.figure import draw
from usvauv.env import Scenario
from usvauv.env.planning.plan import solve
from usvauv.env.site.site import Site
from usvauv.env.world.tables import link_table
from usvauv.kernels.planning import objectives, search
from usvauv.kernels.positioning import usbl

TEAM = ["--auv", "60,80,100", "--auv", "150,120,40"]
POSITIONS = [(60.0, 80.0, 100.0), (150.0, 120.0, 40.0)]
PLACE_KEYS = {"x", "y", "latitude", "longitude", "log_objective", "rms", "located", "errors", "budget"}
ERROR_KEYS = {
    *("range", "major", "minor", "angle", "good"),
    *("detected", "good_if_detected", "wrapped", "direct_ray", "signal_excess"),
}


def link(scenario, count, depth, *changes):
    team = f"auv.count={count}", f"auv.depth={depth}"
    return torch.from_numpy(link_table(Site(Scenario.load(scenario, [*TILTING, *team, *changes]))))


@pytest.fixture
def plan(run_usvauv):
    """Run `usvauv plan` with a simple link in an empty folder: exit code, stdout, stderr."""
    return functools.partial(run_usvauv, "plan", *TILTING_OPTIONS)


class TestOptimum:
    @pytest.mark.parametrize("objective", ["d", "a", "sum", "paper"])
    @pytest.mark.parametrize("measurement", ["fix", "phase"])
    def test_is_that_of_the_planner(self, solve, device, objective, measurement):
        result = solve(*TEAM, "--objective", objective, "--measurement", measurement, "--compare", "20,180")
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
        result = solve(*TEAM, "--scenario", "paper-extreme")
        assert (result["objective"], result["measurement"]) == ("sum", "phase")
        result = solve(*TEAM)
        assert (result["objective"], result["measurement"]) == ("d", "fix")

    def test_lies_in_the_area(self, solve):
        """Single precision rounds 100.3 up."""
        sides = ("--set", "area.width=100.3", "--set", "area.length=100.3")
        best = solve("--auv", "100.3,100.3,80", *sides)["optimum"]
        assert (best["x"], best["y"]) == pytest.approx((100.3, 100.3), abs=1e-2)
        assert max(best["x"], best["y"]) <= 100.3

    def test_one_auv_is_located_best_from_above(self, solve):
        best = solve("--auv", "31,171,80")["optimum"]
        assert (best["x"], best["y"]) == pytest.approx((31, 171), abs=1e-2)
        assert best["errors"][0]["range"] == pytest.approx(80, abs=1e-3)


class TestErrors:
    @pytest.mark.parametrize("measurement", ["fix", "phase"])
    @pytest.mark.parametrize("attitude_error", [0.0, 0.004])
    @pytest.mark.parametrize("slope", [(0.0, 0.0), (0.2, -0.1)])
    def test_ellipses_are_those_of_drawn_fixes(self, solve, device, measurement, attitude_error, slope):
        """200,000 fixes by the kernel; for phases alone each is moved along its direction to the known depth."""
        options = ["--measurement", measurement, "--set", f"usbl.attitude_error={attitude_error}"]
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

    def test_fixes_that_may_be_no_good_say_so(self, plan, solve, device):
        """Spacing beyond half a wavelength (0.05 m at 15 kHz): sure near the nadir, not aside; and far away."""
        wide = ["--auv", "20,20,100", "--set", "usbl.spacing=0.06"]
        compare = ["--compare", "20,20", "--compare", "170,20", "--compare", "200,20"]
        good = [place["errors"][0]["good"] for place in solve(*wide, *compare)["compare"]]
        assert good[0] > 0.9999
        assert good[2] < 0.05
        assert 0.2 < good[1] < 0.8
        link = torch.from_numpy(
            link_table(Site(Scenario.load("extreme", [*TILTING, "auv.count=1", "usbl.spacing=0.06"])))
        ).to(device)
        draws = 40_000
        noise = torch.randn((draws, 6), generator=torch.Generator().manual_seed(3)).to(device)
        offset = noise.new_tensor([20.0 - 170.0, 0.0, -100.0]).expand(draws, 3).contiguous()
        index = torch.zeros(draws, dtype=torch.int32, device=device)
        flags = usbl.fixes(link, index, offset, offset.new_zeros(draws, 2), noise)[2]
        share = (flags == usbl.DETECTED).double().mean().item()
        assert good[1] == pytest.approx(share, abs=5 * math.sqrt(share * (1 - share) / draws) + 1e-4)
        assert "100.0%" in plan(*wide)[1]
        faint = solve("--auv", "20,20,100", "--compare", "180,180", "--set", "acoustics.source_level=145")
        assert faint["optimum"]["errors"][0]["good"] > 0.99
        assert faint["compare"][0]["errors"][0]["good"] < 0.01

    def test_an_auv_in_the_plane_of_the_array_has_no_bounded_error(self, plan, solve, tmp_path):
        """From (50, 100) it is 50 m east and 50 m below, in the plane of an array that falls by 1 in 1 to the east."""
        phases = ["--auv", "100,100,50", "--compare", "50,100", "--slope=-1,0", "--measurement", "phase"]
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
            *("scenario", "objective", "measurement", "slope", "area", "auvs"),
            *("optimum", "centroid", "compare", "warnings"),
        }
        assert result["area"] == {"width": 200, "length": 200, "depth": 120}
        unplaced = {"latitude": None, "longitude": None}
        assert result["auvs"][1] == {"x": 150, "y": 120, "depth": 40, "carrier": 18000} | unplaced
        assert (result["centroid"]["x"], result["centroid"]["y"]) == (105, 100)
        assert [(place["x"], place["y"]) for place in result["compare"]] == [(0, 0), (200, 200)]
        for place in (result["optimum"], result["centroid"], *result["compare"]):
            assert set(place) == PLACE_KEYS
            assert [set(error) for error in place["errors"]] == [ERROR_KEYS, ERROR_KEYS]
        assert not list(tmp_path.iterdir())  # --json - alone writes no file

    def test_help_documents_the_keys(self, plan):
        text = plan("--help")[1]
        assert "Examples" in text
        for key in PLACE_KEYS | ERROR_KEYS | {"optimum", "centroid", "compare", "carrier", "depth", "warnings"}:
            assert key in text

    def test_table_and_files(self, plan, tmp_path):
        code, stdout, _ = plan(*TEAM, "--compare", "12,34", "--json", "plan.json")
        result = json.loads((tmp_path / "plan.json").read_text())
        assert code == 0
        for part in (f"x = {result['optimum']['x']:.2f} m", "centroid", "12.00", "34.00", "major m", "plan.png"):
            assert part in stdout
        for error in result["compare"][0]["errors"]:
            assert f"{error['major']:.3f}" in stdout
        assert sorted(path.name for path in tmp_path.iterdir()) == ["plan.json", "plan.png"]

    @pytest.mark.parametrize(
        ("arguments", "shape"), [([*TEAM, "--compare", "0,0"], (200, 200)), (["--auv", "9,9,9"], (4000, 40))]
    )
    def test_figure(self, plan, tmp_path, arguments, shape):
        area = ["--set", f"area.width={shape[0]}", "--set", f"area.length={shape[1]}", "--set", "auv.start_margin=1"]
        if shape[1] == 40:
            arguments = [*arguments, "--set", "sea.cell_size=2"]
        code, _, stderr = plan(*arguments, *area, "--out", "map.png")
        assert (code, stderr) == (0, "")
        picture = image.imread(tmp_path / "map.png")
        assert min(picture.shape[:2]) > 300
        assert len(np.unique(picture.reshape(-1, picture.shape[2]).round(2), axis=0)) > 100

    def test_no_information_is_no_number(self, plan, tmp_path):
        """A depth that is 0 in single precision; whether a subnormal one is depends on the process."""
        code, stdout, stderr = plan("--auv", "60,80,1e-46", "--objective", "paper", "--json", "-", "--out", "map.png")
        result = json.loads(stdout)
        assert (code, stderr) == (0, f"warning: {result['warnings'][0]}\n")
        assert [result[place]["log_objective"] for place in ("optimum", "centroid")] == [None, None]
        assert (result["centroid"]["rms"], result["centroid"]["located"]) == (None, 0)

    def test_figure_of_a_flat_landscape_in_single_precision(self, tmp_path):
        setting = Scenario.load("extreme", ["auv.count=1"])
        result, landscape = solve(setting, [(60.0, 80.0, 100.0)], [], "d", "fix")
        flat = landscape._replace(log_objective=np.full_like(landscape.log_objective, 700.1, dtype=np.float32))
        draw(result, flat, tmp_path / "flat.png")
        assert (tmp_path / "flat.png").stat().st_size > 10_000

    def test_sixteen_auvs(self, plan, tmp_path):
        team = [part for k in range(16) for part in ("--auv", f"{10 + 11 * k},{190 - 10 * k},{20 + 6 * k}")]
        code, stdout, _ = plan(*team, "--out", "many.svg")
        assert code == 0
        assert " 16 " in stdout
        assert "<svg" in (tmp_path / "many.svg").read_text()


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        ([], ["--auv", "X,Y,Z"]),
        (["--auv", "60,80"], ["--auv '60,80'", "X,Y,Z"]),
        (["--auv", "a,b,c"], ["--auv 'a,b,c'"]),
        (["--auv", "60,80,nan"], ["nan", "depth"]),
        (["--auv", "nan,80,50"], ["nan", "area"]),
        (["--auv", "60,80,0"], ["--auv '60,80,0'", "above 0"]),
        (["--auv", "60,80,-50"], ["--auv '60,80,-50'", "above 0"]),
        (["--auv", "60,80,121"], ["--auv '60,80,121'", "120 m", "area.depth"]),
        (["--auv", "-1,80,50"], ["--auv '-1,80,50'", "[0, 200]", "area.width"]),
        (["--auv", "1,200.5,50"], ["1,200.5,50", "outside"]),
        ([*TEAM, "--compare", "1"], ["--compare '1'", "X,Y"]),
        ([*TEAM, "--compare", "1,201"], ["--compare '1,201'", "outside"]),
        (["--auv", "9,9,9"] * 17, ["17", "at most 16"]),
        ([*TEAM, "--objective", "joint"], ["--objective 'joint'", "d, a, sum, paper"]),
        ([*TEAM, "--slope", "0.1"], ["--slope '0.1'", "SX,SY"]),
        ([*TEAM, "--slope", "0.1,2"], ["--slope '0.1,2'", "between -1 and 1"]),
        ([*TEAM, "--slope", "nan,0"], ["--slope 'nan,0'", "between -1 and 1"]),
        ([*TEAM, "--measurement", "sound"], ["--measurement 'sound'", "fix, phase"]),
        ([*TEAM, "--scenario", "extrem"], ["extrem", "paper-ideal"]),
        ([*TEAM, "--out", "plan.gif"], ["plan.gif", ".png, .pdf, .svg"]),
        ([*TEAM, "--out", "missing/plan.png"], ["missing", "does not exist"]),
        ([*TEAM, "--json", "missing/plan.json"], ["missing", "does not exist"]),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(plan, tmp_path, arguments, parts):
    code, stdout, stderr = plan(*arguments)
    assert (code, stdout) == (2, "")
    assert stderr.startswith("error: ")
    assert stderr.count("\n") == 1
    for part in parts:
        assert part in stderr
    assert not list(tmp_path.iterdir())
