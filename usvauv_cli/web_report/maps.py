"""Maps of a report: ways of AUVs and boats."""

from __future__ import annotations

import math
from collections.abc import Sequence

from usvauv.cli.web_report import document
from usvauv.cli.web_report.document import COLUMN, INK, NODE, SEA, colour, dash
from usvauv.cli.web_report.episodes import Recording, part_shown
from usvauv.env.render.figures import Axes, Figure, Line2D, MaxNLocator
from usvauv.env.scenario import Scenario


def maps(
    names: Sequence[str], part: tuple[float, float, float, float], handles: Sequence[Line2D]
) -> tuple[Figure, list[Axes]]:
    """A map of a part of the area (`part_shown`) for each name, side by side, and a legend of handles."""
    columns = min(len(names), 2)
    rows = math.ceil(len(names) / columns)
    west, south, width, length = part
    side = min((COLUMN - 0.5) / columns - 0.1, 2.9)
    figure = document.new(rows * (min(max(side * length / width, 0.4), 2 * side) + 0.22) + 0.42, handles)
    plots = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    for i, (axes, name) in enumerate(zip(plots, names, strict=False)):
        axes.set_facecolor(SEA)
        axes.set(xlim=(west, west + width), ylim=(south, south + length), aspect="equal")
        document.name_axes(axes, name, columns)
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(MaxNLocator(3 if columns > 1 else 5))
        if i + columns >= len(names):
            axes.set_xlabel("x (east), m")
            axes.tick_params(labelbottom=True)
        if i % columns == 0:
            axes.set_ylabel("y (north), m")
        document.style_axes(axes, grid=False)
    for axes in plots[len(names) :]:
        axes.set_visible(False)
    return figure, list(plots[: len(names)])


def trajectories(names: Sequence[str], recordings: Sequence[Recording], scenario: Scenario) -> Figure:
    """Ways of AUVs and boats in world 0, a map for each combination."""
    auvs = recordings[0].episode.auvs
    ways = [Line2D([], [], color=colour(k), ls=dash(k), lw=1, label=f"AUV {k + 1}") for k in range(auvs)]
    ways.append(Line2D([], [], color=INK, lw=0.9, alpha=0.7, label="boat"))
    points = (("o", "none", "start"), ("s", INK, "end"))
    ways += [Line2D([], [], ls="none", marker=m, ms=4, mec=INK, mfc=f, label=name) for m, f, name in points]
    places = {"nodes": "node", "auvs": "station", "moving": "target, at the end"}
    place = places[scenario.task_definition.targets]
    ways.append(Line2D([], [], ls="none", marker="^", ms=3.5, color=NODE, label=place))
    part = part_shown(scenario, [recording.episode for recording in recordings])
    figure, plots = maps(names, part, ways)
    for axes, recording in zip(plots, recordings, strict=True):
        episode = recording.episode
        axes.plot(*episode.node.T, "^", ms=2.4, color=NODE, mew=0)
        for way in episode.targets:
            axes.plot(*way.T, color=NODE, lw=0.7)
        for k, track in reversed(list(enumerate(episode.tracks))):
            boat = k >= auvs
            look = INK if boat else colour(k)
            axes.plot(*track.T, color=look, lw=0.8, alpha=0.7 if boat else 1, ls="-" if boat else dash(k))
            axes.plot(*track[0], "o", ms=4, mfc="none", mec=look, mew=0.9, clip_on=False, zorder=5)
            axes.plot(*track[-1], "s", ms=3.6, color=look, clip_on=False, zorder=5)
    return figure
