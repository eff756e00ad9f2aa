"""The batched world: `world.World`; what an AUV observes (`observation`), boats as agents and spaces (`agents`), where
boats go (`boat_strategies`), shapes and bounds of the state (`state`), and the numbers that the kernels read (`tables`,
`current_statistics`).

From outside: `World`, `Step`, `ObservationLayout`, and the registries `boat_strategies` and `observation_terms`.
"""
