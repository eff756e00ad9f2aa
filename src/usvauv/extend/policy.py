"""How AUVs are steered: heuristics, algorithms that learn, and what a network reads and commands.

Registries, and the class of their items:

- `heuristics`, `Heuristic`: a policy without learning: `command`, `crab`, `unit`, `rotate`, `SpeedToFly` …
- `algorithms`, `Learner`: an update of actor and critics: `DeterministicLearner`, `Batch`, `Rollout`, `Sizes` …
- `frames`, `Frame`: features and actions of a network
"""

from usvauv.policies.algorithms import Batch, DeterministicLearner, Learner, Rollout, Settings, Sizes, algorithms
from usvauv.policies.frames import Frame, frames
from usvauv.policies.guidance import SpeedToFly, clear_of_others, command, crab, rotate, unit, unrotate
from usvauv.policies.heuristics import heuristics
from usvauv.policies.policy import Heuristic

__all__ = [
    "Batch",
    "DeterministicLearner",
    "Frame",
    "Heuristic",
    "Learner",
    "Rollout",
    "Settings",
    "Sizes",
    "SpeedToFly",
    "algorithms",
    "clear_of_others",
    "command",
    "crab",
    "frames",
    "heuristics",
    "rotate",
    "unit",
    "unrotate",
]
