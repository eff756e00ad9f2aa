"""Pieces of work of a reproduction: their interface, how they report progress and how they stop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from usvauv.cli.engines.task import Stopped
from usvauv.cli.engines.training import EVALUATION_STEP
from usvauv.cli.reproduction.settings import Settings


@dataclass(frozen=True)
class Work:
    """Surroundings of a piece of work.

    Attributes:
        settings: of the reproduction.
        folder: of all results.
        advance: called with the work just done, in world-steps of training.
        stopping: whether to stop.
    """

    settings: Settings
    folder: Path
    advance: Callable[[float], None]
    stopping: Callable[[], bool]

    def step(self, _: int) -> None:
        """Report one step of an evaluation.

        Raises:
            Stopped: the work is to stop.
        """
        self.advance(EVALUATION_STEP)
        if self.stopping():
            raise Stopped


class Piece(Protocol):
    """A piece of work that can be stopped and resumed; finished work is not done again."""

    def left(self, settings: Settings, folder: Path) -> float:
        """Work still to do, in world-steps of training; 0 when all is done."""
        ...

    def run(self, work: Work) -> None:
        """Do the work that is left.

        Raises:
            Stopped: `work.stopping()` was true.
        """
