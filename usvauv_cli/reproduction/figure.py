"""Look of a reproduction's figures: title, names, and the order in which methods take colours."""

from __future__ import annotations

from matplotlib.figure import Figure

from usvauv.env.render.figure_theme import Ground

METHODS = ("ddpg", "sac", "td3", "baseline", "data")
NAMES = {"sdr": "Sum data rate (SDR), Mbit/s", "ec": "Energy consumption (EC), W", "arps": "Reward per step (ARPS)"}
WIDTH = 9.6  # inches


def titled_figure(height: float, title: str, about: str, ground: Ground) -> Figure:
    """An empty figure of a height in inches with a title and up to two lines below it, in its upper 1.1 inches."""
    figure = Figure(figsize=(WIDTH, height))
    left = 0.3 / WIDTH
    figure.text(left, 1 - 0.34 / height, title, fontsize=15, fontweight="bold", va="center")
    figure.text(left, 1 - 0.55 / height, about, color=ground.muted, fontsize=9.5, va="top", linespacing=1.4)
    return figure
