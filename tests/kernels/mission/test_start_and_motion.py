"""How an episode begins, how AUVs and boats move, and what it earns: in an area that is not square, beside NumPy."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import taichi as ti
import torch
from scipy import stats

from tests.kernels.mission.stub import StubWorlds, unchanged
from usvauv.kernels.flow.vortex import Vortex
from usvauv.kernels.mission import boat, motion, observation, reset, rewards
from usvauv.kernels.mission.columns import (
    AuvColumn,
    BeliefColumn,
    BoatColumn,
    EstimateColumn,
    Information,
    NodeColumn,
    Sensor,
    TallyColumn,
)
from usvauv.kernels.mission.poisson_table import table
from usvauv.kernels.mission.tasks import data_collection, station_keeping
from usvauv.kernels.mission.vehicle import hovering_power, travelling_power
from usvauv.kernels.positioning import tracker

WIDTH, LENGTH = 300.0, 120.0
AREA = {"width": WIDTH, "length": LENGTH, "diagonal": math.hypot(WIDTH, LENGTH), "step": 0.5}
MANY = 3000
RATES = [1.0, 4.0, 30.0]


def is_uniform(values: np.ndarray, low: float, high: float) -> bool:
    """By Kolmogorov's and Smirnov's test."""
    return (
        low <= values.min()
        and values.max() <= high
        and stats.kstest(values.ravel(), "uniform", (low, high - low)).pvalue > 1e-4
    )


class TestStart:
    @pytest.mark.parametrize("information", [Information.full, Information.visits])
    def test_nodes(self, device, information):
        """Uniform within the margin, each of one kind, with a whole backlog; of what is known only the mean rate."""
        numbers = {
            **AREA,
            "node_margin": 15.0,
            "start_backlog": 6.0,
            "rate_mean": 35 / 3,
            "rate_variance": np.var(RATES),
        }
        made = StubWorlds(device, numbers, worlds=MANY, auvs=1, nodes=3, arrivals=table(RATES, 0.5))
        made.arrays["node"][:] = 9.0
        after = made.after(data_collection.place_nodes, SimpleNamespace(information=information))
        node, belief = after["node"], after["belief"]
        assert is_uniform(node[..., NodeColumn.x], 15, WIDTH - 15)
        assert is_uniform(node[..., NodeColumn.y], 15, LENGTH - 15)
        kinds, counts = np.unique(node[..., NodeColumn.kind], return_counts=True)
        assert kinds.tolist() == [0, 1, 2]
        assert stats.chisquare(counts).pvalue > 1e-4
        np.testing.assert_array_equal(
            node[..., NodeColumn.rate], np.array(RATES)[node[..., NodeColumn.kind].astype(int)]
        )
        backlogs, counts = np.unique(node[..., NodeColumn.backlog], return_counts=True)
        assert backlogs.tolist() == list(range(7))
        assert stats.chisquare(counts).pvalue > 1e-4
        together = np.corrcoef(
            node[..., [NodeColumn.x, NodeColumn.y, NodeColumn.kind, NodeColumn.backlog]].reshape(-1, 4).T
        )
        assert np.abs(together - np.eye(4)).max() < 0.05
        assert (node[..., [NodeColumn.tour, NodeColumn.successor, NodeColumn.owner]] == 0).all()
        count, exposure = belief[..., BeliefColumn.count], belief[..., BeliefColumn.exposure]
        np.testing.assert_allclose(count / exposure, 35 / 3, rtol=1e-5)
        np.testing.assert_allclose(count / exposure**2, np.var(RATES), rtol=1e-5)
        assert (belief[..., BeliefColumn.since] == 0).all()
        assert (belief[..., BeliefColumn.left] == 3).all()

    def test_auvs(self, device):
        """Uniform within the margin but for those of a lower index, from which each keeps away."""

        @ti.func
        def place(worlds: ti.template(), w):
            for k in range(worlds.auv.shape[1]):
                reset.place_auv(worlds, w, k)
                reset.begin_estimate(worlds, w, k)

        numbers = {**AREA, "start_margin": 10.0, "start_separation": 35.0, "separation_boat": 90.0}
        made = StubWorlds(device, numbers, worlds=MANY, auvs=3)
        made.arrays["auv"][:] = made.arrays["estimate"][:] = 9.0
        after = made.after(place)
        auv, estimate = after["auv"], after["estimate"]
        places = auv[..., [AuvColumn.x, AuvColumn.y]]
        assert is_uniform(places[:, 0, 0], 10, WIDTH - 10)
        assert is_uniform(places[:, 0, 1], 10, LENGTH - 10)
        assert places[..., 0].max() > WIDTH - 11
        assert places[..., 1].max() > LENGTH - 11
        apart = np.linalg.norm(places[:, [0, 0, 1]] - places[:, [1, 2, 2]], axis=-1)
        assert 35 <= apart.min() < 36
        assert (auv[..., AuvColumn.target] == -1).all()
        assert (np.delete(auv, [AuvColumn.x, AuvColumn.y, AuvColumn.target], -1) == 0).all()
        wanted = np.zeros_like(estimate)
        wanted[..., [EstimateColumn.x, EstimateColumn.y]] = places
        wanted[..., EstimateColumn.separation] = 90.0
        np.testing.assert_array_equal(estimate, wanted)

    def test_auvs_that_find_no_room_begin_anywhere(self, device):
        numbers = {**AREA, "start_margin": 10.0, "start_separation": 1000.0}

        @ti.func
        def place(worlds: ti.template(), w):
            for k in range(worlds.auv.shape[1]):
                reset.place_auv(worlds, w, k)

        auv = StubWorlds(device, numbers, worlds=50, auvs=2).after(place)["auv"]
        assert is_uniform(auv[:, 1, AuvColumn.x], 10, WIDTH - 10)
        assert is_uniform(auv[:, 1, AuvColumn.y], 10, LENGTH - 10)

    def test_stations(self, device):
        """On a circle about the middle, evenly, turned by any angle."""
        made = StubWorlds(device, {**AREA, "formation_radius": 40.0}, worlds=MANY, auvs=1, nodes=5)
        made.arrays["node"][:] = 9.0
        node = made.after(station_keeping.place_stations)["node"]
        x, y = node[..., NodeColumn.x] - WIDTH / 2, node[..., NodeColumn.y] - LENGTH / 2
        np.testing.assert_allclose(np.hypot(x, y), 40, rtol=1e-4)
        angle = np.arctan2(y, x)
        np.testing.assert_allclose(np.diff(angle) % (2 * math.pi), 2 * math.pi / 5, atol=1e-4)
        assert is_uniform(angle[:, 0], -math.pi, math.pi)
        rest = [NodeColumn.kind, NodeColumn.rate, NodeColumn.backlog, NodeColumn.tour, NodeColumn.successor]
        assert (node[..., rest] == 0).all()

    @pytest.mark.parametrize(("drawn", "alternate"), [(True, True), (True, False), (False, True), (False, False)])
    def test_vortices(self, device, drawn, alternate):
        """Drawn anywhere with numbers between their limits, or where they are given; either way of either sign."""
        limits = {"circulation_min": 5.0, "circulation_max": 9.0, "core_radius_min": 20.0, "core_radius_max": 50.0}
        numbers = {**AREA, **limits, "random_vortices": float(drawn), "alternate": float(alternate)}
        made = StubWorlds(device, numbers, worlds=MANY, auvs=1).arrays
        fixed = torch.tensor([[10.0, 20.0, 7.0, 30.0], [250.0, 90.0, 8.0, 40.0]], device=device)
        vortex = torch.zeros((MANY, 2, 4), device=device)
        reset.draw_vortices(made["p"], fixed, made["key"], made["clock"], vortex)
        found = vortex.double().cpu().numpy()
        Gamma = found[..., Vortex.Gamma]
        assert abs((Gamma > 0).mean() - (0.5 if alternate else 1.0)) < 0.03
        assert not alternate or abs(np.corrcoef(np.sign(Gamma).T)[0, 1]) < 0.08
        found[..., Vortex.Gamma] = np.abs(Gamma)
        if not drawn:
            np.testing.assert_array_equal(found, np.broadcast_to(fixed.cpu(), found.shape))
            return
        for column, low, high in (
            (Vortex.x, 0, WIDTH),
            (Vortex.y, 0, LENGTH),
            (Vortex.Gamma, 5, 9),
            (Vortex.delta, 20, 50),
        ):
            assert is_uniform(found[..., column], low, high)
        assert np.abs(np.corrcoef(found.reshape(-1, 4).T) - np.eye(4)).max() < 0.06


class TestMotion:
    @pytest.mark.parametrize("refused_hovers", [False, True])
    def test_an_auv_goes_with_the_water_unless_it_would_leave(self, device, refused_hovers):
        """Speed through the water within its limits in the action's direction; power by that, or for holding."""

        @ti.func
        def go(worlds: ti.template(), w):
            motion.travel(worlds, w, 0, worlds.tally[w, 0], worlds.tally[w, 1])

        r = np.random.default_rng(1)
        numbers = {**AREA, "speed_min": 1.0, "speed_max": 2.0, "refused_hovers": float(refused_hovers)}
        made = StubWorlds(device, numbers, worlds=400, auvs=1)
        auv, tally = np.zeros((400, 1, len(AuvColumn.names))), np.zeros((400, len(TallyColumn.names)))
        near = r.integers(0, 2, (2, 400))
        auv[:, 0, AuvColumn.x] = np.where(near[0], r.uniform(0, 1, 400), r.uniform(WIDTH - 1, WIDTH, 400))
        auv[:, 0, AuvColumn.y] = np.where(near[1], r.uniform(0, 1, 400), r.uniform(LENGTH - 1, LENGTH, 400))
        auv[:, 0, [AuvColumn.current_x, AuvColumn.current_y]] = r.uniform(-1, 1, (400, 2)) * [0.5, 3.0]
        action = tally[:, :2] = r.uniform(-0.9, 0.9, (400, 2))
        for name, array in (("auv", auv), ("tally", tally)):
            made.arrays[name][:] = torch.from_numpy(array)
        before, after = made.numbers(), made.after(go)
        norm = np.linalg.norm(action, axis=1, keepdims=True)
        velocity = action / norm * np.clip(2 * norm, 1, 2)
        old, new = before["auv"][:, 0], after["auv"][:, 0]
        current = old[:, [AuvColumn.current_x, AuvColumn.current_y]]
        moved = 0.5 * (velocity + current)
        place = old[:, : AuvColumn.y + 1] + moved
        inside = ((place >= 0) & (place <= [WIDTH, LENGTH])).all(1)
        assert 100 < inside.sum() < 300
        np.testing.assert_allclose(new[:, [AuvColumn.water_x, AuvColumn.water_y]], velocity, atol=1e-6)
        np.testing.assert_allclose(
            new[:, : AuvColumn.y + 1], np.where(inside[:, None], place, old[:, : AuvColumn.y + 1]), atol=1e-4
        )
        np.testing.assert_allclose(
            new[:, [AuvColumn.moved_x, AuvColumn.moved_y]], np.where(inside[:, None], moved, 0), atol=1e-4
        )
        np.testing.assert_array_equal(new[:, AuvColumn.border], ~inside)
        power = np.array([travelling_power(speed) for speed in np.linalg.norm(velocity, axis=1)])
        if refused_hovers:
            holding = np.array([hovering_power(speed) for speed in np.linalg.norm(current, axis=1)])
            power = np.where(inside, power, holding)
        np.testing.assert_allclose(new[:, AuvColumn.power], power, rtol=1e-4)

    def test_what_was_done_is_cleared(self, device):
        @ti.func
        def clear(worlds: ti.template(), w):
            motion.clear_last_step(worlds, w, 1)

        made = StubWorlds(device, AREA, worlds=2, auvs=3)
        made.arrays["auv"][:] = 9.0
        names = ("moved_x", "moved_y", "border", "service_rate", "delivered", "packets_delivered", "hovering")
        columns = [getattr(AuvColumn, name) for name in names]
        before, after = made.numbers(), made.after(clear)
        assert (after["auv"][:, 1, columns] == 0).all()
        after["auv"][:, 1, columns] = 9.0
        unchanged(after, before, {})

    def test_distances(self, device):
        """To the target, whose index may be wrong, and between AUVs."""

        @ti.func
        def measure(worlds: ti.template(), w):
            for k in range(3):
                worlds.auv[w, k, AuvColumn.closed] = motion.distance_to_target(worlds, w, k)
                worlds.auv[w, k, AuvColumn.power] = motion.distance_between(worlds, w, (k + 1) % 3, k)

        r = np.random.default_rng(2)
        auv, node = r.uniform(0, 300, (5, 3, len(AuvColumn.names))), r.uniform(0, 300, (5, 4, len(NodeColumn.names)))
        auv[..., AuvColumn.target] = [[0, 3, 2], [1, 4, -1], [3, 9, -7], [2, 2, 1], [0, 1, 3]]
        after = StubWorlds(device, AREA, worlds=5, auvs=3, nodes=4, auv=auv, node=node).after(measure)["auv"]
        target = np.clip(auv[..., AuvColumn.target], 0, 3).astype(int)
        there = np.take_along_axis(node[..., : NodeColumn.y + 1], target[..., None], 1)
        here = auv[..., : AuvColumn.y + 1]
        np.testing.assert_allclose(after[..., AuvColumn.closed], np.linalg.norm(there - here, axis=-1), rtol=1e-5)
        apart = np.linalg.norm(here - np.roll(here, -1, 1), axis=-1)
        np.testing.assert_allclose(after[..., AuvColumn.power], apart, rtol=1e-5)


