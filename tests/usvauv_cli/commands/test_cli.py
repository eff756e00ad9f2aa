"""The commands through their entry point: what they write, what they refuse, how they end."""

import csv
import os
import signal
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import av
import matplotlib
import pytest
import typer

from usvauv import env
from usvauv.cli import app, terminal
from usvauv.env import Trace, World, plugins
from usvauv.env.record.metrics import COLUMNS
from usvauv.env.storage.files import locked

COMMAND = [sys.executable, "-c", "from usvauv.cli.app import main; main()"]
EXTREME = Path(env.__file__).parent / "scenarios" / "extreme.toml"
HELD = ["--set", "boat.strategy=hold:100,100"]  # one strategy, so that all tests share what is compiled
SHORT = ["--set", "mission.duration=12", *HELD]
BOATS = "hold:100,100", "hold:80,120"
SEE = "(set USVAUV_TRACEBACK=1 to see where it comes from)"
LOADING = "loading torch and Taichi …\n"  # first line of every command


def test_help_names_every_command(run_usvauv):
    text = run_usvauv("--help")[1]
    assert all(command in text for command in ("simulate", "sea", "train", "eval", "reproduce", "plan", "scenarios"))
    assert subprocess.check_output([*COMMAND, "--version"], text=True) == f"usvauv {metadata.version('usvauv')}\n"
    for command in ("simulate", "sea", "train", "eval", "reproduce", "plan"):
        told = run_usvauv(command, "--help")[1]
        assert "Example" in told
        assert "<" not in told  # no types of a programming language
        assert "--out" in told
        assert "-o " in told
        assert told.index("─ Mission ─") < told.index("─ Result ─") < told.index("─ Machine ─")
    assert run_usvauv("help", "plan") == run_usvauv("plan", "--help") == run_usvauv("plan", "-h")


