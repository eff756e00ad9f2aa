"""Tracking of what moves: an AUV's filter of a target from ranges and bearings.

Public: `range_filter` with its functions and `Motion`, `bearings.observe_bearing`, and of `hypotheses` the columns of
its state, `FilterColumn`, `COLUMNS` and `BOUNDS`.
"""
