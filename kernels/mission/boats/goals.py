"""Goals of boats, by the names of their strategies: functions (worlds, w, b) → vec2, m, from estimated positions only.

A boat plans for the AUVs that it serves; without any it stays where it is.
"""

from collections.abc import Sequence
from typing import Any

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.mission.boats import belief_planner, boat_motion, foresight
from usvauv.kernels.mission.boats.boat_strategies import AGENT, HOLD, BoatStrategy, Strategy, boat_strategies
from usvauv.kernels.mission.boats.rollouts import NO_AUV
from usvauv.kernels.planning import search
from usvauv.kernels.planning.ascent import Region
from usvauv.kernels.planning.information import Team, indices
from usvauv.kernels.types import vec2

SEARCH_INTERVAL = 4.0  # s, in which AUVs move by some 10 m, and the highest maximum rarely becomes another


@func
def hold(worlds: ti.template(), w, b) -> vec2:
    """Stays at a point; several boats at one each, or all at the same."""
    first = 2 * b % worlds.strategy_arguments.shape[0]
    return vec2(worlds.strategy_arguments[first], worlds.strategy_arguments[first + 1])


@func
def centroid(worlds: ti.template(), w, b) -> vec2:
    """Goes to the mean of the estimated positions of its AUVs."""
    return boat_motion.centre_of_served(worlds, w, b)


@func
def visit(worlds: ti.template(), w, b) -> vec2:
    """Goes to the predicted position of the AUV that is least certain of its own position."""
    goal = boat_motion.boat_place(worlds, w, b)
    least = belief_planner.least_certain(worlds, w, b)
    if least != NO_AUV:
        goal = foresight.foreseen_place(worlds, w, ti.max(least, 0))
    return goal


@func
def belief(worlds: ti.template(), w, b) -> vec2:
    """Plans visits to its AUVs that keep them certain of their own positions, by rollouts of five minutes."""
    return belief_planner.go(worlds, w, b)


@func
def agent(worlds: ti.template(), w, b) -> vec2:
    """Is commanded by the actions given to `World.step(action, boat_action)`: to train boats from Python."""
    return boat_motion.goal_place(worlds, w, b)


@func
def begin_foresight(worlds: ti.template(), w, b) -> vec2:
    """Begin the prediction of all AUVs; the boat begins at the mean of its own."""
    for k in range(worlds.estimate.shape[1]):
        foresight.begin(worlds, w, k)
    return centroid(worlds, w, b)


@func
def members(worlds: ti.template(), w, b):
    """Indices of the AUVs that boat b serves, where there are several boats."""
    found = indices(0)
    if ti.static(worlds.program.fleet):
        count = 0
        for k in range(worlds.estimate.shape[1]):
            if boat_motion.serves(worlds, w, b, k):
                found[count] = k
                count += 1
    return found


def team_of(worlds, w, count, chosen) -> Team:
    """The AUVs that a boat serves: their number and indices."""
    return Team(worlds.estimate, worlds.link, w, count, chosen if worlds.program.fleet else None)


@func
def best_place(worlds: ti.template(), w, b, start: vec2, everywhere, reach, limited: ti.template()) -> vec2:
    """The place with the best information on the AUVs of boat b; if that is `limited` within `reach` of `start`, m.

    Unless the search is `everywhere`, it is the maximum uphill of `start`.
    """
    count = boat_motion.num_served(worlds, w, b)
    chosen = members(worlds, w, b)
    team = ti.static(team_of(worlds, w, count, chosen))
    size = vec2(worlds.p.width, worlds.p.length)
    goal = boat_motion.boat_place(worlds, w, b)
    if count > 0:
        region = ti.static(Region(size, start, reach, limited))
        best = search.search(team, worlds.program.objective_code, start, everywhere, region)
        goal = vec2(best[0], best[1])
    return goal


@func
def fim(worlds: ti.template(), w, b) -> vec2:
    """Goes to the place from which it can locate all its AUVs best, by their Fisher information.

    It searches everywhere once in `SEARCH_INTERVAL`, and follows the maximum of its goal in between.
    """
    interval = ti.max(ti.cast(SEARCH_INTERVAL / worlds.p.step + 0.5, ti.i32), 1)
    everywhere = worlds.clock[w, 1] % interval == 0
    return best_place(worlds, w, b, boat_motion.goal_place(worlds, w, b), everywhere, search.ANYWHERE, False)


@func
def fim_greedy(worlds: ti.template(), w, b) -> vec2:
    """The goal of `fim`, but only among places so near that the boat slows down towards them."""
    disc = boat_motion.reach(worlds, w, b)
    return best_place(worlds, w, b, vec2(disc[0], disc[1]), True, disc[2], True)


@func
def fim_anywhere(worlds: ti.template(), w, b) -> vec2:
    """Where `fim_greedy` begins: the same search without a limit of its reach."""
    return best_place(worlds, w, b, boat_motion.boat_place(worlds, w, b), True, search.ANYWHERE, True)


def _needs_reckoning(scenario: Any, numbers: Sequence[float]) -> str:
    if scenario.navigation.sensor == "none":
        return " foresees AUVs that reckon where they are and needs navigation.sensor to be ground or water"
    return ""


def _in_area(scenario: Any, numbers: Sequence[float]) -> str:
    if all(0 <= x <= scenario.area.width for x in numbers[::2]) and all(
        0 <= y <= scenario.area.length for y in numbers[1::2]
    ):
        return ""
    return f": the point must lie in the area [0, {scenario.area.width:g}] × [0, {scenario.area.length:g}]"


boat_strategies.register("fim", BoatStrategy(Strategy(start=fim, goal=fim)))
boat_strategies.register("fim-greedy", BoatStrategy(Strategy(start=fim_anywhere, goal=fim_greedy)))
boat_strategies.register("centroid", BoatStrategy(Strategy(start=centroid, goal=centroid)))
boat_strategies.register(
    "visit", BoatStrategy(Strategy(start=begin_foresight, goal=visit, foresees=True), refuse=_needs_reckoning)
)
boat_strategies.register(
    "belief",
    BoatStrategy(
        Strategy(start=begin_foresight, goal=belief, foresees=True, weigh=belief_planner.weigh),
        refuse=_needs_reckoning,
    ),
)
boat_strategies.register(
    AGENT, BoatStrategy(Strategy(start=begin_foresight, goal=agent, foresees=True), refuse=_needs_reckoning)
)
boat_strategies.register(
    "hold", BoatStrategy(Strategy(start=hold, goal=hold), refuse=_in_area, repeats=True, **HOLD._asdict())
)
