"""TorchRL face: the library's own check, agreement with the world, partial resets, specs, ownership of tensors."""

import subprocess
import sys

import numpy as np
import pytest
import torch

from usvauv.env import Scenario, World
from usvauv.env.site.site import Site
from usvauv.env.world.agents import auv_observation_space

pytest.importorskip("torchrl")

from torchrl.envs.utils import check_env_specs, step_mdp

from usvauv.env.interfaces.torchrl_env import DataCollectionTorchRLEnv

STEPS = 5
OBSERVATION, ACTION, REWARD = ("agents", "observation"), ("agents", "action"), ("agents", "reward")


@pytest.fixture(scope="module")
def short():
    return Scenario.load("extreme", [f"mission.duration={STEPS}"])


def actions(count, num_worlds=3, num_auvs=2):
    return 2 * torch.rand(count, num_worlds, num_auvs, 2, generator=torch.Generator().manual_seed(0)) - 1


def step(env, data, move):
    """The world's answer to a move, and what the next step starts from."""
    data = env.step(data.set(ACTION, move))
    return data["next"], step_mdp(data)


def mask_of(data, *worlds):
    mask = torch.zeros(data.batch_size[0], 1, dtype=torch.bool)
    mask[list(worlds)] = True
    return data.clone().set("_reset", mask)


@pytest.mark.parametrize("break_when_any_done", [True, False])
def test_torchrls_own_check(short, break_when_any_done):
    check_env_specs(DataCollectionTorchRLEnv(short, 3, seed=1), break_when_any_done=break_when_any_done)


class TestAgreement:
    def test_is_the_world(self, short):
        """Two episodes; in the first world 0 begins anew after two steps, and each mission ends after its own five."""
        world, env = World(short, 3, seed=7), DataCollectionTorchRLEnv(short, 3, seed=7)
        for ends in ((7, 5, 5), (5, 5, 5)):
            observation, data = world.reset(), env.reset()
            assert torch.equal(data[OBSERVATION], observation)
            assert not data["done"].any()
            assert not data["agents", "info", "measures"].any()
            for number, move in enumerate(actions(max(ends)), start=1):
                if number == 3 and ends[0] == 7:
                    before, data = data, env.reset(mask_of(data, 0))
                    world.reset(torch.tensor([True, False, False]))
                    assert torch.equal(data[OBSERVATION], world.observation)
                    changed = (data[OBSERVATION] != before[OBSERVATION]).flatten(1).any(1)
                    assert changed.tolist() == [True, False, False]
                observation, reward, *_, info = world.step(move)
                got, data = step(env, data, move)
                assert torch.equal(got[OBSERVATION], observation)
                assert torch.equal(got[REWARD].squeeze(-1), reward)
                assert torch.equal(got["agents", "info", "reward_terms"], info["reward_terms"])
                assert torch.equal(got["agents", "info", "measures"], info["measures"])
                for name in ("done", "truncated"):
                    assert got[name].squeeze(-1).tolist() == [number >= end for end in ends]
                assert not got["terminated"].any()

    def test_worlds_not_reset_stay_over(self, short):
        """Whether or not the caller hands in what was, as TorchRL advises."""
        env = DataCollectionTorchRLEnv(short, 3, seed=7)
        data = step_mdp(env.rollout(STEPS)[:, -1])
        assert env.reset(mask_of(data, 1))["done"].squeeze(-1).tolist() == [True, False, True]
        with pytest.warns(UserWarning, match="partial"):
            bare = env.reset(mask_of(data.empty(), 2))
        assert bare["done"].squeeze(-1).tolist() == [True, False, False]


class TestSeeds:
    def test_same_seed_same_episodes(self, short):
        env, other = (DataCollectionTorchRLEnv(short, 3, seed=seed) for seed in (11, 12))
        first, second = env.reset()[OBSERVATION], env.reset()[OBSERVATION]
        assert (first != second).any()
        assert (other.reset()[OBSERVATION] != first).any()
        other.set_seed(11)
        assert torch.equal(other.reset()[OBSERVATION], first)
        assert torch.equal(other.reset()[OBSERVATION], second)


class TestSpecs:
    def test_bounds_are_those_of_the_gymnasium_face(self, short):
        env, space = DataCollectionTorchRLEnv(short, 3), auv_observation_space(Site(short))
        observation, action = env.observation_spec[OBSERVATION], env.full_action_spec[ACTION]
        for spec, low, high in ((observation, space.low, space.high), (action, [-1, -1], [1, 1])):
            np.testing.assert_array_equal(spec.space.low.numpy(force=True), np.broadcast_to(low, spec.shape))
            np.testing.assert_array_equal(spec.space.high.numpy(force=True), np.broadcast_to(high, spec.shape))
        assert (env.action_key, env.reward_key) == (ACTION, REWARD)
        assert env.group_map == {"agents": ["auv_0", "auv_1"]}


class TestTensors:
    def test_are_the_callers(self, short):
        env = DataCollectionTorchRLEnv(short, 3, seed=3)
        moves = actions(2)
        first = env.reset()
        following, _ = step(env, first, moves[0])
        kept = first.clone(), following.clone()
        step(env, first.clone(), moves[1])
        for mine, copy in zip((first, following), kept, strict=True):
            for key, tensor in copy.items(include_nested=True, leaves_only=True):
                assert torch.equal(mine[key], tensor), key


class TestRefusals:
    def test_too_early(self, short):
        env = DataCollectionTorchRLEnv(short, 3)
        with pytest.raises(RuntimeError, match="reset before"):
            env.rand_step()
        with pytest.raises(RuntimeError, match="first reset"):
            env.reset(mask_of(env.fake_tensordict(), 0))

    @pytest.mark.parametrize(
        ("library", "module", "what"),
        [
            ("torchrl", "torchrl_env", "TorchRL face"),
            pytest.param("benchmarl", "benchmarl_task", "BenchMARL task", marks=pytest.mark.slow),
        ],
    )
    def test_without_the_library(self, library, module, what):
        """The package does not import it; the face names the extra that brings it."""
        absent = f"import sys, usvauv.env; assert '{library}' not in sys.modules; sys.modules['{library}'] = None"
        code = f"{absent}; import usvauv.env.interfaces.{module}"
        run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        assert run.stderr.splitlines()[-1] == (
            f'ModuleNotFoundError: the {what} needs the extra {library}: pip install "usvauv[{library}]"'
        )
