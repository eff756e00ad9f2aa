"""Tracking of what moves: an AUV's filter of a target from ranges.

Public: `range_filter` with its functions and `Motion`, and of `hypotheses` the columns of its state, `FilterColumn`,
`COLUMNS` and `BOUNDS`.
"""
