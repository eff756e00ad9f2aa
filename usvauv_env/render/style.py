"""The style of pictures and figures: colours and marker shapes, and text in pictures.

Colours of categories (AUVs; policies, methods, strategies) were found by a search in CIELAB that maximises the
least difference between two of them, and from the colours of the sea, for normal vision and for each of the three
dichromacies (Machado, Oliveira & Fernandes 2009, doi 10.1109/TVCG.2009.113). Colour number i has a similar hue on both
backgrounds. Colours are always accompanied by shapes or numbers. Those of pictures are in OpenCV's order BGR.

Text is DejaVu Sans, which matplotlib installs, rendered by FreeType; OpenCV's own fonts have no Greek. Rendering takes
about 40 µs per letter, so masks are cached: most texts are the same in every frame.

`usvauv.env.render.figures` has what figures need beside it. Other modules import matplotlib's names from there, since
`import matplotlib` fails if MPLBACKEND names a backend that is not installed, as Jupyter's does in another environment,
or if a matplotlibrc cannot be read.
"""

from __future__ import annotations

import colorsys
import contextlib
import importlib
import logging
import os
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np


def _import_matplotlib() -> None:
    """Import matplotlib with the settings of its user, or, where they cannot be used, with its own."""
    logger = logging.getLogger("matplotlib")  # which warns of each line of a matplotlibrc that it does not know
    level = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        importlib.import_module("matplotlib")
    except ImportError:
        raise
    except Exception:  # any error, depending on the settings
        for name in [name for name in sys.modules if name.startswith("matplotlib.")]:
            del sys.modules[name]  # parts of the module that was not made
        names = ("MPLBACKEND", "MATPLOTLIBRC")
        given = {name: os.environ[name] for name in names if name in os.environ}
        os.environ |= dict(zip(names, ("", os.devnull), strict=True))
        try:
            with contextlib.chdir(Path(__file__).parent):  # a matplotlibrc in the folder goes before all others
                importlib.import_module("matplotlib")
        finally:
            for name in names:
                del os.environ[name]
            os.environ |= given
    finally:
        logger.setLevel(level)


_import_matplotlib()

import matplotlib  # noqa: E402
from matplotlib.ft2font import FT2Font  # noqa: E402

# Yellow, lavender, aqua, rose, violet, olive, pale green, lime.
CATEGORICAL = ("#f6fe2e", "#c9a0ff", "#94fcf0", "#bf7282", "#a753f5", "#83832f", "#bedea6", "#aab80a")
CATEGORICAL_ON_WHITE = ("#6d6500", "#c361fe", "#077374", "#9c034d", "#2b06d1", "#232603", "#7b9778", "#94980e")
# Yellow, lavender, green, magenta, ice, rose, peach, olive: of AUVs, also for text on `OUTLINE` and on cards.
VEHICLES = ("#f5ff1a", "#c3b4f6", "#34da73", "#ec02ff", "#b3f8ff", "#bf7379", "#ffd8c8", "#928b00")
VEHICLES_ON_WHITE = ("#63800a", "#0d1f69", "#004336", "#a10ce6", "#347e92", "#c83262", "#3d0600", "#654506")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")  # matplotlib's


def looks(names: Iterable[str], colours: tuple[str, ...] = CATEGORICAL) -> dict[str, tuple[str, str]]:
    """Web colour and marker of each of at most eight categories."""
    return dict(zip(names, zip(colours, MARKERS, strict=True), strict=False))


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
EDGE = colour("#09253f")  # of vehicles on the sea: between `OUTLINE` and its darkest water
BOAT = colour("#e6edf2")
BOAT_DECK = colour("#1b4f8a")
FIELD = colour("#cfe3f5")  # lines of what a place of the boat is worth
FULL = colour("#ff453a")
TARGET = colour("#ff9ddb")  # one that moves, and the estimate of it
AGE = (colour("#3a5168"), WHITE)  # of a node's data: fresh, old
GAUGE = (colour("#35d07f"), colour("#ffb020"), FULL)  # backlog of a node: empty, half, full

# Sea by elevation, lowest first; the mean level is mid-blue.
SEA = tuple(colour(code) for code in ("#082349", "#0e3963", "#18557f", "#2a7c99", "#64aeb9"))
LAND = colour("#4a4b40")


@dataclass(frozen=True)
class Theme:
    """Colours around the map.

    Attributes:
        background, card, line, muted, text: of the frame, of panels, of thin lines, of notes, of text.
        vehicles: of the first AUVs on cards. brightness: of further ones, 0 to 1.
        categories: web colours of a figure's curves.
        water: line of the sea's elevation on cards. glow: the lightest of the room around the sea in perspective.
        runs: of two missions that are compared.
    """

    background: Colour
    card: Colour
    line: Colour
    muted: Colour
    text: Colour
    vehicles: tuple[Colour, ...]
    categories: tuple[str, ...]
    brightness: float
    water: Colour
    glow: Colour
    runs: tuple[Colour, Colour]

    def auv(self, auv: int) -> Colour:
        """Colour of AUV number `auv` on a card; distinct for at least sixteen."""
        if auv < len(self.vehicles):
            return self.vehicles[auv]
        red, green, blue = colorsys.hsv_to_rgb((auv * 0.381966) % 1.0, 0.45, self.brightness)
        return round(blue * 255), round(green * 255), round(red * 255)


