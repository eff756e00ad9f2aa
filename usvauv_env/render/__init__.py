"""Frames of a mission's video, drawn by OpenCV from a trace alone, and the style of figures.

`video.write_video` is the entry point; `frames` draws what it encodes. These use the map with its axes (`map`), its
legend (`legend`), the perspective view (`perspective`) of a scene with its camera (`scene`), that from beside a boat
(`boat_view`), plots of the side panel (`plots`), pictures of the sea (`sea_surface`), the trace's data at any moment
(`mission`, `reply_field`), the boxes of a frame (`layout`), symbols (`shapes`), and colours, text and matplotlib's
figures (`style`).
"""
