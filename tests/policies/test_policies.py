"""The face of `policies`, the heuristics in closed form, and the frames."""

from __future__ import annotations

import math
import re

import pytest
import torch

from tests.policies.toy import LEARNING, ToyWorld, scenario
from tests.slowly import slowly
from usvauv import policies
from usvauv.env import Scenario, World, evaluate
from usvauv.policies import PolicyError, Trainer
from usvauv.policies.frames import TargetFrame, WorldFrame
from usvauv.policies.guidance import rotate, unit, unrotate


def observe(toy, worlds=64, seed=0):
    """Observations of a world that has just begun, and the world."""
    world = ToyWorld(toy, worlds, seed)
    return world.reset(), world


def angle(vector):
    return torch.atan2(vector[..., 1], vector[..., 0])


class TestFace:
    def test_heuristics_come_after_the_trained_ones(self):
        names = policies.available()
        assert names[-7:] == ["straight", "crab", "pace", "clear", "zermelo", "keep", "random"]
        assert names[:-7] == policies.trained()
        world = World(Scenario.load("extreme"))
        for name in names[-7:]:
            assert policies.load(name, world).name == name

    @pytest.mark.parametrize(
        ("name", "part"),
        [
            ("nonsense", "neither a checkpoint directory nor one of"),
            ("straight:fast", "'fast' is not a speed"),
            ("straight:", "'' is not a speed"),
            ("straight:nan", "between 1.2 and 2.2 m/s"),
            ("crab:2.3", "between 1.2 and 2.2 m/s"),
            ("zermelo:2.3", "between 1.2 and 2.2 m/s"),
            ("straight:1.1", "between 1.2 and 2.2 m/s"),
            ("random:3", "takes no parameter"),
            ("pace:-1", "must be at least 0 W"),
            ("clear:fast", "'fast' is not a price of time in W"),
        ],
    )
    def test_a_bad_name_gets_one_clear_line(self, name, part):
        with pytest.raises(PolicyError) as caught:
            policies.check(name, scenario())
        with pytest.raises(PolicyError, match=f"^{re.escape(str(caught.value))}$"):
            policies.load(name, ToyWorld(scenario(), 1))
        message = str(caught.value)
        assert part in message
        assert name in message
        assert "\n" not in message

    @pytest.mark.parametrize(
        ("changes", "part"),
        [
            ({"auv": {"count": 3}}, "number of AUVs 2, but scenario 'toy' has 3"),
            ({"observation": {"current": "speed"}}, "observed current vector, but scenario 'toy' has speed"),
            ({"auv": {"action": "polar"}}, "action form vector, but scenario 'toy' has polar"),
        ],
    )
    def test_a_learned_policy_refuses_another_size(self, changes, part):
        policy = Trainer(ToyWorld(scenario(), 32), LEARNING).policy()
        calm = scenario(storm={"spectrum": "none"})
        assert policy.for_scenario(calm).scenario is calm
        with pytest.raises(PolicyError, match=part):
            policy.for_scenario(scenario(**changes))


@pytest.mark.parametrize(
    "name",
    slowly(["ideal", "extreme", "paper-ideal", "paper-extreme", "station-keeping", "survey", "wide"], "survey", "wide"),
)
def test_the_default_policy_acts_in_every_scenario_and_area(name):
    world = World(Scenario.load(name, ["area.width=150", "area.length=120"]), 2)
    policy = policies.load(policies.default(world.scenario), world)
    assert policy.scenario is world.scenario
    action = policy.act(world.reset())
    assert action.shape == (2, world.num_auvs, 2)
    assert action.abs().max() <= 1.0


class TestStraight:
    @pytest.mark.parametrize("action", ["vector", "polar"])
    @pytest.mark.parametrize("speed", [1.2, 1.7, 2.2])
    def test_velocity_points_at_the_target(self, action, speed):
        toy = scenario(auv={"action": action, "count": 3})
        observation, world = observe(toy)
        velocity = world.velocity(policies.load(f"straight:{speed}", world).act(observation))
        expected = speed * unit(world.target - world.position)
        torch.testing.assert_close(velocity, expected, atol=2e-5, rtol=0)

    def test_default_speed_is_the_recorded_one(self):
        reference = {
            "straight_speed": 1.9,
            "crab_speed": 1.4,
            "pace_price": 20.0,
            "clear_price": 30.0,
            "zermelo_speed": 1.6,
        }
        toy = scenario(reference=reference)
        world = ToyWorld(toy, 1)
        assert policies.load("straight", world).argument == 1.9
        assert policies.load("crab", world).argument == 1.4
        assert policies.load("pace", world).argument == 20.0
        assert policies.load("clear", world).argument == 30.0
        assert policies.load("zermelo", world).argument == 1.6

    def test_on_the_target_it_still_commands_a_speed(self):
        action = policies.load("straight:2.2", ToyWorld(scenario(), 1)).act(torch.zeros(1, 2, 11))
        torch.testing.assert_close(action, torch.tensor([1.0, 0.0]).expand(1, 2, 2))


