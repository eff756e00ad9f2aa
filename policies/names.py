"""Names of policies, known without torch: the trained ones in the package, and a scenario's default."""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from safetensors import safe_open

from usvauv.kernels.errors import UserError
from usvauv.kernels.mission.tasks.task import outline

if TYPE_CHECKING:
    from usvauv.env.scenario import Scenario

ENDING = ".safetensors"
METADATA = "usvauv"  # name of a checkpoint's JSON; with several entries a file's bytes would depend on chance
POLICY = "policy"  # name of its part about the policy


class PolicyError(UserError, ValueError):
    """A policy cannot be used; the message is one line with its name and what is allowed."""


def shipped() -> dict[str, Path]:
    """Name → file of the trained policies inside the package."""
    return {path.stem: path for path in Path(str(resources.files("usvauv.policies") / "trained")).glob(f"*{ENDING}")}


def _made(path: Path) -> dict[str, Any]:
    """JSON of a trained policy in the package."""
    with safe_open(path, "np") as file:
        return json.loads(file.metadata()[METADATA])[POLICY]


def trained() -> list[str]:
    """Names of the trained policies inside the package, the highest score first."""
    scores = {name: _made(path)["score"] for name, path in shipped().items()}
    return sorted(scores, key=lambda name: (-scores[name], name))


def about(name: str) -> str:
    """Description of a trained policy in the package, one sentence, from its checkpoint."""
    made = _made(shipped()[name])
    where, boat = made["scenario"]["name"], made["usv"]
    return f"{made['algorithm'].upper()}, trained in {where} with {made['num_auvs']} AUVs and the boat {boat}"


def default_heuristic(scenario: Scenario) -> str:
    """The default among the policies that are not learned."""
    if scenario.auv.action == "fins":
        return "helm"
    return "pass" if scenario.collects_in_passing else outline(scenario.task).heuristic