class TestPlugin:
    @pytest.fixture(autouse=True)
    def none_loaded(self, monkeypatch):
        monkeypatch.setattr(plugins, "_paths", [])

    def test_is_loaded_before_arguments_are_judged(self, tmp_path, run_usvauv):
        for name in ("a", "b"):
            (tmp_path / f"{name}.py").write_text(f"print('plugin {name}')")
        code, stdout, stderr = run_usvauv("eval", "extrem", "--plugin", "a.py", "--plugin", "b.py")
        assert (code, stdout) == (2, "plugin a\nplugin b\n")
        assert "extrem" in stderr

    def test_that_fails_or_is_missing_gives_one_line(self, tmp_path, run_usvauv):
        (tmp_path / "a.py").write_text("1 / 0")
        raised = f"ZeroDivisionError: division by zero, in {tmp_path}/a.py, line 1 {SEE}"
        for name, problem in (("a", raised), ("b", "there is no such Python file")):
            refused = f"error: plugin {name}.py: {problem}\n"
            assert run_usvauv("train", "--plugin", f"{name}.py") == (2, "", refused)

    def test_of_an_installed_distribution(self, tmp_path, monkeypatch, run_usvauv):
        (tmp_path / "mine.py").write_text("print('installed')")
        about = tmp_path / "mine-1.0.dist-info"
        about.mkdir()
        (about / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1.0\n")
        (about / "entry_points.txt").write_text(f"[{plugins.GROUP}]\nmine = mine\n")
        monkeypatch.syspath_prepend(tmp_path)
        assert run_usvauv("scenarios")[1].startswith("installed\n")


def test_replay_draws_what_simulate_drew(tmp_path, run_usvauv):
    frames = ("--size", "640x360", "--fps", 10, "--view", "both", "--theme", "light")
    mission = ("simulate", "extreme", "--policy", "straight:1.5", "--seed", 3, "--duration", 8, *HELD)
    files = ("--out", "a.mp4", "--trace", "a.nc")
    code, said, _ = run_usvauv(*mission, "--set", "sea.fine_cells=64", *frames, *files)
    assert code == 0
    assert "a.mp4" in said
    assert "services" in said
    with av.open(str(tmp_path / "a.mp4")) as container:
        stream = container.streams.video[0]
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
        assert (stream.width, stream.height, stream.average_rate) == (640, 360, 10)
        assert sum(1 for _ in container.decode(video=0)) == 8
    trace = Trace.load(tmp_path / "a.nc")
    assert (trace.policy, trace.seed) == ("straight:1.5", 3)
    assert trace.surface.shape == (8, 64, 64)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mp4", "a.nc"]
    code, said, _ = run_usvauv("replay", "a.nc", "--out", "b.mp4", *frames)
    assert code == 0
    assert "8 frames" in said
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()
    assert run_usvauv("replay", "a.nc", "a.nc", "--at", 3, "--out", "c.png")[0] == 0
    assert (tmp_path / "c.png").stat().st_size > 1000


@pytest.mark.parametrize(
    ("options", "simulated"),
    [
        ("--view sea --at 3.5 --out a.png", 4),
        ("--view sea --at 2:3 --speedup 1 --out a.webm", 3),
        ("--view sea --at 3 --out a.png --duration 6", 6),
        ("--view map --at 3 --out a.png", 8),
    ],
)
def test_a_view_of_the_sea_is_simulated_no_longer_than_shown(run_usvauv, options, simulated):
    mission = ("--set", "mission.duration=8", "--set", "sea.fine_cells=64", *HELD)
    code, stdout, stderr = run_usvauv("simulate", "--size", "320x240", *options.split(), *mission)
    assert code == 0, stderr
    assert f": {simulated} s of mission" in stdout


TERMINALS = """
import sys
from usvauv.cli.app import main

kept = []
for encoding in ("cp1252", "utf-16"):
    for asked in ("a.toml", "海σ²"):
        sys.argv = ["usvauv", "scenarios", asked]
        kept += [open(f"{encoding} {asked} {stream}", "w", encoding=encoding) for stream in ("out", "err")]
        sys.stdout, sys.stderr = kept[-2:]
        try:
            main()
        except SystemExit as end:
            assert end.code == (0 if asked == "a.toml" else 2)
"""


def test_a_terminal_without_a_letter_gets_a_question_mark(tmp_path):
    """What is printed is TOML still, in ASCII, wherever it is not in Unicode."""
    (tmp_path / "a.toml").write_text('name = "海 ²"', encoding="utf-8")
    subprocess.run([sys.executable, "-c", TERMINALS], check=True, cwd=tmp_path)
    for encoding, said in (("cp1252", "??²"), ("utf-16", "海σ²")):
        printed = (tmp_path / f"{encoding} a.toml out").read_bytes()
        assert tomllib.loads(printed.decode(encoding))["name"] == "海 ²"
        assert (tmp_path / f"{encoding} a.toml err").read_bytes().decode(encoding) == ""
        problem = (tmp_path / f"{encoding} 海σ² err").read_bytes().decode(encoding)
        assert problem.startswith(f"error: scenario '{said}': allowed are bore, coast, extreme")


SETTINGS = """
text.usetex: True
font.family: No Such Font
savefig.bbox: tight
savefig.dpi: 30
savefig.transparent: True
axes.formatter.use_locale: True
axes.spines.top: False
axes.grid: True
lines.linewidth: 9
image.cmap: jet
path.sketch: 1, 100, 2
figure.autolayout: True
"""


def test_the_users_settings_of_matplotlib_change_no_picture_and_stay(tmp_path, run_usvauv):
    command = ("plan", "--auv", "60,80,100", "--out")
    assert run_usvauv(*command, "a.png")[0] == 0
    lines = [line.partition(": ") for line in SETTINGS.split("\n") if line]
    with matplotlib.rc_context({name: value for name, _, value in lines}):
        before = dict.copy(matplotlib.rcParams)  # as it is: asking for the backend would choose one
        assert run_usvauv(*command, "b.png")[0] == 0
        assert dict.copy(matplotlib.rcParams) == before
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_simulate_shows_another_boat_in_the_same_world_beside_it(tmp_path, run_usvauv):
    code, stdout, _ = run_usvauv(
        *("simulate", "extreme", "--duration", 4, "--compare", "usv=hold:9,9", "--out", "a.webm", "--trace", "a.nc"),
        *("--set", "sea.fine_cells=64", "--size", "640x360", *HELD),
    )
    assert code == 0
    assert "boat hold:100,100" in stdout
    assert "boat hold:9,9" in stdout
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.nc", "a.webm"]


def test_eval_pairs_worlds(tmp_path, run_usvauv):
    code, stdout, _ = run_usvauv(
        *("eval", "extreme", "--policy", "straight", "--policy", "random", "--usv", BOATS[0], "--usv", BOATS[1]),
        *("--episodes", 3, "--seed", 5, "--out", "m.csv", *SHORT),
    )
    assert code == 0
    assert "±" in stdout
    with (tmp_path / "m.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert tuple(rows[0])[: len(COLUMNS)] == COLUMNS
    combinations = {(row["policy"], row["usv"], row["episode"]) for row in rows}
    assert len(rows) == len(combinations) == 2 * 2 * 3
    # The motion of `straight` does not depend on where the boat is when fixes are this good: the same worlds.
    energy = {(r["policy"], r["usv"], r["episode"]): float(r["energy_wh"]) for r in rows}
    overflow = {(r["usv"], r["episode"]): r["overflow"] for r in rows if r["policy"] == "straight"}
    one, other = BOATS
    assert overflow[one, "1"] == overflow[other, "1"]
    assert energy["straight", one, "2"] == pytest.approx(energy["straight", other, "2"], rel=0.05)


def test_a_policy_of_ones_own_that_fails_is_one_line(tmp_path, run_usvauv, monkeypatch):
    name = "failing_policy"
    (tmp_path / f"{name}.py").write_text("class Failing:\n    def __init__(self, world):\n        1 / 0\n")
    monkeypatch.setattr(sys, "path", [*sys.path])  # which gets the working directory
    code, _, stderr = run_usvauv("eval", "--policy", f"{name}:Failing", *SHORT)
    problem = f"ZeroDivisionError: division by zero, in {tmp_path}/{name}.py, line 3 {SEE}"
    assert (code, stderr) == (2, f"error: policy '{name}:Failing' of {tmp_path}/{name}.py: raised {problem}\n")
    assert [path.name for path in tmp_path.iterdir() if path.suffix != ""] == [f"{name}.py"]


@pytest.mark.parametrize(
    ("log", "said"),
    [("wandb", "--log wandb: needs the extra 'wandb'"), ("tensorbord", "did you mean 'tensorboard'")],
)
def test_a_log_that_cannot_be_is_refused_in_one_line(tmp_path, refused, monkeypatch, log, said):
    monkeypatch.setattr("usvauv.policies.training.meter.find_spec", lambda name: None)
    assert said in refused("train", "ideal", "--log", log, "--out", "run")
    assert not (tmp_path / "run").exists()


def test_a_run_that_ends_before_it_learns_says_so(tmp_path, run_usvauv, monkeypatch):
    """And one that is taken up with a plugin of another content."""
    monkeypatch.setattr(plugins, "_paths", [])
    (tmp_path / "a.py").write_text("")
    own = ("--plugin", "a.py")
    begin = ["train", "extreme", "--worlds", 2, "--learn", "warmup=40", "--learn", "hidden=8", "--out", "run", *SHORT]
    code, said, warned = run_usvauv(*begin, *own, "--steps", 40)
    assert (code, warned) == (
        0,
        "warning: --steps 40: nothing will be learned: the first update comes after 40 world-steps\n",
    )
    stage, begun, *rest = said.splitlines()
    assert stage == "evaluating clear …"
    words = " ".join(" ".join(rest).split())
    assert begun.startswith("training sac in extreme: an untrained network steers much like clear:80; ")
    assert "; at 14 ARPS " in words
    assert words.count(", margin over clear ") > 1
    assert "best policy, the untrained one: ARPS " in words
    assert " in run/best.safetensors " in words
    assert (tmp_path / "run" / "best.safetensors").exists()
    (tmp_path / "a.py").write_text("# corrected\n")
    for steps, changed in ((42, f"warning: {tmp_path}/a.py: changed since run was saved; the run continues"), (44, "")):
        code, said, warned = run_usvauv("train", "--out", "run", "--resume", *own, "--steps", steps, "-q")
        assert said.startswith("best policy")
        assert (code, warned.count("\n"), warned[: len(changed)]) == (0, len(changed) > 0, changed)
    nothing = "nothing to do: 44 of 44 world-steps are done; a larger --steps continues the run\n"
    assert run_usvauv("train", "--out", "run", "--resume") == (0, nothing, "")
    code, said, complaint = run_usvauv(*begin, "--out", "fins", "--learn", "frame=fins")
    assert (code, said) == (2, "")  # before it evaluates anything
    assert "frame = 'fins': scenario 'extreme' has vector actions" in complaint


def test_in_a_narrow_terminal_help_is_whole(run_usvauv, monkeypatch):
    """Names, choices and words of every command in 40 columns, as far as single words are no longer."""
    monkeypatch.setenv("COLUMNS", "40")
    commands = typer.main.get_command(app.parser()).commands
    overview = " ".join(run_usvauv("--help")[1].split())
    for name, command in commands.items():
        code, text, _ = run_usvauv(name, "--help")
        assert (code, "…" in text) == (0, False)
        assert all(len(line) <= 40 or " " not in line.strip() for line in text.splitlines()), name
        lines = [line.strip() for line in text.splitlines()]
        for option in command.params:
            if option.opts[0].startswith("--"):
                assert any(f"{option.opts[0]}" in line.split() + line.split(", ") for line in lines), option.opts
            if "|" in (option.metavar or ""):
                assert any(option.metavar in line for line in lines), option.metavar
        assert f"{name} " in overview
        assert " ".join(command.help.split("\n\n")[0].split()).replace("`", "") in overview


def test_without_progress_there_are_results_alone(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(terminal, "SHOW_AFTER", -1.0)  # what takes no time is shown too
    monkeypatch.setattr(terminal, "LINE_EVERY", 0.0)
    for quiet, shown in ((["--quiet"], False), ([], True)):
        monkeypatch.setattr(sys, "argv", ["usvauv", "simulate", "--duration", "4", "--out", "a.png", *SHORT, *quiet])
        assert app.run() == 0
        out, error = capfd.readouterr()
        assert "picture: " in out
        assert ("preparing extreme" in error, "simulating: " in error) == (shown, shown)
        assert shown or error == ""


def test_a_policy_of_another_team_is_warned_of(run_usvauv):
    refused = "error: usv: 'hold:999,0': the point must lie in the area [0, 200] × [0, 200]\n"
    told = "policy sac-extreme: was trained with 2 AUVs; scenario 'extreme' has 3\n"
    learned = ("eval", "--usv", "hold:999,0", "--policy", "sac-extreme")
    assert run_usvauv(*learned, "--set", "auv.count=3") == (2, "", told + refused)
    assert run_usvauv(*learned) == (2, "", refused)


@pytest.mark.parametrize("command", ["simulate", "live"])
def test_a_command_says_what_it_does_before_it_imports_what_takes_long(tmp_path, command):
    without = "import sys; sys.modules |= dict.fromkeys(('torch', 'matplotlib'))"
    code = f"{without}; from usvauv.cli.app import main; main()"
    done = subprocess.run([sys.executable, "-c", code, command], capture_output=True, text=True, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(LOADING)


def test_ctrl_c_ends_a_training_run_cleanly(tmp_path, run_usvauv, monkeypatch):
    whole, done = World.step, []

    def step(self, action):
        done.append(self)
        if self.num_worlds == 8 and len(done) > 20:
            signal.raise_signal(signal.SIGINT)
        return whole(self, action)

    monkeypatch.setattr(World, "step", step)
    code, said, complaints = run_usvauv(
        "train", "extreme", "--out", "run", "--worlds", 8, "--steps", 100_000_000, *SHORT
    )
    assert code == 130, complaints
    assert "--resume" in said
    assert "Traceback" not in complaints
    assert (tmp_path / "run" / "last.safetensors").exists()


def test_a_second_run_in_a_folder_names_the_first(tmp_path, refused):
    folder = tmp_path / "run"
    folder.mkdir()
    with locked(folder):
        for command in (["train"], ["train", "--resume"], ["reproduce", "fig3"]):
            assert refused(*command, "--out", "run") == f"run: process {os.getpid()} is writing there\n"
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize(
    ("command", "link"),
    [
        *(("train --out run", name) for name in (".lock", "last.safetensors", "tensorboard")),
        ("sweep study.toml --out run", "runs"),
        ("eval --report run", "index.html"),
        ("eval --out run/a.csv", "a.csv.partial"),
        ("simulate --out run/a.mp4", "a.mp4"),
    ],
)
def test_no_link_leads_out_of_the_folder_of_a_result(tmp_path, run_usvauv, command, link):
    outside = tmp_path / "outside"
    outside.mkdir()
    (tmp_path / "run").mkdir()
    (tmp_path / "study.toml").write_text('[[runs]]\npolicy = "keep"\n')
    (tmp_path / "run" / link).symlink_to(outside if "." not in link[1:] else outside / "file")
    code, _, stderr = run_usvauv(*command.split())
    assert (code, stderr.count("\n")) == (2, 1)
    assert f"run/{link}" in stderr
    assert not list(outside.iterdir())
    assert (tmp_path / "run" / link).is_symlink()


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are bytes on Linux")
def test_a_folder_whose_name_is_no_text_cannot_hold_checkpoints(tmp_path, refused):
    folder = tmp_path / os.fsdecode(b"d\xe9s")
    folder.mkdir()
    (folder / "best.safetensors").touch()
    for command, problem in (("train --out", "cannot hold checkpoints"), ("eval --policy", "must be in UTF-8")):
        assert problem in refused(*command.split(), folder)


@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="no device that is always full")
def test_a_full_standard_output_is_one_line(tmp_path):
    with open("/dev/full", "w") as full:
        done = subprocess.run([*COMMAND, "--version"], stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr) == (
        2,
        "error: standard output: cannot be written: No space left on device\n",
    )


def test_a_closed_pipe_ends_a_command_quietly(tmp_path):
    reads, writes = os.pipe()
    os.close(reads)
    done = subprocess.run([*COMMAND, "--version"], stdout=writes, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writes)
    assert (done.returncode, done.stderr) == (141, "")


def test_an_unexpected_error_is_one_line_that_says_how_to_see_more(run_usvauv, monkeypatch):
    def fail(*arguments):
        raise ZeroDivisionError("division\nby zero")

    monkeypatch.setattr("usvauv.env.Scenario.load", fail)
    code, _, stderr = run_usvauv("scenarios", "extreme")
    assert code == 2
    assert stderr == "error: unexpected ZeroDivisionError: division by zero (set USVAUV_TRACEBACK=1 to see where)\n"
    monkeypatch.setenv("USVAUV_TRACEBACK", "1")
    with pytest.raises(ZeroDivisionError):
        run_usvauv("scenarios", "extreme")


@pytest.mark.parametrize(
    "command",
    [
        "simulate --out a.mp4 --trace a.nc",
        "simulate --out a.png --at 3",
        "eval --out a.csv --report page",
        "sea --out a.png",
        "train --out run",
    ],
)
def test_a_refusal_leaves_no_file(tmp_path, run_usvauv, command):
    """A mission that would be in vain; the file's place has been checked before."""
    assert run_usvauv(*command.split(), "--set", "current.speed=9", "--set", "auv.speed_min=0.01")[0] == 2
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["simulate", "--policy", "straight:9"], ["straight:9", "0.05 and 2 m/s"]),
        (["simulate", "--policy", "json:Best"], ["json:Best", "json/__init__.py", "no class or function 'Best'"]),
        (["simulate", "--seed", "-1"], ["--seed -1: must be from 0 to"]),
        (["simulate", "--duration", "1e12"], ["--duration 1000000000000.0: must be from 0.1 to 10000000"]),
        (["train", "--arch", "gpu"], ["--arch 'gpu': allowed are auto, cpu"]),
        (["sim"], ["command 'sim'", "did you mean 'simulate'?"]),
        (["eval", "--until", "2"], ["eval has no option --until", "did you mean '--until-halfwidth'?"]),
        (["simulate", "extreme", "straight"], ["simulate takes no argument 'straight'"]),
        (["plan", "extreme"], ["--auv: give each AUV as X,Y,Z in metres"]),
        (["simulate", "--size", "³²⁰x³²⁰"], ["--size", "expected WIDTHxHEIGHT"]),
        (["simulate", "--out", "missing/a.mp4"], ["missing/a.mp4", "does not exist"]),
        (["simulate", "--at", "3"], ["--at 3", "usvauv-extreme.mp4", "BEGIN:END"]),
        (["simulate", "--at", "3:b"], ["--at '3:b'", "120:180"]),
        (["simulate", "--out", "a.gif", "--fps", "60"], ["--fps 60: must be from 1 to 50 in a.gif"]),
        (["simulate", "--follow", "boat", "--set", "boat.count=2"], ["--follow 'boat'", "usv:1 to usv:2"]),
        (["replay", "a.nc", "--out", "a.geojson", "--at", "1:2"], ["--at 1:2", "a.geojson", "whole area"]),
        (["eval", "--policy", "."], ["holds no best.safetensors"]),
        (["eval", "--resume"], ["metrics.csv.partial", "nothing to resume"]),
        (["eval", "--resume", "--report", "r"], ["--report", "--resume"]),
        (["reproduce", "nothing", "--out", "a"], ["TARGET 'nothing'", "table2"]),
        (["train", "--worlds", "0"], ["--worlds 0", "at least 1"]),
        (["train", "--resume", "--worlds", "8", "--each"], ["--worlds, --shared: a resumed run keeps"]),
        (["scenarios", "--set", "auv.count=3"], ["--set: needs a scenario"]),
        (["export", "mission.nc"], ["mission.nc: is a trace, which needs --to: csv, parquet, mcap, rrd"]),
        (["export", "sac-extreme", "--onnx", "a.pt"], ["--onnx a.pt: the ending must be .onnx"]),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(tmp_path, run_usvauv, arguments, parts):
    """Through the installed command's own entry point, in this process; one of them also as a process below."""
    code, _, stderr = run_usvauv(*arguments)
    assert code == 2
    assert "preparing" not in stderr, "kernels are compiled for nothing"
    for part in parts:
        assert part in stderr
    if stderr.startswith("error: "):
        assert stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())
