"""What frames of videos write and draw, recorded; a limit of a file's size."""

import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest

from usvauv.env.render import panel_elements, shapes, symbols
from usvauv.env.render import text as texts
from usvauv.env.render.bodies import Body
from usvauv.env.render.canvas import Canvas


class Words(NamedTuple):
    """A text with the place (left, top, right, bottom) of its letters in a picture of a shape."""

    text: str
    place: np.ndarray
    position: tuple[float, float]
    size: float
    anchor: str
    shape: tuple[int, int]

    @property
    def middle(self):
        """Row half way between the highest and the lowest of its letters."""
        lit = np.flatnonzero((texts._mask(self.text, self.size, False)[0][..., 0] > 90).any(1))
        return self.place[1] + (lit[0] + lit[-1]) / 2


@pytest.fixture
def size_limit() -> Callable[[], AbstractContextManager[None]]:
    """Blocks in which the system lets no file grow beyond 4 KiB; pytest writes its report outside of them."""
    resource = pytest.importorskip("resource")

    @contextmanager
    def limited() -> Iterator[None]:
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)

    return limited


@pytest.fixture
def page(monkeypatch):
    """What is written, stroked, and filled in place of being drawn; numbers of AUVs and data of services aside."""
    made = SimpleNamespace(words=[], strokes=[], grounds=[], fills=[], cards=[])

    def note(image, text, position, size, colour, *, bold=False, anchor="left", opacity=1.0):
        if text:
            mask, rise = texts._mask(text, size, bold)
            height, width = mask.shape[:2]
            left, top = position[0] - {"left": 0, "centre": width / 2, "right": width}[anchor], position[1] - rise
            place = np.array([left, top, left + width, top + height])
            made.words.append(Words(text, place, position, size, anchor, image.shape[:2]))

    draw_card = panel_elements.draw_card

    def card(picture, box, layout):
        made.cards.append(box)
        draw_card(picture, box, layout)

    for name, module in list(sys.modules.items()):
        if name.startswith("usvauv.env.render.") and name.split(".")[-1] not in ("symbols", "popups", "text"):
            for attribute, original, new in (("write", texts.write, note), ("draw_card", draw_card, card)):
                if getattr(module, attribute, None) is original:
                    monkeypatch.setattr(module, attribute, new)
    stroke, fill = shapes.stroke, shapes.fill

    def stroked(image, points, colour, width=1, closed=False):
        made.strokes.append((np.asarray(points, float), colour, width))
        made.grounds.append(image.shape[:2])
        stroke(image, points, colour, width, closed)

    def filled(image, points, colour):
        made.fills.append((np.asarray(points, float), colour))
        fill(image, points, colour)

    monkeypatch.setattr(shapes, "stroke", stroked)
    monkeypatch.setattr(shapes, "fill", filled)
    return made


@pytest.fixture
def drawn(monkeypatch):
    """What is drawn on a canvas, by kind: its arguments."""
    made = {}
    for name in ("line", "circle", "trail", "pieces"):
        monkeypatch.setattr(Canvas, name, lambda _, *rest, name=name: made.setdefault(name, []).append(rest))
    for name in ("cross", "fix", "foreseen", "badge", "station"):
        monkeypatch.setattr(symbols, name, lambda _, *rest, name=name: made.setdefault(name, []).append(rest))
    monkeypatch.setattr(Body, "draw", lambda body, _, *rest: made.setdefault("body", []).append((body, *rest)))
    return made
