"""Tracking of what moves: an AUV's filter of a target from ranges and bearings.

Public: `range_filter` with its functions and `Motion`, `ranges.observe_range`, `bearings.observe_bearing`, and of
`hypotheses` what they take, `filter_of`, the workspace's size `ROOM`, and the columns of the state with their bounds.
"""
