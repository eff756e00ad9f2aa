"""Settings of a reproduction: what is trained and tested.

The settings and their scenarios are recorded in the folder of the results. Later calls must agree with the record, so
that the runs of a table are comparable.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from usvauv.cli.reproduction.paper import CONDITIONS
from usvauv.env.scenario import Scenario
from usvauv.env.storage.files import atomic_write
from usvauv.kernels.errors import UserError
from usvauv.policies import TrainingConfig

PHYSICAL = "extreme"  # our own scenario, set beside the paper's in Fig. 4
WIDE = "wide"  # and that in which the boat's strategy decides
HEURISTICS = ("straight", "crab", "random")
STRATEGIES = ("fim", "hold:100,100", "hold:0,0", "centroid")
RECORD = "settings.json"


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


METHODS = (
    Method("ddpg", "DDPG", TrainingConfig(algorithm="ddpg")),
    Method("sac", "SAC", TrainingConfig(algorithm="sac")),
    Method("td3", "TD3", TrainingConfig(algorithm="td3")),
    # MAISAC of the paper's reference [4]: independent SAC with a learned temperature, and neither Eq. 3 to 5.
    Method(
        "baseline",
        "Baseline [4]",
        TrainingConfig(algorithm="sac", frame="target", learning_rate=3e-4, final_rate=1.0, gamma=0.99, tau=0.01),
        usv="hold:100,100",
        learning=("observation.current=none", "reward.collaboration=0"),
        testing=("observation.current=none",),
    ),
    # Another point of the front of data and energy: near the EC of the paper's SAC.
    Method(
        "data",
        "SAC for data",
        TrainingConfig(algorithm="sac", shared=True, updates=2),
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


def record(settings: Settings, folder: Path) -> None:
    """Write the settings and their scenarios into a folder; where they are written already, compare.

    Raises:
        UserError: the folder was begun with other ones, or its record cannot be read.
    """
    path = folder / RECORD
    scenarios = {name: settings.scenario(name).to_dict() for name in (*CONDITIONS.values(), PHYSICAL, WIDE)}
    now = json.loads(json.dumps({**asdict(settings), "scenarios": scenarios}))
    if not path.exists():
        with atomic_write(path) as partial:
            partial.write_text(json.dumps(now, indent=2) + "\n", encoding="utf-8")
        return
    try:
        before = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: cannot be read: {error}") from None
    difference = _difference(before, now)
    if difference:
        field, old, new = difference
        raise UserError(
            f"--out {folder}: was begun with {field} = {json.dumps(old)}, now it would be {json.dumps(new)}; "
            "choose another folder, or what it was begun with"
        )


def _difference(old: Any, new: Any, field: str = "") -> tuple[str, Any, Any] | None:
    """The first place in which two JSON values differ: its dotted name and both values."""
    if isinstance(old, dict) and isinstance(new, dict):
        names = dict.fromkeys((*new, *old))
        pairs = ((f"{field}.{name}".lstrip("."), old.get(name), new.get(name)) for name in names)
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        pairs = ((f"{field}[{i}]", *both) for i, both in enumerate(zip(old, new, strict=True)))
    else:
        return None if old == new else (field, old, new)
    return next((found for name, a, b in pairs if (found := _difference(a, b, name))), None)
