"""Learning algorithms, each one an update that reads like its paper."""

from policies.algorithms.ddpg import DDPG
from policies.algorithms.learner import Learner, Sizes
from policies.algorithms.sac import SAC
from policies.algorithms.td3 import TD3

ALGORITHMS: dict[str, type[Learner]] = {"sac": SAC, "td3": TD3, "ddpg": DDPG}

__all__ = ["ALGORITHMS", "DDPG", "SAC", "TD3", "Learner", "Sizes"]
