"""The state of a training run, how it is saved, and how it is resumed after a check of every number."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import torch
from pydantic import Field
from torch import Tensor

from usvauv.env.storage.memory import require
from usvauv.kernels.errors import DivergenceError
from usvauv.policies import checkpoint
from usvauv.policies.algorithms import Learner, Sizes, algorithms
from usvauv.policies.checkpoint import ENDING, FORMAT, LAST, POLICY, TRAINING, Checked, Count, Figure
from usvauv.policies.config import TrainingConfig
from usvauv.policies.frames import frames
from usvauv.policies.learned import LearnedPolicy, Standardizer
from usvauv.policies.policy import PolicyError
from usvauv.policies.training.exploration import CorrelatedNoise, TrainingWorld
from usvauv.policies.training.replay import STORED, Replay


def learning_bytes(config: TrainingConfig, sizes: Sizes) -> float:
    """Estimate of the memory that networks, optimisers and an update take at its peak, bytes."""
    widths = sizes.observation, *config.hidden, sizes.action
    weights = sum(a * b for a, b in pairwise(widths))
    features = sizes.observation + sum(config.hidden)
    return sizes.stack * (140.0 * weights + config.batch * (128.0 * features + 64.0 * config.n_step))


class SavedRun:
    """The parts of a training run: worlds, learner, replay, random generators and counters; see `Trainer`."""

    def __init__(
        self,
        world: TrainingWorld,
        config: TrainingConfig,
        directory: str | Path | None,
        provenance: Mapping[str, Any] | None,
    ) -> None:
        if config.num_worlds != world.num_worlds:
            raise PolicyError(f"training: num_worlds = {config.num_worlds}, but the world has {world.num_worlds}")
        least = world.num_auvs if config.shared else 1
        if config.batch < least:
            raise PolicyError(f"training: batch = {config.batch}: must be at least {least}, one of each AUV")
        self.world, self.config = world, config
        self.directory = None if directory is None else Path(directory)
        self.provenance = dict(provenance or {})
        device = world.device
        with frames.calling(config.frame):
            self.frame = frames[config.frame](world.scenario)
        self.generator = torch.Generator(device).manual_seed(config.seed)
        sizes = Sizes(1 if config.shared else world.num_auvs, self.frame.features, self.frame.actions)
        require(learning_bytes(config, sizes), "training: hidden, batch or n_step", device)
        with algorithms.calling(config.algorithm):
            self.learner = algorithms[config.algorithm](sizes, config, self.generator)
            self.learner.averaged  # noqa: B018 - a plugin's may have forgotten `set_actor`
        shape = (world.num_worlds, world.num_auvs, self.frame.features, self.frame.actions)
        rows = config.rollout + config.n_step + 1 if config.on_policy else config.replay // config.num_worlds
        self.replay = Replay(rows, shape, device, config.shared)
        self.renewal = config.renewal and not world.scenario.reward.service_terminates
        self._gain = torch.zeros((), dtype=torch.float64, device=device)  # ρ
        self.scale = 1.0  # of the rewards that are learned from
        self.noise = CorrelatedNoise((*shape[:2], self.frame.actions), config.correlation, self.generator)
        self.standardizer = Standardizer.identity(self.frame.features, device)
        self.observation = torch.empty(0, device="cpu")
        self.steps = 0
        self.seconds = 0.0
        self.best = -math.inf
        self.evaluation: dict[str, float] = {}
        self.history: list[dict[str, float]] = []

    @property
    def gain(self) -> float:
        """The average reward ρ of a step, as estimated so far."""
        return float(self._gain)

    @property
    def scaled_gain(self) -> Tensor:
        """The same for rewards as they are learned from."""
        return self.scale * self._gain

    def policy(self) -> LearnedPolicy:
        """The policy in training, for the world's scenario; it shares the trainer's networks and changes with them."""
        scenario, config, actor = self.world.scenario, self.config, self.learner.averaged
        return LearnedPolicy("training", scenario, config.frame, self.standardizer, actor, config.shared)

    def stop_if_not_finite(self) -> None:
        """Raise DivergenceError if a number of the learner is not finite."""
        if (name := first_not_finite(self.learner)) is not None:
            algorithm = algorithms.described(self.config.algorithm)
            raise DivergenceError(
                f"training: {name} is not finite after {self.learner.updates} updates"
                + (f" of {algorithm}" if algorithm else "")
                + "; the checkpoints are those before"
            )

    def save(self) -> None:
        """Write `last`: the policy, and the state of the run for `resume`.

        Raises:
            DivergenceError: a weight is not finite; what was saved before stays.
        """
        self.stop_if_not_finite()
        counters = {
            "format": FORMAT,
            "steps": self.steps,
            "seconds": self.seconds,
            "best": self.best if math.isfinite(self.best) else None,
            "evaluation": self.evaluation,
            "history": self.history,
            "updates": self.learner.updates,
            "gain": self.gain,
            "scale": self.scale,
            "head": self.replay.head,
            "size": self.replay.size,
        }
        tensors = {
            "observation": self.observation,
            "noise": self.noise.value,
            "generator": self.generator.get_state(),
        }
        for group, own in (
            ("replay", self.replay.tensors()),
            ("world", self.world.state()),
            ("learner", self.learner.tensors()),
        ):
            tensors |= {f"{group}.{name}": value for name, value in own.items()}
        parts = {POLICY: self._describe(), TRAINING: (counters, tensors)}
        checkpoint.write(self._folder() / f"{LAST}{ENDING}", parts)

    def resume(self) -> None:
        """Continue the run saved in `directory`; on the CPU the result is that of a run that was never stopped.

        Raises:
            PolicyError: nothing to resume there, damaged, or of another configuration.
        """
        last = checkpoint.path_of(self._folder(), LAST)
        counters, tensors = checkpoint.read(last, TRAINING, self.world.device)
        try:
            Counters.check(counters)
            head, size, rows = counters["head"], counters["size"], self.replay.rows
            if not (head == size < rows or head < size == rows):
                raise PolicyError(f"head = {head}, size = {size}: not those of a replay of {rows} rows")
            worlds, noise = self.config.num_worlds, self.noise.value
            rest = {
                "noise": noise.new_empty((worlds, *noise.shape[1:])),
                "observation": noise.new_empty((worlds, self.world.num_auvs, self.frame.layout.size)),
                "generator": self.generator.get_state(),
            }
            check_run(tensors, self.learner, self.replay, size, worlds, rest)
        except PolicyError as error:
            raise PolicyError(f"{last}: cannot be resumed: {error}") from None
        groups: dict[str, dict[str, Tensor]] = {"learner": {}, "replay": {}, "world": {}}
        try:
            self.observation = tensors.pop("observation")
            self.noise.value = tensors.pop("noise")
            self.generator.set_state(tensors.pop("generator").cpu())
            for name, value in tensors.items():
                group, _, rest = name.partition(".")
                groups[group][rest] = value
            self.learner.restore(groups["learner"])
            self.learner.updates = counters["updates"]
            self._gain.fill_(counters["gain"])
            self.scale = counters["scale"]
            self.replay.restore(groups["replay"], head, size)
            self.world.load_state(groups["world"])
            self.steps, self.seconds = counters["steps"], counters["seconds"]
            self.evaluation, self.history = counters["evaluation"], counters["history"]
            self.best = -math.inf if counters["best"] is None else counters["best"]
        except (IndexError, KeyError, RuntimeError, TypeError, ValueError) as error:
            raise PolicyError(f"{last}: cannot be resumed: {str(error).strip().splitlines()[-1].strip()}") from None
        self.standardizer.copy_(checkpoint.load_policy(last, "training", device=self.world.device).standardizer)

    def _folder(self) -> Path:
        if self.directory is None:
            raise PolicyError("training: without a directory nothing is saved and nothing can be resumed")
        return self.directory

    def _describe(self) -> checkpoint.Part:
        about = {
            "score": self.evaluation.get("arps"),
            "evaluation": self.evaluation,
            "steps": self.steps,
            "updates": self.learner.updates,
            "seconds": round(self.seconds, 1),
            **self.provenance,
        }
        return checkpoint.describe(self.policy(), self.config, about)


class Counters(Checked):
    """A run's values in a checkpoint apart from tensors; `head` and `size` of its replay."""

    steps: Count
    updates: Count
    head: Count
    size: Count
    seconds: Annotated[Figure, Field(ge=0)]
    gain: Figure
    scale: Annotated[Figure, Field(ge=0)]
    best: Figure | None
    evaluation: dict[str, Figure]
    history: list[dict[str, Figure]]


