"""A run in its folder: trained where that is asked for, then evaluated. A folder with `RESULT` is finished.

HASH/run.json       what defines it
HASH/last, best, …  the training run, as `usvauv train` keeps it
HASH/episodes.csv   one row an episode; written last
HASH/failure.txt    how the last attempt failed
HASH/made.json      seconds of all attempts, host and version of the last
"""

from __future__ import annotations

import json
import platform
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any

from usvauv import env, policies
from usvauv.cli.engines import training
from usvauv.cli.engines.task import Signs, Stopped
from usvauv.env import Scenario, World
from usvauv.env.storage.files import OutputError, atomic_write, locked, writing
from usvauv.env.storage.tables import write_rows
from usvauv.policies.checkpoint import clean, provenance
from usvauv.policies.training.figures import EVALUATION_EPISODES, EVALUATION_SEED_OFFSET
from usvauv.policies.training.trainer import EVALUATIONS

RESULT = "episodes.csv"
DEFINITION = "run.json"
FAILURE = "failure.txt"
MADE = "made.json"
PATIENCE = 120.0  # seconds in which a process that was lost may still hold the lock; NFS shows signs after a minute


def finished(place: Path) -> bool:
    """Whether the run of a folder is done."""
    return (place / RESULT).is_file()


@dataclass(frozen=True)
class Perform:
    """Does a run, or what is left of it, in a process of its own.

    Attributes:
        definition: of the run, `study.Planned.definition`.
        place: its folder.
    """

    definition: Mapping[str, Any]
    place: Path

    @property
    def work(self) -> float:
        """Work of the whole run, in world-steps of training."""
        config, episodes = self.definition["training"], self.definition["evaluation"]["episodes"]
        steps = Scenario.from_dict(self.definition["scenario"], stored=True).mission.steps
        evaluated = training.EVALUATION_STEP * steps * episodes / EVALUATION_EPISODES
        if config is None:
            return evaluated
        return config["total"] + (EVALUATIONS + 1) * training.EVALUATION_STEP * steps + evaluated

    def __call__(self, signs: Signs) -> None:
        place = self.place
        with writing(place):
            place.mkdir(parents=True, exist_ok=True)
        with _locked(place):
            if finished(place):
                return
            with atomic_write(place / DEFINITION) as partial_file:
                partial_file.write_text(json.dumps(self.definition, indent=2) + "\n", encoding="utf-8")
            scenario = Scenario.from_dict(self.definition["scenario"], str(place), stored=True)
            with _noted(place / MADE):
                if self.definition["training"]:
                    self._train(scenario, signs)
                self._evaluate(scenario, signs)

    def _train(self, scenario: Scenario, signs: Signs) -> None:
        clean(self.place)
        settings = dict(self.definition["training"])
        total, usv = settings.pop("total"), self.definition["usv"]
        config = policies.TrainingConfig.from_dict(settings, str(self.place))
        left = training.left(self.place, total, EVALUATIONS, scenario.mission.steps)
        signs.advance(total + (EVALUATIONS + 1) * training.EVALUATION_STEP * scenario.mission.steps - left)
        if not left:
            return
        world = World(scenario, config.num_worlds, config.seed, usv)
        judges = World(scenario, EVALUATION_EPISODES, config.seed + EVALUATION_SEED_OFFSET, usv)

        def evaluate(policy: policies.LearnedPolicy) -> dict[str, float]:
            return policies.figures_of_merit(judges, policy, lambda _: signs.advance(training.EVALUATION_STEP))

        begun = policies.read_run(self.place)[2] if training.trained(self.place) else {}
        about = provenance(begun) | {"usv": usv, "total": total}
        trainer = policies.Trainer(world, config, self.place, evaluate, about)
        training.go_on(trainer, total, signs.advance, signs.stopping)

    def _evaluate(self, scenario: Scenario, signs: Signs) -> None:
        wanted, config = self.definition["evaluation"], self.definition["training"]
        name = config["algorithm"] if config else self.definition["policy"]

        def step(world_steps: int) -> None:
            signs.advance(training.EVALUATION_STEP * world_steps / EVALUATION_EPISODES)
            if signs.stopping():
                raise Stopped

        rows = env.evaluate(
            scenario,
            {name: partial(policies.acting, self.place if config else name)},
            episodes=wanted["episodes"],
            seed=wanted["seed"] + self.definition["seed"],
            usv=self.definition["usv"],
            on_step=step,
        )
        (self.place / FAILURE).unlink(missing_ok=True)
        write_rows(self.place / RESULT, list(rows[0].columns()), (row.columns() for row in rows))


@contextmanager
def _noted(path: Path) -> Iterator[None]:
    """Write what the block took, added to what is there, whether or not it succeeds."""
    before, begun = seconds(path.parent) or 0.0, time.monotonic()
    try:
        yield
    finally:
        took = round(before + time.monotonic() - begun, 1)
        about = {"seconds": took, "host": platform.node(), "usvauv": metadata.version("usvauv")}
        with atomic_write(path) as partial_file:
            partial_file.write_text(json.dumps(about) + "\n", encoding="utf-8")


def seconds(place: Path) -> float | None:
    """What all attempts at the run of a folder took; None if that is not known."""
    with suppress(OSError, ValueError, KeyError, TypeError):
        return float(json.loads((place / MADE).read_text(encoding="utf-8"))["seconds"])
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
