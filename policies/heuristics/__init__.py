"""Policies without learning.

Public: `heuristics`, the classes by name, each registered where it is defined and imported when it is first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from usvauv.kernels.registry import Registry
from usvauv.policies.names import PolicyError

if TYPE_CHECKING:
    from usvauv.policies.policy import Heuristic

SHIPPED = {
    "straight": "travel:Straight",
    "helm": "travel:Helm",
    "crab": "travel:Crab",
    "pace": "travel:Pace",
    "clear": "travel:Clear",
    "loiter": "passing:Loiter",
    "pass": "passing:Pass",
    "keep": "travel:Keep",
    "circle": "tracking:Circle",
    "tree": "tracking:Tree",
    "random": "random_actions:Random",
}
heuristics: Registry[type[Heuristic]] = Registry(
    "policy",
    PolicyError,
    "usvauv.policies.policy:Heuristic",
    shipped={name: f"usvauv.policies.heuristics.{place}" for name, place in SHIPPED.items()},
)
