"""Steering in a current: crab angles, economical speeds; frames between world and network."""

from __future__ import annotations

import math

import pytest
import torch
from scipy.optimize import minimize_scalar

from tests.policies.toy import ToyWorld, observe, scenario
from usvauv import policies
from usvauv.env import Scenario, World
from usvauv.policies import PolicyError
from usvauv.policies.frames import CirclingFrame, GuidedFrame, PassingFrame, TargetFrame, frames
from usvauv.policies.frames.offsets import TURN
from usvauv.policies.frames.target import PRICE
from usvauv.policies.guidance import (
    SpeedToFly,
    clear_of_others,
    command,
    crab,
    follow_circle,
    follow_line,
    level_power,
    rotate,
    unit,
    unrotate,
)
from usvauv.policies.learned import LearnedPolicy, Standardizer
from usvauv.policies.networks import DeterministicActor
from usvauv.policies.steering import BORDER_MARGIN

KNOT = 1852 / 3600  # m/s


def directions(count, seed=0):
    angle = 2 * math.pi * torch.rand(count, generator=torch.Generator().manual_seed(seed))
    return torch.stack((angle.cos(), angle.sin()), -1)


@pytest.mark.parametrize("size", [1e-9, 1.0, 1e9])
def test_unit_keeps_the_direction_of_every_length(size):
    course = directions(64)
    torch.testing.assert_close(unit(size * course), course, atol=1e-6, rtol=0)


def test_a_zero_vector_points_east():
    assert unit(torch.tensor([[0.0, 0.0], [-0.0, -0.0]])).tolist() == [[1.0, 0.0], [1.0, -0.0]]


def angle(vector):
    return torch.atan2(vector[..., 1], vector[..., 0])


def power(speed):
    drag = 0.5 * 0.7 * 60 * speed**2
    return drag * speed / (-0.081 * speed**3 + 0.215 * speed**2 - 0.01 * speed + 0.541) + 15


@pytest.mark.parametrize("model", ["point", "torpedo"])
def test_a_remus_100_lasts_as_long_as_its_maker_says(model):
    """22 h at 3 knots and 8 h at 5 from 1 kWh, as a point and by its hull, propeller and motor."""
    data = {"auv": {"vehicle": "remus-100", "model": model}, "nodes": {"service": "passing"}}
    power = level_power(Scenario.from_dict(data), [3 * KNOT, 5 * KNOT])
    assert [1000.0 / each for each in power] == pytest.approx([22.0, 8.0], rel=0.02)


class TestCrab:
    def test_the_track_is_the_one_asked_for(self):
        track, current = directions(500), 0.7 * directions(500, seed=1)
        speed = torch.linspace(1.2, 2.2, 500)
        ground = crab(track, speed, current) * speed.unsqueeze(-1) + current
        torch.testing.assert_close(unit(ground), track, atol=1e-5, rtol=0)

    def test_a_current_too_strong_is_met_head_on(self):
        heading = crab(torch.tensor([1.0, 0.0]), torch.tensor(1.2), torch.tensor([0.0, 1.5]))
        torch.testing.assert_close(heading, torch.tensor([0.0, -1.0]))


def follow(at, track, step, steps, lag=0.0):
    """Way of a point that goes `step` m at a time where `track` says; its course follows within `lag` m."""
    at, way, course = torch.tensor(at, dtype=torch.float64), [], None
    for _ in range(steps):
        way.append(at)
        wanted = track(at + 0.5 * step * track(at)) if lag == 0 else track(at)
        if lag == 0 or course is None:
            course = wanted
        else:
            turn = angle(unrotate(wanted, course)) * (step / lag)
            course = rotate(torch.stack((turn.cos(), turn.sin())), course)
        at = at + step * course
    return torch.stack(way)


