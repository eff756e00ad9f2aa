"""Tours of nodes, rollouts of visits and what visits tell, beside NumPy: in an area that is not square.

The worlds are no mission's: arrays of random numbers with what the functions read.
"""

import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest
import taichi as ti
import torch

from tests.kernels.mission.stub import StubWorlds, unchanged
from usvauv.kernels.mission.columns import AuvColumn, BeliefColumn, EstimateColumn, Information, NodeColumn
from usvauv.kernels.mission.target_rules import knowledge, rollout, tour

WORLDS, AUVS, NODES = 40, 3, 17
WIDTH, LENGTH = 500.0, 200.0
NUMBERS = {
    "step": 2.0,
    "buffer": 500.0,
    "payload": 3.0,
    "reference_rate": 0.2,
    "reference_speed": 1.7,
    "hover_radius": 6.0,
    "start_backlog": 80.0,
    "rate_mean": 4.0,
    "rate_variance": 10.0,
}
PLACE = [NodeColumn.x, NodeColumn.y]
TOURED = [NodeColumn.tour, NodeColumn.successor, NodeColumn.owner]


def worlds_of(device: torch.device, nodes: int = NODES, seed: int = 1) -> StubWorlds:
    r = np.random.default_rng(seed)
    size = np.array([WIDTH, LENGTH])
    node = r.uniform(1, 9, (WORLDS, nodes, len(NodeColumn.names)))
    node[..., PLACE] = r.uniform(0, 1, (WORLDS, nodes, 2)) * size
    node[..., NodeColumn.backlog] = r.integers(0, 500, (WORLDS, nodes))
    node[..., NodeColumn.owner] = r.integers(0, AUVS, (WORLDS, nodes))
    auv = r.uniform(0, 1, (WORLDS, AUVS, len(AuvColumn.names)))
    auv[..., AuvColumn.target] = np.argsort(r.random((WORLDS, max(nodes, AUVS))), 1)[:, :AUVS] % nodes
    auv[: WORLDS // 8, :, AuvColumn.target] = -1
    auv[..., AuvColumn.hover] = r.choice([0.0, 20.0, 90.0], (WORLDS, AUVS))
    estimate = r.uniform(0, 1, (WORLDS, AUVS, len(EstimateColumn.names)))
    estimate[..., : EstimateColumn.y + 1] *= size
    belief = r.uniform(1, 9, (WORLDS, AUVS, nodes, len(BeliefColumn.names)))
    belief[..., BeliefColumn.since] = r.choice([0.0, 3.0, 7.0], belief.shape[:3])
    others = {
        "rule_numbers": np.array([60.0, 0.0]),
        "workspace": np.full((WORLDS, rollout.workspace(nodes, AUVS)), 7.0),
    }
    arrays = {"node": node, "auv": auv, "estimate": estimate, "belief": belief}
    return StubWorlds(device, NUMBERS, worlds=WORLDS, auvs=AUVS, nodes=nodes, **arrays, **others)


class Tour:
    """The tour of the nodes at some places, and how AUVs at others enter it."""

    def __init__(self, nodes: np.ndarray, auvs: np.ndarray) -> None:
        self.nodes, self.auvs = nodes, auvs
        left = list(range(1, len(nodes)))
        self.stops = [0]
        while left:  # the nearest one; nodes that were passed over change places with it
            nearest = min(range(len(left)), key=lambda i: self.apart(self.stops[-1], left[i]))
            left[0], left[nearest] = left[nearest], left[0]
            self.stops.append(left.pop(0))
        self.stops = self.shortened(self.stops)
        ways = [self.apart(a, b) for a, b in itertools.pairwise([*self.stops, self.stops[0]])]
        entries = []
        for first in range(len(nodes)):
            along = np.concatenate([[0.0], np.cumsum(np.roll(ways, -first))[:-1]])
            free, total, targets = list(range(len(auvs))), 0.0, {}
            for place, at in enumerate(along):
                due = at >= sum(ways) * len(targets) / len(auvs) or len(nodes) - place <= len(free)
                if free and due:
                    i = self.stops[(first + place) % len(nodes)]
                    k = min(free, key=lambda k: math.dist(auvs[k], nodes[i]))
                    free.remove(k)
                    targets[k] = i
                    total += math.dist(auvs[k], nodes[i])
            entries.append((total, first, targets))
        _, self.first, self.targets = min(entries, key=lambda entry: entry[0])

    def apart(self, i: int, j: int) -> float:
        return math.dist(self.nodes[i], self.nodes[j])

    def shortened(self, stops: list[int]) -> list[int]:
        """Exchanges of two edges, in the order of their places, until none shortens it."""
        count, again = len(stops), True
        while again:
            again = False
            for a, b in itertools.combinations(range(count), 2):
                i, after_i, j, after_j = stops[a], stops[(a + 1) % count], stops[b], stops[(b + 1) % count]
                now = self.apart(i, after_i) + self.apart(j, after_j)
                if b > a + 1 and self.apart(i, j) + self.apart(after_i, after_j) < now - tour.LEAST_GAIN:
                    stops[a + 1 : b + 1] = stops[a + 1 : b + 1][::-1]
                    again = True
        return stops

    def sectors(self) -> list[list[int]]:
        """The tour cut before each stop that an AUV enters, each part shortened again."""
        ring = self.stops[self.first :] + self.stops[: self.first]
        begins = sorted(ring.index(i) for i in self.targets.values())
        return [self.shortened(ring[a:b]) for a, b in itertools.pairwise([*begins, len(ring)])]


def successors(rings: list[list[int]], count: int) -> np.ndarray:
    found = np.zeros(count)
    for ring in rings:
        found[ring] = ring[1:] + ring[:1]
    return found


@pytest.mark.parametrize("nodes", [NODES, 4, 2])
def test_tours_and_sectors(device, nodes):
    """AUVs enter where the ways of all are shortest, each at a node of its own as far as there are any.

    A sector belongs to the AUV that enters there.
    """

    @ti.func
    def share(worlds: ti.template(), w):
        tour.share_nodes(worlds, w)

    made = worlds_of(device, nodes)
    before, after = made.numbers(), made.after(tour.prepare_tour)
    parts = worlds_of(device, nodes)
    divided, shared = parts.after(tour.prepare_sectors), worlds_of(device, nodes).after(share)
    right = 0
    for w in range(WORLDS):
        its = Tour(before["node"][w][:, PLACE], before["estimate"][w, :, : EstimateColumn.y + 1])
        targets = [its.targets.get(k, -1) for k in range(AUVS)]
        assert sum(target >= 0 for target in targets) == min(nodes, AUVS)
        rings = its.sectors()
        owner = np.zeros(nodes)
        for ring in rings:
            owner[ring] = targets.index(ring[0])
        right += (
            (after["node"][w, :, NodeColumn.tour] == its.stops).all()
            and (after["node"][w, :, NodeColumn.successor] == successors([its.stops], nodes)).all()
            and (after["auv"][w, :, AuvColumn.target] == targets).all()
            and (divided["auv"][w, :, AuvColumn.target] == targets).all()
            and (divided["node"][w, :, NodeColumn.successor] == successors(rings, nodes)).all()
            and (shared["node"][w, :, NodeColumn.owner] == owner).all()
            and (shared["auv"][w, :, AuvColumn.target] == -1).all()
        )
    assert right >= WORLDS - 1  # of a tie that rounding decides
    for each in (after, divided, shared):
        unchanged(each, before, {"node": TOURED, "auv": [AuvColumn.target]})


@pytest.mark.parametrize("information", [Information.full, Information.own_visits])
def test_an_auv_follows_its_tour_to_the_next_free_node(device, information):
    """Without communication it knows its own target only. In step 0 it goes to where it enters, if there is such."""

    @ti.func
    def follow(worlds: ti.template(), w):
        for k in range(AUVS):
            worlds.auv[w, k, AuvColumn.power] = tour.follow(worlds, w, k)

    made = worlds_of(device, 4)
    made.arrays["clock"][::2, 1] = 0
    target = made.arrays["auv"][..., AuvColumn.target]
    target[target < 0] = 1.0
    target[:4:2] = -1.0
    ring = np.array([np.random.default_rng(w).permutation(4) for w in range(WORLDS)])
    node = made.arrays["node"]
    for w in range(WORLDS):
        node[w, :, NodeColumn.successor] = torch.tensor(successors([ring[w].tolist()], 4)).to(node)
    before, after = made.numbers(), made.after(follow, SimpleNamespace(information=information))
    for w in range(WORLDS):
        targets = before["auv"][w, :, AuvColumn.target].astype(int)
        for k in range(AUVS):
            wanted = targets[k]
            if w % 2 == 0 and wanted < 0:
                wanted = k
            elif w % 2:
                taken = set(targets) if information == Information.full else {targets[k]}
                following = [int(before["node"][w, wanted, NodeColumn.successor])]
                while following[-1] in taken and len(following) < 4:
                    following.append(int(before["node"][w, following[-1], NodeColumn.successor]))
                wanted = following[-1]
            assert after["auv"][w, k, AuvColumn.power] == wanted
    unchanged(after, before, {"auv": [AuvColumn.power]})


class Known:
    """What AUV k of world w expects of the nodes."""

    def __init__(self, before: dict, w: int, k: int, information: int) -> None:
        self.node, self.information = before["node"][w], information
        alone = information == Information.own_visits
        belief = before["belief"][w, k if alone else 0]
        self.count, self.exposure, self.since, self.left = belief.T
        self.rates = self.node[:, NodeColumn.rate]
        if information > Information.rates:
            self.rates = self.count / self.exposure
        self.place = self.node[:, PLACE]
        self.auvs = before["estimate"][w, :, : EstimateColumn.y + 1]
        target = before["auv"][w, :, AuvColumn.target].astype(int)
        free = ~np.isin(np.arange(len(self.node)), [target[k]] if alone else target)
        self.open = free & ((self.node[:, NodeColumn.owner] == k) | (not alone))

    def packets(self, i: int, ahead: float) -> float:
        there = self.node[i, NodeColumn.backlog] + self.rates[i] * ahead
        if self.information != Information.full:
            there = self.left[i] + self.rates[i] * (14.0 - self.since[i] + ahead)  # step 7 of 2 s
        return min(there, 500.0)


def way(here: np.ndarray, there: np.ndarray) -> float:
    return max(math.dist(here, there) - 6.0, 0.0) / 1.7


def imagined(known: Known, auv: np.ndarray, k: int, first: int, alone: bool) -> float:
    """Packets of all services within three times 60 s, times exp(−t/60 s), if AUV k goes to a node first."""
    place, free = [*known.auvs], [0.0] * AUVS
    emptied: dict[int, float] = {}

    def there(i: int, t: float) -> float:
        if i not in emptied:
            return known.packets(i, t)
        return min(known.rates[i] * (t - emptied[i]), 500.0) if emptied[i] <= t else 0.0

    def serve(j: int, i: int) -> float:
        arrival = free[j] + way(place[j], known.place[i])
        taken = there(i, arrival)
        emptied[i], place[j] = arrival, known.place[i]
        free[j] = arrival + max(taken * 3.0 / 500.0 / 0.2, 2.0)
        return taken * math.exp(-free[j] / 60.0)

    total = 0.0
    for j in set(range(AUVS)) - {k}:
        target = int(auv[j, AuvColumn.target])
        if alone:
            free[j] = 180.0
        elif target >= 0 and auv[j, AuvColumn.hover] > 0:
            emptied[target], free[j] = 0.0, auv[j, AuvColumn.hover]
        elif target >= 0:
            total += serve(j, target)
    total += serve(k, first)
    mine = (known.node[:, NodeColumn.owner] == k) | (not alone)
    while min(free) < 180.0:
        j = free.index(min(free))
        times = [way(place[j], there) for there in known.place]
        values = [mine[i] * there(i, free[j] + time) / (time + rollout.OVERHEAD) for i, time in enumerate(times)]
        if max(values) > 0:
            total += serve(j, values.index(max(values)))
        else:
            free[j] = 180.0
    return total


@pytest.mark.parametrize(
    "information", [Information.full, Information.rates, Information.visits, Information.own_visits]
)
def test_rollouts(device, information):
    """What comes in after each of the nodes with the most data per time, of those that are free; the best is chosen."""

    @ti.func
    def choose(worlds: ti.template(), w):
        for k in range(1, 2):
            worlds.auv[w, k, AuvColumn.power] = rollout.rollout(worlds, w, k)

    made = worlds_of(device)
    before, after = made.numbers(), made.after(choose, SimpleNamespace(information=information))
    alone, k = information == Information.own_visits, 1
    right = 0
    for w in range(WORLDS):
        known = Known(before, w, k, information)
        times = [way(known.auvs[k], place) for place in known.place]
        values = [known.packets(i, time) / (time + rollout.OVERHEAD) for i, time in enumerate(times)]
        open_nodes = np.flatnonzero(known.open)
        tried = sorted(open_nodes, key=lambda i: -values[i])[: rollout.CANDIDATES]
        wanted = np.full(NODES, -1.0)
        for i in tried:
            wanted[i] = imagined(known, before["auv"][w], k, i, alone)
        found = after["workspace"][w, NODES + 3 * AUVS :]
        right += np.allclose(found, wanted, rtol=1e-3, atol=0.05)
        assert after["auv"][w, k, AuvColumn.power] == (found.argmax() if len(tried) else k)
    assert right >= 0.9 * WORLDS  # ways that take the same time may round apart
    unchanged(after, before, {"auv": [AuvColumn.power], "workspace": list(range(after["workspace"].shape[1]))})


def cut(count: float, exposure: float, low: float, high: float, ramp: float) -> tuple[float, float]:
    """Mean and variance of a Gamma distribution between two rates, where what was seen is likelier up to low + ramp."""
    wide = 15 * (math.sqrt(count) + 1) / exposure
    rates = np.linspace(max(low, 1e-9), min(high, count / exposure + wide), 20001)
    logarithm = (count - 1) * np.log(rates) - exposure * rates
    density = np.exp(logarithm - logarithm.max()) * (np.clip((rates - low) / ramp, 1e-6, 1) if ramp else 1.0)
    mean = np.average(rates, weights=density)
    return mean, np.average((rates - mean) ** 2, weights=density)


@pytest.mark.parametrize("information", [Information.visits, Information.own_visits])
def test_what_a_visit_tells(device, information):
    """What came in the time since the last one; from the start or a full buffer on only an interval of the rate."""

    @ti.func
    def learn(worlds: ti.template(), w):
        for i in range(NODES):
            knowledge.learn(worlds, w, 1, i, worlds.node[w, i, NodeColumn.backlog])

    made = worlds_of(device)
    r = np.random.default_rng(3)
    shape = WORLDS, AUVS, NODES
    count, since = r.choice([4.0, 30.0, 2e6], shape), r.choice([0.0, 3.0, 12.0], shape)
    rate = r.uniform(3, 30, shape)
    found = np.round(r.uniform(0.7, 1.3, shape)[:, 1] * rate[:, 1] * 12) + r.integers(0, 2, (WORLDS, NODES)) * 500
    belief, node = made.arrays["belief"], made.arrays["node"]
    for column, numbers in (("count", count), ("exposure", count / rate), ("since", since)):
        belief[..., getattr(BeliefColumn, column)] = torch.from_numpy(numbers).to(belief)
    node[..., NodeColumn.backlog] = torch.from_numpy(np.minimum(found, 500)).to(node)
    before, after = made.numbers(), made.after(learn, SimpleNamespace(information=information))
    b = 1 if information == Information.own_visits else 0
    checked = 0
    for w, i in np.ndindex(WORLDS, NODES):
        count, exposure, since, _ = before["belief"][w, b, i]
        now = before["node"][w, i, NodeColumn.backlog]
        new_count, new_exposure, visited, left = after["belief"][w, b, i]
        assert (visited, left) == (12.0, 0.0)
        waited, start, full = 12.0 - since, 80.0 if since == 0 else 0.0, now == 500
        if waited == 0 or (count > 1e6 and (start or full)):
            assert (new_count, new_exposure) == (count, exposure)
        elif not start and not full:
            assert new_count == pytest.approx(count + now, rel=1e-6)
            assert new_exposure == pytest.approx(exposure + waited, rel=1e-6)
        else:
            half = 0.5 * math.sqrt(start**2 + 12 * now + 1)
            low, high, ramp = max(now - 0.5 * start - half, 0), now - 0.5 * start + half, 0.0
            if full:
                low, high, ramp = now - start, math.inf, start
            mean, spread = count / exposure, math.sqrt(count) / exposure
            if abs(low / waited - mean) < 4 * spread and high / waited > mean - 4 * spread:
                mean, variance = cut(count, exposure, low / waited, high / waited, ramp / waited)
                assert new_count / new_exposure == pytest.approx(mean, rel=2e-3)
                assert new_count / new_exposure**2 == pytest.approx(variance, rel=3e-2)
                checked += 1
    assert checked > 100
    after["belief"][:, b] = before["belief"][:, b]
    unchanged(after, before, {})