def check_run(
    tensors: Mapping[str, Tensor], learner: Learner, replay: Replay, size: int, worlds: int, rest: Mapping[str, Tensor]
) -> None:
    """Refuse tensors of learner and replay that a run cannot have; those of the world its own `load_state` checks.

    Args:
        tensors: of the checkpoint.
        learner, replay: of the run that they are for.
        size: rows of the replay in use.
        worlds: of the replay that was saved.
        rest: further tensors by name, with the shapes and types that they must have.

    Raises:
        PolicyError: one line with the tensor and what is wrong.
    """
    expected = {name: (tuple(value.shape), value.dtype) for name, value in rest.items()}
    for name, attribute in STORED.items():
        own = getattr(replay, attribute)
        of_worlds = (worlds, *own.shape[2:]) if own.dim() > 1 else ()
        expected[f"replay.{name}"] = (size, *of_worlds), own.dtype
    own = dict(learner.state_dict())
    moments = learner.moments()
    if any(f"learner.{name}" in tensors for name in moments):  # earlier versions had none before the first update
        own |= moments
    expected |= {f"learner.{name}": (tuple(value.shape), value.dtype) for name, value in own.items()}
    checkpoint.check_tensors(
        {name: value for name, value in tensors.items() if not name.startswith("world.")}, expected
    )


def first_not_finite(learner: Learner) -> str | None:
    """Name of the first tensor of a learner with a number that is not finite."""
    for name, value in learner.tensors().items():
        if value.is_floating_point() and not math.isfinite(float(value.detach().abs().amax())):
            return name
    return None
