"""Colours and marker shapes that tell categories apart: vehicles, policies, methods, strategies.

Found by a search over CIELAB for the largest least difference between two colours, as seen with normal vision and with
each of the three dichromacies (Machado, Oliveira & Fernandes 2009, doi 10.1109/TVCG.2009.113), also from the colours of
the sea. Colour number i is of a like hue on both grounds. Shapes or numbers stand beside the colours everywhere.
"""

from __future__ import annotations

from collections.abc import Iterable

# Yellow, lavender, aqua, rose, violet, olive, pale green, lime.
CATEGORICAL = ("#f6fe2e", "#c9a0ff", "#94fcf0", "#bf7282", "#a753f5", "#83832f", "#bedea6", "#aab80a")
CATEGORICAL_ON_WHITE = ("#6d6500", "#c361fe", "#077374", "#9c034d", "#2b06d1", "#232603", "#7b9778", "#94980e")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")  # matplotlib's


def looks(names: Iterable[str], colours: tuple[str, ...] = CATEGORICAL) -> dict[str, tuple[str, str]]:
    """Web colour and marker of each of at most eight categories."""
    return dict(zip(names, zip(colours, MARKERS, strict=True), strict=False))
