"""Figures by matplotlib, which no picture or video needs and takes long to import.

They do not depend on the user's matplotlib settings, see `plain`.
"""

from __future__ import annotations

import contextlib
import math
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from usvauv.env.render.style import LIGHT, ON_DARK, SEA, THEMES, Ground, web
from usvauv.env.storage.files import atomic_write

# isort: split
# After `style`, which imports it whatever its user's settings are. Names written twice are for others too.
import matplotlib
from matplotlib import mlab as mlab
from matplotlib.axes import Axes as Axes
from matplotlib.axis import Axis
from matplotlib.cm import ScalarMappable as ScalarMappable
from matplotlib.colors import LinearSegmentedColormap as LinearSegmentedColormap
from matplotlib.colors import Normalize as Normalize
from matplotlib.figure import Figure as Figure
from matplotlib.lines import Line2D as Line2D
from matplotlib.patches import Ellipse as Ellipse
from matplotlib.patheffects import AbstractPathEffect as AbstractPathEffect
from matplotlib.patheffects import withStroke as withStroke
from matplotlib.ticker import FixedLocator, FormatStrFormatter, LogFormatter, NullLocator
from matplotlib.ticker import MaxNLocator as MaxNLocator

DEFAULTS: dict[Any, Any] = {name: value for name, value in matplotlib.rcParamsDefault.items() if name != "backend"}
DEFAULTS["text.parse_math"] = False


@contextlib.contextmanager
def plain(settings: Mapping[Any, Any] | None = None) -> Iterator[None]:
    """Settings in which a figure is made and saved: matplotlib's own ones but for those given.

    Text is drawn as it stands: names hold dollars, underscores and braces that are no mathematics, and letters that the
    font lacks, each of which matplotlib would warn of again and again.
    """
    with matplotlib.rc_context(DEFAULTS | dict(settings or {})), warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"Glyph \d+ |Matplotlib currently does not support .* natively", UserWarning)
        yield


SEA_COLOURS = LinearSegmentedColormap.from_list("sea", [web(shade) for shade in SEA] + ["#c4e4e3"])
RESOLUTION = 130  # dots an inch, of pairs of figures


def write_pair(path: Path, draw: Callable[[Ground], Figure], pdf: bool = False) -> None:
    """Draw a figure on each theme's ground; of a path x.png to x-light.png and x-dark.png, of the light one also x.pdf.

    Raises:
        OutputError: a file cannot be written.
    """
    for name, theme in THEMES.items():
        ground = Ground.of(theme)
        settings: dict[Any, Any] = {  # matplotlib's own names
            "figure.constrained_layout.h_pad": 0.12,  # inches
            "figure.constrained_layout.w_pad": 0.12,
            "figure.facecolor": ground.background,
            "axes.facecolor": ground.card,
            "axes.labelcolor": ground.muted,
            "axes.labelsize": 9.5,
            "axes.titlecolor": ground.text,
            "axes.titlelocation": "left",
            "axes.titlesize": 11,
            "axes.axisbelow": True,
            "axes.grid": True,
            **{f"axes.spines.{side}": False for side in ("left", "right", "top", "bottom")},
            "grid.color": ground.line,
            "grid.linewidth": 0.6,
            "legend.fontsize": 9.5,
            "legend.frameon": False,
            "legend.labelcolor": ground.text,
            "text.color": ground.text,
            **{f"{axis}tick.{which}.size": 0 for axis in "xy" for which in ("major", "minor")},
            **{f"{axis}tick.labelsize": 9 for axis in "xy"},
            **{f"{axis}tick.color": ground.muted for axis in "xy"},
        }
        with plain(settings):
            figure = draw(ground)
            save_figure(figure, path.with_stem(f"{path.stem}-{name}"), RESOLUTION)
            if pdf and theme is LIGHT:
                save_figure(figure, path.with_suffix(".pdf"))


def style_axes(axes: Axes, tick_pad: float = 5) -> None:
    """Muted labels, numbers without tick marks and no frame; `tick_pad` is from the plot to its numbers, points."""
    axes.tick_params(colors=ON_DARK.muted, labelsize=9, length=0, pad=tick_pad, which="both")
    for axis in (axes.xaxis, axes.yaxis):
        axis.label.set(color=ON_DARK.muted, fontsize=9.5)
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


class WrittenOut(LogFormatter):
    """Numbers of a logarithmic axis where matplotlib has them, but not as powers of ten, which are mathematics."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        return f"{x:g}" if super().__call__(x, pos) else ""


def set_title(axes: Axes, text: str, pad: float | None = None) -> None:
    """Title at the left above a plot, `pad` points from it."""
    axes.set_title(text, color=ON_DARK.text, fontsize=11, loc="left", pad=pad)


def save_figure(figure: Figure, path: Path, dpi: float = 150) -> None:
    """Write a figure, the format by the file's suffix; PDFs carry no date, so that equal figures are equal files.

    Raises:
        OutputError: the file cannot be written.
    """
    kind = path.suffix[1:].lower()
    with atomic_write(path) as partial:
        metadata = {"CreationDate": None} if kind == "pdf" else None
        figure.savefig(partial, dpi=dpi, format=kind, metadata=metadata)