class TestFollowLine:
    DIRECTION, POINT = torch.tensor([0.6, -0.8], dtype=torch.float64), torch.tensor([30.0, 10.0], dtype=torch.float64)

    @pytest.mark.parametrize("side", [40.0, -40.0])
    def test_the_error_falls_exponentially_over_the_way_along_the_line(self, side):
        start = (self.POINT + rotate(torch.tensor([0.0, side], dtype=torch.float64), self.DIRECTION)).tolist()
        way = follow(start, lambda at: follow_line(self.POINT - at, self.DIRECTION, 12.0), 0.2, 500)
        x, error = unrotate(way - self.POINT, self.DIRECTION).unbind(-1)
        assert x[-1] > 50
        torch.testing.assert_close(error, side * torch.exp(-x / 12.0), atol=1e-3, rtol=0)

    def test_no_error_stays_in_a_current(self):
        current = torch.tensor([0.5, 0.3], dtype=torch.float64)
        at, speed = torch.tensor([-20.0, 25.0], dtype=torch.float64), torch.tensor(1.5, dtype=torch.float64)
        for _ in range(400):
            track = follow_line(self.POINT - at, self.DIRECTION, 8.0)
            at = at + 0.25 * (speed * crab(track, speed, current) + current)
        assert abs(float(unrotate(at - self.POINT, self.DIRECTION)[1])) < 1e-3


class TestFollowCircle:
    @pytest.mark.parametrize("turn", [1.0, -1.0])
    @pytest.mark.parametrize("start", [60.0, 8.0])
    def test_the_distance_tends_to_the_radius_as_the_closed_form_says(self, start, turn):
        radius, lookahead = 20.0, 15.0
        way = follow((start, 0.0), lambda at: follow_circle(-at, radius, lookahead, turn), 0.1, 1600)
        x, y = way.unbind(-1)
        gone = torch.cat((torch.zeros(1), torch.atan2(x[:-1] * y[1:] - y[:-1] * x[1:], (way[:-1] * way[1:]).sum(-1))))
        round_it = turn * gone.cumsum(0)
        assert round_it[-1] > math.pi
        share = (start - radius) / start * torch.exp(-radius * round_it / lookahead)
        torch.testing.assert_close(way.norm(dim=-1), radius / (1 - share), atol=2e-3, rtol=0)

    @pytest.mark.parametrize("turn", [1.0, -1.0])
    def test_a_slow_vehicle_flies_outside_by_its_lag_and_lead_takes_that_away(self, turn):
        radius, lookahead, lag = 20.0, 10.0, 3.0
        for lead in (0.0, lag):
            way = follow(
                (50.0, 0.0), lambda at, lead=lead: follow_circle(-at, radius, lookahead, turn, lead), 0.1, 4000, lag
            )
            distance = float(way[-1].norm())
            error = lookahead * math.tan((lag - lead) / distance)
            assert distance == pytest.approx(radius + error, abs=0.05)

    def test_at_the_centre_it_is_finite(self):
        assert torch.isfinite(follow_circle(torch.zeros(2), 20.0, 5.0)).all()


class TestSpeedToFly:
    @pytest.mark.parametrize("price", [0.0, 30.0, 200.0])
    @pytest.mark.parametrize("current", [(0.0, 0.0), (0.6, 0.0), (-0.6, 0.3), (0.2, -0.9)])
    def test_a_metre_over_ground_costs_least(self, price, current):
        along, across = current

        def cost(speed):
            return (power(speed) + price) / (math.sqrt(speed**2 - across**2) + along)

        best = minimize_scalar(cost, bounds=(1.2, 2.2), method="bounded", options={"xatol": 1e-6}).x
        rule = SpeedToFly(scenario())
        found = rule(torch.tensor([1.0, 0.0]), torch.tensor(price), torch.tensor(current))
        assert float(found) == pytest.approx(best, abs=0.5 * (2.2 - 1.2) / 32 + 1e-3)


