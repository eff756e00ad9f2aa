"""Figures of benchmarks and studies in the look of all others, once for light and once for dark pages."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from usvauv_cli.figure_theme import web
from usvauv_env.files import atomic_write
from usvauv_env.render import style

RESOLUTION = 130  # dots an inch


class Ground(NamedTuple):
    """Web colours on a ground: of categories, of text and of what stands back."""

    colours: tuple[str, ...]
    text: str
    muted: str


def write(path: Path, draw: Callable[[Ground], Figure]) -> None:
    """Draw a figure on each theme's ground; of a path x.png to x-light.png and x-dark.png.

    Raises:
        OutputError: a file cannot be written.
    """
    for name, theme in style.THEMES.items():
        background, card, line, muted, text = map(
            web, (theme.background, theme.card, theme.line, theme.muted, theme.text)
        )
        settings = {
            "figure.facecolor": background,
            "axes.facecolor": card,
            "axes.labelcolor": muted,
            "axes.titlecolor": text,
            "axes.titlelocation": "left",
            "axes.axisbelow": True,
            "axes.edgecolor": card,  # no frame
            "grid.color": line,
            "grid.linewidth": 0.6,
            "legend.frameon": False,
            "legend.labelcolor": text,
            "text.color": text,
            "xtick.color": muted,
            "ytick.color": muted,
        }
        with plt.rc_context(settings), atomic_write(path.with_stem(f"{path.stem}-{name}")) as partial:
            figure = draw(Ground(tuple(map(web, theme.vehicles)), text, muted))
            figure.savefig(partial, dpi=RESOLUTION, format=path.suffix[1:])
            plt.close(figure)
