"""Frames of a mission's video, drawn by OpenCV from a trace alone, and the style of figures.

`video.write_video` is the entry point; `frames` draws what it encodes, of views of the water (`views`) and a panel
beside them (`panel`). Both use the trace's data at any moment (`mission`, `reply_field`), the boxes of a frame
(`layout`), symbols (`shapes`), and colours and text (`style`). `figures` has what matplotlib's figures need.
"""
