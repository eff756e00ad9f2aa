"""Programs `python -m …` of the pages run to their end, in missions of a few steps and the smallest sizes they have."""

import importlib
import sys

import numpy as np
import pytest

from benchmarks.studies import front
from tests.test_docs import commands
from usvauv.env import Scenario

SHORT = "mission.duration=4"
SMALLEST: dict[str, tuple[str, dict[str, object]]] = {  # options, and constants of the module
    "benchmarks.studies.buoy": ("", {}),
    "benchmarks.studies.eddies": ("--draws 1 --points 16", {"TIMES": (1,)}),
    "benchmarks.usbl": ("--seconds 0", {}),
    # In slow tests: half a minute to minutes, most of it for compiling.
    "benchmarks.curves": ("--worlds 1 --seconds 0", {"SIZE": 8, "TRIAD": 1 << 10}),
    "benchmarks.sea": ("--largest 64", {}),
    "benchmarks.data_sheet": ("", {}),
    "benchmarks.digest": ("", {"MISSIONS": [("ideal", [], "fim")], "SEAS": [[]], "STEPS": 2}),
    "benchmarks.stream": ("--episodes 2", {}),
    "benchmarks.studies.front": ("--episodes 2", {}),
    "benchmarks.film": ("--fps 1 --size 320x240", {"DURATION": 4.0, "STORM": 1.0, "RACE": 2.0}),
    "benchmarks.plan": ("--trials 40 --tables 1 --seconds 0", {"TEAMS": (2,), "STEPS": 2}),
    "benchmarks.learning": ("--updates 50 --largest 128", {}),
    "benchmarks.scale": ("--jobs 1", {"TASKS": 4}),
    "benchmarks.seeds": ("--seeds 2 --pairs 1 --updates 200 --learn batch=8 --learn hidden=8", {}),
    "benchmarks.plugins": ("--worlds 1 --seconds 0", {"LEAD": 1, "CYCLE": 1, "TURNS": 1}),
    "benchmarks.start": ("--rounds 1", {"COMMANDS": ("policies",)}),
    "benchmarks.step_profile": ("ideal", {"BATCHES": (1,), "ROUNDS": 1, "LEAD": 1}),
    "benchmarks.studies.autopilot": ("", {}),
    "benchmarks.studies.decisions": ("--episodes 2 --tuning-episodes 2", {}),
    "benchmarks.studies.fix_error": ("--episodes 2", {}),
    "benchmarks.studies.generalisation": ("--episodes 2 --steps 256 --jobs 1 --out runs", {}),
    "benchmarks.studies.hindsight": ("--episodes 2 --tuning-episodes 2 --moves 10", {}),
    "benchmarks.studies.refraction": ("--seconds 0", {}),
    "benchmarks.studies.tracking": (
        "--episodes 2",
        {"TEAMS": (1,), "FEW": ((1, 2),), "SETTINGS": {"hard": ((0.5, 0.7), (120.0, 420.0))}},
    ),
    "benchmarks.tracking": ("--runs 2", {"PAIRS": (1,)}),
    "benchmarks.train": ("--seeds 1 --limit 0", {}),
    "benchmarks.vehicles": (
        "--vehicles 16 --seconds 0",
        {"WORLDS": 1, "ROUNDS": 1, "STAGES": (2,), "STEP_LENGTHS": (0.1,), "WAY": 0.5, "RUDDER": {}, "FIN_STEPS": (1,)},
    ),
    "benchmarks.video": ("--frames 2", {}),
    "benchmarks.worlds": ("--largest 1 --seconds 0", {}),
    "tests.cases": ("", {}),
    "tests.trials.architectures": ("--steps 2 --arch cpu", {}),
    "tests.trials.faults": ("--count 0", {}),
    "tests.trials.fuzz": ("--count 4 --kind scenario", {}),
    "tests.trials.soak": ("--seconds 1 --minutes 0", {}),
}
SLOW = list(SMALLEST).index("benchmarks.curves")
# They install packages, need a graphics card or a browser, write into the repository, or have tests of their own.
OTHERS = {f"tests.{name}" for name in ("golden", "trials.conventions", "trials.versions")}
OTHERS |= {f"benchmarks.{name}" for name in ("gpu", "learning_beside", "live", "ranks", "studies.pendulum")}
OTHERS.add("tests.usvauv_env.render.reference_frames")


def test_each_program_of_a_page_is_run_or_left_out_for_a_reason():
    named = {words[2] for each in commands() for words in each.values if words[:2] == ["python", "-m"]}
    assert {name for name in named if name.startswith(("benchmarks.", "tests."))} <= {*SMALLEST, *OTHERS}


@pytest.mark.usefixtures("own_registries")
@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.slow] * (place >= SLOW)) for place, name in enumerate(SMALLEST)],
)
def test_a_program_runs(name, tmp_path, monkeypatch, capsys):
    options, constants = SMALLEST[name]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [name, *options.split()])
    load = Scenario.load
    monkeypatch.setattr(Scenario, "load", lambda which, changes=(): load(which, [*changes, SHORT]))
    try:
        module = importlib.import_module(f"{name}.__main__" if name == "tests.cases" else name)
    except ModuleNotFoundError as missing:
        pytest.skip(f"needs {missing.name}")
    for constant, value in constants.items():
        monkeypatch.setattr(module, constant, value)
    try:
        code = module.main()
    except SystemExit as end:
        code = end.code
    assert not code
    assert capsys.readouterr().out.strip()


def test_a_ratio_to_no_data_is_no_number():
    empty = {f"clear:{price:g}": (0.0, 40.0 + step) for step, price in enumerate(front.CURVES["clear"])}
    both = {"learned": (50.0, 42.5), **empty}
    table = {
        name: {front.DATA: np.full(3, data), front.ENERGY: np.full(3, energy)} for name, (data, energy) in both.items()
    }
    assert np.isnan(front.ratio("learned", table, "clear")).all()
