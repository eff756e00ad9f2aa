"""The batched world: `world.World` and the kernels bound to it (`mission_kernels`); observations of AUVs
(`observation`), boats as agents and spaces (`agents`), boat strategies (`boat_strategies`), shapes, memory and bounds
of the state (`state`), and the numbers that the kernels read (`mission_parameters`, `current_statistics`).

Public: `World`, `Step`, `ObservationLayout`, and the registries `boat_strategies` and `observation_terms`.
"""
