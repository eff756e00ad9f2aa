"""Zermelo's problem: closed forms, rays of Zermelo's own equation, barriers, symmetry, and the gain of an AUV."""

import math

import numpy as np
import pytest
import torch
from scipy.integrate import solve_ivp
from scipy.interpolate import RegularGridInterpolator

from usvauv import policies
from usvauv.env import Scenario, World
from usvauv.kernels.flow.vortex import sample_current
from usvauv.kernels.mission.motion import travelling_power
from usvauv.kernels.planning import zermelo
from usvauv.policies.guidance import unit

SIZE = (200.0, 200.0)
RADIUS = 6.0
GOAL = (93.0, 71.0)


def nodes(count, size=SIZE):
    """Positions (rows, columns, 2) of a grid's nodes, m."""
    x, y = (np.linspace(0.0, side, count) for side in size)
    return np.stack(np.meshgrid(x, y), -1)


class Problem:
    """Batched problems of one vehicle each, solved: flows (W, rows, columns, 2), goals (W, 2)."""

    def __init__(self, device, flow, goal, speeds=(1.3,), rates=(1.0,), size=SIZE):
        def put(numbers):
            return torch.tensor(np.array(numbers, order="C"), dtype=torch.float32, device=device)

        self.flow, self.goal, self.put = put(flow), put(goal)[:, None].contiguous(), put
        self.speeds, self.rates, self.circle = put(speeds), put(rates), {"size": size, "radius": RADIUS}
        worlds, rows, columns, _ = self.flow.shape
        self.cost = put(np.zeros((worlds, 1, rows, columns)))
        due = torch.ones((worlds, 1), dtype=torch.uint8, device=device)
        zermelo.solve(self.flow, self.goal, due, self.speeds, self.rates, self.cost, **self.circle)

    def costs(self, world=0):
        return self.cost[world, 0].double().cpu().numpy()

    def steer(self, position, current):
        """Velocity (W, 2) through the water at positions (W, 2)."""
        velocity = torch.full_like(self.goal, 77.0)
        there = (position[:, None].contiguous(), current[:, None].contiguous())
        choice = (self.speeds, self.rates)
        zermelo.steer(self.flow, self.goal, *there, *choice, self.cost, velocity, **self.circle)
        return velocity[:, 0]


def uniform(count, c):
    return np.broadcast_to(np.asarray(c, float), (1, count, count, 2))


def uniform_time(d, c, speed):
    """The first t ≥ 0 with |d − c t| = V t + R, by the roots of the quadratic; inf where there is none."""
    a, b, gap = c @ c - speed**2, -2.0 * (d @ c + speed * RADIUS), (d**2).sum(-1) - RADIUS**2
    with np.errstate(invalid="ignore"):
        root = np.sqrt(b**2 - 4.0 * a * gap)
    both = np.stack((-b - root, -b + root)) / (2.0 * a)
    first = np.where(both > 0.0, both, np.inf).min(0)
    return np.where(gap <= 0.0, 0.0, first)