class TestBoat:
    def boats(self, device, **changes: float) -> StubWorlds:
        r = np.random.default_rng(3)
        numbers = {**AREA, "top_speed": 4.0, "drifts": 1.0, **changes}
        rows = np.zeros((200, 2, len(BoatColumn.names)))
        rows[..., : BoatColumn.y + 1] = r.uniform(0, 1, (200, 2, 2)) * [WIDTH, LENGTH]
        rows[..., [BoatColumn.current_x, BoatColumn.current_y]] = r.uniform(-3, 3, (200, 2, 2))
        rows[::4, :, BoatColumn.x] = r.choice([0.5, WIDTH - 0.5], (50, 2))
        rows[::3, :, BoatColumn.y] = r.choice([0.5, LENGTH - 0.5], (67, 2))
        rows[..., [BoatColumn.goal_x, BoatColumn.goal_y]] = rows[..., : BoatColumn.y + 1] + r.uniform(
            -4, 4, (200, 2, 2)
        )
        return StubWorlds(device, numbers, worlds=200, auvs=1, boats=2, boat=rows)

    @pytest.mark.parametrize("drifts", [1.0, 0.0])
    def test_it_goes_to_the_nearest_reachable_point(self, device, drifts):
        @ti.func
        def move(worlds: ti.template(), w):
            for b in range(worlds.boat.shape[1]):
                boat.move(worlds, w, b)

        made = self.boats(device, drifts=drifts)
        before, after = made.numbers(), made.after(move)
        old, new = before["boat"], after["boat"]
        place, goal = old[..., : BoatColumn.y + 1], old[..., [BoatColumn.goal_x, BoatColumn.goal_y]]
        drift = drifts * 0.5 * old[..., [BoatColumn.current_x, BoatColumn.current_y]]
        wanted = goal - place - drift
        distance = np.linalg.norm(wanted, axis=-1, keepdims=True)
        reached = np.clip(place + drift + wanted * np.minimum(1, 4.0 * 0.5 / distance), 0, [WIDTH, LENGTH])
        np.testing.assert_allclose(new[..., : BoatColumn.y + 1], reached, atol=1e-4)
        np.testing.assert_allclose(new[..., [BoatColumn.moved_x, BoatColumn.moved_y]], reached - place, atol=1e-4)
        np.testing.assert_allclose(new[..., BoatColumn.effort], np.minimum(distance[..., 0] / 2.0, 1), atol=1e-5)
        assert 0.1 < (new[..., BoatColumn.effort] < 1).mean() < 0.9
        places = [BoatColumn.x, BoatColumn.y, BoatColumn.moved_x, BoatColumn.moved_y, BoatColumn.effort]
        unchanged(after, before, {"boat": places})

    def test_a_goal_is_the_nearest_point_of_the_area(self, device):
        @ti.func
        def aim(worlds: ti.template(), w):
            place = ti.math.vec2(worlds.boat[w, 1, BoatColumn.x], worlds.boat[w, 1, BoatColumn.y])
            boat.set_goal(worlds, w, 1, place)

        made = self.boats(device)
        wanted = np.array(
            [[-5, 20], [310, 20], [150, -1], [150, 130], [299, 119], [400, -9], [2e12, 5], [5, -2e12], [np.nan, 7]]
        )
        made.arrays["boat"][: len(wanted), 1, : BoatColumn.y + 1] = torch.from_numpy(wanted)
        before, after = made.numbers(), made.after(aim)
        goal = after["boat"][: len(wanted), 1][:, [BoatColumn.goal_x, BoatColumn.goal_y]]
        expected = np.where(np.abs(wanted) <= 1e12, np.clip(wanted, 0, [WIDTH, LENGTH]), np.nan)
        np.testing.assert_allclose(goal, expected, rtol=1e-6)
        np.testing.assert_array_equal(after["boat"][:, 0], before["boat"][:, 0])

    def test_the_error_of_its_position(self, device):
        """A Gauss–Markov process of each boat and axis: its variance stays, its memory is what it is told."""

        @ti.func
        def locate(worlds: ti.template(), w):
            for b in range(worlds.boat.shape[1]):
                boat.locate(worlds, w, b)

        numbers = {**AREA, "gnss_error": 0.4, "gnss_memory": 0.8}
        made = StubWorlds(device, numbers, worlds=MANY, auvs=1, boats=2)
        columns = [BoatColumn.gnss_x, BoatColumn.gnss_y]
        made.arrays["boat"][..., columns] = 50.0
        series = []
        for step in range(3):
            made.arrays["clock"][:, 1] = step
            series.append(made.after(locate)["boat"][..., columns].reshape(MANY, 4))
        for errors in series:
            assert np.abs(errors.std(0) / 0.4 - 1).max() < 0.06
            assert np.abs(np.corrcoef(errors.T) - np.eye(4)).max() < 0.08
        for one, other, memory in ((0, 1, 0.8), (1, 2, 0.8), (0, 2, 0.64)):
            both = (series[one] * series[other]).mean(0) / 0.4**2
            assert np.abs(both - memory).max() < 0.08


