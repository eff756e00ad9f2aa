"""Training of one or several seeds in many worlds at once.

`SeedStack.step` is the algorithm's loop, from the action to the update, which `algorithms` have; `Trainer.train`
repeats it, evaluates, reports and saves.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor, wait
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import asdict, replace
from typing import Any

import torch
from torch import Tensor

from usvauv.env.storage.memory import require
from usvauv.kernels.errors import DivergenceError
from usvauv.kernels.interruption import Stop, stoppable
from usvauv.policies.algorithms import Batch, Learner, algorithms
from usvauv.policies.checkpoint import TENSORBOARD
from usvauv.policies.cuda_graph import Recorded
from usvauv.policies.frames import frames
from usvauv.policies.learned import Standardizer
from usvauv.policies.names import PolicyError
from usvauv.policies.networks import stack, unstack
from usvauv.policies.policy import by_component
from usvauv.policies.training.meter import LOGS, scalar_writer, wandb_writer
from usvauv.policies.training.replay import Replay
from usvauv.policies.training.saving import save, save_best
from usvauv.policies.training.training_run import TrainingRun, learning_bytes

TINY = 1e-6
GAIN_RATE = 0.002  # step size of the running mean of the reward, for each step of all worlds
EVALUATED_EVERY, FEWEST, MOST = 200_000, 3, 10  # world-steps between evaluations, and numbers of them in a training
SAVED_EVERY = 300.0  # s, after which a checkpoint is written without an evaluation
WINDOW = 100  # steps of all worlds between two reports

Figures = list[dict[str, Any]]  # of each run, see `Trainer.train`
# What a step of a `TrainingWorld` returns.
Step = tuple[Tensor, Tensor, Tensor, Tensor, dict[str, Any]]


class SeedStack:
    """N runs of the same settings after the same number of steps, whose networks are one stack.

    Acting, the replay and the updates are done for all at once. Because the networks of a stack share nothing and each
    seed draws from its own generator, a run gives the same results as alone, except for rounding.

    Args:
        runs: begun or resumed. Their replays become parts of one; their learners and observations are up to date after
            `write_back`.

    Raises:
        PolicyError: the algorithm has a tensor without the networks' axis.
        MemoryNeeded: all of them do not fit into memory.
    """

    def __init__(self, runs: Sequence[TrainingRun]) -> None:
        first, self.runs = runs[0], runs
        self.config, self.frame, self.world_steps, self.count = first.config, first.frame, first.world.steps, len(runs)
        self.generators = [run.generator for run in runs]
        self.networks = first.learner.sizes.stack  # of a seed
        self.learner, self.replay, self.standardizer = first.learner, first.replay, first.standardizer
        if self.count > 1:
            self.learner, self.replay = self._joint_learner(), self._joint_replay()
            self.standardizer = self._joint_standardizer()
        self.observation = torch.cat([run.observation for run in runs])
        with frames.calling(self.config.frame):
            self._conversion = self.frame.conversion(len(self.observation))
        self._encode = Recorded(self._features, first.generator)
        self._choose = Recorded(self._explore, first.generator)

    def step(self, pool: Executor, total: int) -> None:
        """One step of all worlds, of `total` world-steps of each run, and the updates that go with it.

        The updates run in parallel with the worlds' step, on what was stored before it; the result does not depend on
        which of the two is faster.
        """
        config, learner, replay, runs = self.config, self.learner, self.replay, self.runs
        done = runs[0].steps
        # An on-policy algorithm holds each action for n steps, with its features and noise.
        deciding = not config.on_policy or done // config.num_worlds % self.world_steps % config.n_step == 0
        if config.on_policy:
            learning = deciding and replay.size >= config.rollout
        else:
            learning = done >= config.warmup and replay.size > config.n_step + 1

        encoded, *shared = self._encode(self.observation).values()
        features = encoded if deciding else replay.newest
        if learning and learner.updates == 0:
            features = self._standardize(features)
        if learning:
            learner.set_learning_rate(1.0 - (1.0 - config.final_rate) * done / total)
        if learning and config.on_policy:
            rollout = replay.take(features, config.n_step, config.gamma, self._gains(), config.batch, self.taught)
            self._update(rollout)

        # Act with exploration, and step the worlds.
        noise = torch.cat([run.noise.step() if deciding else run.noise.value for run in runs])
        chosen = self._choose(self.observation, features, noise, *shared)
        if self.taught:
            self._teach(chosen)
        stepping = pool.submit(self._step_worlds, chosen["command"])
        if replay.device.type == "cuda":  # which updates after the step, and must not see both at a recording
            wait((stepping,))

        # Sample and update.
        if learning and not config.on_policy:
            for _ in range(config.updates):
                self._update(replay.sample(config.batch, config.n_step, config.gamma, self.generators, self._gains()))

        # Store.
        try:
            steps = stepping.result()
        except ValueError:  # most likely an action that is not finite, because a weight is not
            self.write_back()
            for run in runs:
                run.check_finite()
            raise
        rewards, ends = [], []
        for run, (_, reward, horizon_ended, _, info) in zip(runs, steps, strict=True):
            ends.append(renewed(run, reward, horizon_ended, info))
            rewards.append(run.scale * reward)
            run.meter.add(info)
            run.steps += config.num_worlds
        replay.add(features, chosen["action"], torch.cat(rewards), torch.cat(ends))
        self.observation = torch.cat([observation for observation, *_ in steps])

        # Reset at the end of an episode, which the number of steps tells without a look at the device.
        if runs[0].steps // config.num_worlds % self.world_steps == 0:
            replay.finish(self._features(self.observation)["features"])
            self.observation = pool.submit(self._reset_worlds).result()

    @property
    def taught(self) -> bool:
        """Whether the actors still learn what their teachers do."""
        return self.runs[0].teacher is not None and self.learner.updates < self.config.imitation

    def _features(self, observation: Tensor) -> dict[str, Tensor]:
        """The standardised features (N W, K, F) of observations (N W, K, O), and what `Frame.shared` returns."""
        with frames.calling(self.config.frame):
            own = self._conversion
            features, *shared = (own.features(observation),) if own else self._described(observation)
        features = self.standardizer(features.unflatten(0, (self.count, -1))).flatten(0, 1).contiguous()
        return {"features": features} | {f"shared_{number}": each for number, each in enumerate(shared)}

    def _described(self, observation: Tensor) -> tuple[Tensor, ...]:
        """Features of observations and what `Frame.shared` returns, by torch."""
        observation = by_component(observation)
        shared = self.frame.shared(observation)
        return self.frame.encode(observation, *shared), *shared

    def _explore(self, observation: Tensor, features: Tensor, noise: Tensor, *more: Tensor) -> dict[str, Tensor]:
        """The networks' exploring actions for features (N W, K, F) and noise (N W, K, A), and the worlds' commands."""
        name, shared = self.config.algorithm, self.config.shared
        noise = stack(noise, shared, self.count)
        with algorithms.calling(name):
            chosen = self.learner.explore(stack(features, shared, self.count), noise)
        if chosen.shape != noise.shape:
            raise algorithms.refuse(name, f"actions of shape {tuple(chosen.shape)}", f"of {tuple(noise.shape)}")
        action = unstack(chosen, features.shape[1], self.count)
        with frames.calling(self.config.frame):
            if self._conversion:
                command = self._conversion.commands(action)
            else:
                command = self.frame.decode(by_component(observation), action, *more)
        return {"action": action, "command": command}

    def _teach(self, chosen: dict[str, Tensor]) -> None:
        """Put the teachers' actions in the place of those to learn from; worlds follow them and the networks in turns.

        So an actor sees both where its teacher comes and where it comes itself, as by Ross, Gordon and Bagnell, "A
        reduction of imitation learning and structured prediction to no-regret online learning", AISTATS 2011.
        """
        seen = self.observation.chunk(self.count)
        taught = torch.cat([run.teacher.act(own) for run, own in zip(self.runs, seen, strict=True) if run.teacher])
        chosen["action"] = self.frame.choice(self.observation, taught)
        chosen["command"][::2] = taught[::2]

    def _step_worlds(self, command: Tensor) -> list[Step]:
        """Step the worlds of each run."""
        steps = []
        for run, own in zip(self.runs, command.chunk(self.count), strict=True):
            with naming(run):
                steps.append(run.world.step(own))
        return steps

    def _reset_worlds(self) -> Tensor:
        """Begin the next episode of all worlds; returns observations."""
        return torch.cat([run.world.reset() for run in self.runs])

    def _update(self, batch: Batch) -> None:
        """Update the networks, and keep the figures of the update."""
        name = self.config.algorithm
        with algorithms.calling(name):
            losses = self.learner.learn(batch)
        if not all(isinstance(value, Tensor) and value.numel() == 1 for value in losses.values()):
            raise algorithms.refuse(name, losses, "one number for each name")
        for run in self.runs:
            run.meter.losses.append(losses)

    def _gains(self) -> Tensor:
        """The average rewards (N,) of the runs, scaled as the rewards in the replay."""
        return torch.stack([run.scale * run.gain for run in self.runs])

    def _standardize(self, features: Tensor) -> Tensor:
        """Take the statistics of features and rewards of each run from the replay, once before the first update;
        rescale the replay and `features` by them.
        """
        parts = []
        for run, own in zip(self.runs, features.chunk(self.count), strict=True):
            rewards = run.replay.reward[: self.replay.size]
            run.scale = self.config.reward_scale / max(float(rewards.abs().mean()), TINY)
            rewards.mul_(run.scale)
            stored = run.replay.observation[: self.replay.size]
            if self.frame.standardised:
                run.standardizer.copy_(Standardizer.of(stored))  # in place: earlier policies share the statistics
            stored.copy_(run.standardizer(stored))
            parts.append(run.standardizer(own))
        if self.count > 1:
            self.standardizer.copy_(self._joint_standardizer())
        return torch.cat(parts)

    def write_back(self) -> None:
        """Bring learner, replay and observation of every run up to date."""
        tensors, observations = self.learner.tensors(), self.observation.chunk(self.count)
        for index, run in enumerate(self.runs):
            run.observation = observations[index]
            run.replay.head, run.replay.size = self.replay.head, self.replay.size
            if self.count > 1:
                run.learner.restore(self._part(tensors, index))
                run.learner.updates = self.learner.updates

    def _joint_learner(self) -> Learner:
        """One learner of the networks of all runs, those of a seed after those of another."""
        first, config, device = self.runs[0].learner, self.config, self.replay.device
        sizes = replace(first.sizes, stack=self.count * self.networks)
        require(learning_bytes(config, sizes), f"training: seeds = {self.count}", device)
        with algorithms.calling(config.algorithm):
            learner = algorithms[config.algorithm](sizes, config, torch.Generator(device))
        learner.draw_from(*self.generators)
        own = first.state_dict()
        for name, value in learner.state_dict().items():
            shape = own[name].shape
            if shape and (shape[0] % self.networks or value.shape != (self.count * shape[0], *shape[1:])):
                raise PolicyError(
                    f"training: algorithm {config.algorithm!r} cannot train several seeds together: {name} has"
                    f" shape {tuple(shape)} for {self.networks} networks: its first axis must be theirs"
                )
        tensors = [run.learner.tensors() for run in self.runs]
        learner.restore(
            {
                name: value
                if value.dim() == 0  # a count of updates
                else torch.stack([each[name].unflatten(0, (-1, self.networks)) for each in tensors], 1).flatten(0, 2)
                for name, value in tensors[0].items()
            }
        )
        learner.updates = first.updates
        return learner

    def _part(self, tensors: Mapping[str, Tensor], index: int) -> dict[str, Tensor]:
        """The tensors of one run's learner, of those of the joint one."""
        shape = -1, self.count, self.networks
        return {
            name: value if value.dim() == 0 else value.unflatten(0, shape)[:, index].flatten(0, 1)
            for name, value in tensors.items()
        }

    def _joint_replay(self) -> Replay:
        """One replay of all runs, whose own become shares of it."""
        first = self.runs[0].replay
        worlds, auvs, features = first.observation.shape[1:]
        shape = self.count * worlds, auvs, features, first.action.shape[-1]
        replay = Replay(first.rows, shape, first.device, first.shared, self.count)
        replay.head, replay.size = first.head, first.size
        for index, run in enumerate(self.runs):
            share = replay.share(index)
            share.restore(run.replay.tensors(), first.head, first.size)
            run.replay = share
        return replay

    def _joint_standardizer(self) -> Standardizer:
        """The standardisers of all runs as one, (N, 1, 1, F)."""
        own = [run.standardizer for run in self.runs]
        mean, deviation = torch.stack([one.mean for one in own]), torch.stack([one.deviation for one in own])
        return Standardizer(mean[:, None, None], deviation[:, None, None])