class TestUniformCurrent:
    @pytest.mark.parametrize("c", [(0.0, 0.0), (0.6, 0.3), (-0.9, 0.4), (0.0, -1.2)])
    def test_first_order_to_the_closed_form(self, device, c):
        errors = []
        for count in (51, 101, 201):
            exact = uniform_time(np.array(GOAL) - nodes(count), np.array(c), 1.3)
            error = Problem(device, uniform(count, c), [GOAL]).costs() - exact
            assert error.min() > -1e-3
            errors.append(error.mean())
        assert errors[1] < 0.02 * exact.mean()
        order = math.log2(errors[0] / errors[2]) / 2
        assert 0.6 < order < 1.2, f"errors {errors}"

    def test_only_what_lies_upstream_reaches_the_goal_in_a_stronger_current(self, device):
        c = np.array([1.5, 0.3])
        costs = Problem(device, uniform(101, c), [GOAL]).costs()
        exact = uniform_time(np.array(GOAL) - nodes(101), c, 1.3)
        reached = costs < zermelo.UNREACHABLE
        assert (costs[~reached] == zermelo.UNREACHABLE).all()
        assert np.isinf(exact[reached]).mean() < 0.03  # the rim of the cone is blurred, and partly missed
        both = reached & np.isfinite(exact)
        assert both.sum() > 0.85 * np.isfinite(exact).sum()
        assert np.abs(costs[both] - exact[both]).max() < 2.0

    def test_the_cheapest_of_several_speeds(self, device):
        speeds, c = np.array([1.2, 1.7, 2.2]), np.array([-0.9, 0.0])
        rates = np.array([travelling_power(float(speed)) for speed in speeds]) + 40.0

        def costs(place):
            times = [uniform_time(np.array(GOAL) - place, c, speed) for speed in speeds]
            return np.stack([rate * time for rate, time in zip(rates, times, strict=True)])

        exact = costs(nodes(101)).min(0)
        problem = Problem(device, uniform(101, c), [GOAL], speeds, rates)
        assert np.abs(problem.costs() - exact).max() < 0.02 * exact.max()
        chosen = set()
        for start in ((5.0, 71.0), (190.0, 71.0), (93.0, 180.0)):
            place = problem.put([start])
            best = np.argmin(costs(np.array(start)))
            chosen.add(best)
            velocity = problem.steer(place, problem.put([c]))
            assert velocity.norm().item() == pytest.approx(speeds[best], abs=1e-4)
        assert len(chosen) > 1

    def test_several_vehicles_steer_in_an_oblong_area(self, device):
        """Two vehicles in each of two worlds, of other spacing in x than in y."""
        size, goals = (300.0, 120.0), np.array([[(40.0, 30.0), (260.0, 90.0)], [(150.0, 100.0), (60.0, 60.0)]])
        places = np.array([[(200.0, 100.0), (30.0, 15.0)], [(20.0, 10.0), (280.0, 90.0)]])
        currents = np.array([(0.3, -0.2), (-0.5, 0.7)])
        speed = 1.3

        def put(numbers):
            return torch.tensor(np.array(numbers, order="C"), dtype=torch.float32, device=device)

        flow = put(np.broadcast_to(currents[:, None, None], (2, 41, 61, 2)))
        speeds, rates, cost = put([speed]), put([2.0]), put(np.zeros((2, 2, 41, 61)))
        due = torch.ones((2, 2), dtype=torch.uint8, device=device)
        about = {"size": size, "radius": RADIUS}
        zermelo.solve(flow, put(goals), due, speeds, rates, cost, **about)
        velocity = put(np.full((2, 2, 2), 77.0))
        water = put(np.repeat(currents[:, None], 2, axis=1))
        zermelo.steer(flow, put(goals), put(places), water, speeds, rates, cost, velocity, **about)
        for w in range(2):
            for k in range(2):
                d, found = goals[w, k] - places[w, k], velocity[w, k].double().cpu().numpy()
                time = uniform_time(d, currents[w], speed)
                straight = d - currents[w] * time
                np.testing.assert_allclose(found, speed * straight / np.linalg.norm(straight), atol=0.05)
                row, column = places[w, k, 1] / 3, places[w, k, 0] / 5
                assert cost[w, k, round(row), round(column)].item() == pytest.approx(2 * time, rel=0.03, abs=3)


def rays(current, jacobian, speed, times, count=48):
    """Places (count, T, 2) from which the goal is reached in the given times on rays of Zermelo's navigation equation.

    Backwards from the circle, which a time-optimal way enters at right angles:
    dθ/dt = sin²θ v_x + sin θ cos θ (u_x − v_y) − cos²θ u_y.
    """
    places = []
    for angle in np.arange(count) * 2 * math.pi / count:
        outward = np.array([math.cos(angle), math.sin(angle)])

        def backwards(_, state):
            x, theta = state[:2], state[2]
            e = np.array([math.cos(theta), math.sin(theta)])
            (u_x, u_y), (v_x, v_y) = jacobian(x)
            turn = e[1] ** 2 * v_x + e[0] * e[1] * (u_x - v_y) - e[0] ** 2 * u_y
            return [*-(speed * e + current(x)), -turn]

        start = [*(np.array(GOAL) + RADIUS * outward), angle + math.pi]
        solution = solve_ivp(backwards, (0.0, times[-1]), start, t_eval=times, rtol=1e-8, atol=1e-8)
        places.append(solution.y[:2].T)
    return np.stack(places)


def inside_so_far(places, margin=1.0):
    """Of places (N, T, 2), those up to which the ray has stayed in the area."""
    inside = ((places > margin) & (places < SIZE[0] - margin)).all(-1)
    return np.logical_and.accumulate(inside, axis=1)


def interpolate(costs, places):
    """Bilinear; NaN outside the area."""
    x = np.linspace(0.0, SIZE[0], costs.shape[1])
    return RegularGridInterpolator((x, x), costs, bounds_error=False)(places[..., ::-1])


SHEAR = 0.007  # 1/s
VORTEX = (121.3, 98.7, 160.0, 40.0)


