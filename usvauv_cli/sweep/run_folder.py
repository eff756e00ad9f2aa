"""A run in its folder: trained if required, then evaluated. A folder with `RESULT` is finished.

HASH/run.json       its definition
HASH/last, best, …  the training run, as `usvauv train` keeps it
HASH/episodes.csv   one row per episode; written last
HASH/failure.txt    failure of the last attempt
HASH/made.json      seconds of all attempts, host and version of the last
"""

from __future__ import annotations

import hashlib
import json
import platform
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property, partial
from importlib import metadata
from pathlib import Path
from typing import Any

from usvauv.cli.sweep.engine import Signs, Stopped
from usvauv.env.record.evaluation import run_episodes
from usvauv.env.scenario import Scenario
from usvauv.env.storage.files import OutputError, atomic_write, inside, locked, read_text, writing
from usvauv.env.storage.result_tables import read_rows, write_rows
from usvauv.env.world.world import World
from usvauv.kernels.errors import UserError
from usvauv.policies import checkpoint, loading
from usvauv.policies.checkpoint import provenance
from usvauv.policies.config import TrainingConfig
from usvauv.policies.inputs import digests
from usvauv.policies.learned import LearnedPolicy
from usvauv.policies.training.figures import EVALUATION_EPISODES, EVALUATION_SEED_OFFSET, figures_of_merit
from usvauv.policies.training.saving import resume
from usvauv.policies.training.trainer import Trainer, usual_evaluations
from usvauv.policies.training.training_run import TrainingRun

RESULT = "episodes.csv"
DEFINITION = "run.json"
FAILURE = "failure.txt"
MADE = "made.json"
EVALUATION_STEP = 12  # world-steps of training that take as long as one step of an evaluation's worlds
PATIENCE = 120.0  # seconds in which a process that was lost may still hold the lock; NFS shows signs after a minute

Evaluate = Callable[[Mapping[str, Any], Path, Callable[[int], None]], list[dict[str, Any]]]


def episodes(definition: Mapping[str, Any], place: Path, step: Callable[[int], None]) -> list[dict[str, Any]]:
    """Rows of `usvauv eval` for the policy of a run in its scenario; its folder has the policy where one was trained.

    `step` is called after each step with the number of worlds that made it; it may raise `Stopped`.
    """
    wanted, config = definition["evaluation"], definition["training"]
    name = config["algorithm"] if config else definition["policy"]
    rows = run_episodes(
        Scenario.from_dict(definition["scenario"], str(place)),
        {name: partial(loading.acting, place if config else name)},
        episodes=wanted["episodes"],
        seed=wanted["seed"] + definition["seed"],
        usv=definition["usv"],
        on_step=step,
    )
    return [row.columns() for row in rows]


@dataclass(frozen=True, kw_only=True)
class Piece:
    """A run that was checked.

    Its definition is the JSON that decides the results: "scenario", "policy" or "training" (a `TrainingConfig`, "total"
    world-steps, and if they are not the default "evaluations" and "judged" episodes in each), "usv", "seed", and
    "evaluation" with its number of "episodes" and what `evaluate` needs, and "files", the digests of
    `usvauv.policies.inputs`.
    """

    definition: Mapping[str, Any]
    method: str  # what acts, as tables name it
    task: str  # in what, likewise
    evaluate: Evaluate = episodes  # gives the rows of `RESULT`; a function at the top of a module

    @cached_property
    def key(self) -> str:
        """Name of the run's folder."""
        return key_of(self.definition)

    @property
    def seed(self) -> int:
        """Seed of the training."""
        return self.definition["seed"]

    @property
    def work(self) -> float:
        """Work of the whole run, in world-steps of training."""
        steps = EVALUATION_STEP * Scenario.from_dict(self.definition["scenario"]).mission.steps
        evaluated = steps * self.definition["evaluation"]["episodes"] / EVALUATION_EPISODES
        config = self.definition["training"]
        if not config:
            return evaluated
        total = config["total"]
        return evaluated + total + (config.get("evaluations", usual_evaluations(total)) + 1) * steps

    def place(self, folder: Path) -> Path:
        """Folder of the run in that of a study, out of which no link may lead."""
        path = folder / "runs" / self.key
        inside(folder, path)
        return path

    def finished(self, folder: Path) -> bool:
        """Whether the run is done."""
        return (self.place(folder) / RESULT).is_file()

    def rows(self, folder: Path) -> list[dict[str, str]]:
        """The result of the run."""
        return read_rows(inside(folder, self.place(folder) / RESULT))