class Trainer:
    """Trains runs that differ only in the seed, all in step: act with exploration, step the worlds, store, update.

    Worlds are truncated together and reset together. A truncated transition bootstraps from the last observation; one
    at which the value's horizon ends does not bootstrap. Each run keeps its own checkpoints. Runs with fewer steps than
    others, because a process was killed while it saved, are trained first until they have as many.

    With `config.renewal` the average reward ρ of a step is maximised. By the renewal-reward theorem a policy is optimal
    if no trip to the next service yields more than ρ times its number of steps (Ross, "Applied probability models with
    optimization applications", 1970, section 7). So a service ends the value's horizon, and ρ, estimated by the running
    mean of the reward, is subtracted from the reward of every step. The price of time is then the same everywhere, and
    rewards after the service, which are noise to the trip, do not enter its value. With a discount alone the price of
    time depends on the distance to the next reward.

    Args:
        runs: new or resumed, each with its own worlds and directory.
        evaluations: number of evaluations of each run, besides that of the untrained policy; None:
            `usual_evaluations`.
        log: one of `meter.LOGS`, where the curves go.
        threads: number of threads in which equal shares of the runs learn on a CPU, where several small stacks are
            faster than one whose operations are spread over its cores. On a GPU it is one.

    Attributes:
        stopped: whether the training was asked to stop, by Ctrl-C or a caller; it then ends after the present step.
        interruption: the signal that asked the last `train` to stop.

    Raises:
        PolicyError: the runs differ in more than the seed.
    """

    def __init__(
        self, *runs: TrainingRun, evaluations: int | None = None, log: str = LOGS[0], threads: int = 1
    ) -> None:
        first = runs[0]
        for run in runs[1:]:
            alike = replace(run.config, seed=first.config.seed) == first.config
            if not alike or run.world.scenario != first.world.scenario:
                raise PolicyError(
                    f"training: seeds {first.config.seed} and {run.config.seed}: settings or scenario differ; they must"
                    " be the same"
                )
        self.runs, self.evaluations, self.log = runs, evaluations, log
        self.threads = threads if first.world.device.type == "cpu" else 1
        self.stopped = False
        self.interruption = Stop()

    def stop(self) -> None:
        """End `train` after the present step."""
        self.stopped = True

    def train(self, steps: int, callback: Callable[[Figures], None] = lambda figures: None) -> None:
        """Train until each run has done `steps` world-steps in all, or until Ctrl-C (then `stopped` is true).

        Args:
            steps: of each run.
            callback: called with the figures of each run that is under way: steps, total, seconds, eta,
                steps_per_second, updates, those of `Meter.figures`, and evaluation with evaluated_at, the steps that
                were done then. Those of the updates are means over the runs that learn in one thread.

        Raises:
            DivergenceError: a weight or a state of the worlds is no longer finite. It names the seed and ends all runs;
                the checkpoints are those before.
        """
        for run in self.runs:
            if run.steps == 0:
                run.observation = run.world.reset().clone()
            if not run.history:
                evaluate(run)
        self.stopped = False
        with stoppable(self.stop) as self.interruption, ExitStack() as stack:
            writers = {run: stack.enter_context(self._writer(run)) for run in self.runs}
            while not self.stopped and (unfinished := [run for run in self.runs if run.steps < steps]):
                least = min(run.steps for run in unfinished)
                until = min([steps, *(run.steps for run in unfinished if run.steps > least)])
                for figures in self._train_in_step([run for run in unfinished if run.steps == least], until, steps):
                    for run, own in figures.items():
                        writers[run](own)
                    callback([*figures.values()])

    def _train_in_step(
        self, runs: Sequence[TrainingRun], until: int, total: int
    ) -> Iterator[dict[TrainingRun, dict[str, Any]]]:
        """Train runs that have done equally many steps until each has done `until` of its `total` world-steps; yields
        their figures after every `WINDOW` steps of all worlds, at an evaluation and at the end.
        """
        first, before = runs[0], [run.seconds for run in runs]
        count, worlds = min(self.threads, len(runs)), first.config.num_worlds
        stacks = [SeedStack(runs[index::count]) for index in range(count)]
        evaluations = self.evaluations or usual_evaluations(total)
        begun, over = time.perf_counter(), False
        saved = begun
        since, steps_then = begun, first.steps  # the rate is that from then on: of steps with updates, which are slower
        with ThreadPoolExecutor(1) as pool, ThreadPoolExecutor(count) as workers:
            while not over:
                list((workers.map if count > 1 else map)(lambda each: each.step(pool, total), stacks))
                over = self.stopped or first.steps >= until
                due = first.steps * evaluations // total > (first.steps - worlds) * evaluations // total
                if not (due or over or first.meter.rows == WINDOW):
                    continue
                for each in stacks:
                    each.write_back()
                figures = {}
                for run, seconds in zip(runs, before, strict=True):
                    if due:  # also when stopped, because a resumed run begins after this step
                        evaluate(run)
                    now = time.perf_counter()
                    run.seconds = seconds + now - begun
                    figures[run] = report(run, total, (first.steps - steps_then) / (now - since))
                if not first.learner.updates:
                    since, steps_then = time.perf_counter(), first.steps
                yield figures
                over |= self.stopped
                if due or over or time.perf_counter() - saved > SAVED_EVERY:
                    for run in runs:
                        if run.directory is not None:
                            save(run)
                    saved = time.perf_counter()

    def _writer(self, run: TrainingRun) -> AbstractContextManager[Callable[[dict[str, Any]], None]]:
        """A function that writes figures for TensorBoard or Weights & Biases; without a directory it does nothing."""
        if run.directory is None:
            return nullcontext(lambda figures: None)
        if self.log == "wandb":
            return wandb_writer(run.directory, asdict(run.config) | {"scenario": run.world.scenario.to_dict()})
        return scalar_writer(run.directory / TENSORBOARD, run.steps)


