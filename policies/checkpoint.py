"""Policies and training runs on disk, in safetensors files with JSON as their metadata, so that loading runs no code.

    RUN/best.safetensors    the best policy of a run
    RUN/last.safetensors    the last policy, and the state of the run for resuming it

A file has parts. The JSON of the part "policy" has the policy's provenance and score; its tensors are the actor's
weights and the statistics of the standardizer, `policy.actor.*` and `policy.whitening.*`. The part "training" has the
run's counters, networks, optimisers, replay, random generators and world, `training.*`. The metadata `usvauv` holds the
JSON of all parts by name:

>>> from safetensors import safe_open
>>> json.loads(safe_open("last.safetensors", "np").metadata()["usvauv"])["policy"]["score"]

A new file replaces the previous one atomically, so that a reader or a resumed run finds either one complete, whenever a
process is killed.
"""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

import torch
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from safetensors import safe_open
from safetensors.torch import save_file
from torch import Tensor

from usvauv.env import plugins
from usvauv.env.scenario import Scenario, ScenarioError
from usvauv.env.storage.files import (
    OutputError,
    atomic_write,
    inside,
    is_text,
    parse_text,
    readable,
    sync,
    writing,
)
from usvauv.policies.algorithms import Sizes, algorithms
from usvauv.policies.config import TrainingConfig
from usvauv.policies.frames import frames
from usvauv.policies.learned import LearnedPolicy, Standardizer
from usvauv.policies.names import ENDING, METADATA, POLICY, PolicyError

FORMAT = 2  # 1 had a guided frame without repulsion
TRAINING = "training"  # beside the part `POLICY`
LAST, BEST, TENSORBOARD, WANDB = "last", "best", "tensorboard", "wandb"
CPU = torch.device("cpu")
ATTEMPTS = 20  # to read a file that is being replaced

Part = tuple[dict[str, Any], dict[str, Tensor]]  # its JSON and its tensors


LATEST, LARGEST = 10**15, 1e12  # of steps and updates; of a figure
SHOWN = 60  # characters of a wrong value in a message
Count = Annotated[int, Field(ge=0, le=LATEST)]
Figure = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]


class Checked(BaseModel):
    """Checked fields of a checkpoint's JSON, which may have others."""

    model_config = ConfigDict(strict=True, allow_inf_nan=False)

    @classmethod
    def check(cls, content: Mapping[str, Any], place: str = "") -> None:
        """Refuse JSON with an invalid field; `place` begins the message.

        Raises:
            PolicyError: one line with the field, its value and what is allowed.
        """
        try:
            cls.model_validate(content)
        except ValidationError as error:
            first = error.errors()[0]
            field, message = ".".join(map(str, first["loc"])), first["msg"]
            given = "" if first["type"] == "missing" else f" = {repr(first['input'])[:SHOWN]}"
            raise PolicyError(f"{place}{field}{given}: {message[0].lower()}{message[1:]}") from None


class Resumption(Checked, extra="allow"):
    """An entry of `Made.resumed`, see `provenance`; its other fields are text."""

    __pydantic_extra__: dict[str, str]
    steps: Count
    plugins: list[str] = []
    files: dict[str, str] = {}


class Made(Checked):
    """Fields of a policy's JSON about its training."""

    steps: Count = 0
    updates: Count = 0
    total: Annotated[Count, Field(gt=0)] = 1
    usv: str = ""
    command: str = ""
    commit: str = ""
    torch: str = ""
    plugins: list[str] = []
    files: dict[str, str] = {}
    seconds: Annotated[Figure, Field(ge=0)] = 0.0
    score: Figure | None = None
    evaluation: dict[str, Figure] = {}
    resumed: list[Resumption] = []


def path_of(run: Path, name: str) -> Path:
    """Path of a run's checkpoint `LAST` or `BEST`, existing or not."""
    return run / f"{name}{ENDING}"


def write(path: Path, parts: Mapping[str, Part]) -> None:
    """Write the parts of a checkpoint; the file changes as a whole or not at all.

    Raises:
        OutputError: it cannot be written.
    """
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    about = json.dumps({part: content for part, (content, _) in parts.items()}, indent=2)
    tensors = {f"{part}.{name}": value.contiguous() for part, (_, own) in parts.items() for name, value in own.items()}
    with atomic_write(path) as partial:
        mode = partial.stat().st_mode
        save_file(tensors, partial, {METADATA: about})
        partial.chmod(mode)  # safetensors makes it readable for its owner only
    with writing(path):
        sync(path.parent)


def clean(run: Path) -> None:
    """Remove incomplete files of a killed process from the folder of a run.

    Only the one process that writes there may call it, see `usvauv.env.storage.files`.

    Raises:
        OutputError: the folder cannot be written, a file there is a link out of it, or its path is not UTF-8, which
            safetensors needs.
    """
    if not is_text(os.path.realpath(run)):
        raise OutputError(f"{run}: cannot hold checkpoints: its path must be in UTF-8")
    for name in (f"{LAST}{ENDING}", f"{BEST}{ENDING}", TENSORBOARD, WANDB):
        inside(run, run / name)
    with writing(run):
        for left in run.glob(f"*{ENDING}.*.partial"):
            left.unlink()


