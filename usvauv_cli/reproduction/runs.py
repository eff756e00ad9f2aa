"""What is trained and tested for a reproduction: its settings, and the runs made of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from usvauv import policies
from usvauv.cli.evaluation.run import digests
from usvauv.cli.reproduction.paper import CONDITIONS
from usvauv.cli.sweep.run import Evaluate, Piece
from usvauv.env import Scenario, World
from usvauv.env.planning.fix_errors import best_variance, median_of_normals
from usvauv.env.record.metrics import episode_metrics, position_error
from usvauv.env.record.recorder import record
from usvauv.env.storage.tables import write_rows
from usvauv.env.world.boat_strategies import StrategyChoice
from usvauv.policies import TrainingConfig, checkpoint

HEURISTICS = ("straight", "crab", "random")
STRATEGIES = ("fim", "hold:100,100", "hold:0,0", "centroid")
BOUND = "bound"
OVER_TIME = "over-time.csv"  # of a run of `fix_errors`, beside its rows


@dataclass(frozen=True)
class Method:
    """A row of Table 2 that is learned.

    Attributes:
        key: its name in files.
        title: its name in tables.
        config: of its training; the seed is replaced by each run's.
        usv: the boat's strategy, while learning and while tested.
        learning: changes of the scenario while learning.
        testing: changes of the scenario while tested, so that the observation is the one the policy was trained with.
    """

    key: str
    title: str
    config: TrainingConfig
    usv: str = "fim"
    learning: tuple[str, ...] = ()
    testing: tuple[str, ...] = ()


_config = partial(TrainingConfig, num_worlds=128, batch=512)  # with which the tables were made
METHODS = (
    Method("ddpg", "DDPG", _config(algorithm="ddpg")),
    Method("sac", "SAC", _config(algorithm="sac")),
    Method("td3", "TD3", _config(algorithm="td3")),
    # MAISAC of the paper's reference [4]: independent SAC with a learned temperature, and neither Eq. 3 to 5.
    Method(
        "baseline",
        "Baseline [4]",
        _config(algorithm="sac", frame="target", learning_rate=3e-4, final_rate=1.0, gamma=0.99, tau=0.01),
        usv="hold:100,100",
        learning=("observation.current=none", "reward.collaboration=0"),
        testing=("observation.current=none",),
    ),
    # Another point of the front of data and energy: near the EC of the paper's SAC.
    Method(
        "data",
        "SAC for data",
        _config(algorithm="sac", shared=True, updates=2),
        learning=(
            "reward.distance_form=progress",
            "reward.service_terminates=false",
            "reward.service_form=completion",
            "reward.service=30",
            "reward.power=-0.0043",
            "reward.proximity=-0.3",
        ),
    ),
)


@dataclass(frozen=True)
class Settings:
    """Size of a reproduction.

    Attributes:
        methods: the learned rows of Table 2.
        seeds: of the training runs; Fig. 4(b) takes them as seeds of its worlds.
        steps: world-steps of a training run.
        evaluations: of a training run, beside one of the untrained policy. judged: episodes in each.
        episodes: of each policy in each condition it is tested in. Run number i is tested in episodes i·episodes to
            (i+1)·episodes − 1 of `test_seed`, heuristics in all of them.
        test_seed: of the worlds tested in, and of Fig. 4(a)'s.
        fix_episodes: of Fig. 4(b), for each seed.
        wide_episodes: of each strategy of the boat in `wide`, of `test_seed`.
        overrides: changes of every scenario.
    """

    methods: tuple[Method, ...] = METHODS
    seeds: tuple[int, ...] = (0, 1, 2, 3, 4)
    steps: int = 300_000
    evaluations: int = 10
    judged: int = 32
    episodes: int = 40
    test_seed: int = 2026
    fix_episodes: int = 10
    wide_episodes: int = 100
    overrides: tuple[str, ...] = ()

    def method(self, key: str) -> Method:
        """The method of that key."""
        return next(method for method in self.methods if method.key == key)

    def scenario(self, name: str, changes: tuple[str, ...] = ()) -> Scenario:
        """A scenario with the changes of these settings."""
        return Scenario.load(name, [*self.overrides, *changes])


FULL = Settings()
QUICK = replace(
    FULL, seeds=(0, 1), steps=60_000, evaluations=4, judged=8, episodes=10, fix_episodes=4, wide_episodes=12
)


def learned(settings: Settings, method: str, trained_in: str, seed: int) -> Piece:
    """A training run, and the tests of its best policy in both conditions."""
    about = settings.method(method)
    config = asdict(replace(about.config, seed=seed))
    sizes = {"total": settings.steps, "evaluations": settings.evaluations, "judged": settings.judged}
    tests = _tests(settings, about.testing, settings.episodes, settings.seeds.index(seed))
    scenario = settings.scenario(trained_in, about.learning)
    return _piece(scenario, about.title, about.usv, tests, trained_in, _test, config | sizes, seed)


def heuristic(settings: Settings, policy: str) -> Piece:
    """The tests of a heuristic in both conditions."""
    scenario = settings.scenario(CONDITIONS["ISC"])
    tests = _tests(settings, (), settings.episodes * len(settings.seeds), 0)
    usv = StrategyChoice.parse(None, scenario).name
    return _piece(scenario, policy, usv, tests, "both conditions", _test)


def fix_errors(settings: Settings, name: str, usv: str) -> Piece:
    """Errors of positions by one strategy of the boat, AUVs steered by `straight`; by `fim` also the bound.

    The rows are median and 95th percentile of each episode over steps and AUVs, the table `OVER_TIME` median and
    quartiles over episodes and AUVs, in s and m. The bound has neither quartiles nor percentile.
    """
    evaluation = {"episodes": settings.fix_episodes * len(settings.seeds), "seeds": list(settings.seeds)}
    return _piece(settings.scenario(name), "straight", usv, evaluation, f"{name}, boat {usv}", _measure)


def best(piece: Piece, folder: Path) -> dict[str, Any]:
    """JSON of the best policy of a training run: score, updates, commit and more."""
    return checkpoint.read(checkpoint.path_of(piece.place(folder), checkpoint.BEST), checkpoint.POLICY)[0]


def _tests(settings: Settings, changes: tuple[str, ...], count: int, number: int) -> dict[str, Any]:
    """Block number `number` of `count` episodes, in both conditions."""
    scenarios = [settings.scenario(name, changes).to_dict() for name in CONDITIONS.values()]
    about = {"episodes": count * len(scenarios), "seed": settings.test_seed, "first": number * count}
    return about | {"scenarios": scenarios}


def _piece(
    scenario: Scenario,
    policy: str,
    usv: str,
    evaluation: dict[str, Any],
    task: str,
    evaluate: Evaluate,
    training: dict[str, Any] | None = None,
    seed: int = 0,
) -> Piece:
    definition = {"scenario": scenario.to_dict(), "policy": policy, "training": training, "usv": usv, "seed": seed}
    definition |= {"evaluation": evaluation, "files": [digest for _, digest in digests([], ())]}
    return Piece(definition=definition, method=policy, task=task, evaluate=evaluate)


def _test(definition: Mapping[str, Any], place: Path, step: Callable[[int], None]) -> list[dict[str, Any]]:
    """One row an episode: which run it tests, its metrics, and what Eq. 5's term adds to its arps."""
    wanted, about, policy = definition["evaluation"], {"run": "", "updates": ""}, definition["policy"]
    if definition["training"]:
        policy = checkpoint.path_of(place, checkpoint.BEST)
        updates = checkpoint.read(policy, checkpoint.POLICY)[0]["updates"]
        about = {"run": definition["seed"], "updates": updates}
    count, first, rows = wanted["episodes"] // len(wanted["scenarios"]), wanted["first"], []
    for of in wanted["scenarios"]:
        world = World(Scenario.from_dict(of), count, wanted["seed"], definition["usv"], first_world=first)
        act = policies.load(policy, world).act
        trace = record(world, act, definition["policy"], on_step=lambda _: step(count))
        term = trace.reward_terms[..., trace.reward_names.index("collaboration")]
        added = term.sum(axis=2, dtype=np.float64).mean(axis=0)
        for row, value in zip(episode_metrics(trace, first), added, strict=True):
            rows.append(about | row.columns() | {"collaboration": float(value)})
    return rows


