"""The boat's best place for one layout of AUVs, and the expected errors of fixes from there.

Public: `boat_place.solve` with its result, and `fix_errors`.
"""
