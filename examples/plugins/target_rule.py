"""A target rule: the node visited longest ago. `usvauv eval --plugin target_rule.py --targets oldest`"""

import taichi as ti

from usvauv.extend.task import TargetRule, best_free, knowledge, target_rules
from usvauv.extend.world import BeliefColumn


@ti.func
def waiting(worlds: ti.template(), w, k, i):
    return -worlds.belief[w, knowledge.holder(worlds, k), i, BeliefColumn.since]


@ti.func
def oldest(worlds: ti.template(), w, k):
    return best_free(worlds, waiting, w, k)


target_rules.register("oldest", TargetRule(oldest))
