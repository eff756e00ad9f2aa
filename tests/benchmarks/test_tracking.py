"""The study of learned tracking on training runs that have learned nothing."""

import json
import sys

import pytest

from benchmarks.studies import tracking
from usvauv.env import World
from usvauv.policies import Trainer, TrainingConfig, TrainingRun

NOTHING = {"arps": 1.0, "margin": 0.0}


@pytest.mark.slow
def test_untrained_policies_err_as_circle_does(tmp_path, monkeypatch, capsys):
    scenario = tracking.setting("hard", 1)
    for seed in (1, 2):
        config = TrainingConfig.of(scenario, frame="circling", num_worlds=2, seed=seed)
        run = TrainingRun(World(scenario, 2, seed), config, tmp_path / f"seed-{seed}", lambda policy: NOTHING)
        Trainer(run, evaluations=1).train(4)
    monkeypatch.setattr(tracking, "TEAMS", (1,))
    options = f"--runs {tmp_path} --out {tmp_path}/curve.png --episodes 64 --json"
    monkeypatch.setattr(sys, "argv", ["tracking", *options.split()])
    tracking.main()
    result = json.loads(capsys.readouterr().out)
    assert [row["mean"] for row in result["curves"]] == [0.0, 0.0]
    difference, half = (float(part) for part in result["learned"][0]["from circle, m"].split(" (")[0].split(" ± "))
    assert abs(difference) < half + 0.5
    assert {path.name for path in tmp_path.glob("*.png")} == {"curve-light.png", "curve-dark.png"}
