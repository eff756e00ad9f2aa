"""Replay, stacked networks, and each algorithm on a task it must solve."""

from __future__ import annotations

import dataclasses

import pytest
import torch

import policies
from policies import PolicyError, Trainer, TrainingConfig
from policies.algorithms import ALGORITHMS, Sizes
from policies.algorithms.learner import AVERAGED
from policies.learned import Whitening
from policies.networks import ACTION_GAIN, Critic, DeterministicActor, GaussianActor, StackedMLP
from policies.noise import CorrelatedNoise
from policies.replay import Batch, Replay, stack, unstack
from tests.toy import ToyWorld, mean_reward, scenario

CPU = torch.device("cpu")
TOY = TrainingConfig(
    num_worlds=32,
    frame="target",
    hidden=(64, 64),
    batch=256,
    warmup=1600,
    gamma=0.95,
    n_step=3,
    tau=0.05,
    reward_scale=0.2,
    replay=100_000,
)


def seeded(seed=0):
    return torch.Generator().manual_seed(seed)


def random_batch(stack_size, batch=32, features=5, seed=0):
    draw = seeded(seed)
    return Batch(
        observation=torch.randn((stack_size, batch, features), generator=draw),
        action=2.0 * torch.rand((stack_size, batch, 2), generator=draw) - 1.0,
        reward=torch.randn((stack_size, batch), generator=draw),
        discount=torch.full((stack_size, batch), 0.9),
        next_observation=torch.randn((stack_size, batch, features), generator=draw),
    )


class TestReplay:
    def filled(self, rewards, terminated=(), ends=(), rows=20):
        """One world, one AUV; the observation at step t is t, and an episode's end adds an observation of its own."""
        replay = Replay(rows, (1, 1, 1, 1), CPU, shared=False)
        clock = 0
        for step, reward in enumerate(rewards):
            one = torch.full((1, 1), float(reward))
            replay.add(
                torch.full((1, 1, 1), float(clock)), one.unsqueeze(-1), one, torch.tensor([[step in terminated]])
            )
            clock += 1
            if step in ends:
                replay.finish(torch.full((1, 1, 1), float(clock)))
                clock += 1
        return replay

    def drawn(self, replay, n, gamma=0.5):
        """(reward, discount, next observation) of each transition drawn, by the observation it starts from."""
        batch = replay.sample(500, n, gamma, seeded())
        values = torch.stack(
            (batch.observation[0, :, 0], batch.reward[0], batch.discount[0], batch.next_observation[0, :, 0]), -1
        )
        return {int(row[0]): tuple(row[1:].tolist()) for row in values}

    def test_n_step_returns(self):
        drawn = self.drawn(self.filled([1, 2, 4, 8, 16, 32, 64]), n=3)
        # 2 + 4/2 + 8/4, then the value of observation 4 with weight 1/8.
        assert drawn[1] == (6.0, 0.125, 4.0)
        assert drawn[2] == (12.0, 0.125, 5.0)
        assert drawn[3] == (24.0, 0.125, 6.0)
        assert set(drawn) == {1, 2, 3}

    def test_termination_cuts_the_value(self):
        drawn = self.drawn(self.filled([1, 2, 4, 8, 16, 32, 64], terminated={2}), n=3)
        assert drawn[1][:2] == (4.0, 0.0)  # 2 + 4/2, nothing after
        assert drawn[2][:2] == (4.0, 0.0)
        assert drawn[3] == (24.0, 0.125, 6.0)  # the episode goes on

    def test_truncation_bootstraps_from_the_last_observation(self):
        # Steps at observations 0 1 2 3, the episode ends in observation 4, the next begins at 5.
        drawn = self.drawn(self.filled([1, 2, 4, 8, 16, 32, 64, 128], ends={3}), n=3)
        assert drawn[1] == (6.0, 0.125, 4.0)
        assert drawn[2] == (8.0, 0.25, 4.0)
        assert drawn[3] == (8.0, 0.5, 4.0)
        assert drawn[5] == (48.0, 0.125, 8.0)
        assert 4 not in drawn

    def test_one_step(self):
        drawn = self.drawn(self.filled([1, 2, 4, 8], terminated={1}), n=1)
        assert drawn == {1: (2.0, 0.0, 2.0), 2: (4.0, 0.5, 3.0)}

    def test_the_ring_forgets_the_oldest(self):
        drawn = self.drawn(self.filled([float(step) for step in range(27)], rows=10), n=2)
        assert set(drawn) == set(range(18, 25))
        assert drawn[24] == (24 + 0.5 * 25, 0.25, 26.0)

    def test_agents_and_worlds_stay_together(self):
        replay = Replay(8, (3, 2, 1, 1), CPU, shared=False)
        for step in range(8):
            place = 100.0 * step + 10.0 * torch.arange(3.0).view(3, 1) + torch.arange(2.0)
            replay.add(place.unsqueeze(-1), place.unsqueeze(-1), place, place == 311)
        batch = replay.sample(200, 1, 0.9, seeded())
        assert torch.equal(batch.observation[..., 0], batch.reward)
        assert torch.equal(batch.action[..., 0], batch.reward)
        assert torch.equal(batch.reward[0] % 10, torch.zeros(200))
        assert torch.equal(batch.reward[1] % 10, torch.ones(200))
        assert torch.equal(batch.next_observation[..., 0], batch.reward + 100)
        assert torch.equal(batch.discount == 0, batch.reward == 311)
        assert (batch.reward == 311).any()

    def test_shared_learners_get_the_transitions_of_all(self):
        replay = Replay(8, (3, 2, 1, 1), CPU, shared=True)
        for step in range(8):
            place = 10.0 * step + torch.arange(2.0).expand(3, 2)
            replay.add(place.unsqueeze(-1), place.unsqueeze(-1), place, torch.zeros(3, 2, dtype=torch.bool))
        batch = replay.sample(64, 1, 0.9, seeded())
        assert batch.observation.shape == (1, 64, 1)
        assert set((batch.reward % 10).flatten().tolist()) == {0.0, 1.0}
        assert torch.equal(batch.observation[..., 0], batch.reward)

    @pytest.mark.parametrize("shared", [False, True])
    def test_unstack_inverts_stack(self, shared):
        value = torch.randn(5, 3, 4)
        assert torch.equal(unstack(stack(value, shared), 3), value)


