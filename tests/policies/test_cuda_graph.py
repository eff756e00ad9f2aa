"""Recorded functions, and that nothing which a GPU does in training waits for the host.

There need not be a GPU: a recorder in Python stands for its graphs, and operations that would wait are refused.
"""

import pytest
import torch

from tests.nothing_waits import NothingWaits
from tests.policies.toy import LEARNING, ToyWorld, scenario, seeded
from usvauv.policies import TrainingConfig
from usvauv.policies.algorithms import ALGORITHMS, Batch, Sizes
from usvauv.policies.cuda_graph import WARM_UP, Recorded
from usvauv.policies.training import Trainer

SIZES = Sizes(stack=2, observation=5, action=2)
CALLS = 3 * WARM_UP + 5


class ReplayOfLearner:
    """Records without executing, and replays what was recorded, with counters as they were then."""

    def __init__(self, learner):
        self.learner = learner
        self.recorded = 0

    def run(self, function):
        return function()

    def record(self, function):
        learner = self.learner
        self.recorded += 1
        updates, random = learner.updates, learner.generator.get_state()
        before = {name: value.clone() for name, value in learner.tensors().items()}
        outputs = function()
        for name, value in learner.tensors().items():
            value.copy_(before[name])
        learner.generator.set_state(random)

        def replay():
            learner.updates = updates
            for name, value in function().items():
                outputs[name].copy_(value)

        return replay, outputs


def batches(count):
    generator = seeded(3)
    shape = SIZES.stack, 16

    def draw(*axes):
        return torch.randn((*shape, *axes), generator=generator)

    for _ in range(count):
        yield Batch(draw(SIZES.observation), draw(2).clamp(-1, 1), draw(), draw().abs(), draw(SIZES.observation))


def learn(algorithm, recorder=None):
    """Learner and figures after `CALLS` updates, the learning rate changing."""
    learner = ALGORITHMS[algorithm](SIZES, TrainingConfig(hidden=(8,)), seeded())
    if recorder:
        recorder = recorder(learner)
        learner._learn = Recorded(learner._update_and_average, recorder)
    figures = []
    for number, batch in enumerate(batches(CALLS)):
        learner.set_learning_rate(1.0 - 0.01 * number)
        figures.append(learner.learn(batch))
    return learner, figures, recorder


@pytest.mark.parametrize("algorithm", ["sac", "td3"])
def test_replayed_updates_are_updates(algorithm):
    alone, figures, _ = learn(algorithm)
    recorded, same_figures, recorder = learn(algorithm, ReplayOfLearner)
    assert recorder.recorded == recorded.period == (2 if algorithm == "td3" else 1)
    assert alone.updates == recorded.updates == CALLS
    expected = alone.tensors()
    assert all(torch.equal(value, expected[name]) for name, value in recorded.tensors().items())
    assert figures == same_figures
    assert len({float(each["critic_loss"]) for each in same_figures}) == CALLS


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
    trainer = Trainer(Still(scenario(auv={"count": 3}), 4), config)
    monkeypatch.setattr(trainer, "standardize", lambda features: features)  # waits, once in a run
    trainer.observation = trainer.world.reset().clone()
    with NothingWaits():
        for _ in range(12):
            trainer._advance(Now(), 1000)
    assert trainer.learner.updates >= 8
