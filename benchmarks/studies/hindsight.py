"""What could be had by better decisions: with rates known after one visit, and by plans that know everything.

    python -m benchmarks.studies.hindsight

First `rollout` where little is known, as it is; told the true rate of a node when an AUV serves it first; and knowing
everything. Between the first two lies what better estimates can bring.

Then, in still water, plans for whole missions by simulated annealing (Kirkpatrick, Gelatt and Vecchi, 1983, doi
10.1126/science.220.4598.671), which know all rates and backlogs: the order of nodes of each AUV that brings in the most
data in a kinematic model: straight ways at one speed, whole steps, expected arrivals. Annealing begins with what
`rollout` did there. The AUVs of the simulator then follow the plan; in still water, because a plan made beforehand
cannot wait for who is late. Its speed is the best of `SPEEDS` on other seeds. Annealing may miss the best plan, so that
this is no bound in the strict sense. Intervals are 95 %, differences paired by world.
"""

import argparse

import numba
import numpy as np
import taichi as ti

from benchmarks.machine import describe
from benchmarks.studies.table import head, interval, line
from usvauv import policies
from usvauv.env import Scenario, World
from usvauv.env.record.metrics import episode_metrics, served
from usvauv.env.record.recorder import record
from usvauv.env.record.trace import Trace
from usvauv.env.site.site import Site
from usvauv.env.world.mission_parameters import reference_rate
from usvauv.kernels.mission.columns import AuvColumn, NodeColumn
from usvauv.kernels.mission.target_rules import TargetRule, knowledge, rollout, target_rules

STOPS = 120  # nodes of an AUV in a plan
MOVES = 400_000  # of the annealing, in each world
HOT, COLD = 0.2, 0.002  # its first and last temperature, buffers
SPEEDS = (1.45, 1.55, 1.65, 1.75, 1.85)  # m/s
HORIZONS = (40, 90)  # s, of `rollout`
STILL = ("current.count=0", "sea.irregular_rms=0", "storm.spectrum=none")


@ti.func
def begin(worlds: ti.template(), w):
    """Each AUV is at the beginning of its plan."""
    for k in range(worlds.auv.shape[1]):
        worlds.workspace[w, k * (STOPS + 1)] = 0.0


@ti.func
def following(worlds: ti.template(), w, k):
    """The next node of the plan of AUV k."""
    counter = k * (STOPS + 1)
    stop = ti.cast(worlds.workspace[w, counter], ti.i32)
    worlds.workspace[w, counter] = ti.cast(ti.min(stop + 1, STOPS - 1), ti.f32)
    return ti.cast(worlds.workspace[w, counter + 1 + stop], ti.i32)


@ti.func
def told(worlds: ti.template(), w, k):
    """`rollout` by one who learns the true rate of a node with its first visit."""
    for i in range(worlds.node.shape[1]):
        b = knowledge.holder(worlds, k)
        if worlds.belief.since[w, b, i] > 0.0:
            worlds.belief.count[w, b, i] = worlds.node.rate[w, i] * knowledge.SURE
            worlds.belief.exposure[w, b, i] = knowledge.SURE
    return rollout.rollout(worlds, w, k)


target_rules.register("told", TargetRule(told, arguments=(("HORIZON", 90.0),), workspace=rollout.workspace))
target_rules.register("planned", TargetRule(following, prepare=begin, workspace=lambda _, auvs: auvs * (STOPS + 1)))


