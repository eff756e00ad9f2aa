"""Full disks, vanished folders, closed pipes and signals, for every command.

`python -m tests.trials.faults --seed S --count N [--only COMMAND]`

Each of N cases runs a command, beside files that are there already, with a fault at a random place or time: the folder
on a disk of a random size (needs root on Linux), a random limit to the size of files, a refused system call, the folder
removed or made unwritable, standard output closed or full, Ctrl-C, SIGTERM. Afterwards: the exit code is right,
standard error is one line, no traceback; nothing temporary is left; every file is the earlier one or a whole new one.
Most cases start in a fork of a process that has imported everything; every eighth is a process of its own, imports
included.
"""

from __future__ import annotations

import argparse
import atexit
import csv
import errno
import json
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import av
import torch
import xarray

from usvauv.cli import app
from usvauv.cli.boat_placement import figure  # noqa: F401  imported once, for all forks
from usvauv.cli.reproduction import page  # noqa: F401
from usvauv.policies import checkpoint
from usvauv.policies.names import PolicyError

app.parser()  # which imports the commands once, for all forks
CPU = torch.device("cpu")
BEGIN = [
    *("ideal", "--worlds", "4", "--steps", "1000", "--usv", "centroid", "--seed", "5", "--set", "mission.duration=12"),
    *("--learn", "warmup=100", "--learn", "batch=16", "--learn", "replay=4000", "--learn", "hidden=16,16"),
]
CALL = "from usvauv.cli.app import main; main()"
STUDY = Path(__file__).with_name("study.toml")
PLAN = ["plan", "--auv", "60,80,100", "--auv", "150,120,90"]
SEA = ["sea", "ideal", "--duration", "2", "--resolution", "20", "--interval", "0.25", "--out"]
COMMANDS = {
    "simulate": [
        *("simulate", "ideal", "--policy", "straight", "--duration", "5", "--size", "320x320", "--set"),
        *("sea.fine_cells=32", "--out", "a.mp4", "--trace", "a.nc"),
    ],
    "train": ["train", *BEGIN, "--out", "run"],
    "eval": [
        *("eval", "ideal", "--policy", "straight", "--episodes", "3", "--set", "mission.duration=30", "--out", "a.csv")
    ],
    "eval report": [
        *("eval", "ideal", "--policy", "straight", "--episodes", "3", "--set", "mission.duration=30", "--out", "a.csv"),
        *("--report", "report"),
    ],
    "replay": ["replay", "TRACE", "--size", "320x320", "--out", "a.mp4"],
    "sweep": ["sweep", str(STUDY), "--jobs", "2", "--out", "."],
    "plan": [*PLAN, "--out", "a.png", "--json", "a.json"],
    "plan to stdout": [*PLAN, "--json", "-"],
    "plan log": ["plan", "--log", "LOG", "--out", "a.png", "--json", "a.json"],
    "sea mp4": [*SEA, "a.mp4", "--size", "320x320"],
    "sea nc": [*SEA, "a.nc"],
    "sea png": [*SEA, "a.png"],
    "export": ["export", "sac-extreme", "--onnx", "a.onnx"],
    **{f"export {to}": ["export", "TRACE", "--to", to, "--out", f"a.{to}"] for to in ("mcap", "rrd")},
    **{f"export {to}": ["export", "TRACE", "--to", to, "--out", "tables"] for to in ("parquet", "csv")},
    "reproduce": ["reproduce", "fig3", "--quick", "--jobs", "2", "--out", "."],
    "scenarios": ["scenarios", "extreme"],
    "doctor": ["doctor"],
}
FAULTS = ("disk", "limit", "call", "removed", "unwritable", "pipe", "stdout", "SIGINT", "SIGTERM")
RECORD = ["simulate", "ideal", "--policy", "straight", "--duration", "5", "--at", "5", "--out", "a.png", "--trace"]
LONGEST = {"reproduce": 40.0}  # seconds after which a case without its fault is ended by SIGTERM; else it ends itself
TIMEOUT, PATIENCE = 300.0, 180.0  # seconds until a case is ended by SIGTERM, and by SIGKILL
PROGRESS = re.compile(r"[a-z ]+: \d+%, \d+ s left")
BEFORE = b"earlier"
LOG = ["time,auv,x,y,depth", *(f"{t},{auv},{60 + 40 * auv},{80 + t},{90 + t % 2}" for t in range(9) for auv in (1, 2))]


