"""Whether what is read from a checkpoint can be the state of a training run; it is checked before any of it is used."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from usvauv.policies.algorithms.learner import Learner
from usvauv.policies.policy import PolicyError
from usvauv.policies.training.replay import STORED, Replay

LARGEST = 1e12  # of a weight, a moment, a feature or a reward
LATEST = 10**15  # steps, updates

Shape = tuple[int, ...]


def check_counters(counters: Mapping[str, Any], replay: Replay) -> None:
    """Refuse counters that a run cannot have.

    Raises:
        PolicyError: one line with name, value and what is allowed.
    """
    whole = {"steps": LATEST, "updates": LATEST, "head": replay.rows - 1, "size": replay.rows}
    for name, most in whole.items():
        value = _given(counters, name)
        if type(value) is not int or not 0 <= value <= most:
            raise PolicyError(f"{name} = {value!r}: must be a whole number from 0 to {most}")
    head, size = counters["head"], counters["size"]
    if size < replay.rows and head != size:
        raise PolicyError(f"head = {head}: must be {size}, the number of rows in use")
    for name, least in (("seconds", 0.0), ("gain", -LARGEST), ("scale", 0.0)):
        value = _given(counters, name)
        if not (_finite(value) and value >= least):
            raise PolicyError(f"{name} = {value!r}: must be a finite number, at least {least:g}")
    best = _given(counters, "best")
    if best is not None and not _finite(best):
        raise PolicyError(f"best = {best!r}: must be a finite number or null")
    history = _given(counters, "history")
    figures = [_given(counters, "evaluation"), *(history if isinstance(history, list) else [None])]
    for record in figures:
        if not (isinstance(record, dict) and all(map(_finite, record.values()))):
            raise PolicyError(f"evaluation, history: {str(record)[:60]!r} must be figures by name")


def _given(counters: Mapping[str, Any], name: str) -> Any:
    if name not in counters:
        raise PolicyError(f"{name} is missing")
    return counters[name]


def _finite(value: object) -> bool:
    return type(value) in (int, float) and abs(value) <= LARGEST  # pyright: ignore[reportArgumentType]


def check_tensors(
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
    expected |= {f"learner.{name}": (tuple(value.shape), value.dtype) for name, value in own.items()}
    moments = {f"learner.{name}": form for name, form in _moments(learner).items()}
    if any(name in tensors for name in moments):  # before the first update there are none
        expected |= moments
    given = {name for name in tensors if not name.startswith("world.")}
    if different := sorted(given ^ expected.keys()):
        raise PolicyError(f"{different[0]} is {'unknown' if different[0] in given else 'missing'}")
    for name, (shape, kind) in expected.items():
        value = tensors[name]
        if tuple(value.shape) != shape or value.dtype != kind:
            raise PolicyError(f"{name} is {value.dtype} {tuple(value.shape)}: must be {kind} {shape}")
        if value.is_floating_point():
            least = 0.0 if name.endswith((".exp_avg_sq", ".step")) else -LARGEST
            if not ((value >= least) & (value <= LARGEST)).all():
                raise PolicyError(f"{name}: numbers must be finite, from {least:g} to {LARGEST:g}")


def _moments(learner: Learner) -> dict[str, tuple[Shape, torch.dtype]]:
    """Names, shapes and types of what Adam keeps, see `Learner.tensors`."""
    found: dict[str, tuple[Shape, torch.dtype]] = {}
    for name, optimiser in learner.optimisers.items():
        for index, parameter in enumerate(optimiser.param_groups[0]["params"]):
            prefix = f"optimiser.{name}.{index}."
            for moment in ("exp_avg", "exp_avg_sq"):
                found[prefix + moment] = tuple(parameter.shape), parameter.dtype
            found[prefix + "step"] = (), torch.float32
    return found


def first_not_finite(learner: Learner) -> str | None:
    """Name of the first tensor of a learner with a number that is not finite."""
    for name, value in learner.tensors().items():
        if value.is_floating_point() and not math.isfinite(float(value.detach().abs().amax())):
            return name
    return None
