"""Figure of `usvauv plan`: objective over the area, AUVs, places of the boat, error ellipses."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from usvauv.cli import terminal
from usvauv.env.accuracy.boat_place import OBJECTIVE_NAMES, BoatPlace, Landscape, Plan
from usvauv.env.render import figures, style
from usvauv.env.render.figures import SEA_COLOURS, save_figure, style_axes
from usvauv.env.render.style import CATEGORICAL, ON_DARK, web

TEXT, MUTED, OUTLINE = ON_DARK.text, ON_DARK.muted, web(style.OUTLINE)
SIGMAS = 2
LONGEST_NAME = 10  # characters
# Upper bounds on a drawn semi-major axis over the shorter side of the area: from the optimum, from any place.
LARGEST_BEST, LARGEST = 0.12, 0.25
FACTORS = (1.05, 1.1, 1.25, 1.5, 2, 3, 5, 10, 20, 50)
LINES = {  # meaning of the contour lines, by objective
    "d": "Error, geometric mean",
    "a": "Error, rms",
    "sum": "By noise and attitude: error of a common offset",
}
HEADING_OUTDENT = 55  # of the legend's headings, pixels
MAP = 6.0  # longer side of the map, inches
LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"


def magnification(result: Plan) -> float:
    """Factor by which error ellipses are drawn larger: the largest of ..., 1, 2, 3, 5, 10, ... at which they fit."""
    best = max((error.major for error in result.optimum.errors if error.located and error.major), default=1.0)
    errors = [error for place in (result.optimum, *result.compare) for error in place.errors]
    worst = max((error.major for error in errors if error.located and error.major), default=1.0)
    side = min(result.area["width"], result.area["length"])
    room = min(LARGEST_BEST / best, LARGEST / worst) * side / SIGMAS
    decade = 10.0 ** math.floor(math.log10(room))
    return decade * max(step for step in (1, 2, 3, 5) if step * decade <= room)


def metres(value: float | None) -> str:
    """A length in m to three digits, without an exponent; ∞ for an unbounded one."""
    if value is None:
        return "∞"
    return f"{value:.3g}" if value < 1000 else f"{value:.0f}"


def error_of(place: BoatPlace, objective: str) -> str:
    """Error from a place as its objective measures it, and of how many AUVs where not all are located."""
    if not place.located:
        return "no fixes"
    count = len(place.errors)
    error = metres(place.mean if objective == "d" else place.rms)
    return f"{error} m" + (f", {place.located} of {count} AUVs" if place.located < count else "")


def look(i: int) -> tuple[str, str]:
    """Letter and colour of compared place number `i`."""
    return LETTERS[i % len(LETTERS)], CATEGORICAL[i % len(CATEGORICAL)]


@figures.plain()
def draw(result: Plan, landscape: Landscape, path: Path) -> None:
    """Draw the result of a plan and save it, the format by the file's suffix."""
    width, length = result.area["width"], result.area["length"]
    # Inches: the map within 6 × 6; beside it colour bar and legend, whose rows set the least height; above, the title.
    across, along = (MAP * side / max(width, length) for side in (width, length))
    across = max(across, 1.0)
    rows = 8 + len(result.auvs) + len(result.compare)
    below = max(along, 0.21 * rows) - along
    width_in, height_in = across + 5.2, along + below + 1.75
    figure = figures.Figure(figsize=(width_in, height_in), facecolor=ON_DARK.background)

    def at(x: float, y: float) -> tuple[float, float]:
        return x / width_in, y / height_in

    axes = figure.add_axes((*at(0.8, 0.65 + below), *at(across, along)))
    bar = figure.add_axes((*at(1.0 + across, 0.65 + below), *at(0.15, along)))
    draw_landscape(result, landscape, axes, bar)
    scale = draw_places(result, axes)
    draw_legend(result, scale, figure, at(1.85 + across, 0.78 + below + along))
    best = result.optimum
    title = f"Best place for the boat: ({best.x:.1f}, {best.y:.1f}) m"
    about = f"{result.scenario} · objective {result.objective} · measurement {result.measurement}"
    if result.slope != (0, 0):
        about += f" · errors on a slope of {result.slope[0]:g}, {result.slope[1]:g}"
    left, top = at(0.8, height_in - 0.45)
    figure.text(left, top, title, color=TEXT, fontsize=15, fontweight="bold")
    figure.text(left, at(0.8, height_in - 0.72)[1], about, color=MUTED, fontsize=10)
    save_figure(figure, path)


