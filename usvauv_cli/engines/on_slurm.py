"""Slurm through submitit: the pieces of work are the elements of job arrays; extra `scale`.

The nodes share the folder of the results and can import usvauv. Whether a job has ended is asked of `squeue`, because
`sacct`, which submitit asks, knows nothing where Slurm keeps no accounts.
"""

from __future__ import annotations

import math
import subprocess
import time
from collections import deque
from collections.abc import Sequence
from contextlib import redirect_stderr
from io import StringIO
from pathlib import Path
from typing import Any

from usvauv.cli.engines.local import LOST, THREADS
from usvauv.cli.engines.task import Ended, Task
from usvauv.kernels.errors import UserError, in_words

LOOK = 0.2  # seconds between two looks for results
ASK = 10.0  # seconds between two questions to Slurm; a job without a result that has ended at two of them is lost


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
        """Nothing is left to be let go."""
