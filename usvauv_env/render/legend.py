"""Legend of the video: each symbol and its meaning, without terms that the paper introduces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from usvauv.env.render import shapes, style, symbols
from usvauv.env.render.frame_layout import Layout, Rectangle
from usvauv.env.render.panel_elements import draw_card
from usvauv.env.render.text import shorten, text_width, write

Symbol = Callable[[np.ndarray, np.ndarray, Layout], None]


def _auv(picture: np.ndarray, at: np.ndarray, layout: Layout) -> None:
    symbols.auv(picture, at, 0.35, 22 * layout.unit, layout.theme.auv(0), layout.zoom)


def _boat(picture: np.ndarray, at: np.ndarray, layout: Layout) -> None:
    symbols.boat(picture, at, 0.35, 22 * layout.unit, layout.zoom)


def _goal(picture: np.ndarray, at: np.ndarray, layout: Layout) -> None:
    symbols.cross(picture, at, 4.5 * layout.unit, style.BOAT, layout.px(2))


def _ping(picture: np.ndarray, at: np.ndarray, layout: Layout) -> None:
    for radius, share in ((4, 0.7), (9, 0.35)):
        ink = style.mix(layout.theme.card, layout.theme.text, share)
        shapes.ring(picture, at, radius * layout.unit, ink, layout.px(1.3))


def _heard(picture: np.ndarray, at: np.ndarray, layout: Layout) -> None:
    ends = at + np.array([(-12, 5), (12, -5)]) * layout.unit
    shapes.stroke(picture, ends, style.mix(layout.theme.card, layout.theme.auv(0), 0.6), layout.px(1.2))


def _target(picture: np.ndarray, at: np.ndarray, layout: Layout) -> None:
    ends = at + np.array([(-11, 5), (11, -5)]) * layout.unit
    for piece in shapes.dashes(ends[0], ends[1], 4 * layout.unit):
        shapes.stroke(picture, piece, layout.theme.auv(0), layout.px(1.3))


def _next(picture: np.ndarray, at: np.ndarray, layout: Layout) -> None:
    points = at + np.array([(-12, 5), (-3, -4), (5, 5), (13, -3)]) * layout.unit
    for place, share in enumerate((0.4, 0.6, 0.75)):
        ink = style.mix(layout.theme.auv(0), layout.theme.card, share)
        shapes.stroke(picture, points[place : place + 2], ink, layout.px(1.3))


def _age(picture: np.ndarray, at: np.ndarray, layout: Layout) -> None:
    gauges = symbols.NodeGauges(5.5 * layout.unit)
    for x, age in ((-13, 0.0), (0, 0.5), (13, 1.0)):
        gauges.draw(picture, at + (np.array([x, 0]) * layout.unit), 0.25, age)


def _node(picture: np.ndarray, at: np.ndarray, layout: Layout) -> None:
    gauges = symbols.NodeGauges(5.5 * layout.unit)
    for x, share in ((-13, 0.12), (0, 0.5), (13, 0.85)):
        gauges.draw(picture, at + (np.array([x, 0]) * layout.unit), share)


def _station(picture: np.ndarray, at: np.ndarray, layout: Layout) -> None:
    symbols.station(picture, at, 6.5 * layout.unit, layout.theme.auv(0), layout.zoom)


def _full(picture: np.ndarray, at: np.ndarray, layout: Layout) -> None:
    symbols.NodeGauges(5.5 * layout.unit).draw(picture, at, 1.0, pulse=0.6)


def _service(picture: np.ndarray, at: np.ndarray, layout: Layout) -> None:
    symbols.progress_ring(picture, at, 8 * layout.unit, 0.65, layout.theme.auv(0), 2.8 * layout.unit, layout.zoom)


def _fix(picture: np.ndarray, at: np.ndarray, layout: Layout) -> None:
    symbols.plus(picture, at + np.array([-7, 0]) * layout.unit, 4.5 * layout.unit, layout.theme.text, layout.px(1))
    symbols.fix(
        picture,
        at + np.array([7, 0]) * layout.unit,
        4.5 * layout.unit,
        layout.theme.text,
        1.5 * layout.unit,
        layout.zoom,
    )


def _ellipse(picture: np.ndarray, at: np.ndarray, layout: Layout) -> None:
    axes = np.array([(11.0, -3.0), (1.5, 5.0)]) * layout.unit
    shapes.stroke(picture, shapes.ellipse_points(at, axes), layout.theme.text, layout.px(1.2), closed=True)


def _current(picture: np.ndarray, at: np.ndarray, layout: Layout) -> None:
    for y, length in ((-4, 11), (4, 6)):
        ends = at + np.array([(-length, y), (0, y), (length, y)]) * layout.unit
        shapes.stroke(picture, ends[:2], layout.theme.line, layout.px(1.5))
        shapes.stroke(picture, ends[1:], layout.theme.muted, layout.px(1.5))


def _foreseen(picture: np.ndarray, at: np.ndarray, layout: Layout) -> None:
    symbols.foreseen(picture, at, 5 * layout.unit, layout.theme.auv(0), 1.5 * layout.unit, layout.zoom)


def _field(picture: np.ndarray, at: np.ndarray, layout: Layout) -> None:
    for radius, share in ((3, 0.8), (6, 0.55), (9, 0.3)):
        shapes.ring(
            picture, at, radius * layout.unit, style.mix(layout.theme.card, layout.theme.muted, share), layout.px(1.2)
        )


ENTRIES: tuple[tuple[Symbol, str], ...] = (
    (_auv, "underwater vehicle (AUV), last 2 min"),
    (_boat, "boat (USV): finds the AUVs by sound"),
    (_ping, "ring: the boat asks where they are"),
    (_heard, "line from the boat: an AUV it heard"),
    (_target, "way to the sensor node it heads for"),
    (_goal, "where the boat plans to go"),
    (_next, "its way to the next three nodes"),
    (_fix, "true place of an AUV, and estimated"),
    (_node, "sensor nodes: how full with data"),
    (_ellipse, "2-σ ellipse: 86 % of errors expected"),
    (_full, "full: new data is being lost"),
    (_service, "AUV hovers and takes over data"),
    (_age, "white ring: last visited 5 min ago"),
    (_current, "drifting streaks: water current"),
)

STATION_ENTRIES: tuple[tuple[Symbol, str], ...] = (
    (_auv, "underwater vehicle (AUV), last 2 min"),
    (_boat, "boat (USV): finds the AUVs by sound"),
    (_ping, "ring: the boat asks where they are"),
    (_heard, "line from the boat: an AUV it heard"),
    (_target, "way back to its station"),
    (_goal, "where the boat plans to go"),
    (_current, "drifting streaks: water current"),
    (_fix, "true place of an AUV, and estimated"),
    (_station, "station that it holds"),
    (_ellipse, "2-σ ellipse: 86 % of errors expected"),
)

FORESIGHT: tuple[tuple[Symbol, str], ...] = (
    (_foreseen, "where the boat foresees an AUV"),
    (_field, "lines: what the boat would learn there"),
)

ON_MAP = replace(style.DARK, card=style.SEA[1])
"""Colours of symbols: those of the map, on a stripe of water."""

ABBREVIATIONS = "SDR: data rates of all services, added up · EC: an AUV's energy per second of travel"


def draw_legend(picture: np.ndarray, box: Rectangle, layout: Layout, task: str, foresees: bool) -> None:
    """Two columns of symbols and words, and what the abbreviations stand for; `foresees`: the boat foresees AUVs."""
    draw_card(picture, box, layout)
    unit, size = layout.unit, 11 * layout.unit
    entries = (ENTRIES if task == "data-collection" else STATION_ENTRIES) + FORESIGHT * foresees
    rows, widest = len(entries) // 2, max(text_width(words, size) for _, words in entries)
    size *= min(1.0, (box.width / 2 - 48 * unit) / widest)
    position = box.left + 8 * unit, box.bottom - 5 * unit
    meaning = ABBREVIATIONS if task == "data-collection" else ABBREVIATIONS.split(" · ")[1]
    write(picture, shorten(meaning, size, box.width - 16 * unit), position, size, layout.theme.muted)
    box = box._replace(top=box.top + round(3 * unit), height=box.height - round(22 * unit))
    on_map = replace(layout, theme=ON_MAP)
    for column in range(2):
        left = round(box.left + column * box.width / 2)
        draw_card(picture, Rectangle(left, box.top, round(40 * unit), box.height), on_map)
    for place, (symbol, words) in enumerate(entries):
        left = box.left + (place % 2) * box.width / 2
        middle = box.top + (place // 2 + 0.5) * box.height / rows
        symbol(picture, np.array([left + 20 * unit, middle]), on_map)
        write(picture, words, (left + 43 * unit, middle + 0.36 * size), size, layout.theme.text)
