"""Frames of a mission's video, drawn by OpenCV from a trace and nothing else.

`painter.painter_of` is the entrance for missions: the map with its panel (`painter`), the sea in perspective
(`sea_frame`, `perspective`), two missions side by side (`comparison`). Map, panel elements, plots and colours are
also used by the views of the sea alone in `usvauv.cli.sea_view` and by the figures.
"""
