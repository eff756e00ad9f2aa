"""`usvauv sweep`: study files, names of runs, nothing lost and nothing twice, failures, what the terminal shows."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.usvauv_cli.commands.test_cli import COMMAND, LOADING
from tests.usvauv_cli.sweep.work import Here
from usvauv import policies
from usvauv.cli.sweep import perform, run_folder
from usvauv.cli.sweep.engine import Stopped
from usvauv.cli.sweep.run_folder import Piece, key_of
from usvauv.cli.sweep.study import Evaluation, Resources, StudyRun, define, read
from usvauv.env.scenario import Scenario
from usvauv.env.storage.result_tables import read_rows
from usvauv.kernels.errors import UserError
from usvauv.policies import checkpoint

ROOT = Path(__file__).parents[3]
HELD = "mission.duration=12", "boat.strategy=hold:0,0"  # compiles soonest
SHORT = f"set = {json.dumps(HELD)}"
MINE = """
import os, signal
from pathlib import Path

class Good:
    def __init__(self, world):
        self.scale = world.scenario.auv.count * 0.0

    def act(self, observation):
        return observation[..., :2] * self.scale

class Bad(Good):
    def act(self, observation):
        if not Path("repaired").exists():
            raise RuntimeError("first line\\nthe last line")
        return super().act(observation)

class Full(Good):
    def act(self, observation):
        if not Path("repaired").exists():
            import resource
            resource.setrlimit(resource.RLIMIT_FSIZE, (5000, resource.RLIM_INFINITY))
        return super().act(observation)

class Killed(Good):
    steps = 0

    def act(self, observation):
        self.steps += 1
        if self.steps == 5 and not Path("killed").exists():
            Path("killed").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return super().act(observation)
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "study.toml"
    path.write_text(text, encoding="utf-8")
    return path


class TestFile:
    @pytest.mark.parametrize(
        ("text", "line"),
        [
            ("", "runs: there are none; expected at least one [[runs]]"),
            ("runs = [1]", "runs[0] = 1: must be a table of fields"),
            ("[[runs]]", "runs[0]: policy = '', algorithm = '': must be one of the two"),
            (
                '[[runs]]\npolicy = "clear"\nsteps = 5',
                "runs[0]: steps = 5: must go with algorithm, not with policy",
            ),
            ('[[runs]]\npolicy = "clear"\nseeds = 1', "runs[0]: seeds: unknown field; allowed here: name, scenario, "),
            ('[[runs]]\npolicy = "clear"\nseed = []', "runs[0]: seed = []: must have at least one entry"),
            ('[[runs]]\npolicy = "cleer"', "runs[0]: policy 'cleer': allowed are"),
            ('[[runs]]\nalgorithm = "sac"\nlearn = ["tau=2"]', "runs[0]: training: tau = 2.0: must be from 1e-06"),
            ("[evaluation]\nepisodes = 0", "evaluation: episodes = 0: input should be greater than or equal to 1"),
            ('[evaluation]\nscore = "joy"', "evaluation: score: 'joy': allowed are sdr, "),
            ("runs = ", "not valid TOML: "),
        ],
    )
    def test_is_refused_in_one_line(self, tmp_path, text, line):
        path = written(tmp_path, text)
        with pytest.raises(UserError) as refused:
            read(path)
        assert str(refused.value).startswith(f"{path}: {line}")
        assert "\n" not in str(refused.value)

    @pytest.mark.parametrize(
        ("options", "said"),
        [
            ("--ray auto --slurm batch", "--ray, --slurm: must not both be given"),
            ("--ray auto --jobs 2", "--jobs 2: must go without --ray auto, whose resources decide"),
            ("--jobs 0", "--jobs 0: must be at least 1, and finite"),
        ],
    )
    def test_options_that_cannot_be_are_refused(self, tmp_path, run_usvauv, options, said):
        assert run_usvauv("sweep", "a.toml") == (2, "", "error: a.toml: is not a file\n")
        written(tmp_path, '[[runs]]\npolicy = "clear"')
        code, _, complaints = run_usvauv("sweep", "study.toml", *options.split())
        assert code == 2
        assert complaints.startswith(f"error: {said}")
        assert complaints.count("\n") == 1
        assert list(tmp_path.glob("studies/*/*")) == []

    def test_has_a_page_with_all_fields(self):
        page = (ROOT / "docs" / "scale.md").read_text(encoding="utf-8")
        rows = " ".join(line.split("|")[1] for line in page.splitlines() if line.startswith("| `"))
        fields = [*StudyRun.model_fields, *Evaluation.model_fields, *Resources.model_fields]
        assert [name for name in fields if f"`{name}`" not in rows] == []

    def test_makes_every_combination_once(self, tmp_path):
        text = """
            [common]
            scenario = ["ideal", "extreme"]
            [[runs]]
            policy = ["clear", "straight"]
            set = [["mission.duration=12"], ["mission.duration=12", "auv.count=3"]]
            [[runs]]
            policy = "clear"
            set = ["mission.duration=12"]
            [[runs]]
            algorithm = "sac"
            learn = [["tau=0.1"], ["tau=0.2"]]
            seed = [0, 1, 2]
        """
        runs = read(written(tmp_path, text)).runs
        assert len(runs) == 2 * 2 * 2 + 2 * 2 * 3
        assert len({planned.key for planned in runs}) == len(runs)

    def test_of_the_examples_is_a_study(self):
        names = Counter((piece.method, piece.task) for piece in read(ROOT / "examples" / "study.toml").runs)
        assert names == {(m, t): 2 for m in ("clear", "sac") for t in ("ideal", "extreme")}

    def test_names_what_differs_differently(self, tmp_path, monkeypatch):
        """A copy of a scenario keeps its name; runs of one name have other policies, settings or seeds."""
        monkeypatch.chdir(tmp_path)
        Path("mine.toml").write_text(Scenario.load("ideal", ["boat.top_speed=3"]).to_toml(), encoding="utf-8")
        Path("copy.toml").write_text(Scenario.load("ideal").to_toml(), encoding="utf-8")
        text = """
            [common]
            scenario = ["ideal", "mine.toml", "copy.toml"]
            [[runs]]
            policy = "clear"
            [[runs]]
            policy = ["pace:100", "pace:50"]
            name = "tuned"
            targets = "sectors"
            [[runs]]
            algorithm = "sac"
            learn = [["tau=0.1", "updates=2"], ["tau=0.2", "updates=2"]]
            seed = [0, 1]
            name = "clear"
        """
        runs = read(written(tmp_path, text)).runs
        methods = {"clear": 1, "tuned · pace:100": 1, "tuned · pace:50": 1}
        methods |= {"clear · sac · tau=0.1 · updates=2": 2, "clear · sac · tau=0.2 · updates=2": 2}
        expected = {(m, t): count for m, count in methods.items() for t in ("ideal", "ideal · mine.toml")}
        assert Counter((piece.method, piece.task) for piece in runs) == expected


