"""Elements of a side panel: title with clock, tiles with figures, cards (rounded backgrounds) with headings."""

from __future__ import annotations

import cv2
import numpy as np

from usvauv_env.render.frame_layout import Layout, Rectangle
from usvauv_env.render.text import clock, shorten, text_width, write


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


def draw_tiles(picture: np.ndarray, box: Rectangle, layout: Layout, figures: list[tuple[str, str]]) -> None:
    """Names and values side by side."""
    unit, theme = layout.unit, layout.theme
    across = box.width / len(figures)
    for place, (name, value) in enumerate(figures):
        left, room = box.left + place * across + 10 * unit, across - 14 * unit
        write(picture, name, (left, box.top + 17 * unit), _fitting(name, 11 * unit, room), theme.muted)
        size = _fitting(value, 20 * unit, room, bold=True)
        write(picture, value, (left, box.top + 42 * unit), size, theme.text, bold=True)


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
