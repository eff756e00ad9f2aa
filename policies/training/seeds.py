"""Training of many seeds in one process."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

from usvauv.kernels.interruption import Stop, stoppable
from usvauv.policies.policy import PolicyError
from usvauv.policies.training.batched_runs import naming, train_together
from usvauv.policies.training.trainer import Trainer

Figures = list[dict[str, Any]]


class Seeds:
    """Trains runs that differ only in the seed, all in step.

    Each run gives the same results as its `Trainer` alone, except for rounding, and keeps its own checkpoints. Runs
    with fewer steps than others, because a process was killed while it saved, catch up first.

    Args:
        runs: new or resumed; each with its own worlds and directory.
        threads: number of threads in which equal shares of the runs learn on a CPU, where several small stacks are
            faster than one whose operations are spread over its cores. On a GPU it is one.

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
        self.runs, self.threads = runs, threads if first.world.device.type == "cpu" else 1
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
            writers = {run: stack.enter_context(run.writer()) for run in self.runs}
            while not self.stopped and (unfinished := [run for run in self.runs if run.steps < steps]):
                lowest = min(run.steps for run in unfinished)
                until = min([steps, *(run.steps for run in unfinished if run.steps > lowest)])
                behind = [run for run in unfinished if run.steps == lowest]

                def show(figures: Figures, behind: Sequence[Trainer] = behind) -> None:
                    for run, own in zip(behind, figures, strict=True):
                        writers[run](own)
                    callback(figures)

                train_together(behind, until, steps, lambda: self.stopped, show, self.threads)
