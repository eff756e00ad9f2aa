"""Training runs that differ in the seed alone, advanced as one batched program."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from usvauv.env.storage.memory import require
from usvauv.kernels.errors import DivergenceError
from usvauv.kernels.interruption import Stop, stoppable
from usvauv.policies.algorithms import ALGORITHMS
from usvauv.policies.cuda_graph import Recorded
from usvauv.policies.frames import FRAMES
from usvauv.policies.learned import Standardizer
from usvauv.policies.policy import PolicyError, by_component
from usvauv.policies.training.exploration import explore
from usvauv.policies.training.replay import Replay
from usvauv.policies.training.saved_run import learning_bytes
from usvauv.policies.training.trainer import WINDOW, Trainer, learn

# What a step of a `TrainingWorld` returns.
Step = tuple[Tensor, Tensor, Tensor, Tensor, dict[str, Any]]


@contextmanager
def naming(run: Trainer) -> Iterator[None]:
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

    Each has its worlds and random generators, and the figures and checkpoints of a `Trainer` of its own; acting, the
    replay and the updates are those of all at once. Because the networks of a stack share nothing and each seed draws
    from its own generator, a run does what it would do alone, but for rounding.

    Args:
        runs: begun or resumed. Their replays become parts of one; learners and observation are up to date after
            `hand_out`.

    Raises:
        PolicyError: the algorithm has a tensor without the networks' axis.
        MemoryNeeded: all together do not fit into memory.
    """

    def __init__(self, runs: Sequence[Trainer]) -> None:
        first, self.runs = runs[0], runs
        config, device = first.config, first.world.device
        self.first, self.config, self.count = first, config, len(runs)
        self.own_stack = first.learner.sizes.stack
        sizes = replace(first.learner.sizes, stack=self.count * self.own_stack)
        what = f"training: seeds = {self.count}"
        require(learning_bytes(config, sizes), what, device)
        generators = [run.generator for run in runs]
        with ALGORITHMS.calling(config.algorithm):
            self.learner = ALGORITHMS[config.algorithm](sizes, config, torch.Generator(device))
        self.learner.draw_from(*generators)
        self._refuse_other_axes()
        self.learner.restore(joined([run.learner.tensors() for run in runs], self.own_stack))
        self.learner.updates = first.learner.updates
        self.replay = self._one_replay()
        self.standardizer = self._standardizers()
        self.observation = torch.cat([run.observation for run in runs])
        self._encode = Recorded.on(generators[0], self._features)
        self._choose = Recorded.on(generators[0], self._explore)

    def _refuse_other_axes(self) -> None:
        own = self.first.learner.state_dict()
        for name, value in self.learner.state_dict().items():
            shape = own[name].shape
            if shape and (shape[0] % self.own_stack or value.shape != (self.count * shape[0], *shape[1:])):
                raise PolicyError(
                    f"training: algorithm {self.config.algorithm!r} cannot train several seeds together: {name} has"
                    f" shape {tuple(shape)} for {self.own_stack} networks: its first axis must be theirs"
                )

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
        """As that of a `Trainer`: one step of all worlds, of `total` world-steps of each run, and the updates."""
        config, learner, first = self.config, self.learner, self.first
        deciding = first.deciding
        features = self._encode(self.observation)["features"] if deciding else self.replay.newest
        learning = first.learning
        if learning and learner.updates == 0:
            parts = zip(self.runs, features.chunk(self.count), strict=True)
            features = torch.cat([run.standardize(own) for run, own in parts])
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
        if first.world.device.type == "cuda":  # as in `Trainer`
            wait((step,))
        if learning and not config.on_policy:
            for _ in range(config.updates):
                self._count(self._learn())
        try:
            steps = step.result()
        except ValueError:  # as in `Trainer`
            self.hand_out()
            for run in self.runs:
                with naming(run):
                    run.stop_if_not_finite()
            raise
        observation = self._store(features, chosen["action"], steps)
        if first.steps // first.world.num_worlds % first.world.steps == 0:
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
            run.steps += run.world.num_worlds
        self.replay.add(features, action, torch.cat(rewards), torch.cat(ends))
        return torch.cat([observation for observation, *_ in steps])

    def _reset(self) -> Tensor:
        return torch.cat([run.world.reset() for run in self.runs])

    def _features(self, observation: Tensor) -> dict[str, Tensor]:
        with FRAMES.calling(self.config.frame):
            features = self.first.frame.encode(by_component(observation)).unflatten(0, (self.count, -1))
        return {"features": self.standardizer(features).flatten(0, 1).contiguous()}

    def _explore(self, observation: Tensor, features: Tensor, noise: Tensor) -> dict[str, Tensor]:
        action = explore(self.learner, self.config, features, noise, self.count)
        with FRAMES.calling(self.config.frame):
            return {"action": action, "command": self.first.frame.decode(by_component(observation), action)}

    def hand_out(self) -> None:
        """Bring learner and observation of every run up to date."""
        tensors = self.learner.tensors()
        observations = self.observation.chunk(self.count)
        for index, run in enumerate(self.runs):
            run.learner.restore(part(tensors, self.count, self.own_stack, index))
            run.learner.updates = self.learner.updates
            run.observation = observations[index]


Figures = list[dict[str, Any]]
Write = Callable[[dict[str, Any]], None]


class Seeds:
    """Trains runs that differ in the seed alone, all in step.

    Each run does what its `Trainer` would do alone, but for rounding, and keeps its own checkpoints. Runs that have
    done fewer steps than others, because a process was killed while it saved, come up with them first.

    Args:
        runs: new or resumed; each with worlds and a directory of its own.
        threads: number of threads in which equal shares of the runs learn on a CPU, where several small stacks do so
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
