"""Policies and runs on disk: round trip, refusal of what is damaged, resuming, interruption."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import signal
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file, save_file

from tests.policies.toy import ToyWorld, scenario
from usvauv import policies
from usvauv.env.storage import swap
from usvauv.env.storage.files import OutputError
from usvauv.policies import PolicyError, Trainer, TrainingConfig, checkpoint

CONFIG = TrainingConfig(num_worlds=8, hidden=(16, 16), batch=32, warmup=200, n_step=3, replay=4000)


def trainer(directory, world_seed=1, evaluate=None, **changes):
    config = dataclasses.replace(CONFIG, **changes)
    return Trainer(ToyWorld(scenario(), 8, world_seed), config, directory, evaluate, {"command": "test", "commit": "0"})


@pytest.fixture
def saved(tmp_path):
    run = trainer(tmp_path / "run")
    run.train(800)
    return run, tmp_path / "run" / "last"


class TestRoundTrip:
    @pytest.mark.parametrize("algorithm", ["sac", "td3", "ddpg"])
    @pytest.mark.parametrize("shared", [False, True])
    def test_actions_are_bit_equal(self, tmp_path, algorithm, shared):
        run = trainer(tmp_path, algorithm=algorithm, shared=shared)
        run.train(400)
        loaded = policies.load(tmp_path / "last", run.world)
        observation = run.world.reset()
        assert torch.equal(loaded.act(observation), run.policy().act(observation))
        assert loaded.act(observation).requires_grad is False

    def test_a_run_gives_its_best_else_its_last(self, saved):
        run, last = saved
        observation = run.world.reset()
        action = policies.load(last.parent, run.world).act(observation)
        assert torch.equal(action, policies.load(last, run.world).act(observation))
        os.rename(last, last.parent / "best")
        assert torch.equal(action, policies.load_learned(last.parent).act(observation))

    def test_it_says_where_it_comes_from(self, saved):
        _, last = saved
        about = json.loads((last / "policy.json").read_text())
        assert about["algorithm"] == "sac"
        assert about["command"] == "test"
        assert about["commit"] == "0"
        assert about["num_auvs"] == 2
        assert about["observation_size"] == 11
        assert about["training"]["seed"] == 0
        assert about["scenario"]["name"] == "toy"
        assert about["steps"] == 800

    def test_a_file_can_be_read_by_anyone_allowed_to(self, saved):
        assert saved[1].stat().st_mode & 0o777 == 0o755

    def test_run_can_be_described_without_its_world(self, saved):
        _, last = saved
        toy, config, about = checkpoint.read_run(last.parent)
        assert toy == scenario()
        assert config == CONFIG
        assert about["steps"] == 800


class TestRefusal:
    def refused(self, path, part, toy=None):
        with pytest.raises(PolicyError) as caught:
            policies.check(path, toy or scenario())
        message = str(caught.value)
        assert part in message
        assert str(path) in message
        assert "\n" not in message

    def test_missing(self, saved, tmp_path):
        _, last = saved
        (tmp_path / "empty").mkdir()
        self.refused(tmp_path / "empty", "not a checkpoint: policy.json is missing")
        self.refused(tmp_path / "nowhere", "neither a checkpoint directory nor one of")
        (last / "policy.safetensors").unlink()
        self.refused(last, "checkpoint is missing policy.safetensors")

    def test_damaged_tensors(self, saved):
        _, last = saved
        path = last / "policy.safetensors"
        whole = path.read_bytes()
        for damaged in (whole[:-7], whole[:3], b"", b"\xff" * 64):
            path.write_bytes(damaged)
            self.refused(last, "damaged")

    def test_values_that_are_not_numbers(self, saved):
        _, last = saved
        path = last / "policy.safetensors"
        tensors = load_file(path)
        first = next(name for name in tensors if name.startswith("actor."))
        tensors[first].view(-1)[0] = torch.nan
        save_file(tensors, path)
        self.refused(last, "not finite")

    def test_damaged_json(self, saved):
        _, last = saved
        path = last / "policy.json"
        for damaged in ("{", "[]", '{"format": 99}', "\x00", "{}"):
            path.write_text(damaged)
            self.refused(last, "policy.json")

    @pytest.mark.parametrize("field", ["scenario", "training"])
    def test_json_without_a_field(self, saved, field):
        _, last = saved
        path = last / "policy.json"
        about = json.loads(path.read_text())
        del about[field]
        path.write_text(json.dumps(about))
        self.refused(last, "damaged")

    @pytest.mark.parametrize(
        ("field", "value"),
        [("hidden", [16, 8]), ("hidden", "wide"), ("algorithm", "ppo"), ("speed", 3), ("gamma", "x")],
    )
    def test_settings_that_do_not_fit_the_tensors(self, saved, field, value):
        _, last = saved
        path = last / "policy.json"
        about = json.loads(path.read_text())
        about["training"][field] = value
        path.write_text(json.dumps(about))
        self.refused(last, "damaged")

    def test_another_size(self, saved):
        _, last = saved
        self.refused(last, "number of AUVs 2, but scenario 'toy' has 3", scenario(auv={"count": 3}))
        self.refused(last, "observed current vector", scenario(observation={"current": "none"}))

    def test_unwritable(self, tmp_path):
        (tmp_path / "file").write_text("")
        with pytest.raises(OutputError, match="cannot be written"):
            checkpoint.write(tmp_path / "file" / "run", {})


class TestAtomicity:
    def test_a_failed_write_leaves_the_old_checkpoint(self, saved, monkeypatch):
        run, last = saved
        before = {path.name: path.read_bytes() for path in last.iterdir()}
        run.train(1200)
        changed = {path.name: path.read_bytes() for path in last.iterdir()}
        assert changed != before

        def full(*arguments):
            raise OSError("no space left on device")

        run.train(1208)
        good = {path.name: path.read_bytes() for path in last.iterdir()}
        monkeypatch.setattr(checkpoint, "save_file", full)
        with pytest.raises(OutputError, match="no space left"):
            run.save()
        monkeypatch.undo()
        monkeypatch.setattr(swap, "_exchange", full)
        with pytest.raises(OutputError, match="no space left"):
            run.save()
        assert {path.name: path.read_bytes() for path in last.iterdir()} == good
        assert sorted(path.name for path in last.parent.iterdir()) == ["last", "tensorboard"]

    def test_what_a_kill_left_in_the_middle_is_read_and_put_back(self, saved, monkeypatch):
        """Where folders cannot be exchanged, as in earlier versions, the old one is renamed first."""
        run, last = saved
        good = {path.name: path.read_bytes() for path in last.iterdir()}

        def no_exchange(*names):
            raise NotImplementedError

        class Killed(BaseException):
            pass

        replace, rmtree = os.replace, shutil.rmtree

        def killed(old, new):
            if Path(new) == last:
                raise Killed
            replace(old, new)

        monkeypatch.setattr(swap, "_exchange", no_exchange)
        run.save()
        monkeypatch.setattr(os, "replace", killed)
        monkeypatch.setattr(shutil, "rmtree", lambda *place, **how: None)
        with pytest.raises(Killed):
            run.save()
        monkeypatch.setattr(os, "replace", replace)
        monkeypatch.setattr(shutil, "rmtree", rmtree)
        assert not last.exists()
        policies.load_learned(last.parent)
        assert checkpoint.read_run(last.parent)[2]["steps"] == 800
        checkpoint.clean(last.parent)
        assert {path.name: path.read_bytes() for path in last.iterdir()} == good
        assert sorted(path.name for path in last.parent.iterdir()) == ["last", "tensorboard"]


def stop_at(run, steps):
    """Let a run be stopped, as by Ctrl-C, when it has done some steps."""
    advance = run._advance

    def advance_and_stop(*arguments):
        advance(*arguments)
        run.stopped = run.stopped or run.steps >= steps

    run._advance = advance_and_stop


class TestResume:
    @pytest.mark.parametrize("algorithm", ["sac", "td3", "ddpg"])
    def test_it_equals_a_run_that_was_never_stopped(self, tmp_path, algorithm):
        whole = trainer(tmp_path / "whole", algorithm=algorithm)
        whole.train(2000)
        # Stopped within an episode: 50 steps of 8 worlds are 400 world-steps.
        first = trainer(tmp_path / "parts", algorithm=algorithm)
        stop_at(first, 1048)
        first.train(2000)
        second = trainer(tmp_path / "parts", world_seed=77, algorithm=algorithm)
        second.resume()
        assert second.steps == 1048
        second.train(2000)
        one, other = whole.learner.tensors(), second.learner.tensors()
        assert one.keys() == other.keys()
        assert all(torch.equal(one[name], other[name]) for name in one)
        assert torch.equal(whole.replay.observation, second.replay.observation)
        assert torch.equal(whole.observation, second.observation)

    def test_before_learning_began(self, tmp_path):
        whole = trainer(tmp_path / "whole")
        whole.train(800)
        trainer(tmp_path / "parts").train(80)
        second = trainer(tmp_path / "parts")
        second.resume()
        second.train(800)
        assert torch.equal(whole.learner.actor.weights[0], second.learner.actor.weights[0])

    def test_nothing_there(self, tmp_path):
        with pytest.raises(PolicyError, match=r"checkpoint is missing training\.json"):
            trainer(tmp_path).resume()

    def test_another_configuration(self, saved):
        _, last = saved
        with pytest.raises(PolicyError, match="cannot be resumed"):
            trainer(last.parent, hidden=(8, 8)).resume()


class TestRun:
    def test_ctrl_c_ends_after_the_step_and_keeps_it(self, tmp_path):
        run = trainer(tmp_path)
        before = signal.getsignal(signal.SIGINT)
        run.train(100_000, lambda figures: signal.raise_signal(signal.SIGINT))
        assert run.stopped
        assert signal.getsignal(signal.SIGINT) is before
        again = trainer(tmp_path)
        again.resume()
        assert again.steps == run.steps < 100_000

    def test_the_best_policy_is_kept(self, tmp_path):
        scores = iter([0.5, 1.0, 3.0, 2.0, *[0.0] * 7])
        seen = []

        def evaluate(policy):
            seen.append(policy.act(probe))
            return {"arps": next(scores), "services": 5}

        run = trainer(tmp_path, evaluate=evaluate)
        probe = ToyWorld(scenario(), 4, seed=9).reset()
        figures = run.train(4000)
        assert len(seen) == 11
        best = policies.load(tmp_path, run.world)
        assert torch.equal(best.act(probe), seen[2])
        assert json.loads((tmp_path / "best" / "policy.json").read_text())["score"] == 3.0
        assert figures["evaluation"] == {"arps": 0.0, "services": 5.0}

    def test_the_untrained_policy_is_evaluated_and_kept_before_the_first_step(self, tmp_path):
        probe = ToyWorld(scenario(), 4, seed=9).reset()
        seen = []

        def evaluate(policy):
            seen.append(policy.act(probe))
            return {"arps": 1.0 / len(seen)}

        run = trainer(tmp_path, evaluate=evaluate)
        untrained = run.policy().act(probe)
        first = []
        run.train(100_000, lambda figures: (first.append(figures), run.stop()))
        assert (first[0]["evaluation"], first[0]["evaluated_at"]) == ({"arps": 1.0}, 0)
        assert run.history == [{"steps": 0, "updates": 0, "arps": 1.0}]
        assert torch.equal(policies.load(tmp_path / "best", run.world).act(probe), untrained)
        again = trainer(tmp_path, evaluate=evaluate)
        again.resume()
        again.train(run.steps + 8)
        assert [row["steps"] for row in again.history] == [0, run.steps + 8]
        assert again.best == 1.0

    def test_a_run_that_was_never_evaluated_is_when_it_goes_on(self, tmp_path):
        trainer(tmp_path).train(80)
        run = trainer(tmp_path, evaluate=lambda policy: {"arps": 2.0})
        run.resume()
        run.train(88)
        assert run.history[0] == {"steps": 80, "updates": 0, "arps": 2.0}

    def test_evaluations_change_nothing_of_the_training(self, tmp_path):
        worlds = ToyWorld(scenario(), 4, seed=9)

        def evaluate(policy):
            action = policy.act(worlds.reset())
            return {"arps": float(worlds.step(action)[1].sum())}

        without, evaluated = trainer(tmp_path / "without"), trainer(tmp_path / "evaluated", evaluate=evaluate)
        for run in (without, evaluated):
            run.train(800)
        assert evaluated.learner.updates > 0
        one, other = without.learner.tensors(), evaluated.learner.tensors()
        assert all(torch.equal(one[name], other[name]) for name in one)
        assert torch.equal(without.observation, evaluated.observation)

    def test_events_are_written_for_tensorboard(self, saved):
        from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

        _, last = saved
        events = EventAccumulator(str(last.parent / "tensorboard"))
        events.Reload()
        tags = events.Tags()["scalars"]
        assert {"run/arps", "run/services", "reward/progress", "learner/critic_loss"} <= set(tags)
        assert events.Scalars("run/arps")[-1].step == 800
