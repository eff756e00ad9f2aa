"""A boat strategy: above one AUV. `usvauv eval --plugin boat_strategy.py --usv above:1`"""

import taichi as ti

from usvauv.extend.boat import BoatStrategy, Strategy, boat_strategies
from usvauv.extend.world import vec2


@ti.func
def above(worlds: ti.template(), w, b) -> vec2:
    k = ti.cast(worlds.strategy_arguments[0], ti.i32)
    return vec2(worlds.estimate.x[w, k], worlds.estimate.y[w, k])


def refuse(scenario, numbers):
    return "" if numbers[0] in range(scenario.auv.count) else f": the AUV must be from 0 to {scenario.auv.count - 1}"


boat_strategies.register("above", BoatStrategy(Strategy(start=above, goal=above), ("AUV",), refuse))
