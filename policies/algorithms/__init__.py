"""Learning algorithms, each one an update that reads like its paper.

From outside: `ALGORITHMS`, the classes by name; `Learner`, what a new one derives from, and the types it is given.
"""

from kernels.registry import Registry
from policies.algorithms.ddpg import DDPG
from policies.algorithms.learner import Batch, Learner, Settings
from policies.algorithms.sac import SAC
from policies.algorithms.td3 import TD3
from policies.networks import Sizes
from policies.policy import PolicyError

ALGORITHMS: Registry[type[Learner]] = Registry("algorithm", PolicyError, Learner)
ALGORITHMS.register("sac", SAC)
ALGORITHMS.register("td3", TD3)
ALGORITHMS.register("ddpg", DDPG)

__all__ = ["ALGORITHMS", "Batch", "Learner", "Settings", "Sizes"]
