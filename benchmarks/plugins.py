"""What a step costs with a part of a plugin, over the same step with the same part as one of the package.

    python -m benchmarks.plugins

The parts are those of `examples/plugins`: an observation term, a boat strategy, a target rule and a task, in `extreme`.
Both worlds compute the same. Rates are taken in turns.
"""

from __future__ import annotations

from pathlib import Path

from benchmarks.machine import best_time, command_line, describe, parse, show
from benchmarks.worlds import CYCLE, LEAD, stepper
from usvauv.env import Scenario, World, plugins
from usvauv.kernels.mission.boats.boat_strategies import boat_strategies
from usvauv.kernels.mission.observation import observation_terms
from usvauv.kernels.mission.target_rules import target_rules
from usvauv.kernels.mission.tasks.task import tasks

FOLDER = Path(__file__).parents[1] / "examples" / "plugins"
TURNS = 3
PARTS = {  # file → registry, changes of the scenario, boat strategy
    "observation_term": (observation_terms, ["observation.extra=['backlog']"], "fim"),
    "boat_strategy": (boat_strategies, [], "above:1"),
    "target_rule": (target_rules, ["nodes.target_rule=oldest"], "fim"),
    "task": (tasks, ["task=survey"], "fim"),
}


def ratio(part: str, num_worlds: int, seconds: float) -> float:
    """Rate with the plugin over that of the same part of the package."""
    registry, changes, usv = PARTS[part]
    scenario = Scenario.load("extreme", changes)
    steps = [stepper(World(scenario, num_worlds, usv=usv), None)]
    files = dict(registry._files)
    registry._files.clear()  # all parts are the package's
    steps.append(stepper(World(scenario, num_worlds, usv=usv), None))
    registry._files.update(files)
    for step in steps:
        for _ in range(LEAD):
            step()
    turns = [[best_time(step, seconds / TURNS, least=CYCLE) for step in steps] for _ in range(TURNS)]
    plugin, own = map(min, zip(*turns, strict=True))
    return own / plugin


def main() -> None:
    parser = command_line(__doc__)
    parser.add_argument("--worlds", type=int, nargs="+", default=[1, 64, 4096])
    parser.add_argument("--seconds", type=float, default=1.0, help="time spent on each rate, s")
    arguments = parse(parser)
    for part in PARTS:
        plugins.load(FOLDER / f"{part}.py")
    rows = [
        {"part": part} | {f"{size} worlds": ratio(part, size, arguments.seconds) for size in arguments.worlds}
        for part in PARTS
    ]
    show({"machine": describe(), "rate over that of a part of the package": rows}, arguments.json)


if __name__ == "__main__":
    main()
