"""The legend of a mission's picture: symbols of what is drawn at present, with a word or two."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from usvauv.env.render import style
from usvauv.env.render.layout import Layout, Rectangle, draw_card
from usvauv.env.render.mission import HEARD_STEPS, Playback, error_axes, step_of
from usvauv.env.render.shapes import LegendSymbol
from usvauv.env.render.style import text_width, write

LETTERS, LEAST_ROW = 17.0, 24.0  # size of letters at most, and least distance of lines, pixels of the design
LATELY = 150  # frames for which an entry stays after what it names was last drawn
ON_MAP = replace(style.DARK, card=style.SEA[1])
"""Colours of symbols: those of the map, on a stripe of water."""

ABBREVIATIONS = "SDR: data rates of all services, added up · EC: an AUV's energy per second of travel"


class Entry(NamedTuple):
    """A symbol, what it says, and whether a legend has it at the moment that an `InPicture` describes."""

    symbol: Callable[[LegendSymbol], None]
    words: str
    shown: Callable[[InPicture], bool]


class InPicture:
    """What is drawn of a mission at about a moment t, of a picture with `scale` pixels a metre.

    Attributes:
        least: distance (m) from which on two places are seen apart. insets: whether errors are drawn magnified.
    """

    def __init__(self, play: Playback, scale: float, layout: Layout, from_above: bool, insets: bool) -> None:
        self.play, self.from_above, self.insets = play, from_above, insets
        self.least = 5 * layout.unit / scale
        self.look(0.0)

    def look(self, t: float) -> None:
        """Set the moment."""
        self.t, self.step = t, step_of(t)
        self.lately = slice(max(0, step_of(t - LATELY * self.play.pace)), self.step + 1)

    @property
    def collects(self) -> bool:
        return not self.play.stations and not self.play.moving

    @property
    def hovers(self) -> bool:
        return bool(self.play.hovering[self.lately].any())

    @property
    def foresees(self) -> bool:
        return self._apart(self.play.foreseen.values, self.play.estimated.values)

    @property
    def errs(self) -> bool:
        return self.insets or self._apart(self.play.estimated.values, self.play.auvs.values)

    @property
    def ellipses(self) -> bool:
        return self.insets or np.abs(error_axes(self.play.covariance.values[self.step])).max() > 0.4 * self.least

    @property
    def heads(self) -> bool:
        """A boat is under way to a goal that is drawn."""
        away = self.play.goals.values[self.lately] - self.play.boats.values[self.lately]
        return bool((np.hypot(away[..., 0], away[..., 1]) > 4 * self.least).any())

    @property
    def replies(self) -> bool:
        """The boat has heard an AUV lately, or the line to one has not faded yet."""
        least = min(math.exp(-LATELY * self.play.pace / HEARD_STEPS), 0.06)
        return any(self.play.heard(self.t, auv)[1] > least for auv in range(self.play.hovering.shape[1]))

    def _apart(self, places: np.ndarray, others: np.ndarray) -> bool:
        away = places[self.lately] - others[self.lately]
        return bool((np.hypot(away[..., 0], away[..., 1]) > self.least).any())


# The most important first: a legend has as many as are legible in it.
ENTRIES = (
    Entry(LegendSymbol.auv, "AUV, underwater robot", lambda now: True),
    Entry(LegendSymbol.boat, "boat that locates AUVs", lambda now: True),
    Entry(LegendSymbol.node, "node: how full of data", lambda now: now.collects),
    Entry(LegendSymbol.moving, "target that moves", lambda now: now.play.moving),
    Entry(LegendSymbol.station, "station of an AUV", lambda now: now.play.stations),
    Entry(LegendSymbol.fix, "true place, estimated", lambda now: now.errs),
    Entry(LegendSymbol.heard, "AUV heard just now", lambda now: now.replies),
    Entry(LegendSymbol.ellipse, "86 % of errors are in it", lambda now: now.ellipses),
    Entry(LegendSymbol.tracked, "estimate of a target", lambda now: now.play.moving),
    Entry(LegendSymbol.rim, "bright: ranges tell more", lambda now: now.insets and now.play.tracks),
    Entry(LegendSymbol.range, "range to a target", lambda now: now.from_above and bool(now.play.ranges(now.t))),
    Entry(LegendSymbol.ping, "ping of the boat", lambda now: any(now.play.pinged(now.lately))),
    Entry(LegendSymbol.goal, "where the boat heads", lambda now: now.heads),
    Entry(LegendSymbol.service, "AUV takes over data", lambda now: now.collects and now.hovers),
    Entry(LegendSymbol.full, "full: new data is lost", lambda now: bool((now.play.fill[now.lately] >= 1).any())),
    Entry(LegendSymbol.foreseen, "where the boat expects it", lambda now: now.foresees),
    Entry(LegendSymbol.field, "what a boat learns there", lambda now: bool(now.play.field.lines(now.step))),
    Entry(LegendSymbol.target, "way to its target", lambda now: True),
    Entry(LegendSymbol.next, "next nodes", lambda now: now.collects),
    Entry(LegendSymbol.age, "white ring: old data", lambda now: bool((now.play.age[now.lately] >= 0.5).any())),
)


class Legend:
    """Symbols and words in two columns or in one, and what the abbreviations stand for.

    Args:
        scale: pixels a metre of the picture. from_above: it is a map, which shows the current. insets: fixes are drawn
            magnified as well.
    """

    def __init__(
        self, play: Playback, box: Rectangle, layout: Layout, scale: float, from_above: bool, insets: bool
    ) -> None:
        self._box, self._layout = box, layout
        self._now = InPicture(play, scale, layout, from_above, insets)
        self._abbreviations = ABBREVIATIONS if self._now.collects else ABBREVIATIONS.split(" · ")[1]
        self._columns = 2 if box.width >= 500 * layout.unit else 1
        self._shown: list[Entry] = []
        self._card = np.empty((box.height, box.width, 3), np.uint8)

    def draw(self, picture: np.ndarray, t: float) -> None:
        """Draw the entries of a moment; it is drawn anew when they change."""
        self._now.look(t)
        most = self._columns * max(1, int((self._box.height / self._layout.unit - 22) / LEAST_ROW))
        shown = [entry for entry in ENTRIES if entry.shown(self._now)][:most]
        if shown != self._shown:
            self._shown = shown
            self._card[:] = self._layout.theme.background
            self._draw_card(self._card, self._box._replace(left=0, top=0))
        self._box.of(picture)[:] = self._card

    def _draw_card(self, card: np.ndarray, box: Rectangle) -> None:
        layout, unit, shown = self._layout, self._layout.unit, self._shown
        draw_card(card, box, layout)
        if text_width(self._abbreviations, 11 * unit) <= box.width - 16 * unit:
            line = box.bottom - 5 * unit
            write(card, self._abbreviations, (box.left + 8 * unit, line), 11 * unit, layout.theme.muted)
            box = box._replace(height=box.height - round(16 * unit))
        box = box._replace(top=round(3 * unit), height=box.height - round(6 * unit))
        rows = math.ceil(len(shown) / self._columns)
        across, down = box.width / self._columns, box.height / rows
        room = across - 50 * unit
        size = min(LETTERS * unit, 0.72 * down)
        size *= min(1.0, room / max(text_width(entry.words, size) for entry in shown))
        on_map = replace(layout, theme=ON_MAP)
        for column in range(self._columns):
            draw_card(card, Rectangle(round(column * across), box.top, round(40 * unit), box.height), on_map)
        for place, entry in enumerate(shown):
            left, middle = (place % self._columns) * across, box.top + (place // self._columns + 0.5) * down
            entry.symbol(LegendSymbol(card, np.array([left + 20 * unit, middle]), on_map))
            write(card, entry.words, (left + 46 * unit, middle + 0.36 * size), size, layout.theme.text)
