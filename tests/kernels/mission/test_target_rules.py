"""Target rules and what they know, against computations of their own in NumPy."""

import itertools
import math
from collections.abc import Iterator

import numpy as np
import pytest
import taichi as ti
import torch
from scipy.special import gammainc

from tests.kernels.mission.test_packets import steer
from tests.links import EVERY_STEP
from usvauv.env import Scenario, ScenarioError, World
from usvauv.env.site.site import Site
from usvauv.env.world.mission_parameters import reference_rate
from usvauv.kernels.mission.columns import AuvColumn, BeliefColumn, NodeColumn
from usvauv.kernels.mission.target_rules import knowledge
from usvauv.kernels.types import array2


@ti.kernel
def cut_each(given: array2, answer: array2):
    """`knowledge.cut` of each row."""
    for n in range(given.shape[0]):
        after = knowledge.cut(given[n, 0], given[n, 1], given[n, 2], given[n, 3], given[n, 4])
        answer[n, 0] = after[0]
        answer[n, 1] = after[1]


PLAIN = (*EVERY_STEP, "boat.strategy=centroid")  # no rule asks where the boat goes, and this one compiles fastest
CALM = (*PLAIN, "auv.count=3", "nodes.count=12")
VISITS = (*PLAIN, "nodes.information=visits")  # a tour is the same with them as without
CAPACITY, PAYLOAD = 5000.0, 2.0


class Seen:
    """A world as NumPy arrays of double precision."""

    def __init__(self, world: World) -> None:
        node, auv = world.node.double().cpu().numpy().copy(), world.auv.double().cpu().numpy().copy()
        self.place, self.rate = node[..., NodeColumn.span("x", "y")], node[..., NodeColumn.rate]
        self.backlog, self.successor = node[..., NodeColumn.backlog], node[..., NodeColumn.successor].astype(int)
        self.target, self.served = auv[..., AuvColumn.target].astype(int), auv[..., AuvColumn.service_rate] > 0
        self.hover = auv[..., AuvColumn.hover]
        self.position = world.estimate.double().cpu().numpy()[..., :2].copy()


def run(world: World, steps: int) -> Iterator[tuple[int, Seen, Seen]]:
    """Step number, the state before and the state after it."""
    world.reset()
    before = Seen(world)
    for number in range(1, steps + 1):
        world.step(steer(world))
        after = Seen(world)
        yield number, before, after
        before = after


def choices(world: World, steps: int) -> Iterator[tuple[int, int, set[int], Seen, int]]:
    """World, AUV, nodes that it may not take, the state as it was then, and the node taken, of every choice that no
    other AUV made in the same step.
    """
    for _, before, after in run(world, steps):
        for w, k in np.argwhere(after.served):
            if after.served[w].sum() == 1:
                taken = {*before.target[w].tolist(), *np.delete(after.target[w], k).tolist()}
                yield int(w), int(k), taken, after, int(after.target[w, k])


def to_nodes(seen: Seen, w: int, k: int) -> np.ndarray:
    return np.linalg.norm(seen.place[w] - seen.position[w, k], axis=1)


def greedy(scenario: Scenario, seen: Seen, w: int, k: int) -> np.ndarray:
    return seen.rate[w] * seen.backlog[w] / CAPACITY - 0.1 * to_nodes(seen, w, k)


def nearest(scenario: Scenario, seen: Seen, w: int, k: int) -> np.ndarray:
    return np.where(seen.backlog[w] >= 1000, 0, seen.backlog[w] - 1e6) - to_nodes(seen, w, k) * (
        seen.backlog[w] >= 1000
    )


def rate(scenario: Scenario, seen: Seen, w: int, k: int) -> np.ndarray:
    travel = np.maximum(to_nodes(seen, w, k) - 6, 0) / scenario.reference.straight_speed
    return np.minimum(seen.backlog[w] + seen.rate[w] * travel, CAPACITY) / (travel + 10)