class TestClearOfOthers:
    def test_follows_the_negative_gradient_of_the_potential(self):
        """By differences of ½ η (1/ρ − 1/ρ₀)² with η = ρ₀³, in double precision."""
        reach, towards = 1.5 * 5.0, directions(200).double()
        others = (directions(200, seed=1) * torch.linspace(1.0, 9.0, 200).unsqueeze(-1)).double()

        def potential(at):
            distance = (others - at).norm(dim=-1)
            return torch.where(distance < reach, 0.5 * reach**3 * (1 / distance - 1 / reach) ** 2, 0.0)

        step = 1e-5
        steps = step * torch.eye(2, dtype=torch.float64)
        push = torch.stack([(potential(-way) - potential(way)) / (2 * step) for way in steps], -1)
        expected = unit(towards + push)
        torch.testing.assert_close(clear_of_others(towards, others.unsqueeze(-2), 5.0), expected, atol=1e-6, rtol=0)

    def test_only_the_nearest_repels_and_coincidence_is_finite(self):
        east = torch.tensor([1.0, 0.0])
        north_near, south = torch.tensor([0.0, 2.0]), torch.tensor([0.0, -3.0])
        both = clear_of_others(east, torch.stack([south, north_near]), 5.0)
        torch.testing.assert_close(both, clear_of_others(east, north_near.unsqueeze(0), 5.0))
        assert float(both[1]) < -0.9  # away from the one in the north
        assert float(clear_of_others(east, torch.zeros(1, 2), 5.0).norm()) == pytest.approx(1.0)


class TestGuidedFrame:
    def observe(self, place, target):
        """One AUV of a pair at a place of the toy area, its target at another, in the toy's current; (1, 2, O)."""
        world = ToyWorld(scenario(), 1)
        world.reset()
        world.position[:] = torch.tensor(place)
        world.position[0, 1] = torch.tensor([50.0, 50.0])
        world.target[:] = torch.tensor(target)
        return world, world._observe()

    @pytest.mark.parametrize("count", [1, 2, 5])
    def test_no_action_is_the_heuristic_clear(self, count):
        toy = scenario(auv={"count": count, "safe_distance": 20.0})
        world = ToyWorld(toy, 64, seed=3)
        clear, pace = (policies.load(f"{name}:{PRICE}", world) for name in ("clear", "pace"))
        observation = world.reset()
        inside = ((world.position > BORDER_MARGIN) & (world.position < 100 - BORDER_MARGIN)).all(-1)
        action = GuidedFrame(toy).decode(observation, torch.zeros(64, count, 2))
        assert inside.sum() > 50
        torch.testing.assert_close(action[inside], clear.act(observation)[inside])
        repelled = (action - pace.act(observation)).norm(dim=-1)[inside] > 1e-3
        assert repelled.any() == (count > 1)

    @pytest.mark.parametrize(("side", "course"), [("west", 1.0), ("west", 0.6), ("north", -0.5)])
    def test_a_course_that_leads_out_is_turned_along_the_border(self, side, course):
        place, axis, outwards = {"west": ((2.0, 40.0), 0, -1.0), "north": ((40.0, 98.5), 1, 1.0)}[side]
        world, observation = self.observe(place, (80.0, 40.0) if side == "west" else (20.0, 98.0))
        action = GuidedFrame(world.scenario).decode(observation, torch.tensor([course, 0.0]).expand(1, 2, 2))
        ground = (world.velocity(action) + world.drift)[0, 0]
        assert outwards * float(ground[axis]) < 1e-5
        assert float(ground.norm()) > 0.5


class TestPassingFrame:
    def test_no_action_is_the_heuristic_pass_and_actions_are_offsets_from_it(self):
        observed = 'observation.extra=["attitude", "motion", "depth"]'  # as in the tests of vehicles in worlds
        world = World(Scenario.load("extreme-torpedo", [observed]), 8, 3, "centroid")
        frame, heuristic = PassingFrame(world.scenario), policies.load("pass", world)
        observation, same = world.reset(), []
        for _ in range(40):
            action = heuristic.act(observation)
            plain = frame.decode(observation, torch.zeros_like(action))
            same.append(((plain - action).abs() < 0.01).all(-1))
            offset = frame.decode(observation, torch.tensor([0.5, -0.25]).to(action).expand(8, 2, 2))
            observation = world.step(action)[0]
        assert torch.stack(same).float().mean() > 0.95  # the course of `pass` is the true one, with the storm in it
        for each in (heuristic, policies.load("loiter", world)):  # on a CPU kernels compute them
            in_torch = command(*each.steer(observation), world.scenario)
            torch.testing.assert_close(each.act(observation), in_torch, atol=1e-5, rtol=0)
        auv = world.scenario.auv
        turned = angle(unrotate(offset, unit(plain)))
        torch.testing.assert_close(turned, torch.full_like(turned, 0.5 * TURN), atol=1e-4, rtol=0)
        speed = (plain.norm(dim=-1) * auv.speed_max - 0.25 * (auv.speed_max - auv.speed_min)).clamp_min(auv.speed_min)
        torch.testing.assert_close(offset.norm(dim=-1) * auv.speed_max, speed)

    def test_it_says_what_a_scenario_does_not_observe(self):
        with pytest.raises(PolicyError, match=r"'passing': scenario 'wide' does not observe service, next, attitude"):
            PassingFrame(Scenario.load("wide"))


