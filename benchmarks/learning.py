"""Steps and updates a second of training: the default algorithm in `extreme`, in more and more worlds.

    python -m benchmarks.learning --json
    python -m benchmarks.learning --arch cuda

Settings are those of `usvauv train` but for worlds and batch; its own are 256 and 256. A step of all worlds comes with
one update. Timing begins after the first updates: compilation, and on a card the recording of graphs, are left out.
"""

from __future__ import annotations

from time import perf_counter

from benchmarks.machine import command_line, describe, parse, show
from usvauv.env import Scenario, World
from usvauv.policies import Trainer, TrainingConfig, TrainingRun
from usvauv.policies.training.trainer import WINDOW

SIZES = ((128, 512), (256, 256), (1024, 4096), (8192, 16384))  # worlds, and transitions of each AUV in an update


def updates_per_second(worlds: int, batch: int, updates: int) -> float:
    """From the first report on of about as many updates after those of the first steps."""
    config = TrainingConfig(num_worlds=worlds, batch=batch)
    run = TrainingRun(World(Scenario.load("extreme"), worlds, config.seed), config)
    trainer = Trainer(run)
    trainer.train(config.before_learning + WINDOW * worlds)
    marks: list[tuple[float, int]] = []
    trainer.train(run.steps + updates * worlds, lambda figures: marks.append((perf_counter(), run.learner.updates)))
    (begin, before), (end, after) = marks[0], marks[-1]
    return (after - before) / (end - begin)


def main() -> None:
    parser = command_line(__doc__)
    parser.add_argument("--largest", type=int, default=SIZES[-1][0], help="worlds, at most")
    parser.add_argument("--updates", type=int, default=500, help="timed, but for those before the first report")
    arguments = parse(parser)
    sizes = []
    for worlds, batch in SIZES:
        if worlds <= arguments.largest:
            rate = updates_per_second(worlds, batch, arguments.updates)
            sizes.append(
                {"worlds": worlds, "batch": batch, "updates_per_second": rate, "world_steps_per_second": worlds * rate}
            )
    show({"machine": describe(), "sizes": sizes}, arguments.json)


if __name__ == "__main__":
    main()
