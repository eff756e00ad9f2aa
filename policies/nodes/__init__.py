"""A target rule that learns which node is next: the network of `kernels.mission.target_rules.learned`, trained by PPO.

From outside: `NodeTrainer`, its `NodeConfig` and `Progress`.
"""

from policies.nodes.trainer import NodeConfig, NodeTrainer, Progress

__all__ = ["NodeConfig", "NodeTrainer", "Progress"]