def read(path: Path, part: str, device: torch.device = CPU) -> Part:
    """JSON and tensors of a checkpoint's part, as given to `write`; both from the same `write`.

    Raises:
        PolicyError: missing or damaged.
    """
    for _ in range(ATTEMPTS):  # safetensors opens a file twice, for its header and for its tensors
        before = _identity(path)
        try:
            content = _read(path, part, device)
        except PolicyError:
            if before == _identity(path):
                raise
        else:
            if before == _identity(path):
                return content
    raise PolicyError(f"{path}: checkpoint cannot be read while it is replaced all the time")


def _identity(path: Path) -> tuple[int, int] | None:
    """A value that differs between a file and one that replaced it; None: no file."""
    try:
        about = path.stat()
    except OSError:
        return None
    return about.st_ino, about.st_mtime_ns


def _read(path: Path, part: str, device: torch.device) -> Part:
    if not is_text(str(path)):  # which safetensors cannot open
        raise PolicyError(f"{path}: the path of a checkpoint must be in UTF-8")
    try:
        about, tensors = _read_file(path, part, device)
    except FileNotFoundError:
        raise PolicyError(f"{path}: checkpoint is missing") from None
    except KeyError:
        raise PolicyError(f"{path}: checkpoint has no part {part!r}") from None
    except Exception as error:  # any error of safetensors and torch: types unknown to one of them, sizes, headers
        raise PolicyError(f"{path}: checkpoint is damaged: {error}") from None
    if not isinstance(about, dict) or type(about.get("format")) is not int or about["format"] != FORMAT:
        raise PolicyError(
            f"{path}: not a checkpoint of format {FORMAT}; policies of earlier versions must be trained again"
        )
    return about, tensors


def _read_file(path: Path, part: str, device: torch.device) -> Part:
    if not os.path.isfile(path):  # reading a pipe would not end
        raise FileNotFoundError
    with safe_open(path, "pt", device=str(device)) as file:
        about = parse_text((file.metadata() or {})[METADATA], "JSON")[part]
        names = [name for name in file.keys() if name.startswith(f"{part}.")]  # noqa: SIM118 - it is no mapping
        return about, {name.removeprefix(f"{part}."): file.get_tensor(name) for name in names}


def provenance(begun: Mapping[str, Any], files: Mapping[str, str] = MappingProxyType({})) -> dict[str, Any]:
    """Command, commit, version of torch, plugins and files, recorded in a checkpoint so that it can be reproduced.

    A resumed run keeps those of its beginning, from the JSON `begun` of its checkpoint; "resumed" lists the world-steps
    at which it was resumed, with the same items. `files` are those that enter the result with their digests, see
    `usvauv.policies.inputs`.
    """

    def git(*arguments: str) -> str:
        place = Path(__file__).parent
        try:
            done = subprocess.run(["git", *arguments], capture_output=True, text=True, check=False, cwd=place)
        except OSError:  # git is not installed
            return ""
        return done.stdout.strip() if done.returncode == 0 else ""

    commit = git("rev-parse", "HEAD") or "unknown"
    dirty = "+changes" if git("status", "--porcelain", "--untracked-files=no") else ""
    command = readable(shlex.join(["usvauv", *sys.argv[1:]]))
    now: dict[str, Any] = {
        "command": command,
        "commit": commit + dirty,
        "torch": torch.__version__,
        "files": dict(files),
    }
    if loaded := plugins.loaded():
        now["plugins"] = [readable(str(file)) for file in loaded]
    if not begun:
        return now
    first = {key: begun[key] for key in ("command", "commit", "torch", "plugins", "files") if key in begun}
    return first | {"resumed": [*begun.get("resumed", []), {"steps": begun.get("steps", 0), **now}]}


def describe(policy: LearnedPolicy, config: TrainingConfig, about: Mapping[str, Any]) -> Part:
    """JSON and tensors of a policy; `about` adds its provenance and score."""
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
    # Copies, because a file cannot hold shared memory twice, and a run has the actor among its networks too.
    tensors = {f"actor.{name}": value.clone() for name, value in policy.actor.state_dict().items()}
    tensors["whitening.mean"] = policy.standardizer.mean
    tensors["whitening.deviation"] = policy.standardizer.deviation
    return content, tensors


def load_policy(
    path: Path, name: str, scenario: Scenario | None = None, device: torch.device | None = None
) -> LearnedPolicy:
    """The policy of a checkpoint, for `scenario` (default: the one it was trained in).

    Raises:
        PolicyError: missing, damaged, or made for other sizes than the scenario's.
    """
    device = device or CPU
    content, tensors = read(path, POLICY, device)
    own, config, sizes = _checked(content, tensors, path)
    standardizer = Standardizer(tensors.pop("whitening.mean"), tensors.pop("whitening.deviation"))
    with algorithms.calling(config.algorithm):
        actor = algorithms[config.algorithm].make_actor(sizes, config, torch.Generator(device))
        actor.load_state_dict({key.removeprefix("actor."): value for key, value in tensors.items()})
    policy = LearnedPolicy(name, own, config.frame, standardizer, actor.requires_grad_(False), config.shared, content)
    return policy if scenario is None else policy.for_scenario(scenario)