class TestCrab:
    @pytest.mark.parametrize("action", ["vector", "polar"])
    @pytest.mark.parametrize("drift", [(0.3, -0.2), (-0.8, 0.7), (0.0, 1.1)])
    def test_ground_track_points_at_the_target(self, action, drift):
        toy = scenario(auv={"action": action})
        observation, world = observe(toy)
        world.drift = torch.tensor(drift)
        policy = policies.load("crab:1.3", world)
        water = world.velocity(policy.act(observation))
        torch.testing.assert_close(water.norm(dim=-1), torch.full((64, 2), 1.3), atol=1e-5, rtol=0)
        bearing = unit(world.target - world.position)
        along, across = unrotate(water + world.drift, bearing).unbind(-1)
        assert across.abs().max() < 2e-5
        assert (along > 0).float().mean() > 0.5

    def test_a_current_too_strong_is_met_head_on(self):
        toy = scenario()
        observation, world = observe(toy)
        world.drift = torch.tensor([0.0, 3.0])
        policy = policies.load("crab:1.5", world)
        bearing = unit(world.target - world.position)
        drift_across = unrotate(world.current(), bearing)[..., 1]
        along, across = unrotate(world.velocity(policy.act(observation)), bearing).unbind(-1)
        beyond = drift_across.abs() > 1.5
        assert beyond.any()
        assert along[beyond].abs().max() < 2e-3
        torch.testing.assert_close(across[beyond], -1.5 * drift_across[beyond].sign(), atol=1e-5, rtol=0)


class TestClear:
    """Two or more AUVs; the safe distance is 12 m, so others repel within 18 m."""

    def acting(self, places, targets, name, drift=(0.0, 0.0)):
        """Velocity over ground of AUVs at places (K, 2) with targets (K, 2), m and m/s."""
        world = ToyWorld(scenario(auv={"count": len(places)}), 1)
        world.reset()
        world.position[:], world.target[:], world.drift = (
            torch.tensor(places),
            torch.tensor(targets),
            torch.tensor(drift),
        )
        return (world.velocity(policies.load(name, world).act(world._observe())) + world.drift)[0]

    def test_far_from_the_others_and_alone_it_is_pace(self):
        for places in ([[50.0, 50.0]], [[50.0, 50.0], [50.0, 69.0]], [[50.0, 50.0], [69.0, 50.0], [20.0, 50.0]]):
            targets = [[90.0 - 20.0 * k, 70.0] for k in range(len(places))]
            clear, pace = (self.acting(places, targets, f"{name}:40", (0.3, -0.2)) for name in ("clear", "pace"))
            torch.testing.assert_close(clear, pace)

    def test_the_track_is_that_of_the_potential_of_the_nearest(self):
        """For an AUV 10 m in the north, at r = 1.8: 0.8 r² of the unit vectors' sum point south."""
        places, targets = [[50.0, 50.0], [50.0, 60.0], [38.0, 50.0]], [[90.0, 50.0], [50.0, 95.0], [5.0, 50.0]]
        east, north = self.acting(places, targets, "clear:40", (0.3, -0.2))[0].tolist()
        assert east > 0
        assert north / east == pytest.approx(-0.8 * 1.8**2, rel=1e-4)

    def test_it_stops_approaching_just_above_the_safe_distance(self):
        """The target is behind the other AUV: at 12.3 m = 0.68 · 18 m the terms are of equal size."""
        for distance, sign in ((12.2, -1), (12.4, 1)):
            places, targets = [[40.0, 50.0], [40.0 + distance, 50.0]], [[90.0, 50.0], [90.0, 50.0]]
            first, second = self.acting(places, targets, "clear:40")
            assert math.copysign(1, first[0]) == sign
            assert second[0] > 0

    def test_a_pair_that_meets_separates_mirrored(self):
        places, targets = [[45.0, 50.0], [55.0, 52.0]], [[90.0, 60.0], [10.0, 42.0]]
        first, second = self.acting(places, targets, "clear:40")
        torch.testing.assert_close(first, -second, atol=1e-4, rtol=0)
        apart = torch.tensor(places[0]) - torch.tensor(places[1])
        assert float(first @ apart) > 0

    @pytest.mark.slow
    def test_it_ends_nearly_all_proximity(self):
        scenario = Scenario.load("extreme", ["mission.duration=300"])
        rows = evaluate(scenario, policies.named("clear:50", "pace:50"), episodes=32, seed=7, targets="greedy")
        clear, pace = rows[:32], rows[32:]
        assert sum(row.collisions for row in pace) > 10
        assert sum(row.collisions for row in clear) == 0
        assert sum(row.services for row in clear) > 0.97 * sum(row.services for row in pace)


