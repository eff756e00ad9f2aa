"""Each command through its real entry point, in a process of its own."""

import csv
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import av
import pytest

from usvauv_env import Trace
from usvauv_env.record.metrics import COLUMNS

COMMAND = [sys.executable, "-c", "from usvauv_cli.app import main; main()"]
SHORT = ["--set", "mission.duration=12"]


def usvauv(*arguments: object, cwd: Path, code: int = 0) -> subprocess.CompletedProcess:
    """Run the command; its exit code must be `code`, and nothing it prints may be a traceback."""
    done = subprocess.run(
        [*COMMAND, *map(str, arguments)], capture_output=True, text=True, cwd=cwd, timeout=300, check=False
    )
    assert done.returncode == code, f"exit {done.returncode}\n{done.stdout}\n{done.stderr}"
    assert "Traceback" not in done.stdout + done.stderr
    return done


def test_help_names_every_command(tmp_path):
    text = usvauv("--help", cwd=tmp_path).stdout
    assert all(command in text for command in ("simulate", "sea", "train", "eval", "reproduce", "plan", "scenarios"))
    for command in ("simulate", "sea", "train", "eval", "reproduce", "plan"):
        assert "Example" in usvauv(command, "--help", cwd=tmp_path).stdout


def test_simulate(tmp_path):
    done = usvauv(
        *("simulate", "extreme", "--policy", "straight:1.5", "--usv", "hold:50,60", "--seed", 3, "--duration", 8),
        *("--out", "a.mp4", "--size", "640x360", "--fps", 10, "--trace", "a.nc", "--set", "sea.fine_cells=64"),
        cwd=tmp_path,
    )
    assert "a.mp4" in done.stdout
    assert "services" in done.stdout
    with av.open(str(tmp_path / "a.mp4")) as container:
        stream = container.streams.video[0]
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
        assert (stream.width, stream.height, stream.average_rate) == (640, 360, 10)
        assert sum(1 for _ in container.decode(video=0)) == 8
    trace = Trace.load(tmp_path / "a.nc")
    assert (trace.policy, trace.usv, trace.seed) == ("straight:1.5", "hold:50,60", 3)
    assert trace.surface.shape == (8, 64, 64)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mp4", "a.nc"]


