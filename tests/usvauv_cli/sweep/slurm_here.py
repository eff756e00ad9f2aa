"""A stand-in of Slurm's commands for tests: jobs are processes of this machine, which all begin at once."""

from __future__ import annotations

import os
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory


@contextmanager
def stand_in() -> Iterator[dict[str, str]]:
    """Commands of the names of Slurm's, in a folder of their own; the environment variables that lead to them."""
    with TemporaryDirectory(prefix="slurm") as place:
        for name in COMMANDS:
            path = Path(place, name)
            path.write_text(f'#!/bin/sh\nexec {sys.executable} {__file__} {place}/jobs {name} "$@"\n')
            path.chmod(path.stat().st_mode | stat.S_IXUSR)
        jobs = Path(place, "jobs")
        jobs.mkdir()
        yield {"PATH": os.pathsep.join([place, os.environ["PATH"]])}
        _scancel(jobs, *[path.name for path in jobs.iterdir()])


def _sbatch(jobs: Path, script: str) -> None:
    text = Path(script).read_text()  # as Slurm keeps a copy: submitit moves the file while the job begins
    fields = [line.removeprefix("#SBATCH --").partition("=") for line in text.splitlines()]
    about = {name: value for name, _, value in fields}
    if about["partition"] != "batch":
        sys.exit("sbatch: error: invalid partition specified")
    number = time.time_ns()
    last = about.get("array", "").partition("%")[0].rpartition("-")[2]
    for element in range(int(last) + 1) if last else [None]:
        name = f"{number}" if element is None else f"{number}_{element}"
        array = {} if element is None else {"SLURM_ARRAY_JOB_ID": f"{number}", "SLURM_ARRAY_TASK_ID": f"{element}"}
        ranks = dict.fromkeys(("SLURM_NODEID", "SLURM_PROCID", "SLURM_LOCALID"), "0")
        one = dict.fromkeys(("SLURM_NTASKS", "SLURM_JOB_NUM_NODES"), "1")
        running = subprocess.Popen(
            ["sh", "-c", 'sh -c "$1"; rm "$2"', "sh", text, str(jobs / name)],
            env={**os.environ, "SLURM_JOB_ID": f"{number}", **array, **ranks, **one},
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
        (jobs / name).write_text(str(running.pid))
    print(f"Submitted batch job {number}")


def _srun(jobs: Path, unbuffered: str, output: str, out: str, error: str, err: str, *command: str) -> None:
    assert (unbuffered, output, error) == ("--unbuffered", "--output", "--error")
    os.execvp(command[0], command)


def _squeue(jobs: Path, *options: str) -> None:
    assert options == ("--me", "--noheader", "--array", "--format=%i")
    print(*[path.name for path in jobs.iterdir()], sep="\n")


def _scancel(jobs: Path, *names: str) -> None:
    for name in names:
        os.killpg(int((jobs / name).read_text()), signal.SIGKILL)
        (jobs / name).unlink(missing_ok=True)


COMMANDS = {"sbatch": _sbatch, "srun": _srun, "squeue": _squeue, "scancel": _scancel}

if __name__ == "__main__":
    COMMANDS[sys.argv[2]](Path(sys.argv[1]), *sys.argv[3:])
