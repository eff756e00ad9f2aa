"""How the figures of a reproduction look, and how they are saved."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from usvauv_cli.figure_theme import CARD, MUTED, TEXT, web
from usvauv_env.files import atomic_write
from usvauv_env.render import style

PLOT, LINE = web(style.CARD), web(style.LINE)
METHOD_COLOURS = {"ddpg": "#ffb020", "sac": "#7df9ff", "td3": "#ff6fcf", "baseline": "#c9f26b", "data": "#4f9bd9"}
HEURISTIC_COLOUR = MUTED
NAMES = {"sdr": "Sum data rate (SDR), Mbit/s", "ec": "Energy consumption (EC), W", "arps": "Reward per step (ARPS)"}


def make(width: float, height: float, title: str, about: str) -> Figure:
    """An empty figure of a size in inches with a title and a line below it; plots stand below 0.86 of its height."""
    figure = Figure(figsize=(width, height), facecolor=CARD)
    figure.text(0.5 / width, 1 - 0.38 / height, title, color=TEXT, fontsize=15, fontweight="bold", va="center")
    figure.text(0.5 / width, 1 - 0.68 / height, about, color=MUTED, fontsize=9.5, va="center")
    return figure


def dress(axes: Axes, title: str = "") -> None:
    """Colours of a plot's ground, grid, ticks and labels."""
    axes.set_facecolor(PLOT)
    axes.set_axisbelow(True)
    axes.grid(color=LINE, lw=0.6)
    axes.tick_params(colors=MUTED, labelsize=9, length=0, pad=5, which="both")
    axes.xaxis.label.set(color=MUTED, fontsize=9.5)
    axes.yaxis.label.set(color=MUTED, fontsize=9.5)
    axes.set_title(title, color=TEXT, fontsize=11, loc="left")
    for spine in axes.spines.values():
        spine.set_visible(False)


def save(figure: Figure, place: Path) -> None:
    """Write PLACE.png and PLACE.pdf."""
    for form, metadata in (("png", None), ("pdf", {"CreationDate": None})):  # without the date equal figures are equal
        with atomic_write(place.with_name(f"{place.name}.{form}")) as partial:
            figure.savefig(partial, dpi=140, facecolor=CARD, format=form, metadata=metadata)