def whole(path: Path) -> bool:
    """Whether a file is the earlier one, or a complete new one."""
    data = path.read_bytes()
    if data == BEFORE:
        return True
    try:
        match path.suffix:
            case ".mp4":
                with av.open(str(path)) as container:
                    return sum(1 for _ in container.decode(video=0)) > 0
            case ".nc":
                with xarray.open_dataset(path, engine="h5netcdf") as file:
                    file.load()
            case ".csv":
                rows = list(csv.DictReader(data.decode().splitlines()))
                return all(None not in row.values() for row in rows)
            case ".json":
                json.loads(data)
            case ".html":
                return data.rstrip().endswith(b"</html>")
            case ".parquet":
                return data[:4] == data[-4:] == b"PAR1"
            case ".mcap":
                return data[:8] == data[-8:] == b"\x89MCAP0\r\n"
            case ".rrd":
                return data[:4] == b"RRF2" and b"RRF2" in data[-64:]
            case ".pdf":
                return data.rstrip().endswith(b"%%EOF")
            case ".png":
                return data.endswith(b"IEND\xaeB`\x82")
            case ".onnx":
                import onnx

                onnx.checker.check_model(str(path))
    except Exception:
        return False
    return True


def prepare(folder: Path, arguments: list[str]) -> None:
    """Earlier files where the command will write."""
    for option in ("--out", "--trace", "--json", "--onnx"):
        if option in arguments and "." in (name := arguments[arguments.index(option) + 1])[1:]:
            (folder / name).write_bytes(BEFORE)


def start(folder: Path, arguments: list[str], stdout: int, stderr: int, before: Callable[[], None], own: bool) -> int:
    """Start the command in a folder; returns its process id. `before` is called in the process."""

    def enter() -> None:
        os.setpgid(0, 0)
        os.chdir(folder)
        os.dup2(stdout, 1)
        os.dup2(stderr, 2)
        before()

    if own:
        return subprocess.Popen([sys.executable, "-c", CALL, *arguments], preexec_fn=enter).pid
    child = os.fork()
    if child:
        return child
    enter()
    sys.argv = ["usvauv", *arguments]
    sys.stderr = os.fdopen(2, "w", closefd=False)
    sys.stdout = os.fdopen(1, "w", closefd=False)
    code: object = 99
    try:
        app.main()
    except SystemExit as ended:
        code = ended.code
    except BaseException:
        sys.excepthook(*sys.exc_info())
    atexit._run_exitfuncs()
    os._exit(code if isinstance(code, int) else 98)


def refuse_a_call(draw: random.Random) -> None:
    """Let a random one of the next renames and syncs fail."""
    number, left = draw.choice((errno.ENOSPC, errno.EIO, errno.EROFS, errno.EDQUOT)), draw.choice((1, 1, 1, 2, 3, 5))
    name = draw.choice(("replace", "fsync"))
    real = getattr(os, name)

    def call(*arguments: object) -> object:
        nonlocal left
        left -= 1
        if left == 0:
            raise OSError(number, os.strerror(number))
        return real(*arguments)

    setattr(os, name, call)


def attempt(
    folder: Path, command: str, fault: str, draw: random.Random, usual: float, trace: Path
) -> tuple[list[str], int]:
    """Run one case; returns what was wrong, and the exit code."""
    inputs = {"TRACE": trace, "LOG": trace.with_name("log.csv")}
    arguments = [str(inputs.get(part, part)) for part in COMMANDS[command]]
    size = round(10 ** draw.uniform(3.0, 6.2))
    if fault == "disk":
        size = max(size, 8192)
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size},nr_inodes=200", "none", folder], check=True)
    prepare(folder, arguments)
    limits = {
        "limit": lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size)),
        "call": lambda: refuse_a_call(draw),
    }
    own = fault != "call" and draw.random() < 0.125
    at = draw.uniform(0.0, 1.05) * usual + (draw.uniform(0.0, 6.0) if own else 0.0)
    if draw.random() < 0.15:
        at = draw.uniform(0.0, 0.5)  # while it starts
    reads, writes = os.pipe()
    with tempfile.TemporaryFile() as errors, tempfile.TemporaryFile() as output:
        stdout = {"pipe": writes, "stdout": os.open("/dev/full", os.O_WRONLY)}.get(fault, output.fileno())
        process = start(folder, arguments, stdout, errors.fileno(), limits.get(fault, lambda: None), own)
        os.close(writes)
        begun, timely, code = time.monotonic(), fault not in ("none", "disk", "limit", "call", "stdout"), None
        end = begun + LONGEST.get(command, TIMEOUT)
        struck = ended = False
        while code is None:
            now = time.monotonic()
            if timely and not struck and now - begun >= at:
                struck = True
                strike(fault, process, folder, reads, draw)
            if now > end:
                if ended:
                    os.killpg(process, signal.SIGKILL)
                    return [f"still running {PATIENCE:g} s after SIGTERM"], -9
                ended, end = True, now + PATIENCE
                os.kill(process, signal.SIGTERM)
            done, status = os.waitpid(process, os.WNOHANG)
            if done:
                code = os.waitstatus_to_exitcode(status)
            time.sleep(0.02)
        errors.seek(0)
        said = [line for line in errors.read().decode(errors="replace").splitlines() if not PROGRESS.fullmatch(line)]
    if fault not in ("pipe",) or not struck:
        os.close(reads)
    wrong = judge(fault, code, said, ended, at if struck and own else None)
    if fault == "unwritable":
        subprocess.run(["chattr", "-i", folder], check=False)
    if folder.exists():
        wrong += leftovers(folder, fault == "unwritable")
    return wrong, code


