"""Training runs that differ only in the seed, advanced as one batched program; a single run is a batch of one."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from usvauv.env.storage.memory import require
from usvauv.kernels.errors import DivergenceError
from usvauv.policies.algorithms import Batch, Learner, algorithms
from usvauv.policies.cuda_graph import Recorded
from usvauv.policies.frames import frames
from usvauv.policies.learned import Standardizer
from usvauv.policies.policy import PolicyError, by_component
from usvauv.policies.training.exploration import explore
from usvauv.policies.training.replay import Replay
from usvauv.policies.training.saved_run import learning_bytes

WINDOW = 100  # steps of all worlds between two reports

Run = Any  # a `Trainer`, whose module imports this one
# What a step of a `TrainingWorld` returns.
Step = tuple[Tensor, Tensor, Tensor, Tensor, dict[str, Any]]


def learn(learner: Learner, name: str, batch: Batch) -> dict[str, Tensor]:
    """One update of a learner of the algorithm of that name; the figures to show, one number each."""
    with algorithms.calling(name):
        losses = learner.learn(batch)
    if not all(isinstance(value, Tensor) and value.numel() == 1 for value in losses.values()):
        raise algorithms.refuse(name, losses, "one number for each name")
    return losses


@contextmanager
def naming(run: Run) -> Iterator[None]:
    """Name the seed of a run that diverges."""
    try:
        yield
    except DivergenceError as error:
        raise DivergenceError(f"seed {run.config.seed}: {error}") from error


def joined(learners: Sequence[Mapping[str, Tensor]], stack: int) -> dict[str, Tensor]:
    """The tensors of learners of `stack` networks each as those of one stack, in which they follow one another."""
    return {
        name: value
        if value.dim() == 0  # a count of updates
        else torch.stack([own[name].unflatten(0, (-1, stack)) for own in learners], 1).flatten(0, 2)
        for name, value in learners[0].items()
    }


def part(tensors: Mapping[str, Tensor], seeds: int, stack: int, index: int) -> dict[str, Tensor]:
    """The inverse of `joined`: the tensors of one learner."""
    return {
        name: value if value.dim() == 0 else value.unflatten(0, (-1, seeds, stack))[:, index].flatten(0, 1)
        for name, value in tensors.items()
    }


class BatchedRuns:
    """N runs of the same settings after the same number of steps, whose networks are one stack.

    Each has its worlds and random generators, and the figures and checkpoints of its own `Trainer`; acting, the replay
    and the updates are done for all at once. Because the networks of a stack share nothing and each seed draws from its
    own generator, a run gives the same results as alone, except for rounding.

    Args:
        runs: begun or resumed. Their replays become parts of one; learners and observation are up to date after
            `hand_out`.

    Raises:
        PolicyError: the algorithm has a tensor without the networks' axis.
        MemoryNeeded: all together do not fit into memory.
    """

    def __init__(self, runs: Sequence[Run]) -> None:
        first, self.runs = runs[0], runs
        self.first, self.config, self.count = first, first.config, len(runs)
        self.own_stack = first.learner.sizes.stack
        self.learner, self.replay, self.standardizer = first.learner, first.replay, first.standardizer
        if self.count > 1:
            self.learner, self.replay = self._one_learner(), self._one_replay()
            self.standardizer = self._standardizers()
        self.observation = torch.cat([run.observation for run in runs])
        self._encode = Recorded(self._features, first.generator)
        self._choose = Recorded(self._explore, first.generator)

    def _one_learner(self) -> Learner:
        first, config, device = self.first.learner, self.config, self.first.world.device
        sizes = replace(first.sizes, stack=self.count * self.own_stack)
        require(learning_bytes(config, sizes), f"training: seeds = {self.count}", device)
        with algorithms.calling(config.algorithm):
            learner = algorithms[config.algorithm](sizes, config, torch.Generator(device))
        learner.draw_from(*(run.generator for run in self.runs))
        own = first.state_dict()
        for name, value in learner.state_dict().items():
            shape = own[name].shape
            if shape and (shape[0] % self.own_stack or value.shape != (self.count * shape[0], *shape[1:])):
                raise PolicyError(
                    f"training: algorithm {self.config.algorithm!r} cannot train several seeds together: {name} has"
                    f" shape {tuple(shape)} for {self.own_stack} networks: its first axis must be theirs"
                )
        learner.restore(joined([run.learner.tensors() for run in self.runs], self.own_stack))
        learner.updates = first.updates
        return learner

    def _one_replay(self) -> Replay:
        first = self.first.replay
        worlds, auvs, features = first.observation.shape[1:]
        shape = self.count * worlds, auvs, features, first.action.shape[-1]
        replay = Replay(first.rows, shape, first.device, first.shared, self.count)
        replay.head, replay.size = first.head, first.size
        for index, run in enumerate(self.runs):
            share = replay.share(index)
            share.restore(run.replay.tensors(), first.head, first.size)
            run.replay = share
        return replay

    def _standardizers(self) -> Standardizer:
        """Of all runs, (N, 1, 1, F)."""
        own = [run.standardizer for run in self.runs]
        mean, deviation = torch.stack([one.mean for one in own]), torch.stack([one.deviation for one in own])
        return Standardizer(mean[:, None, None], deviation[:, None, None])

    def advance(self, pool: Executor, total: int) -> None:
        """One step of all worlds, of `total` world-steps of each run, and the updates that go with it."""
        config, learner, first = self.config, self.learner, self.first
        deciding, learning = first.deciding, first.learning
        features = self._encode(self.observation)["features"] if deciding else self.replay.newest
        if learning and learner.updates == 0:
            parts = zip(self.runs, features.chunk(self.count), strict=True)
            features = torch.cat([run.standardize(own) for run, own in parts])
            if self.count > 1:
                self.standardizer.copy_(self._standardizers())
        if learning:
            learner.set_learning_rate(first.rate_share(total))
            if config.on_policy:
                gains = torch.stack([run.scaled_gain for run in self.runs])
                rollout = self.replay.take(features, config.n_step, config.gamma, gains, config.batch)
                self._count(learn(learner, config.algorithm, rollout))
        noise = torch.cat([run.noise.step() if deciding else run.noise.value for run in self.runs])
        chosen = self._choose(self.observation, features, noise)
        step = pool.submit(self._step, chosen["command"])
        if first.world.device.type == "cuda":  # which updates after the step, and must not see both at a recording
            wait((step,))
        if learning and not config.on_policy:
            for _ in range(config.updates):
                self._count(self._learn())
        try:
            steps = step.result()
        except ValueError:  # most likely an action that is not finite, because a weight is not
            self.hand_out()
            for run in self.runs:
                with naming(run):
                    run.stop_if_not_finite()
            raise
        observation = self._store(features, chosen["action"], steps)
        if first.steps // config.num_worlds % first.world.steps == 0:  # truncated, without a look at the device
            self.replay.finish(self._features(observation)["features"])
            observation = pool.submit(self._reset).result()
        self.observation = observation
        for run in self.runs:
            run.replay.head, run.replay.size = self.replay.head, self.replay.size

    def _count(self, losses: dict[str, Tensor]) -> None:
        for run in self.runs:
            run.meter.losses.append(losses)

    def _learn(self) -> dict[str, Tensor]:
        """One update of all networks, with the draws that each run would make alone."""
        config = self.config
        rows, worlds, gains = [], [], []
        for index, run in enumerate(self.runs):
            row, world = run.replay.draw(config.batch, config.n_step, run.generator)
            rows.append(row)
            worlds.append(world + index * run.replay.worlds)
            gains.append(run.scaled_gain.expand(len(row)))
        gain = torch.cat(gains).float().unsqueeze(-1)
        batch = self.replay.transitions(torch.cat(rows), torch.cat(worlds), config.n_step, config.gamma, gain)
        return learn(self.learner, config.algorithm, batch)

    def _step(self, command: Tensor) -> list[Step]:
        """One step of the worlds of each run."""
        steps = []
        for run, own in zip(self.runs, command.chunk(self.count), strict=True):
            with naming(run):
                steps.append(run.world.step(own))
        return steps

    def _store(self, features: Tensor, action: Tensor, steps: Sequence[Step]) -> Tensor:
        """Store and count a step of all worlds; returns the observations after it."""
        rewards, ends = [], []
        for run, (_, reward, horizon_ended, _, info) in zip(self.runs, steps, strict=True):
            ends.append(run.renew(reward, horizon_ended, info))
            rewards.append(run.scale * reward)
            run.meter.add(info)
            run.steps += self.config.num_worlds
        self.replay.add(features, action, torch.cat(rewards), torch.cat(ends))
        return torch.cat([observation for observation, *_ in steps])

    def _reset(self) -> Tensor:
        return torch.cat([run.world.reset() for run in self.runs])

    def _features(self, observation: Tensor) -> dict[str, Tensor]:
        with frames.calling(self.config.frame):
            features = self.first.frame.encode(by_component(observation)).unflatten(0, (self.count, -1))
        return {"features": self.standardizer(features).flatten(0, 1).contiguous()}

    def _explore(self, observation: Tensor, features: Tensor, noise: Tensor) -> dict[str, Tensor]:
        """The networks' exploring actions, and the worlds' commands for them."""
        action = explore(self.learner, self.config, features, noise, self.count)
        with frames.calling(self.config.frame):
            return {"action": action, "command": self.first.frame.decode(by_component(observation), action)}

    def hand_out(self) -> None:
        """Bring learner and observation of every run up to date."""
        tensors, observations = self.learner.tensors(), self.observation.chunk(self.count)
        for index, run in enumerate(self.runs):
            run.observation = observations[index]
            if self.count > 1:
                run.learner.restore(part(tensors, self.count, self.own_stack, index))
                run.learner.updates = self.learner.updates


def train_together(
    runs: Sequence[Run],
    until: int,
    total: int,
    asked_to_stop: Callable[[], bool],
    show: Callable[[list[dict[str, Any]]], None],
    threads: int = 1,
) -> None:
    """Train runs that have done equally many steps until each has done `until` of its `total` world-steps.

    Args:
        asked_to_stop: whether to end after the present step.
        show: called with the figures of each run, see `Trainer.train`.
        threads: in which equal shares of the runs learn.
    """
    first, before, steps_before = runs[0], [run.seconds for run in runs], runs[0].steps
    count = min(threads, len(runs))
    batches = [BatchedRuns(runs[index::count]) for index in range(count)]
    begun, over = time.perf_counter(), first.steps >= until
    with ThreadPoolExecutor(1) as pool, ThreadPoolExecutor(count) as workers:
        while not over:
            list((workers.map if count > 1 else map)(lambda batch: batch.advance(pool, total), batches))
            over, due = asked_to_stop() or first.steps >= until, first.evaluation_due(total)
            if not (due or over or first.meter.rows == WINDOW):
                continue
            for batch in batches:
                batch.hand_out()
            figures = []
            for run, seconds in zip(runs, before, strict=True):
                with naming(run):
                    if due:  # also when stopped, because a resumed run begins after this step
                        run.evaluate_now()
                    elapsed = time.perf_counter() - begun
                    run.seconds = seconds + elapsed
                    figures.append(run.report(total, (first.steps - steps_before) / elapsed))
            show(figures)
            over |= asked_to_stop()
            if due or over:
                for run in runs:
                    if run.directory is not None:
                        run.save()
