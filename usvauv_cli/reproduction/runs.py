"""Training runs and tests of policies.

FOLDER/runs/METHOD-SCENARIO-SEED/          a training run as `Trainer` keeps it
FOLDER/evaluations/POLICY-in-SCENARIO.csv  a test, one row an episode
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from usvauv import policies
from usvauv.cli.engines import training
from usvauv.cli.engines.training import EVALUATION_STEP
from usvauv.cli.reproduction.paper import CONDITIONS
from usvauv.cli.reproduction.settings import Settings
from usvauv.cli.reproduction.work import Work
from usvauv.env import World
from usvauv.env.record.metrics import COLUMNS, episode_metrics
from usvauv.env.record.recorder import record
from usvauv.env.storage.files import locked, writing
from usvauv.env.storage.tables import write_rows
from usvauv.policies import checkpoint
from usvauv.policies.checkpoint import provenance
from usvauv.policies.training.figures import EVALUATION_SEED_OFFSET

TESTED = ("method", "trained_in", "run", "updates", *COLUMNS, "collaboration")


@dataclass(frozen=True)
class Learned:
    """A training run; if `tested`, also the tests of its best policy in both conditions."""

    method: str
    trained_in: str
    seed: int
    tested: bool

    def place(self, folder: Path) -> Path:
        """The run's directory."""
        return folder / "runs" / f"{self.method}-{self.trained_in}-{self.seed}"

    def about(self, folder: Path) -> dict[str, Any]:
        """JSON of its best policy: score, updates, commit and more."""
        return checkpoint.read(checkpoint.path_of(self.place(folder), checkpoint.BEST), checkpoint.POLICY)[0]

    def results(self, folder: Path) -> dict[str, Path]:
        """Scenario → table of the test in it."""
        names = CONDITIONS.values() if self.tested else ()
        return {name: folder / "evaluations" / f"{self.place(folder).name}-in-{name}.csv" for name in names}

    def left(self, settings: Settings, folder: Path) -> float:
        steps = settings.scenario(self.trained_in).mission.steps
        tests = sum(not path.exists() for path in self.results(folder).values())
        untrained = training.left(self.place(folder), settings.steps, settings.evaluations, steps)
        return untrained + tests * EVALUATION_STEP * steps

    def run(self, work: Work) -> None:
        place = self.place(work.folder)
        if training.trained(place) < work.settings.steps:
            with writing(place):
                place.mkdir(parents=True, exist_ok=True)
            with locked(place):
                checkpoint.clean(place)
                self._train(work)
        for scenario, path in self.results(work.folder).items():
            if not path.exists():
                self._test(work, scenario, path)

    def _train(self, work: Work) -> None:
        settings, place = work.settings, self.place(work.folder)
        method = settings.method(self.method)
        scenario = settings.scenario(self.trained_in, method.learning)
        config = replace(method.config, seed=self.seed)
        world = World(scenario, config.num_worlds, config.seed, method.usv)
        evaluation_worlds = World(scenario, settings.judged, config.seed + EVALUATION_SEED_OFFSET, method.usv)

        def evaluate(policy: policies.LearnedPolicy) -> dict[str, float]:
            return policies.figures_of_merit(evaluation_worlds, policy, lambda _: work.advance(EVALUATION_STEP))

        about = provenance({})
        trainer = policies.Trainer(world, config, place, evaluate, about, settings.evaluations)
        training.go_on(trainer, settings.steps, work.advance, work.stopping)

    def _test(self, work: Work, name: str, path: Path) -> None:
        settings = work.settings
        method = settings.method(self.method)
        scenario = settings.scenario(name, method.testing)
        first = settings.seeds.index(self.seed) * settings.episodes
        world = World(scenario, settings.episodes, settings.test_seed, method.usv, first_world=first)
        updates = self.about(work.folder)["updates"]
        about = {"method": self.method, "trained_in": self.trained_in, "run": self.seed, "updates": updates}
        policy = policies.load(self.place(work.folder) / "best", world)
        write_rows(path, TESTED, test(world, policy, method.title, about, first, work))


@dataclass(frozen=True)
class Heuristic:
    """The test of a heuristic in a condition."""

    policy: str
    scenario: str

    def result(self, folder: Path) -> Path:
        """Table of the test."""
        return folder / "evaluations" / f"{self.policy}-in-{self.scenario}.csv"

    def left(self, settings: Settings, folder: Path) -> float:
        steps = settings.scenario(self.scenario).mission.steps
        return 0 if self.result(folder).exists() else EVALUATION_STEP * steps

    def run(self, work: Work) -> None:
        settings = work.settings
        scenario = settings.scenario(self.scenario)
        world = World(scenario, settings.episodes * len(settings.seeds), settings.test_seed)
        about = {"method": self.policy, "trained_in": "", "run": "", "updates": ""}
        rows = test(world, policies.load(self.policy, world), self.policy, about, 0, work)
        write_rows(self.result(work.folder), TESTED, rows)


def test(
    world: World, policy: policies.Policy, title: str, about: Mapping[str, Any], first: int, work: Work
) -> Iterable[dict[str, Any]]:
    """One row an episode: what is tested, its metrics, and what Eq. 5's term adds to its arps."""
    trace = record(world, policy.act, title, on_step=work.step)
    term = trace.reward_terms[..., trace.reward_names.index("collaboration")]
    added = term.sum(axis=2, dtype=np.float64).mean(axis=0)
    for row, value in zip(episode_metrics(trace, first), added, strict=True):
        yield {**about, **{name: getattr(row, name) for name in COLUMNS}, "collaboration": float(value)}
