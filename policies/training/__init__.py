"""Training: the trainer, what it needs of a world, its replay memory, exploration noise and figures.

From outside: `Trainer`, `Seeds` and `TrainingWorld`; `Replay`, `CorrelatedNoise` and `Meter` from their modules.
"""

from usvauv.policies.training.seeds import Seeds
from usvauv.policies.training.trainer import Trainer
from usvauv.policies.training.world import TrainingWorld

__all__ = ["Seeds", "Trainer", "TrainingWorld"]
