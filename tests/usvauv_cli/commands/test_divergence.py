"""A state that cannot be, in each command: one line, exit code 2, and what was good before is kept."""

import csv
import math

import xarray

from usvauv.env import Trace, World
from usvauv.env.sea.simulation import SeaSimulation

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
    assert said == f"stopped; 2 complete episodes kept in {kept}; --resume continues from there\n"
    assert not out.exists()
    assert list(report.iterdir()) == []


def test_sea_keeps_the_records_before(tmp_path, run_usvauv, monkeypatch):
    whole = SeaSimulation.advance

    def advance(self):
        if self.time == 9.0:
            fields, clock = self.long_waves.state()
            self.long_waves.load_state(fields * math.nan, clock)
        whole(self)

    monkeypatch.setattr(SeaSimulation, "advance", advance)
    out = tmp_path / "s.nc"
    code, _, error = run_usvauv("sea", "extreme", *SCENARIO, "--duration", 20, "--out", out)
    assert code == 2
    assert error.splitlines()[-1].startswith("error: the sea: the elevation is nan m at 10 s")
    with xarray.open_dataset(out) as dataset:
        assert dataset.sizes["time"] == 10


def test_train_keeps_the_checkpoint_before(tmp_path, run_usvauv, monkeypatch):
    out = tmp_path / "run"
    settings = ("--learn", "hidden=8,8", "--learn", "batch=8", "--learn", "warmup=8", "--learn", "n_step=2")
    command = ("train", "extreme", *SCENARIO, "--worlds", 4, *settings, "--out", out)
    assert run_usvauv(*command, "--steps", 40)[0] == 0
    before = (out / "last.safetensors").read_bytes()
    whole, done = World.step, []

    def step(self, action):
        done.append(self)
        if self.num_worlds == 4 and len(done) > 12:
            self.boat[2, 0, 0] = math.nan
        return whole(self, action)

    monkeypatch.setattr(World, "step", step)
    code, _, error = run_usvauv("train", "--resume", "--out", out, "--steps", 4000)
    assert code == 2
    assert error.splitlines()[-1].startswith("error: seed 0: world 2 at ")
    assert (out / "last.safetensors").read_bytes() == before
