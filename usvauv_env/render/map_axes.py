"""Still parts around the map: axes in metres, scale bar, directions, colour scale, speed scale."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from usvauv.env.render import shapes
from usvauv.env.render.frame_layout import Layout, MapView, nice, nice_above
from usvauv.env.render.sea_layers import CurrentStreaks, SeaSurface, colour_scale
from usvauv.env.render.text import text_width, write
from usvauv.env.scenario import Scenario
from usvauv.env.scenario.sea import Area


class Scene(Protocol):
    """A map: metres to pixels, and the layers whose scales are drawn above it."""

    view: MapView
    surface: SeaSurface
    streaks: CurrentStreaks


def draw_map_axes(picture: np.ndarray, scene: Scene, layout: Layout, area: Area, note: str) -> None:
    """Draw axes and scales on a picture, and a note below the map if there is room."""
    unit, box = layout.unit, layout.map
    corners = [(0, 0), (area.width, 0), (area.width, area.length), (0, area.length)]
    frame = scene.view.pixel(np.array(corners, float)) + np.array([(-1, 1), (1, 1), (1, -1), (-1, -1)]) * unit
    shapes.stroke(picture, frame, layout.theme.line, layout.px(1.5), closed=True)
    size, spacing = 11 * unit, nice_above(max(area.width, area.length) / 5)
    for x in np.arange(0, area.width * 1.0001, spacing):
        at = scene.view.pixel(np.array([x, 0]))[0]
        shapes.stroke(picture, np.array([(at, box.bottom + unit), (at, box.bottom + 5 * unit)]), layout.theme.muted)
        write(picture, f"{x:g}", (at, box.bottom + 17 * unit), size, layout.theme.muted, anchor="centre")
    for y in np.arange(0, area.length * 1.0001, spacing):
        at = scene.view.pixel(np.array([0, y]))[1]
        shapes.stroke(picture, np.array([(box.left - unit, at), (box.left - 5 * unit, at)]), layout.theme.muted)
        write(picture, f"{y:g}", (box.left - 8 * unit, at + 0.36 * size), size, layout.theme.muted, anchor="right")
    below = box.bottom + 32 * unit
    east = "metres east →"
    write(picture, east, (box.right, below), size, layout.theme.muted, anchor="right")
    room = box.width - text_width(east, size) - _scale_bar(picture, scene, layout, below) - 30 * unit
    if text_width(note, size) < room:
        position = box.right - text_width(east, size) - 15 * unit, below
        write(picture, note, position, size, layout.theme.muted, anchor="right")
    free = box.left - 8 * unit, _scales(picture, scene, layout)
    if text_width("metres north ↑", size) + 12 * unit < free[1] - free[0]:
        write(picture, "metres north ↑", (free[0], box.top - 8 * unit), size, layout.theme.muted)


def view_note(scenario: Scenario) -> str:
    """Point of view, and the depth of the AUVs."""
    return f"seen from above, AUVs {scenario.auv.depth:g} m below the boat"


def _scale_bar(picture: np.ndarray, scene: Scene, layout: Layout, below: float) -> float:
    """Draw a scale bar at the left; returns its width including the text, pixels."""
    unit, box = layout.unit, layout.map
    length = nice(0.25 * box.width / scene.view.per_metre)
    bar = length * scene.view.per_metre
    left, level = box.left, below - 4 * unit
    ends = np.array([(left, level - 4 * unit), (left, level), (left + bar, level), (left + bar, level - 4 * unit)])
    shapes.stroke(picture, ends, layout.theme.text, layout.px(1.5))
    text = f"{length:g} m"
    write(picture, text, (left + bar + 8 * unit, below), 11 * unit, layout.theme.text)
    return bar + 8 * unit + text_width(text, 11 * unit)


def _scales(picture: np.ndarray, scene: Scene, layout: Layout) -> float:
    """Draw colour scale and, where there is room, speed scale above the map; returns their left end, pixels."""
    unit, size = layout.unit, 11 * layout.unit
    right, line = layout.map.right, layout.map.top - 8 * unit

    def words(text: str, gap: float) -> None:
        nonlocal right
        write(picture, text, (right, line), size, layout.theme.muted, anchor="right")
        right -= text_width(text, size) + round(gap * unit)

    limit, streaks = scene.surface.limit, scene.streaks
    if limit:
        words(f"+{limit:g} m", 6)
        width, height = round(90 * unit), round(9 * unit)
        top = round(line - height)
        picture[top : top + height, right - width : right] = colour_scale(width, height)
        right -= width + round(6 * unit)
    words(f"sea surface  −{limit:g}" if limit else "flat sea", 18)
    if streaks.fastest == 0.0:
        words("no current", 0)
        return right
    speed = nice(streaks.fastest)
    tail, middle = speed * streaks.tail * scene.view.per_metre, line - 4 * unit
    text = f"current {speed:g} m/s"
    if right - text_width(text, size) - 6 * unit - tail < layout.left:
        return right
    words(text, 6)
    shapes.stroke(picture, np.array([(right - tail, middle), (right, middle)]), layout.theme.muted, layout.px(1.5))
    shapes.stroke(picture, np.array([(right - tail / 2, middle), (right, middle)]), layout.theme.text, layout.px(1.5))
    return right - tail
