"""Errors of the AUVs' positions by the boat's strategy, for Fig. 4(b)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from usvauv import policies
from usvauv.cli.engines.training import EVALUATION_STEP
from usvauv.cli.reproduction.settings import Settings
from usvauv.cli.reproduction.work import Work
from usvauv.env import World
from usvauv.env.record import error_bound
from usvauv.env.record.metrics import position_error
from usvauv.env.record.recorder import record
from usvauv.env.storage.tables import write_rows

BOUND = "bound"
OVER_TIME = ("time", "median", "lower_quartile", "upper_quartile")
OVER_EPISODES: tuple[str, ...] = ("seed", "episode", "median", "p95")


@dataclass(frozen=True)
class FixErrors:
    """Errors of positions by one strategy of the boat, AUVs steered by `straight`; by `fim` also the bound.

    Two tables for each: over time (median and quartiles over episodes and AUVs), and over episodes (median and 95th
    percentile over steps and AUVs), in s and m. The bound has no quartiles and no percentile.
    """

    scenario: str
    usv: str

    def _rows(self) -> tuple[str, ...]:
        return (self.usv, BOUND) if self.usv == "fim" else (self.usv,)

    def left(self, settings: Settings, folder: Path) -> float:
        if all(path.exists() for row in self._rows() for path in results(folder, self.scenario, row)):
            return 0
        return EVALUATION_STEP * len(settings.seeds) * settings.scenario(self.scenario).mission.steps

    def run(self, work: Work) -> None:
        settings = work.settings
        scenario = settings.scenario(self.scenario)
        traces = []
        for seed in settings.seeds:
            world = World(scenario, settings.fix_episodes, seed, self.usv)
            act = policies.load("straight", world).act
            traces.append(record(world, act, "straight", on_step=work.step))
        time, episodes = traces[0].time, [(t.seed, w) for t in traces for w in range(settings.fix_episodes)]

        error = np.concatenate([position_error(trace) for trace in traces], axis=1)
        at = zip(time, *np.quantile(error, (0.5, 0.25, 0.75), axis=(1, 2)), strict=True)
        of = zip(episodes, *np.quantile(error, (0.5, 0.95), axis=(0, 2)), strict=True)
        self._write(work, self.usv, at, of)
        if self.usv == "fim":
            variance = np.concatenate([error_bound.variance(trace) for trace in traces], axis=1)
            median = error_bound.median_of_normals
            at = ((float(t), median(row.ravel()), "", "") for t, row in zip(time, variance, strict=True))
            of = ((place, median(variance[:, w].ravel()), "") for w, place in enumerate(episodes))
            self._write(work, BOUND, at, of)

    def _write(self, work: Work, row: str, at: Iterable[tuple], of: Iterable[tuple]) -> None:
        times, episodes = results(work.folder, self.scenario, row)
        write_rows(times, OVER_TIME, (dict(zip(OVER_TIME, values, strict=True)) for values in at))
        rows = (dict(zip(OVER_EPISODES, (*episode, *values), strict=True)) for episode, *values in of)
        write_rows(episodes, OVER_EPISODES, rows)


def results(folder: Path, scenario: str, row: str) -> tuple[Path, Path]:
    """Tables over time and over episodes of a strategy or of the bound."""
    name = f"fixes-{scenario}-{row.replace(':', '-').replace(',', '-')}"
    return folder / "evaluations" / f"{name}-over-time.csv", folder / "evaluations" / f"{name}-over-episodes.csv"
