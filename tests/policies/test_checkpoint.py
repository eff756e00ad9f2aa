"""Policies and runs on disk: round trip, refusal of what is damaged or cannot be resumed."""

from __future__ import annotations

import dataclasses
import math
import os
import resource
import shutil

import pytest
import torch
from safetensors.torch import save_file

from tests.policies.toy import ToyWorld, scenario
from tests.trials.checkpoints import STEPS
from tests.trials.checkpoints import training_run as real_run
from usvauv import policies
from usvauv.env.storage.files import OutputError
from usvauv.kernels.errors import DivergenceError
from usvauv.policies import PolicyError, Trainer, TrainingConfig, TrainingRun, checkpoint, resume
from usvauv.policies.checkpoint import POLICY, TRAINING
from usvauv.policies.training.saving import save

CONFIG = TrainingConfig(num_worlds=8, hidden=(16, 16), batch=32, warmup=200, n_step=3, replay=4000)


def training_run(directory, **changes):
    config = dataclasses.replace(CONFIG, **changes)
    return TrainingRun(ToyWorld(scenario(), 8, 1), config, directory, provenance={"command": "test", "commit": "0"})


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The checkpoint of a run of 800 world-steps."""
    folder = tmp_path_factory.mktemp("whole")
    Trainer(training_run(folder)).train(800)
    return folder / "last.safetensors"


@pytest.fixture
def saved(whole, tmp_path):
    """The run, and a checkpoint of its own."""
    run = training_run(tmp_path / "run")
    (tmp_path / "run").mkdir(exist_ok=True)
    last = shutil.copy(whole, tmp_path / "run" / "last.safetensors")
    resume(run)
    return run, last


def edit(path, part, about=None, tensors=None):
    """Write a checkpoint anew with fields and tensors of a part changed; a value of None removes one."""
    parts = {name: checkpoint.read(path, name) for name in (POLICY, TRAINING)}
    for content, changes in zip(parts[part], (about, tensors), strict=True):
        content.update(changes or {})
        for name in [name for name, value in (changes or {}).items() if value is None]:
            del content[name]
    checkpoint.write(path, parts)


class TestRoundTrip:
    @pytest.mark.parametrize(("algorithm", "shared"), [("sac", False), ("td3", True), ("ddpg", False)])
    def test_actions_are_bit_equal(self, tmp_path, algorithm, shared):
        run = training_run(tmp_path, algorithm=algorithm, shared=shared)
        Trainer(run).train(400)
        loaded = policies.load(tmp_path / "last.safetensors", run.world)
        observation = run.world.reset()
        assert torch.equal(loaded.act(observation), run.policy().act(observation))
        assert loaded.act(observation).requires_grad is False

    def test_a_run_gives_its_best_else_its_last(self, saved):
        run, last = saved
        observation = run.world.reset()
        action = policies.load(last.parent, run.world).act(observation)
        assert torch.equal(action, policies.load(last, run.world).act(observation))
        os.rename(last, last.with_name("best.safetensors"))
        assert torch.equal(action, policies.load_learned(last.parent).act(observation))

    def test_a_run_can_be_described_without_its_world(self, saved):
        toy, config, about = checkpoint.read_run(saved[1].parent)
        assert (toy, config) == (scenario(), CONFIG)
        expected = {"algorithm": "sac", "command": "test", "commit": "0", "num_auvs": 2, "steps": 800}
        assert expected.items() <= about.items()

    def test_a_file_can_be_read_by_anyone_allowed_to(self, saved):
        assert saved[1].stat().st_mode & 0o777 == 0o644

    def test_equal_content_is_an_equal_file(self, saved):
        _, last = saved
        parts = {part: checkpoint.read(last, part) for part in (POLICY, TRAINING)}
        for number in range(4):
            checkpoint.write(last.with_name(f"{number}.safetensors"), parts)
        assert len({last.with_name(f"{number}.safetensors").read_bytes() for number in range(4)}) == 1


class TestRefusal:
    def refused(self, path, part, toy=None):
        with pytest.raises(PolicyError) as caught:
            policies.check(path, toy or scenario())
        assert part in str(caught.value)
        assert str(path) in str(caught.value)
        assert "\n" not in str(caught.value)

    def test_missing(self, tmp_path):
        (tmp_path / "empty").mkdir()
        self.refused(tmp_path / "empty", "holds no best.safetensors")
        self.refused(tmp_path / "nowhere", "allowed are ppo-wide-torpedo, sac-extreme")
        with pytest.raises(PolicyError, match=r"last\.safetensors: checkpoint is missing"):
            resume(training_run(tmp_path))

    def test_damaged_bytes(self, saved):
        _, last = saved
        whole = last.read_bytes()
        for damaged in (whole[:-7], whole[:3], b"", b"\xff" * 64, whole.replace(b'"format', b'format"', 1)):
            last.write_bytes(damaged)
            self.refused(last, "damaged")
        save_file({"x": torch.zeros(1)}, last)
        self.refused(last, "has no part 'policy'")

    def test_values_that_are_not_numbers(self, saved):
        tensors = checkpoint.read(saved[1], POLICY)[1]
        first = next(name for name in tensors if name.startswith("actor."))
        edit(saved[1], POLICY, tensors={first: torch.full_like(tensors[first], torch.nan)})
        self.refused(saved[1], "numbers must be finite")

    @pytest.mark.parametrize("kind", [torch.float64, torch.float16, torch.int64, torch.bool, torch.complex64])
    @pytest.mark.parametrize("name", ["whitening.mean", "actor.weights.0"])
    def test_numbers_of_another_type(self, saved, name, kind):
        edit(saved[1], POLICY, tensors={name: checkpoint.read(saved[1], POLICY)[1][name].to(kind)})
        self.refused(saved[1], f"damaged: {name} is {kind} ")

    def test_networks_larger_than_the_file_take_no_memory(self, saved):
        training = checkpoint.read(saved[1], POLICY)[0]["training"]
        edit(saved[1], POLICY, {"training": {**training, "hidden": [8192] * 5}})
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        self.refused(saved[1], "damaged: actor.biases.3 is missing")
        with pytest.raises(PolicyError, match=r"damaged: actor\.biases\.3 is missing"):
            policies.read_run(saved[1].parent)  # before it is resumed
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < before + 200_000  # kB; the networks take 1 GB

    @pytest.mark.parametrize(
        ("field", "value", "part"),
        [
            *((field, None, "damaged") for field in ("scenario", "training")),
            *(("format", value, "not a checkpoint of format 2") for value in (None, 99)),
            ("num_auvs", 3, "num_auvs = 3: must be 2"),
            ("steps", -1, "steps = -1: input should be greater than or equal to 0"),
            ("score", math.inf, "score = inf: input should be a finite number"),
        ],
    )
    def test_fields(self, saved, field, value, part):
        edit(saved[1], POLICY, {field: value})
        self.refused(saved[1], part)

    @pytest.mark.parametrize(("field", "value"), [("hidden", [16, 8]), ("algorithm", "a2c"), ("speed", 3)])
    def test_settings_that_do_not_fit_the_tensors(self, saved, field, value):
        training = checkpoint.read(saved[1], POLICY)[0]["training"]
        edit(saved[1], POLICY, {"training": {**training, field: value}})
        self.refused(saved[1], "damaged")

    def test_another_size(self, saved):
        self.refused(saved[1], "number of AUVs 2, but scenario 'toy' has 3", scenario(auv={"count": 3}))
        self.refused(saved[1], "observed current vector", scenario(observation={"current": "none"}))

    def test_another_configuration(self, saved):
        with pytest.raises(PolicyError, match="cannot be resumed"):
            resume(training_run(saved[1].parent, hidden=(8, 8)))


class TestWriting:
    def test_unwritable(self, tmp_path):
        (tmp_path / "file").write_text("")
        with pytest.raises(OutputError, match="cannot be written"):
            checkpoint.write(tmp_path / "file" / "last.safetensors", {})

    def test_a_failed_write_leaves_the_old_checkpoint(self, saved, monkeypatch):
        run, last = saved
        good = last.read_bytes()

        def full(*arguments):
            raise OSError("no space left on device")

        Trainer(run).train(808)
        assert last.read_bytes() != good
        good = last.read_bytes()
        for module, name in ((checkpoint, "save_file"), (os, "replace")):
            with monkeypatch.context() as patch:
                patch.setattr(module, name, full)
                with pytest.raises(OutputError, match="no space left"):
                    save(run)
        assert last.read_bytes() == good
        assert sorted(path.name for path in last.parent.iterdir()) == ["last.safetensors", "tensorboard"]

    def test_what_a_killed_process_left_is_removed(self, saved):
        _, last = saved
        last.with_name("best.safetensors.host-1.partial").write_text("")
        checkpoint.clean(last.parent)
        assert [path.name for path in last.parent.iterdir()] == ["last.safetensors"]


@pytest.fixture(scope="module")
def real(tmp_path_factory):
    """A run in the world that was saved, and a copy of its checkpoint."""
    folder = tmp_path_factory.mktemp("run")
    run = real_run(folder)
    Trainer(run).train(STEPS)
    return run, shutil.copy(folder / "last.safetensors", folder / "copy")


@pytest.fixture
def damaged(real):
    """Resuming from the checkpoint after a change is refused in one line."""

    def refused(**changes):
        run, copy = real
        last = shutil.copy(copy, run.directory / "last.safetensors")
        edit(last, TRAINING, **changes)
        with pytest.raises(PolicyError, match=r"cannot be resumed: [^\n]+$"):
            resume(run)

    return refused


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("world.auv", 1e9),
        ("world.clock", -5),
        ("replay.observation", math.inf),
        ("learner.actor.weights.0", math.nan),
        ("observation", -math.inf),
    ],
)
def test_a_wild_number_is_refused(real, damaged, name, value):
    wild = checkpoint.read(real[1], TRAINING)[1][name].clone()
    wild.view(-1)[6 % wild.numel()] = value
    damaged(tensors={name: wild})


@pytest.mark.parametrize("name", ["world.auv", "replay.end", "learner.optimiser.actor.0.exp_avg_sq", "generator"])
def test_another_form_is_refused(real, damaged, name):
    own = checkpoint.read(real[1], TRAINING)[1][name]
    for wrong in (own.flatten()[1:], own.to(torch.float16), None):
        damaged(tensors={name: wrong})


@pytest.mark.parametrize(
    ("field", "value"),
    [("head", 40), ("size", 1e3), ("steps", True), ("gain", math.nan), ("history", {})],
)
def test_a_wild_counter_is_refused(damaged, field, value):
    damaged(about={field: value})


def test_a_weight_that_is_not_finite_stops_the_run_and_leaves_the_checkpoint(saved):
    run, last = saved
    before = last.read_bytes()
    next(run.learner.actor.parameters()).data.fill_(math.nan)
    with pytest.raises(DivergenceError, match=r"^seed 0: training: \S+ is not finite after \d+ updates[^\n]*$"):
        Trainer(run).train(1600)
    assert last.read_bytes() == before
