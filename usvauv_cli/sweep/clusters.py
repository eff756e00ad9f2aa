"""Engines of several machines: Ray Core, and Slurm through submitit; extra `scale`.

The nodes share the folder of the results and can import usvauv. Ray itself runs a task again whose node is lost.
`squeue` says whether a job of Slurm has ended, because `sacct`, which submitit asks, has no answer where Slurm keeps no
accounts.
"""

from __future__ import annotations

import logging
import math
import os
import signal
import subprocess
import time
from collections import deque
from collections.abc import Sequence
from contextlib import redirect_stderr, suppress
from io import StringIO
from pathlib import Path
from typing import Any

from usvauv.cli.sweep.engine import Ended, Task
from usvauv.cli.sweep.local import LOST, THREADS
from usvauv.kernels.errors import UserError, in_words
from usvauv.kernels.interruption import SIGNALS, deferred

# Without these Ray reports its use to its makers, and warns of changes in later versions.
SETTINGS = {"RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0", "RAY_USAGE_STATS_ENABLED": "0"}
LOOK = 0.2  # seconds between two looks for results
ASK = 10.0  # seconds between two questions to Slurm; a job without a result that has ended at two of them is lost


class OnRay:
    """Tasks on a Ray cluster.

    Args:
        address: "local" begins one on this machine, "auto" finds one, else where one is.
        jobs: tasks at a time on one that is begun here.
        cores, memory, gpu: of a task: CPU cores, GB, share of a graphics card.

    Raises:
        UserError: Ray is missing, or there is no such cluster.
    """

    def __init__(self, address: str, jobs: int, cores: int, memory: float, gpu: float) -> None:
        try:
            import ray
            from ray.exceptions import RayError
        except ImportError:
            raise UserError("--ray: needs the extra 'scale'; install it with: pip install 'usvauv[scale]'") from None
        for name, value in SETTINGS.items():
            os.environ.setdefault(name, value)
        handlers = {signum: signal.getsignal(signum) for signum in SIGNALS}
        here: dict[str, Any] = {"num_cpus": jobs * cores, "include_dashboard": False} if address == "local" else {}
        try:
            with deferred():  # between the processes that it starts and its knowing of them
                ray.init(address, log_to_driver=False, logging_level=logging.ERROR, **here)
        except BaseException as error:
            ray.shutdown()
            if not isinstance(error, (ConnectionError, ValueError, RuntimeError)):
                raise
            raise UserError(f"--ray {address}: {str(error).splitlines()[0]}") from None
        finally:
            for signum, handler in handlers.items():  # Ray takes SIGTERM for itself
                signal.signal(signum, handler)
        self._ray, self._error = ray, RayError
        needed = {"CPU": cores, "GPU": gpu, "memory": memory * 1e9}
        nodes = [node["Resources"] for node in ray.nodes() if node["Alive"]]
        if not any(all(node.get(name, 0) >= number for name, number in needed.items()) for node in nodes):
            print(f"warning: no node of Ray has {cores} cores, {memory:g} GB and {gpu:g} GPU; runs wait for one")
        resources = {"num_cpus": cores, "num_gpus": gpu, "memory": int(memory * 1e9)}
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


class OnSlurm:
    """Tasks as Slurm jobs.

    Args:
        folder: of what submitit keeps: scripts, and what jobs print.
        partition: of Slurm.
        jobs: that Slurm has at a time, running or waiting.
        cores, memory, gpu: of a task: CPU cores, GB, graphics cards (rounded up).
        hours: time limit.

    Raises:
        UserError: submitit or Slurm is missing.
    """

    def __init__(
        self, folder: Path, partition: str, jobs: int, cores: int, memory: float, gpu: float, hours: float
    ) -> None:
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
            cpus_per_task=cores,
            mem_gb=math.ceil(memory),
            gpus_per_node=math.ceil(gpu),
            timeout_min=math.ceil(60 * hours),
            slurm_partition=partition,
            slurm_array_parallelism=jobs,
            slurm_setup=[
                f"export {THREADS}={cores} SRUN_CPUS_PER_TASK={cores}"
            ],  # which srun does not take from sbatch
        )
        self._errors, self._partition, self._jobs = utils, partition, jobs
        self._waiting: deque[Task] = deque()
        self._running: dict[str, Any] = {}
        self._ended: set[str] = set()  # of the running ones at the last question
        self._asked = time.monotonic()

    def submit(self, tasks: Sequence[Task]) -> None:
        self._waiting += tasks

    def wait(self, seconds: float) -> list[Ended]:
        self._begin()
        until = time.monotonic() + seconds
        while not (results := [*self._results(), *self._lost()]) and time.monotonic() < until:
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

    def _results(self) -> list[Ended]:
        return [self._result(name) for name, job in list(self._running.items()) if job.paths.result_pickle.exists()]

    def _result(self, name: str) -> Ended:
        try:
            return self._running.pop(name).result()
        except self._errors.FailedJobError as error:  # outside of the task, as where usvauv cannot be imported
            return Ended(name, "failed", in_words(error), str(error))

    def _lost(self) -> list[Ended]:
        """Those that Slurm no longer has and that left no result."""
        if time.monotonic() - self._asked < ASK:
            return []
        self._asked = time.monotonic()
        command = ["squeue", "--me", "--noheader", "--array", "--format=%i"]
        asked = subprocess.run(command, capture_output=True, text=True, check=False)
        if asked.returncode:  # its controller restarts
            return []
        before, there = self._ended, set(asked.stdout.split())
        self._ended = {name for name, job in self._running.items() if job.job_id not in there}
        return [self._gone(name) for name in self._ended & before]

    def _gone(self, name: str) -> Ended:
        said = (self._running.pop(name).stderr() or "").strip()
        return Ended(name, "lost", said.rpartition("\n")[2] or LOST, said)

    def cancel(self, names: Sequence[str]) -> None:
        self._waiting = deque(task for task in self._waiting if task.name not in names)
        jobs = [self._running.pop(name).job_id for name in names if name in self._running]
        if jobs:
            subprocess.run(["scancel", *jobs], capture_output=True, check=False)

    def close(self) -> None:
        """There are no processes of this machine to end."""