class TestKey:
    def test_is_that_of_what_decides_the_results(self):
        def key(evaluation=None, **fields):
            return key_of(define(StudyRun(policy="clear", **fields), evaluation or Evaluation(), "here"))

        assert key_of({"a": {"b": 1.0, "c": [1, 2]}, "d": None}) == key_of({"d": None, "a": {"c": [1, 2], "b": 1.0}})
        assert key() == key(name="mine", usv="fim", set=("auv.count=2",)) == key(Evaluation(score="ec"))
        changes = [{"seed": 1}, {"usv": "centroid"}, {"set": ("auv.count=3",)}, {"targets": "sectors"}]
        assert len({key(), *(key(**change) for change in changes), key(Evaluation(episodes=21))}) == 6

    def test_is_another_when_weights_or_the_file_of_a_class_change(self, tmp_path, monkeypatch):
        def keys(*names):
            return {key_of(define(StudyRun(policy=name), Evaluation(), "here")) for name in names}

        (tmp_path / "mine").mkdir()
        best = shutil.copy(ROOT / "policies/trained/sac-extreme.safetensors", tmp_path / "mine" / "best.safetensors")
        monkeypatch.syspath_prepend(tmp_path)
        (tmp_path / "mine_here.py").write_text("class Best: ...\nclass Other: ...\n")
        names = str(best.parent), "mine_here:Best", "mine_here:Other"
        before = keys(*names)
        assert len(before) == 3
        about, tensors = checkpoint.read(best, checkpoint.POLICY)
        checkpoint.write(best, {checkpoint.POLICY: (about, {name: 1.01 * value for name, value in tensors.items()})})
        (tmp_path / "mine_here.py").write_text("class Best: ...\nclass Other: pass\n")
        assert not before & keys(*names)

    @pytest.mark.parametrize("field", ["bathymetry", "currents", "waves"])
    def test_is_another_when_data_of_the_scenario_change(self, tmp_path, field):
        data = tmp_path / "data.nc"
        changed = StudyRun(policy="clear", set=(f"water.{field}={data}",))
        keys = set()
        for content in ("one", "another", "one"):
            data.write_text(content)
            keys.add(key_of(define(changed, Evaluation(), "here")))
        assert len(keys) == 2


