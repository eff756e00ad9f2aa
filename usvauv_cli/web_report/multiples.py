"""Small multiples of a report: the same plot for each combination, with the first one's median in grey."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from usvauv.cli.web_report import document
from usvauv.cli.web_report.document import MUTED, colour
from usvauv.cli.web_report.episodes import PERIODS, Recording, error_quantiles
from usvauv.env.render.figures import Figure, WrittenOut


def bands(names: Sequence[str], time: Sequence[np.ndarray], shown: Sequence[np.ndarray], label: str) -> Figure:
    """Over the time, (F,) of each, the middle one of three quantiles (3, F), and a band between the others."""
    columns = min(len(names), 2)
    rows = math.ceil(len(names) / columns)
    figure = document.new(2.0 if columns == 1 else 0.45 + 0.95 * rows)
    plots = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    for i, (axes, name) in enumerate(zip(plots, names, strict=False)):
        low, middle, high = shown[i]
        axes.fill_between(time[i], low, high, color=colour(0), alpha=0.22, lw=0)
        if i:
            axes.plot(time[0], shown[0][1], color=MUTED, lw=0.7)
        axes.plot(time[i], middle, color=colour(0), lw=1)
        document.name_axes(axes, name, columns)
        document.style_axes(axes)
        if i + columns >= len(names):
            axes.set_xlabel("time, s")
            axes.tick_params(labelbottom=True)
    for axes in plots[len(names) :]:
        axes.set_visible(False)
    figure.supylabel(label, fontsize=7.5)
    return figure


def errors_of_each(names: Sequence[str], recordings: Sequence[Recording], duration: float, kind: str) -> Figure:
    """Errors of a kind, an attribute of the recordings, over time, of all episodes, m."""
    time = (np.arange(PERIODS) + 0.5) / PERIODS * duration
    found = [error_quantiles(getattr(recording, kind), (0.05, 0.5, 0.95)) for recording in recordings]
    figure = bands(names, [time] * len(names), found, "error, m")
    axis = figure.axes[0]
    axis.set(yscale="log", xlim=(0, duration))
    axis.yaxis.set_major_formatter(WrittenOut())
    axis.yaxis.set_minor_formatter(WrittenOut())
    return figure


def ages(names: Sequence[str], recordings: Sequence[Recording]) -> Figure:
    """Ages of the nodes' data over the first episode, s."""
    found = [recording.episode.age for recording in recordings]
    return bands(names, [age[0] for age in found], [age[1:] for age in found], "age, s")
