"""SIGKILL at random times: what a checkpoint and a training run are afterwards.

`python -m tests.trials.kills --seed S --count N --runs R`

N times a child that writes checkpoints in a loop is killed: half of them after a random time, half just before a
random file operation. After each kill the checkpoint must be whole, and none older than the last one that was complete;
another process reads it all the time. R times `usvauv train` is killed at a random time and resumed;
its end must equal, bit for bit, that of a run never killed.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import torch

from usvauv.cli import app, parser  # noqa: F401  imported once, for all forks
from usvauv.policies import checkpoint
from usvauv.policies.policy import PolicyError

CPU = torch.device("cpu")
PARTS = (checkpoint.POLICY, checkpoint.TRAINING)
LAST, BEST = "last.safetensors", "best.safetensors"
VALUES = 20_000  # of a tensor; a write takes some milliseconds
OPERATIONS = ("open", "os.rename", "os.mkdir", "os.remove", "os.rmdir", "os.chmod")
BEGIN = [
    *("ideal", "--worlds", "4", "--steps", "1000", "--usv", "centroid", "--seed", "5", "--set", "mission.duration=12"),
    *("--learn", "warmup=100", "--learn", "batch=16", "--learn", "replay=4000", "--learn", "hidden=16,16"),
]


def parts(number: int) -> dict[str, checkpoint.Part]:
    """Contents of checkpoint `number`: every file holds the number."""
    about = {"format": checkpoint.FORMAT, "number": number}
    return {part: (about, {"values": torch.full((VALUES,), float(number))}) for part in PARTS}


def number_of(place: Path, names: tuple[str, ...] = PARTS) -> int:
    """Number of the checkpoint at a place.

    Raises:
        PolicyError: it is not whole.
    """
    found = set()
    for part in names:
        about, tensors = checkpoint.read(place, part, CPU)
        found |= {about["number"], *tensors["values"].unique().int().tolist()}
    if len(found) != 1:
        raise PolicyError(f"{place}: a mixture of {sorted(found)}")
    return found.pop()


def write_until_killed(run: Path, first: int, told: int, operation: int | None) -> None:
    """Write checkpoints, telling of each that is complete, until killed from outside or before the n-th operation."""
    left = operation

    def count(event: str, _: tuple = ()) -> None:
        nonlocal left
        if left is not None and event in OPERATIONS:
            left -= 1
            if left < 0:
                os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(count)
    for number in range(first, first + 1000):
        checkpoint.write(run / LAST, parts(number))
        os.write(told, f"{number}\n".encode())


def kill_a_write(run: Path, first: int, draw: random.Random) -> tuple[int, int]:
    """Returns the last number that was complete (first − 1: none was) and the one found after the kill."""
    reads, told = os.pipe()
    operation = draw.randrange(60) if draw.random() < 0.5 else None
    child = os.fork()
    if child == 0:
        write_until_killed(run, first, told, operation)
        os._exit(1)
    os.close(told)
    if operation is None:
        time.sleep(draw.uniform(0.0, 0.15))
        os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    with os.fdopen(reads) as lines:
        complete = [int(line) for line in lines]
    if draw.random() < 0.3:  # as a resumed run does; else what several kills leave gathers
        checkpoint.clean(run)
    return (complete or [first - 1])[-1], number_of(run / LAST)


def begin_reading(run: Path) -> tuple[int, int]:
    """Start a process that reads the checkpoint all the time; its number, and where it tells how it went."""
    reads, told = os.pipe()
    child = os.fork()
    if child:
        os.close(told)
        return child, reads
    whole, lost = 0, 0
    while os.getppid() != 1:
        try:
            number_of(run / LAST, PARTS[:1])
            whole += 1
        except PolicyError as error:
            lost += 1
            print(f"reader: {error}", file=sys.stderr)
        if (run / "ended").exists():
            break
    os.write(told, f"{whole} {lost}".encode())
    os._exit(0)


def kill_writes(folder: Path, count: int, draw: random.Random) -> Counter[str]:
    """Kill `count` writes."""
    run, outcome, before = folder / "run", Counter[str](), 0
    checkpoint.write(run / LAST, parts(0))
    reader, reads = begin_reading(run)
    for _ in range(count):
        outcome["tried"] += 1
        if outcome["tried"] % 200 == 0:
            print(f"writes so far: {dict(outcome)}", flush=True)
        try:
            complete, before = kill_a_write(run, before + 1, draw)
            outcome["survived" if complete <= before <= complete + 1 else "lost"] += 1
        except PolicyError as error:
            outcome["lost"] += 1
            print(f"lost: {error}", file=sys.stderr)
            checkpoint.write(run / LAST, parts(before))
    (run / "ended").touch()
    os.waitpid(reader, 0)
    with os.fdopen(reads) as told:
        outcome["reads meanwhile"], outcome["of them not whole"] = map(int, told.read().split())
    return outcome


def result(run: Path) -> dict[str, object]:
    """What must not depend on kills: all tensors, and the counters without the time taken."""
    found: dict[str, object] = {}
    for file, part in ((LAST, checkpoint.POLICY), (LAST, checkpoint.TRAINING), (BEST, checkpoint.POLICY)):
        about, tensors = checkpoint.read(run / file, part)
        found |= {f"{file} {part} {name}": value.tolist() for name, value in tensors.items()}
        if part == checkpoint.TRAINING:
            found |= {name: value for name, value in about.items() if name != "seconds"}
    return found


def train(run: Path) -> int:
    """Begin or resume a training run in a fork; returns its process id."""
    child = os.fork()
    if child:
        return child
    with open(run.with_suffix(".log"), "a") as log:
        os.dup2(log.fileno(), 1)
        os.dup2(log.fileno(), 2)
    sys.argv = ["usvauv", "train", *(["--resume"] if (run / LAST).exists() else BEGIN), "--out", str(run)]
    code = app.run()
    sys.stdout.flush()
    os._exit(code)


def kill_runs(folder: Path, count: int, draw: random.Random) -> Counter[str]:
    """Kill and resume `count` training runs."""
    outcome, whole = Counter[str](), folder / "whole"
    begun = time.monotonic()
    process = train(whole)
    until_it_trains(process, whole)
    starting = time.monotonic() - begun
    assert os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) == 0, whole.with_suffix(".log").read_text()
    training = time.monotonic() - begun - starting
    for number in range(count):
        run = folder / f"killed-{number}"
        process = train(run)
        if draw.random() < 0.15:
            time.sleep(draw.uniform(0.0, starting))
        else:
            until_it_trains(process, run)
            time.sleep(draw.uniform(0.0, 0.9 * training))
        os.kill(process, signal.SIGKILL)
        status = os.waitpid(process, 0)[1]
        outcome["killed"] += os.WIFSIGNALED(status)
        outcome["tried"] += 1
        code = os.waitstatus_to_exitcode(os.waitpid(train(run), 0)[1])
        left = {path.name for path in run.iterdir()} - {BEST, LAST, "tensorboard"}
        good = code == 0 and not left and result(run) == result(whole)
        outcome["survived" if good else "lost"] += 1
        print(f"runs so far: {dict(outcome)}", flush=True)
        if not good:
            print(f"lost: exit {code}, left {left}\n{run.with_suffix('.log').read_text()}", file=sys.stderr)
    return outcome


def until_it_trains(process: int, run: Path) -> None:
    """Wait until a run has opened a file for TensorBoard, or has ended."""
    running = os.P_PID, process, os.WEXITED | os.WNOHANG | os.WNOWAIT
    while not list(run.glob("tensorboard/*")) and os.waitid(*running) is None:
        time.sleep(0.02)


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--count", type=int, default=1000, help="kills of a write")
    options.add_argument("--runs", type=int, default=20, help="training runs that are killed")
    chosen = options.parse_args()
    draw = random.Random(chosen.seed)
    with tempfile.TemporaryDirectory() as folder:
        for name, trial, count in (("writes", kill_writes, chosen.count), ("runs", kill_runs, chosen.runs)):
            if count:
                outcome = trial(Path(folder), count, draw)
                print(f"{name}: {', '.join(f'{key} {value}' for key, value in outcome.items())}", flush=True)


if __name__ == "__main__":
    main()
