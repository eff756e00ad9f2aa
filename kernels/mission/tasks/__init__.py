"""Tasks of the AUVs: one file per task. `tasks` has them by name; `Task` and `RewardTerm` are for new ones."""