class TestCirclingFrame:
    def observed(self, count, **terms):
        """The frame of a team in `tracking-plain`, and an observation of it with these terms, the others 0."""
        frame = CirclingFrame(Scenario.load("tracking-plain", [f"auv.count={count}", "auv.safe_distance=0"]))
        observation = torch.zeros(1, count, frame.layout.size)
        for name, numbers in terms.items():
            observation[..., frame.layout.slice(name)] = torch.tensor(numbers)
        return frame, observation

    @pytest.mark.parametrize("count", [1, 4])
    def test_features_are_those_of_the_target_and_of_the_circle(self, count):
        """A target 60 m north that goes north, an AUV that goes east; deviations of 60 m along and 15 m across."""
        track = [0.0, 0.493, 0.986, 0.0, 0.6, 0.15, 0.3]
        diagonal = math.hypot(10_000, 10_000)
        frame, observation = self.observed(count, target=[0.0, 60 / diagonal], track=track)
        features = frame.encode(observation)
        expected = torch.tensor([0.5, 0.5, 0.0, 0.0, -1.0, 0.0, math.log(0.25), 0.3]).expand(1, count, 8)
        torch.testing.assert_close(features[..., :8], expected, atol=1e-5, rtol=0)
        torch.testing.assert_close(features[..., 8:].norm(dim=-1), torch.ones(1, count))
        assert frame.features == features.shape[-1]

    def test_an_offset_turns_the_course_of_the_circle(self):
        frame, observation = self.observed(2, target=[0.003, 0.001], track=[0.1, 0.4, 0.9, 0.3, 0.2, 0.3, 0.1])
        plain, offset = (frame.decode(observation, torch.full((1, 2, 1), a)) for a in (0.0, 0.5))
        turned = angle(unrotate(offset, unit(plain)))
        torch.testing.assert_close(turned, torch.full_like(turned, 0.5 * TURN), atol=1e-4, rtol=0)

    def test_a_speed_is_an_action_where_there_is_a_choice(self):
        assert CirclingFrame(Scenario.load("tracking-plain")).actions == 1
        assert CirclingFrame(Scenario.load("tracking")).actions == 2