def test_a_file_that_changes_during_a_run_fails_it(tmp_path, monkeypatch):
    """A result is of the files that its key has; a second attempt has the new ones."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    Path("touched.py").write_text(
        "class Best:\n    def __init__(self, world): ...\n    def act(self, o): return 0 * o[..., :2]\n"
    )
    settings = StudyRun(scenario="ideal", set=HELD, policy="touched:Best")
    piece = Piece(definition=define(settings, Evaluation(episodes=1), "here"), method="", task="")
    signs = SimpleNamespace(advance=lambda units: None, stopping=lambda: False)
    Path("touched.py").write_text("")
    with pytest.raises(UserError, match="a file that the result depends on has changed"):
        run_folder.perform(piece.definition, piece.evaluate, piece.place(tmp_path), signs)
    assert not piece.finished(tmp_path)


def counted(folder: Path) -> Counter:
    """Rows of a study's table by run and episode."""
    return Counter((row["run"], row["episode"]) for row in read_rows(folder / "results.csv"))


def test_a_failed_run_is_shown_and_a_killed_one_done_again(tmp_path, run_usvauv, monkeypatch):
    (tmp_path / "own.py").write_text(MINE)
    monkeypatch.delitem(sys.modules, "own", raising=False)  # of another test
    monkeypatch.syspath_prepend(tmp_path)  # which processes that are started take over
    runs = '[[runs]]\nscenario = "ideal"\npolicy = ["own:Good", "own:Bad", "own:Killed"]'
    written(tmp_path, f"[common]\n{SHORT}\n{runs}\n[evaluation]\nepisodes = 3")
    code, said, complaints = run_usvauv("sweep", "study.toml", "--out", "a", "--jobs", "1")
    assert code == 2
    assert "Traceback" not in said + complaints
    assert complaints.startswith("error: 1 of 3 runs failed, see ")
    (line,) = [line for line in " ".join(said.split()).split("(") if "failed: " in line]
    assert "own:Bad in ideal, seed 0: failed: policy 'own:Bad'" in line
    assert "the last line" in line
    assert (tmp_path / "killed").exists()
    results = sorted((tmp_path / "a" / "runs").glob("*/episodes.csv"))
    assert len(results) == 2
    assert len(counted(tmp_path / "a")) == 2 * 3
    before = {path: path.stat().st_mtime_ns for path in results}

    page = (tmp_path / "a" / "report" / "index.html").read_text(encoding="utf-8")
    assert "<dt>failed</dt><dd>1<" in page
    assert "the last line" in page
    (failure,) = (tmp_path / "a" / "runs").glob("*/failure.txt")
    assert f'File "{tmp_path}/own.py", line 15, in act' in failure.read_text()

    (tmp_path / "repaired").touch()
    monkeypatch.setattr(perform, "Local", lambda jobs, cores: Here())
    code, said, complaints = run_usvauv("sweep", "study.toml", "--out", "a", "--jobs", "1")
    assert (code, complaints) == (0, "")
    assert said.startswith("1 of 3 runs to do, 2 done already\n")
    assert {path: path.stat().st_mtime_ns for path in results} == before
    assert set(counted(tmp_path / "a").values()) == {1}
    assert len(counted(tmp_path / "a")) == 3 * 3
    assert not list((tmp_path / "a" / "runs").glob("*/failure.txt"))
    assert all(json.loads(path.read_text())["seconds"] > 0 for path in (tmp_path / "a" / "runs").glob("*/made.json"))

    (tmp_path / "a" / ".signs").mkdir()  # of a command that was killed
    code, said, _ = run_usvauv("sweep", "study.toml", "--out", "a")
    assert code == 0
    assert said.startswith("nothing to do: 3 runs done already\n")
    assert max(map(len, said.splitlines())) <= 80
    assert not list((tmp_path / "a").glob(".signs*"))