class TestRandom:
    def test_it_is_uniform_and_repeatable(self):
        toy = scenario()
        observation, world = observe(toy, worlds=4000)
        policy = policies.load("random", world)
        first, second = policy.act(observation), policy.act(observation)
        assert torch.equal(policies.load("random", world).act(observation), first)
        assert not torch.equal(second, first)
        for draws in (first, second):
            assert draws.abs().max() <= 1.0
            # 16000 draws: standard errors of mean, variance and of neighbours' correlation are 0.0046, 0.0024, 0.0026.
            flat = draws.flatten()
            assert abs(float(flat.mean())) < 0.02
            assert abs(float(flat.var()) - 1 / 3) < 0.01
            assert abs(float((flat[1:] * flat[:-1]).mean())) < 0.01
        assert abs(float((first * second).mean())) < 0.01

    def test_a_world_acts_the_same_in_any_batch(self):
        toy = scenario()
        few, many = (
            policies.load("random", world).act(observation)
            for observation, world in (observe(toy, worlds) for worlds in (3, 30))
        )
        assert torch.equal(many[:3], few)


class TestFrames:
    def turned(self, observation, layout, turn):
        """The observation of the same team with the world turned about the AUV by an angle."""
        observation = observation.clone()
        direction = torch.tensor([math.cos(turn), math.sin(turn)])
        for name in ("others", "target", "current"):
            vectors = observation[..., layout.slice(name)]
            vectors.copy_(rotate(vectors.unflatten(-1, (-1, 2)), direction).flatten(-2))
        return observation

    def test_rotations_invert(self):
        vector, direction = torch.randn(50, 2), unit(torch.randn(50, 2))
        torch.testing.assert_close(rotate(unrotate(vector, direction), direction), vector)
        torch.testing.assert_close(unrotate(direction, direction), torch.tensor([1.0, 0.0]).expand(50, 2))

    def test_target_frame_turns_with_the_target(self):
        toy = scenario(auv={"count": 3})
        frame = TargetFrame(toy)
        observation, _ = observe(toy)
        before, after = frame.encode(observation), frame.encode(self.turned(observation, frame.layout, 0.7))
        assert before.shape[-1] == frame.features
        bearing = [2, 3]
        rest = [index for index in range(frame.features) if index not in bearing]
        torch.testing.assert_close(after[..., rest], before[..., rest], atol=1e-5, rtol=0)
        turned = angle(after[..., bearing]) - angle(before[..., bearing])
        torch.testing.assert_close(turned.remainder(2 * math.pi), torch.full_like(turned, 0.7), atol=1e-4, rtol=0)

    def test_target_frame_sees_the_nearest_other(self):
        toy = scenario(auv={"count": 3})
        frame = TargetFrame(toy)
        observation = torch.zeros(1, 3, frame.layout.size)
        frame.term(observation, "others")[:] = torch.tensor([0.5, 0.0, 0.0, 0.1])
        frame.term(observation, "target")[:] = torch.tensor([0.0, 0.3])  # in the north
        features = frame.encode(observation)[0, 0]
        torch.testing.assert_close(features[:1], torch.tensor([0.3]))
        torch.testing.assert_close(features[2:6], torch.tensor([0.0, 1.0, 0.1, 0.0]), atol=1e-6, rtol=0)

    @pytest.mark.parametrize("current", ["none", "speed", "vector"])
    def test_one_auv_has_nobody_beside_it(self, current):
        toy = scenario(auv={"count": 1}, observation={"current": current})
        frame = TargetFrame(toy)
        features = frame.encode(torch.rand(4, 1, frame.layout.size))
        assert features.shape == (4, 1, frame.features)
        assert (features[..., 4:9] == 0).all()

    @pytest.mark.parametrize("form", ["vector", "polar"])
    def test_an_action_of_zero_heads_for_the_target_at_middle_speed(self, form):
        toy = scenario(auv={"action": form})
        observation, world = observe(toy)
        action = TargetFrame(toy).decode(observation, torch.zeros(64, 2, 2))
        torch.testing.assert_close(action, policies.load("straight:1.7", world).act(observation), atol=1e-6, rtol=0)

    @pytest.mark.parametrize("form", ["vector", "polar"])
    def test_course_and_speed_come_out_as_asked(self, form):
        toy = scenario(auv={"action": form})
        observation, world = observe(toy)
        asked = 2.0 * torch.rand((64, 2, 2), generator=torch.Generator().manual_seed(1)) - 1.0
        velocity = world.velocity(TargetFrame(toy).decode(observation, asked))
        torch.testing.assert_close(velocity.norm(dim=-1), 1.7 + 0.5 * asked[..., 1], atol=1e-5, rtol=0)
        course = angle(unrotate(velocity, unit(world.target - world.position)))
        off = (course - math.pi * asked[..., 0] + math.pi).remainder(2 * math.pi) - math.pi
        assert off.abs().max() < 1e-4

    def test_world_frame_changes_nothing(self):
        toy = scenario()
        observation, _ = observe(toy)
        frame = WorldFrame(toy)
        assert torch.equal(frame.encode(observation), observation)
        assert frame.features == observation.shape[-1]
        action = torch.rand(64, 2, 2)
        assert frame.decode(observation, action) is action
