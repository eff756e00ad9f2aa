"""Training in many worlds at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import Any

from torch import Tensor

from usvauv.kernels.interruption import Stop, stoppable
from usvauv.policies import checkpoint
from usvauv.policies.checkpoint import BEST, ENDING, POLICY, TENSORBOARD
from usvauv.policies.config import TrainingConfig
from usvauv.policies.learned import LearnedPolicy, Standardizer
from usvauv.policies.training.batched_runs import train_together
from usvauv.policies.training.exploration import TrainingWorld
from usvauv.policies.training.figures import LOGS, Meter, scalar_writer, wandb_writer
from usvauv.policies.training.saved_run import SavedRun

TINY = 1e-6
GAIN_RATE = 0.002  # step size of the running mean of the reward, for each step of all worlds
EVALUATIONS = 10  # evaluations in a run by default

Evaluate = Callable[[LearnedPolicy], Mapping[str, float]]
Callback = Callable[[dict[str, Any]], None]


class Trainer(SavedRun):
    """Trains a policy: act with exploration, step the worlds, store, update.

    The updates run in parallel with the worlds' step, on what was stored before it; the result does not depend on which
    of the two is faster. Worlds are truncated together and reset together. A truncated transition bootstraps from the
    last observation; one at which the value's horizon ends does not bootstrap.

    With `config.renewal` the average reward ρ of a step is maximised. By the renewal-reward theorem a policy is optimal
    if no trip to the next service yields more than ρ times its number of steps (Ross, "Applied probability models with
    optimization applications", 1970, section 7). So a service ends the value's horizon, and ρ, estimated by the running
    mean of the reward, is subtracted from the reward of every step. The price of time is then the same everywhere, and
    rewards after the service, which are noise to the trip, do not enter its value. With a discount alone the price of
    time depends on the distance to the next reward.

    Args:
        world: the worlds to train in, with their own seed.
        config: settings; `config.num_worlds` must be the world's.
        directory: where the checkpoints `last` and `best` and `tensorboard` are kept; None: nothing is written.
        evaluate: policy → figures with at least "arps", on other worlds than the training ones. Also called before the
            first step. The policy with the highest arps is kept as `best`.
        provenance: recorded in every checkpoint with the figures, such as command and commit.
        evaluations: number of calls of `evaluate` in a run, besides that for the untrained policy.
        log: one of `figures.LOGS`, where the curves go.

    Attributes:
        history: every evaluation of the run so far: its figures, with steps and updates; saved with the run.
        steps: world-steps done.
        stopped: whether the run was asked to stop, by Ctrl-C or a caller; it then ends after the present step.
        interruption: the signal that asked the last `train` to stop.

    Raises:
        PolicyError: `config.num_worlds` is not the world's, or `config.batch` below its number of AUVs.
        MemoryNeeded: networks, an update or the replay do not fit into memory.
    """

    def __init__(
        self,
        world: TrainingWorld,
        config: TrainingConfig,
        directory: str | Path | None = None,
        evaluate: Evaluate | None = None,
        provenance: Mapping[str, Any] | None = None,
        evaluations: int = EVALUATIONS,
        log: str = LOGS[0],
    ) -> None:
        super().__init__(world, config, directory, provenance)
        self.log = log
        self.evaluate = evaluate
        self.evaluations = evaluations
        self.meter = Meter(world)
        self.stopped = False
        self.interruption = Stop()

    def train(self, steps: int, callback: Callback = lambda figures: None) -> dict[str, Any]:
        """Train until `steps` world-steps are done in all, or until Ctrl-C (then `stopped` is true).

        Returns:
            The last figures, as `callback` got them: steps, total, seconds, eta, steps_per_second, updates, those of
            `Meter.figures`, and evaluation with evaluated_at, the steps that were done then.

        Raises:
            DivergenceError: a weight or a state of the worlds is no longer finite; the checkpoints are those before.
        """
        self.begin()
        last: dict[str, Any] = {}
        self.stopped = False
        with self.writer() as write, stoppable(self.stop) as self.interruption:

            def show(figures: list[dict[str, Any]]) -> None:
                last.update(figures[0])
                write(figures[0])
                callback(figures[0])

            train_together([self], steps, steps, lambda: self.stopped, show)
        return last

    def begin(self) -> None:
        """Begin a run that has not begun: reset the worlds, evaluate the untrained policy."""
        if self.steps == 0:
            self.observation = self.world.reset().clone()
        if not self.history:
            self.evaluate_now()

    def report(self, total: int, rate: float) -> dict[str, Any]:
        """The figures since the last report, see `train`.

        Args:
            total: world-steps of the run.
            rate: world-steps a second.

        Raises:
            DivergenceError: a weight is not finite.
        """
        figures = {
            "steps": self.steps,
            "total": total,
            "seconds": self.seconds,
            "eta": (total - self.steps) / rate,
            "steps_per_second": rate,
            "updates": self.learner.updates,
            **self.meter.figures(),
            "evaluation": self.evaluation,
            "evaluated_at": self.history[-1]["steps"] if self.history else None,
        }
        self.meter.reset()
        self.stop_if_not_finite()
        return figures

    def stop(self) -> None:
        """End `train` after the present step."""
        self.stopped = True

    def writer(self) -> AbstractContextManager[Callback]:
        """A function that writes figures for TensorBoard or Weights & Biases; without a directory it does nothing."""
        if self.directory is None:
            return nullcontext(lambda figures: None)
        if self.log == "wandb":
            return wandb_writer(self.directory, asdict(self.config) | {"scenario": self.world.scenario.to_dict()})
        return scalar_writer(self.directory / TENSORBOARD, self.steps)

    def evaluation_due(self, total: int) -> bool:
        """Whether one is due after the step just done, in a run of `total` world-steps."""
        before = self.steps - self.config.num_worlds
        return self.steps * self.evaluations // total > before * self.evaluations // total

    @property
    def deciding(self) -> bool:
        """Whether the next step takes a new action; on-policy algorithms hold each, as its features and noise."""
        time = self.steps // self.config.num_worlds % self.world.steps
        return not self.config.on_policy or time % self.config.n_step == 0

    @property
    def learning(self) -> bool:
        """Whether the next step comes with updates."""
        if self.config.on_policy:
            return self.replay.size >= self.config.rollout and self.deciding
        return self.steps >= self.config.warmup and self.replay.size > self.config.n_step + 1

    def rate_share(self, total: int) -> float:
        """Learning rate of now over the initial one, in a run of `total` world-steps."""
        return 1.0 - (1.0 - self.config.final_rate) * self.steps / total

    def renew(self, reward: Tensor, horizon_ended: Tensor, info: dict[str, Tensor]) -> Tensor:
        """Where the value's horizon ends; with renewal also at services, and the average reward learns of `reward`."""
        if not self.renewal:
            return horizon_ended
        self._gain += GAIN_RATE * (reward.mean().double() - self._gain)
        return horizon_ended | (info["measures"][..., self.world.measure_names.index("service_rate")] > 0)

    def standardize(self, features: Tensor) -> Tensor:
        """Take the statistics of features and reward from the replay, once before the first update; rescale the replay
        and `features` by them.
        """
        rewards = self.replay.reward[: self.replay.size]
        self.scale = self.config.reward_scale / max(float(rewards.abs().mean()), TINY)
        rewards.mul_(self.scale)
        stored = self.replay.observation[: self.replay.size]
        self.standardizer.copy_(Standardizer.of(stored))  # in place: earlier policies share the updated statistics
        stored.copy_(self.standardizer(stored))
        return self.standardizer(features)

    def evaluate_now(self) -> None:
        """Evaluate, and keep the policy if it is the best so far."""
        if self.evaluate is None:
            return
        self.stop_if_not_finite()
        self.evaluation = {name: float(value) for name, value in self.evaluate(self.policy()).items()}
        self.history.append({"steps": self.steps, "updates": self.learner.updates, **self.evaluation})
        if self.evaluation["arps"] > self.best:
            self.best = self.evaluation["arps"]
            if self.directory is not None:
                checkpoint.write(self.directory / f"{BEST}{ENDING}", {POLICY: self._describe()})
