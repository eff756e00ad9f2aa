"""Slurm on this machine for tests: its daemons on one node where they are installed, and a stand-in of its commands."""

from __future__ import annotations

import getpass
import os
import platform
import shutil
import signal
import socket
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

DAEMONS = ("munged", "slurmctld", "slurmd")
PLACES = os.pathsep.join([os.environ["PATH"], "/usr/sbin", "/usr/local/sbin"])
INSTALLED = all(shutil.which(name, path=PLACES) for name in (*DAEMONS, "sbatch", "srun", "squeue", "scancel"))
CONFIGURATION = """
ClusterName=here
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
AuthType=auth/munge
AuthInfo=socket={folder}/munge
CredType=cred/munge
SlurmUser={user}
SlurmdUser={user}
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
KillWait=1
NodeName={host} NodeAddr=127.0.0.1 CPUs={cores} RealMemory={memory} State=UNKNOWN
PartitionName=batch Nodes={host} Default=YES State=UP
"""


@contextmanager
def installed() -> Iterator[dict[str, str]]:
    """Slurm's daemons with one node and the partition `batch`; gives the environment variables of its commands."""
    with TemporaryDirectory(prefix="slurm") as place, ExitStack() as stack:  # a socket's path must be short
        folder = Path(place)
        for name in ("state", "spool"):
            (folder / name).mkdir()
        key = folder / "key"
        key.write_bytes(os.urandom(128))
        key.chmod(0o600)
        with socket.socket() as one, socket.socket() as other:
            one.bind(("127.0.0.1", 0))
            other.bind(("127.0.0.1", 0))
            ports = [one.getsockname()[1], other.getsockname()[1]]
        about = {"host": platform.node().partition(".")[0], "user": getpass.getuser(), "cores": os.cpu_count()}
        memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2**20 - 100
        configuration = folder / "slurm.conf"
        configuration.write_text(CONFIGURATION.format(folder=folder, ports=ports, memory=memory, **about))
        variables = {"SLURM_CONF": str(configuration), "PATH": PLACES}
        files = {"socket": "munge", "key-file": "key", "pid-file": "pid", "log-file": "log", "seed-file": "seed"}
        options = [f"--{option}={folder / file}" for option, file in files.items()]
        for command in (["munged", "-F", "--force", *options], ["slurmctld", "-D"], ["slurmd", "-D"]):
            path = shutil.which(command[0], path=PLACES)
            assert path
            output = stack.enter_context((folder / f"{command[0]}.out").open("w"))
            process = subprocess.Popen(
                [path, *command[1:]], stdout=output, stderr=output, env={**os.environ, **variables}
            )
            stack.callback(process.wait)
            stack.callback(process.terminate)
        until = time.monotonic() + 30
        while "idle" not in _said(["sinfo", "--noheader", "--format=%T"], variables):
            assert time.monotonic() < until, "\n".join(path.read_text() for path in folder.glob("*.[ol][ug][tg]"))
            time.sleep(0.2)
        yield variables
        subprocess.run(["scancel", f"--user={about['user']}"], env={**os.environ, **variables}, check=False)


def _said(command: list[str], variables: dict[str, str]) -> str:
    done = subprocess.run(command, env={**os.environ, **variables}, capture_output=True, text=True, check=False)
    return done.stdout


@contextmanager
def stand_in() -> Iterator[dict[str, str]]:
    """Commands of the names of Slurm's that run jobs as processes, all at once; their environment variables."""
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
    fields = [line.removeprefix("#SBATCH --").partition("=") for line in Path(script).read_text().splitlines()]
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
            ["sh", "-c", f"sh {script}; rm {jobs / name}"],
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
