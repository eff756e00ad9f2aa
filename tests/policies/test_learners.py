"""Replay, stacked networks, one update of each algorithm, exploration noise, standardizer."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.policies.toy import LEARNING, seeded
from usvauv.policies.algorithms import Batch, Rollout, Sizes, algorithms, ppo
from usvauv.policies.algorithms.learner import Adam
from usvauv.policies.learned import Standardizer
from usvauv.policies.networks import LARGE, Critic, GaussianActor, StackedMLP
from usvauv.policies.training.exploration import CorrelatedNoise
from usvauv.policies.training.replay import Replay

CPU = torch.device("cpu")


def random_batch(stack_size, batch=32, features=5, seed=0):
    draw = seeded(seed)
    return Batch(
        observation=torch.randn((stack_size, batch, features), generator=draw),
        action=2.0 * torch.rand((stack_size, batch, 2), generator=draw) - 1.0,
        reward=torch.randn((stack_size, batch), generator=draw),
        discount=torch.full((stack_size, batch), 0.9),
        next_observation=torch.randn((stack_size, batch, features), generator=draw),
    )


def as_rollout(batch, decisions=4, parts=1):
    """The same as decisions of one episode."""
    tensors = {name: value.unflatten(1, (decisions, -1)) for name, value in vars(batch).items()}
    follows = torch.ones(decisions)
    follows[-1] = 0.0
    return Rollout(**tensors, follows=follows, parts=parts)


class TestReplay:
    def filled(self, rewards, horizon_ended=(), ends=(), rows=20):
        """One world, one AUV; the observation at step t is t, and an episode's end adds an observation of its own."""
        replay = Replay(rows, (1, 1, 1, 1), CPU, shared=False)
        clock = 0
        for step, reward in enumerate(rewards):
            one = torch.full((1, 1), float(reward))
            replay.add(
                torch.full((1, 1, 1), float(clock)), one.unsqueeze(-1), one, torch.tensor([[step in horizon_ended]])
            )
            clock += 1
            if step in ends:
                replay.finish(torch.full((1, 1, 1), float(clock)))
                clock += 1
        return replay

    def drawn(self, replay, n, gamma=0.5):
        """(reward, discount, next observation) of each transition drawn, by the observation it starts from."""
        batch = replay.sample(500, n, gamma, [seeded()])
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

    def test_the_end_of_the_horizon_cuts_the_value(self):
        drawn = self.drawn(self.filled([1, 2, 4, 8, 16, 32, 64], horizon_ended={2}), n=3)
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

    def test_the_ring_forgets_the_oldest(self):
        drawn = self.drawn(self.filled([float(step) for step in range(27)], rows=10), n=2)
        assert set(drawn) == set(range(18, 25))
        assert drawn[24] == (24 + 0.5 * 25, 0.25, 26.0)

    def test_a_rollout_is_a_sequence_of_decisions(self):
        """Each held for 3 steps; the first episode ends in its second decision, the rollout in its fourth."""
        replay = self.filled([1, 2, 4, 8, 16, 1, 2, 4, 8], ends={4}, horizon_ended={6})
        rollout = replay.take(torch.full((1, 1, 1), 10.0), 3, 0.5, torch.tensor(0.0), batch=2)
        rows = (rollout.observation, rollout.reward, rollout.discount, rollout.next_observation)
        start, reward, discount, after = (row.flatten().tolist() for row in rows)
        assert start == [0, 3, 6, 9]  # observations 5 and 10 are those that end
        assert reward == [1 + 2 / 2 + 4 / 4, 8 + 16 / 2, 1 + 2 / 2, 8]
        assert discount == [0.125, 0.25, 0.0, 0.5]
        assert after[:2] + after[3:] == [3, 5, 10]
        assert rollout.follows.tolist() == [1, 0, 1, 0]
        assert rollout.parts == 2

    def test_agents_and_worlds_stay_together(self):
        replay = Replay(8, (3, 2, 1, 1), CPU, shared=False)
        for step in range(8):
            place = 100.0 * step + 10.0 * torch.arange(3.0).view(3, 1) + torch.arange(2.0)
            replay.add(place.unsqueeze(-1), place.unsqueeze(-1), place, place == 311)
        batch = replay.sample(200, 1, 0.9, [seeded()])
        assert torch.equal(batch.observation[..., 0], batch.reward)
        assert torch.equal(batch.action[..., 0], batch.reward)
        assert torch.equal(batch.reward[0] % 10, torch.zeros(200))
        assert torch.equal(batch.reward[1] % 10, torch.ones(200))
        assert torch.equal(batch.next_observation[..., 0], batch.reward + 100)
        assert torch.equal(batch.discount == 0, batch.reward == 311)
        assert (batch.reward == 311).any()


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

    @pytest.mark.parametrize(("layer_norm", "rows"), [(True, 10), (True, LARGE // 4), (False, LARGE // 4)])
    def test_gradients_of_a_network(self, layer_norm, rows):
        network = StackedMLP(2, (4, 16, 8, 2), seeded(), layer_norm)
        x = torch.randn((2, rows, 4), generator=seeded(1)).requires_grad_()
        parameters = [x, *network.parameters()]
        found = torch.autograd.grad(network(x).square().mean(1).sum(), parameters)
        alone = torch.stack([self.alone(network, index, x[index]) for index in range(2)])
        expected = torch.autograd.grad(alone.square().mean(1).sum(), parameters)
        torch.testing.assert_close(found, expected, rtol=1e-3, atol=1e-5)

    @pytest.mark.parametrize("layer_norm", [False, True])
    def test_a_frozen_critic_gives_its_gradient_to_the_action_alone(self, layer_norm):
        critic = Critic(2, Sizes(3, 4, 2), (8,), seeded(), layer_norm)
        observation = torch.randn((3, 10, 4), generator=seeded(1))
        action = torch.rand((3, 10, 2), generator=seeded(2)).requires_grad_()
        value, frozen = critic(observation, action), critic(observation, action, frozen=True)
        torch.testing.assert_close(frozen, value)
        found = torch.autograd.grad(frozen.exp().sum(), [action, *critic.parameters()], allow_unused=True)
        assert found[1:] == (None,) * len(found[1:])
        torch.testing.assert_close(found[0], torch.autograd.grad(value.exp().sum(), action)[0])

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

    def test_the_density_of_an_action_is_that_of_its_draw_but_for_the_slope(self):
        actor = GaussianActor(2, (3, 8, 4), seeded())
        observation, noise = torch.randn((2, 50, 3), generator=seeded(1)), torch.randn((2, 50, 2), generator=seeded(2))
        action, log_density = actor.sample(observation, noise)
        expected = log_density + (1.0 - action.square()).log().sum(-1) + math.log(2.0 * math.pi)
        torch.testing.assert_close(actor.log_density(observation, action), expected, rtol=1e-3, atol=1e-3)


class TestLearners:
    @pytest.mark.parametrize("algorithm", ["sac", "td3", "ddpg", "ppo"])
    def test_an_agent_learns_nothing_from_the_data_of_another(self, algorithm):
        learners = []
        for scale in (1.0, 5.0):
            learner = algorithms[algorithm](Sizes(2, 5, 2), LEARNING, seeded())
            for step in range(12):
                batch = random_batch(2, seed=step)
                batch.reward[1] *= scale
                learner.learn(as_rollout(batch, parts=2) if learner.on_policy else batch)
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
        learner = algorithms["ddpg"](Sizes(1, 5, 2), LEARNING, seeded())
        batch = random_batch(1)
        value = learner.critics(batch.observation, batch.action)[0]
        future = learner.target_critics(batch.next_observation, learner.target_actor(batch.next_observation))[0]
        expected = (value - batch.reward - 0.9 * future).square().mean()
        assert float(learner.update(batch)["critic_loss"]) == pytest.approx(float(expected.detach()), rel=1e-5)

    @pytest.mark.parametrize("algorithm", ["sac", "td3", "ddpg"])
    def test_the_value_of_a_constant_reward_is_its_geometric_sum(self, algorithm):
        """1 + 1/2 + 1/4 + …; what entropy is worth to SAC is a twentieth of it at first."""
        config = replace(LEARNING, algorithm=algorithm, hidden=(16,), learning_rate=3e-3)
        learner = algorithms[algorithm](Sizes(1, 5, 2), config, seeded())
        batch = random_batch(1)
        batch = replace(batch, reward=torch.ones(1, 32), discount=torch.full((1, 32), 0.5))
        for _ in range(400):
            value = learner.update(batch)["value"]
        assert value.item() == pytest.approx(2.0, abs=0.2)

    def test_ppo_finds_the_action_that_pays_most(self):
        """Reward −|a − a*|², a* = (0.3, −0.2), in a single step; the value does not depend on the action."""
        learner = algorithms["ppo"](Sizes(1, 5, 2), replace(LEARNING, updates=4), seeded())
        best = torch.tensor([0.3, -0.2])
        for step in range(100):
            observation, noise = (torch.randn((1, 256, n), generator=seeded(2 * step + n)) for n in (5, 2))
            action = learner.explore(observation, noise)
            reward = -(action - best).square().sum(-1)
            batch = Batch(observation, action, reward, torch.zeros_like(reward), observation)
            learner.learn(as_rollout(batch, decisions=1))
        assert (learner.actor(observation) - best).abs().mean() < 0.05
        assert (learner.value(observation)[..., 0] - reward.mean()).abs().mean() < 0.02

    def test_generalised_advantages_are_sums_of_errors(self):
        """A_t = Σ_k (Γλ)^k δ_{t+k}, to the end of the episode (Schulman et al., 2016, equation 16)."""
        rollout = as_rollout(random_batch(2, 30), decisions=6)
        rollout.follows[2] = 0.0  # an episode ends after the third
        value, after = torch.randn((2, 2, 6, 5), generator=seeded(1))
        error = rollout.reward + 0.9 * after - value
        found = ppo.advantages(rollout, value, after)
        for t, last in enumerate((2, 2, 2, 5, 5, 5)):
            expected = sum((0.9 * ppo.TRACE) ** (k - t) * error[:, k] for k in range(t, last + 1))
            torch.testing.assert_close(found[:, t], expected)

    def test_td3_waits_before_it_moves_its_actor(self):
        learner = algorithms["td3"](Sizes(1, 5, 2), LEARNING, seeded())
        before = [value.clone() for value in learner.actor.parameters()]
        learner.update(random_batch(1))
        assert all(torch.equal(old, new) for old, new in zip(before, learner.actor.parameters(), strict=True))
        learner.update(random_batch(1))
        assert not any(torch.equal(old, new) for old, new in zip(before, learner.actor.parameters(), strict=True))


class TestNoise:
    def test_variance_and_correlation(self):
        noise = CorrelatedNoise((20_000,), 0.8, seeded())
        path = torch.stack([noise.step() for _ in range(6)])
        for lag in range(4):
            # Standard error of a mean over 20000 products is below 0.01.
            assert float((path[0] * path[lag]).mean()) == pytest.approx(0.8**lag, abs=0.04)


class TestStandardizer:
    def test_it_standardises_and_leaves_constants(self):
        samples = torch.randn((100, 4, 3), generator=seeded()) * torch.tensor([10.0, 0.1, 0.0]) + 2.0
        standardized = Standardizer.of(samples)(samples).flatten(0, 1)
        torch.testing.assert_close(standardized.mean(0), torch.zeros(3), atol=1e-4, rtol=0)
        torch.testing.assert_close(standardized.std(0, correction=0), torch.tensor([1.0, 1.0, 0.0]), atol=1e-4, rtol=0)


def test_adam_takes_the_steps_of_its_formulas():
    theta, rates, draw = np.array([[0.5, -2.0, 3.0]]), (0.1, 0.1, 0.02), seeded()
    gradients = torch.randn((3, *theta.shape), generator=draw) * torch.tensor([1.0, 1e-3, 100.0])
    parameter = torch.nn.Parameter(torch.tensor(theta, dtype=torch.float32))
    adam = Adam([parameter], rates[0])
    m = v = 0.0
    for t, (rate, gradient) in enumerate(zip(rates, gradients, strict=True), 1):
        adam.set_rate(rate)
        adam.step([gradient])
        g = gradient.double().numpy()
        m, v = 0.9 * m + 0.1 * g, 0.999 * v + 0.001 * g * g
        theta = theta - rate * m / (1.0 - 0.9**t) / (np.sqrt(v / (1.0 - 0.999**t)) + 1e-8)
        np.testing.assert_allclose(parameter.detach().numpy(), theta, rtol=1e-5)
