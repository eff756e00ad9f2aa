"""The batched world: `world.World`, what an AUV observes (`observation`, `spaces`), how the boat is steered
(`boat_strategies`), its memory (`arrays`), what its draws depend on (`seeds`), and the numbers that the kernels read
(`tables`, `current_statistics`).

From outside: `World`, `ObservationLayout`, and the registries `boat_strategies` and `observation_terms`.
"""
