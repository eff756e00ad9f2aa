"""What a command does with a result that is there already."""

import itertools
import shutil
from pathlib import Path

import pytest

from usvauv import env

EXTREME = Path(env.__file__).parent / "scenarios" / "extreme.toml"
SHORT = ["--set", "mission.duration=12", "--set", "boat.strategy=hold:100,100"]
PLAN = ("plan", "--auv", "60,80,100", "--json", "a.json")


def test_other_arguments_replace_one_only_by_force(tmp_path, run_usvauv, refused):
    files = [tmp_path / name for name in ("plan.png", "a.json")]
    assert run_usvauv(*PLAN)[0] == 0
    before = [path.read_bytes() for path in files]
    assert run_usvauv(*PLAN, "--json", "a.json", "--arch", "auto")[0] == 0  # the same in other words
    said = refused(*PLAN, "--slope", "0.1,0", "--out", "plan.png")
    assert said.startswith('--out plan.png: exists, made with --slope = "0,0", here "0.1,0"; --force')
    assert [path.read_bytes() for path in files] == before
    assert 'made with command = "plan", here "sea"' in refused("sea", "--out", "plan.png")
    assert run_usvauv(*PLAN, "--slope", "0.1,0", "--force")[0] == 0
    assert run_usvauv(*PLAN, "--slope", "0.1,0")[0] == 0


def test_a_name_that_nobody_gave_is_numbered(tmp_path, run_usvauv):
    """The same arguments replace their own result, others make one beside it."""
    for slope, _ in itertools.product(("0,0", "0.1,0", "0.2,0"), range(2)):
        code, said, _ = run_usvauv(*PLAN[:3], "--slope", slope)
        assert code == 0
    assert "plan-3.png" in said
    assert sorted(path.name for path in tmp_path.iterdir()) == ["plan-2.png", "plan-3.png", "plan.png"]


def test_resume_goes_on_with_the_number_that_is_begun(tmp_path, refused):
    """Not with a result of a similar name, which somebody else has begun."""
    (tmp_path / "metrics.csv").touch()
    for name in ("metrics-2.csv.partial", "metrics-1st.csv.partial"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "evaluation.json").write_text("{")
    assert refused("eval", "--resume", *SHORT).startswith("metrics-2.csv.partial")


def test_a_file_that_was_changed_is_another_argument(tmp_path, run_usvauv, refused):
    scenario, log = tmp_path / "base.toml", tmp_path / "a.csv"
    shutil.copy(EXTREME, scenario)
    (tmp_path / "mine.toml").write_text('base = "base.toml"')
    command = ("eval", "mine.toml", "--policy", "keep", "--episodes", "1", "--out", log.name, *SHORT)
    assert run_usvauv(*command)[0] == 0
    assert run_usvauv(*command)[0] == 0
    before = log.read_bytes()
    scenario.write_text(f"{scenario.read_text()}\n")
    assert refused(*command).startswith('--out a.csv: exists, made with scenario = "mine.toml (SHA-256 ')
    assert log.read_bytes() == before


@pytest.mark.parametrize(
    ("command", "option", "name"),
    [
        (["simulate"], "--out", "a.mp4"),
        (["simulate"], "--trace", "a.nc"),
        (["replay", "x.nc"], "--out", "a.png"),
        (["eval"], "--out", "a.csv"),
        (["sea"], "--out", "a.nc"),
        (["export", "sac-extreme"], "--onnx", "a.onnx"),
    ],
)
def test_of_nobody_knows_what_are_kept(tmp_path, refused, command, option, name):
    """Before any work, on every path that a command writes."""
    (tmp_path / name).write_text("mine")
    said = refused(*command, option, name)
    assert said.startswith(f"{option} {name}: exists, perhaps made with other arguments; --force")
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {name: "mine"}
