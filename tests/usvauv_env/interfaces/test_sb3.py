"""Stable-Baselines3 face: its library's wrappers and evaluation run on it, and it is the world."""

import numpy as np
import pytest
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecCheckNan, VecMonitor, VecNormalize

from usvauv.env import Scenario, World
from usvauv.env.interfaces.sb3_env import AuvVecEnv

STEPS, WORLDS, AUVS = 4, 3, 2


@pytest.fixture(scope="module")
def short():
    return Scenario.load("extreme", [f"mission.duration={STEPS}"])


def actions(count):
    return np.random.default_rng(0).uniform(-1, 1, (count, WORLDS * AUVS, 2)).astype(np.float32)


def test_is_the_world_row_by_row(short):
    env, world = AuvVecEnv(short, WORLDS, 5, reward_scale=0.1), World(short, WORLDS, 5)
    space, moves = env.observation_space, actions(2 * STEPS)
    seen = env.reset()

    def expected():
        return np.clip(world.observation.numpy().reshape(WORLDS * AUVS, -1), space.low, space.high)

    world.reset()
    np.testing.assert_array_equal(seen, expected())
    for step, move in enumerate(moves, 1):
        seen, reward, done, infos = env.step(move)
        _, own, *_ = world.step(torch.from_numpy(move.reshape(WORLDS, AUVS, 2)))
        np.testing.assert_allclose(reward, 0.1 * own.numpy().ravel(), rtol=1e-6)
        np.testing.assert_array_equal([info["auv_reward"] for info in infos], own.numpy().ravel())
        assert (done == (step % STEPS == 0)).all()
        if done.any():
            last = expected()
            world.reset()
            for row, info in enumerate(infos):
                np.testing.assert_array_equal(info["terminal_observation"], last[row])
                assert info["TimeLimit.truncated"] is True
        else:
            assert all(info.keys() == {"auv_reward"} for info in infos)
        np.testing.assert_array_equal(seen, expected())


def test_seeds(short):
    env = AuvVecEnv(short, WORLDS, 5)
    first, second = env.reset(), env.reset()
    assert not np.array_equal(first, second)
    env.seed(5)
    np.testing.assert_array_equal(env.reset(), first)
    np.testing.assert_array_equal(env.reset(), second)


def test_its_librarys_wrappers_and_evaluation(short):
    """Numbers are finite, episodes are counted, and a policy is saved, loaded and evaluated."""
    env = VecNormalize(VecMonitor(VecCheckNan(AuvVecEnv(short, WORLDS, 5), raise_exception=True)))
    model = PPO("MlpPolicy", env, n_steps=STEPS, batch_size=12, n_epochs=1, device="cpu")
    model.learn(2 * STEPS * env.num_envs)
    assert [episode["l"] for episode in model.ep_info_buffer] == [STEPS] * (2 * env.num_envs)
    rewards, lengths = evaluate_policy(model, env, n_eval_episodes=env.num_envs, return_episode_rewards=True)
    assert lengths == [STEPS] * env.num_envs
    assert np.isfinite(rewards).all()
