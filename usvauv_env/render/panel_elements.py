"""Elements of a side panel: title with clock, tiles with figures, cards (rounded backgrounds) with headings."""

from __future__ import annotations

import cv2
import numpy as np

from usvauv.env.render import shapes, style
from usvauv.env.render.frame_layout import Layout, Rectangle
from usvauv.env.render.text import clock, shorten, text_width, write


def write_title(
    picture: np.ndarray, box: Rectangle, layout: Layout, name: str, run: str, duration: float, speed_up: float
) -> None:
    """Two lines: name, with room for the clock at its right; run, duration and play speed."""
    unit, theme = layout.unit, layout.theme
    end, edge = clock(duration), 2 * unit
    room = box.width - text_width(end, 24 * unit, bold=True) - 14 * unit
    name = shorten(name, 21 * unit, room, bold=True)
    write(picture, name, (box.left + edge, box.top + 24 * unit), 21 * unit, theme.text, bold=True)
    line, size = box.top + 44 * unit, 12 * unit
    pace = f"of {end} · {speed_up:g} × speed"
    run = shorten(run, size, box.width - text_width(pace, size) - 14 * unit)
    write(picture, run, (box.left + edge, line), size, theme.muted)
    write(picture, pace, (box.right - edge, line), size, theme.muted, anchor="right")


def draw_clock(picture: np.ndarray, box: Rectangle, layout: Layout, time: float, share: float) -> None:
    """The time in s, and a progress bar filled to `share`, in the title's box."""
    unit, theme = layout.unit, layout.theme
    corner = box.right - 2 * unit, box.top + 24 * unit
    write(picture, clock(time), corner, 24 * unit, theme.text, bold=True, anchor="right")
    top, done = round(box.bottom - 2 * unit), round(box.width * share)
    bar = picture[top : top + layout.px(3), box.left : box.right]
    bar[:], bar[:, :done] = theme.line, theme.muted


def name_tiles(still: np.ndarray, box: Rectangle, layout: Layout, names: list[str]) -> None:
    """Names of tiles side by side, of one size."""
    unit = layout.unit
    across = box.width / len(names)
    size = min(_fitting(name, 11 * unit, across - 14 * unit) for name in names)
    for place, name in enumerate(names):
        write(still, name, (box.left + place * across + 10 * unit, box.top + 17 * unit), size, layout.theme.muted)


def fill_tiles(picture: np.ndarray, box: Rectangle, layout: Layout, values: list[str]) -> None:
    """Values below the names."""
    unit = layout.unit
    across = box.width / len(values)
    for place, value in enumerate(values):
        size = _fitting(value, 20 * unit, across - 14 * unit, bold=True)
        position = box.left + place * across + 10 * unit, box.top + 42 * unit
        write(picture, value, position, size, layout.theme.text, bold=True)


def _fitting(text: str, size: float, room: float, bold: bool = False) -> float:
    """Font size, reduced where needed so that the text is no wider than `room` pixels."""
    width = text_width(text, size, bold)
    return size if width <= room else size * max(room, 1.0) / width


def write_heading(picture: np.ndarray, layout: Layout, box: Rectangle, text: str, note: str = "") -> None:
    """Title of a card, and a note at the right if there is room for both."""
    unit, theme = layout.unit, layout.theme
    line = box.top + 18 * unit
    room = box.width - 20 * unit
    text = shorten(text, 12 * unit, room, bold=True)
    write(picture, text, (box.left + 10 * unit, line), 12 * unit, theme.text, bold=True)
    if text_width(text, 12 * unit, bold=True) + 12 * unit + text_width(note, 11 * unit) < room:
        write(picture, note, (box.right - 10 * unit, line), 11 * unit, theme.muted, anchor="right")


def draw_card(picture: np.ndarray, box: Rectangle, layout: Layout) -> None:
    """A rounded background."""
    colour, radius = layout.theme.card, max(1, round(5 * layout.unit))
    left, top, right, bottom = box.left, box.top, box.right - 1, box.bottom - 1
    cv2.rectangle(picture, (left + radius, top), (right - radius, bottom), colour, -1)
    cv2.rectangle(picture, (left, top + radius), (right, bottom - radius), colour, -1)
    for x in (left + radius, right - radius):
        for y in (top + radius, bottom - radius):
            cv2.circle(picture, (x, y), radius, colour, -1, cv2.LINE_AA)


def within_margins(
    box: Rectangle, unit: float, top: float, sides: float, bottom: float, left: float | None = None
) -> Rectangle:
    """The box without its margins, which are in pixels of the design."""
    a, b, c = round((sides if left is None else left) * unit), round(sides * unit), round(top * unit)
    return Rectangle(
        box.left + a, box.top + c, max(box.width - a - b, 8), max(box.height - c - round(bottom * unit), 8)
    )


class Bars:
    """A title, and named values side by side, each with a bar from the middle that `scale` fills."""

    def __init__(
        self, still: np.ndarray, box: Rectangle, layout: Layout, title: tuple[str, str], names: list[str], scale: float
    ) -> None:
        unit, theme = layout.unit, layout.theme
        for line, words in enumerate(title):
            write(still, words, (box.left + 10 * unit, box.top + (18 + 15 * line) * unit), 11 * unit, theme.muted)
        start = box.left + max(text_width(words, 11 * unit) for words in title) + 26 * unit
        across = (box.right - start) / len(names)
        self._layout, self._scale, self._row = layout, scale, box.top
        self._left, self._room = [start + place * across for place in range(len(names))], across - 10 * unit
        self._size = min(_fitting(f"{name} +00.00", 11 * unit, self._room) for name in names)
        row = box.top + 30 * unit
        for left, name in zip(self._left, names, strict=True):
            write(still, name, (left, box.top + 18 * unit), self._size, theme.muted)
            shapes.stroke(still, np.array([(left, row), (left + self._room, row)]), theme.line, layout.px(2))

    def draw(self, picture: np.ndarray, values: list[float]) -> None:
        """Draw the values over a copy of the still picture."""
        layout, unit, room = self._layout, self._layout.unit, self._room
        for left, value in zip(self._left, values, strict=True):
            number, row = f"{value:+.2f}".replace("-", "−"), self._row + 30 * unit
            position = left + room, self._row + 18 * unit
            write(picture, number, position, self._size, layout.theme.text, anchor="right")
            middle, length = left + room / 2, room / 2 * min(max(value / self._scale, -1.0), 1.0)
            ink = style.GAUGE[0] if value > 0 else style.GAUGE[2]
            shapes.stroke(picture, np.array([(middle, row), (middle + length, row)]), ink, layout.px(4))
