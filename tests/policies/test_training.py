"""Training runs: what they learn in the toy world, their settings, renewal, the size of rewards."""

from __future__ import annotations

import dataclasses
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import torch

from tests.kernels.nothing_waits import NothingWaits
from tests.policies.toy import LEARNING, ToyWorld, mean_reward, scenario, seeded
from usvauv import policies
from usvauv.env import Scenario, World
from usvauv.kernels.errors import UserError
from usvauv.policies import PolicyError, Trainer, TrainingConfig, TrainingRun
from usvauv.policies.checkpoint import read_run
from usvauv.policies.training.trainer import SeedStack, usual_evaluations


class TestTraining:
    @pytest.mark.parametrize(
        ("algorithm", "changes"),
        [
            ("sac", {}),
            pytest.param("td3", {}, marks=pytest.mark.slow),
            pytest.param("ddpg", {}, marks=pytest.mark.slow),
            ("ppo", {"n_step": 2, "rollout": 10, "updates": 5, "learning_rate": 3e-3, "shared": True, "seed": 2}),
            pytest.param("ddpg", {"shared": True}, marks=pytest.mark.slow),
            pytest.param("sac", {"frame": "world"}, marks=pytest.mark.slow),
        ],
    )
    def test_each_algorithm_solves_the_toy_task(self, algorithm, changes):
        toy = scenario()
        run = TrainingRun(ToyWorld(toy, 32, seed=1), dataclasses.replace(LEARNING, algorithm=algorithm, **changes))

        def score(policy):
            return mean_reward(ToyWorld(toy, 64, seed=99), policy)

        untrained = score(run.policy())
        Trainer(run).train(25_600)
        learned = score(run.policy())
        random, middle, fast, best = (
            score(name) for name in ("random", "straight:1.7", "straight:2.0", "straight:2.2")
        )
        assert random < 0.5 < 5.0 < middle < fast < best
        if changes.get("frame") == "world":
            # In world axes the untrained policy knows nothing.
            assert untrained < 2.0
            assert learned > 0.7 * best
        else:
            # In the target's frame it heads for the target at the middle speed; learning finds that fast is better.
            assert untrained == pytest.approx(middle, abs=0.2)
            assert learned > fast
        steps = run.steps // 32
        assert run.learner.updates == (steps // 10 - 1 if algorithm == "ppo" else steps - LEARNING.warmup // 32)

    def test_ppo_holds_each_action_until_the_next_decision_or_the_episode_ends(self):
        config = dataclasses.replace(LEARNING, algorithm="ppo", n_step=4, rollout=90)
        run = TrainingRun(ToyWorld(scenario(), 32, seed=1), config)
        Trainer(run).train(32 * 58)
        action = run.replay.action[[row for row in range(59) if row != 50]]  # of an episode's end
        same = (action[1:] == action[:-1]).flatten(1).all(1).tolist()
        assert same == [step % 50 % 4 != 0 for step in range(1, 58)]

    @pytest.mark.parametrize(
        ("name", "algorithm", "heuristic", "changes"),
        [
            ("extreme", "sac", "clear", {"hidden": (8,), "batch": 8, "replay": 64, "warmup": 4}),
            pytest.param(
                *("extreme-torpedo", "ppo", "loiter", {"shared": True, "batch": 8, "rollout": 6}),
                marks=pytest.mark.slow,
            ),
        ],
    )
    def test_what_torch_makes_by_default_changes_nothing(self, name, algorithm, heuristic, changes):
        """A device "meta", whose tensors have no numbers, stands for any other than the world's."""
        scenario = Scenario.load(name, ["mission.duration=10"])

        def results():
            world = World(scenario, 2)
            run = TrainingRun(world, TrainingConfig(algorithm=algorithm, num_worlds=2, n_step=2, **changes))
            Trainer(run).train(32)
            world.load_state(world.state())
            acting = run.policy(), policies.load(heuristic, world)
            found = [*run.learner.tensors().values(), *(policy.act(world.observation) for policy in acting)]
            figures = policies.figures_of_merit(world, heuristic)
            return [*found, torch.from_numpy(np.nan_to_num([*figures.values()]))]

        expected = results()
        try:
            torch.set_default_dtype(torch.float64)
            torch.set_default_device("meta")
            found = results()
        finally:
            torch.set_default_dtype(torch.float32)
            torch.set_default_device(None)
        assert all(map(torch.equal, found, expected))

    def test_same_seed_same_result(self):
        def learned(seed):
            run = TrainingRun(ToyWorld(scenario(), 32, seed=1), dataclasses.replace(LEARNING, seed=seed))
            Trainer(run).train(3200)
            return run.learner.tensors()

        first, again, other = learned(0), learned(0), learned(1)
        assert first.keys() == again.keys()
        assert all(torch.equal(first[name], again[name]) for name in first)
        assert not torch.equal(first["actor.weights.0"], other["actor.weights.0"])

    @pytest.mark.parametrize(
        ("scores", "half", "kept"),
        [
            ((1.0, 3.0, 2.0, 3.0, 2.9), None, 1),  # the first of two alike
            ((1.0, 3.0, 2.6, 2.4), 1.0, 2),  # below the highest by less than a half of it, not below the one before
            ((3.0, 2.4, 1.8), 1.0, 0),
            ((0.0,), 1.0, 0),
        ],
    )
    def test_the_latest_policy_is_kept_that_is_not_below_the_highest_beyond_its_error(self, scores, half, kept):
        run = TrainingRun(ToyWorld(scenario(), 32, seed=1), LEARNING)
        run.history = [{"arps": score} | ({"margin_half": half} if half else {}) for score in scores]
        assert run.kept is run.history[kept]

    @pytest.mark.parametrize(("steps", "number"), [(9000, 3), (600_000, 3), (1_500_000, 7), (10_000_000, 10)])
    def test_a_long_training_is_evaluated_more_often(self, steps, number):
        assert usual_evaluations(steps) == number

    def test_a_long_time_without_an_evaluation_is_saved(self, tmp_path, monkeypatch):
        monkeypatch.setattr("usvauv.policies.training.trainer.SAVED_EVERY", 0.0)
        run = TrainingRun(ToyWorld(scenario(), 32, seed=1), LEARNING, tmp_path)
        steps = []

        def look(figures):
            if (file := tmp_path / "last.safetensors").exists():
                steps.append(read_run(tmp_path)[2]["steps"])
                file.unlink()

        Trainer(run, evaluations=1).train(32 * 400, look)
        assert steps == [3200, 6400, 9600]

    def test_figures_count_what_happened(self):
        toy = scenario()
        seen = []
        run = TrainingRun(ToyWorld(toy, 32, seed=1), dataclasses.replace(LEARNING, warmup=10_000))
        Trainer(run).train(3200, lambda figures: seen.extend(figures))
        assert [figures["steps"] for figures in seen] == [1088, 2144, 3200]
        last = seen[-1]
        assert last["steps"] == last["total"] == 3200
        assert last["updates"] == 0
        assert last["arps"] == pytest.approx(sum(last["reward"].values()))
        # Each service earns 1; progress is at most 0.1 · (2.2 + 0.36) for each of two AUVs.
        assert last["reward"]["service"] * toy.mission.steps == pytest.approx(last["services"], rel=1e-6)
        assert last["reward"]["progress"] < 0.512
        assert last["sdr"] == pytest.approx(last["services"])


class TestConfig:
    @pytest.mark.parametrize(
        ("changes", "part"),
        [
            ({"algorithm": "a2c"}, "algorithm = 'a2c': allowed are sac, td3, ddpg, ppo"),
            ({"tau": float("nan")}, "tau = nan: must be from 1e-06 to 1.0"),
            ({"batch": 1.5}, "batch = 1.5: must be of type int"),
            ({"hidden": (64, 10**9)}, "hidden = (64, 1000000000): must be from 1 to 16 widths, each from 1 to 8192"),
            ({"replay": 10**12}, "replay = 1000000000000: must be from num_worlds · (n_step + 3) = 3328 to 1000000000"),
            ({"hidden": ()}, "hidden"),
        ],
    )
    def test_bad_settings_get_one_clear_line(self, changes, part):
        with pytest.raises(PolicyError) as caught:
            TrainingConfig(**changes)
        assert part in str(caught.value)

    @pytest.mark.parametrize("changes", [{"warmup": 170}, {"warmup": 0}])
    def test_learning_begins_when_it_says(self, changes):
        config = dataclasses.replace(LEARNING, **changes)
        run = TrainingRun(ToyWorld(scenario(), 32, seed=1), config)
        Trainer(run).train(config.before_learning)
        assert (run.steps, run.learner.updates) == (config.before_learning, 0)
        Trainer(run).train(config.before_learning + 32)
        assert run.learner.updates == config.updates


class TestRenewal:
    def test_a_service_ends_the_horizon_and_the_average_reward_is_taken_off(self):
        config = dataclasses.replace(LEARNING, warmup=800)
        run = TrainingRun(ToyWorld(scenario(), 32, seed=1), config)
        rewards, ends = [], []
        step, add = run.world.step, run.replay.add

        def watched(action):
            result = step(action)
            rewards.append(result[1].mean().item())
            ends.append(result[4]["measures"][..., 2].bool())
            return result

        run.world.step = watched
        stored = []
        run.replay.add = lambda *row: (stored.append(row[3].clone()), add(*row))
        Trainer(run).train(32 * 200)
        assert sum(int(end.sum()) for end in ends) > 50
        assert all(torch.equal(kept, end) for kept, end in zip(stored, ends, strict=True))
        gain = 0.0
        for reward in rewards:
            gain += 0.002 * (reward - gain)
        assert float(run.gain) == pytest.approx(gain, rel=1e-4)
        one, other = (run.replay.sample(64, 3, 0.9, [seeded(5)], gain=price) for price in (0.0, 0.25))
        # Each of the m steps of a transition costs the gain, discounted: 1, 1 + 0.9 or 1 + 0.9 + 0.81 of it.
        paid = (one.reward - other.reward) / 0.25
        sums = torch.tensor([1.0, 1.9, 2.71])
        assert (paid.unsqueeze(-1) - sums).abs().amin(-1).max() < 1e-4
        assert ((paid < 1.5) & (one.discount == 0)).any()


class TestScales:
    def test_the_unit_of_rewards_changes_nothing(self):
        """A power of two, so that not even rounding differs; the gain is subtracted in the same unit."""

        class Dear(ToyWorld):
            def step(self, action):
                observation, reward, *rest = super().step(action)
                return observation, 8.0 * reward, *rest

        config = dataclasses.replace(LEARNING, warmup=800)
        runs = [TrainingRun(world(scenario(), 32, seed=1), config) for world in (ToyWorld, Dear)]
        for run in runs:
            Trainer(run).train(32 * 60)
        assert runs[0].gain != 0.0
        assert float(runs[1].gain) == pytest.approx(8.0 * float(runs[0].gain))
        for one, other in zip(runs[0].learner.actor.parameters(), runs[1].learner.actor.parameters(), strict=True):
            assert torch.equal(one, other)


class TestSettings:
    def test_settings_can_be_changed_by_name(self):
        config = TrainingConfig().changed(["updates=4", "hidden=128,32", "renewal=false", "gamma=0.98", "frame=world"])
        expected = TrainingConfig(updates=4, hidden=(128, 32), renewal=False, gamma=0.98, frame="world")
        assert config == expected

    @pytest.mark.parametrize(
        ("text", "part"),
        [
            ("updates", "NAME=VALUE"),
            ("speed=3", "expected NAME=VALUE; allowed are frame"),
            ("updates=many", "updates = 'many': must be a whole number"),
            ("hidden=64,,64", "hidden = '64,,64': must be whole numbers with a comma between two, as in 64,64"),
            ("gamma=1.5", "gamma = 1.5: must be at least 0 and below 1"),
        ],
    )
    def test_what_is_not_allowed_is_said(self, text, part):
        with pytest.raises(PolicyError, match=part):
            TrainingConfig().changed([text])


class Now:
    """Executor that does things at once, and in this thread."""

    def submit(self, function, *arguments):
        value = function(*arguments)
        self.result = lambda: value
        return self


class Still(ToyWorld):
    """Nothing happens in it."""

    def step(self, action):
        shape = self.num_worlds, self.num_auvs
        ended = torch.zeros(shape, dtype=torch.bool)
        info = {"reward_terms": torch.zeros(*shape, 3), "measures": torch.zeros(*shape, len(self.measure_names))}
        return torch.zeros(*shape, self.observation_size), torch.zeros(shape), ended, ended, info


@pytest.mark.parametrize(
    ("algorithm", "frame", "shared"), [("sac", "guided", True), ("td3", "target", False), ("ddpg", "world", False)]
)
def test_a_step_of_training_does_not_wait_for_the_device(monkeypatch, algorithm, frame, shared):
    settings = {"algorithm": algorithm, "frame": frame, "shared": shared, "n_step": 2, "updates": 2, "renewal": True}
    config = TrainingConfig(**{**vars(LEARNING), **settings, "num_worlds": 4, "warmup": 16, "batch": 16})
    run = TrainingRun(Still(scenario(auv={"count": 3}), 4), config)
    run.observation = run.world.reset().clone()
    seeds = SeedStack([run])
    monkeypatch.setattr(seeds, "_standardize", lambda features: features)  # waits, once in a run
    with NothingWaits():
        for _ in range(12):
            seeds.step(Now(), 1000)
    assert run.learner.updates >= 8


class StandIn(ModuleType):
    """The part of wandb that is used, as https://docs.wandb.ai/ref/python describes it."""

    class Error(Exception):
        pass

    def __init__(self) -> None:
        super().__init__("wandb")
        self.begun, self.logged, self.ended = {}, [], 0
        self.Settings = SimpleNamespace

    def init(self, **how):
        self.begun = how
        if not how["project"]:
            raise self.Error("no project\nat all")
        return self

    def define_metric(self, name, step_metric=None):
        assert step_metric in (None, "steps")

    def log(self, values):
        self.logged.append(values)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.ended += 1


def test_curves_in_weights_and_biases(tmp_path, monkeypatch):
    """The figures that a caller gets, by steps, instead of TensorBoard's files."""
    wandb, got = StandIn(), []
    monkeypatch.setitem(sys.modules, "wandb", wandb)
    folder = tmp_path / "mine"
    folder.mkdir()
    run = TrainingRun(ToyWorld(scenario(), 32, seed=1), LEARNING, folder)
    trainer = Trainer(run, log="wandb")
    trainer.train(1600, lambda figures: got.extend(figures))
    assert (wandb.begun["project"], wandb.begun["group"], wandb.begun["dir"]) == ("usvauv", "mine", folder)
    assert wandb.begun["config"]["num_worlds"] == 32
    assert wandb.begun["config"]["scenario"]["auv"]["count"] == run.world.scenario.auv.count
    assert [values["steps"] for values in wandb.logged] == [figures["steps"] for figures in got]
    assert [values["run/arps"] for values in wandb.logged] == [figures["arps"] for figures in got]
    assert {name.partition("/")[0] for name in wandb.logged[-1]} >= {"steps", "run", "reward"}
    assert wandb.ended == 1
    assert not (folder / "tensorboard").exists()
    monkeypatch.setenv("WANDB_PROJECT", "")
    with pytest.raises(UserError, match="--log wandb: no project at all"):
        trainer.train(3200)
