"""Frames of a mission's video, drawn by OpenCV from a trace and nothing else, and the look of figures.

`video.write_video` is the entrance; `frames` draws what it encodes. Below lie the map with its axes (`map`), plots of
the panel beside it (`plots`), the perspective view (`perspective`), what both show of the sea (`sea`) and of the trace
(`mission`), the scene with its camera (`scene`), the boxes of a frame (`layout`), symbols (`shapes`), colours and text
(`style`). `figures` has the look of matplotlib's figures, which `plain_matplotlib` makes the same for everybody.
"""
