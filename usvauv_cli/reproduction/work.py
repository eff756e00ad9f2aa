"""What the pieces of work have in common: how they report and stop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

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
