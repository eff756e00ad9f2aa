"""Runs on an engine until all are done or Ctrl-C, shown in the terminal: a bar, and a line for each run that ends.

Engines of several machines are Ray Core, and Slurm through submitit; extra `scale`. The nodes share the folder of the
results and can import usvauv. Ray itself repeats a task whose node is lost. `squeue` shows whether a job of Slurm has
ended, because `sacct`, which submitit uses, gives no answer if Slurm keeps no accounts.
"""

from __future__ import annotations

import logging
import math
import os
import signal
import subprocess
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stderr, suppress
from functools import partial
from io import StringIO
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from usvauv.cli import terminal
from usvauv.cli.sweep.engine import LOST, THREADS, Ended, Engine, Local, Task, conduct, remove_signs, reported, signs_in
from usvauv.cli.sweep.run_folder import FAILURE, Piece, perform
from usvauv.cli.sweep.study import Resources
from usvauv.env import plugins
from usvauv.env.storage import memory
from usvauv.env.storage.files import atomic_write, inside
from usvauv.kernels import runtime
from usvauv.kernels.errors import UserError, in_words
from usvauv.kernels.interruption import SIGNALS, deferred

# Without these Ray reports its use to its makers, and warns of changes in later versions.
SETTINGS = {"RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0", "RAY_USAGE_STATS_ENABLED": "0"}
LOOK = 0.2  # seconds between two looks for results
ASK = 10.0  # seconds between two questions to Slurm; a job without a result that has ended at two of them is lost

RECENT = 300.0  # seconds of work by which the time of the rest is estimated
MOST_JOBS = 1000  # of a Slurm array at a time, unless told otherwise


class OnRay:
    """Tasks on a Ray cluster: "local" begins one on this machine for so many jobs at a time, "auto" finds one."""

    def __init__(self, address: str, jobs: int, needs: Resources) -> None:
        try:
            import ray
            from ray.exceptions import RayError
        except ImportError:
            raise UserError("--ray: needs the extra 'scale'; install it with: pip install 'usvauv[scale]'") from None
        for name, value in SETTINGS.items():
            os.environ.setdefault(name, value)
        handlers = {signum: signal.getsignal(signum) for signum in SIGNALS}
        options: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.ERROR}
        if address == "local":
            options |= {"num_cpus": jobs * needs.cores, "include_dashboard": False}
        try:
            with deferred():  # between the processes that it starts and its knowing of them
                ray.init(address, **options)
        except BaseException as error:
            ray.shutdown()
            if not isinstance(error, (ConnectionError, ValueError, RuntimeError)):
                raise
            raise UserError(f"--ray {address}: {str(error).splitlines()[0]}") from None
        finally:
            for signum, handler in handlers.items():  # Ray takes SIGTERM for itself
                signal.signal(signum, handler)
        self._ray, self._error = ray, RayError
        self._reaper = _reaper() if address == "local" else None
        needed = {"CPU": needs.cores, "GPU": needs.gpu, "memory": needs.memory * 1e9}
        nodes = [node["Resources"] for node in ray.nodes() if node["Alive"]]
        if not any(all(node.get(name, 0) >= number for name, number in needed.items()) for node in nodes):
            wanted = f"{needs.cores} cores, {needs.memory:g} GB and {needs.gpu:g} GPU"
            print(f"warning: no node of Ray has {wanted}; runs wait for one")
        resources = {"num_cpus": needs.cores, "num_gpus": needs.gpu, "memory": int(needs.memory * 1e9)}
        self._call = ray.remote(max_retries=2, **resources)(Task.__call__)
        self._running: dict[Any, str] = {}

    def submit(self, tasks: Sequence[Task]) -> None:
        for task in tasks:
            self._running[self._call.remote(task)] = task.name

    def wait(self, seconds: float) -> list[Ended]:
        ray, references = self._ray, list(self._running)
        if not references or not ray.wait(references, timeout=seconds)[0]:
            return []
        ready, _ = ray.wait(references, num_returns=len(references), timeout=0)
        return [self._result(reference) for reference in ready]

    def _result(self, reference: Any) -> Ended:
        name = self._running.pop(reference)
        try:
            return self._ray.get(reference)
        except self._error:
            return Ended(name, "lost", LOST)

    def cancel(self, names: Sequence[str]) -> None:
        for reference, name in self._running.items():
            if name in names:
                self._ray.cancel(reference)

    def close(self) -> None:
        with suppress(Exception):
            self._ray.shutdown()
        if self._reaper:
            self._reaper.kill()
            self._reaper.communicate()


