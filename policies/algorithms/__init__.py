"""Learning algorithms, each with one update written as in its paper.

Public: `algorithms`, the classes by name; `Learner` and `DeterministicLearner`, base classes of a new one, and the
types of its arguments.
"""

from usvauv.kernels.registry import Registry
from usvauv.policies.algorithms.deterministic import DDPG, TD3, DeterministicLearner
from usvauv.policies.algorithms.learner import Batch, Learner, Rollout, Settings
from usvauv.policies.algorithms.ppo import PPO
from usvauv.policies.algorithms.sac import SAC
from usvauv.policies.names import PolicyError
from usvauv.policies.networks import Sizes

algorithms: Registry[type[Learner]] = Registry("algorithm", PolicyError, Learner)
algorithms.register("sac", SAC)
algorithms.register("td3", TD3)
algorithms.register("ddpg", DDPG)
algorithms.register("ppo", PPO)

__all__ = ["Batch", "DeterministicLearner", "Learner", "Rollout", "Settings", "Sizes", "algorithms"]
