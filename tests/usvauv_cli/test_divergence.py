"""A state that cannot be, in each command: one line, exit code 2, and what was good before is kept."""

import csv
import math

from usvauv.env import Trace, World

SCENARIO = ("--set", "mission.duration=8", "--set", "sea.fine_cells=32", "--set", "sea.cell_size=20")


def breaking(monkeypatch, at, world=0):
    """Put NaN into an AUV's place before the step `at`, counted over all worlds made from now on."""
    whole, done = World.step, []

    def step(self, action):
        done.append(self)
        if len(done) == at:
            self.auv[world, 0, 0] = math.nan
        return whole(self, action)

    monkeypatch.setattr(World, "step", step)


def test_simulate_keeps_video_and_trace_of_the_steps_before(tmp_path, run_usvauv, monkeypatch):
    breaking(monkeypatch, 6)
    video, trace = tmp_path / "v.mp4", tmp_path / "t.nc"
    command = ("simulate", "extreme", *SCENARIO, "--policy", "straight", "--size", "320x320")
    code, _, error = run_usvauv(*command, "--out", video, "--trace", trace)
    assert code == 2
    assert error.splitlines()[-1].startswith("error: world 0 at 6 s: ")
    assert Trace.load(trace).time.tolist() == [1, 2, 3, 4, 5]
    assert video.stat().st_size > 0
    assert sorted(tmp_path.iterdir()) == [trace, video]


def test_eval_keeps_the_episodes_that_are_complete(tmp_path, run_usvauv, monkeypatch):
    breaking(monkeypatch, 8 + 3, world=1)
    out, report = tmp_path / "m.csv", tmp_path / "report"
    command = ("eval", "extreme", *SCENARIO, "--policy", "straight", "--policy", "crab", "--episodes", 2, "--out", out)
    code, said, error = run_usvauv(*command, "--report", report)
    assert code == 2
    assert error.splitlines()[-1].startswith("error: world 1 at 3 s: ")
    kept = tmp_path / "m.csv.partial"
    with (kept / "0-0-2.csv").open() as stream:
        assert [row["policy"] for row in csv.DictReader(stream)] == ["straight"] * 2
    assert said == f"stopped; 2 complete episodes kept in {kept}; --resume goes on from there\n"
    assert not out.exists()
    assert list(report.iterdir()) == []
