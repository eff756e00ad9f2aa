"""Policies and training runs on disk: tensors in safetensors, everything else in JSON, so that loading runs no code.

    NAME/policy.json            the policy's settings, how it was made, its score
    NAME/policy.safetensors     actor weights, and statistics of the standardizer under the keys `whitening.*`
    NAME/training.json          counters of a run, for resuming
    NAME/training.safetensors   networks, optimisers, replay, generator, world

A directory is written beside its place under a name of its own and put there, complete, in one step: a reader and a
resumed run find the old one or the new one, whenever a process is killed.
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import load_file, save_file
from torch import Tensor

from usvauv.env.scenario import Scenario, ScenarioError
from usvauv.env.storage import text_files
from usvauv.env.storage.files import sync, writing
from usvauv.env.storage.swap import found, replace_folder
from usvauv.policies.algorithms import ALGORITHMS, Sizes
from usvauv.policies.config import TrainingConfig
from usvauv.policies.frames import ACTION_SIZE, FRAMES
from usvauv.policies.learned import LearnedPolicy, Standardizer
from usvauv.policies.policy import PolicyError

FORMAT = 2  # 1 had a guided frame without repulsion
POLICY, TRAINING = "policy", "training"
LAST, BEST = "last", "best"
ATTEMPTS = 20  # to read what is being replaced

Part = tuple[dict[str, Any], dict[str, Tensor]]  # its JSON and its tensors


def write(directory: Path, parts: Mapping[str, Part]) -> None:
    """Write `part.json` and `part.safetensors` for each part; the directory changes as a whole or not at all.

    Raises:
        OutputError: the directory cannot be written.
    """
    directory = Path(directory)
    with writing(directory):
        directory.parent.mkdir(parents=True, exist_ok=True)
        partial = Path(tempfile.mkdtemp(prefix=f".{directory.name}-", dir=directory.parent))
        try:
            partial.chmod(0o755)
            for part, (about, tensors) in parts.items():
                path = partial / f"{part}.json"
                path.write_text(json.dumps(about, indent=2) + "\n", encoding="utf-8")
                sync(path)
                save_file({name: value.contiguous() for name, value in tensors.items()}, _tensors(partial, part))
                sync(_tensors(partial, part))
            sync(partial)
            replace_folder(partial, directory)
            sync(directory.parent)
        finally:
            shutil.rmtree(partial, ignore_errors=True)


def clean(run: Path) -> None:
    """Put back what a killed process was replacing in the directory of a run, and remove what it had not completed.

    To be called by the one process that writes there, see `usvauv.env.storage.files`.

    Raises:
        OutputError: the directory cannot be written.
    """
    with writing(run):
        for place in (run / LAST, run / BEST):
            if found(place) != place:
                os.replace(found(place), place)
            for left in run.glob(f".{place.name}-*"):
                shutil.rmtree(left)


def _tensors(directory: Path, part: str) -> Path:
    return directory / f"{part}.safetensors"


def read(directory: Path, part: str, device: torch.device) -> Part:
    """JSON and tensors of a part, as given to `write`; both of the same `write`, also while another one is going on.

    Raises:
        PolicyError: missing or damaged.
    """
    for _ in range(ATTEMPTS):
        place = found(directory)
        before = _identity(place)
        try:
            content = _read(place, part, device)
        except PolicyError:
            if before is not None and before == _identity(place):
                raise
        else:
            if before == _identity(place):
                return content
    return _read(directory, part, device)


def _identity(directory: Path) -> tuple[int, int] | None:
    """What tells a directory from another one in its place; None: there is none."""
    try:
        about = directory.stat()
    except OSError:
        return None
    return about.st_ino, about.st_mtime_ns


def _read(directory: Path, part: str, device: torch.device) -> Part:
    path = directory / f"{part}.json"
    try:
        about = text_files.read(path, "JSON")
        if type(about.get("format")) is not int or about["format"] != FORMAT:
            raise PolicyError(
                f"{path}: not a checkpoint of format {FORMAT}; policies of earlier versions must be trained again"
            )
        path = _tensors(directory, part)
        if not os.path.isfile(path):
            raise FileNotFoundError
        return about, load_file(path, device=str(device))
    except FileNotFoundError:
        raise PolicyError(f"{directory}: checkpoint is missing {path.name}") from None
    except PolicyError:
        raise
    except Exception as error:  # of safetensors and torch, of any kind: types unknown to one of them, sizes, headers
        raise PolicyError(f"{path}: checkpoint is damaged: {error}") from None


def describe(policy: LearnedPolicy, config: TrainingConfig, about: Mapping[str, Any]) -> Part:
    """JSON and tensors of a policy; `about` adds how it was made and its score."""
    scenario = policy.scenario
    content = {
        "format": FORMAT,
        "algorithm": config.algorithm,
        "observation_size": policy.frame.layout.size,
        "num_auvs": scenario.auv.count,
        "action": scenario.auv.action,
        **about,
        "training": asdict(config),
        "scenario": scenario.to_dict(),
    }
    tensors = {f"actor.{name}": value for name, value in policy.actor.state_dict().items()}
    tensors["whitening.mean"] = policy.standardizer.mean
    tensors["whitening.deviation"] = policy.standardizer.deviation
    return content, tensors


def load_policy(
    directory: Path, name: str, scenario: Scenario | None = None, device: torch.device | None = None
) -> LearnedPolicy:
    """The policy of a checkpoint directory, for `scenario` (default: the one it was trained in).

    Raises:
        PolicyError: missing, damaged, or made for other sizes than the scenario's.
    """
    device = device or torch.device("cpu")
    content, tensors = read(directory, POLICY, device)
    own, config = _scenario_and_config(content, directory / f"{POLICY}.json")
    sizes = Sizes(1 if config.shared else own.auv.count, FRAMES[config.frame](own).features, ACTION_SIZE)
    actor = ALGORITHMS[config.algorithm].make_actor(sizes, config, torch.Generator(device))
    try:
        if not all(value.isfinite().all() for value in tensors.values()):
            raise RuntimeError("a value is not finite")
        standardizer = Standardizer(tensors.pop("whitening.mean"), tensors.pop("whitening.deviation"))
        actor.load_state_dict({key.removeprefix("actor."): value for key, value in tensors.items()})
    except (KeyError, RuntimeError) as error:
        first = str(error).strip().splitlines()[-1].strip()
        raise PolicyError(f"{_tensors(directory, POLICY)}: checkpoint is damaged: {first}") from None
    shape = (sizes.observation,)
    if standardizer.mean.shape != shape or standardizer.deviation.shape != shape:
        raise PolicyError(f"{_tensors(directory, POLICY)}: checkpoint is damaged: whitening is not {shape[0]} numbers")
    policy = LearnedPolicy(name, own, config.frame, standardizer, actor.requires_grad_(False), config.shared, content)
    return policy if scenario is None else policy.for_scenario(scenario)


def _scenario_and_config(content: Mapping[str, Any], path: Path) -> tuple[Scenario, TrainingConfig]:
    """What a policy was trained in and with, from the JSON of its checkpoint, whose other fields are checked."""
    try:
        scenario = Scenario.from_dict(content["scenario"], str(path), stored=True)
        config = TrainingConfig.from_dict(content["training"], str(path))
    except (KeyError, ScenarioError) as error:
        raise PolicyError(f"{path}: checkpoint is damaged: {error}") from None
    own = {
        "algorithm": config.algorithm,
        "num_auvs": scenario.auv.count,
        "action": scenario.auv.action,
        "observation_size": FRAMES[config.frame](scenario).layout.size,
    }
    for name, value in own.items():
        if type(content.get(name)) is not type(value) or content[name] != value:
            raise PolicyError(f"{path}: {name} = {_quoted(content.get(name))}: must be {value!r}, as its settings say")
    for name, (right, rule) in ABOUT.items():
        if name in content and not right(content[name]):
            raise PolicyError(f"{path}: {name} = {_quoted(content[name])}: must be {rule}")
    return scenario, config


def _quoted(value: object) -> str:
    return repr(value)[:60]


def _is_count(value: object) -> bool:
    return type(value) is int and 0 <= value <= LATEST


def _is_finite(value: object) -> bool:
    return type(value) in (int, float) and abs(value) <= LARGEST  # pyright: ignore[reportArgumentType]


def _is_text(value: object) -> bool:
    return isinstance(value, str)


def _is_texts(value: object) -> bool:
    return isinstance(value, list) and all(map(_is_text, value))


def _is_resumption(value: object) -> bool:
    """Whether this is an entry of "resumed", see `usvauv.policies.training.provenance`."""
    if not isinstance(value, dict) or not _is_count(value.get("steps")):
        return False
    texts = (text for name, text in value.items() if name not in ("steps", "plugins"))
    return all(map(_is_text, texts)) and _is_texts(value.get("plugins", []))


LATEST, LARGEST = 10**15, 1e12  # of steps and updates; of a figure
# Fields of policy.json that tell how a policy was made: whether a value is right, and what it must be.
ABOUT: dict[str, tuple[Callable[[object], bool], str]] = {
    **dict.fromkeys(("steps", "updates"), (_is_count, f"a whole number from 0 to {LATEST}")),
    "total": (lambda value: _is_count(value) and value != 0, f"a whole number from 1 to {LATEST}"),
    **dict.fromkeys(("usv", "command", "commit", "torch"), (_is_text, "text")),
    "plugins": (_is_texts, "a list of texts"),
    "seconds": (lambda value: _is_finite(value) and value >= 0, "a finite number, at least 0"),  # pyright: ignore
    "score": (lambda value: value is None or _is_finite(value), "a finite number or null"),
    "evaluation": (lambda value: isinstance(value, dict) and all(map(_is_finite, value.values())), "figures by name"),
    "resumed": (
        lambda value: isinstance(value, list) and all(map(_is_resumption, value)),
        "a list of steps, command, commit, torch and plugins",
    ),
}


def read_run(directory: Path) -> tuple[Scenario, TrainingConfig, dict[str, Any]]:
    """Scenario, settings and JSON of the run in a directory, from which its world is built before resuming.

    Raises:
        PolicyError: there is no such run, or it is damaged.
    """
    last = Path(directory) / LAST
    content, _ = read(last, POLICY, torch.device("cpu"))
    return *_scenario_and_config(content, last / f"{POLICY}.json"), content


def read_history(directory: Path) -> list[dict[str, float]]:
    """The evaluations of the run in a directory, oldest first, see `Trainer.history`; none before its first save.

    Raises:
        PolicyError: what is there is damaged.
    """
    path = found(Path(directory) / LAST) / f"{TRAINING}.json"
    try:
        history = text_files.read(path, "JSON")["history"]
    except FileNotFoundError:
        return []
    except (text_files.TextFileError, KeyError) as error:
        raise PolicyError(f"{path}: checkpoint is damaged: {error}") from None
    if not isinstance(history, list) or not all(_is_row(row) for row in history):
        raise PolicyError(f"{path}: checkpoint is damaged: history is not a list of named numbers")
    return history


def _is_row(row: object) -> bool:
    """Whether this is a row of `Trainer.history`."""
    return isinstance(row, dict) and all(type(value) in (int, float) for value in row.values())
