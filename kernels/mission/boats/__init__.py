"""The boats of a mission.

`boat_motion` moves them and decides which one serves an AUV; `boat_strategies` has the strategies by name and `goals`
the functions that say where boats go. `belief_planner` plans visits by `rollouts` from where AUVs are predicted to be
(`foresight`).
"""