def strike(fault: str, process: int, folder: Path, reads: int, draw: random.Random) -> None:
    """Let a fault happen now."""
    if fault == "removed":
        shutil.rmtree(folder, ignore_errors=True)
    elif fault == "unwritable":
        subprocess.run(["chattr", "+i", folder], check=False, stderr=subprocess.DEVNULL)
    elif fault == "pipe":
        os.close(reads)
    else:
        send = os.killpg if draw.random() < 0.5 else os.kill  # a terminal's Ctrl-C reaches the children too
        send(process, getattr(signal, fault))


def judge(fault: str, code: int, said: list[str], ended: bool, own_at: float | None) -> list[str]:
    """What is wrong with an exit code and standard error."""
    ends = {"pipe": (141,), "SIGINT": (130,), "SIGTERM": (143,)}.get(fault, (2,))
    wrong = []
    if code not in (0, *ends, *((143,) if ended else ())):
        # The interpreter itself, before any line of the command runs, knows only the default.
        if not (own_at is not None and own_at < 0.5 and code in (-signal.SIGINT, -signal.SIGTERM, 1)):
            wrong.append(f"exit code {code}")
        else:
            return []
    expected = {0: 0, 141: 0}.get(code, 1)
    if len(said) != expected or not all(re.match(r"error: \S|stopped$", line) for line in said):
        wrong.append("standard error: " + " | ".join(said[:3] + said[-3:]))
    if any("unexpected" in line for line in said):
        wrong.append("unexpected")
    return wrong


def leftovers(folder: Path, temporary: bool) -> list[str]:
    """What is wrong in a folder; where it was made unwritable, temporaries cannot be removed."""
    wrong = []
    for path in folder.rglob("*"):
        if "a.csv.partial" in path.parts and path.name != ".lock":  # of `eval`, for --resume
            continue
        if (path.name.endswith(".partial") or path.name == ".lock") and not temporary:
            wrong.append(f"left {path.relative_to(folder)}")
        elif path.is_file() and not whole(path):
            wrong.append(f"not whole: {path.relative_to(folder)}")
    for last in folder.rglob("last.safetensors"):
        try:
            checkpoint.read(last, checkpoint.POLICY, CPU)
        except PolicyError as error:
            wrong.append(str(error))
    return wrong


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--count", type=int, default=200)
    options.add_argument("--seconds", type=float, default=1e9, help="begin no case after so many")
    options.add_argument("--only", choices=COMMANDS, action="append")
    chosen = options.parse_args()
    draw = random.Random(chosen.seed)
    faults = [fault for fault in FAULTS if os.geteuid() == 0 or fault not in ("disk", "unwritable")]
    names, usual, tried, bad = chosen.only or list(COMMANDS), {}, Counter(), Counter()
    codes: Counter[tuple[str, int]] = Counter()
    end = time.monotonic() + chosen.seconds
    trace = Path(tempfile.mkdtemp(prefix="faults-")) / "a.nc"
    subprocess.run(
        [sys.executable, "-c", CALL, *RECORD, trace], cwd=trace.parent, stdout=subprocess.DEVNULL, check=True
    )
    trace.with_name("log.csv").write_text("\n".join(LOG) + "\n")
    for number in range(chosen.count):
        if time.monotonic() > end:
            break
        command, fault = names[number % len(names)], faults[draw.randrange(len(faults))]
        place = Path(tempfile.mkdtemp(prefix="faults-"))
        folder = place / "out"
        folder.mkdir()
        begun = time.monotonic()
        try:
            if command not in usual:  # once without a fault, for the time it takes
                wrong, code = attempt(folder, command, "none", draw, 1e9, trace)
                usual[command], fault = time.monotonic() - begun, "none"
            else:
                wrong, code = attempt(folder, command, fault, draw, usual[command], trace)
        finally:
            if os.path.ismount(folder):
                subprocess.run(["umount", folder], check=False)
            shutil.rmtree(place, ignore_errors=True)
        tried[command] += 1
        bad[command] += bool(wrong)
        codes[command, code] += 1
        if (number + 1) % 50 == 0:
            print(f"{number + 1} tried, {bad.total()} wrong", flush=True)
        if wrong:
            print(f"case {number}: {command}, {fault}: exit {code}: {'; '.join(wrong)}", flush=True)
    shutil.rmtree(trace.parent)
    for command in names:
        ends = ", ".join(f"{count} × {code}" for (name, code), count in sorted(codes.items()) if name == command)
        print(f"{command}: tried {tried[command]}, wrong {bad[command]}; exit codes {ends}")
    print(f"all: tried {tried.total()}, wrong {bad.total()}")


if __name__ == "__main__":
    main()
