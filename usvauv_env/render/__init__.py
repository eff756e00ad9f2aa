"""Frames of a mission's video, drawn by OpenCV from a trace and nothing else.

`painter.Painter` is the entrance for missions. The map, the panel elements, the plots and the colours are also used by
the views of the sea alone in `usvauv_cli.sea_view` and by the figures. `perspective.PerspectiveView` draws a mission in
perspective.
"""
