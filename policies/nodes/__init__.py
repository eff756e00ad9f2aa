"""A target rule that learns which node is next: the network of `kernels.mission.target_rules.learned`, trained by PPO.

From outside: `NodeTrainer`, its `NodeConfig` and `Progress`, and `EVALUATION_EPISODES`, in how many it evaluates.
"""

from policies.nodes.trainer import EVALUATION_EPISODES, NodeConfig, NodeTrainer, Progress

__all__ = ["EVALUATION_EPISODES", "NodeConfig", "NodeTrainer", "Progress"]
