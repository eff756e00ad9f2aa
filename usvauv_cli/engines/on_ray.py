"""Ray Core: each piece of work is a Ray task with its resources, on whichever node has them; extra `scale`.

The nodes share the folder of the results and can import usvauv. Ray itself runs a task again whose node is lost.
"""

from __future__ import annotations

import logging
import os
import signal
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from usvauv.cli.engines.local import LOST
from usvauv.cli.engines.task import Ended, Task
from usvauv.kernels.errors import UserError
from usvauv.kernels.interruption import SIGNALS

# Else Ray tells other processes of this machine, and its makers, and warns of what a later version does.
SETTINGS = {"RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0", "RAY_USAGE_STATS_ENABLED": "0"}


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
            ray.init(address, log_to_driver=False, logging_level=logging.ERROR, **here)
        except (ConnectionError, ValueError, RuntimeError) as error:
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
