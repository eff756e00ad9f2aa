"""A piece of work that runs in some process, and what that process and the one that waits for it tell each other.

They share a folder of signs, on a shared file system if they are on different machines: SIGNS/NAME says how much of a
piece is done, SIGNS/stop asks all of them to stop, as does its removal.
"""

from __future__ import annotations

import multiprocessing
import os
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, NamedTuple

from usvauv.kernels.errors import UserError, in_words

STOP = "stop"  # the sign to stop
REPORT = 0.3  # seconds between two looks at a sign, and between two reports


class Stopped(Exception):
    """Work was stopped on request; its results so far are saved."""


class Ended(NamedTuple):
    """How a piece of work ended.

    Attributes:
        name: of the piece.
        how: "lost" if its process or machine ended before the piece did.
        words: why it failed, in one line.
        details: traceback of an error that is none of the user's.
    """

    name: str
    how: Literal["done", "stopped", "failed", "lost"]
    words: str = ""
    details: str = ""


class Signs:
    """What a piece of work tells, and whether it is to stop."""

    def __init__(self, folder: Path, name: str) -> None:
        self._stop, self._report = folder / STOP, folder / name
        self._parent = multiprocessing.parent_process()
        self._done, self._told, self._looked, self._asked = 0.0, 0.0, 0.0, False

    def advance(self, units: float) -> None:
        """Report that much more work as done."""
        self._done += units
        if time.monotonic() - self._told > REPORT:
            self._told = time.monotonic()
            with suppress(OSError):  # a report that is lost harms nobody
                self._report.write_text(repr(self._done), encoding="ascii")

    def stopping(self) -> bool:
        """Whether to stop: it was asked for, or what began this piece has ended, or its command was given again."""
        if not self._asked and time.monotonic() - self._looked > REPORT:
            self._looked = time.monotonic()
            orphaned = self._parent is not None and not self._parent.is_alive()
            self._asked = orphaned or self._stop.exists() or not self._stop.parent.exists()
        return self._asked


def reported(folder: Path, name: str) -> float | None:
    """Work that a piece has reported as done; None: it has not begun."""
    try:
        return float((folder / name).read_text(encoding="ascii"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError):  # it is being written
        return 0.0


@dataclass(frozen=True)
class Task:
    """A piece of work with what its process needs; it can be pickled, and is called in that process.

    Attributes:
        name: of the piece and of its file of signs.
        do: does it, unless it is done already.
        signs: folder of the signs; it exists.
        threads: of Taichi's kernels.
        arch: as `usvauv.kernels.runtime.start` takes it.
        plugins: files to load first.
        directory: where relative paths begin.
    """

    name: str
    do: Callable[[Signs], None]
    signs: Path
    threads: int
    arch: str = "auto"
    plugins: tuple[Path, ...] = ()
    directory: Path = field(default_factory=Path.cwd)

    def __call__(self) -> Ended:
        """Do the piece in this process; whatever it raises becomes the answer."""
        from usvauv.env import plugins
        from usvauv.kernels import runtime

        signs = Signs(self.signs, self.name)
        try:
            if signs.stopping():
                return Ended(self.name, "stopped")
            signs.advance(0.0)
            os.chdir(self.directory)
            plugins.load_installed()
            for file in self.plugins:
                plugins.load(file)
            runtime.start(self.arch, self.threads)
            self.do(signs)
        except Stopped:
            return Ended(self.name, "stopped")
        except UserError as error:
            return Ended(self.name, "failed", str(error))
        except (Exception, SystemExit) as error:
            return Ended(self.name, "failed", in_words(error), traceback.format_exc())
        return Ended(self.name, "done")
