"""Your own policy beside the shipped ones, in the same worlds.

In this folder: `usvauv eval --policy own_policy:Nearing --policy straight`; or `python examples/own_policy.py`
"""

from torch import Tensor

from usvauv import World, evaluate, policies
from usvauv.extend import mean_figures

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
    rows = evaluate("extreme", compared, episodes=10, seed=7)
    for name in compared:
        figures = mean_figures([row for row in rows if row.policy == name])
        print(f"{name}: ARPS {figures['arps']:.2f}, SDR {figures['sdr']:.2f} Mbit/s, EC {figures['ec']:.1f} W")
