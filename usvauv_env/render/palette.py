"""Colours and marker shapes that tell categories apart: policies, methods, strategies.

Found by a search over CIELAB for the largest least difference between two colours, as seen with normal vision and with
each of the three dichromacies (Machado, Oliveira & Fernandes 2009, doi 10.1109/TVCG.2009.113). The first six differ
most; with more than six, and in print, marker shapes are needed too. Colour number i is of a like hue on both grounds.
"""

from __future__ import annotations

# Amber, blue, mint, raspberry, green, lavender, salmon, straw.
CATEGORICAL = ("#f8b528", "#0d72f2", "#98f5c7", "#cf4179", "#5c830b", "#ccb5fe", "#d47f6a", "#ebe68e")
CATEGORICAL_ON_WHITE = ("#c07d1f", "#045c9a", "#0e9d85", "#6f1d47", "#404c02", "#ae6cee", "#ab505c", "#826a27")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")  # matplotlib's
