"""Decisions that are learned by PPO: which node an AUV heads for next.

From outside: `DecisionTrainer` and `DecisionConfig`.
"""

from usvauv.policies.decisions.trainer import DecisionConfig, DecisionTrainer

__all__ = ["DecisionConfig", "DecisionTrainer"]
