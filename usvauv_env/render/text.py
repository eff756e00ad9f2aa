"""Text in pictures: DejaVu Sans, which matplotlib installs, rendered by FreeType; OpenCV's own fonts have no Greek.

Rendering takes about 40 µs a letter, so masks are cached: most texts are the same in every frame.
"""

from __future__ import annotations

from functools import cache, lru_cache
from pathlib import Path
from typing import Literal

import matplotlib
import numpy as np
from matplotlib.ft2font import FT2Font

from usvauv.env.render.style import Colour


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
