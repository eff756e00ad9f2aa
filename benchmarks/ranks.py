"""What training over several processes exchanges: bytes and seconds, beside those of an update.

    python -m benchmarks.ranks
    python -m benchmarks.ranks --ranks 1 2 4 --learn hidden=256,256

Processes of this machine talk by gloo. "update" is one gradient update of the batch's share of a rank, without what it
exchanges; "gradients" is the exchange of an update's gradients, each step of an optimiser by itself; "word" is the
smallest exchange, of which a step of all worlds makes two. Medians over `ROUNDS`.
"""

from __future__ import annotations

import os
import socket
import statistics
import time
from collections.abc import Callable
from typing import Any

import torch
from torch import multiprocessing

from benchmarks.machine import command_line, describe
from usvauv.env import Scenario
from usvauv.policies import TrainingConfig
from usvauv.policies.algorithms import ALGORITHMS, Batch, Sizes
from usvauv.policies.frames import FRAMES
from usvauv.policies.training.ranks import VARIABLES, Ranks, joined

ROUNDS, WARM_UP = 200, 20


def median(work: Callable[[], object], ranks: Ranks) -> float:
    """Seconds of a call, all ranks beginning together."""
    seconds = []
    for _ in range(WARM_UP + ROUNDS):
        ranks.most(0)
        begun = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - begun)
    return statistics.median(seconds[WARM_UP:])


def measure(rank: int, count: int, port: int, config: TrainingConfig, results: Any) -> None:
    """What rank 0 puts into `results`."""
    values = dict(zip(VARIABLES, (rank, count, rank, count), strict=True))
    values |= {"MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port}
    os.environ.update({name: str(value) for name, value in values.items()})
    torch.set_num_threads(1)
    scenario = Scenario.load("extreme")
    with joined("cpu") as ranks:
        frame = FRAMES[config.frame](scenario)
        sizes = Sizes(1 if config.shared else scenario.auv.count, frame.features, frame.actions)
        generator = torch.Generator().manual_seed(0)
        learner = ALGORITHMS[config.algorithm](sizes, config, generator)

        def draw(*shape: int) -> torch.Tensor:
            return torch.rand((sizes.stack, config.batch // count, *shape), generator=generator)

        observation, action, reward = draw(sizes.observation), draw(sizes.action), draw()
        batch = Batch(observation, action, reward, reward, observation)
        update = median(lambda: learner.learn(batch), ranks)
        groups = [optimiser.parameters for optimiser in learner.optimisers.values()]
        gradients = [[torch.zeros_like(parameter) for parameter in group] for group in groups]
        exchange = median(lambda: [ranks.mean(group, 1.0 / count) for group in gradients], ranks)
        word = median(lambda: ranks.most(0), ranks)
        if ranks.leads:
            numbers = sum(value.numel() for group in gradients for value in group)
            results.put((4 * numbers, len(groups), update, exchange, word))


def main() -> None:
    parser = command_line(__doc__)
    parser.add_argument("--ranks", type=int, nargs="+", default=[1, 2], help="numbers of processes")
    parser.add_argument("--shared", action="store_true", help="one network for all AUVs")
    parser.add_argument("--learn", action="append", default=[], metavar="NAME=VALUE", help="settings of the learning")
    arguments = parser.parse_args()
    config = TrainingConfig(shared=arguments.shared).changed(arguments.learn)
    print(describe())
    print("ranks  gradients, bytes  exchanges  update, ms  gradients, ms  word, ms")
    for count in arguments.ranks:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        results = multiprocessing.get_context("spawn").SimpleQueue()
        multiprocessing.spawn(measure, (count, port, config, results), count)
        size, exchanges, *seconds = results.get()
        print(f"{count:5d}  {size:16,d}  {exchanges:9d}", *(f"{1e3 * value:12.3f}" for value in seconds))


if __name__ == "__main__":
    main()
