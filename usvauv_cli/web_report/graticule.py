"""Parallels, meridians and a scale bar on a map of a scenario that has a place on Earth."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from usvauv.cli.web_report.document import INK, LINE
from usvauv.env.render.layout import nice, nice_above
from usvauv.env.render.style import Axes
from usvauv.env.site.place import LocalFrame

STEPS = (1, 2, 4, 5, 10)  # none is more than twice the one before, so that two lines wanted are one at least
POINTS = 33  # of a line; parallels and meridians are curved on a plane
BAR = 0.28  # longest scale bar, of the width


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