class TestNetworks:
    def alone(self, network, index, x):
        """Member `index` of a stack, computed with plain matrix products."""
        for layer, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
            x = x @ weight[index] + bias[index]
            if layer < len(network.weights) - 1:
                if network.layer_norm:
                    x = (x - x.mean(-1, keepdim=True)) / (x.var(-1, keepdim=True, correction=0) + 1e-5).sqrt()
                x = x.clamp_min(0.0)
        return x

    @pytest.mark.parametrize("layer_norm", [False, True])
    def test_a_stack_equals_its_members(self, layer_norm):
        network = StackedMLP(3, (4, 16, 8, 2), seeded(), layer_norm)
        x = torch.randn((3, 10, 4), generator=seeded(1))
        for index in range(3):
            torch.testing.assert_close(network(x)[index], self.alone(network, index, x[index]))
        assert not torch.allclose(network(x[:1].expand(3, -1, -1))[0], network(x[:1].expand(3, -1, -1))[1])

    def test_critics_share_the_input_of_their_agent(self):
        critic = Critic(2, 3, 4, 2, (16,), seeded(), layer_norm=False)
        observation, action = torch.randn(3, 10, 4), torch.randn(3, 10, 2)
        value = critic(observation, action)
        for twin in range(2):
            for agent in range(3):
                x = torch.cat((observation[agent], ACTION_GAIN * action[agent]), -1)
                expected = self.alone(critic.of_state, 3 * twin + agent, observation[agent])
                expected = expected + self.alone(critic.of_action, 3 * twin + agent, x)
                torch.testing.assert_close(value[twin, agent], expected[:, 0])

    def test_the_squashed_density_integrates_to_one(self):
        actor = GaussianActor(1, (3, 8, 2), seeded(), output_gain=0.0)
        with torch.no_grad():
            actor.biases[-1][..., 0] = 0.3  # the mean; 0.8047 is a deviation of 1
            actor.biases[-1][..., 1] = 0.8047
        action, log_density = actor.sample(
            torch.zeros(1, 200_000, 3), torch.randn((1, 200_000, 1), generator=seeded(1))
        )
        # The mean of 1/p over draws from p is the area they come from.
        inside = action[..., 0].abs() < 0.9
        area = ((-log_density).exp() * inside).mean().detach()
        torch.testing.assert_close(area, torch.tensor(1.8), rtol=0.02, atol=0)
        torch.testing.assert_close(actor(torch.zeros(1, 1, 3)).flatten(), torch.tensor([0.3]).tanh())

    def test_the_mode_is_deterministic(self):
        actor = DeterministicActor(2, (3, 8, 2), seeded())
        x = torch.randn(2, 5, 3)
        assert torch.equal(actor(x), actor(x))
        assert actor(100.0 * x).abs().max() <= 1.0


