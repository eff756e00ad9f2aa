"""Gymnasium and PettingZoo faces: their libraries' own checks, autoreset step by step, agreement with the world."""

import runpy
from copy import deepcopy
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from pettingzoo.test import parallel_api_test, parallel_seed_test, render_test, state_test
from pettingzoo.utils import parallel_to_aec

from tests.usvauv_env.world.faults.test_faults import until_seen
from usvauv.env import Scenario, ScenarioError, World, parallel_env
from usvauv.env.interfaces.gymnasium_env import DataCollectionEnv, DataCollectionVectorEnv
from usvauv.env.site.site import Site
from usvauv.env.world.agents import auv_observation_space
from usvauv.kernels.errors import DivergenceError
from usvauv.kernels.positioning import tracker

NAME = "usvauv/DataCollection-v0"
SEEDS = [7, (1 << 64) - 1, 7 + (1 << 32)]
EXAMPLES = Path(__file__).parents[3] / "examples"
STEPS = 5


@pytest.fixture(scope="module")
def short():
    return Scenario.load("extreme", [f"mission.duration={STEPS}"])


def vector_env(scenario, mode=AutoresetMode.NEXT_STEP, num_envs=3):
    return gymnasium.make_vec(NAME, num_envs=num_envs, scenario=scenario, autoreset_mode=mode)


def actions(count, num_envs=3, num_auvs=2):
    return np.random.default_rng(0).uniform(-1, 1, (count, num_envs, num_auvs, 2)).astype(np.float32)


def episode(world, moves):
    """Observations (n + 1, W, K, O) and rewards (n, W, K) of the world's next episode, straight from the world."""
    observations, rewards = [world.reset().cpu().numpy().copy()], []
    for move in moves:
        observation, reward, *_ = world.step(torch.from_numpy(move))
        observations.append(observation.cpu().numpy().copy())
        rewards.append(reward.cpu().numpy().copy())
    return observations, rewards


class TestAutoreset:
    """Episodes of five steps."""

    def test_disabled_needs_every_ended_world_reset(self, short):
        envs = vector_env(short, AutoresetMode.DISABLED)
        envs.reset(seed=7)
        for move in actions(5):
            envs.step(move)
        envs.reset(options={"reset_mask": np.array([True, False, True])})
        with pytest.raises(gymnasium.error.ResetNeeded, match=r"worlds \[1\] are over"):
            envs.step(actions(1)[0])

    @pytest.mark.parametrize("mode", list(AutoresetMode))
    def test_as_gymnasiums_own_vector_env(self, mode):
        """It equals SyncVectorEnv over the single environment, to the bit, with a seed for each and worlds out of step.

        Except that "auv_reward" is there in every step. Without waves, on which a world goes on when it begins anew
        beside others.
        """
        calm = ["storm.spectrum=none", "sea.irregular_rms=0"]
        short = Scenario.load("extreme", [f"mission.duration={STEPS}", *calm])
        theirs = SyncVectorEnv([lambda: DataCollectionEnv(short)] * 3, autoreset_mode=mode)
        ours = vector_env(short, mode)
        assert ours.single_observation_space == theirs.single_observation_space
        assert ours.observation_space == theirs.observation_space
        assert ours.action_space == theirs.action_space

        def alike(a, b, where):
            assert type(a) is type(b), where
            if isinstance(a, dict):
                assert a.keys() == b.keys(), where
                for key in a:
                    alike(a[key], b[key], f"{where} {key}")
            else:
                assert (a.dtype, a.shape) == (b.dtype, b.shape), where
                for own, same in zip(a, b, strict=True):  # of worlds
                    np.testing.assert_array_equal(own, same, err_msg=where)

        seen = ours.reset(seed=SEEDS)[0]
        alike(seen, theirs.reset(seed=SEEDS)[0], "reset")
        assert len(np.unique(seen, axis=0)) == 3
        ends = []
        for step, move in enumerate(actions(13), start=1):
            if step == 3:
                mask = np.array([True, False, False])
                began, same = (each.reset(options={"reset_mask": mask.copy()})[0] for each in (ours, theirs))
                alike(began, same, "reset by mask")
                np.testing.assert_array_equal((began != seen).any((1, 2)), mask)
            a, b = ours.step(move), theirs.step(move)
            seen = a[0]
            ends += [(step, world) for world in np.flatnonzero(a[3])]
            assert a[4]["_auv_reward"].all()
            np.testing.assert_allclose(a[4]["auv_reward"].sum(-1), a[1], rtol=1e-5)
            for info in (a[4], b[4]):
                info.pop("auv_reward", None), info.pop("_auv_reward", None)
            for name, x, y in zip(("observation", "reward", "terminated", "truncated", "info"), a, b, strict=True):
                alike(x, y, f"step {step} {name}")
            if mode is AutoresetMode.DISABLED and a[3].any():
                mask = {"reset_mask": a[3]}
                alike(ours.reset(options=mask)[0], theirs.reset(options=mask.copy())[0], f"reset after step {step}")
        again = 6 if mode is AutoresetMode.NEXT_STEP else 5  # steps from end to end
        assert ends == [(5, 1), (5, 2), (7, 0), (5 + again, 1), (5 + again, 2), (7 + again, 0)]


