"""Target rules by name: the choice of an AUV's next node, from the knowledge of the nodes.

Public: `target_rules`, `TargetRule` and `parse`; for your own rule also `knowledge` and `best_free`.
"""

from usvauv.kernels.mission.choices import TargetRule, target_rules, usage
from usvauv.kernels.mission.target_rules import knowledge
from usvauv.kernels.mission.target_rules.rollout import ROLLOUT
from usvauv.kernels.mission.target_rules.rule import (
    DEMONSTRATION,
    GREEDY,
    NEAREST,
    RATE,
    best_free,
    parse,
)
from usvauv.kernels.mission.target_rules.tour import SECTORS, TOUR, share_nodes

target_rules.register("greedy", GREEDY)
target_rules.register("nearest", NEAREST)
target_rules.register("rate", RATE)
target_rules.register("rollout", ROLLOUT)
target_rules.register("tour", TOUR)
target_rules.register("sectors", SECTORS)
target_rules.register("demonstration", DEMONSTRATION)

__all__ = ["TargetRule", "best_free", "knowledge", "parse", "share_nodes", "target_rules", "usage"]
