"""Planning over a horizon: its value against whole filters in double precision, derivatives, optima, closed loop."""

import math

import numpy as np
import pytest
import torch

from usvauv.kernels.planning import global_search, objectives, receding_horizon
from usvauv.kernels.positioning import acoustic_link, tracker

CARRIERS = (15000.0, 18000.0, 12000.0, 14000.0, 16000.0, 17000.0)
ATTITUDE_ERROR = math.radians(0.1)
MODEL = {"variance": 0.22, "correlation_time": 180.0}
SPEED = 4.0


def links(count, device, attitude_error=ATTITUDE_ERROR):
    return torch.from_numpy(
        acoustic_link.link_table(
            CARRIERS[:count], acoustic_link.Sonar(accuracy=acoustic_link.Accuracy(attitude=attitude_error))
        )
    ).to(device)


def layouts(seed, worlds, count, device, *, spread=200.0):
    """Random tracks (n, K, COLUMNS), estimates (n, K, 3), places of the boat and goals (n, 2)."""
    random = np.random.default_rng(seed)
    track = np.zeros((worlds, count, tracker.COLUMNS))
    track[..., :2] = random.uniform(0, spread, (worlds, count, 2))
    track[..., 2:4] = random.normal(0, 0.3, (worlds, count, 2))
    # One number of each block, of a correlation below one.
    a, c = random.uniform(0.02, 0.3, (2, worlds, count))
    b = random.uniform(-0.9, 0.9, (worlds, count)) * np.sqrt(a * c)
    for columns, block in (((tracker.XX, tracker.YY), a), ((tracker.XU, tracker.YV), b), ((tracker.UU, tracker.VV), c)):
        track[..., columns] = block[..., None]
    track[..., tracker.ADRIFT] = random.random((worlds, count)) < 0.8
    velocity = random.normal(0, 1.2, (worlds, count, 2))
    track[..., [tracker.WATER_X, tracker.WATER_Y]] = track[..., [tracker.ADRIFT]] * velocity
    estimate = np.concatenate([track[..., :2], random.uniform(90, 110, (worlds, count, 1))], -1)
    places = random.uniform(0, spread, (2, worlds, 2))
    return [torch.tensor(array, dtype=torch.float32, device=device) for array in (track, estimate, *places)]


def outlook(criterion="d", **settings):
    return receding_horizon.outlook_for(criterion, **MODEL, **settings)


def fix_variance(link, k, offset, z):
    """1/T + ε² z² in double precision."""
    S0 = link[k, acoustic_link.REFERENCE]
    q = offset @ offset + z * z
    log_T = (
        link[k, acoustic_link.LEVEL]
        - link[k, acoustic_link.POWER] * math.log(q / S0**2)
        - link[k, acoustic_link.DECAY] * (math.sqrt(q) - S0)
    )
    return math.exp(-log_T) + (ATTITUDE_ERROR * z) ** 2


def reference(track, estimate, link, boat, goal, criterion, steps, top_speed=SPEED, step=1.0):
    """The criterion from filters of four states, covariance 4 × 4 and textbook form, in double precision."""
    rho = math.exp(-step / MODEL["correlation_time"])
    means, total = [], 0.0
    for k in range(len(track)):
        P = np.zeros((4, 4))
        P[np.triu_indices(4)] = track[k, tracker.XX : tracker.VV + 1]
        P = P + np.triu(P, 1).T
        place, adrift = track[k, :2].copy(), track[k, tracker.ADRIFT]
        velocity = track[k, tracker.WATER_X : tracker.WATER_Y + 1] + adrift * track[k, 2:4]
        sum_a = 0.0
        for h in range(1, steps + 1):
            way = goal - boat
            distance = np.linalg.norm(way)
            position = goal if distance <= h * top_speed * step else boat + way * (h * top_speed * step / distance)
            R = fix_variance(link, k, position - place, estimate[k, 2]) * np.eye(2)
            P = P - P[:, :2] @ np.linalg.inv(P[:2, :2] + R) @ P[:2]
            A = P[:2, :2]
            total += -math.log(np.linalg.det(A)) if criterion == "d" else -np.trace(A) if criterion == "a" else 0.0
            sum_a += np.linalg.eigvalsh(A)[-1]
            decay = np.diag([1, 1, rho, rho])
            F = np.eye(4)
            F[0, 2] = F[1, 3] = adrift * step
            P = decay @ P @ decay + np.diag([0, 0, 1, 1]) * MODEL["variance"] * (1 - rho**2)
            P = F @ P @ F.T
            place = place + step * velocity
        means.append(sum_a / steps)
    return -max(means) if criterion == "e" else total / steps


