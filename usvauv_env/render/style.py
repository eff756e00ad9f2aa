"""Colours of the video, in OpenCV's order blue, green, red: of the map, and around it by theme."""

from __future__ import annotations

import colorsys
from dataclasses import dataclass

from usvauv.env.render import palette

Colour = tuple[int, int, int]


def colour(code: str) -> Colour:
    """BGR of a web colour such as "#ffb300"."""
    red, green, blue = (int(code[i : i + 2], 16) for i in (1, 3, 5))
    return blue, green, red


def mix(first: Colour, second: Colour, share: float) -> Colour:
    """`first` at share 0, `second` at share 1."""
    blue, green, red = (round(a + (b - a) * share) for a, b in zip(first, second, strict=True))
    return blue, green, red


WHITE = (255, 255, 255)
OUTLINE = colour("#06121d")
BOAT = colour("#ffffff")
BOAT_DECK = colour("#1b4f8a")
FIELD = colour("#cfe3f5")  # lines of what a place of the boat is worth
FULL = colour("#ff453a")
AGE = (colour("#3a5168"), WHITE)  # of a node's data: fresh, old
GAUGE = (colour("#35d07f"), colour("#ffb020"), FULL)  # backlog of a node: empty, half, full

# Sea by elevation, lowest first; the mean level is mid-blue.
SEA = tuple(colour(code) for code in ("#082349", "#0e3963", "#18557f", "#2a7c99", "#64aeb9"))
LAND = colour("#4a4b40")

_ON_SEA = tuple(colour(code) for code in palette.CATEGORICAL)


def auv_colour(auv: int) -> Colour:
    """Colour of AUV number `auv` on the sea; distinct for at least sixteen."""
    return _further(auv, _ON_SEA, 1.0)


def _further(auv: int, first: tuple[Colour, ...], value: float) -> Colour:
    """The first colours, and from then on hues of a brightness `value`."""
    if auv < len(first):
        return first[auv]
    red, green, blue = colorsys.hsv_to_rgb((auv * 0.381966) % 1.0, 0.45, value)
    return round(blue * 255), round(green * 255), round(red * 255)


@dataclass(frozen=True)
class Theme:
    """Colours around the map.

    Attributes:
        background, card, line, muted, text: of the frame, of panels, of thin lines, of notes, of text.
        vehicles: of the first AUVs on cards. brightness: of further ones, 0 to 1.
        water: line of the sea's elevation on cards.
    """

    background: Colour
    card: Colour
    line: Colour
    muted: Colour
    text: Colour
    vehicles: tuple[Colour, ...]
    brightness: float
    water: Colour

    def auv(self, auv: int) -> Colour:
        """Colour of AUV number `auv` on a card."""
        return _further(auv, self.vehicles, self.brightness)


DARK = Theme(
    background=colour("#0b131c"),
    card=colour("#142130"),
    line=colour("#2b3f53"),
    muted=colour("#93a7b9"),
    text=colour("#eef3f7"),
    vehicles=_ON_SEA,
    brightness=1.0,
    water=SEA[4],
)
LIGHT = Theme(
    background=colour("#e9eef2"),
    card=colour("#ffffff"),
    line=colour("#cfd9e1"),
    muted=colour("#52677a"),
    text=colour("#12202c"),
    vehicles=tuple(colour(code) for code in palette.CATEGORICAL_ON_WHITE),
    brightness=0.6,
    water=SEA[2],
)
THEMES = {"dark": DARK, "light": LIGHT}


def gauge_colour(fill: float) -> Colour:
    """Green, amber, red for a buffer filled to the share `fill`."""
    fill = min(max(fill, 0.0), 1.0)
    if fill < 0.5:
        return mix(GAUGE[0], GAUGE[1], fill * 2)
    return mix(GAUGE[1], GAUGE[2], fill * 2 - 1)
