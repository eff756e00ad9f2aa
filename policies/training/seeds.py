"""Many seeds in one process."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

from usvauv.kernels.interruption import Stop, stoppable
from usvauv.policies.policy import PolicyError
from usvauv.policies.training.batched import BatchedRuns, naming
from usvauv.policies.training.trainer import WINDOW, Trainer

Figures = list[dict[str, Any]]
Write = Callable[[dict[str, Any]], None]


class Seeds:
    """Trains runs that differ in the seed alone, all in step.

    Each run does what its `Trainer` would do alone, but for rounding, and keeps its own checkpoints. Runs that have
    done fewer steps than others, because a process was killed while it saved, come up with them first.

    Args:
        runs: new or resumed; each with worlds and a directory of its own.
        threads: number of threads in which equal shares of the runs learn. Several small stacks learn faster on a CPU
            than one whose operations are spread over its cores, and on a GPU one does.

    Attributes:
        stopped, interruption: as those of a `Trainer`.

    Raises:
        PolicyError: the runs differ in more than the seed.
    """

    def __init__(self, runs: Sequence[Trainer], threads: int = 1) -> None:
        first = runs[0]
        for run in runs[1:]:
            alike = replace(run.config, seed=first.config.seed) == first.config
            if not alike or run.world.scenario != first.world.scenario:
                raise PolicyError(
                    f"training: seeds {first.config.seed} and {run.config.seed}: settings or scenario differ; they must"
                    " be the same"
                )
        self.runs, self.threads = runs, threads
        self.stopped = False
        self.interruption = Stop()

    def stop(self) -> None:
        """End `train` after the present step."""
        self.stopped = True

    def train(self, steps: int, callback: Callable[[Figures], None] = lambda figures: None) -> None:
        """Train until each run has done `steps` world-steps in all, or until Ctrl-C (then `stopped` is true).

        Args:
            steps: of each run.
            callback: called with the figures of each run that is under way, see `Trainer.train`. Those of the updates
                are means over the runs that learn in one thread.

        Raises:
            DivergenceError: as by `Trainer.train`; names the seed, and ends all runs.
        """
        for run in self.runs:
            with naming(run):
                run.begin()
        self.stopped = False
        with stoppable(self.stop) as self.interruption, ExitStack() as stack:
            writers = [stack.enter_context(run.writer()) for run in self.runs]
            while not self.stopped and (unfinished := [run for run in self.runs if run.steps < steps]):
                lowest = min(run.steps for run in unfinished)
                until = min([steps, *(run.steps for run in unfinished if run.steps > lowest)])
                behind = [pair for pair in zip(self.runs, writers, strict=True) if pair[0].steps == lowest]
                self._train_behind(behind, until, steps, callback)

    def _train_behind(
        self, behind: Sequence[tuple[Trainer, Write]], until: int, total: int, callback: Callable[[Figures], None]
    ) -> None:
        """Train runs that have done equally many steps, each with what writes its figures, until `until` are done."""
        first, before = behind[0][0], [run.seconds for run, _ in behind]
        count = min(self.threads, len(behind))
        batches = [BatchedRuns([run for run, _ in behind[index::count]]) for index in range(count)]
        begun, steps_before = time.perf_counter(), first.steps
        over = False
        with ThreadPoolExecutor(1) as pool, ThreadPoolExecutor(count) as workers:
            while not over:
                list(workers.map(lambda batch: batch.advance(pool, total), batches))
                due = first.evaluation_due(total)
                over = first.steps >= until or self.stopped
                if not (due or over or first.meter.rows == WINDOW):
                    continue
                for batch in batches:
                    batch.hand_out()
                elapsed = time.perf_counter() - begun
                all_figures = []
                for (run, write), seconds in zip(behind, before, strict=True):
                    with naming(run):
                        if due:
                            run.evaluate_now()
                        run.seconds = seconds + elapsed
                        figures = run.report(total, (first.steps - steps_before) / elapsed)
                    write(figures)
                    all_figures.append(figures)
                callback(all_figures)
                over |= self.stopped
                if due or over:
                    for run, _ in behind:
                        if run.directory is not None:
                            run.save()