def draw_landscape(result: Plan, landscape: Landscape, axes: figures.Axes, bar: figures.Axes) -> None:
    """Draw ln of the objective as filled contours, and lines where the error is a given multiple of the best.

    Objective A has the unit m⁻²: the error is proportional to its power −1/2. Determinants have it once for
    each axis of each error ellipse in them: the geometric mean of the error over those axes is proportional to the
    power −1/(2 · axes). The paper's Eq. 3 as printed is no determinant of information and has no lines.
    """
    x, y, value = landscape
    value = np.where(np.isfinite(value), value, value[np.isfinite(value)].min(initial=0.0)).astype(np.float64)
    best = value.max() if result.optimum.log_objective is None else result.optimum.log_objective
    low, high = np.percentile(value, 0.5), max(value.max(), best)
    filled = axes.contourf(x, y, value, levels=np.linspace(low, high + 1e-3, 41), cmap=SEA_COLOURS, extend="min")
    filled.set_edgecolor("face")  # without it PDF and SVG show thin gaps between the bands
    ellipse_axes = {"d": 2 * len(result.auvs), "sum": 2}.get(result.objective, 1)
    levels = {best - 2 * ellipse_axes * math.log(factor): factor for factor in FACTORS}
    drawn = sorted(level for level in levels if value.min() < level < value.max())
    if drawn and result.objective in LINES:
        lines = axes.contour(x, y, value, levels=drawn, colors=TEXT, linewidths=0.7, linestyles="solid", alpha=0.65)
        labels = axes.clabel(lines, fmt={level: f"×{factor:g}" for level, factor in levels.items()}, fontsize=8)
        for label in labels:
            label.set(color=TEXT, path_effects=[figures.withStroke(linewidth=2, foreground=OUTLINE)])
    axes.set(xlim=(0, x[-1]), ylim=(0, y[-1]), aspect="equal")
    shades = figures.ScalarMappable(figures.Normalize(low, high), SEA_COLOURS)
    ticks = max(1, round(7 * min(1.0, y[-1] / x[-1])))
    scale = axes.figure.colorbar(shades, cax=bar, ticks=figures.MaxNLocator(ticks))
    scale.outline.set_visible(False)
    bar.set_title(OBJECTIVE_NAMES[result.objective], color=MUTED, fontsize=9.5, loc="left", pad=8)
    style_axes(axes, tick_pad=9)
    style_axes(bar, tick_pad=4)
    axes.set_xlabel("x (east), m", fontsize=10)
    axes.set_ylabel("y (north), m", fontsize=10)


