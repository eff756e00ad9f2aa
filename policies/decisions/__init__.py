"""Decisions that are learned by PPO: which node an AUV heads for next, and which AUV the boat visits next.

From outside: `DecisionTrainer` with `NODES` or `VISITS`, and `DecisionConfig`.
"""

from usvauv.policies.decisions.nodes import NODES
from usvauv.policies.decisions.trainer import DecisionConfig, DecisionTrainer
from usvauv.policies.decisions.visits import VISITS

__all__ = ["NODES", "VISITS", "DecisionConfig", "DecisionTrainer"]