def rollout(scenario: Scenario, seen: Seen, w: int, k: int, discount: float = 90.0) -> np.ndarray:
    """Packets of all services within three times `discount`, times exp(−t/discount), if AUV k went to each node next.

    All of the 12 nodes are tried.
    """
    speed, link = scenario.reference.straight_speed, reference_rate(Site(scenario))
    nodes, team = range(scenario.nodes.count), range(scenario.auv.count)

    def after(first: int) -> float:
        place, free = [*seen.position[w]], [0.0] * len(team)
        known = [(seen.backlog[w, i], 0.0) for i in nodes]  # packets at a time
        total = 0.0

        def there(i: int, t: float) -> float:
            packets, since = known[i]
            return 0.0 if since > t else min(packets + seen.rate[w, i] * (t - since), CAPACITY)

        def way(j: int, i: int) -> float:
            return max(math.dist(place[j], seen.place[w, i]) - 6, 0) / speed

        def serve(j: int, i: int) -> float:
            arrival = free[j] + way(j, i)
            taken = there(i, arrival)
            place[j], known[i] = seen.place[w, i], (0.0, arrival)
            free[j] = arrival + max(taken * PAYLOAD / CAPACITY / link, 1.0)
            return taken * math.exp(-free[j] / discount)

        for j in team:
            if j != k and seen.hover[w, j] > 0:
                known[seen.target[w, j]], free[j] = (0.0, 0.0), seen.hover[w, j]
            elif j != k:
                total += serve(j, seen.target[w, j])
        total += serve(k, first)
        while min(free) < 3 * discount:
            j = free.index(min(free))
            values = [there(i, free[j] + way(j, i)) / (way(j, i) + 10) for i in nodes]
            if max(values) > 0:
                total += serve(j, values.index(max(values)))
            else:
                free[j] = 3 * discount
        return total

    return np.array([after(first) for first in nodes])


@pytest.mark.parametrize(
    ("rule", "value"),
    [
        pytest.param("greedy:0.1", greedy, marks=pytest.mark.slow),
        pytest.param("nearest", nearest, marks=pytest.mark.slow),
        pytest.param("rate", rate, marks=pytest.mark.slow),
        ("rollout", rollout),
    ],
)
def test_choices(rule, value):
    world = World(Scenario.load("ideal", CALM), 8, seed=5, targets=rule)
    made = best = 0
    for w, k, taken, seen, chosen in choices(world, 200):
        values = value(world.scenario, seen, w, k)
        free = [i for i in range(12) if i not in taken]
        assert chosen in free
        made += 1
        most = max(values[free])
        best += values[chosen] >= most - 1e-5 * (1 + abs(most))
    assert made > 60
    assert best >= made - 1 if rule == "rollout" else best == made  # two ways that take the same time may round apart


def test_a_world_does_not_depend_on_those_beside_it():
    """`rollout` has numbers of its own for each world."""
    scenario = Scenario.load("ideal", CALM)
    many, one = (World(scenario, count, 9, targets="rollout", first_world=first) for count, first in ((4, 0), (1, 2)))
    for world in (many, one):
        world.reset()
        for _ in range(150):
            world.step(steer(world))
    assert torch.equal(many.auv[2], one.auv[0])
    assert torch.equal(many.node[2], one.node[0])


def cycles(successor: np.ndarray) -> list[list[int]]:
    left, found = set(range(len(successor))), []
    while left:
        here = [min(left)]
        while (following := int(successor[here[-1]])) != here[0]:
            here.append(following)
            assert len(here) <= len(successor)
        found.append(here)
        left -= set(here)
    return found


def length(place: np.ndarray, stops: list[int]) -> float:
    return sum(math.dist(place[a], place[b]) for a, b in itertools.pairwise([*stops, stops[0]]))


def improvable(place: np.ndarray, stops: list[int]) -> bool:
    """Whether turning a part of the tour around makes it shorter."""
    own = length(place, stops)
    for a in range(1, len(stops)):
        for b in range(a + 1, len(stops)):
            turned = stops[:a] + stops[a : b + 1][::-1] + stops[b + 1 :]
            if length(place, turned) < own - 0.01:
                return True
    return False