class TestVectorEnv:
    def test_returned_arrays_are_the_callers(self, short):
        envs = vector_env(short)
        observation, _ = envs.reset(seed=3)
        kept = observation.copy()
        _, _, _, _, info = envs.step(actions(1)[0])
        kept_info = {name: value.copy() for name, value in info.items()}
        envs.step(-actions(1)[0])
        np.testing.assert_array_equal(observation, kept)
        assert data_equivalence(info, kept_info, exact=True)

    def test_actions_are_clipped(self, short):
        a, b = vector_env(short), vector_env(short)
        a.reset(seed=1)
        b.reset(seed=1)
        move = 4 * actions(1)[0]
        np.testing.assert_array_equal(a.step(move)[0], b.step(np.clip(move, -1, 1))[0])


class TestSpaces:
    def test_contains_what_is_observed_unclamped(self):
        scenario = Scenario.load("extreme", ["auv.count=16"])
        space = auv_observation_space(Site(scenario))
        world = World(scenario, 32, seed=2)
        observation = world.reset()
        assert space.shape == (world.observation_size,)
        for move in actions(60, 32, world.num_auvs):
            assert (observation.cpu() >= torch.from_numpy(space.low)).all()
            assert (observation.cpu() <= torch.from_numpy(space.high)).all()
            observation, *_ = world.step(torch.from_numpy(move))

    def test_current_bound_is_reached_at_the_peak_of_a_vortex(self):
        """An AUV drifting through a lone vortex meets nearly the bound, never more."""
        lone = ["current.count=0", "current.centres=[[100, 100]]", "current.circulation_min=260"]
        lone += ["current.core_radius_min=30", "current.core_radius_max=30", "storm.spectrum=none"]
        lone += ["sea.irregular_rms=0", "current.period=100000", "current.decay_depth=0"]
        scenario = Scenario.load("extreme", lone)
        speed = World(scenario, 2000, seed=2).reset()[..., 8]
        bound = auv_observation_space(Site(scenario)).high[8]
        assert 0.99 * bound < speed.max() <= bound

    def test_a_wild_estimate_is_clamped(self, short):
        envs = vector_env(short)
        envs.reset(seed=1)
        for of_auvs_or_boat in (envs.world.own, envs.world.track):
            of_auvs_or_boat[..., [tracker.X, tracker.Y]] = 1e4  # where they take the AUVs to be, m
        observation, *_ = envs.step(actions(1)[0])
        assert envs.world.observation.abs().max() > 2
        assert observation in envs.observation_space


