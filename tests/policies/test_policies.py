"""The face of `policies`, and the heuristics in closed form."""

from __future__ import annotations

import copy
import pickle
import re
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.reduction import ForkingPickler

import pytest
import torch

from tests.policies.toy import LEARNING, ToyWorld, observe, scenario, seeded
from usvauv import policies
from usvauv.env import Scenario, World, run_episodes
from usvauv.env.scenario.fields import shipped
from usvauv.policies import PolicyError, TrainingRun
from usvauv.policies import policy as policy_base
from usvauv.policies.guidance import unit, unrotate


@pytest.mark.parametrize(
    ("name", "where"), [("clear", "extreme"), ("sac-extreme", "extreme"), ("ppo-wide-torpedo", "wide-torpedo")]
)
def test_actions_of_many_worlds_are_those_of_each(name, where, monkeypatch):
    world = ToyWorld(Scenario.load(where), 2100)
    policy, shape = policies.load(name, world), (2100, world.num_auvs)
    observation = torch.rand((*shape, world.observation_size), generator=seeded())
    monkeypatch.setattr(policy_base, "LARGEST_PIECE", 700)
    divided = policy.act(observation)
    monkeypatch.setattr(policy_base, "PIECE", 1 << 30)
    monkeypatch.setattr(policy_base, "LARGEST_PIECE", 1 << 30)
    torch.testing.assert_close(divided, policy.act(observation), rtol=0, atol=0)
    assert divided.shape == (*shape, 2)
    if name != "clear":  # which reads the current of a whole world
        assert torch.equal(policy.act(observation[7:12]), divided[7:12])


BATCHES = ((0, 130), (0, 1), (0, 8), (90, 40), (123, 7))  # first world, number of worlds; the first has all
ACTING = [
    *((name, "", ()) for name in shipped()),
    ("extreme", "sac-extreme", ()),
    ("wide-torpedo", "", ("auv.action=fins",)),
    *(("wide-torpedo", name, ()) for name in ("pass", "loiter", "random")),
    ("wide", "crab", ()),
]
LONG = ("paper-ideal", ""), ("paper-extreme", ""), ("extreme-torpedo", ""), ("ideal", ""), ("bore", "")
LONG += ("coast", ""), ("wide-torpedo", ""), ("wide-torpedo", "loiter"), ("wide", "crab"), ("survey", "")
LONG += (("tracking-plain", ""),)


@pytest.mark.parametrize(
    ("name", "policy", "changes"),
    [
        pytest.param(*each, marks=[pytest.mark.slow] * (each[:2] in LONG or "auv.action=fins" in each[2]))
        for each in ACTING
    ],
)
def test_an_episode_is_the_same_in_any_batch(name, policy, changes):
    """Bit for bit: actions of `policy` or the default one, and what comes of them."""
    chosen = Scenario.load(name, [*changes, "sea.realisations=1"])
    found = {}
    for first, count in BATCHES:
        world = World(chosen, count, 5, first_world=first)
        act, seen, steps = policies.load(policy or policies.default(chosen), world).act, world.reset(), []
        for _ in range(12):
            action = act(seen)
            seen, reward, *_ = world.step(action)
            steps.append(torch.cat((seen.flatten(1), action.flatten(1), reward.flatten(1)), 1))
        found[first, count] = torch.stack(steps, 1)
        assert torch.equal(found[first, count], found[BATCHES[0]][first : first + count]), (first, count)


