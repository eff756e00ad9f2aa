"""A target rule: the node visited longest ago. `usvauv eval --plugin target_rule.py --targets oldest`"""

import taichi as ti

from usvauv.extend.task import TargetRule, best_free, knowledge, target_rules


@ti.func
def waiting(worlds: ti.template(), w, k, i):
    return -worlds.belief.since[w, knowledge.holder(worlds, k), i]


@ti.func
def oldest(worlds: ti.template(), w, k):
    return best_free(worlds, waiting, w, k)


target_rules.register("oldest", TargetRule(oldest))