def key_of(definition: Mapping[str, Any]) -> str:
    """Hash of JSON values; the order of their keys does not matter."""
    text = json.dumps(definition, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def perform(definition: Mapping[str, Any], evaluate: Evaluate, place: Path, signs: Signs) -> None:
    """Perform a run, or its remainder, see `Piece`; `Stopped`, with the training saved, if `signs` asks for it."""

    def step(world_steps: int) -> None:
        signs.advance(EVALUATION_STEP * world_steps / EVALUATION_EPISODES)
        if signs.stopping():
            raise Stopped

    with writing(place):
        place.mkdir(parents=True, exist_ok=True)
    with _locked(place):
        if (place / RESULT).is_file():
            return
        with atomic_write(place / DEFINITION) as partial_file:
            partial_file.write_text(json.dumps(definition, indent=2) + "\n", encoding="utf-8")
        with _record_time(place / MADE):
            if definition["training"]:
                _train(definition, place, signs)
            rows = evaluate(definition, place, step)
            if _files(definition) != definition["files"]:
                raise UserError("a file that the result depends on has changed during the run: run the command again")
            (place / FAILURE).unlink(missing_ok=True)
            write_rows(place / RESULT, list(rows[0]), rows)


def _files(definition: Mapping[str, Any]) -> list[str]:
    """Digests of the files that enter the result of a run."""
    scenario = Scenario.from_dict(definition["scenario"])
    return [*digests([scenario], [definition["policy"]]).values()]


def _train(definition: Mapping[str, Any], place: Path, signs: Signs) -> None:
    checkpoint.clean(place)
    scenario, usv = Scenario.from_dict(definition["scenario"], str(place)), definition["usv"]
    settings = dict(definition["training"])
    total = settings.pop("total")
    evaluations = settings.pop("evaluations", usual_evaluations(total))
    judged = settings.pop("judged", EVALUATION_EPISODES)
    config = TrainingConfig.from_dict(settings, str(place))
    evaluation_work = EVALUATION_STEP * scenario.mission.steps
    begun = {}
    if checkpoint.path_of(place, checkpoint.LAST).exists():
        begun = checkpoint.read_run(place)[2]
        trained = begun["steps"] >= total
        evaluated = evaluations + 1 if trained else len(checkpoint.read_history(place))
        signs.advance(min(begun["steps"], total) + evaluated * evaluation_work)
        if trained:
            return
    world = World(scenario, config.num_worlds, config.seed, usv)
    judges = World(scenario, judged, config.seed + EVALUATION_SEED_OFFSET, usv)

    def evaluate(policy: LearnedPolicy) -> dict[str, float]:
        return figures_of_merit(judges, policy, lambda _: signs.advance(EVALUATION_STEP))

    about = provenance(begun, digests([scenario])) | {"usv": usv, "total": total}
    training = TrainingRun(world, config, place, evaluate, about)
    if begun:
        resume(training)
    trainer, done = Trainer(training, evaluations=evaluations), training.steps

    def watch(figures: list[dict[str, Any]]) -> None:
        nonlocal done
        signs.advance(training.steps - done)
        done = training.steps
        trainer.stopped |= signs.stopping()

    trainer.train(total, watch)
    if training.steps < total:
        trainer.interruption.raise_if_asked()
        raise Stopped
    checkpoint.close_run(place)  # it is only read from now on


@contextmanager
def _record_time(path: Path) -> Iterator[None]:
    """Write the time of the block, added to the recorded time, whether or not it succeeds."""
    before, begun = seconds(path.parent) or 0.0, time.monotonic()
    try:
        yield
    finally:
        took = round(before + time.monotonic() - begun, 3)
        about = {"seconds": took, "host": platform.node(), "usvauv": metadata.version("usvauv")}
        with atomic_write(path) as partial_file:
            partial_file.write_text(json.dumps(about) + "\n", encoding="utf-8")


def seconds(place: Path) -> float | None:
    """Time of all attempts at the run of a folder; None if unknown."""
    with suppress(OSError, ValueError, KeyError, TypeError):
        return float(read_text(place / MADE, "JSON")["seconds"])
    return None


@contextmanager
def _locked(place: Path) -> Iterator[None]:
    """The lock of a folder, for which it waits up to `PATIENCE`."""
    begun = time.monotonic()
    with ExitStack() as stack:
        while True:
            try:
                stack.enter_context(locked(place))
                break
            except OutputError:
                if time.monotonic() - begun > PATIENCE:
                    raise
                time.sleep(0.5)
        yield