class TestLearners:
    @pytest.mark.parametrize("algorithm", ["sac", "td3", "ddpg"])
    def test_an_agent_learns_nothing_from_the_data_of_another(self, algorithm):
        learners = []
        for scale in (1.0, 5.0):
            learner = ALGORITHMS[algorithm](Sizes(2, 5, 2), TOY, seeded())
            for step in range(12):
                batch = random_batch(2, seed=step)
                batch.reward[1] *= scale
                learner.update(batch)
                learner.average()
            learners.append(dict(learner.named_parameters()))
        one, other = learners
        for name in one:
            first, second = one[name].data, other[name].data
            if "critic" in name:  # (critics · agents, ...), the agent varying fastest
                first, second = first.unflatten(0, (-1, 2)), second.unflatten(0, (-1, 2))
                assert torch.equal(first[:, 0], second[:, 0])
                differs = first[:, 1], second[:, 1]
            else:
                assert torch.equal(first[0], second[0])
                differs = first[1], second[1]
            assert not torch.equal(*differs)

    def test_ddpg_target_is_the_bellman_target(self):
        learner = ALGORITHMS["ddpg"](Sizes(1, 5, 2), TOY, seeded())
        batch = random_batch(1)
        value = learner.critic(batch.observation, batch.action)[0]
        future = learner.target_critic(batch.next_observation, learner.target_actor(batch.next_observation))[0]
        expected = (value - batch.reward - 0.9 * future).square().mean()
        assert float(learner.update(batch)["critic_loss"]) == pytest.approx(float(expected.detach()), rel=1e-5)

    def test_targets_follow_by_tau(self):
        learner = ALGORITHMS["ddpg"](Sizes(1, 5, 2), TOY, seeded())
        before = [value.clone() for value in learner.target_critic.parameters()]
        learner.update(random_batch(1))
        for old, new, network in zip(
            before, learner.target_critic.parameters(), learner.critic.parameters(), strict=True
        ):
            torch.testing.assert_close(new.data, old + TOY.tau * (network.data - old))

    def test_td3_waits_before_it_moves_its_actor(self):
        learner = ALGORITHMS["td3"](Sizes(1, 5, 2), TOY, seeded())
        before = [value.clone() for value in learner.actor.parameters()]
        learner.update(random_batch(1))
        assert all(torch.equal(old, new) for old, new in zip(before, learner.actor.parameters(), strict=True))
        learner.update(random_batch(1))
        assert not any(torch.equal(old, new) for old, new in zip(before, learner.actor.parameters(), strict=True))

    def test_temperature_falls_while_entropy_is_above_its_target(self):
        learner = ALGORITHMS["sac"](Sizes(2, 5, 2), TOY, seeded())
        before = learner.log_alpha.detach().clone()
        figures = learner.update(random_batch(2))
        assert float(figures["entropy"]) > learner.target_entropy
        assert (learner.log_alpha < before).all()


class TestNoise:
    def test_variance_and_correlation(self):
        noise = CorrelatedNoise((20_000,), 0.8, seeded())
        path = torch.stack([noise.step() for _ in range(6)])
        for lag in range(4):
            # Standard error of a mean over 20000 products is below 0.01.
            assert float((path[0] * path[lag]).mean()) == pytest.approx(0.8**lag, abs=0.04)


class TestWhitening:
    def test_it_standardises_and_leaves_constants(self):
        samples = torch.randn((100, 4, 3), generator=seeded()) * torch.tensor([10.0, 0.1, 0.0]) + 2.0
        white = Whitening.of(samples)(samples).flatten(0, 1)
        torch.testing.assert_close(white.mean(0), torch.zeros(3), atol=1e-4, rtol=0)
        torch.testing.assert_close(white.std(0, correction=0), torch.tensor([1.0, 1.0, 0.0]), atol=1e-4, rtol=0)