def _measure(definition: Mapping[str, Any], place: Path, step: Callable[[int], None]) -> list[dict[str, Any]]:
    """See `fix_errors`."""
    seeds, usv = definition["evaluation"]["seeds"], definition["usv"]
    count, traces = definition["evaluation"]["episodes"] // len(seeds), []
    for seed in seeds:
        world = World(Scenario.from_dict(definition["scenario"]), count, seed, usv)
        act = policies.load(definition["policy"], world).act
        traces.append(record(world, act, definition["policy"], on_step=lambda _: step(count)))
    time, episodes = traces[0].time, [(trace.seed, world) for trace in traces for world in range(count)]

    error = np.concatenate([position_error(trace) for trace in traces], axis=1)
    at = [(usv, *row) for row in zip(time, *np.quantile(error, (0.5, 0.25, 0.75), axis=(1, 2)), strict=True)]
    of_episodes = zip(episodes, *np.quantile(error, (0.5, 0.95), axis=(0, 2)), strict=True)
    of = [(usv, *about, *row) for about, *row in of_episodes]
    if usv == "fim":
        variance = np.concatenate([best_variance(trace) for trace in traces], axis=1)
        median = median_of_normals
        at += [(BOUND, float(t), median(row.ravel()), "", "") for t, row in zip(time, variance, strict=True)]
        of += [(BOUND, *about, median(variance[:, w].ravel()), "") for w, about in enumerate(episodes)]
    columns = ("strategy", "time", "median", "lower_quartile", "upper_quartile")
    write_rows(place / OVER_TIME, columns, (dict(zip(columns, row, strict=True)) for row in at))
    return [dict(zip(("strategy", "seed", "episode", "median", "p95"), row, strict=True)) for row in of]
