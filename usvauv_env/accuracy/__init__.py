"""The boat's best place for one layout of AUVs, expected errors of fixes from there, and least errors of tracking.

Public: `boat_place.solve` with its result, `fix_errors`, and `tracking_bound`.
"""
