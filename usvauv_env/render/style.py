"""Colours of the video, in OpenCV's order blue, green, red."""

from __future__ import annotations

import colorsys

Colour = tuple[int, int, int]


def colour(code: str) -> Colour:
    """BGR of a web colour such as "#ffb300"."""
    red, green, blue = (int(code[i : i + 2], 16) for i in (1, 3, 5))
    return blue, green, red


def mix(first: Colour, second: Colour, share: float) -> Colour:
    """`first` at share 0, `second` at share 1."""
    blue, green, red = (round(a + (b - a) * share) for a, b in zip(first, second, strict=True))
    return blue, green, red


BACKGROUND = colour("#0b131c")
CARD = colour("#142130")
LINE = colour("#2b3f53")
MUTED = colour("#93a7b9")
TEXT = colour("#eef3f7")
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

# Distinct from the sea and from the nodes' green, amber and red.
_AUVS = tuple(colour(code) for code in ("#ff6fcf", "#ffe95c", "#b7a0ff", "#7df9ff", "#ff9d66", "#c9f26b"))


def auv_colour(auv: int) -> Colour:
    """Colour of AUV number `auv`; distinct for at least sixteen."""
    if auv < len(_AUVS):
        return _AUVS[auv]
    red, green, blue = colorsys.hsv_to_rgb((auv * 0.381966) % 1.0, 0.45, 1.0)
    return round(blue * 255), round(green * 255), round(red * 255)


def gauge_colour(fill: float) -> Colour:
    """Green, amber, red for a buffer filled to the share `fill`."""
    fill = min(max(fill, 0.0), 1.0)
    if fill < 0.5:
        return mix(GAUGE[0], GAUGE[1], fill * 2)
    return mix(GAUGE[1], GAUGE[2], fill * 2 - 1)