DARK = Theme(
    background=colour("#0b131c"),
    card=colour("#142130"),
    line=colour("#2b3f53"),
    muted=colour("#93a7b9"),
    text=colour("#eef3f7"),
    vehicles=tuple(map(colour, VEHICLES)),
    categories=CATEGORICAL,
    brightness=1.0,
    water=SEA[4],
    glow=colour("#1d3346"),
    runs=(colour("#eef3f7"), colour("#ff8f3f")),
)
LIGHT = Theme(
    background=colour("#e9eef2"),
    card=colour("#ffffff"),
    line=colour("#cfd9e1"),
    muted=colour("#52677a"),
    text=colour("#12202c"),
    vehicles=tuple(map(colour, VEHICLES_ON_WHITE)),
    categories=CATEGORICAL_ON_WHITE,
    brightness=0.6,
    water=SEA[2],
    glow=colour("#ffffff"),
    runs=(colour("#12202c"), colour("#c4500c")),
)
THEMES = {"dark": DARK, "light": LIGHT}
auv_colour = DARK.auv  # on the sea


def gauge_colour(fill: float) -> Colour:
    """Green, amber, red for a buffer filled to the share `fill`."""
    fill = min(max(fill, 0.0), 1.0)
    if fill < 0.5:
        return mix(GAUGE[0], GAUGE[1], fill * 2)
    return mix(GAUGE[1], GAUGE[2], fill * 2 - 1)


def web(colour: Colour) -> str:
    """Web colour of the video's BGR."""
    blue, green, red = colour
    return f"#{red:02x}{green:02x}{blue:02x}"


class Ground(NamedTuple):
    """Web colours of a figure: categories, text, notes, panels, water, the ground around panels, lines of a grid."""

    colours: tuple[str, ...]
    text: str
    muted: str
    card: str
    water: str
    background: str
    line: str

    @classmethod
    def of(cls, theme: Theme) -> Ground:
        others = theme.text, theme.muted, theme.card, theme.water, theme.background, theme.line
        return cls(theme.categories, *map(web, others))


ON_DARK = Ground.of(DARK)


@cache
def _font(bold: bool) -> FT2Font:
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return FT2Font(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name))


@lru_cache(maxsize=512)
def _mask(text: str, size: float, bold: bool) -> tuple[np.ndarray, int]:
    """Coverage (height, width, 1) 0..255 of a text, and the rows above its baseline."""
    font = _font(bold)
    font.set_size(size, 72)
    # Names of scenarios and policies may hold letters that the font lacks.
    font.set_text("".join(letter if font.get_char_index(ord(letter)) else "?" for letter in text), 0.0)
    font.draw_glyphs_to_bitmap(antialiased=True)
    mask = np.array(font.get_image(), np.uint16)[:, :, None]
    return mask, mask.shape[0] - round(font.get_descent() / 64)


def clock(seconds: float) -> str:
    """A time as minutes:seconds, from one hour on hours:minutes:seconds."""
    whole = int(seconds)
    if whole >= 3600:
        return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"
    return f"{whole // 60}:{whole % 60:02d}"


def text_width(text: str, size: float, bold: bool = False) -> int:
    """Width of a text, pixels."""
    return _mask(text, size, bold)[0].shape[1] if text else 0


def shorten(text: str, size: float, width: float, bold: bool = False) -> str:
    """The text, cut with an ellipsis if it is wider than `width` pixels."""
    if text_width(text, size, bold) <= width:
        return text
    while text and text_width(text + "…", size, bold) > width:
        text = text[:-1]
    return text + "…"


def write(
    image: np.ndarray,
    text: str,
    position: tuple[float, float],
    size: float,
    colour: Colour,
    *,
    bold: bool = False,
    anchor: Literal["left", "centre", "right"] = "left",
    opacity: float = 1.0,
) -> None:
    """Blend a line of text into a BGR image; `position` is the anchor's point on the baseline, pixels.

    What lies outside the image is cut off.
    """
    if not text:
        return
    mask, rise = _mask(text, size, bold)
    height, width = mask.shape[:2]
    left = round(position[0]) - {"left": 0, "centre": width // 2, "right": width}[anchor]
    top = round(position[1]) - rise
    x0, y0 = max(left, 0), max(top, 0)
    x1, y1 = min(left + width, image.shape[1]), min(top + height, image.shape[0])
    if x0 >= x1 or y0 >= y1:
        return
    alpha = mask[y0 - top : y1 - top, x0 - left : x1 - left]
    if opacity < 1.0:
        alpha = (alpha * opacity).astype(np.uint16)
    region = image[y0:y1, x0:x1]
    region[:] = (region * (255 - alpha) + np.array(colour, np.uint16) * alpha + 127) // 255