class TestTour:
    def test_is_near_the_shortest_of_all(self):
        world = World(Scenario.load("ideal", [*VISITS, "nodes.count=7"]), 8, seed=2, targets="tour")
        world.reset()
        seen = Seen(world)
        ratios = []
        for w in range(8):
            (stops,) = cycles(seen.successor[w])
            shortest = min(length(seen.place[w], [0, *rest]) for rest in itertools.permutations(range(1, 7)))
            ratios.append(length(seen.place[w], stops) / shortest)
        assert min(ratios) > 1 - 1e-6
        assert np.mean(ratios) < 1.02

    def test_cannot_be_improved_and_auvs_enter_it_evenly_spaced_and_follow_it(self):
        world = World(Scenario.load("ideal", [*VISITS, "auv.count=3"]), 6, seed=2, targets="tour")
        world.reset()
        seen = Seen(world)
        for w in range(6):
            (stops,) = cycles(seen.successor[w])
            assert sorted(stops) == list(range(30))
            assert not improvable(seen.place[w], stops)
            whole, longest = length(seen.place[w], stops), 0.0
            along = dict.fromkeys(stops, 0.0)
            for a, b in itertools.pairwise(stops):
                along[b] = along[a] + math.dist(seen.place[w, a], seen.place[w, b])
                longest = max(longest, along[b] - along[a])
            longest = max(longest, whole - along[stops[-1]])
            entries = sorted(along[i] for i in seen.target[w])
            gaps = np.diff([*entries, entries[0] + whole])
            assert np.abs(gaps - whole / 3).max() < longest
        followed = 0
        for _, before, after in run(world, 250):
            for w, k in np.argwhere(after.served):
                expected = before.successor[w, before.target[w, k]]
                if expected not in np.delete(after.target[w], k):
                    assert after.target[w, k] == expected
                    followed += 1
        assert followed > 50

    def test_sectors_are_tours_of_their_own(self):
        world = World(Scenario.load("ideal", [*VISITS, "auv.count=3"]), 6, seed=2, targets="sectors")
        world.reset()
        first = Seen(world)
        for w in range(6):
            parts = cycles(first.successor[w])
            assert sorted(itertools.chain(*parts)) == list(range(30))
            assert len(parts) == 3
            assert not any(improvable(first.place[w], part) for part in parts)
            assert all(len(set(part) & {*first.target[w].tolist()}) == 1 for part in parts)
        for _, before, after in run(world, 250):
            for w in range(6):
                for part in cycles(before.successor[w]):
                    assert len(set(part) & {*after.target[w].tolist()}) == 1

    @pytest.mark.parametrize(
        ("rule", "nodes", "changes"),
        [
            ("tour", 1, VISITS),
            ("tour", 3, VISITS),
            ("sectors", 2, VISITS),
            ("rollout", 1, PLAIN),
        ],
    )
    def test_fewer_nodes_than_auvs(self, rule, nodes, changes):
        scenario = Scenario.load("ideal", [*changes, "auv.count=4", f"nodes.count={nodes}"])
        for _, _before, after in run(World(scenario, 2, targets=rule), 120):
            assert after.target.min() >= 0
            assert after.target.max() < nodes


