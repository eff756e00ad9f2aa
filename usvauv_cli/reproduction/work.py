"""What the pieces of work have in common: how they report and stop, and their tables."""

from __future__ import annotations

import csv
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from usvauv_cli.reproduction.settings import Settings

EVALUATION_STEP = 12  # a step of an evaluation's worlds takes about as long as so many world-steps of training


class Stopped(Exception):
    """Work was stopped on request; what there is of it is saved."""


@dataclass(frozen=True)
class Work:
    """What a piece of work needs to know.

    Attributes:
        settings: what is to be done.
        folder: where everything is kept.
        advance: told of work done, in world-steps of training.
        stopping: whether to stop.
    """

    settings: Settings
    folder: Path
    advance: Callable[[float], None]
    stopping: Callable[[], bool]

    def step(self, _: int) -> None:
        """A step of an evaluation is done; raises `Stopped` when it is time to."""
        self.advance(EVALUATION_STEP)
        if self.stopping():
            raise Stopped


class Piece(Protocol):
    """A piece of work: it can be stopped, goes on where it stopped, and is not done twice."""

    def left(self, settings: Settings, folder: Path) -> float:
        """What is still to do, in world-steps of training; 0 when all is done."""

    def run(self, work: Work) -> None:
        """Do what is left; raises `Stopped` when told to stop."""


def write_rows(path: Path, names: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> None:
    """Write a CSV with a header; the file appears only when it is complete."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(path.name + ".partial")
    try:
        with partial.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.DictWriter(stream, names)
            writer.writeheader()
            writer.writerows(rows)
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def read_rows(path: Path) -> list[dict[str, str]]:
    """The rows of a CSV that `write_rows` wrote."""
    with path.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))