class TestValue:
    @pytest.mark.parametrize("criterion", receding_horizon.CRITERIA)
    @pytest.mark.parametrize("steps", [1, 12])
    def test_filters_in_double_precision(self, device, criterion, steps):
        world = layouts(3, 20, 3, device)
        link = links(3, device)
        found = receding_horizon.look_ahead_batch(*world[:2], link, *world[2:], outlook(criterion, steps=steps))
        assert found.shape == (20, 3)
        plain = [array.double().cpu().numpy() for array in (*world, link)]
        for i in range(20):
            track, estimate, boat, goal = (array[i] for array in plain[:4])
            expected = reference(track, estimate, plain[4], boat, goal, criterion, steps)
            assert found[i, 0].item() == pytest.approx(expected, rel=2e-5, abs=2e-5)

    @pytest.mark.parametrize("criterion", receding_horizon.CRITERIA)
    def test_derivatives_by_the_goal(self, device, criterion):
        """Central differences of the double precision value; goals within reach and beyond it."""
        world = layouts(4, 30, 2, device)
        world[3][:15] = world[2][:15] + 0.05 * (world[3][:15] - world[2][:15])
        link = links(2, device)
        found = receding_horizon.look_ahead_batch(*world[:2], link, *world[2:], outlook(criterion, steps=8))
        plain = [array.double().cpu().numpy() for array in (*world, link)]
        for i in range(30):
            track, estimate, boat, goal = (array[i] for array in plain[:4])
            for axis in range(2):
                beside = np.eye(2)[axis] * 1e-4
                high, low = (
                    reference(track, estimate, plain[4], boat, goal + way, criterion, 8) for way in (beside, -beside)
                )
                slope = found[i, 1 + axis].item()
                assert slope == pytest.approx((high - low) / 2e-4, rel=2e-3, abs=2e-6)

    def test_unknown_criterion(self):
        with pytest.raises(ValueError, match="'x' is not one of d, a, e"):
            outlook("x")


