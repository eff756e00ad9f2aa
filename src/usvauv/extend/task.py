"""What AUVs do: tasks, their figures of merit, and the rules by which an AUV chooses its next node.

Registries, and the class of their items:

- `tasks`, `Task`: a task: `Quantity`, a number of it; `RewardTerm`, `rewards`, `travel`, `distance_to_target`
- `task_metrics`, `Metric`: a task's figure of merit, a column of the metrics CSV: `position_error`, …
- `target_rules`, `TargetRule`: which node an AUV heads for: `best_free`, `knowledge`
"""

from usvauv.env.record.metrics import Metric, mean_figures, position_error, task_metrics
from usvauv.kernels.limits import Quantity
from usvauv.kernels.mission.auvs.motion import distance_to_target, travel
from usvauv.kernels.mission.target_rules import TargetRule, best_free, knowledge, target_rules
from usvauv.kernels.mission.tasks import rewards
from usvauv.kernels.mission.tasks.task import RewardTerm, Task, tasks

__all__ = [
    "Metric",
    "Quantity",
    "RewardTerm",
    "TargetRule",
    "Task",
    "best_free",
    "distance_to_target",
    "knowledge",
    "mean_figures",
    "position_error",
    "rewards",
    "target_rules",
    "task_metrics",
    "tasks",
    "travel",
]
