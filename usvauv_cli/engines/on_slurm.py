"""Slurm through submitit: the pieces of work are the elements of a job array; extra `scale`.

The nodes share the folder of the results and can import usvauv.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from kernels.errors import UserError
from usvauv_cli.engines.local import LOST, THREADS
from usvauv_cli.engines.task import Ended, Task

LOOK = 0.2  # seconds between two looks at the jobs


class OnSlurm:
    """Tasks as Slurm jobs.

    Args:
        folder: of what submitit keeps: scripts, and what jobs print.
        partition: of Slurm.
        jobs: elements of an array that run at a time.
        cores, memory, gpu: of a task: CPU cores, GB, graphics cards (rounded up).
        hours: time limit.
        cluster: as submitit names it: "slurm", or "local" for processes of this machine.

    Raises:
        UserError: submitit or Slurm is missing.
    """

    def __init__(
        self,
        folder: Path,
        partition: str,
        jobs: int,
        cores: int,
        memory: float,
        gpu: float,
        hours: float,
        cluster: str = "slurm",
    ) -> None:
        try:
            import submitit
            from submitit.core import utils
        except ImportError:
            raise UserError("--slurm: needs the extra 'scale'; install it with: pip install 'usvauv[scale]'") from None
        try:
            self._executor: Any = submitit.AutoExecutor(folder, cluster)
        except RuntimeError as error:
            raise UserError(f"--slurm {partition}: {str(error).splitlines()[0]}") from None
        self._executor.update_parameters(
            name="usvauv",
            cpus_per_task=cores,
            mem_gb=math.ceil(memory),
            gpus_per_node=math.ceil(gpu),
            timeout_min=math.ceil(60 * hours),
            slurm_partition=partition,
            slurm_array_parallelism=jobs,
            **{f"{cluster}_setup": [f"export {THREADS}={cores}"]},
        )
        self._errors = utils
        self._running: dict[str, Any] = {}

    def submit(self, tasks: Sequence[Task]) -> None:
        try:
            jobs = self._executor.map_array(Task.__call__, tasks)
        except self._errors.FailedSubmissionError as error:
            raise UserError(f"--slurm: {error}") from None
        self._running |= {task.name: job for task, job in zip(tasks, jobs, strict=True)}

    def wait(self, seconds: float) -> list[Ended]:
        until = time.monotonic() + seconds
        while not (ready := [name for name, job in self._running.items() if job.done()]):
            if time.monotonic() > until:
                return []
            time.sleep(LOOK)
        return [self._result(name) for name in ready]

    def _result(self, name: str) -> Ended:
        try:
            return self._running.pop(name).result()
        except (self._errors.UncompletedJobError, self._errors.FailedJobError):
            return Ended(name, "lost", LOST)

    def cancel(self, names: Sequence[str]) -> None:
        for name in names:
            if name in self._running:
                self._running.pop(name).cancel()

    def close(self) -> None:
        """Nothing is left to be let go."""