class TestPlan:
    def test_one_step_without_prior_is_the_planner_of_fixes(self, device):
        """Boundless speed, unknown positions, no attitude error: log det of the information of one fix, JOINT_FIX."""
        track, estimate, boat, goal = layouts(5, 200, 2, device)
        for columns, value in (
            ((tracker.XX, tracker.YY), 1e6),
            ((tracker.XU, tracker.YV), 0.0),
            ((tracker.UU, tracker.VV), 0.1),
        ):
            track[..., columns] = value
        link = links(2, device, attitude_error=0.0)
        found = receding_horizon.plan_batch(track, estimate, link, boat, goal, outlook(steps=1, top_speed=300.0))
        best = global_search.plan_batch(link, estimate, code=objectives.objective_code("fix", "d"))
        at_found = objectives.log_objective_batch(
            link, estimate, found[:, :2].contiguous(), code=objectives.objective_code("fix", "d")
        )[:, 0]
        gap = (best[:, 2] - at_found).cpu().numpy()
        assert np.mean(gap < 1e-5) > 0.98  # one ascent: of two maxima it may find the lower
        assert gap.max() < 0.1

    @pytest.mark.parametrize("criterion", receding_horizon.CRITERIA)
    @pytest.mark.parametrize("count", [2, 4])
    def test_near_the_best_of_a_grid(self, device, criterion, count):
        world = layouts(6, 40, count, device)
        link = links(count, device)
        found = receding_horizon.plan_batch(*world[:2], link, *world[2:], outlook(criterion))
        assert found.shape == (40, 3)
        assert (found[:, :2] >= 0).all()
        assert (found[:, :2] <= 200).all()
        x = torch.linspace(0, 200, 41, device=device)
        grid = torch.stack(torch.meshgrid(x, x, indexing="xy"), -1).reshape(-1, 2)
        gaps, spans = [], []
        for i in range(40):
            same = [array[i : i + 1].expand(len(grid), *array.shape[1:]).contiguous() for array in world[:3]]
            values = receding_horizon.look_ahead_batch(*same[:2], link, same[2], grid, outlook(criterion))[:, 0]
            gaps.append((values.max() - found[i, 2]).item())
            spans.append((values.max() - values.min()).item())
        gaps, spans = np.array(gaps), np.array(spans)
        assert np.mean(gaps < 0.01 * spans) > 0.9  # other local maxima remain in a few
        assert np.all(gaps < 0.3 * spans)

    @pytest.mark.parametrize("criterion", receding_horizon.CRITERIA)
    def test_an_oblong_area_and_its_mirror(self, device, criterion):
        """Width and length exchanged with x and y; AUVs, goals and boats also outside of one side."""
        track, estimate, boat, goal = layouts(9, 40, 2, device, spread=300.0)
        link = links(2, device)
        swapped = track.clone()
        pairs = [(tracker.X, tracker.Y), (tracker.CURRENT_X, tracker.CURRENT_Y), (tracker.WATER_X, tracker.WATER_Y)]
        for one, other in pairs:  # the covariance is the same for both axes
            swapped[..., [one, other]] = track[..., [other, one]]
        mirrored = swapped, estimate[..., [1, 0, 2]].contiguous(), link, boat.flip(1), goal.flip(1)
        weighed = outlook(criterion, steps=6)
        wide = receding_horizon.plan_batch(track, estimate, link, boat, goal, weighed, width=280.0, length=90.0)
        long = receding_horizon.plan_batch(*mirrored, weighed, width=90.0, length=280.0)
        torch.testing.assert_close(wide[:, 2], long[:, 2], rtol=1e-4, atol=1e-4)
        assert (wide[:, :2] >= 0).all()
        assert (wide[:, 0] <= 280).all()
        assert (wide[:, 1] <= 90).all()
        assert (wide[:, 0] > 100).any()

    def test_goes_above_a_lone_auv_that_holds_position(self, device):
        track, estimate, boat, goal = layouts(7, 50, 1, device)
        track[..., [tracker.ADRIFT, tracker.WATER_X, tracker.WATER_Y]] = 0.0
        found = receding_horizon.plan_batch(track, estimate, links(1, device), boat, goal, outlook(steps=100))
        assert (found[:, :2] - track[:, 0, :2]).norm(dim=-1).max().item() < 0.2

    def test_a_neglects_no_far_auv_where_d_does(self, device):
        """Two AUVs 500 m apart: the determinant neglects one of them, the trace stays between them."""
        track, estimate, boat, goal = layouts(8, 1, 2, device)
        track[0, :, :2] = estimate[0, :, :2] = torch.tensor([[50.0, 300.0], [550.0, 300.0]])
        track[..., tracker.ADRIFT :] = 0.0
        track[..., [tracker.XX, tracker.YY]], track[..., [tracker.XU, tracker.YV]] = 1e3, 0.0
        boat[:], goal[:] = 200.0, 200.0
        nearest = {}
        for criterion in ("d", "a"):
            found = receding_horizon.plan_batch(
                track, estimate, links(2, device), boat, goal, outlook(criterion, steps=200), width=600.0, length=600.0
            )
            nearest[criterion] = (track[0, :, :2] - found[0, :2]).norm(dim=-1).min().item()
        assert nearest["d"] < 20
        assert nearest["a"] > 150


