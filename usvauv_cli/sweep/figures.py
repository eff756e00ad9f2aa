"""Figures of a study's page, drawn from the numbers of its summary."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from usvauv.cli.web_report.figure_style import (
    INK,
    MUTED,
    colour,
    dash,
    drawing,
    legend,
    marker,
    new,
    rows_of_legend,
    style_axes,
)
from usvauv.cli.web_report.figures import shortened

NAMES = {"iqm": "interquartile mean", "median": "median", "mean": "mean"}
ROW = 0.15  # inches of a row of points
TITLE = 54  # letters
Values = Mapping[str, Any]  # "value", "low" and "high", of which the last two may be None
Curve = Sequence[tuple[float, Values]]  # world-steps, score


def scores(tasks: Mapping[str, Mapping[str, Values]], methods: Mapping[str, str], score: str) -> Figure:
    """Mean score of each method, a plot for each task; `methods` has names in the order of their colours."""
    with drawing("scores"):
        heights = [ROW * len(of) + 0.42 for of in tasks.values()]
        figure = new(sum(heights) + 0.25 + rows_of_legend(list(methods.values())))
        plots = figure.subplots(len(tasks), 1, squeeze=False, height_ratios=heights).ravel()
        for axes, (task, of_methods) in zip(plots, tasks.items(), strict=True):
            _rows(axes, [(list(methods).index(method), value) for method, value in of_methods.items()])
            axes.set_title(shortened(task, TITLE), loc="left", pad=3)
        plots[-1].set_xlabel(score)
        legend(figure, _points(methods.values()))
    return figure


def aggregates(of_methods: Mapping[str, Mapping[str, Values]], methods: Mapping[str, str]) -> Figure:
    """Interquartile mean, median and mean of scaled scores, side by side."""
    with drawing("aggregates"):
        figure = new(ROW * len(of_methods) + 0.65 + rows_of_legend(list(methods.values())))
        plots = figure.subplots(1, len(NAMES), sharex=True)
        for axes, (name, words) in zip(plots, NAMES.items(), strict=True):
            _rows(axes, [(list(methods).index(method), of[name]) for method, of in of_methods.items()])
            axes.set_title(words, loc="left", pad=3)
            axes.set_xlim(-0.02, 1.02)
        plots[1].set_xlabel("scaled score")
        legend(figure, _points(methods.values()))
    return figure


def profiles(of_methods: Mapping[str, Sequence[Values]], methods: Mapping[str, str]) -> Figure:
    """Share of runs above a scaled score, with bands of 95 %."""
    with drawing("profiles"):
        figure = new(2.2 + rows_of_legend(list(methods.values())))
        axes = figure.add_subplot()
        for method, profile in of_methods.items():
            _curve(axes, list(methods).index(method), [(point["above"], point) for point in profile])
        axes.set(xlabel="scaled score τ", ylabel="share of runs above τ", xlim=(0, 1), ylim=(-0.02, 1.02))
        style_axes(axes)
        legend(figure, _lines(methods.values()))
    return figure


def improvement(pairs: Sequence[Values], methods: Mapping[str, str]) -> Figure:
    """Probability that a run of one method is better than one of another, for each pair."""
    with drawing("improvement"):
        figure = new(0.32 * len(pairs) + 0.55)
        axes = figure.add_subplot()
        _rows(axes, [(list(methods).index(pair["method"]), pair) for pair in pairs])
        names = [[shortened(methods[pair[which]], 24) for which in ("method", "over")] for pair in pairs]
        axes.set_yticks(range(0, -len(pairs), -1), [f"{one}\nover {other}" for one, other in names])
        axes.axvline(0.5, color=MUTED, lw=0.8, zorder=1)
        axes.set(xlim=(-0.02, 1.02), xlabel="probability of improvement")
    return figure


def learning(tasks: Mapping[str, Mapping[str, Curve]], methods: Mapping[str, str], score: str) -> Figure:
    """Mean score of evaluations during the training, with bands of 95 % over seeds, a plot for each task."""
    drawn = {method for of_methods in tasks.values() for method in of_methods}
    with drawing("learning"):
        figure = new(1.75 * len(tasks) + 0.25 + rows_of_legend([methods[method] for method in drawn]))
        plots = figure.subplots(len(tasks), 1, squeeze=False).ravel()
        for axes, (task, of_methods) in zip(plots, tasks.items(), strict=True):
            for method, curve in of_methods.items():
                _curve(axes, list(methods).index(method), curve)
            axes.set_title(shortened(task, TITLE), loc="left", pad=3)
            axes.set_ylabel(score)
            style_axes(axes)
        plots[-1].set_xlabel("world-steps")
        legend(
            figure, [line for method, line in zip(methods, _lines(methods.values()), strict=True) if method in drawn]
        )
    return figure


def _rows(axes: Axes, rows: Sequence[tuple[int, Values]]) -> None:
    """A point with its interval in each row, of method number i."""
    for place, (i, about) in enumerate(rows):
        if about["low"] is not None:
            axes.plot([about["low"], about["high"]], [-place, -place], color=colour(i), lw=1.2, solid_capstyle="butt")
        axes.plot(about["value"], -place, marker(i), color=colour(i), ms=4.5, mec=INK, mew=0.6, zorder=5)
    style_axes(axes)
    axes.set_yticks([])
    axes.set_ylim(0.6 - len(rows), 0.6)


def _curve(axes: Axes, i: int, curve: Curve) -> None:
    """A line of method number i, with its band."""
    at = [place for place, _ in curve]
    low, value, high = (
        [math.nan if about[name] is None else about[name] for _, about in curve] for name in ("low", "value", "high")
    )
    axes.fill_between(at, low, high, color=colour(i), alpha=0.15, lw=0)
    axes.plot(at, value, color=colour(i), ls=dash(i))


def _points(names: Iterable[str]) -> list[Line2D]:
    looks = {"ls": "none", "ms": 4.5, "mec": INK, "mew": 0.6}
    return [Line2D([], [], marker=marker(i), color=colour(i), label=name, **looks) for i, name in enumerate(names)]


def _lines(names: Iterable[str]) -> list[Line2D]:
    return [Line2D([], [], color=colour(i), ls=dash(i), label=name) for i, name in enumerate(names)]