@numba.njit(cache=True)
def value(plan, start, nodes, rates, backlog, speed, radius, capacity, link, step, duration):
    """Data of a plan (K, STOPS) in a world, packets; `link` in packets/s."""
    auvs = len(start)
    at, free, stop = start.copy(), np.zeros(auvs), np.zeros(auvs, np.int64)
    held, since = backlog.copy(), np.zeros(len(nodes))
    total = 0.0
    while True:
        first, arrival = -1, duration
        for k in range(auvs):
            if stop[k] < plan.shape[1]:
                i = plan[k, stop[k]]
                way = np.hypot(nodes[i, 0] - at[k, 0], nodes[i, 1] - at[k, 1])
                there = free[k] + max(way - radius, 0.0) / speed
                if there < arrival:
                    first, arrival = k, there
        if first < 0:
            return total
        i = plan[first, stop[first]]
        arrival = step * np.ceil(arrival / step)
        taken = min(held[i] + rates[i] * (arrival - since[i]), capacity)
        done = arrival + step * max(np.ceil(taken / link / step), 1.0)
        if done > duration:
            stop[first] = plan.shape[1]
            continue
        total += taken
        held[i], since[i] = 0.0, arrival
        way = at[first] - nodes[i]
        at[first] = nodes[i] + way * min(
            radius / max(np.hypot(way[0], way[1]), 1e-9), 1.0
        )  # it hovers where it comes in
        free[first] = done
        stop[first] += 1


@numba.njit(cache=True)
def vary(plan, used, num_nodes):
    """Change a plan at random among its first `used` stops: replace, exchange, reverse, move, exchange ends."""
    auvs, stops = plan.shape
    kind = np.random.randint(5)
    a, b = np.random.randint(auvs), np.random.randint(auvs)
    i, j = np.random.randint(used), np.random.randint(used)
    if kind == 0:
        plan[a, i] = np.random.randint(num_nodes)
    elif kind == 1:
        plan[a, i], plan[b, j] = plan[b, j], plan[a, i]
    elif kind == 2:
        low, high = min(i, j), max(i, j)
        plan[a, low : high + 1] = plan[a, low : high + 1][::-1].copy()
    elif kind == 3:
        node = plan[a, i]
        plan[a, i : stops - 1] = plan[a, i + 1 :].copy()
        plan[b, j + 1 :] = plan[b, j : stops - 1].copy()
        plan[b, j] = node
    elif a != b:
        end = min(stops - i, stops - j)
        piece = plan[a, i : i + end].copy()
        plan[a, i : i + end] = plan[b, j : j + end]
        plan[b, j : j + end] = piece


@numba.njit(cache=True)
def anneal(plan, used, moves, seed, start, nodes, rates, backlog, speed, radius, capacity, link, step, duration):
    """The best plan that was found, and its data, packets."""
    np.random.seed(seed)
    model = (start, nodes, rates, backlog, speed, radius, capacity, link, step, duration)
    now = value(plan, *model)
    best, most = plan.copy(), now
    for move in range(moves):
        heat = HOT * (COLD / HOT) ** (move / moves) * capacity
        other = plan.copy()
        vary(other, used, len(nodes))
        then = value(other, *model)
        if then > now or np.random.random() < np.exp((then - now) / heat):
            plan, now = other, then
            if now > most:
                best, most = plan.copy(), now
    return best, most


def orders(trace: Trace) -> np.ndarray:
    """The nodes that each AUV served, (W, K, STOPS), and then some at random."""
    _, worlds, auvs = trace.target.shape
    plans = np.random.default_rng(0).integers(trace.backlog.shape[2], size=(worlds, auvs, STOPS))
    _, world, auv, node = served(trace)
    for w in range(worlds):
        for k in range(auvs):
            stops = node[(world == w) & (auv == k)][:STOPS]
            plans[w, k, : len(stops)] = stops
    return plans


def run(scenario: Scenario, rule: str, episodes: int, seed: int, plans: np.ndarray | None = None) -> Trace:
    """Episodes with a target rule, of the rule `planned` by plans (W, K, STOPS)."""
    world = World(scenario, episodes, seed, "centroid", rule)
    if plans is not None:
        world.rule_workspace.view(*plans.shape[:2], STOPS + 1)[..., 1:] = world.auv.new_tensor(plans)
    return record(world, policies.acting("pace", world), "pace")


