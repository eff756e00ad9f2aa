"""Boat strategies: where the boat should be, from estimated positions only; functions (worlds, w) → vec2, m."""

import taichi as ti

from kernels.mission import belief_planner
from kernels.mission.columns import BoatColumn, EstimateColumn, Parameter
from kernels.mission.worlds import Strategy
from kernels.planning import global_search, objectives, receding_horizon
from kernels.planning.team import Team
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
def visit(worlds: ti.template(), w) -> vec2:
    """Where the boat foresees the AUV that is least certain of its own position."""
    for k in range(worlds.estimate.shape[1]):
        belief_planner.foresee(worlds, w, k)
    return belief_planner.foreseen_place(worlds, w, belief_planner.least_certain(worlds, w))


@ti.func
def belief(worlds: ti.template(), w) -> vec2:
    """Where the AUVs' uncertainty of their own positions is expected to cost least."""
    for k in range(worlds.estimate.shape[1]):
        belief_planner.foresee(worlds, w, k)
    return belief_planner.go(worlds, w)


@ti.func
def begin_foresight(worlds: ti.template(), w) -> vec2:
    """Foresee all AUVs; the boat begins at their mean."""
    for k in range(worlds.estimate.shape[1]):
        belief_planner.begin(worlds, w, k)
    return centroid(worlds, w)


@ti.func
def fim(worlds: ti.template(), w) -> vec2:
    """The place in the area with the best information."""
    count = worlds.estimate.shape[1]
    team = ti.static(Team(worlds.estimate, worlds.link, w, count))
    size = vec2(worlds.p[Parameter.width], worlds.p[Parameter.length])
    last = vec2(worlds.boat[w, BoatColumn.goal_x], worlds.boat[w, BoatColumn.goal_y])
    best = global_search.plan(team, worlds.program.objective_code, last, size)
    return vec2(best[0], best[1])


@ti.func
def best_within(worlds: ti.template(), w, reach) -> vec2:
    """The place with the best information at most `reach` (m) from the boat."""
    count = worlds.estimate.shape[1]
    team = ti.static(Team(worlds.estimate, worlds.link, w, count))
    size = vec2(worlds.p[Parameter.width], worlds.p[Parameter.length])
    here = vec2(worlds.boat[w, BoatColumn.x], worlds.boat[w, BoatColumn.y])
    best = global_search.greedy(team, worlds.program.objective_code, here, reach, size)
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
    count = worlds.estimate.shape[1]
    team = ti.static(Team(worlds.estimate, worlds.link, w, count))
    best = receding_horizon.plan(team, worlds.track, outlook, here, last, vec2(p[Parameter.width], p[Parameter.length]))
    return vec2(best[0], best[1])


HOLD = Strategy(start=hold, goal=hold)
CENTROID = Strategy(start=centroid, goal=centroid)
VISIT = Strategy(start=begin_foresight, goal=visit, foresees=True)
BELIEF = Strategy(start=begin_foresight, goal=belief, foresees=True)
FIM = Strategy(start=fim, goal=fim)
FIM_GREEDY = Strategy(start=fim_anywhere, goal=fim_greedy)
FIM_HORIZON = Strategy(start=fim, goal=fim_horizon)
