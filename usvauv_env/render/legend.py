"""The legend of a mission's map: each symbol with its words."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from usvauv.env.render import shapes, style
from usvauv.env.render.layout import Layout, Rectangle, draw_card
from usvauv.env.render.style import Colour, text_width, write
from usvauv.env.scenario import Scenario


class LegendSymbol(NamedTuple):
    """Draws symbols of the map at a place of a picture."""

    picture: np.ndarray
    at: np.ndarray
    layout: Layout

    def _line(self, points: Sequence[tuple[float, float]], ink: Colour, width: float = 1.3) -> None:
        """A line through points (N, 2) from the place, pixels of the design."""
        ends = self.at + np.array(points) * self.layout.unit
        shapes.stroke(self.picture, ends, ink, self.layout.px(width))

    def _rings(self, rings: tuple[tuple[float, float], ...], ink: Colour, width: float) -> None:
        """Rings of radii, each in a share of an ink."""
        for radius, share in rings:
            faded = style.mix(self.layout.theme.card, ink, share)
            shapes.ring(self.picture, self.at, radius * self.layout.unit, faded, self.layout.px(width))

    def _gauges(self, *gauges: tuple[float, float, float]) -> None:
        """Nodes beside each other: offset, how full, age."""
        sprites = shapes.NodeGauges(5.5 * self.layout.unit)
        for x, share, old in gauges:
            sprites.draw(self.picture, self.at + np.array([x, 0]) * self.layout.unit, share, old, pulse=0.6)

    def auv(self) -> None:
        shapes.auv(self.picture, self.at, 0.35, 22 * self.layout.unit, self.layout.theme.auv(0), self.layout.zoom)

    def boat(self) -> None:
        shapes.boat(self.picture, self.at, 0.35, 22 * self.layout.unit, self.layout.zoom)

    def goal(self) -> None:
        shapes.cross(self.picture, self.at, 4.5 * self.layout.unit, style.BOAT, self.layout.px(2))

    def ping(self) -> None:
        self._rings(((4, 0.7), (9, 0.35)), self.layout.theme.text, 1.3)

    def heard(self) -> None:
        theme = self.layout.theme
        self._line([(-12, 5), (12, -5)], style.mix(theme.card, theme.auv(0), 0.6), 1.2)

    def target(self) -> None:
        ends = self.at + np.array([(-11, 5), (11, -5)]) * self.layout.unit
        for piece in shapes.dashes(ends[0], ends[1], 4 * self.layout.unit):
            shapes.stroke(self.picture, piece, self.layout.theme.auv(0), self.layout.px(1.3))

    def next(self) -> None:
        points, theme = [(-12, 5), (-3, -4), (5, 5), (13, -3)], self.layout.theme
        for place, share in enumerate((0.4, 0.6, 0.75)):
            self._line(points[place : place + 2], style.mix(theme.auv(0), theme.card, share))

    def age(self) -> None:
        self._gauges((-13, 0.25, 0.0), (0, 0.25, 0.5), (13, 0.25, 1.0))

    def node(self) -> None:
        self._gauges((-13, 0.12, 0.0), (0, 0.5, 0.0), (13, 0.85, 0.0))

    def full(self) -> None:
        self._gauges((0, 1.0, 0.0))

    def station(self) -> None:
        shapes.station(self.picture, self.at, 6.5 * self.layout.unit, self.layout.theme.auv(0), self.layout.zoom)

    def service(self) -> None:
        unit, colour = self.layout.unit, self.layout.theme.auv(0)
        shapes.progress_ring(self.picture, self.at, 8 * unit, 0.65, colour, 2.8 * unit, self.layout.zoom)

    def fix(self) -> None:
        unit, ink, aside = self.layout.unit, self.layout.theme.text, np.array([7, 0]) * self.layout.unit
        shapes.plus(self.picture, self.at - aside, 4.5 * unit, ink, self.layout.px(1))
        shapes.fix(self.picture, self.at + aside, 4.5 * unit, ink, 1.5 * unit, self.layout.zoom)

    def ellipse(self) -> None:
        axes = np.array([(11.0, -3.0), (1.5, 5.0)]) * self.layout.unit
        outline = shapes.ellipse_points(self.at, axes)
        shapes.stroke(self.picture, outline, self.layout.theme.text, self.layout.px(1.2), closed=True)

    def current(self) -> None:
        for y, length in ((-4, 11), (4, 6)):
            self._line([(-length, y), (0, y)], self.layout.theme.line, 1.5)
            self._line([(0, y), (length, y)], self.layout.theme.muted, 1.5)

    def foreseen(self) -> None:
        unit, colour = self.layout.unit, self.layout.theme.auv(0)
        shapes.foreseen(self.picture, self.at, 5 * unit, colour, 1.5 * unit, self.layout.zoom)

    def field(self) -> None:
        self._rings(((3, 0.8), (6, 0.55), (9, 0.3)), self.layout.theme.muted, 1.2)


Entry = tuple[Callable[[LegendSymbol], None], str]
AUV: Entry = LegendSymbol.auv, "underwater vehicle (AUV), last 2 min"
BOAT: Entry = LegendSymbol.boat, "boat (USV): finds the AUVs by sound"
PING: Entry = LegendSymbol.ping, "ring: the boat asks where they are"
HEARD: Entry = LegendSymbol.heard, "line from the boat: an AUV it heard"
GOAL: Entry = LegendSymbol.goal, "where the boat plans to go"
FIX: Entry = LegendSymbol.fix, "true place of an AUV, and estimated"
ELLIPSE: Entry = LegendSymbol.ellipse, "2-σ ellipse: 86 % of errors expected"
CURRENT: Entry = LegendSymbol.current, "drifting streaks: water current"
TO_NODE: Entry = LegendSymbol.target, "way to the sensor node it heads for"
TO_STATION: Entry = LegendSymbol.target, "way back to its station"
NEXT: Entry = LegendSymbol.next, "its way to the next three nodes"
NODE: Entry = LegendSymbol.node, "sensor nodes: how full with data"
FULL: Entry = LegendSymbol.full, "full: new data is being lost"
SERVICE: Entry = LegendSymbol.service, "AUV hovers and takes over data"
IN_PASSING: Entry = LegendSymbol.service, "AUV in range takes over data"
AGE: Entry = LegendSymbol.age, "white ring: last visited 5 min ago"
STATION: Entry = LegendSymbol.station, "station that it holds"
ENTRIES = AUV, BOAT, PING, HEARD, TO_NODE, GOAL, NEXT, FIX, NODE, ELLIPSE, FULL, SERVICE, AGE, CURRENT
STATION_ENTRIES = AUV, BOAT, PING, HEARD, TO_STATION, GOAL, CURRENT, FIX, STATION, ELLIPSE
FORESIGHT: tuple[Entry, ...] = (
    (LegendSymbol.foreseen, "where the boat foresees an AUV"),
    (LegendSymbol.field, "lines: what the boat would learn there"),
)

ON_MAP = replace(style.DARK, card=style.SEA[1])
"""Colours of symbols: those of the map, on a stripe of water."""

ABBREVIATIONS = "SDR: data rates of all services, added up · EC: an AUV's energy per second of travel"


def draw_legend(
    picture: np.ndarray, box: Rectangle, layout: Layout, scenario: Scenario, foresees: bool, from_above: bool = True
) -> None:
    """Symbols and words in one column or two, and what the abbreviations stand for.

    Args:
        foresees: the boat foresees AUVs. from_above: the picture is a map, which shows the current.
    """
    draw_card(picture, box, layout)
    unit, size = layout.unit, 11 * layout.unit
    task, passing = scenario.task, scenario.nodes.service == "passing"
    entries = (ENTRIES if task == "data-collection" else STATION_ENTRIES) + FORESIGHT * foresees
    entries = [entry for entry in entries if from_above or entry is not CURRENT]
    entries = [IN_PASSING if passing and entry is SERVICE else entry for entry in entries]
    widest = max(text_width(words, size) for _, words in entries)
    columns = 2 if box.width >= 500 * unit else 1
    rows = -(-len(entries) // columns)
    size *= min(1.0, (box.width / columns - 48 * unit) / widest)
    meaning = ABBREVIATIONS if task == "data-collection" else ABBREVIATIONS.split(" · ")[1]
    if text_width(meaning, size) <= box.width - 16 * unit:
        write(picture, meaning, (box.left + 8 * unit, box.bottom - 5 * unit), size, layout.theme.muted)
        box = box._replace(height=box.height - round(16 * unit))
    box = box._replace(top=box.top + round(3 * unit), height=box.height - round(6 * unit))
    on_map = replace(layout, theme=ON_MAP)
    for column in range(columns):
        left = round(box.left + column * box.width / columns)
        draw_card(picture, Rectangle(left, box.top, round(40 * unit), box.height), on_map)
    for place, (symbol, words) in enumerate(entries):
        left = box.left + (place % columns) * box.width / columns
        middle = box.top + (place // columns + 0.5) * box.height / rows
        symbol(LegendSymbol(picture, np.array([left + 20 * unit, middle]), on_map))
        write(picture, words, (left + 45 * unit, middle + 0.36 * size), size, layout.theme.text)
