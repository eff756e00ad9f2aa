"""Training: the trainer, its replay memory, exploration and figures; many seeds at once.

Public: the names below; `Replay`, `CorrelatedNoise` and `Meter` from their modules.
"""

from usvauv.policies.training.exploration import TrainingWorld
from usvauv.policies.training.figures import evaluated, figures_of_merit
from usvauv.policies.training.seeds import Seeds
from usvauv.policies.training.trainer import Trainer

__all__ = ["Seeds", "Trainer", "TrainingWorld", "evaluated", "figures_of_merit"]