def usual_evaluations(steps: int) -> int:
    """Number of evaluations in a training of so many world-steps: each takes as long as some hundred updates."""
    return min(max(steps // EVALUATED_EVERY, FEWEST), MOST)


@contextmanager
def naming(run: TrainingRun) -> Iterator[None]:
    """A context in which the message of a divergence gets the seed of the run."""
    try:
        yield
    except DivergenceError as error:
        raise DivergenceError(f"seed {run.config.seed}: {error}") from error


def renewed(run: TrainingRun, reward: Tensor, horizon_ended: Tensor, info: dict[str, Tensor]) -> Tensor:
    """Ends (W, K) of the value's horizon, with renewal also at services; updates the average reward by `reward`."""
    if not run.config.renewal or run.world.scenario.reward.service_terminates:
        return horizon_ended
    run.gain += GAIN_RATE * (reward.mean().double() - run.gain)
    return horizon_ended | (info["measures"][..., run.world.measure_names.index("service_rate")] > 0)


def evaluate(run: TrainingRun) -> None:
    """Evaluate the policy of a run, and keep it as the best if it is, see `TrainingRun.kept`."""
    if run.evaluate is None:
        return
    run.check_finite()
    with naming(run):
        run.evaluation = {name: float(value) for name, value in run.evaluate(run.policy()).items()}
    run.history.append({"steps": run.steps, "updates": run.learner.updates, **run.evaluation})
    if run.kept is run.history[-1] and run.directory is not None:
        save_best(run)


def report(run: TrainingRun, total: int, rate: float) -> dict[str, Any]:
    """The figures of a run since the last report, see `Trainer.train`.

    Args:
        total: world-steps of the run.
        rate: world-steps a second.

    Raises:
        DivergenceError: a weight is not finite.
    """
    figures = {
        "steps": run.steps,
        "total": total,
        "seconds": run.seconds,
        "eta": (total - run.steps) / rate,
        "steps_per_second": rate,
        "updates": run.learner.updates,
        **run.meter.figures(),
        "evaluation": run.evaluation,
        "evaluated_at": run.history[-1]["steps"] if run.history else None,
    }
    run.meter.reset()
    run.check_finite()
    return figures
