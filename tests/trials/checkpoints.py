"""Wild numbers in the checkpoint of a training run: refused in one line, or a run that goes on with finite numbers.

A kind of `tests.trials.fuzz`. A small run is saved. Then one tensor, or one field of the JSON of its parts, is changed:
one number or all to NaN, infinity, 1e9, −1 or the like, another type, another shape, missing, renamed.
"""

from __future__ import annotations

import functools
import json
import math
import random
from pathlib import Path
from typing import Any

import torch

from usvauv.env import Scenario, World
from usvauv.env.world.strategy_choice import StrategyChoice
from usvauv.policies import Trainer, TrainingConfig, TrainingRun, checkpoint, read_run, resume
from usvauv.policies.checkpoint import POLICY, TRAINING, provenance

WORLDS, STEPS, MORE = 4, 64, 12
PARTS = POLICY, TRAINING
NUMBERS = (math.nan, math.inf, -math.inf, 1e9, -1.0, 0.5, 3e38, 1e-40, 255.0)
FORMS = ("half", "double", "int64", "shorter", "longer", "scalar", "transposed", "missing", "renamed")
VALUES: tuple[Any, ...] = (
    *(None, True, "x", [], {}, -1, 10**9, 10**400, 0.5, math.nan, math.inf, [1, 2], {"a": 1}, {"arps": "x"}),
    "missing",
)


def training_run(folder: Path) -> TrainingRun:
    scenario = Scenario.load("extreme", ["mission.duration=20"])
    config = TrainingConfig(
        num_worlds=WORLDS, replay=WORLDS * 40, hidden=(8, 8), batch=8, n_step=2, warmup=32, layer_norm=True
    )
    about = provenance({}) | {"usv": "fim", "total": 10 * STEPS, "plugins": []}
    about["resumed"] = [{"steps": 1, **provenance({})}]
    return TrainingRun(World(scenario, WORLDS, 0), config, folder, provenance=about)


def changed(tensors: dict[str, torch.Tensor], kind: str, name: str, value: Any, source: random.Random) -> None:
    """Change one tensor in place of the old one."""
    old = tensors[name]
    if kind == "form":
        new = {
            "half": old.to(torch.float16),
            "double": old.to(torch.float64),
            "int64": old.nan_to_num().to(torch.int64),
            "shorter": old.flatten()[1:].clone(),
            "longer": torch.cat([old.flatten(), old.flatten()]),
            "scalar": old.flatten()[:1].reshape(()).clone(),
            "transposed": old.unsqueeze(0).contiguous(),
        }.get(value)
        del tensors[name]
        if value == "renamed":
            tensors[name + "x"] = old
        elif new is not None:
            tensors[name] = new
        return
    new = old.clone()
    wild = value if old.is_floating_point() else max(min(0 if value != value else value, 2.0**62), -(2.0**62))
    if not old.is_floating_point():
        wild = int(wild) % 2 if old.dtype == torch.bool else int(wild)
        limits = None if old.dtype == torch.bool else torch.iinfo(old.dtype)
        wild = wild if limits is None else max(limits.min, min(limits.max, wild))
    if kind == "all":
        new.fill_(wild)
    elif new.numel():
        new.view(-1)[source.randrange(new.numel())] = wild
    tensors[name] = new


@functools.cache
def begun(folder: Path) -> tuple[TrainingRun, Path]:
    """A run that has just begun, and the checkpoint of one that has learned."""
    Trainer(training_run(folder / "begun")).train(STEPS)
    run = training_run(folder / "run")
    Trainer(run).train(WORLDS)
    return run, folder / "begun" / "last.safetensors"


def go_on(source: random.Random, folder: Path) -> None:
    """Train on from a changed checkpoint; raises for numbers that are not finite."""
    run, whole = begun(folder)
    parts = {part: checkpoint.read(whole, part) for part in PARTS}
    names = list(parts[TRAINING][1])
    found: list[tuple[str, str, Any]] = [
        *((kind, name, value) for name in names for kind in ("one", "all") for value in NUMBERS),
        *(("form", name, form) for name in names for form in FORMS),
        *((part, field, value) for part in PARTS for field in parts[part][0] for value in VALUES),
    ]
    kind, name, value = source.choice(found)
    if kind not in PARTS:
        changed(parts[TRAINING][1], kind, name, value, source)
    elif value == "missing":
        del parts[kind][0][name]
    else:
        parts[kind][0][name] = value
    checkpoint.write(folder / "run" / "last.safetensors", parts)
    setting, _, about = read_run(folder / "run")
    StrategyChoice.parse(about.get("usv", "fim"), setting)
    assert 0 < about.get("total", 1) < math.inf
    json.dumps(provenance(about), allow_nan=False)
    resume(run)
    Trainer(run).train(run.steps + MORE)
    values = [*run.learner.tensors().values(), *run.world.state().values(), run.observation]
    assert all(bool(value.double().isfinite().all()) for value in values), (kind, name, value)
