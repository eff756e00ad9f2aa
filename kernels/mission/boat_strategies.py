"""Boat strategies: where the boat should be, from estimated positions only; functions (worlds, w) → vec2, m."""

import taichi as ti

from kernels.mission.columns import BoatColumn, EstimateColumn, Parameter
from kernels.mission.worlds import Strategy
from kernels.planning import global_search, objectives, receding_horizon
from kernels.types import vec2


@ti.func
def hold(worlds: ti.template(), w) -> vec2:
    """The point that the strategy was given."""
    return vec2(worlds.strategy_arguments[0], worlds.strategy_arguments[1])


@ti.func
def centroid(worlds: ti.template(), w) -> vec2:
    """Mean of the AUVs' positions."""
    num_auvs = worlds.estimate.shape[1]
    goal = vec2(0.0, 0.0)
    for k in range(num_auvs):
        goal += vec2(worlds.estimate[w, k, EstimateColumn.x], worlds.estimate[w, k, EstimateColumn.y]) / num_auvs
    return goal


@ti.func
def fim(worlds: ti.template(), w) -> vec2:
    """The place in the area with the best information."""
    best = global_search.plan(
        worlds.estimate,
        w,
        worlds.estimate.shape[1],
        worlds.link,
        worlds.program.objective_code,
        worlds.boat[w, BoatColumn.goal_x],
        worlds.boat[w, BoatColumn.goal_y],
        worlds.p[Parameter.width],
        worlds.p[Parameter.length],
    )
    return vec2(best[0], best[1])


@ti.func
def best_within(worlds: ti.template(), w, reach) -> vec2:
    """The place with the best information at most `reach` (m) from the boat."""
    best = global_search.greedy(
        worlds.estimate,
        w,
        worlds.estimate.shape[1],
        worlds.link,
        worlds.program.objective_code,
        worlds.boat[w, BoatColumn.x],
        worlds.boat[w, BoatColumn.y],
        reach,
        worlds.p[Parameter.width],
        worlds.p[Parameter.length],
    )
    return vec2(best[0], best[1])


@ti.func
def fim_greedy(worlds: ti.template(), w) -> vec2:
    """The place with the best information within reach of one step."""
    return best_within(worlds, w, worlds.p[Parameter.top_speed] * worlds.p[Parameter.step])


@ti.func
def fim_anywhere(worlds: ti.template(), w) -> vec2:
    """Where `fim_greedy` begins: the same search without a limit of its reach."""
    return best_within(worlds, w, global_search.ANYWHERE)


@ti.func
def fim_horizon(worlds: ti.template(), w) -> vec2:
    """The place that is best for the tracks over the steps to come."""
    p = ti.static(worlds.p)
    outlook = receding_horizon.Outlook(
        criterion=ti.static(objectives.objective_of(worlds.program.objective_code)),
        variance=p[Parameter.current_variance],
        correlation_time=p[Parameter.correlation_time],
        top_speed=p[Parameter.top_speed],
        step=p[Parameter.step],
        steps=ti.cast(p[Parameter.horizon], ti.i32),
    )
    here = vec2(worlds.boat[w, BoatColumn.x], worlds.boat[w, BoatColumn.y])
    last = vec2(worlds.boat[w, BoatColumn.goal_x], worlds.boat[w, BoatColumn.goal_y])
    best = receding_horizon.plan(
        worlds.track,
        worlds.estimate,
        w,
        worlds.link,
        outlook,
        here,
        last,
        p[Parameter.width],
        p[Parameter.length],
    )
    return vec2(best[0], best[1])


HOLD = Strategy(start=hold, goal=hold)
CENTROID = Strategy(start=centroid, goal=centroid)
FIM = Strategy(start=fim, goal=fim)
FIM_GREEDY = Strategy(start=fim_anywhere, goal=fim_greedy)
FIM_HORIZON = Strategy(start=fim, goal=fim_horizon)
