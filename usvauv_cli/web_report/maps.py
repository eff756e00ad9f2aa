"""Maps of a report: ways of AUVs and boats, and ages of data, with parallels, meridians and a scale bar where the
scenario has a place on Earth.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from usvauv.cli.web_report import document
from usvauv.cli.web_report.document import AGES, COLUMN, INK, LINE, MUTED, NODE, SEA, colour, dash
from usvauv.cli.web_report.episodes import Recording, collects_data
from usvauv.env.render.layout import nice, nice_above
from usvauv.env.render.style import Axes, Figure, Line2D, MaxNLocator
from usvauv.env.scenario import Scenario
from usvauv.env.site.place import LocalFrame
from usvauv.env.site.site import Site

STEPS = (1, 2, 4, 5, 10)  # none is more than twice the one before, so that two lines wanted are one at least
POINTS = 33  # of a line; parallels and meridians are curved on a plane
BAR = 0.28  # longest scale bar, of the width


def maps(names: Sequence[str], scenario: Scenario, handles: Sequence[Line2D]) -> tuple[Figure, list[Axes]]:
    """A map of the area for each name, side by side, and a legend of handles.

    Where the scenario has a place on Earth it is in longitude and latitude, with a scale bar.
    """
    columns = 1 if len(names) == 1 else 2 if len(names) <= 4 else 3
    rows = math.ceil(len(names) / columns)
    width, length = scenario.area.width, scenario.area.length
    side = min((COLUMN - 0.5) / columns - 0.1, 2.9)
    figure = document.new(rows * (min(max(side * length / width, 0.4), 2 * side) + 0.22) + 0.42, handles)
    frame = Site(scenario).frame
    across, along = ("longitude", "latitude") if frame else ("x (east), m", "y (north), m")
    plots = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    for i, (axes, name) in enumerate(zip(plots, names, strict=False)):
        axes.set_facecolor(SEA)
        axes.set(xlim=(0, width), ylim=(0, length), aspect="equal")
        axes.set_title(document.truncated(name, 46 // columns), loc="left", pad=3)
        if frame:
            draw_graticule(axes, frame, width, length, 2 if columns > 1 else 3)
        else:
            for axis in (axes.xaxis, axes.yaxis):
                axis.set_major_locator(MaxNLocator(3 if columns > 1 else 5))
        if i + columns >= len(names):
            axes.set_xlabel(across)
            axes.tick_params(labelbottom=True)
        if i % columns == 0:
            axes.set_ylabel(along)
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
    place = "node" if collects_data(scenario) else "station"
    ways.append(Line2D([], [], ls="none", marker="^", ms=3.5, color=NODE, label=place))
    figure, plots = maps(names, scenario, ways)
    for axes, recording in zip(plots, recordings, strict=True):
        episode = recording.episode
        axes.plot(*episode.node.T, "^", ms=2.4, color=NODE, mew=0)
        for k, track in reversed(list(enumerate(episode.tracks))):
            boat = k >= auvs
            look = INK if boat else colour(k)
            axes.plot(*track.T, color=look, lw=0.8, alpha=0.7 if boat else 1, ls="-" if boat else dash(k))
            axes.plot(*track[0], "o", ms=4, mfc="none", mec=look, mew=0.9, clip_on=False, zorder=5)
            axes.plot(*track[-1], "s", ms=3.6, color=look, clip_on=False, zorder=5)
    return figure


def ages(names: Sequence[str], recordings: Sequence[Recording], scenario: Scenario) -> Figure:
    """Mean age of the data of each node in world 0, older ones larger and stronger, a map for each combination."""
    edges = age_edges(np.concatenate([recording.episode.age for recording in recordings]))
    sizes = np.linspace(2.6, 7.5, len(AGES))
    digits = max(0, -math.floor(math.log10(edges[1] - edges[0])))
    looks = [{"ms": size, "color": ink, "mec": MUTED, "mew": 0.4} for size, ink in zip(sizes, AGES, strict=True)]
    marks = [
        Line2D([], [], ls="none", marker="o", label=f"{low:.{digits}f}–{high:.{digits}f} s", **look)
        for (low, high), look in zip(pairwise(edges), looks, strict=True)
    ]
    figure, plots = maps(names, scenario, marks)
    for axes, recording in zip(plots, recordings, strict=True):
        old = np.clip(np.searchsorted(edges, recording.episode.age) - 1, 0, len(AGES) - 1)
        for i, look in enumerate(looks):
            axes.plot(*recording.episode.node[old == i].T, "o", zorder=3 + i, **look)
    return figure


def age_edges(age: np.ndarray) -> np.ndarray:
    """Edges of as many equal classes as `AGES` that hold all ages, at whole multiples of a power of ten, s."""
    unit = 10.0 ** max(math.floor(math.log10(max(np.ptp(age), 1e-3))) - 1, -3)
    low = math.floor(age.min() / unit) * unit
    return low + np.arange(len(AGES) + 1) * math.ceil(max(age.max() - low, unit) / (len(AGES) * unit)) * unit


def draw_graticule(axes: Axes, frame: LocalFrame, width: float, length: float, lines: int) -> None:
    """Draw lines of equal longitude and latitude, about so many each way, ≥ 2, and a scale bar on a map of width ×
    length, m, with ticks in degrees.
    """
    x, y = np.meshgrid([0.0, width], [0.0, length])
    for across, degrees in zip((True, False), frame.to_geographic(x, y), strict=True):
        low, high = degrees.min(), degrees.max()
        step = nice_above((high - low) / lines, STEPS)
        values = step * np.arange(math.ceil(low / step), math.floor(high / step) + 1)
        places, shown = [], []
        for value in values:
            line = _line(frame, value, across, width, length)
            axes.plot(*line, color=LINE, lw=0.6, zorder=0.5)
            along, beside = line if across else line[::-1]
            place = float(np.interp(0.0, beside, along))
            if 0 <= place <= (width if across else length):
                places.append(place)
                shown.append(value)
        set_ticks = axes.set_xticks if across else axes.set_yticks
        set_ticks(places, degree_labels(shown, step, "EW" if across else "NS"))
    axes.set(xlim=(0, width), ylim=(0, length))
    _scale_bar(axes, width, length)


def degree_labels(values: Sequence[float], step: float, sides: str) -> list[str]:
    """Degrees with as many digits as a step needs and one of two sides; longitudes from 180° west to 180° east."""
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    turned = [(value + 180) % 360 - 180 if sides == "EW" else value for value in values]
    return [f"{abs(value):.{digits}f}°{sides[int(round(value, digits) < 0)]}" for value in turned]


def _line(
    frame: LocalFrame, value: float, meridian: bool, width: float, length: float
) -> tuple[np.ndarray, np.ndarray]:
    """x and y (POINTS,), m, of a meridian or a parallel through the area and a little beyond."""
    along = np.linspace(-0.05, 1.05, POINTS)
    x, y = (0.5 * width, along * length) if meridian else (along * width, 0.5 * length)
    longitude, latitude = frame.to_geographic(*np.broadcast_arrays(x, y))
    fixed = np.full(POINTS, value)
    return frame.to_local(fixed, latitude) if meridian else frame.to_local(longitude, fixed)


def _scale_bar(axes: Axes, width: float, length: float) -> None:
    bar, left, low = nice(BAR * width), 0.05 * width, 0.05 * length
    axes.plot([left, left + bar], [low, low], color=INK, lw=2, solid_capstyle="butt", zorder=8)
    text = f"{bar / 1000:g} km" if bar >= 1000 else f"{bar:g} m"
    axes.annotate(text, (left, low), (0, 2), textcoords="offset points", color=INK, va="bottom", fontsize=6, zorder=8)
