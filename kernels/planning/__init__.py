"""Planning for boat and AUVs: Fisher information of fixes, objectives and their maximum.

Public: `objectives.objective_code`, the functions `*_batch` of `search`, `objectives` and `information`; inside a
kernel `search.search` with an `information.Team` and an `ascent.Region`.
"""
