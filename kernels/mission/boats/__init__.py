"""The boats of a mission.

`boat_motion` moves them and decides which one serves an AUV; `boat_strategies` says where they go. `belief_planner`
plans visits by `rollouts` from where AUVs are predicted to be (`foresight`).
"""