class TestActing:
    """A learned policy acts as its network says, wherever and however often; on a CPU its kernel has memory."""

    def policy(self, name="sac-extreme"):
        """One that has acted, in torch's inference mode."""
        world = ToyWorld(Scenario.load("extreme"), 3)
        policy, observation = policies.load(name, world), torch.rand((3, 2, world.observation_size), generator=seeded())
        with torch.inference_mode():
            policy.act(observation)
        return policy, observation

    def test_after_another_mode_in_copies_and_for_other_sizes(self):
        policy, observation = self.policy()
        copies = [policy, copy.deepcopy(policy), pickle.loads(pickle.dumps(policy))]
        for each in copies:
            for seen in (observation, observation[:1], observation[:, :1]):  # of one world, and one AUV of each
                torch.testing.assert_close(each.act(seen), policy.actions(seen), rtol=0, atol=1e-5)

    def test_after_it_was_sent_to_another_process(self):
        """Torch moves tensors that it sends into shared memory."""
        policy, observation = self.policy()
        ForkingPickler.dumps(policy)
        policy.standardizer.mean.add_(1.0)
        with torch.no_grad():
            for weights in policy.actor.parameters():
                weights.mul_(0.9)
        torch.testing.assert_close(policy.act(observation), policy.actions(observation), rtol=0, atol=1e-5)

    def test_what_is_not_a_number_stays_so(self):
        policy, observation = self.policy()
        observation[0, 0, 0] = torch.nan
        assert torch.equal(policy.act(observation).isnan(), policy.actions(observation).isnan())
        with torch.no_grad():
            policy.actor.weights[1][0, 3, 1] = torch.nan
        assert policy.act(observation)[:, 0].isnan().all()

    def test_a_policy_of_the_passing_frame_can_be_copied(self):
        world = ToyWorld(Scenario.load("wide-torpedo"), 3)
        policy = policies.load("ppo-wide-torpedo", world)
        observation = torch.rand((3, world.num_auvs, world.observation_size), generator=seeded())
        torch.testing.assert_close(copy.deepcopy(policy).act(observation), policy.act(observation), rtol=0, atol=0)

    def test_in_several_threads_at_once(self):
        policy, observation = self.policy()
        seen = [observation, observation.flip(0)]
        wanted = [policy.actions(each).detach() for each in seen]

        def off(index):
            return max((policy.act(seen[index]) - wanted[index]).abs().max().item() for _ in range(1000))

        with ThreadPoolExecutor(2) as pool:
            assert max(pool.map(off, range(2))) < 1e-5


class TestFace:
    @pytest.mark.parametrize(
        ("name", "part"),
        [
            ("nonsense", "allowed are ppo-wide-torpedo, sac-extreme"),
            ("straight:fast", "'fast' is not a speed"),
            ("straight:nan", "between 1.2 and 2.2 m/s"),
            ("crab:2.3", "between 1.2 and 2.2 m/s"),
            ("random:3", "takes no parameter"),
            ("pace:-1", "must be at least 0 W"),
            ("pass", "needs nodes.service = passing"),
            ("helm", 'needs auv.action = "fins", not "vector"'),
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

    def test_a_learned_policy_refuses_another_form_of_action(self):
        policy = TrainingRun(ToyWorld(scenario(), 32), LEARNING).policy()
        calm = scenario(storm={"spectrum": "none"})
        assert policy.for_scenario(calm).scenario is calm
        deep = scenario(auv={"action": "vector-depth", "model": "torpedo"}, nodes={"service": "passing"})
        with pytest.raises(PolicyError, match="action form vector, but scenario 'toy' has vector-depth"):
            policy.for_scenario(deep)


@pytest.mark.parametrize("name", Scenario.shipped())
def test_the_default_policy_acts_in_every_scenario_and_area(name):
    """On numbers in the place of observations: a world of each scenario would take seconds to compile."""
    small = ["area.width=150", "area.length=120", "auv.start_margin=10", "nodes.margin=10"]
    world = ToyWorld(Scenario.load(name, small), 2)
    policy = policies.load(policies.default(world.scenario), world)
    assert policy.scenario is world.scenario
    observation = torch.rand((2, world.num_auvs, world.observation_size), generator=torch.Generator().manual_seed(0))
    action = policy.act(observation)
    assert action.shape == (2, world.num_auvs, 2)
    assert action.abs().max() <= 1.0


class TestStraight:
    @pytest.mark.parametrize("speed", [1.2, 1.7, 2.2])
    def test_velocity_points_at_the_target(self, speed):
        toy = scenario(auv={"count": 3})
        observation, world = observe(toy)
        velocity = world.velocity(policies.load(f"straight:{speed}", world).act(observation))
        expected = speed * unit(world.target - world.position)
        torch.testing.assert_close(velocity, expected, atol=2e-5, rtol=0)


class TestCrab:
    @pytest.mark.parametrize("drift", [(0.3, -0.2), (-0.8, 0.7), (0.0, 1.1)])
    def test_ground_track_points_at_the_target(self, drift):
        observation, world = observe(scenario())
        world.drift = torch.tensor(drift)
        policy = policies.load("crab:1.3", world)
        water = world.velocity(policy.act(observation))
        torch.testing.assert_close(water.norm(dim=-1), torch.full((64, 2), 1.3), atol=1e-5, rtol=0)
        bearing = unit(world.target - world.position)
        along, across = unrotate(water + world.drift, bearing).unbind(-1)
        assert across.abs().max() < 2e-5
        assert (along > 0).float().mean() > 0.5


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

    @pytest.mark.slow
    def test_it_ends_nearly_all_proximity(self):
        scenario = Scenario.load("extreme", ["mission.duration=300"])
        rows = run_episodes(scenario, policies.named("clear:50", "pace:50"), episodes=32, seed=7, targets="greedy")
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
