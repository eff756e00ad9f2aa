"""Tasks of the AUVs: one file a task. `tasks` has them by name; `Task` and `RewardTerm` are for new ones."""