class _Shapes(torch.Generator):
    """A source of numbers on the device "meta", where tensors have shapes but take no memory."""

    device = torch.device("meta")  # pyright: ignore[reportAssignmentType] - of the class it is an attribute


def check_tensors(tensors: Mapping[str, Tensor], expected: Mapping[str, tuple[tuple[int, ...], torch.dtype]]) -> None:
    """Refuse tensors other than those expected, by name with shape and type, and numbers out of range.

    Raises:
        PolicyError: one line with the tensor and what is wrong.
    """
    if different := sorted(tensors.keys() ^ expected.keys()):
        raise PolicyError(f"{different[0]} is {'unknown' if different[0] in tensors else 'missing'}")
    for name, (shape, kind) in expected.items():
        value = tensors[name]
        if tuple(value.shape) != shape or value.dtype != kind:
            raise PolicyError(f"{name} is {value.dtype} {tuple(value.shape)}: must be {kind} {shape}")
        if value.is_floating_point():
            least = 0.0 if name.endswith((".exp_avg_sq", ".step")) else -LARGEST
            if not ((value >= least) & (value <= LARGEST)).all():
                raise PolicyError(f"{name}: numbers must be finite, from {least:g} to {LARGEST:g}")


def _checked(
    content: Mapping[str, Any], tensors: Mapping[str, Tensor], path: Path
) -> tuple[Scenario, TrainingConfig, Sizes]:
    """Scenario and settings of a policy's training, and sizes of its actors, from its checkpoint, all of which is
    checked before networks of these sizes are built.
    """
    scenario, config = _scenario_and_config(content, path)
    with frames.calling(config.frame):
        sizes = frames[config.frame](scenario).sizes(config.shared)
    learner = algorithms[config.algorithm]
    try:
        actor = learner.make_actor(sizes, config, _Shapes())
    except Exception:  # a plugin's that needs numbers
        with algorithms.calling(config.algorithm):
            actor = learner.make_actor(sizes, config, torch.Generator())
    expected = {f"actor.{name}": (tuple(value.shape), value.dtype) for name, value in actor.state_dict().items()}
    expected |= {f"whitening.{name}": ((sizes.observation,), torch.float32) for name in ("mean", "deviation")}
    try:
        check_tensors(tensors, expected)
    except PolicyError as error:
        raise PolicyError(f"{path}: checkpoint is damaged: {error}") from None
    return scenario, config, sizes


def _scenario_and_config(content: Mapping[str, Any], path: Path) -> tuple[Scenario, TrainingConfig]:
    """Scenario and settings of a policy's training, from its checkpoint's JSON, whose other fields are checked."""
    try:
        scenario = Scenario.from_dict(content["scenario"], str(path), stored=True)
        config = TrainingConfig.from_dict(content["training"], str(path))
    except (KeyError, ScenarioError) as error:
        raise PolicyError(f"{path}: checkpoint is damaged: {str(error).splitlines()[0]}") from None
    own = {
        "algorithm": config.algorithm,
        "num_auvs": scenario.auv.count,
        "action": scenario.auv.action,
        "observation_size": frames[config.frame](scenario).layout.size,
    }
    for name, value in own.items():
        if type(content.get(name)) is not type(value) or content[name] != value:
            given = repr(content.get(name))[:SHOWN]
            raise PolicyError(f"{path}: {name} = {given}: must be {value!r}, as its settings say")
    Made.check(content, f"{path}: ")
    return scenario, config


def read_run(run: Path) -> tuple[Scenario, TrainingConfig, dict[str, Any]]:
    """Scenario, settings and JSON of a training run, from which its world is built before resuming.

    Raises:
        PolicyError: no such run, or it is damaged.
    """
    path = path_of(Path(run), LAST)
    content, tensors = read(path, POLICY)
    scenario, config, _ = _checked(content, tensors, path)
    return scenario, config, content


def read_history(run: Path) -> list[dict[str, float]]:
    """The evaluations of a training run, oldest first, see `TrainingRun.history`; none before its first save.

    Raises:
        PolicyError: the checkpoint is damaged.
    """
    path = path_of(Path(run), LAST)
    if not path.exists():
        return []
    history = read(path, TRAINING)[0].get("history")
    if not isinstance(history, list) or not all(_is_row(row) for row in history):
        raise PolicyError(f"{path}: checkpoint is damaged: history is not a list of named numbers")
    return history


def close_run(run: Path) -> None:
    """Remove from the last checkpoint the parts needed only for resuming: replay, networks and world.

    Raises:
        PolicyError: no checkpoint, or it is damaged.
        OutputError: it cannot be written.
    """
    path = path_of(run, LAST)
    write(path, {POLICY: read(path, POLICY), TRAINING: (read(path, TRAINING)[0], {})})


def _is_row(row: object) -> bool:
    """Whether this is a row of `TrainingRun.history`."""
    return isinstance(row, dict) and all(type(value) in (int, float) for value in row.values())
