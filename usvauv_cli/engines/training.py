"""A training run that can be stopped at any time and goes on where it was saved last."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from usvauv import policies
from usvauv.cli.engines.task import Stopped
from usvauv.policies import checkpoint

EVALUATION_STEP = 12  # world-steps of training that take as long as one step of an evaluation's worlds


def trained(place: Path) -> int:
    """World-steps that are done of the run in a folder."""
    return policies.read_run(place)[2]["steps"] if checkpoint.path_of(place, checkpoint.LAST).exists() else 0


def left(place: Path, steps: int, evaluations: int, mission_steps: int) -> float:
    """Work still to do of a run of `steps` world-steps, in world-steps."""
    if trained(place) >= steps:
        return 0.0
    missing = evaluations + 1 - len(policies.read_history(place))
    return steps - trained(place) + missing * EVALUATION_STEP * mission_steps


def go_on(
    trainer: policies.Trainer, steps: int, advance: Callable[[float], None], stopping: Callable[[], bool]
) -> None:
    """Train until `steps` world-steps are done in all; then the run is only read, and its replay is removed.

    Args:
        trainer: new; its directory is cleaned and locked.
        steps: of the whole run.
        advance: called with the world-steps just done.
        stopping: whether to stop.

    Raises:
        Stopped: `stopping()` was true; the run is saved.
        KeyboardInterrupt: the same after Ctrl-C in this process.
    """
    assert trainer.directory is not None
    if checkpoint.path_of(trainer.directory, checkpoint.LAST).exists():
        trainer.resume()
    done = trainer.steps

    def watch(figures: Mapping[str, Any]) -> None:
        nonlocal done
        advance(figures["steps"] - done)
        done = figures["steps"]
        trainer.stopped |= stopping()

    trainer.train(steps, watch)
    if trainer.steps < steps:
        trainer.interruption.raise_if_asked()
        raise Stopped
    checkpoint.close_run(trainer.directory)