def vortex(x):
    """Eq. 8 in double precision at (..., 2)."""
    d = x - np.array(VORTEX[:2])
    square = (d**2).sum(-1, keepdims=True)
    turn = VORTEX[2] / (2 * math.pi * square) * -np.expm1(-square / VORTEX[3] ** 2)
    return turn * np.stack((-d[..., 1], d[..., 0]), -1)


def vortex_jacobian(x, step=1e-4):
    columns = [(vortex(x + step * e) - vortex(x - step * e)) / (2 * step) for e in np.eye(2)]
    return np.stack(columns, -1)


class TestZermelosEquation:
    times = np.arange(5.0, 80.0, 5.0)

    def test_linear_shear(self, device):
        """Rays do not cross within this time, so the cost on them is their time."""
        places = rays(
            lambda x: np.array([SHEAR * (x[1] - 100.0), 0.0]), lambda x: ((0.0, SHEAR), (0.0, 0.0)), 1.3, self.times
        )
        kept = inside_so_far(places)
        assert kept.sum() > 300
        errors = []
        for count in (51, 101, 201):
            flow = np.zeros((1, count, count, 2))
            flow[..., 0] = SHEAR * (nodes(count)[..., 1] - 100.0)
            error = (
                interpolate(Problem(device, flow, [GOAL]).costs(), places)[kept]
                - np.broadcast_to(self.times, kept.shape)[kept]
            )
            errors.append(np.abs(error).mean())
        assert errors[2] < 0.2
        assert math.log2(errors[0] / errors[2]) / 2 > 0.6, f"errors {errors}"

    def test_no_ray_in_a_vortex_is_faster_and_the_way_takes_the_time(self, device):
        places = rays(vortex, vortex_jacobian, 1.3, self.times)
        kept = inside_so_far(places)
        problem = Problem(device, vortex(nodes(201))[None], [GOAL])
        late = (interpolate(problem.costs(), places) - self.times)[kept]
        assert late.max() < 0.8  # a first-order scheme is late
        assert np.median(np.abs(late)) < 0.3

        starts = np.random.default_rng(0).uniform(5, 195, (64, 2))
        flow = np.repeat(vortex(nodes(51))[None], len(starts), 0)
        many = Problem(device, flow, np.repeat([GOAL], len(starts), 0))
        arrival = sail(many, many.put(starts), lambda x: many.put(vortex(x.double().cpu().numpy())), many.steer, 0.25)
        expected = interpolate(problem.costs(), starts)
        assert (arrival - expected < 0.01 * expected + 0.5).all()


def sail(problem, position, current, steer, step=0.5, longest=400.0):
    """Arrival times (W,) at the circle by explicit steps, inf where it is not reached; no move leaves the area."""
    arrival = np.full(len(position), np.inf)
    for n in range(int(longest / step)):
        there = ((position - problem.goal[:, 0]).norm(dim=-1) <= RADIUS).cpu().numpy()
        arrival[there & np.isinf(arrival)] = n * step
        if np.isfinite(arrival).all():
            break
        water = current(position)
        moved = position + step * (steer(position, water) + water)
        outside = ((moved < 0) | (moved > SIZE[0])).any(-1, keepdim=True)
        position = torch.where(outside, position, moved)
    return arrival


def crab(goal, speed):
    """Velocity through the water whose track over ground points at the goal."""

    def steer(position, water):
        bearing = unit(goal - position)
        left = torch.stack((-bearing[:, 1], bearing[:, 0]), -1)
        sine = (-(water * left).sum(-1, keepdim=True) / speed).clamp(-1.0, 1.0)
        return speed * ((1.0 - sine.square()).sqrt() * bearing + sine * left)

    return steer


def random_vortices(worlds, seed=0):
    """As in `extreme`."""
    draw = np.random.default_rng(seed)
    shape = (worlds, 4)
    gamma = draw.uniform(120, 260, shape) * draw.choice([-1, 1], shape)
    parts = (draw.uniform(0, 200, shape), draw.uniform(0, 200, shape), gamma, draw.uniform(30, 50, shape))
    return np.stack(parts, -1), draw.uniform(10, 190, (worlds, 2)), draw.uniform(10, 190, (worlds, 2))