class TestFrames:
    def turned(self, observation, layout, turn):
        """The observation of the same team with the world turned about the AUV by an angle."""
        observation = observation.clone()
        direction = torch.tensor([math.cos(turn), math.sin(turn)])
        for name in ("others", "target", "current", "current_profile", "next", "attitude"):
            if name not in layout:
                continue
            vectors = observation[..., layout.slice(name)][..., : 2 if name == "attitude" else None]
            vectors.copy_(rotate(vectors.unflatten(-1, (-1, 2)), direction).flatten(-2))
        return observation

    @pytest.mark.parametrize("name", ["toy", "wide-torpedo"])
    def test_target_frame_turns_with_the_target(self, name):
        toy = scenario(auv={"count": 3})
        frame = TargetFrame(toy if name == "toy" else Scenario.load(name))
        observation, _ = observe(toy)
        if name != "toy":
            observation = torch.randn((5, 8, frame.layout.size), generator=torch.Generator().manual_seed(1))
        before, after = frame.encode(observation), frame.encode(self.turned(observation, frame.layout, 0.7))
        assert before.shape[-1] == frame.features
        bearing = [2, 3]
        rest = [index for index in range(frame.features) if index not in bearing]
        torch.testing.assert_close(after[..., rest], before[..., rest], atol=1e-5, rtol=0)
        turned = angle(after[..., bearing]) - angle(before[..., bearing])
        torch.testing.assert_close(turned.remainder(2 * math.pi), torch.full_like(turned, 0.7), atol=1e-4, rtol=0)

    def test_course_and_speed_come_out_as_asked(self):
        toy = scenario()
        observation, world = observe(toy)
        asked = 2.0 * torch.rand((64, 2, 2), generator=torch.Generator().manual_seed(1)) - 1.0
        velocity = world.velocity(TargetFrame(toy).decode(observation, asked))
        torch.testing.assert_close(velocity.norm(dim=-1), 1.7 + 0.5 * asked[..., 1], atol=1e-5, rtol=0)
        course = angle(unrotate(velocity, unit(world.target - world.position)))
        off = (course - math.pi * asked[..., 0] + math.pi).remainder(2 * math.pi) - math.pi
        assert off.abs().max() < 1e-4

    @pytest.mark.parametrize(
        ("name", "shared", "auv", "observed"),
        [
            ("guided", True, {"count": 2}, {"current": "vector"}),
            ("guided", False, {"count": 5, "model": "torpedo", "action": "vector-depth"}, {"current": "profile"}),
            ("guided", False, {"count": 1}, {"current": "speed"}),
            ("target", True, {"count": 3}, {"current": "none"}),
            ("world", False, {"count": 3}, {"current": "none"}),
            ("passing", True, {"count": 4, "model": "torpedo"}, {"current": "vector"}),
            ("passing", False, {"count": 1, "model": "torpedo"}, {"current": "profile"}),
        ],
    )
    def test_a_policy_acts_as_its_frame_and_network_say(self, name, shared, auv, observed):
        """On a CPU kernels compute it: beside torch's results, for 2,000 observations within the area."""
        service = {"service": "passing"} if "model" in auv else {}
        extra = ["next", "attitude", "motion"] if name == "passing" else ["next"]
        toy = scenario(auv=auv, observation=observed | {"extra": extra}, nodes=service)
        generator, frame = torch.Generator().manual_seed(5), frames[name](toy)
        mean, deviation = torch.rand((2, frame.features), generator=generator)
        sizes = (frame.features, 30, 17, 2)  # not whole tiles
        actor = DeterministicActor(1 if shared else toy.auv.count, sizes, generator, output_gain=4.0)
        policy = LearnedPolicy("some", toy, name, Standardizer(mean, 0.5 + deviation), actor, shared)
        observation = torch.rand((2000, toy.auv.count, frame.layout.size), generator=generator) - 0.5
        position = observation[..., frame.layout.slice("position")]
        position.copy_((position + 0.5) / math.sqrt(2))
        if "current" in frame.layout:
            observation[..., frame.layout.slice("current")] *= 5.0  # in some no speed makes headway
        if "service" in frame.layout:
            data = observation[..., frame.layout.slice("service")]
            data.copy_(torch.stack((data[..., 0] > 0.0, data[..., 1] + 0.5), -1))
        off = (policy.act(observation) - policy.actions(observation)).abs()
        assert (off > 1e-5).float().mean() < 5e-3  # of two speeds that cost the same either may be taken
        assert off.quantile(0.999) < 0.1  # or of two sides of a node
        conversion = frame.conversion(2000)
        assert (conversion is None) == (name == "world")
        if conversion:
            found, expected = conversion.features(observation), frame.encode(observation)
            assert ((found - expected).abs() > 1e-4).float().mean() < 5e-3
            action = 2.0 * torch.rand((2000, toy.auv.count, frame.actions), generator=generator) - 1.0
            off = (conversion.commands(action) - frame.decode(observation, action)).abs()
            assert (off > 1e-5).float().mean() < 5e-3
            assert off.quantile(0.999) < 0.1
