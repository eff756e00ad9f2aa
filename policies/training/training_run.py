"""A training run: what one seed has of its own."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any, cast

import torch

from usvauv.env.storage.memory import require
from usvauv.env.world.world import World
from usvauv.kernels.errors import DivergenceError
from usvauv.policies.algorithms import Sizes, algorithms
from usvauv.policies.config import TrainingConfig
from usvauv.policies.frames import frames
from usvauv.policies.learned import LearnedPolicy, Standardizer
from usvauv.policies.loading import load
from usvauv.policies.names import PolicyError
from usvauv.policies.training.exploration import CorrelatedNoise, TrainingWorld
from usvauv.policies.training.meter import Meter
from usvauv.policies.training.replay import Replay

Evaluate = Callable[[LearnedPolicy], Mapping[str, float]]


def learning_bytes(config: TrainingConfig, sizes: Sizes) -> float:
    """Estimate of the memory that networks, optimisers and an update take at its peak, bytes."""
    widths = sizes.observation, *config.hidden, sizes.action
    weights = sum(a * b for a, b in pairwise(widths))
    features = sizes.observation + sum(config.hidden)
    return sizes.stack * (140.0 * weights + config.batch * (128.0 * features + 64.0 * config.n_step))


class TrainingRun:
    """Worlds, networks, replay, random numbers and evaluations of one seed, which a `Trainer` trains.

    Its state is what a checkpoint saves, see `saving`. In a `Trainer` of several runs learner, replay and observation
    are up to date whenever `train` reports.

    Args:
        world: the worlds to train in, with their own seed.
        config: settings; `config.num_worlds` must be the world's.
        directory: where the checkpoints `last` and `best` and `tensorboard` are kept; None: nothing is written.
        evaluate: policy → figures with at least "arps", on other worlds than the training ones. Also called before the
            first step. It can have "margin_half", half of a 95 % interval of the score's margin; `kept` says which
            policy is kept as `best`.
        provenance: recorded in every checkpoint with the figures, such as command and commit.

    Attributes:
        teacher: the policy of `Frame.teacher` in these worlds; None: there is none.
        history: every evaluation of the run so far: its figures, with steps and updates; saved with the run.
        steps: world-steps done.

    Raises:
        PolicyError: `config.num_worlds` is not the world's, or `config.batch` below its number of AUVs.
        MemoryNeeded: networks, an update or the replay do not fit into memory.
    """

    def __init__(
        self,
        world: TrainingWorld,
        config: TrainingConfig,
        directory: str | Path | None = None,
        evaluate: Evaluate | None = None,
        provenance: Mapping[str, Any] | None = None,
    ) -> None:
        if config.num_worlds != world.num_worlds:
            raise PolicyError(f"training: num_worlds = {config.num_worlds}, but the world has {world.num_worlds}")
        least = world.num_auvs if config.shared else 1
        if config.batch < least:
            raise PolicyError(f"training: batch = {config.batch}: must be at least {least}, one of each AUV")
        self.world, self.config, self.evaluate = world, config, evaluate
        self.directory = None if directory is None else Path(directory)
        self.provenance = dict(provenance or {})
        device = world.device
        with frames.calling(config.frame):
            self.frame = frames[config.frame](world.scenario)
        self.generator = torch.Generator(device).manual_seed(config.seed)
        frame = self.frame
        self.teacher = load(frame.teacher, cast(World, world)) if frame.teacher else None
        if frame.choices and not algorithms[config.algorithm].chooses:
            raise PolicyError(
                f"training: algorithm = {config.algorithm!r}: cannot learn choices, which are the actions of frame"
                f" {config.frame!r}: must be ppo"
            )
        sizes = frame.sizes(config.shared)
        require(learning_bytes(config, sizes), "training: hidden, batch or n_step", device)
        with algorithms.calling(config.algorithm):
            self.learner = algorithms[config.algorithm](sizes, config, self.generator)
            self.learner.averaged  # noqa: B018 - a plugin's may have forgotten `set_actor`
        shape = (world.num_worlds, world.num_auvs, frame.features, frame.actions)
        rows = config.rollout + config.n_step + 1 if config.on_policy else config.replay // config.num_worlds
        self.replay = Replay(rows, shape, device, config.shared)
        self.standardizer = Standardizer.identity(frame.features, device)
        self.noise = CorrelatedNoise((*shape[:2], frame.actions), config.correlation, self.generator)
        self.gain = torch.zeros((), dtype=torch.float64, device=device)  # ρ, the average reward of a step
        self.scale = 1.0  # of the rewards that are learned from
        self.observation = torch.empty(0, device="cpu")
        self.meter = Meter(world)
        self.steps = 0
        self.seconds = 0.0
        self.evaluation: dict[str, float] = {}
        self.history: list[dict[str, float]] = []

    @property
    def kept(self) -> dict[str, float]:
        """The evaluation of the policy that is kept as `best`: the latest one above all before it, or below the highest
        by less than a standard error of its margin.

        The highest of a few noisy means is high by chance as well, and the later of two policies that differ by less
        has learned more.
        """
        kept, highest = self.history[0], -math.inf
        for row in self.history:
            if row["arps"] > highest - 0.5 * row.get("margin_half", 0.0):
                kept = row
            highest = max(highest, row["arps"])
        return kept

    def policy(self) -> LearnedPolicy:
        """The policy in training, for the world's scenario; it shares the run's networks and changes with them."""
        scenario, config, actor = self.world.scenario, self.config, self.learner.averaged
        return LearnedPolicy("training", scenario, config.frame, self.standardizer, actor, config.shared)

    def check_finite(self) -> None:
        """Check every number of the learner.

        Raises:
            DivergenceError: one is not finite; the message names the seed.
        """
        for name, value in self.learner.tensors().items():
            if value.is_floating_point() and not math.isfinite(float(value.detach().abs().amax())):
                algorithm = algorithms.described(self.config.algorithm)
                raise DivergenceError(
                    f"seed {self.config.seed}: training: {name} is not finite after {self.learner.updates} updates"
                    + (f" of {algorithm}" if algorithm else "")
                    + "; the checkpoints are those before"
                )