def _reaper() -> subprocess.Popen[bytes]:
    """A process that kills the present descendants of this one as soon as this one has ended, however it ends.

    Ray's agents would stay for a minute, in which they report the end to a process that is gone too.
    """
    import psutil  # pyright: ignore[reportMissingModuleSource] - of Ray

    ray = [str(process.pid) for process in psutil.Process().children(recursive=True)]
    command = ["sh", "-c", 'read -r _; kill -9 "$@"', "sh", *ray]
    return subprocess.Popen(
        command, stdin=subprocess.PIPE, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL, start_new_session=True
    )


class OnSlurm:
    """Tasks as Slurm jobs, so many at a time, running or waiting; their scripts and what they print are in a folder.

    A share of a graphics card becomes a whole one.
    """

    def __init__(self, folder: Path, partition: str, jobs: int, needs: Resources) -> None:
        try:
            import submitit
            from submitit.core import utils
        except ImportError:
            raise UserError("--slurm: needs the extra 'scale'; install it with: pip install 'usvauv[scale]'") from None
        try:
            self._executor: Any = submitit.AutoExecutor(folder, "slurm")
        except RuntimeError as error:
            raise UserError(f"--slurm {partition}: {error}") from None
        for left in folder.glob("*.pkl"):  # of earlier jobs, or of whoever made the folder: loading one runs its code
            left.unlink()
        self._executor.update_parameters(
            name="usvauv",
            cpus_per_task=needs.cores,
            mem_gb=math.ceil(needs.memory),
            gpus_per_node=math.ceil(needs.gpu),
            timeout_min=math.ceil(60 * needs.hours),
            slurm_partition=partition,
            slurm_array_parallelism=jobs,
            # The second is not passed on by sbatch to srun.
            slurm_setup=[f"export {THREADS}={needs.cores} SRUN_CPUS_PER_TASK={needs.cores}"],
        )
        self._errors, self._partition, self._jobs = utils, partition, jobs
        self._waiting: deque[Task] = deque()
        self._running: dict[str, Any] = {}
        self._gone: set[str] = set()  # of the running ones at the last question
        self._asked = time.monotonic()

    def submit(self, tasks: Sequence[Task]) -> None:
        self._waiting += tasks

    def wait(self, seconds: float) -> list[Ended]:
        self._begin()
        until = time.monotonic() + seconds
        while not (results := self._ended()) and time.monotonic() < until:
            time.sleep(LOOK)
        return results

    def _begin(self) -> None:
        """Submit what there is room for."""
        room = min(self._jobs - len(self._running), len(self._waiting))
        if not room:
            return
        tasks = [self._waiting.popleft() for _ in range(room)]
        try:
            with redirect_stderr(StringIO()):  # which submitit shows and raises
                jobs = self._executor.map_array(Task.__call__, tasks)
        except (self._errors.FailedJobError, self._errors.FailedSubmissionError) as error:
            raise UserError(f"--slurm {self._partition}: {' '.join(str(error).split())}") from None
        self._running |= {task.name: job for task, job in zip(tasks, jobs, strict=True)}

    def _result(self, name: str) -> Ended:
        try:
            return self._running.pop(name).result()
        except self._errors.FailedJobError as error:  # outside of the task, as where usvauv cannot be imported
            return Ended(name, "failed", in_words(error), str(error))

    def _ended(self) -> list[Ended]:
        """The tasks that have a result, and those that Slurm no longer has and that left none."""
        if ready := [name for name, job in self._running.items() if job.paths.result_pickle.exists()]:
            return [self._result(name) for name in ready]
        if time.monotonic() - self._asked < ASK:
            return []
        self._asked = time.monotonic()
        command = ["squeue", "--me", "--noheader", "--array", "--format=%i"]
        asked = subprocess.run(command, capture_output=True, text=True, check=False)
        if asked.returncode:  # its controller restarts
            return []
        before, there = self._gone, set(asked.stdout.split())
        self._gone = {name for name, job in self._running.items() if job.job_id not in there}
        said = {name: (self._running.pop(name).stderr() or "").strip() for name in self._gone & before}
        return [Ended(name, "lost", text.rpartition("\n")[2] or LOST, text) for name, text in said.items()]

    def cancel(self, names: Sequence[str]) -> None:
        self._waiting = deque(task for task in self._waiting if task.name not in names)
        jobs = [self._running.pop(name).job_id for name in names if name in self._running]
        if jobs:
            subprocess.run(["scancel", *jobs], capture_output=True, check=False)

    def close(self) -> None:
        """There are no processes of this machine to end."""


