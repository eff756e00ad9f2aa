"""What each process of `test_ranks` does; RANK and the like are in its environment, its folder is its argument."""

from __future__ import annotations

import os
import signal
import sys
from functools import cache
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from usvauv.env import Scenario, World
from usvauv.policies import PolicyError, Trainer, TrainingConfig
from usvauv.policies.algorithms import ALGORITHMS, Batch, Sizes
from usvauv.policies.training.ranks import ALONE, Ranks, joined

ALGORITHM_NAMES = "sac", "td3", "ddpg"
SIZES, BATCH, UPDATES = Sizes(2, 6, 2), 32, 100
LEARNING = TrainingConfig(hidden=(16, 16))
WORLDS, TOTAL, STOP = 5, 150, 100  # the ranks' shares differ
SCENARIO = ["mission.duration=12", "boat.strategy=centroid"]
RUN = TrainingConfig(num_worlds=WORLDS, hidden=(16, 16), batch=32, n_step=3, warmup=60, replay=WORLDS * 25, updates=2)


def learned(algorithm: str, ranks: Ranks = ALONE) -> tuple[list[Tensor], dict[str, Tensor]]:
    """Gradients of the first step, and everything after `UPDATES`, of the same batches and noise for any ranks."""
    own, source = ranks.share(BATCH - 3), torch.Generator().manual_seed(1)
    learner = ALGORITHMS[algorithm](SIZES, LEARNING, torch.Generator().manual_seed(0))
    seen: list[list[Tensor]] = []

    def join(gradients):
        gradients = ranks.mean(gradients, (own.stop - own.start) / (BATCH - 3))
        seen.append([value.clone() for value in gradients])
        return gradients

    def draw(*shape: int) -> Tensor:
        return torch.randn((SIZES.stack, BATCH - 3, *shape), generator=source)[:, own]

    learner.train_with_others(join)
    learner.normal = lambda shape: draw(*shape[2:])
    for _ in range(UPDATES):
        observation, action, reward = draw(6), draw(2).tanh(), draw()
        learner.learn(Batch(observation, action, reward, 0.9 * torch.ones_like(reward), draw(6)))
    return seen[0], learner.tensors()


@cache
def world(first: int, last: int, batch: int | None) -> World:
    return World(Scenario.load("paper-extreme", SCENARIO), last - first, 5, first_world=first, batch=batch)


def trainer(folder: Path, ranks: Ranks = ALONE) -> Trainer:
    """In the worlds of its rank, at their beginning; its evaluations depend on every weight of the actor."""
    mine = ranks.share(WORLDS)
    own = world(mine.start, mine.stop, WORLDS if ranks.count > 1 else None)
    own.rewind()
    probe = torch.rand((8, 2, own.observation_size), generator=torch.Generator().manual_seed(0))
    evaluate = (lambda policy: {"arps": float(policy.act(probe).sum())}) if ranks.leads else None
    return Trainer(own, RUN, folder, evaluate, ranks=ranks)


def work(folder: Path, ranks: Ranks) -> dict[str, Any]:
    found: dict[str, Any] = {name: learned(name, ranks) for name in ALGORITHM_NAMES}
    whole = trainer(folder / "whole", ranks)
    found["figures"] = whole.train(TOTAL)
    found["weights"] = whole.learner.tensors()
    found["generator"] = whole.generator.get_state()

    run = trainer(folder / "parts", ranks)
    renew = run.renew

    def renew_and_stop(*step):
        if run.steps + WORLDS == STOP and not ranks.leads:
            for _ in range(2):  # from the terminal and from torchrun
                signal.raise_signal(signal.SIGINT)
        return renew(*step)

    run.renew = renew_and_stop
    run.train(TOTAL)
    found["stopped"] = run.stopped, run.steps, run.interruption.signum
    run = trainer(folder / "parts", ranks)
    ranks.most(0)  # rank 0 has written
    run.resume()
    run.train(TOTAL)

    run = trainer(folder / "alone", ranks)
    run.resume()
    run.train(TOTAL)
    found["resumed"] = {name: value.clone() for name, value in run.learner.tensors().items()}

    with torch.no_grad():
        next(run.learner.actor.parameters()).view(-1)[0] += ranks.rank
    try:
        run.train(TOTAL + WORLDS)
    except PolicyError as error:
        found["refused"] = str(error)
    return found


def lose(folder: Path, ranks: Ranks) -> None:
    """Train until rank 1 is killed."""
    run = trainer(folder / "parts", ranks)
    run.resume()
    if not ranks.leads:
        run.replay.add = lambda *row: os.kill(os.getpid(), signal.SIGKILL)
    run.train(2 * TOTAL)


if __name__ == "__main__":
    place = Path(sys.argv[1])
    try:
        with joined("cpu") as all_ranks:
            torch.save(work(place, all_ranks), place / f"rank-{all_ranks.rank}.pt")
            lose(place, all_ranks)
    finally:  # of rank 0
        threads = [name.read_text() for name in Path("/proc/self/task").glob("*/comm")]
        (place / "threads.txt").write_text("".join(threads))
