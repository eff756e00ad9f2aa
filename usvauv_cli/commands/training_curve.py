"""The curve of a training run as text: the margin over the heuristic at each evaluation, with its 95 % interval."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

HEIGHT, WIDTH = 9, 60  # letters


def curve(evaluations: Sequence[Mapping], baseline: str) -> list[str]:
    """Lines of a plot of *margin* ± *margin_half* over *steps*; the heuristic is the line at 0.

    Empty where fewer than two evaluations have a margin, as in a run of an earlier version.
    """
    points = [(row["steps"], row["margin"], row.get("margin_half", math.nan)) for row in evaluations if "margin" in row]
    if len(points) < 2 or points[-1][0] <= points[0][0]:
        return []
    ends = [0.0]
    for _, mean, half in points:
        ends += [mean] if math.isnan(half) else [mean - half, mean + half]
    low, high = min(ends), max(ends)
    high = high if high > low else low + 1.0
    begin, end = points[0][0], points[-1][0]

    def row_of(value: float) -> int:
        return round((high - value) / (high - low) * (HEIGHT - 1))

    grid = [[" "] * WIDTH for _ in range(HEIGHT)]
    grid[row_of(0.0)] = ["┄"] * WIDTH
    for steps, mean, half in points:
        column = round((steps - begin) / (end - begin) * (WIDTH - 1))
        if not math.isnan(half):
            for row in range(row_of(mean + half), row_of(mean - half) + 1):
                grid[row][column] = "│"
        grid[row_of(mean)][column] = "●"
    marks = {HEIGHT - 1: low, 0: high, row_of(0.0): 0.0}
    names = [f"{marks[row]:+.2f}".replace("-", "−") if row in marks else "" for row in range(HEIGHT)]
    lines = [f"{name:>7} ┤{''.join(letters).rstrip()}" for name, letters in zip(names, grid, strict=True)]
    last = f"{end:,} world-steps"
    scale = f"{'':>9}{begin:,}".ljust(9 + WIDTH - len(last)) + last
    return [f"margin over {baseline} in ARPS, with 95 % intervals:", *lines, scale]