class TestKnowledge:
    def test_estimates(self):
        """Counts and exposures from what every visit found, as NumPy adds them up."""
        overrides = [*VISITS, "nodes.start_backlog=0", "nodes.arrival_rates=[1,2,9]"]
        world = World(Scenario.load("ideal", overrides), 4, seed=1, targets="tour")
        mean, variance = 4.0, 38 / 3
        count, exposure = np.full((4, 30), mean**2 / variance), np.full((4, 30), mean / variance)
        last, weights = np.zeros((4, 30)), 0
        for number, before, after in run(world, 400):
            for w, k in np.argwhere((before.hover == 0) & (after.hover > 0)):
                i = after.target[w, k]
                count[w, i] += world.auv[w, k, AuvColumn.cargo]
                exposure[w, i] += number - 1 - last[w, i]  # the packets of this step are still to come
                last[w, i] = number - 1
                weights += 1
        assert weights > 50
        belief = world.belief[:, 0].double().cpu().numpy()
        np.testing.assert_allclose(belief[..., BeliefColumn.count], count, rtol=1e-4)
        np.testing.assert_allclose(belief[..., BeliefColumn.exposure], exposure, rtol=1e-4)
        np.testing.assert_allclose(belief[..., BeliefColumn.since], last)

    @pytest.mark.parametrize("start", [0, 1000])
    def test_errors_are_as_large_as_they_say(self, start):
        """(λ − its estimate) over its standard deviation has a variance of 1, also where nodes begin with packets."""
        overrides = [*VISITS, f"nodes.start_backlog={start}", "mission.duration=600"]
        world = World(Scenario.load("ideal", overrides), 64, seed=3, targets="tour")
        for _ in run(world, 600):
            pass
        belief = world.belief[:, 0].double().cpu().numpy()
        visited = belief[..., BeliefColumn.since] > 0
        count, exposure = belief[visited, BeliefColumn.count], belief[visited, BeliefColumn.exposure]
        error = (world.node[..., NodeColumn.rate].cpu().numpy()[visited] - count / exposure) / (
            np.sqrt(count) / exposure
        )
        assert visited.mean() > 0.6
        assert abs(error.mean()) < 0.15
        assert 0.8 < error.std() < 1.25

    @pytest.mark.parametrize("buffer", [5000, 2000])
    def test_first_visits_and_full_buffers(self, buffer):
        """Mean and deviation after every visit, against the posterior by its likelihood on a fine grid of rates.

        What was there at the start is uniform from 0 to S packets; a full buffer says that at least C came.
        """
        overrides = [*VISITS, "nodes.arrival_rates=[1,1,2,30]", f"nodes.buffer={buffer}", "auv.count=4"]
        world = World(Scenario.load("ideal", overrides), 8, seed=1, targets="tour")
        world.reset()
        known = world.belief[:, 0].double().cpu().numpy().copy()
        world.rewind()
        first, full, errors = 0, 0, []
        for number, before, after in run(world, 300):
            for w, k in np.argwhere((before.hover == 0) & (after.hover > 0)):
                i, found = after.target[w, k], float(world.auv[w, k, AuvColumn.cargo])
                count, exposure, since, _ = known[w, i]
                waited, start = number - 1 - since, 1000 if since == 0 else 0
                if waited > 0 and (start or found == buffer):
                    spread = math.sqrt(count) / exposure
                    rates = np.linspace(0.0, 1.0, 5001)[1:] ** 2 * (count / exposure + 40 * (spread + 1 / exposure))
                    arrivals = rates * waited
                    if found < buffer:  # from found − start to found have come
                        likelihood = gammainc(max(found - start, 1e-9), arrivals) - gammainc(found + 1, arrivals)
                    else:
                        least = found - (np.arange(100) + 0.5) / 100 * start
                        likelihood = np.mean([gammainc(n, arrivals) for n in least], axis=0)
                    logarithm = (count - 0.5) * np.log(rates) - exposure * rates  # one half: steps grow as their root
                    density = likelihood * np.exp(logarithm - logarithm[likelihood > 0].max())
                    mean = np.average(rates, weights=density)
                    deviation = math.sqrt(np.average((rates - mean) ** 2, weights=density))
                    now = world.belief[w, 0, i].double().cpu().numpy()
                    errors.append((now[0] / now[1] / mean - 1, math.sqrt(now[0]) / now[1] / deviation - 1))
                    first += start > 0
                    full += found == buffer
            known = world.belief[:, 0].double().cpu().numpy().copy()
        assert first > 100
        assert full > 20 or buffer == 5000
        mean, deviation = np.abs(errors).T
        assert np.quantile(mean, 0.9) < 0.02
        assert np.quantile(deviation, 0.9) < 0.04
        assert max(mean.max(), deviation.max()) < 0.2

    def test_any_interval_leaves_a_distribution(self, device):
        """Also one that contradicts what was held, or is narrower than single precision."""
        r = np.random.default_rng(1)
        n = 200_000
        count, exposure = 10 ** r.uniform(-6, 6, n), 10 ** r.uniform(-5, 6, n)
        low = np.where(r.random(n) < 0.3, 0.0, 10 ** r.uniform(-4, 5, n))
        high = np.where(r.random(n) < 0.3, np.inf, low * (1 + 10 ** r.uniform(-4, 3, n)) + 1e-4)
        ramp = np.where(r.random(n) < 0.5, 0.0, 10 ** r.uniform(-4, 4, n))
        given = torch.tensor(np.stack([count, exposure, low, high, ramp], 1), dtype=torch.float32, device=device)
        answer = torch.empty((n, 2), dtype=torch.float32, device=device)
        cut_each(given, answer)
        mean = (answer[:, 0] / answer[:, 1]).cpu().numpy()
        assert torch.isfinite(answer).all()
        assert (answer > 0).all()
        assert (mean >= low * (1 - 1e-3)).all()
        assert (mean <= high * (1 + 1e-3)).all()

    @pytest.mark.slow
    def test_with_rates_known_backlogs_are_expected_without_bias(self):
        world = World(Scenario.load("ideal", [*PLAIN, "nodes.information=rates"]), 32, seed=4, targets="rate")
        for _ in run(world, 300):
            pass
        belief = world.belief[:, 0]
        rates = world.node[..., NodeColumn.rate]
        waited = 300 - belief[..., BeliefColumn.since]
        expected = (belief[..., BeliefColumn.left] + rates * waited).clamp_max(CAPACITY)
        error = (world.node[..., NodeColumn.backlog] - expected).double()
        never = error[belief[..., BeliefColumn.since] == 0]
        assert abs(never.mean()) < 4 * never.std() / math.sqrt(len(never))
        assert never.std() == pytest.approx(1000 / math.sqrt(12), rel=0.1)
        served = torch.zeros_like(waited).scatter_(
            1, world.auv[..., AuvColumn.target].long(), (world.auv[..., AuvColumn.hover] > 0).float()
        )
        visited = (belief[..., BeliefColumn.since] > 0) & (served == 0)  # packets are taken when a service ends
        noise = (error / (rates * waited).clamp_min(1.0).sqrt())[visited]
        assert 0.9 < noise.std() < 1.1  # that of a Poisson number

    @pytest.mark.slow
    def test_without_communication_each_knows_its_own_visits(self):
        overrides = [*PLAIN, "nodes.information=own-visits", "nodes.count=20", "auv.count=2"]
        world = World(Scenario.load("ideal", overrides), 4, seed=2, targets="rollout")
        visits = np.zeros((4, 2, 20), bool)
        for _, before, after in run(world, 300):
            for w, k in np.argwhere((before.hover == 0) & (after.hover > 0)):
                visits[w, k, after.target[w, k]] = True
        assert ((world.belief[..., BeliefColumn.since] > 0).cpu().numpy() == visits).all()
        assert not (visits[:, 0] == visits[:, 1]).all()

    @pytest.mark.slow
    @pytest.mark.parametrize("rule", ["greedy", "nearest", "rate", "rollout"])
    def test_without_communication_each_keeps_to_its_sector(self, rule):
        """Sectors are the cycles of the rule `sectors`; they do not depend on the rule."""
        changes = [*VISITS, "auv.count=3"]
        sectors = World(Scenario.load("ideal", changes), 6, seed=2, targets="sectors")
        world = World(Scenario.load("ideal", [*changes, "nodes.information=own-visits"]), 6, seed=2, targets=rule)
        sectors.reset()
        owner = np.zeros((6, 30), int)
        for w in range(6):
            parts = cycles(sectors.node[w, :, NodeColumn.successor].long().cpu().numpy())
            for k in range(3):
                (mine,) = (part for part in parts if int(sectors.auv[w, k, AuvColumn.target]) in part)
                owner[w, list(mine)] = k
        chosen = [set() for _ in range(18)]
        for _, _before, after in run(world, 250):
            for w in range(6):
                for k in range(3):
                    assert owner[w, after.target[w, k]] == k
                    chosen[3 * w + k].add(int(after.target[w, k]))
        assert min(map(len, chosen)) > 1


class TestNames:
    @pytest.mark.parametrize(
        ("text", "allowed"),
        [
            ("far", "greedy[:ALPHA], nearest[:PACKETS]"),
            ("greedy:much", "greedy[:ALPHA] with numbers from 0"),
            ("greedy:1,2", "greedy[:ALPHA]"),
            ("greedy:-1", "from 0 to 1e+06"),
            ("rate:nan", "rate[:SECONDS]"),
            ("tour:3", "expected tour"),
            ("rate:", "rate[:SECONDS]"),
            ("learned:mine.json", "'learned:mine.json': was removed in 0.4"),
        ],
    )
    def test_refused(self, text, allowed):
        with pytest.raises(ScenarioError, match=r"nodes\.target_rule") as refused:
            World(Scenario.load("ideal", EVERY_STEP), targets=text)
        assert allowed in str(refused.value)