@pytest.mark.parametrize(
    ("make", "more"),
    [(gymnasium.make, {}), (gymnasium.make_vec, {"num_envs": 2, "autoreset_mode": AutoresetMode.SAME_STEP})],
)
def test_a_spec_goes_through_json(make, more, short, tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(short.to_toml(), encoding="utf-8")
    for given in (file, short):
        made = make(NAME, scenario=given, usv="fim", **more)
        file.unlink(missing_ok=True)
        again = make(EnvSpec.from_json(made.spec.to_json()))
        assert again.spec == made.spec
        assert again.unwrapped.world.scenario == short
        np.testing.assert_array_equal(again.reset(seed=7)[0], made.reset(seed=7)[0])


class TestSingleEnv:
    def test_checker(self):
        check_env(gymnasium.make(NAME).unwrapped)

    def test_is_the_world(self, short):
        moves = actions(STEPS, 1)
        observations, rewards = episode(World(short, 1, seed=9), moves)
        env = gymnasium.make(NAME, scenario=short)
        observation, info = env.reset(seed=9)
        np.testing.assert_array_equal(observation, observations[0][0])
        for step, move in enumerate(moves, start=1):
            kept = (info, deepcopy(info))
            observation, reward, terminated, truncated, info = env.step(move[0])
            assert data_equivalence(*kept, exact=True)  # what a step returned stays as it was
            np.testing.assert_array_equal(observation, observations[step][0])
            np.testing.assert_array_equal(info["auv_reward"], rewards[step - 1][0])
            assert reward == pytest.approx(rewards[step - 1].sum(), rel=1e-5, abs=1e-5)
            np.testing.assert_allclose(info["reward_terms"].sum(axis=-1), info["auv_reward"], rtol=1e-5, atol=1e-5)
            assert (terminated, truncated) == (False, step == STEPS)


class TestParallelEnv:
    def test_api(self):
        parallel_api_test(parallel_env(Scenario.load("extreme", ["mission.duration=30"])), num_cycles=100)

    @pytest.mark.filterwarnings("ignore:Environment's .* state space value is:UserWarning")  # nothing bounds a backlog
    def test_state(self, short):
        env = parallel_env(short)
        env.reset(seed=1)
        state_test(parallel_to_aec(env), parallel_env(short))
        env.reset(seed=1)
        before = env.state()
        assert before.shape == env.state_space.shape
        env.step({agent: env.action_space(agent).sample() for agent in env.agents})
        assert not np.array_equal(env.state(), before)

    def test_seed(self):
        parallel_seed_test(parallel_env, num_cycles=50)

    def test_is_the_world(self, short):
        moves = actions(STEPS, 1)
        observations, rewards = episode(World(short, 1, seed=9), moves)
        env = parallel_env(scenario=short)
        assert env.possible_agents == ["auv_0", "auv_1"]
        env.reset(seed=9)
        for step, move in enumerate(moves, start=1):
            observation, reward, terminated, truncated, info = env.step(dict(zip(env.agents, move[0], strict=True)))
            for k, agent in enumerate(env.possible_agents):
                np.testing.assert_array_equal(observation[agent], observations[step][0, k])
                assert observation[agent] in env.observation_space(agent)
                assert reward[agent] == rewards[step - 1][0, k]
                assert info[agent]["reward_terms"].sum() == pytest.approx(reward[agent], rel=1e-4, abs=1e-4)
                assert (terminated[agent], truncated[agent]) == (False, step == STEPS)
        assert env.agents == []
        with pytest.raises(gymnasium.error.ResetNeeded):
            env.step({})

    def test_bad_arguments(self, short):
        env = parallel_env(scenario=short)
        env.reset(seed=1)
        with pytest.raises(ValueError, match="auv_1"):
            env.step({"auv_0": np.zeros(2)})


FACES = [
    lambda short: DataCollectionEnv(short, render_mode="rgb_array"),
    lambda short: DataCollectionVectorEnv(1, short, render_mode="rgb_array"),
    lambda short: parallel_env(short, render_mode="rgb_array"),
]


@pytest.mark.parametrize("make", FACES)
def test_nothing_goes_before_reset_and_all_goes_on_after_a_divergence(short, make):
    env = make(short)
    moves = {agent: np.zeros(2) for agent in getattr(env, "possible_agents", ())}
    action = moves or np.zeros(env.action_space.shape)
    for asked in (lambda: env.step(action), env.render, *([env.state] if moves else [])):
        with pytest.raises(gymnasium.error.ResetNeeded, match="call reset first"):
            asked()
    env.reset(seed=3)
    env.step(action)
    world = env._team.world if moves else env.world
    world.auv[...] = np.nan
    with pytest.raises(DivergenceError):
        until_seen(lambda: env.step(action))
    env.reset()
    env.step(action)
    assert env.render() is not None


@pytest.mark.parametrize("make", FACES)
@pytest.mark.parametrize("wrong", [None, np.zeros((2, 3)), np.full((2, 2), "0.5"), np.full(2, np.nan)])
def test_what_is_no_action_is_refused_in_words(short, make, wrong):
    env = make(short)
    env.reset(seed=3)
    moves = dict.fromkeys(getattr(env, "possible_agents", ()), wrong)
    with pytest.raises(ScenarioError, match=r"^action( of auv_0)?\b[^\n]*must be[^\n]*$"):
        env.step(moves or wrong)


class TestPictures:
    def test_unknown_modes_are_refused(self):
        assert gymnasium.make(NAME, render_mode=None).render_mode is None
        for make in (DataCollectionEnv, DataCollectionVectorEnv, parallel_env):
            with pytest.raises(TypeError, match="render_mode = 'human': must be None or one of rgb_array"):
                make(render_mode="human")

    def test_many_missions(self, short):
        envs = gymnasium.make_vec(NAME, num_envs=3, scenario=short, render_mode="rgb_array", autoreset_mode="Disabled")
        assert DataCollectionVectorEnv(2, short).render() is None
        envs.reset(seed=5)
        for move in actions(4, 3):
            envs.step(move)
        first, second, third = envs.render()
        assert (first != second).any()
        envs.reset(options={"reset_mask": np.array([False, True, False])})
        again = envs.render()
        np.testing.assert_array_equal(again[0], first)
        np.testing.assert_array_equal(again[2], third)
        assert (again[1] != second).mean() > 0.01

    def test_pettingzoo(self, short):
        def make(render_mode):
            # PettingZoo's test makes one with "human" only to ask for its modes.
            mode = render_mode if render_mode in ("rgb_array",) else None
            return parallel_to_aec(parallel_env(short, render_mode=mode))

        render_test(make)
        env = parallel_env(short)
        env.reset(seed=1)
        assert env.render() is None


@pytest.mark.parametrize(
    ("file", "arguments"),
    [("gymnasium_vector.py", {"num_envs": 4, "steps": 6}), ("pettingzoo_parallel.py", {"max_steps": 6})],
)
def test_examples(file, arguments, capsys):
    runpy.run_path(str(EXAMPLES / file))["main"](**arguments)
    assert capsys.readouterr().out.count("\n") == 1
