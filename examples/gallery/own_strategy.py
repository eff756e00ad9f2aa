"""
A boat strategy of your own
============================

A plugin in a few lines: the boat circles round the AUVs instead of staying above them.
"""

import matplotlib.pyplot as plt
import numpy as np
import taichi as ti

from usvauv import Scenario, World, policies, record
from usvauv.extend.boat import BoatStrategy, Strategy, boat_strategies
from usvauv.extend.task import position_error
from usvauv.extend.world import vec2

# %%
# The function runs inside the mission's kernel, for all worlds at once. It gets the state of the worlds and returns
# where boat b should be next. The number after the name, as in ``circle:40``, is in ``worlds.strategy_arguments``.


@ti.func
def circle(worlds: ti.template(), w, b) -> vec2:
    middle = vec2(0.0, 0.0)
    for k in range(worlds.estimate.shape[1]):
        middle += vec2(worlds.estimate.x[w, k], worlds.estimate.y[w, k])
    middle /= worlds.estimate.shape[1]
    out = vec2(worlds.boat[w, b, 0], worlds.boat[w, b, 1]) - middle
    ahead = ti.atan2(out[1], out[0]) + 0.5  # rad further round
    return middle + worlds.strategy_arguments[0] * vec2(ti.cos(ahead), ti.sin(ahead))


boat_strategies.register("circle", BoatStrategy(Strategy(start=circle, goal=circle), ("RADIUS",)))

# %%
# In a file of its own it is used by ``usvauv eval --plugin circle.py --usv circle:40``.
scenario = Scenario.load("extreme", ["mission.duration=200"])
figure, (track, errors) = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
for usv in ("fim", "circle:40"):
    world = World(scenario, seed=4, usv=usv)
    trace = record(world, policies.load("clear", world).act, "clear")
    track.plot(*trace.boat_position[:, 0, 0].T, lw=1, label=usv)
    error = position_error(trace)
    errors.ecdf(error.ravel(), label=f"{usv}, median {np.median(error):.2f} m")
track.set(xlabel="x (east), m", ylabel="y (north), m", aspect="equal", title="Track of the boat")
errors.set(xlabel="error of the boat's estimates, m", ylabel="share below", xlim=(0, 3))
for axes in (track, errors):
    axes.legend(frameon=False)
plt.show()