class TestTraining:
    @pytest.mark.parametrize(
        ("algorithm", "changes"),
        [
            ("sac", {}),
            ("td3", {}),
            ("ddpg", {}),
            ("ddpg", {"shared": True}),
            ("sac", {"frame": "world"}),
            ("sac", {"frame": "guided"}),
        ],
    )
    def test_each_algorithm_solves_the_toy_task(self, algorithm, changes):
        toy = scenario()
        trainer = Trainer(ToyWorld(toy, 32, seed=1), dataclasses.replace(TOY, algorithm=algorithm, **changes))

        def score(policy):
            return mean_reward(ToyWorld(toy, 64, seed=99), policy)

        untrained = score(trainer.policy())
        figures = trainer.train(32_000)
        learned = score(trainer.policy())
        random, middle, fast, best = (
            score(policies.load(name, toy)) for name in ("random", "straight:1.7", "straight:2.0", "straight:2.2")
        )
        assert random < 0.5 < 5.0 < middle < fast < best
        if changes.get("frame") == "world":
            # In world axes the untrained policy knows nothing.
            assert untrained < 2.0
            assert learned > 0.7 * best
        elif changes.get("frame") == "guided":
            assert untrained > random
            assert learned > fast
        else:
            # In the target's frame it heads for the target at the middle speed; learning finds that fast is better.
            assert untrained == pytest.approx(middle, abs=0.2)
            assert learned > fast
        assert figures["updates"] == figures["steps"] // 32 - TOY.warmup // 32

    def test_same_seed_same_result(self):
        def run(seed):
            config = dataclasses.replace(TOY, seed=seed)
            trainer = Trainer(ToyWorld(scenario(), 32, seed=1), config)
            trainer.train(3200)
            return trainer.learner.tensors()

        first, again, other = run(0), run(0), run(1)
        assert first.keys() == again.keys()
        assert all(torch.equal(first[name], again[name]) for name in first)
        assert not torch.equal(first["actor.weights.0"], other["actor.weights.0"])

    def test_figures_count_what_happened(self):
        toy = scenario()
        seen = []
        trainer = Trainer(ToyWorld(toy, 32, seed=1), dataclasses.replace(TOY, warmup=10_000))
        last = trainer.train(3200, seen.append)
        assert [figures["steps"] for figures in seen] == [320 * i for i in range(1, 11)] or seen[-1] == last
        assert last["steps"] == last["total"] == 3200
        assert last["updates"] == 0
        assert last["arps"] == pytest.approx(sum(last["reward"].values()))
        # Each service earns 1; progress is at most 0.1 · (2.2 + 0.36) for each of two AUVs.
        assert last["reward"]["service"] * toy.mission.steps == pytest.approx(last["services"], rel=1e-6)
        assert last["reward"]["progress"] < 0.512
        assert last["sdr"] == pytest.approx(last["services"])

    def test_terminations_reach_the_targets(self):
        trainer = Trainer(ToyWorld(scenario(), 32, seed=1, terminates=True), TOY)
        trainer.train(3200)
        assert trainer.replay.terminated.any()
        assert int(trainer.replay.end.sum()) == 2

    def test_trains_in_the_real_world(self):
        from usvauv_env import Scenario, World

        config = dataclasses.replace(TOY, num_worlds=4, warmup=80, hidden=(16,), batch=32)
        trainer = Trainer(World(Scenario.load("extreme"), num_worlds=4, seed=5), config)
        figures = trainer.train(320)
        assert figures["updates"] == 60
        assert torch.isfinite(trainer.policy().act(trainer.observation)).all()


class TestConfig:
    @pytest.mark.parametrize(
        ("changes", "part"),
        [
            ({"algorithm": "ppo"}, "algorithm = 'ppo': must be one of sac, td3, ddpg"),
            ({"num_worlds": 0}, "num_worlds = 0: must be at least 1"),
            ({"gamma": 1.0}, "gamma = 1.0: must be at least 0 and below 1"),
            ({"hidden": ()}, "hidden"),
            ({"learning_rate": float("nan")}, "learning_rate = nan"),
            ({"replay": 10}, "replay = 10"),
        ],
    )
    def test_bad_settings_get_one_clear_line(self, changes, part):
        with pytest.raises(PolicyError) as caught:
            TrainingConfig(**changes)
        assert part in str(caught.value)

    def test_the_world_must_have_as_many_worlds(self):
        with pytest.raises(PolicyError, match="num_worlds = 32, but the world has 4"):
            Trainer(ToyWorld(scenario(), 4), TOY)


