"""Frames of a mission's video, drawn by OpenCV from a trace and nothing else, and the look of figures.

`video.write_video` is the entrance; `frames` draws what it encodes. Below lie the map with its axes and legend (`map`),
the perspective view (`perspective`) of a scene with its camera (`scene`), plots of the panel beside them (`plots`),
what all show of the sea (`sea`) and of the trace (`mission`), the boxes of a frame (`layout`), symbols (`shapes`), and
colours, text and matplotlib's figures (`style`).
"""
