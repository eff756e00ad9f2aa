"""Look of a reproduction's figures: title, plots, colours of the methods, and the two formats they are saved in."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from usvauv_cli import figure_theme
from usvauv_cli.figure_theme import BACKGROUND, CARD, LINE, MUTED, TEXT
from usvauv_env.render.palette import looks

METHOD_LOOKS = looks(("ddpg", "sac", "td3", "baseline", "data"))
HEURISTIC_LOOK = (MUTED, "o")
NAMES = {"sdr": "Sum data rate (SDR), Mbit/s", "ec": "Energy consumption (EC), W", "arps": "Reward per step (ARPS)"}


def titled_figure(width: float, height: float, title: str, about: str) -> Figure:
    """An empty figure of a size in inches with a title and a line below it; plots stand below 0.86 of its height."""
    figure = Figure(figsize=(width, height), facecolor=BACKGROUND)
    figure.text(0.5 / width, 1 - 0.38 / height, title, color=TEXT, fontsize=15, fontweight="bold", va="center")
    figure.text(0.5 / width, 1 - 0.68 / height, about, color=MUTED, fontsize=9.5, va="center")
    return figure


def style_plot(axes: Axes, title: str = "", title_pad: float | None = None) -> None:
    """Ground, grid, labels and title of one plot."""
    axes.set_facecolor(CARD)
    axes.set_axisbelow(True)
    axes.grid(color=LINE, lw=0.6)
    figure_theme.style_axes(axes)
    figure_theme.set_title(axes, title, title_pad)


def save(figure: Figure, stem: Path) -> None:
    """Write STEM.png and STEM.pdf."""
    for kind in ("png", "pdf"):
        figure_theme.save(figure, stem.with_name(f"{stem.name}.{kind}"), dpi=140)
