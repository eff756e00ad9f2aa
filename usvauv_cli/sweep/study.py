"""A study file: its runs, their evaluation, and the resources of each.

Each `[[runs]]` is a run, or, where fields have lists, one for each combination of their entries; `[common]` holds for
all of them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import Field, ValidationError, model_validator

from usvauv.cli.sweep.run_folder import Piece, key_of
from usvauv.env.record.metrics import FIGURES, task_metrics
from usvauv.env.scenario import Scenario
from usvauv.env.scenario.fields import Layer, Section, one_of, problems_of
from usvauv.env.storage.files import TextFileError, decoded, read_text
from usvauv.env.world.strategy_choice import StrategyChoice
from usvauv.kernels.errors import UserError
from usvauv.policies import loading
from usvauv.policies.config import TrainingConfig
from usvauv.policies.inputs import digests

OF_TRAINING = ("steps", "worlds", "shared", "learn")
LISTS = ("set", "learn")  # fields that are lists themselves; several of these are a list of lists
MOST_RUNS = 10_000
SEPARATOR = " · "  # between parts of a name


class StudyRun(Section):
    """A run: a policy that is named, or an algorithm that learns one."""

    name: str = Field(default="", description="of the method in tables; default what distinguishes it")
    scenario: str = Field(default="extreme", description="shipped name or path of a TOML file")
    set: tuple[str, ...] = Field(default=(), description="changes of the scenario, SECTION.FIELD=VALUE")
    policy: str = Field(default="", description="as `usvauv eval --policy` takes it")
    algorithm: str = Field(default="", description="sac, td3, ddpg or ppo: the policy is learned first")
    steps: int = Field(default=2_000_000, ge=1, description="world-steps of the training")
    worlds: int | None = Field(default=None, ge=1, description="worlds stepped together in it; default as `train` has")
    shared: bool | None = Field(default=None, description="one network for all AUVs; default as `train` has")
    learn: tuple[str, ...] = Field(default=(), description="settings of the learning, NAME=VALUE")
    usv: str = Field(default="", description="boat strategy; default the scenario's")
    targets: str = Field(default="", description="target rule; default the scenario's")
    seed: int = Field(default=0, ge=0, lt=2**31, description="of the training; it is added to that of the evaluation")

    @model_validator(mode="after")
    def _check(self) -> StudyRun:
        if bool(self.policy) == bool(self.algorithm):
            raise ValueError(f"policy = {self.policy!r}, algorithm = {self.algorithm!r}: must be one of the two")
        given = [name for name in OF_TRAINING if name in self.model_fields_set]
        if self.policy and given:
            raise ValueError(f"{given[0]} = {getattr(self, given[0])!r}: must go with algorithm, not with policy")
        return self


class Evaluation(Section):
    """How each run is evaluated."""

    episodes: int = Field(default=20, ge=1, le=1_000_000, description="of each run")
    seed: int = Field(
        default=2026, ge=1, le=1_000_000, description="that of the run is added; 0 would be that of its training"
    )
    score: Annotated[str, one_of(FIGURES, task_metrics)] = Field(
        default="arps", description="figure that the summary compares, a column of `usvauv eval`"
    )
    better: Literal["higher", "lower"] = Field(default="higher", description="which score is better")


class Resources(Section):
    """Resources of a run, which an engine gives it."""

    cores: int = Field(default=1, ge=1, le=1024, description="CPU cores")
    memory: float = Field(default=2.0, ge=0.1, le=100_000, description="memory, GB")
    gpu: float = Field(default=0.0, ge=0, le=1, description="share of a graphics card; 0: on the CPU")
    hours: float = Field(default=24.0, ge=0.02, le=10_000, description="time limit under Slurm, h")

    @property
    def arch(self) -> str:
        """The architecture, an argument of `usvauv.kernels.runtime.start`."""
        return "cuda" if self.gpu else "cpu"


@dataclass(frozen=True)
class Study:
    """Contents of a study file; duplicate runs are taken once."""

    path: Path
    text: str
    runs: tuple[Piece, ...]
    evaluation: Evaluation
    resources: Resources


def read(path: Path) -> Study:
    """A study from its TOML file; refusals name the file, the field, its value and what is allowed."""
    try:
        data = read_text(path, "TOML")
    except FileNotFoundError:
        raise UserError(f"{path}: is not a file") from None
    except TextFileError as error:
        raise UserError(f"{path}: {error}") from None
    allowed = {"common": dict, "runs": list, "evaluation": dict, "resources": dict}
    for name, value in data.items():
        if name not in allowed:
            raise UserError(f"{path}: {name}: unknown; allowed here: {', '.join(allowed)}")
        if not isinstance(value, allowed[name]):
            raise UserError(f"{path}: {name} = {value!r}: must be {'[[runs]]' if name == 'runs' else f'[{name}]'}")
    evaluation = _valid(Evaluation, data.get("evaluation", {}), f"{path}: evaluation")
    resources = _valid(Resources, data.get("resources", {}), f"{path}: resources")
    planned: dict[str, tuple[StudyRun, dict[str, Any]]] = {}
    for number, entry in enumerate(data.get("runs", [])):
        source = f"{path}: runs[{number}]"
        if not isinstance(entry, Mapping):
            raise UserError(f"{source} = {entry!r}: must be a table of fields")
        for values in _combinations({**data.get("common", {}), **entry}, source):
            run = _valid(StudyRun, values, source)
            definition = define(run, evaluation, source)
            planned.setdefault(key_of(definition), (run, definition))
    if not planned:
        raise UserError(f"{path}: runs: there are none; expected at least one [[runs]]")
    return Study(path, decoded(path.read_bytes()), tuple(_named(list(planned.values()))), evaluation, resources)


S = TypeVar("S", bound=Section)


def _valid(kind: type[S], values: Mapping[str, Any], source: str) -> S:
    try:
        return kind.model_validate(values)
    except ValidationError as error:
        raise UserError(*problems_of(error, [Layer(values, source)], kind)) from None


def _combinations(fields: Mapping[str, Any], source: str) -> Iterator[dict[str, Any]]:
    """Fields with one value each, for each combination."""
    axes: list[Sequence[Any]] = []
    for name, value in fields.items():
        several = isinstance(value, list) and (name not in LISTS or any(isinstance(part, list) for part in value))
        if several and not value:
            raise UserError(f"{source}: {name} = []: must have at least one entry")
        axes.append(value if several else [value])
    if (count := math.prod(map(len, axes))) > MOST_RUNS:
        raise UserError(f"{source}: {count} combinations: must be at most {MOST_RUNS}")
    for values in product(*axes):
        yield dict(zip(fields, values, strict=True))


def define(run: StudyRun, evaluation: Evaluation, source: str) -> dict[str, Any]:
    """The definition of a run, see `Piece`, checked as far as it can be without a world; refusals name `source`."""
    try:
        scenario = Scenario.load(run.scenario, run.set).with_targets(run.targets or None)
        usv = StrategyChoice.parse(run.usv or None, scenario).name
        training = None
        if run.algorithm:
            config = TrainingConfig.of(
                scenario, algorithm=run.algorithm, num_worlds=run.worlds, seed=run.seed, shared=run.shared
            ).changed(run.learn)
            training = {**asdict(config), "total": run.steps}
        else:
            loading.check(run.policy, scenario)
    except UserError as error:
        raise UserError(*(f"{source}: {problem}" for problem in error.args)) from None
    return {
        "scenario": scenario.to_dict(),
        "policy": run.policy,
        "training": training,
        "usv": usv,
        "seed": run.seed,
        "evaluation": {"episodes": evaluation.episodes, "seed": evaluation.seed},
        "files": [*digests([scenario], [run.policy]).values()],
    }


def _named(runs: Sequence[tuple[StudyRun, dict[str, Any]]]) -> Iterator[Piece]:
    """Runs with their method and task in words, each of which stands for one content in the whole study: what acts, and
    in which scenario; of settings and changes those that are not the same in all runs.
    """
    settings = [
        [f"{name}={getattr(run, name)}" for name in OF_TRAINING[:-1] if name in run.model_fields_set] + _last(run.learn)
        for run, _ in runs
    ]
    same = _in_all([of for of, (run, _) in zip(settings, runs, strict=True) if run.algorithm])
    changes = _in_all([run.set for run, _ in runs])
    boats = len({definition["usv"] for _, definition in runs}) > 1
    methods, tasks, scenarios = [], [], dict[str, tuple[str, list[str]]]()
    for of, (run, definition) in zip(settings, runs, strict=True):
        varying = [text for text in of if text not in same]
        parts = [run.policy or run.algorithm, *varying, definition["usv"] if boats else "", run.targets]
        whole = [run.policy or run.algorithm, *of, run.usv, run.targets]
        methods.append((run.name or SEPARATOR.join(filter(None, parts)), whole))
        task = [definition["scenario"]["name"], *(change for change in run.set if change not in changes)]
        content = json.dumps(_without_targets(run, definition), sort_keys=True)
        tasks.append(scenarios.setdefault(content, (" ".join(task), [run.scenario, *_last(run.set)])))
    for (_, definition), method, task in zip(runs, _told_apart(methods), _told_apart(tasks), strict=True):
        yield Piece(definition=definition, method=method, task=task)


def _without_targets(run: StudyRun, definition: Mapping[str, Any]) -> Mapping[str, Any]:
    """The content of a run's scenario, with the target rule only where it is not part of the method."""
    scenario = definition["scenario"]
    return {**scenario, "nodes": {**scenario["nodes"], "target_rule": ""}} if run.targets else scenario


def _told_apart(named: Sequence[tuple[str, Sequence[str]]]) -> list[str]:
    """Names, given with all that makes up what each stands for; one that stands for several things is followed by what
    these do not have in common.
    """
    found: dict[str, list[Sequence[str]]] = {}
    for name, parts in named:
        found.setdefault(name, []).append(parts)
    common = {name: _in_all(of) for name, of in found.items()}
    return [
        SEPARATOR.join([name, *(part for part in parts if part and part != name and part not in common[name])])
        for name, parts in named
    ]


def _last(assignments: Sequence[str]) -> list[str]:
    """Assignments NAME=VALUE that have an effect: the last one of each name."""
    return list({text.partition("=")[0]: text for text in assignments}.values())


def _in_all(lists: Sequence[Sequence[str]]) -> set[str]:
    return set.intersection(*map(set, lists)) if lists else set()
