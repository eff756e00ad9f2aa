"""All that a plugin needs, in one import: registries, classes of their items, and helpers for their functions.

    registry              item                 adds
    `tasks`               `Task`               what AUVs do: `RewardTerm`, `rewards`, `travel`, `distance_to_target`
    `task_metrics`        `Metric`             a task's figure of merit, a column of the metrics CSV
    `boat_strategies`     `BoatStrategy`       a boat's goal: `Strategy`, `serves`, `vec2`
    `target_rules`        `TargetRule`         which node an AUV heads for: `best_free`, `knowledge`
    `observation_terms`   `ObservationTerm`    numbers in an AUV's observation
    `ambient_noise_laws`  a function           ambient noise (frequency, shipping, wind) → dB re 1 µPa²/Hz
    `HEURISTICS`          `Heuristic`          a policy without learning: `command`, `crab`, `unit`, `SpeedToFly` …
    `ALGORITHMS`          `Learner`            an update of actor and critics: `Batch`, `Rollout`, `Sizes` …
    `FRAMES`              `Frame`              features and actions of a network
    `vehicles`            `Vehicle`            a model of an AUV: `Body`, `Surroundings`, `Command`, `Actuators` …

`registry.register(name, item)` adds an item; a name already in use is refused. Functions with `@ti.func` receive
`worlds` (`Worlds`), the arrays of all worlds; `AuvColumn`, `NodeColumn` and so on name their columns, `uniforms` and
`normals` draw random numbers. `docs/extending.md` has an example of each.
"""

from usvauv.env.record.metrics import Metric, mean_figures, position_error, task_metrics
from usvauv.env.scenario import Scenario
from usvauv.env.world.boat_strategies import BoatStrategy, boat_strategies
from usvauv.env.world.observation import ObservationLayout, ObservationTerm, observation_terms
from usvauv.env.world.world import World
from usvauv.kernels.errors import UserError
from usvauv.kernels.mission.boats.boat_motion import serves
from usvauv.kernels.mission.columns import (
    AuvColumn,
    BeliefColumn,
    BoatColumn,
    Draw,
    EstimateColumn,
    ExchangeColumn,
    ForesightColumn,
    NodeColumn,
    Parameter,
    TallyColumn,
)
from usvauv.kernels.mission.motion import distance_to_target, travel
from usvauv.kernels.mission.target_rules import TargetRule, best_free, knowledge, target_rules
from usvauv.kernels.mission.tasks import rewards
from usvauv.kernels.mission.tasks.task import RewardTerm, Task, tasks
from usvauv.kernels.mission.worlds import Strategy, Worlds, normals, uniforms
from usvauv.kernels.positioning.sonar import ambient_noise_laws
from usvauv.kernels.types import vec2
from usvauv.kernels.vehicles.kinematics import velocity_of_water
from usvauv.kernels.vehicles.vehicle import (
    LANES,
    Actuators,
    Body,
    Command,
    Memory,
    Quantity,
    Surroundings,
    Vehicle,
    lanes,
    positive,
    vehicles,
)
from usvauv.policies.algorithms import ALGORITHMS, Batch, DeterministicLearner, Learner, Rollout, Settings, Sizes
from usvauv.policies.frames import FRAMES, Frame
from usvauv.policies.guidance import SpeedToFly, clear_of_others, command, crab, rotate, unit, unrotate
from usvauv.policies.heuristics import HEURISTICS, Heuristic

__all__ = [
    "ALGORITHMS",
    "FRAMES",
    "HEURISTICS",
    "LANES",
    "Actuators",
    "AuvColumn",
    "Batch",
    "BeliefColumn",
    "BoatColumn",
    "BoatStrategy",
    "Body",
    "Command",
    "DeterministicLearner",
    "Draw",
    "EstimateColumn",
    "ExchangeColumn",
    "ForesightColumn",
    "Frame",
    "Heuristic",
    "Learner",
    "Memory",
    "Metric",
    "NodeColumn",
    "ObservationLayout",
    "ObservationTerm",
    "Parameter",
    "Quantity",
    "RewardTerm",
    "Rollout",
    "Scenario",
    "Settings",
    "Sizes",
    "SpeedToFly",
    "Strategy",
    "Surroundings",
    "TallyColumn",
    "TargetRule",
    "Task",
    "UserError",
    "Vehicle",
    "World",
    "Worlds",
    "ambient_noise_laws",
    "best_free",
    "boat_strategies",
    "clear_of_others",
    "command",
    "crab",
    "distance_to_target",
    "knowledge",
    "lanes",
    "mean_figures",
    "normals",
    "observation_terms",
    "position_error",
    "positive",
    "rewards",
    "rotate",
    "serves",
    "target_rules",
    "task_metrics",
    "tasks",
    "travel",
    "uniforms",
    "unit",
    "unrotate",
    "vec2",
    "vehicles",
    "velocity_of_water",
]
