"""What the commands share that learn decisions."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from usvauv.cli import tables
from usvauv.kernels.interruption import Interrupted

if TYPE_CHECKING:
    from usvauv.policies.decisions import DecisionTrainer


def learn(trainer: DecisionTrainer, baselines: Sequence[str], out: Path, about: dict[str, Any]) -> None:
    """Train, with a line for each evaluation beside baselines in the same worlds; Ctrl-C keeps the best weights."""
    iterations = trainer.config.iterations
    against = ", ".join(f"{name} {trainer.evaluate_other(name):.1f}" for name in baselines)
    typer.echo(tables.wrapped(f"evaluation, Mbit: {against}", 2))
    begun = time.monotonic()
    try:
        for result in trainer.train(out, about):
            typer.echo(
                f"iteration {result.iteration} of {iterations}: {result.sampled:.1f} Mbit drawn,"
                f" evaluation {result.evaluated:.1f}, best {trainer.best:.1f};"
                f" {(time.monotonic() - begun) * (iterations / result.iteration - 1):.0f} s left"
            )
    except Interrupted:
        typer.echo(f"stopped after {trainer.iteration} of {iterations} iterations")
        if math.isfinite(trainer.best):
            typer.echo(f"best {trainer.best:.1f} Mbit in {out}")
        raise
    typer.echo(tables.wrapped(f"best {trainer.best:.1f} Mbit ({against}) in {out}", 2))