FLEET = SimpleNamespace(fleet=True, sensor=Sensor.none, task=SimpleNamespace(reward_terms=rewards.STANDARD))


class TestEarnings:
    """Three AUVs and two boats in random states."""

    def worlds(self, device, **changes: float) -> StubWorlds:
        r = np.random.default_rng(4)
        numbers = {
            **AREA,
            "safe_distance": 60.0,
            "collision_distance": 30.0,
            "farthest": 400.0,
            "payload": 2.0,
            "buffer": 500.0,
        }
        auv = r.uniform(0.5, 2, (80, 3, len(AuvColumn.names)))
        auv[..., : AuvColumn.y + 1] = r.uniform(0, 100, (80, 3, 2))
        for column in (AuvColumn.border, AuvColumn.hovering, AuvColumn.hover, AuvColumn.service_rate):
            auv[..., column] *= r.random((80, 3)) < 0.4
        auv[..., [AuvColumn.border, AuvColumn.hovering]] = auv[..., [AuvColumn.border, AuvColumn.hovering]] > 0
        estimate = r.uniform(20, 90, (80, 3, len(EstimateColumn.names)))
        estimate[..., EstimateColumn.served_by] = r.integers(0, 2, (80, 3))
        arrays = {
            "auv": auv,
            "estimate": estimate,
            "boat": r.uniform(0, 100, (80, 2, len(BoatColumn.names))),
            "tally": r.integers(0, 90, (80, len(TallyColumn.names))),
            "own": r.uniform(0, 100, (80, 3, tracker.COLUMNS)),
            "node": r.uniform(0, 100, (80, 4, len(NodeColumn.names))),
            "reward_weights": r.uniform(-2, 2, 9),
        }
        arrays["auv"][..., AuvColumn.target] = r.integers(0, 4, (80, 3))
        return StubWorlds(device, {**numbers, **changes}, worlds=80, auvs=3, boats=2, nodes=4, **arrays)

    @pytest.mark.parametrize("once", [0.0, 1.0])
    @pytest.mark.parametrize("hovering", [0.0, 1.0])
    def test_rewards(self, device, once, hovering):
        @ti.func
        def pay(worlds: ti.template(), w):
            for k in range(worlds.auv.shape[1]):
                rewards.write(worlds, w, k)

        made = self.worlds(device, proximity_once=once, service_hovering=hovering)
        before, after = made.numbers(), made.after(pay, FLEET)
        auv, tally, weights = before["auv"], before["tally"], before["reward_weights"]
        place = auv[..., : AuvColumn.y + 1]
        apart = np.linalg.norm(place[:, :, None] - place[:, None], axis=-1)
        counted = np.triu(np.ones((3, 3)), 1) if once else 1 - np.eye(3)
        by = before["estimate"][..., EstimateColumn.served_by].astype(int)
        away = place - np.take_along_axis(before["boat"][..., : BoatColumn.y + 1], by[..., None], 1)
        slant = np.sqrt((away**2).sum(-1) + before["estimate"][..., EstimateColumn.separation] ** 2)
        in_service = (auv[..., AuvColumn.hovering] > 0) | (auv[..., AuvColumn.hover] > 0)
        terms = {
            "distance": auv[..., AuvColumn.closed],
            "border": auv[..., AuvColumn.border],
            "overflow": tally[:, [TallyColumn.overflowing]],
            "proximity": (counted * np.maximum(60 - apart, 0)).sum(-1),
            "service": in_service if hovering else auv[..., AuvColumn.service_rate] > 0,
            "power": auv[..., AuvColumn.power],
            "collaboration": 400 / slant,
            "data": auv[..., AuvColumn.delivered],
            "lost": 2.0 * tally[:, [TallyColumn.packets_lost]] / 500 / 3,
        }
        assert [term.name for term in rewards.STANDARD] == list(terms)
        wanted = np.stack(
            [weight * np.broadcast_to(term, (80, 3)) for weight, term in zip(weights, terms.values(), strict=True)], -1
        )
        np.testing.assert_allclose(after["reward_terms"], wanted, rtol=1e-4, atol=1e-5)
        np.testing.assert_allclose(after["reward"], wanted.sum(-1), rtol=1e-4, atol=1e-3)
        unchanged(after, before, {"reward_terms": list(range(9)), "reward": [0, 1, 2]})

    def test_collisions(self, device):
        made = self.worlds(device)
        before, after = made.numbers(), made.after(rewards.count_collisions)
        place = before["auv"][..., : AuvColumn.y + 1]
        apart = np.linalg.norm(place[:, [0, 0, 1]] - place[:, [1, 2, 2]], axis=-1)
        np.testing.assert_array_equal(after["tally"][:, TallyColumn.collisions], (apart < 30).sum(1))
        unchanged(after, before, {"tally": [TallyColumn.collisions]})

    @pytest.mark.parametrize("sensor", [Sensor.none, Sensor.ground])
    def test_observations(self, device, sensor):
        """Each term from its own place on; near its target an AUV that reckons hears it and knows the way."""

        @ti.func
        def look(worlds: ti.template(), w):
            for k in range(worlds.auv.shape[1]):
                observation.others(worlds, w, k, 1)
                observation.target(worlds, w, k, 6)
                observation.position(worlds, w, k, 9)
                observation.border(worlds, w, k, 12)
                observation.overflow(worlds, w, k, 14)
                observation.current_speed(worlds, w, k, 16)
                observation.current_vector(worlds, w, k, 18)

        made = self.worlds(device, homing_range=50.0)
        before = made.numbers()
        after = made.after(look, SimpleNamespace(sensor=sensor))
        auv, estimate, node = before["auv"], before["estimate"], before["node"]
        true = auv[..., : AuvColumn.y + 1]
        place = estimate[..., : EstimateColumn.y + 1]
        own = place if sensor == Sensor.none else before["own"][..., [tracker.X, tracker.Y]]
        target = auv[..., AuvColumn.target].astype(int)
        there = np.take_along_axis(node[..., : NodeColumn.y + 1], target[..., None], 1)
        near = (np.linalg.norm(there - true, axis=-1) <= 50) & (sensor != Sensor.none)
        expected = np.zeros((80, 3, 40))
        others = [[1, 2], [0, 2], [0, 1]]
        for k in range(3):
            expected[:, k, 1:5] = (place[:, others[k]] - own[:, [k]]).reshape(80, 4) / AREA["diagonal"]
        expected[..., 6:8] = (there - np.where(near[..., None], true, own)) / AREA["diagonal"]
        expected[..., 9:11] = own / AREA["diagonal"]
        expected[..., 12] = auv[..., AuvColumn.border]
        expected[..., 14] = before["tally"][:, [TallyColumn.overflowing]] / 4
        current = auv[..., [AuvColumn.current_x, AuvColumn.current_y]]
        expected[..., 16] = np.linalg.norm(current, axis=-1)
        expected[..., 18:20] = current
        np.testing.assert_allclose(after["observation"], expected, atol=1e-5)
        unchanged(after, before, {"observation": list(range(40))})