def test_eval_pairs_worlds(tmp_path):
    done = usvauv(
        *("eval", "extreme", "--policy", "straight", "--policy", "random", "--usv", "fim", "--usv", "centroid"),
        *("--episodes", 3, "--seed", 5, "--out", "m.csv", *SHORT),
        cwd=tmp_path,
    )
    assert "±" in done.stdout
    with (tmp_path / "m.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert tuple(rows[0]) == COLUMNS
    combinations = {(row["policy"], row["usv"], row["episode"]) for row in rows}
    assert len(rows) == len(combinations) == 2 * 2 * 3
    # The motion of `straight` does not depend on where the boat is when fixes are this good: the same worlds.
    energy = {(r["policy"], r["usv"], r["episode"]): float(r["energy_wh"]) for r in rows}
    overflow = {(r["usv"], r["episode"]): r["overflow"] for r in rows if r["policy"] == "straight"}
    assert overflow["fim", "1"] == overflow["centroid", "1"]
    assert energy["straight", "fim", "2"] == pytest.approx(energy["straight", "centroid", "2"], rel=0.05)


def test_eval_repeats_itself(tmp_path):
    for name in ("a.csv", "b.csv"):
        usvauv("eval", "--policy", "crab", "--episodes", 2, "--out", name, *SHORT, cwd=tmp_path)
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


def test_train_then_resume_then_eval(tmp_path):
    options = ["train", "extreme", "--out", "run", *SHORT]
    usvauv(*options, "--algorithm", "td3", "--worlds", 8, "--steps", 400, "--seed", 4, cwd=tmp_path)
    about = json.loads((tmp_path / "run" / "last" / "policy.json").read_text())
    assert "td3" in json.dumps(about)
    assert list((tmp_path / "run" / "tensorboard").glob("events*"))
    refused = usvauv(*options, "--steps", 800, cwd=tmp_path, code=2).stderr
    assert "--resume" in refused
    assert "--set" in usvauv(*options, "--steps", 800, "--resume", cwd=tmp_path, code=2).stderr
    usvauv("train", "--out", "run", "--steps", 800, "--resume", cwd=tmp_path)
    assert json.loads((tmp_path / "run" / "last" / "policy.json").read_text())["steps"] == 800
    usvauv("eval", "--policy", "run/last", "--episodes", 1, "--out", "m.csv", *SHORT, cwd=tmp_path)


def test_ctrl_c_ends_a_training_run_cleanly(tmp_path):
    command = ["train", "extreme", "--out", "run", "--worlds", "8", "--steps", "100000000"]
    with subprocess.Popen(
        [*COMMAND, *command], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as run:
        deadline = time.monotonic() + 120
        while not list(tmp_path.glob("run/tensorboard/events*")) and time.monotonic() < deadline:
            time.sleep(0.1)
        time.sleep(1)
        run.send_signal(signal.SIGINT)
        stdout, stderr = run.communicate(timeout=60)
    assert run.returncode == 0, stderr
    assert "--resume" in stdout
    assert "Traceback" not in stderr
    assert (tmp_path / "run" / "last" / "policy.json").exists()


def test_scenarios(tmp_path):
    assert "paper-extreme" in usvauv("scenarios", cwd=tmp_path).stdout
    text = usvauv("scenarios", "extreme", "--set", "auv.count=4", cwd=tmp_path).stdout
    (tmp_path / "mine.toml").write_text(text)
    assert "count = 4" in usvauv("scenarios", "mine.toml", cwd=tmp_path).stdout


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["simulate", "extrem"], ["extrem", "paper-ideal"]),
        (["simulate", "--set", "auv.number=2"], ["auv.number", "unknown field", "count"]),
        (["simulate", "--set", "auv.count=0"], ["extreme", "auv.count", "0"]),
        (["simulate", "--set", "auv.count=many"], ["auv.count", "many"]),
        (["simulate", "--policy", "clever"], ["clever", "straight"]),
        (["simulate", "--policy", "straight:9"], ["straight:9", "2.2"]),
        (["simulate", "--usv", "hold:999,0"], ["hold:999,0", "area"]),
        (["simulate", "--size", "12x9"], ["--size", "12x9"]),
        (["simulate", "--out", "missing/a.mp4"], ["missing/a.mp4", "does not exist"]),
        (["simulate", "--trace", "missing/a.nc"], ["--trace missing/a.nc", "does not exist"]),
        (["simulate", "--arch", "abacus"], ["abacus", "cuda"]),
        (["eval", "--policy", "."], ["policy.json", "missing"]),
        (["eval", "--episodes", "0"], ["--episodes 0", "at least 1"]),
        (["eval", "--out", "."], ["--out", "folder"]),
        (["train", "--worlds", "0"], ["--worlds 0", "at least 1"]),
        (["simulate", "--duration", "-3"], ["--duration -3", "at least"]),
        (["eval", "--seed", "-1"], ["seed = -1"]),
        (["train", "--algorithm", "ppo"], ["ppo", "sac"]),
        (["train", "--resume", "--out", "nothing"], ["nothing"]),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(tmp_path, run_usvauv, arguments, parts):
    """Through the installed command's own entry point, in this process; one of them also as a process below."""
    code, _, stderr = run_usvauv(*arguments)
    assert code == 2
    for part in parts:
        assert part in stderr
    if stderr.startswith("error: "):
        assert stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_bad_input_as_a_process(tmp_path):
    done = usvauv("simulate", "extrem", cwd=tmp_path, code=2)
    assert done.stderr.startswith("error: scenario: 'extrem'")
    assert done.stderr.count("\n") == 1