def data(trace: Trace) -> np.ndarray:
    """Delivered, (W,), Mbit."""
    return np.array([row.delivered_mbit for row in episode_metrics(trace)])


def planned(scenario: Scenario, first: Trace, speed: float, moves: int) -> tuple[np.ndarray, np.ndarray]:
    """Plans (W, K, STOPS) for the worlds of a trace, and the data that the model expects, (W,), Mbit."""
    world = World(scenario, first.backlog.shape[1], first.seed, "centroid", "tour")
    world.reset()
    start = world.auv[..., AuvColumn.span("x", "y")].numpy().astype(float)
    node = world.node.numpy().astype(float)
    buffer, payload = float(scenario.nodes.buffer), scenario.nodes.payload
    link = reference_rate(Site(scenario)) * buffer / payload
    plans, expected = orders(first), []
    for w in range(len(plans)):
        used = int((first.service_rate[:, w] > 0).sum(0).max()) + 4
        plans[w], packets = anneal(
            plans[w], used, moves, w, start[w], node[w][:, NodeColumn.span("x", "y")], node[w][:, NodeColumn.rate],
            node[w][:, NodeColumn.backlog], speed, scenario.auv.hover_radius, buffer, link, scenario.mission.step,
            scenario.mission.duration,
        )  # fmt: skip
        expected.append(packets * payload / buffer)
    return plans, np.array(expected)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", default="survey")
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--moves", type=int, default=MOVES)
    parser.add_argument("--tuning-episodes", type=int, default=16)
    parser.add_argument("--tuning-seed", type=int, default=77)
    parser.add_argument("--part", choices=("estimates", "plans"), help="default both")
    arguments = parser.parse_args()
    episodes, seed = arguments.episodes, arguments.seed
    print(f"{describe()}; {episodes} paired episodes of {arguments.scenario}, seed {seed}\n")

    def row(name: str, values: np.ndarray, against: np.ndarray) -> None:
        line([name, interval(values), interval(values - against)])

    for known in () if arguments.part == "plans" else ("visits", "own-visits"):
        head([f"`{known}`", "Mbit", "gain"])
        for horizon in HORIZONS:
            scenario = Scenario.load(arguments.scenario, [f"nodes.information={known}"])
            all_known = Scenario.load(arguments.scenario, ["nodes.information=full"])
            as_it_is = data(run(scenario, f"rollout:{horizon}", episodes, seed))
            row(f"`rollout:{horizon}`", as_it_is, as_it_is)
            row("given the rates of nodes served", data(run(scenario, f"told:{horizon}", episodes, seed)), as_it_is)
            row("full information", data(run(all_known, f"rollout:{horizon}", episodes, seed)), as_it_is)
        print()
    if arguments.part == "estimates":
        return

    scenario = Scenario.load(arguments.scenario, ["nodes.information=full", *STILL])

    def found(first: Trace, seed: int, speed: float) -> tuple[np.ndarray, np.ndarray]:
        """Data that plans at a speed expect and bring in, (W,), Mbit."""
        plans, expected = planned(scenario, first, speed, arguments.moves)
        return expected, data(run(scenario, "planned", len(plans), seed, plans))

    rule = f"rollout:{HORIZONS[-1]}"
    first = run(scenario, rule, arguments.tuning_episodes, arguments.tuning_seed)
    tried = {speed: found(first, arguments.tuning_seed, speed)[1].mean() for speed in SPEEDS}
    speed = max(tried, key=tried.__getitem__)
    first, tour = run(scenario, rule, episodes, seed), run(scenario, "tour", episodes, seed)
    expected, brought = found(first, seed, speed)
    head([f"still water, plan at {speed:g} m/s", "Mbit", "minus the plan"])
    row("plan, followed", brought, brought)
    row("plan, its own prediction", expected, brought)
    row(f"`{rule}`, full information", data(first), brought)
    row("`tour`", data(tour), brought)


if __name__ == "__main__":
    main()