def draw_places(result: Plan, axes: figures.Axes) -> float:
    """Draw AUVs, error ellipses of those located from the optimum and from each compared place, and the places.

    Returns:
        The magnification of the ellipses.
    """
    best, others, centroid = result.optimum, result.compare, result.centroid
    scale = magnification(result)
    shadow: list[figures.AbstractPathEffect] = [figures.withStroke(linewidth=3, foreground=OUTLINE)]
    for place, colour, dash in [
        (best, TEXT, "-"),
        *((p, look(i)[1], (0, (4, 2))) for i, p in enumerate(others)),
    ]:
        for auv, error in zip(result.auvs, place.errors, strict=True):
            if not error.located or error.major is None or error.minor is None or error.angle is None:
                continue
            size = [2 * SIGMAS * scale * axis for axis in (error.major, error.minor)]
            ellipse = figures.Ellipse((auv.x, auv.y), *size, angle=math.degrees(error.angle), fill=False)
            ellipse.set(edgecolor=colour, linestyle=dash, linewidth=1.5, zorder=4)
            if place is best:
                ellipse.set_path_effects(shadow)
            axes.add_patch(ellipse)
    above = {"clip_on": False, "mec": OUTLINE}
    names = terminal.shortened([auv.name for auv in result.auvs], LONGEST_NAME)
    for k, auv in enumerate(result.auvs):
        colour = web(style.auv_colour(k))
        axes.plot(auv.x, auv.y, "o", ms=7, mfc=colour, mew=1, zorder=5, **above)
        label = axes.annotate(names[auv.name], (auv.x, auv.y), (6, 6), textcoords="offset points", zorder=6)
        label.set(parse_math=False, color=colour, fontsize=11, fontweight="bold", path_effects=shadow)
    for i, place in enumerate(others):
        letter, colour = look(i)
        axes.plot(place.x, place.y, "s", ms=13, mfc=colour, mew=1.2, zorder=7, **above)
        text = axes.annotate(letter, (place.x, place.y), ha="center", va="center_baseline", zorder=8)
        text.set(color=OUTLINE, fontsize=8, fontweight="bold")
    axes.plot(centroid.x, centroid.y, "+", ms=12, mew=2, color=TEXT, path_effects=shadow, zorder=8)
    axes.plot(best.x, best.y, "*", ms=20, mfc=TEXT, mew=1.2, zorder=9, **above)
    return scale


def draw_legend(result: Plan, scale: float, figure: figures.Figure, corner: tuple[float, float]) -> None:
    """Draw the legend: places with their error, AUVs with their error from the optimum, lines."""

    def mark(marker: str, colour: str, size: float) -> figures.Line2D:
        edge = (TEXT, 2) if marker == "+" else (OUTLINE, 1)
        return figures.Line2D([], [], marker=marker, ls="none", ms=size, mfc=colour, mec=edge[0], mew=edge[1])

    def line(colour: str, dashes: str, width: float = 1.5) -> figures.Line2D:
        return figures.Line2D([], [], color=colour, ls=dashes, lw=width)

    def heading(text: str) -> tuple[figures.Line2D, str]:
        return line("none", "none"), text

    best, centroid, objective = result.optimum, result.centroid, result.objective
    entries = [
        heading("Boat: error of a fix, " + ("geometric mean" if objective == "d" else "rms")),
        (mark("*", TEXT, 15), f"optimum   {error_of(best, objective)}"),
        (mark("+", TEXT, 9), f"centroid   {error_of(centroid, objective)}"),
    ]
    for i, place in enumerate(result.compare):
        letter, colour = look(i)
        entries.append((mark("s", colour, 9), f"{letter} ({place.x:g}, {place.y:g})   {error_of(place, objective)}"))
    entries.append(heading("AUV: 1-σ from the optimum"))
    names = terminal.shortened([auv.name for auv in result.auvs], LONGEST_NAME)
    for k, (auv, error) in enumerate(zip(result.auvs, best.errors, strict=True)):
        size = f"{metres(error.major)} × {metres(error.minor)} m" if error.located else f"{error.good:.0%} good"
        text = f"{names[auv.name]}, {auv.depth:g} m deep   {size}"
        entries.append((mark("o", web(style.auv_colour(k)), 7), text))
    entries.append(heading(f"{SIGMAS}-σ ellipses, drawn × {scale:g}"))
    entries.append((line(TEXT, "-"), "from the optimum"))
    if result.compare:
        letters = [look(i)[0] for i in range(len(result.compare))]
        text = "from " + ", ".join(letters) + (", each in its colour" if len(letters) > 1 else "")
        entries.append((line(look(0)[1], "--"), text))
    if objective in LINES:
        entries.append(heading(LINES[objective]))
        entries.append((line(TEXT, "-", 0.7), "as a multiple of the best"))
    handles, texts = zip(*entries, strict=True)
    legend = figure.legend(
        handles, texts, loc="upper left", bbox_to_anchor=corner, frameon=False, labelcolor=TEXT, fontsize=9.5
    )
    for handle, text in zip(handles, legend.get_texts(), strict=True):
        text.set_parse_math(False)
        if handle.get_color() == "none":
            text.set(color=MUTED, x=-HEADING_OUTDENT)