class TestService:
    """Three AUVs, of which two may serve one node."""

    def worlds(self, device, **changes: float) -> StubWorlds:
        r = np.random.default_rng(5)
        numbers = {
            **AREA,
            "payload": 2.0,
            "buffer": 500.0,
            "hover_radius": 6.0,
            "speed_min": 1.0,
            "speed_max": 2.0,
            "progress": 1.0,
            "cruise": 20.0,
            "spreading": 20.0,
            "data_absorption": 4.0,
            "data_level": 60.0,
            "data_bandwidth": 1e4,
            **changes,
        }
        node = np.zeros((60, 4, len(NodeColumn.names)))
        node[..., : NodeColumn.y + 1] = r.uniform(0.2, 0.8, (60, 4, 2)) * [WIDTH, LENGTH]
        node[..., NodeColumn.backlog] = r.integers(100, 400, (60, 4))
        auv = np.zeros((60, 3, len(AuvColumn.names)))
        target = r.integers(0, 4, (60, 3))
        auv[..., AuvColumn.target] = target
        there = np.take_along_axis(node[..., : NodeColumn.y + 1], target[..., None], 1)
        away = r.choice([1.0, 5.0, 9.0], (60, 3, 1))
        angle = r.uniform(0, 2 * math.pi, (60, 3))
        auv[..., : AuvColumn.y + 1] = there + away * np.stack([np.cos(angle), np.sin(angle)], -1)
        hovers = r.random((60, 3)) < 0.5
        auv[..., AuvColumn.hover] = hovers * r.choice([0.3, 0.5, 4.0], (60, 3))
        auv[..., AuvColumn.cargo] = hovers * r.integers(1, 50, (60, 3))
        auv[..., AuvColumn.rate] = r.uniform(0.1, 1, (60, 3))
        auv[..., [AuvColumn.current_x, AuvColumn.current_y]] = r.uniform(-2, 2, (60, 3, 2))
        belief = r.uniform(1, 2, (60, 1, 4, len(BeliefColumn.names)))
        bed = np.array([[50.0, 80.0], [60.0, 40.0]]).reshape(1, 2, 2, 1)  # rows from the south, columns from the west
        arrays = {"auv": auv, "node": node, "belief": belief, "water": bed}
        return StubWorlds(device, numbers, worlds=60, auvs=3, nodes=4, **arrays)

    @pytest.mark.parametrize(("progress", "separation"), [(1.0, 0.0), (0.0, 33.0)])
    def test_a_step(self, device, progress, separation):
        """Those that hover bring in their packets when it is over, others travel, and begin to hover near their nodes.

        AUVs move one after the other: packets that one of a lower index has begun to take are no longer there.
        """

        @ti.func
        def move(worlds: ti.template(), w):
            for k in range(worlds.auv.shape[1]):
                motion.clear_last_step(worlds, w, k)
                data_collection.move(worlds, w, k, 0.6, -0.3)

        made = self.worlds(device, progress=progress, separation_node=separation)
        before, after = made.numbers(), made.after(move, SimpleNamespace(information=Information.full))
        velocity = np.array([0.6, -0.3]) * 2
        begun = completed = 0
        for w in range(60):
            rows = before["auv"][w].copy()
            for k in range(3):
                row, new = rows[k], after["auv"][w, k]
                target = int(row[AuvColumn.target])
                there = before["node"][w, target, : NodeColumn.y + 1]
                was = np.linalg.norm(there - row[: AuvColumn.y + 1])
                distance = was
                current = row[[AuvColumn.current_x, AuvColumn.current_y]]
                if row[AuvColumn.hover] > 0:
                    left = row[AuvColumn.hover] - 0.5
                    done = left <= 0
                    completed += done
                    wanted = {
                        "hovering": 1.0,
                        "water_x": 0.0,
                        "water_y": 0.0,
                        "power": hovering_power(np.linalg.norm(current)),
                        "hover": max(left, 0.0),
                        "service_rate": done * row[AuvColumn.rate],
                        "packets_delivered": done * row[AuvColumn.cargo],
                        "delivered": done * row[AuvColumn.cargo] * 2.0 / 500,
                        "cargo": row[AuvColumn.cargo],
                    }
                    rows[k, AuvColumn.hover] = max(left, 0.0)
                else:
                    moved = row[: AuvColumn.y + 1] + 0.5 * (velocity + current)
                    distance = np.linalg.norm(there - moved)
                    wanted = {"hovering": 0.0, "water_x": velocity[0], "water_y": velocity[1], "delivered": 0.0}
                    wanted |= {"x": moved[0], "y": moved[1], "hover": 0.0}
                    if distance <= 6:
                        x, y = there / [WIDTH, LENGTH]
                        depth = (1 - y) * (50 + 30 * x) + y * (60 - 20 * x)
                        slant = math.hypot(distance, separation or depth - 20.0)
                        snr = 60.0 - 20 * math.log10(slant) - 4.0 * slant / 1000
                        rate = 1e-6 * 1e4 * math.log2(1 + 10 ** (0.1 * snr))
                        same = rows[:, AuvColumn.target] == target
                        cargo = before["node"][w, target, NodeColumn.backlog] - rows[same, AuvColumn.cargo].sum()
                        wanted |= {"rate": rate, "cargo": cargo, "hover": max(cargo * 2.0 / 500 / rate, 5e-4)}
                        rows[k, AuvColumn.cargo] = cargo
                        begun += 1
                wanted["closed"] = was - distance if progress else -distance
                for name, number in wanted.items():
                    assert new[getattr(AuvColumn, name)] == pytest.approx(number, rel=1e-3, abs=2e-4), name
        assert min(begun, completed) > 20

    def test_what_is_served_leaves_its_node_and_the_auv_goes_on(self, device):
        """Packets that came meanwhile stay."""

        @ti.func
        def next_but_one(worlds: ti.template(), w, k):
            return k + 1

        made = self.worlds(device)
        done = torch.rand((60, 3), generator=torch.Generator().manual_seed(1)) < 0.5
        made.arrays["auv"][..., AuvColumn.service_rate] = done.to(made.arrays["auv"])
        made.arrays["auv"][..., AuvColumn.packets_delivered] = 7.0 + torch.arange(3, device=device)
        before = made.numbers()
        after = made.after(
            data_collection.complete_services, SimpleNamespace(target_rule=SimpleNamespace(choose=next_but_one))
        )
        backlog, auv = before["node"][..., NodeColumn.backlog].copy(), before["auv"].copy()
        for w, k in np.argwhere(done.numpy()):
            backlog[w, int(auv[w, k, AuvColumn.target])] -= 7.0 + k
            auv[w, k, [AuvColumn.cargo, AuvColumn.target]] = 0.0, k + 1
        np.testing.assert_allclose(after["node"][..., NodeColumn.backlog], backlog)
        np.testing.assert_array_equal(after["auv"], auv)
        unchanged(after, before, {"node": [NodeColumn.backlog], "auv": list(range(auv.shape[-1]))})

    def test_nodes_fill(self, device):
        """By Poisson numbers of their kinds, also the last one of an odd number; a full buffer loses the rest."""
        numbers = {**AREA, "buffer": 12.0}
        made = StubWorlds(device, numbers, worlds=MANY, auvs=1, nodes=7, arrivals=table(RATES, 0.5))
        node = made.arrays["node"]
        node[..., NodeColumn.kind] = torch.arange(7, device=device) % 3
        node[..., NodeColumn.backlog] = torch.tensor([0.0, 10, 12, 3, 11, 0, 12], device=device)
        before, after = made.numbers(), made.after(data_collection.fill_nodes)
        new, tally = after["node"][..., NodeColumn.backlog], after["tally"]
        old = before["node"][0, :, NodeColumn.backlog]
        assert new.max() == 12
        created = tally[:, TallyColumn.packets_created]
        np.testing.assert_array_equal(created - tally[:, TallyColumn.packets_lost], (new - old).sum(1))
        means = 0.5 * np.array(RATES)[np.arange(7) % 3]
        assert created.mean() == pytest.approx(means.sum(), abs=5 * math.sqrt(means.sum() / MANY))
        over = sum(stats.poisson.sf(12 - start, mean) for start, mean in zip(old, means, strict=True))
        assert tally[:, TallyColumn.overflowing].mean() == pytest.approx(over, abs=0.1)
        for i in range(7):
            room = 12 - old[i]
            kept = stats.poisson(means[i]).expect(lambda n, room=room: np.minimum(n, room))
            assert (new[:, i] - old[i]).mean() == pytest.approx(kept, abs=0.25)
        columns = [TallyColumn.packets_created, TallyColumn.packets_lost, TallyColumn.overflowing]
        unchanged(after, before, {"node": [NodeColumn.backlog], "tally": columns})
