"""Policies: heuristics, learned ones, and how they are learned.

>>> import policies
>>> policies.available()
>>> policy = policies.load("straight:1.4")
>>> action = policy.act(observation)
"""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path

from policies.checkpoint import load_policy, read_history, read_run
from policies.config import TrainingConfig
from policies.heuristics import Crab, Keep, Pace, Random, Straight, Zermelo
from policies.learned import LearnedPolicy
from policies.policy import Policy, PolicyError
from policies.trainer import Trainer
from usvauv_env.scenario import Scenario

__all__ = [
    "LearnedPolicy",
    "Policy",
    "PolicyError",
    "Trainer",
    "TrainingConfig",
    "available",
    "default",
    "load",
    "read_history",
    "read_run",
    "yardstick",
]

WITH_PARAMETER = {"straight": Straight, "crab": Crab, "pace": Pace, "zermelo": Zermelo}
WITHOUT_PARAMETER = {"keep": Keep, "random": Random}
HEURISTICS = (*WITH_PARAMETER, *WITHOUT_PARAMETER)


def _shipped() -> Path:
    return Path(str(resources.files("policies") / "trained"))


def trained() -> list[str]:
    """Names of the trained policies inside the package, the highest score first."""
    scores = {
        path.parent.name: json.loads(path.read_text(encoding="utf-8"))["score"]
        for path in _shipped().glob("*/policy.json")
    }
    return sorted(scores, key=lambda name: (-scores[name], name))


def available() -> list[str]:
    """Names that `load` knows: the trained ones, best first, then the heuristics."""
    return [*trained(), *HEURISTICS]


def default(scenario: Scenario) -> str:
    """The best shipped policy that fits a scenario; where none does `crab`, or `keep` where stations are to be held."""
    for name in trained():
        try:
            load(name, scenario).check(scenario)
        except PolicyError:
            continue
        return name
    return "crab" if scenario.task == "data-collection" else "keep"


def yardstick(scenario: Scenario) -> str:
    """The heuristic that a learned policy has to beat."""
    return "straight" if scenario.task == "data-collection" else "keep"


def load(name: str | Path, scenario: Scenario | None = None) -> Policy:
    """A policy by name, or from a checkpoint directory, for use in `scenario` (default: `extreme`).

    Args:
        name: one of `available()`; `straight:SPEED`, `crab:SPEED` or `zermelo:SPEED` with a speed in m/s;
            `pace:PRICE` with a price of time in W; the path of a checkpoint, or of a training run, whose best
            checkpoint is then taken.
        scenario: its speed limits and recorded speeds are used. A checkpoint that does not fit it is refused.

    Raises:
        PolicyError: unknown name, missing or damaged checkpoint, one of another size, speed out of range.
    """
    text = str(name)
    if text in trained():
        return load_policy(_shipped() / text, text, scenario)
    base, _, parameter = text.partition(":")
    if base in HEURISTICS:
        scenario = scenario or Scenario.load("extreme")
        if base in WITHOUT_PARAMETER:
            if parameter:
                raise PolicyError(f"policy {text}: {base} takes no parameter")
            return WITHOUT_PARAMETER[base](text, scenario)
        return WITH_PARAMETER[base](text, scenario, _number(text, parameter) if ":" in text else None)
    directory = Path(name)
    if not directory.is_dir():
        raise PolicyError(f"policy {text!r}: neither a checkpoint directory nor one of {', '.join(available())}")
    for place in (directory, directory / "best", directory / "last"):
        if (place / "policy.json").exists():
            return load_policy(place, text, scenario)
    raise PolicyError(f"{text}: not a checkpoint: policy.json is missing")


def _number(text: str, parameter: str) -> float:
    try:
        return float(parameter)
    except ValueError:
        base = text.split(":")[0]
        needed = "a price of time in W, as in pace:40" if base == "pace" else f"a speed in m/s, as in {base}:1.5"
        raise PolicyError(f"policy {text}: {parameter!r} is not {needed}") from None
