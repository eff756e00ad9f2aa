"""Where boat and AUVs should go: Fisher information of fixes, objectives and their maximum, Zermelo's problem.

From outside use `objectives.objective_code`, the functions `*_batch` of `global_search` and
`tilted_array`, and `zermelo.solve` and `steer`; inside a kernel `plan` and `greedy` with a `team.Team`.
"""