def engine(resources: Resources, folder: Path, ray: str | None, slurm: str | None, jobs: int | None) -> Engine:
    """The engine that options choose; `jobs` are by default as many as there are cores and memory for."""
    if ray not in (None, "local") and jobs is not None:
        raise UserError(f"--jobs {jobs}: must go without --ray {ray}, whose resources decide")
    room = [runtime.available_cores() / resources.cores, memory.available() / (resources.memory * 1e9)]
    if resources.gpu:
        room.append(1 / resources.gpu)
    here = jobs or max(1, int(min(room)))
    if ray is not None:
        return OnRay(ray, here, resources)
    if slurm is not None:
        return OnSlurm(inside(folder, folder / "slurm"), slurm, jobs or MOST_JOBS, resources)
    return Local(here, resources.cores)


def perform_all(
    pieces: Sequence[Piece],
    folder: Path,
    make_engine: Callable[[], Engine],
    threads: int,
    arch: str,
    quiet: bool = False,
) -> str:
    """Perform the rest of runs; returns which failed in words, empty if none did. The others are done then.

    Args:
        quiet: show no progress.

    Raises:
        KeyboardInterrupt: after Ctrl-C, when what was running is saved.
    """
    left = {piece.key: piece for piece in pieces if not piece.finished(folder)}
    every, done = terminal.counted(len(pieces), "run"), len(pieces) - len(left)
    if not left:
        remove_signs(folder)  # of a killed command, whose runs went on elsewhere
        if not quiet:
            print(f"nothing to do: {every} done already")
        return ""
    if not quiet:
        print(f"{len(left)} of {every} to do{f', {done} done already' if done else ''}", flush=True)
    files = tuple(plugins.loaded())
    with signs_in(folder) as signs:
        board = Board(left, folder, signs, quiet)
        tasks = []
        for key, piece in left.items():
            do = partial(perform, piece.definition, piece.evaluate, piece.place(folder).resolve())
            tasks.append(Task(key, do, signs, threads, arch, files))
        with board.bar:
            conduct(make_engine(), tasks, signs, board.ended, board.watch)
    if not board.failed:
        return ""
    failures = f"{folder / 'runs'}/*/{FAILURE}"
    return f"{board.failed} of {every} failed, see {failures}; run the same command to try them again"


class Board:
    """Shows how far runs are while `bar`, of all work, is a context, and a line for each that ends.

    How one failed is written into its folder.
    """

    def __init__(self, pieces: Mapping[str, Piece], folder: Path, signs: Path, quiet: bool = False) -> None:
        self._pieces, self._folder, self._signs = pieces, folder, signs
        self._work = {key: piece.work for key, piece in pieces.items()}
        self._unfinished = dict.fromkeys(pieces)
        self.failed = 0
        self._done = dict[str, float]()  # work by run
        self._console = Console(markup=False, emoji=False, highlight=False, quiet=quiet)
        self.bar = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(8),
            TaskProgressColumn(),
            TimeRemainingColumn(),
            console=self._console,
            transient=True,
            disable=quiet or not self._console.is_terminal,
            speed_estimate_period=RECENT,
        )
        self._all = self.bar.add_task("", total=sum(self._work.values()))
        self._show()

    def ended(self, result: Ended) -> None:
        """Show that a run has ended."""
        del self._unfinished[result.name]
        piece, how = self._pieces[result.name], "done"
        if result.how != "done":
            self.failed += 1
            how, place = f"failed: {result.words}", piece.place(self._folder)
            place.mkdir(parents=True, exist_ok=True)
            with atomic_write(place / FAILURE) as partial_file:
                partial_file.write_text(f"{result.details or result.words}\n", encoding="utf-8")
        self._done[result.name] = self._work[result.name]
        self._show()
        number = len(self._pieces) - len(self._unfinished)
        line = f"{number}/{len(self._pieces)} {piece.method} in {piece.task}, seed {piece.seed}: {how}"
        left = self.bar.tasks[0].time_remaining
        line += f", about {terminal.duration(left, rough=True)} left" if left and self._unfinished else ""
        self._console.print(terminal.wrapped(f"{line} ({result.name})", 2), soft_wrap=True)

    def watch(self) -> None:
        """Show what unfinished runs report."""
        found = {key: reported(self._signs, key) for key in self._unfinished}
        self._done |= {key: units for key, units in found.items() if units is not None}
        self._show()

    def _show(self) -> None:
        running = len(self._unfinished.keys() & self._done.keys())
        count, waiting = len(self._pieces), len(self._unfinished) - running
        ended = f"{count - len(self._unfinished)} of {count} ended"
        state = f"{ended}, {running} running, {waiting} waiting, {self.failed} failed"
        self.bar.update(self._all, completed=sum(self._done.values()), description=state)