class TestRenewal:
    def test_a_service_ends_the_horizon_and_the_average_reward_is_taken_off(self):
        config = dataclasses.replace(TOY, warmup=800)
        trainer = Trainer(ToyWorld(scenario(), 32, seed=1), config)
        rewards, ends = [], []
        step, add = trainer.world.step, trainer.replay.add

        def watched(action):
            result = step(action)
            rewards.append(result[1].mean().item())
            ends.append(result[4]["measures"][..., 2].bool())
            return result

        trainer.world.step = watched
        stored = []
        trainer.replay.add = lambda *row: (stored.append(row[3].clone()), add(*row))
        trainer.train(32 * 400)
        assert sum(int(end.sum()) for end in ends) > 50
        assert all(torch.equal(kept, end) for kept, end in zip(stored, ends, strict=True))
        gain = 0.0
        for reward in rewards:
            gain += 0.002 * (reward - gain)
        assert trainer.gain == pytest.approx(gain, rel=1e-4)
        one, other = (trainer.replay.sample(64, 3, 0.9, seeded(5), gain=price) for price in (0.0, 0.25))
        # Each of the m steps of a transition costs the gain, discounted: 1, 1 + 0.9 or 1 + 0.9 + 0.81 of it.
        paid = (one.reward - other.reward) / 0.25
        sums = torch.tensor([1.0, 1.9, 2.71])
        assert (paid.unsqueeze(-1) - sums).abs().amin(-1).max() < 1e-4
        assert ((paid < 1.5) & (one.discount == 0)).any()

    def test_without_it_services_end_nothing(self):
        trainer = Trainer(ToyWorld(scenario(), 32, seed=1), dataclasses.replace(TOY, renewal=False))
        trainer.train(32 * 60)
        assert not trainer.replay.terminated.any()
        assert trainer.gain == 0.0

    def test_where_the_scenario_ends_the_horizon_itself_time_has_no_price(self):
        toy = scenario(reward={"service_terminates": True})
        trainer = Trainer(ToyWorld(toy, 32, seed=1, terminates=True), TOY)
        trainer.train(32 * 60)
        assert trainer.gain == 0.0
        assert trainer.replay.terminated.any()


class TestScales:
    def test_rewards_are_brought_to_the_configured_size(self):
        runs = []
        for size in (0.2, 0.4):
            trainer = Trainer(ToyWorld(scenario(), 32, seed=1), dataclasses.replace(TOY, reward_scale=size, warmup=800))
            trainer.train(32 * 26)
            runs.append(trainer)
        before = runs[0].replay.reward[:25].abs().mean()
        torch.testing.assert_close(before, torch.tensor(0.2), rtol=1e-4, atol=0)
        assert runs[1].scale == pytest.approx(2 * runs[0].scale)

    def test_the_learning_rate_falls_to_its_share(self):
        trainer = Trainer(ToyWorld(scenario(), 32, seed=1), dataclasses.replace(TOY, final_rate=0.1, warmup=0))
        trainer.train(32 * 100)
        rate = trainer.learner.optimisers["actor"].param_groups[0]["lr"]
        assert rate == pytest.approx(TOY.learning_rate * (1 - 0.9 * 99 / 100))

    def test_the_policy_is_the_average_of_the_actor(self):
        learner = ALGORITHMS["ddpg"](Sizes(1, 5, 2), TOY, seeded())
        start = learner.actor.biases[0].detach().clone()
        with torch.no_grad():
            learner.actor.biases[0] += 1.0
        for _ in range(3):
            learner.average()
        expected = start + 1.0 - (1.0 - 1.0 / AVERAGED) ** 3
        torch.testing.assert_close(learner.averaged.biases[0].data, expected)


class TestPolicy:
    def test_one_taken_before_learning_goes_on_with_the_trainer(self):
        trainer = Trainer(ToyWorld(scenario(), 32, seed=1), TOY)
        early = trainer.policy()
        trainer.train(32 * 60)
        observation = ToyWorld(scenario(), 64, seed=7).reset()
        assert torch.equal(early.act(observation), trainer.policy().act(observation))


class TestSettings:
    def test_settings_can_be_changed_by_name(self):
        config = TrainingConfig().changed(["updates=4", "hidden=128,32", "renewal=false", "gamma=0.98", "frame=world"])
        expected = TrainingConfig(updates=4, hidden=(128, 32), renewal=False, gamma=0.98, frame="world")
        assert config == expected

    @pytest.mark.parametrize(
        ("text", "part"),
        [
            ("updates", "NAME=VALUE"),
            ("speed=3", "NAME=VALUE with a NAME of frame"),
            ("seed=3", "NAME=VALUE with a NAME of frame"),
            ("updates=many", "updates = 'many': must be of type int"),
            ("renewal=maybe", "renewal = 'maybe': must be of type bool"),
            ("hidden=12,x", "must be of type tuple"),
            ("gamma=1.5", "gamma = 1.5: must be at least 0 and below 1"),
        ],
    )
    def test_what_is_not_allowed_is_said(self, text, part):
        with pytest.raises(PolicyError, match=part):
            TrainingConfig().changed([text])
