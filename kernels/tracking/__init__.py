"""Tracking of what moves: an AUV's filter of a target from ranges.

Public: `range_filter`, with the columns of its state.
"""