def workers(process: int) -> list[int]:
    """Child processes that do runs."""
    found = Path(f"/proc/{process}/task/{process}/children").read_text().split()
    return [int(child) for child in found if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()]


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs /proc to find the process")
def test_a_stopped_and_killed_training_goes_on_from_its_checkpoint(tmp_path):
    """Ctrl-C, then a kill of the command, then one of the process that trains."""
    total = 40_000
    training = f'algorithm = "sac"\nsteps = {total}\nworlds = 8\nlearn = ["hidden=8", "batch=16", "warmup=200"]'
    written(tmp_path, f"[common]\n{SHORT}\n[[runs]]\n{training}\n[evaluation]\nepisodes = 2")

    def run_of() -> dict[str, Any]:
        for path in tmp_path.glob("a/runs/*/last.safetensors"):
            return policies.read_run(path.parent)[2]
        return {"steps": 0}

    def begun() -> subprocess.Popen:
        """The command, when it has saved more world-steps than before."""
        command, before = [*COMMAND, "sweep", "study.toml", "--out", "a", "--jobs", "1"], run_of()["steps"]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        running = subprocess.Popen(command, cwd=tmp_path, start_new_session=True, **pipes)
        while run_of()["steps"] <= before:
            assert running.poll() is None, running.communicate()
            time.sleep(0.02)
        return running

    running = begun()
    os.killpg(running.pid, signal.SIGINT)  # as a terminal does
    said, complaints = running.communicate(timeout=120)
    assert (running.returncode, complaints) == (130, LOADING + "stopped\n")
    assert "run the same command to continue" in said
    saved = [run_of()["steps"]]
    running = begun()
    running.kill()
    running.communicate(timeout=120)  # the process that trains ends too, and saves
    saved.append(run_of()["steps"])
    running = begun()
    (worker,) = workers(running.pid)
    os.kill(worker, signal.SIGKILL)
    said, complaints = running.communicate(timeout=300)
    assert (running.returncode, complaints) == (0, LOADING)
    resumed = [entry["steps"] for entry in run_of()["resumed"]]
    assert resumed[:2] == saved
    assert 0 < resumed[0] < resumed[1] < resumed[2] < total
    assert list(counted(tmp_path / "a").values()) == [1, 1]


@pytest.mark.slow
def test_a_full_disk_of_one_process_fails_its_run_and_leaves_no_half(tmp_path, run_usvauv, monkeypatch):
    """In the process of one of two runs no file can grow beyond a few kilobytes, which are less than its table has."""
    (tmp_path / "own.py").write_text(MINE)
    monkeypatch.delitem(sys.modules, "own", raising=False)  # of another test
    monkeypatch.syspath_prepend(tmp_path)  # which processes that are started take over
    written(tmp_path, f'[common]\n{SHORT}\n[[runs]]\npolicy = ["own:Good", "own:Full"]\n[evaluation]\nepisodes = 40')
    code, said, _ = run_usvauv("sweep", "study.toml", "--out", "a", "--jobs", "2")
    assert code == 2
    (failure,) = tmp_path.glob("a/runs/*/failure.txt")
    assert failure.read_text() == f"{failure.parent / 'episodes.csv'}: cannot be written: File too large\n"
    assert "cannot be written: File too large" in " ".join(said.split())
    assert not (failure.parent / "episodes.csv").exists()
    assert not list(failure.parent.glob("*.partial"))
    assert len(counted(tmp_path / "a")) == 40

    (tmp_path / "repaired").touch()
    code, said, _ = run_usvauv("sweep", "study.toml", "--out", "a", "--jobs", "2")
    assert code == 0
    assert said.startswith("1 of 2 runs to do, 1 done already\n")
    assert len(counted(tmp_path / "a")) == 2 * 40


def test_a_stopped_training_ends_as_one_in_one_go(tmp_path, monkeypatch):
    """During training; the evaluation of the untrained policy takes the first 12 reports."""
    monkeypatch.setattr("usvauv.policies.training.trainer.WINDOW", 5)
    fields = {"steps": 160, "worlds": 4, "learn": ("hidden=8", "batch=16", "warmup=40", "n_step=2", "replay=400")}
    settings = StudyRun(scenario="ideal", set=HELD, algorithm="ddpg", **fields)
    piece = Piece(definition=define(settings, Evaluation(episodes=2), "here"), method="", task="")

    class Signs:
        def __init__(self, most: int) -> None:
            self.reports, self.most = 0, most

        def advance(self, units: float) -> None:
            self.reports += 1

        def stopping(self) -> bool:
            return self.reports > self.most

    one, two = piece.place(tmp_path / "one"), piece.place(tmp_path / "two")
    run_folder.perform(piece.definition, piece.evaluate, one, Signs(10**9))
    with pytest.raises(Stopped):
        run_folder.perform(piece.definition, piece.evaluate, two, Signs(14))
    assert 0 < policies.read_run(two)[2]["steps"] < 160
    assert not piece.finished(tmp_path / "two")
    run_folder.perform(piece.definition, piece.evaluate, two, Signs(10**9))
    assert policies.read_history(one) == policies.read_history(two)
    assert (one / "episodes.csv").read_bytes() == (two / "episodes.csv").read_bytes()
    for part in ("best", "last"):
        tensors = [checkpoint.read(place / f"{part}.safetensors", checkpoint.POLICY)[1] for place in (one, two)]
        assert all(tensors[0][name].equal(tensors[1][name]) for name in tensors[0])
