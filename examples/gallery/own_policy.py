"""
Your own policy
=====================

Anything that turns observations into actions can steer: here one that heads for its target at a chosen speed.
"""

import matplotlib.pyplot as plt
from torch import Tensor

from usvauv import Scenario, World, evaluate, policies

# %%
# A policy is made for a world and gets observations (W, K, O), for W worlds of K AUVs. Actions are velocities through
# the water as a share of the highest speed, (W, K, 2). The layout of the observation says where the target is in it.


def steady(speed: float):
    """A class of policies that head straight for the target at a speed through the water, m/s."""

    class Steady:
        def __init__(self, world: World) -> None:
            self.target = world.observation_layout.slice("target")
            self.share = speed / world.scenario.auv.speed_max

        def act(self, observation: Tensor) -> Tensor:
            offset = observation[..., self.target]
            return self.share * offset / offset.norm(dim=-1, keepdim=True).clamp_min(1e-6)

    return Steady


# %%
# Beside it the autopilot that ships, which compensates the current and keeps AUVs apart, in the same worlds.
scenario = Scenario.load("extreme", ["mission.duration=400"])
speeds = (1.2, 1.5, 1.8, 2.1)
compared = {f"{speed} m/s": steady(speed) for speed in speeds} | policies.named("clear")
table = evaluate(scenario, compared, episodes=16, seed=3)
means = table["mean"].unstack("figure").droplevel(["usv", "targets"])

figure, axes = plt.subplots(figsize=(6.5, 4), layout="constrained")
for name in compared:
    axes.plot(means.loc[name, "ec"], means.loc[name, "delivered_mbit"], "o", ms=8, label=name)
axes.set(xlabel="power, W", ylabel="data collected, Mbit")
axes.legend(frameon=False)
plt.show()
table.loc[["delivered_mbit", "ec", "collisions"]].round(2)
