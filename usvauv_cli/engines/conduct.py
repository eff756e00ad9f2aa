"""Many pieces of work on an engine: all of them, until Ctrl-C; those whose process was lost, or that stopped unasked,
again.
"""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol
from uuid import uuid4

from usvauv.cli.engines.task import REPORT, STOP, Ended, Task, reported
from usvauv.env.storage.files import writing
from usvauv.kernels.interruption import deferred

ATTEMPTS = 3  # at a piece that does not end by itself
UNFINISHED = ("lost", "stopped")
SIGNS = ".signs"


class Engine(Protocol):
    """Something that runs tasks in processes of its own."""

    def submit(self, tasks: Sequence[Task]) -> None:
        """Take tasks, to run each when there is room for it."""
        ...

    def wait(self, seconds: float) -> list[Ended]:
        """Those that have ended since the last call; waits up to that long for the first."""
        ...

    def cancel(self, names: Sequence[str]) -> None:
        """Forget tasks that have not begun."""
        ...

    def close(self) -> None:
        """Let go of the processes; none has a task."""
        ...


@contextmanager
def signs_in(folder: Path) -> Iterator[Path]:
    """A new folder for signs below `folder`, which is removed at the end. Those of others there are removed first, so
    that what they left running on other machines stops.
    """
    signs = folder.absolute() / SIGNS / uuid4().hex  # processes begin elsewhere
    with writing(signs):
        shutil.rmtree(signs.parent, ignore_errors=True)
        signs.mkdir(parents=True)
    try:
        yield signs
    finally:
        shutil.rmtree(signs.parent, ignore_errors=True)


def conduct(
    engine: Engine,
    tasks: Sequence[Task],
    signs: Path,
    ended: Callable[[Ended], None],
    watch: Callable[[], None] = lambda: None,
) -> None:
    """Run tasks and close the engine. Whatever ends it early, as Ctrl-C does, asks those that run to stop, and waits.

    Args:
        engine: runs them.
        tasks: of different names.
        signs: folder of their signs.
        ended: called with each result that is final.
        watch: called several times a second.
    """
    left, attempts = {task.name: task for task in tasks}, Counter()

    def collect() -> Iterator[Ended]:
        for result in engine.wait(REPORT):
            attempts[result.name] += 1
            if result.how not in UNFINISHED or attempts[result.name] == ATTEMPTS:
                del left[result.name]
            yield result

    try:
        engine.submit(tasks)
        while left:
            for result in collect():
                if result.name in left:
                    engine.submit([left[result.name]])
                else:
                    ended(result)
            watch()
    except BaseException:
        with deferred():
            (signs / STOP).touch()
            waiting = [name for name in left if reported(signs, name) is None]
            engine.cancel(waiting)
            for name in waiting:
                del left[name]
            while left:
                for result in engine.wait(REPORT):
                    left.pop(result.name, None)
        raise
    finally:
        with deferred():
            engine.close()