class TestAgainstCrab:
    def test_never_later_in_random_frozen_vortices(self, device):
        eddies, starts, goals = random_vortices(300)
        eddies = torch.as_tensor(eddies, dtype=torch.float32, device=device)
        grid = torch.as_tensor(nodes(51).reshape(1, -1, 2), dtype=torch.float32, device=device)
        flow = sample_current(eddies, grid.expand(300, -1, -1).contiguous()).view(300, 51, 51, 2)
        problem = Problem(device, flow.cpu().numpy(), goals)

        def current(position):
            return sample_current(eddies, position[:, None].contiguous())[:, 0]

        start = problem.put(starts)
        reachable = problem.steer(start, current(start)).norm(dim=-1).cpu().numpy() > 0
        reachable |= np.linalg.norm(starts - goals, axis=-1) < RADIUS
        ours = sail(problem, start, current, problem.steer)
        others = sail(problem, start, current, crab(problem.goal[:, 0], 1.3))
        assert np.isfinite(ours[reachable]).all()
        assert np.isinf(others[~reachable]).all()  # where it finds no way there is none
        assert (ours <= others + 0.5).all()  # a step
        won = others[np.isfinite(others)] - ours[np.isfinite(others)]
        assert won.mean() > 2.0
        assert np.isfinite(ours).sum() > np.isfinite(others).sum()


@pytest.fixture(scope="module")
def problem(device):
    """A jet from west to east, faster than the vehicle, over the whole length of the area: no path leads back."""
    flow = np.zeros((2, 51, 51, 2))
    flow[:, :, 24:28, 0] = 1.6
    return Problem(device, flow, [(40.0, 100.0), (160.0, 100.0)])


class TestWalls:
    def test_no_way_against_a_jet_nor_around_it_outside_the_area(self, problem):
        west_goal, east_goal = problem.costs(0), problem.costs(1)
        assert (west_goal[:, 28:] == zermelo.UNREACHABLE).all()
        assert (west_goal[:, :24] < 300.0).all()
        assert (east_goal < 300.0).all()

    def test_no_velocity_where_there_is_no_way_and_in_the_circle(self, problem):
        still = problem.put([(0.0, 0.0)] * 2)
        velocity = problem.steer(problem.put([(150.0, 60.0), (50.0, 60.0)]), still)
        assert velocity[0].norm() == 0
        assert velocity[1].norm().item() == pytest.approx(1.3, abs=1e-5)
        assert problem.steer(problem.put([(41.0, 100.0), (159.0, 100.0)]), still).norm() == 0

    def test_from_outside_it_comes_back(self, problem):
        velocity = problem.steer(problem.put([(20.0, -3.0), (203.0, 60.0)]), problem.put([(0.0, 0.0)] * 2))
        assert velocity[0, 1] > 0
        assert velocity[1, 0] < 0

    def test_what_is_not_due_stays(self, problem):
        kept = problem.cost.clone()
        problem.cost[:] = 7.0
        due = torch.tensor([[0], [1]], dtype=torch.uint8, device=kept.device)
        zermelo.solve(problem.flow, problem.goal, due, problem.speeds, problem.rates, problem.cost, **problem.circle)
        assert (problem.cost[0] == 7.0).all()
        assert torch.equal(problem.cost[1], kept[1])
        problem.cost.copy_(kept)


class TestSymmetry:
    @pytest.mark.parametrize("turns", [1, 2, 3])
    def test_turned_fields_have_turned_solutions(self, device, turns):
        flow, goal, start = vortex(nodes(51)), np.array(GOAL), np.array([[170.0, 140.0]])
        turn = np.linalg.matrix_power(np.array([[0.0, -1.0], [1.0, 0.0]]), turns)
        centre = np.array([100.0, 100.0])
        turned = np.rot90(flow, -turns, axes=(0, 1)) @ turn.T  # row 0 is in the south
        plain = Problem(device, flow[None], [goal])
        other = Problem(device, turned[None], [centre + turn @ (goal - centre)])
        np.testing.assert_allclose(other.costs(), np.rot90(plain.costs(), -turns), rtol=2e-4, atol=2e-3)
        water = vortex(start)
        velocity = plain.steer(plain.put(start), plain.put(water)).cpu().numpy()
        there = other.steer(other.put(centre + (start - centre) @ turn.T), other.put(water @ turn.T))
        np.testing.assert_allclose(there.cpu().numpy(), velocity @ turn.T, atol=0.03)


class TestPolicy:
    def test_without_a_way_it_does_as_crab(self):
        scenario = Scenario.load("extreme", ['storm.spectrum="none"'])
        world = World(scenario, 8, seed=1)
        observation = world.reset()
        centre, speed = -3000.0, 3.0  # nearly uniform, and faster than it
        world.vortex[:] = torch.tensor([100.0, centre, -speed * 2 * math.pi * -centre, 30.0], device=world.device)
        ours, others = (policies.load(f"{name}:1.4", world) for name in ("zermelo", "crab"))
        action, fallback = ours.act(observation), others.act(observation)
        lost = ours.velocity.norm(dim=-1) == 0
        assert lost.sum() > 3
        torch.testing.assert_close(action[lost], fallback[lost])
