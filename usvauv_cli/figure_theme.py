"""Look of the figures: the colours of the video, plain axes, and how they are saved."""

from __future__ import annotations

import math
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FormatStrFormatter, NullLocator

from usvauv_env.files import atomic_write
from usvauv_env.render import style


def web(colour: style.Colour) -> str:
    """Web colour of the video's BGR."""
    blue, green, red = colour
    return f"#{red:02x}{green:02x}{blue:02x}"


TEXT, MUTED, OUTLINE = web(style.DARK.text), web(style.DARK.muted), web(style.OUTLINE)
BACKGROUND, CARD, LINE = web(style.DARK.background), web(style.DARK.card), web(style.DARK.line)
WATER = web(style.SEA[4])
SEA = LinearSegmentedColormap.from_list("sea", [web(colour) for colour in style.SEA] + ["#c4e4e3"])


def style_axes(axes: Axes, tick_pad: float = 5) -> None:
    """Muted labels, numbers without tick marks and no frame; `tick_pad` is from the plot to its numbers, points."""
    axes.tick_params(colors=MUTED, labelsize=9, length=0, pad=tick_pad, which="both")
    for axis in (axes.xaxis, axes.yaxis):
        axis.label.set(color=MUTED, fontsize=9.5)
    for spine in axes.spines.values():
        spine.set_visible(False)


def log_ticks(axis: Axis) -> None:
    """Ticks of a logarithmic axis at 1, 2 and 5 times powers of ten, written out; finer ones where few are in view."""
    low, high = axis.get_view_interval()
    for steps in ((1, 2, 5), (1, 1.5, 2, 3, 5, 7), [n / 10 for n in range(10, 100)]):
        powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
        ticks = [step * 10.0**power for power in powers for step in steps]
        shown = [tick for tick in ticks if low <= tick <= high]
        if len(shown) > 2:
            break
    axis.set_major_locator(FixedLocator(shown))
    axis.set_major_formatter(FormatStrFormatter("%g"))
    axis.set_minor_locator(NullLocator())


def set_title(axes: Axes, text: str, pad: float | None = None) -> None:
    """Title at the left above a plot, `pad` points from it."""
    axes.set_title(text, color=TEXT, fontsize=11, loc="left", pad=pad)


def save(figure: Figure, path: Path, dpi: float = 150) -> None:
    """Write a figure, the format by the file's suffix; PDFs carry no date, so that equal figures are equal files.

    Raises:
        OutputError: the file cannot be written.
    """
    kind = path.suffix[1:].lower()
    with atomic_write(path) as partial:
        metadata = {"CreationDate": None} if kind == "pdf" else None
        figure.savefig(partial, dpi=dpi, facecolor=BACKGROUND, format=kind, metadata=metadata)
