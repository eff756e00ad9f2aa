"""Figures of a training run as TensorBoard files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from usvauv.env.files import writing

AXES = ("steps", "total", "seconds", "eta", "evaluated_at")  # figures that are no curves of their own


@contextmanager
def scalar_writer(directory: Path, first_step: int) -> Iterator[Callable[[Mapping[str, Any]], None]]:
    """A function that writes the figures of a step; what is in the directory from `first_step` on is discarded.

    Raises:
        OutputError: the directory cannot be written.
    """
    from torch.utils.tensorboard import SummaryWriter  # takes a second to import

    with writing(directory), SummaryWriter(directory, purge_step=first_step) as writer:

        def write(figures: Mapping[str, Any]) -> None:
            for name, value in figures.items():
                if isinstance(value, Mapping):
                    for part, number in value.items():
                        writer.add_scalar(f"{name}/{part}", number, figures["steps"])
                elif name not in AXES:
                    writer.add_scalar(f"run/{name}", value, figures["steps"])

        yield write
