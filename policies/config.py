"""Settings of a training run."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

from usvauv.env.scenario import Scenario
from usvauv.env.world.observation_layout import ObservationLayout
from usvauv.kernels.errors import choices
from usvauv.policies.algorithms import algorithms
from usvauv.policies.frames import frames
from usvauv.policies.frames.offsets import PASSING_TERMS
from usvauv.policies.names import PolicyError

MOST_LAYERS, WIDEST = 16, 8192
MOST = 1_000_000_000
BOUNDS: dict[str, tuple[float, float]] = {  # both included; steps of Adam and rewards beyond leave single precision
    "num_worlds": (1, 1 << 22),
    "n_step": (1, 1000),
    "rollout": (1, 100_000),
    "batch": (1, 1 << 20),
    "updates": (1, 1000),
    "learning_rate": (1e-9, 1.0),
    "final_rate": (1e-6, 1.0),
    "tau": (1e-6, 1.0),
    "noise": (0.0, 10.0),
    "reward_scale": (1e-6, 1e3),
    "warmup": (0, MOST),
    "imitation": (0, 100_000),
}


@dataclass(frozen=True)
class TrainingConfig:
    """Settings of a training run, apart from its scenario.

    Attributes:
        algorithm: a name in `algorithms.algorithms`.
        num_worlds: W, worlds stepped together. Each step stores W transitions for each AUV.
        seed: of the training worlds, the initial weights, the exploration and the sampling.
        shared: one network for all AUVs, trained on the transitions of all; else one for each AUV.
        frame: a name in `frames.frames`.
        hidden: width of each hidden layer.
        renewal: maximise the average reward trip by trip, see `Trainer`; without effect in a scenario in which services
            end the value's horizon (`reward.service_terminates`).
        gamma: discount γ of one mission step.
        n_step: steps n of reward before the bootstrap. On-policy algorithms hold each action for them.
        rollout: steps of all worlds from which an on-policy algorithm learns at once.
        batch: transitions per learner in one update; for a shared one the same number from each AUV, rounded down.
        updates: gradient updates per step of all worlds; for an on-policy algorithm epochs on each rollout.
        learning_rate: initial learning rate of Adam for actor, critics and temperature.
        final_rate: learning rate at the end of the run over the initial one; it falls linearly with the steps.
        tau: τ of the soft update of target networks.
        noise: standard deviation of the exploration noise of TD3 and DDPG.
        correlation: correlation of the exploration noise from one step to the next, see `CorrelatedNoise`.
        replay: capacity in transitions per AUV, in whole steps of all worlds, rounded down.
        warmup: world-steps of the untrained policy, with its exploration, before the first update.
        imitation: first rollouts in which an on-policy algorithm learns what the frame's teacher does, if it has one.
        reward_scale: mean magnitude to which rewards are scaled, from those before the first update.
        layer_norm: normalise the critics' hidden layers.
    """

    algorithm: str = "sac"
    num_worlds: int = 256
    seed: int = 0
    shared: bool = False
    frame: str = "guided"
    hidden: tuple[int, ...] = (64, 64)
    renewal: bool = True
    gamma: float = 0.99
    n_step: int = 10
    rollout: int = 100
    batch: int = 256
    updates: int = 1
    learning_rate: float = 1e-3
    final_rate: float = 0.05
    tau: float = 0.01
    noise: float = 0.2
    correlation: float = 0.9
    replay: int = 500_000
    warmup: int = 20_000
    imitation: int = 40
    reward_scale: float = 0.12
    layer_norm: bool = True

    def __post_init__(self) -> None:
        for field in fields(self):
            value, kind = getattr(self, field.name), type(field.default)
            if type(value) is not kind and not (kind is float and type(value) is int):
                raise PolicyError(f"training: {field.name} = {value!r}: must be of type {kind.__name__}")
        for name, known in (("algorithm", algorithms), ("frame", frames)):
            if (value := getattr(self, name)) not in known:
                raise PolicyError(f"training: {name} = {value!r}: {choices(value, known)}")
        widths = self.hidden
        allowed = {
            "hidden": (
                1 <= len(widths) <= MOST_LAYERS and all(type(w) is int and 1 <= w <= WIDEST for w in widths),
                f"from 1 to {MOST_LAYERS} widths, each from 1 to {WIDEST}",
            ),
        }
        for name, (low, high) in BOUNDS.items():
            allowed[name] = (low <= getattr(self, name) <= high, f"from {low} to {high}")
        allowed["gamma"] = (0.0 <= self.gamma < 1.0, "at least 0 and below 1")
        allowed["correlation"] = (0.0 <= self.correlation < 1.0, "at least 0 and below 1")
        allowed["seed"] = (0 <= self.seed < 1 << 63, "from 0 to 2**63 - 1")
        least = self.num_worlds * (self.n_step + 3)
        allowed["replay"] = (least <= self.replay <= MOST, f"from num_worlds · (n_step + 3) = {least} to {MOST}")
        for name, (right, rule) in allowed.items():
            if not right:
                raise PolicyError(f"training: {name} = {getattr(self, name)!r}: must be {rule}")

    @classmethod
    def of(cls, scenario: Scenario, **settings: Any) -> TrainingConfig:
        """The algorithm's defaults in a scenario, overridden by those of `settings`, by name, that are not None.

        Where data are collected in passing and all terms that the frame `passing` needs are observed, the default is
        that frame without renewal, since a node's data come in many steps; with fins as actions it is `fins`, where
        targets are tracked `circling`. With each of these the default algorithm is `ppo`, in `docs/policies.md` the one
        that learns reliably there. Where targets are tracked by AUVs with rudders it learns with the frame `rudder`.
        """
        terms = ObservationLayout.of(scenario).terms
        passing = not set(PASSING_TERMS).difference(terms)
        frame = "passing" if passing else "circling" if "track" in terms else None
        frame = "fins" if scenario.auv.action == "fins" else frame
        algorithm = settings.get("algorithm") or ("ppo" if frame else cls.algorithm)
        learner = algorithms.get(algorithm)
        if learner and learner.chooses and "outlook" in terms:
            frame = "rudder"
        own = {"frame": frame, **frames[frame].defaults} if frame else {}
        given = {name: value for name, value in settings.items() if value is not None}
        return cls(**{**(learner.defaults if learner else {}), **own, **given, "algorithm": algorithm})

    @property
    def on_policy(self) -> bool:
        """Whether the algorithm learns from rollouts."""
        return algorithms[self.algorithm].on_policy

    @property
    def before_learning(self) -> int:
        """World-steps before the first update: the warm-up in whole steps, at least those for an update's n steps; for
        an on-policy algorithm a rollout.
        """
        if self.on_policy:
            return self.num_worlds * self.rollout
        return self.num_worlds * max(math.ceil(self.warmup / self.num_worlds), self.n_step + 2)

    def changed(self, assignments: Sequence[str]) -> TrainingConfig:
        """A copy with fields set by "name=value", as in "updates=4", "hidden=128,128" or "renewal=false".

        Raises:
            PolicyError: not of that form, no such field, or a value that is not allowed.
        """
        values = {}
        for assignment in assignments:
            name, _, text = assignment.partition("=")
            if name not in TUNABLE or not text:
                raise PolicyError(f"training: {assignment!r}: expected NAME=VALUE; {choices(name, TUNABLE)}")
            try:
                values[name] = _value(text, getattr(self, name))
            except ValueError:
                kind = WORDS[type(getattr(self, name))]
                raise PolicyError(f"training: {name} = {text!r}: must be {kind}") from None
        return replace(self, **values)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any], source: str) -> TrainingConfig:
        """The inverse of `dataclasses.asdict`, from JSON; `source` names the file in an error message."""
        try:
            return cls(**{**values, "hidden": tuple(values["hidden"])})
        except (KeyError, TypeError, PolicyError) as error:
            raise PolicyError(f"{source}: checkpoint is damaged, or needs a plugin: {error}") from None


# Settings that `changed` accepts; the others have separate options.
TUNABLE = tuple(
    field.name for field in fields(TrainingConfig) if field.name not in ("algorithm", "num_worlds", "seed", "shared")
)


WORDS = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    tuple: "whole numbers with a comma between two, as in 64,64",
}


def _value(text: str, now: object) -> object:
    """Read a value of the type of the present one.

    Raises:
        ValueError: the value has another type.
    """
    if isinstance(now, bool):
        if text not in ("true", "false"):
            raise ValueError(text)
        return text == "true"
    if isinstance(now, tuple):
        return tuple(int(part) for part in text.split(","))
    return int(text) if isinstance(now, int) else float(text) if isinstance(now, float) else text
