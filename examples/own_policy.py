"""Your own policy beside the shipped ones, in the same worlds.

In this folder: `usvauv eval --policy own_policy:Nearing --policy straight`; or `python examples/own_policy.py`
"""

from torch import Tensor

from usvauv import World, evaluate, policies

SLOWING = 100.0  # m from the target


class Nearing:
    """Heads for the target, the slower the nearer it is."""

    def __init__(self, world: World) -> None:
        self.target = world.observation_layout.slice("target")
        self.unit = world.scenario.area.diagonal / SLOWING

    def act(self, observation: Tensor) -> Tensor:
        """Velocities through the water over the highest speed, (W, K, 2), for observations (W, K, O)."""
        offset = self.unit * observation[..., self.target]
        return offset / offset.norm(dim=-1, keepdim=True).clamp_min(1.0)


if __name__ == "__main__":
    compared = {"nearing": Nearing, **policies.named("straight", "pace")}
    print(evaluate("extreme", compared, episodes=10, seed=7).loc[["arps", "sdr", "ec"]].round(2).to_string())
