"""Colours of the figures: those of the video."""

from __future__ import annotations

from matplotlib.colors import LinearSegmentedColormap

from usvauv_env.render import style


def web(colour: style.Colour) -> str:
    """Web colour of the video's BGR."""
    blue, green, red = colour
    return f"#{red:02x}{green:02x}{blue:02x}"


TEXT, MUTED, CARD, EDGE = web(style.TEXT), web(style.MUTED), web(style.BACKGROUND), web(style.OUTLINE)
SEA = LinearSegmentedColormap.from_list("sea", [web(colour) for colour in style.SEA] + ["#c4e4e3"])