def voyage(device, count, planner, *, top_speed, steps, seed, worlds=64):
    """Mean σ² per axis of fixes and of tracks over a voyage beside AUVs that run between random places."""
    random = np.random.default_rng(seed)
    link = links(count, device)
    table = link.double().cpu().numpy()
    place, heading = random.uniform(10, 190, (2, worlds, count, 2))
    track = np.zeros((worlds, count, tracker.COLUMNS))
    a, b, c = np.full((worlds, count), 0.05), np.zeros((worlds, count)), np.full((worlds, count), 0.05)
    rho = math.exp(-1 / MODEL["correlation_time"])
    noise = MODEL["variance"] * (1 - rho**2)
    boat = goal = place.mean(1)
    sums = np.zeros(2)
    for _ in range(steps):
        way = heading - place
        distance = np.linalg.norm(way, axis=-1, keepdims=True)
        heading = np.where(distance < 6, random.uniform(10, 190, heading.shape), heading)
        velocity = 1.4 * way / np.maximum(distance, 1e-9)
        place = place + velocity
        c, b = rho**2 * c + noise, rho * b
        a, b = a + 2 * b + c, b + c
        track[..., :2], track[..., tracker.ADRIFT] = place, 1.0
        track[..., [tracker.WATER_X, tracker.WATER_Y]] = velocity
        for columns, block in (
            ((tracker.XX, tracker.YY), a),
            ((tracker.XU, tracker.YV), b),
            ((tracker.UU, tracker.VV), c),
        ):
            track[..., columns] = block[..., None]
        estimate = np.concatenate([place, np.full((worlds, count, 1), 100.0)], -1)
        tensors = [torch.tensor(array, dtype=torch.float32, device=device) for array in (track, estimate, boat, goal)]
        goal = planner(link, *tensors).double().cpu().numpy()
        way = goal - boat
        boat = boat + way * np.minimum(1, top_speed / np.maximum(np.linalg.norm(way, axis=-1, keepdims=True), 1e-9))
        q = ((boat[:, None] - place) ** 2).sum(-1) + 1e4
        S0 = table[:, acoustic_link.REFERENCE]
        log_T = (
            table[:, acoustic_link.LEVEL]
            - table[:, acoustic_link.POWER] * np.log(q / S0**2)
            - table[:, acoustic_link.DECAY] * (q**0.5 - S0)
        )
        r = np.exp(-log_T) + (ATTITUDE_ERROR * 100) ** 2
        s = a + r
        a, b, c = a * r / s, b * r / s, c - b * b / s
        sums += r.mean(), a.mean()
    return sums / steps


def to_the_optimum(link, track, estimate, boat, goal):
    return global_search.plan_batch(link, estimate, code=objectives.objective_code("fix", "d"), start=goal)[:, :2]


def ahead(steps, top_speed):
    def planner(link, track, estimate, boat, goal):
        weighed = outlook("a", steps=steps, top_speed=top_speed)
        return receding_horizon.plan_batch(track, estimate, link, boat, goal, weighed)[:, :2]

    return planner


class TestVoyage:
    """The gain of looking ahead: almost none for a boat faster than the AUVs, a little for a slow one."""

    def test_fast_boat(self, device):
        simple = voyage(device, 3, to_the_optimum, top_speed=4.0, steps=120, seed=1)
        planned = voyage(device, 3, ahead(10, 4.0), top_speed=4.0, steps=120, seed=1)
        assert 0.95 * simple[1] < planned[1] < 1.001 * simple[1]

    def test_slow_boat(self, device):
        simple = voyage(device, 2, to_the_optimum, top_speed=0.5, steps=200, seed=2)
        planned = voyage(device, 2, ahead(30, 0.5), top_speed=0.5, steps=200, seed=2)
        assert planned[1] < 0.995 * simple[1]
