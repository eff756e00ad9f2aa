"""Pieces of work for tests of the engines, in a module that the processes which do them load at once, and an engine."""

import json
import os
import signal
import sys
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from usvauv.cli.sweep.engine import Ended, Signs, Stopped, Task, conduct, signs_in
from usvauv.kernels.errors import UserError


class Here:
    """An engine without processes: tasks in this one, one after the other."""

    def __init__(self) -> None:
        self.waiting: list[Task] = []

    def submit(self, tasks: Sequence[Task]) -> None:
        self.waiting += tasks

    def wait(self, seconds: float) -> list[Ended]:
        return [self.waiting.pop(0)()] if self.waiting else []

    def cancel(self, names: Sequence[str]) -> None:
        self.waiting = [task for task in self.waiting if task.name not in names]

    def close(self) -> None:
        """There is nothing to close."""


def cores_of_process(path: Path, signs: Signs) -> None:
    import torch

    from usvauv.cli.sweep import engine
    from usvauv.kernels import runtime

    threads = [os.environ[engine.THREADS], runtime.start().threads, torch.get_num_threads()]
    time.sleep(0.5)  # so that another process gets the other piece
    path.write_text(json.dumps([os.getpid(), sorted(os.sched_getaffinity(0)), *threads]))


def killed(path: Path, times: int, signs: Signs) -> None:
    tries = int(path.read_text()) if path.exists() else 0
    path.write_text(str(tries + 1))
    if tries < times:
        os.kill(os.getpid(), signal.SIGKILL)


def until_stopped(path: Path, signs: Signs) -> None:
    path.touch()
    while not signs.stopping():
        time.sleep(0.05)
    raise Stopped


def waits_at_first(path: Path, signs: Signs) -> None:
    path.write_text("2" if path.exists() else "1")
    while path.read_text() == "1":
        time.sleep(0.05)


def in_here(signs: Signs) -> None:
    assert Path.cwd().name == "here"


def failing(signs: Signs) -> None:
    raise UserError("the last line")


def on_node(folder: Path, name: str, signs: Signs) -> None:
    """Tells where it is, waits until pieces there may end, and counts that it has."""
    import ray

    node = ray.get_runtime_context().get_node_id()
    (folder / f"{name}-{node}").touch()
    while not (folder / f"go on-{node}").exists():
        time.sleep(0.05)
    with (folder / "ended").open("a") as file:
        print(name, file=file)


def on_ray(folder: Path) -> int:
    """A command that has a task on Ray until it is stopped."""
    from usvauv.cli.sweep.perform import OnRay
    from usvauv.cli.sweep.study import Resources

    with signs_in(folder) as signs:
        task = Task("a", partial(until_stopped, folder / "begun"), signs, 1, "cpu")
        conduct(OnRay("local", 1, Resources(memory=0.5)), [task], signs, print)
    return 0


if __name__ == "__main__":
    from usvauv.cli import app

    app._command = partial(on_ray, Path(sys.argv[1]))
    app.main()
