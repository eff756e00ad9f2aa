"""Training runs that cannot be: damaged checkpoints, and weights that leave finite numbers."""

import math

import pytest
import torch

from tests.trials.checkpoints import STEPS, trainer
from usvauv.kernels.errors import DivergenceError
from usvauv.policies import PolicyError, checkpoint
from usvauv.policies.checkpoint import LAST, TRAINING


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run that was saved, and what was saved."""
    folder = tmp_path_factory.mktemp("run")
    run = trainer(folder)
    run.train(STEPS)
    return run, checkpoint.read(folder / LAST, TRAINING, torch.device("cpu"))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("world.auv", 1e9),
        ("world.sea", math.nan),
        ("world.clock", -5),
        ("replay.observation", math.inf),
        ("replay.reward", 1e30),
        ("learner.actor.layers.0.weight", math.nan),
        ("noise", math.nan),
        ("observation", -math.inf),
    ],
)
def test_a_wild_number_is_refused(run, monkeypatch, name, value):
    trainer, (counters, tensors) = run
    key = name if name in tensors else next(key for key in tensors if key.startswith("learner.actor"))
    wild = tensors[key].clone()
    wild.view(-1)[6] = value
    monkeypatch.setattr(checkpoint, "read", _reader(checkpoint.read, counters, {**tensors, key: wild}))
    with pytest.raises(PolicyError, match=r"cannot be resumed: [^\n]+$"):
        trainer.resume()


@pytest.mark.parametrize("name", ["world.auv", "replay.end", "learner.optimiser.actor.0.exp_avg_sq", "generator"])
@pytest.mark.parametrize("change", [lambda t: t.flatten()[1:], lambda t: t.to(torch.float16), None])
def test_another_form_is_refused(run, monkeypatch, name, change):
    trainer, (counters, tensors) = run
    wrong = {**tensors, name: change(tensors[name])} if change else {k: v for k, v in tensors.items() if k != name}
    monkeypatch.setattr(checkpoint, "read", _reader(checkpoint.read, counters, wrong))
    with pytest.raises(PolicyError, match=r"cannot be resumed: [^\n]+$"):
        trainer.resume()


@pytest.mark.parametrize(
    ("field", "value"),
    [("head", 40), ("head", -1), ("size", 1e3), ("steps", True), ("gain", math.nan), ("best", "x"), ("history", {})],
)
def test_a_wild_counter_is_refused(run, monkeypatch, field, value):
    trainer, (counters, tensors) = run
    monkeypatch.setattr(checkpoint, "read", _reader(checkpoint.read, {**counters, field: value}, dict(tensors)))
    with pytest.raises(PolicyError, match=r"cannot be resumed: [^\n]+$"):
        trainer.resume()


def test_a_weight_that_is_not_finite_stops_the_run_and_leaves_the_checkpoint(tmp_path):
    run = trainer(tmp_path)
    run.train(STEPS)
    before = checkpoint.read(tmp_path / LAST, TRAINING, torch.device("cpu"))
    next(run.learner.actor.parameters()).data.fill_(math.nan)
    with pytest.raises(DivergenceError, match=r"^training: \S+ is not finite after \d+ updates[^\n]*$"):
        run.train(2 * STEPS)
    after = checkpoint.read(tmp_path / LAST, TRAINING, torch.device("cpu"))
    assert before[0] == after[0]
    assert all(torch.equal(value, after[1][name]) for name, value in before[1].items())


def _reader(real, counters, tensors):
    """`checkpoint.read` with the training part in place of the file's."""
    return lambda folder, part, device: (counters, dict(tensors)) if part == TRAINING else real(folder, part, device)
