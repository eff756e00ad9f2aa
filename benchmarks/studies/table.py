"""Markdown tables of figures with their intervals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from usvauv.cli.evaluation import comparison
from usvauv.env import EpisodeMetrics


def figure(rows: Sequence[EpisodeMetrics], name: str) -> np.ndarray:
    """A figure of each episode."""
    return np.array([row.columns()[name] for row in rows])


def interval(values: np.ndarray, digits: int = 1) -> str:
    """Mean and 95 % interval of the finite ones, of episodes on seas of their own."""
    mean, half, _ = comparison.interval(np.where(np.isfinite(values), values, np.nan))
    return f"{mean:.{digits}f} ± {half:.{digits}f}".replace("-", "−")


def line(cells: Sequence[str]) -> None:
    print("| " + " | ".join(cells) + " |", flush=True)


def head(cells: Sequence[str]) -> None:
    line(cells)
    line(["---"] * len(cells))
