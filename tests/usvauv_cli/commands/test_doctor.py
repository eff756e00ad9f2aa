"""`usvauv doctor` names what is broken."""

import json
import math

import pytest

from usvauv.cli.commands import inspect
from usvauv.env import Scenario
from usvauv.env.sea.long_waves import coarse_cells

GOOD = {"rate": 100.0, "threads": 2, "observation": [0.1, 0.2], "reward": [1.0], "sea": [0.5]}


@pytest.fixture
def trials(monkeypatch):
    """What the trial of each architecture finds."""
    found = {"cpu": GOOD, "cuda": {"absent": "arch: no"}, "vulkan": GOOD}
    monkeypatch.setattr(inspect, "attempt", lambda arch: found[arch])
    return found


def test_all_is_well(run_usvauv, trials):
    code, out, err = run_usvauv("doctor")
    assert (code, err) == (0, "")
    assert max(map(len, out.splitlines())) <= 80
    lines = dict(line.split(maxsplit=1) for line in out.splitlines())
    assert lines["cpu"].startswith("works")
    assert lines["cuda"] == "not here"
    assert lines["vulkan"].startswith("works, as the CPU")


@pytest.mark.parametrize(
    ("arch", "found", "words"),
    [
        ("vulkan", GOOD | {"reward": [1.01]}, "vulkan: reward differs from the CPU's by 0.01"),
        ("vulkan", GOOD | {"observation": [0.1, float("nan")]}, "vulkan: observation differs"),
        ("cpu", {"broken": "exit code -11: no message"}, "cpu: exit code -11"),
        ("cpu", {"absent": "arch: 'cpu' could not be started"}, "cpu: arch: 'cpu' could not"),
    ],
)
def test_what_is_broken_is_named(run_usvauv, trials, arch, found, words):
    trials[arch] = found
    code, _, err = run_usvauv("doctor")
    assert code == 1
    assert words in err


def test_the_trial_runs_whatever_files_are_in_the_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "random.py").write_text("raise SystemExit('not the library')")
    found = inspect.attempt("cpu")
    assert found["rate"] > 0
    assert len(found["sea"]) == 4 * math.prod(coarse_cells(Scenario.load("extreme")))
    assert inspect.difference(json.loads(json.dumps(found)), found) == ""
    assert inspect.attempt("abacus") == {"absent": "arch: 'abacus': allowed are auto, cpu, cuda, vulkan"}
