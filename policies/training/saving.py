"""Checkpoints of training runs: saving the last and the best, and resuming after a check of every number."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

from pydantic import Field
from torch import Tensor

from usvauv.policies import checkpoint
from usvauv.policies.checkpoint import BEST, ENDING, FORMAT, LAST, POLICY, TRAINING, Checked, Count, Figure
from usvauv.policies.names import PolicyError
from usvauv.policies.training.training_run import TrainingRun


class Counters(Checked):
    """Values of a run in a checkpoint apart from tensors; `head` and `size` are those of its replay."""

    steps: Count
    updates: Count
    head: Count
    size: Count
    seconds: Annotated[Figure, Field(ge=0)]
    gain: Figure
    scale: Annotated[Figure, Field(ge=0)]
    evaluation: dict[str, Figure]
    history: list[dict[str, Figure]]


def save(run: TrainingRun) -> None:
    """Write `last`: the policy, and the state of the run for `resume`.

    Raises:
        DivergenceError: a weight is not finite; what was saved before stays.
    """
    run.check_finite()
    counters = {
        "format": FORMAT,
        "steps": run.steps,
        "seconds": run.seconds,
        "evaluation": run.evaluation,
        "history": run.history,
        "updates": run.learner.updates,
        "gain": float(run.gain),
        "scale": run.scale,
        "head": run.replay.head,
        "size": run.replay.size,
    }
    tensors = {"observation": run.observation, "noise": run.noise.value, "generator": run.generator.get_state()}
    groups = {"replay": run.replay.tensors(), "world": run.world.state(), "learner": run.learner.tensors()}
    for group, own in groups.items():
        tensors |= {f"{group}.{name}": value for name, value in own.items()}
    parts = {POLICY: _describe(run), TRAINING: (counters, tensors)}
    checkpoint.write(_folder(run) / f"{LAST}{ENDING}", parts)


def save_best(run: TrainingRun) -> None:
    """Write `best`: the present policy."""
    checkpoint.write(_folder(run) / f"{BEST}{ENDING}", {POLICY: _describe(run)})


def resume(run: TrainingRun) -> None:
    """Continue the run saved in its directory; on the CPU the result is that of a run that was never stopped.

    Raises:
        PolicyError: nothing to resume there, damaged, or of another configuration.
    """
    last = checkpoint.path_of(_folder(run), LAST)
    counters, tensors = checkpoint.read(last, TRAINING, run.world.device)
    try:
        Counters.check(counters)
        _check_tensors(run, counters, tensors)
    except PolicyError as error:
        raise PolicyError(f"{last}: cannot be resumed: {error}") from None
    groups: dict[str, dict[str, Tensor]] = {"learner": {}, "replay": {}, "world": {}}
    try:
        run.observation = tensors.pop("observation")
        run.noise.value = tensors.pop("noise")
        run.generator.set_state(tensors.pop("generator").cpu())
        for name, value in tensors.items():
            group, _, own = name.partition(".")
            groups[group][own] = value
        run.learner.restore(groups["learner"])
        run.learner.updates = counters["updates"]
        run.gain.fill_(counters["gain"])
        run.scale = counters["scale"]
        run.replay.restore(groups["replay"], counters["head"], counters["size"])
        run.world.load_state(groups["world"])
        run.steps, run.seconds = counters["steps"], counters["seconds"]
        run.evaluation, run.history = counters["evaluation"], counters["history"]
    except (IndexError, KeyError, RuntimeError, TypeError, ValueError) as error:
        raise PolicyError(f"{last}: cannot be resumed: {str(error).strip().splitlines()[-1].strip()}") from None
    run.standardizer.copy_(checkpoint.load_policy(last, "training", device=run.world.device).standardizer)


def _check_tensors(run: TrainingRun, counters: Mapping[str, int], tensors: Mapping[str, Tensor]) -> None:
    """Refuse tensors that a run cannot have; those of the world its own `load_state` checks.

    Raises:
        PolicyError: one line with the tensor and what is wrong.
    """
    head, size, rows = counters["head"], counters["size"], run.replay.rows
    if not (head == size < rows or head < size == rows):
        raise PolicyError(f"head = {head}, size = {size}: not those of a replay of {rows} rows")
    learner, moments = dict(run.learner.state_dict()), run.learner.moments()
    if any(f"learner.{name}" in tensors for name in moments):  # earlier versions had none before the first update
        learner |= moments
    noise = run.noise.value
    own = {
        "noise": noise,
        "observation": noise.new_empty((*noise.shape[:2], run.frame.layout.size)),
        "generator": run.generator.get_state(),
        **{f"learner.{name}": value for name, value in learner.items()},
    }
    expected = {name: (tuple(value.shape), value.dtype) for name, value in own.items()}
    for name, value in run.replay.tensors().items():
        expected[f"replay.{name}"] = (size, *value.shape[1:]), value.dtype
    found = {name: value for name, value in tensors.items() if not name.startswith("world.")}
    checkpoint.check_tensors(found, expected)


def _folder(run: TrainingRun) -> Path:
    """The directory of a run.

    Raises:
        PolicyError: it has none.
    """
    if run.directory is None:
        raise PolicyError("training: without a directory nothing is saved and nothing can be resumed")
    return run.directory


def _describe(run: TrainingRun) -> checkpoint.Part:
    """JSON and tensors of the present policy."""
    about = {
        "score": run.evaluation.get("arps"),
        "evaluation": run.evaluation,
        "steps": run.steps,
        "updates": run.learner.updates,
        "seconds": round(run.seconds, 1),
        **run.provenance,
    }
    return checkpoint.describe(run.policy(), run.config, about)
