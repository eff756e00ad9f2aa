"""
A mission and its trace
=======================

One mission in an extreme sea, recorded step by step, and where the AUVs, the boat and its fixes were.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np

from usvauv import Scenario, World, play, policies, record, write_video
from usvauv.env.record.metrics import position_error, usable

# %%
# A world is made of a scenario and a seed. The policy steers the AUVs, the boat goes where the scenario says.
scenario = Scenario.load("extreme", ["mission.duration=300"])
world = World(scenario, seed=7)
policy = policies.load(policies.default(scenario), world)
trace = record(world, policy.act, "clear", surface=True)

# %%
# A trace has plain arrays over time, worlds and AUVs; ``trace.save("mission.nc")`` writes them as NetCDF.
figure, axes = plt.subplots(figsize=(6.5, 6), layout="constrained")
axes.plot(*trace.node_position[0].T, "s", color="0.6", ms=4, label="nodes")
for k in range(scenario.auv.count):
    (line,) = axes.plot(*trace.auv_position[:, 0, k].T, label=f"AUV {k + 1}")
    axes.plot(*trace.fix[:, 0, k].T, ".", color=line.get_color(), ms=3, alpha=0.5)
axes.plot(*trace.boat_position[:, 0, 0].T, color="black", lw=1, label="boat")
axes.set(xlabel="x (east), m", ylabel="y (north), m", aspect="equal", xlim=(0, 200), ylim=(0, 200))
axes.legend(ncols=4, loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)
plt.show()

# %%
# How far off the boat's estimates are, and how often a fix comes.
error = position_error(trace)[:, 0]
figure, axes = plt.subplots(figsize=(7, 3), layout="constrained")
axes.plot(trace.time, error, lw=1)
axes.set(xlabel="time, s", ylabel="error of the boat's estimate, m", ylim=0)
plt.show()
print(f"rms {np.sqrt((error**2).mean()):.2f} m, a fix in {usable(trace).mean():.0%} of the steps")
print(f"data collected: {trace.delivered.sum():.1f} Mbit")

# %%
# The mission as a video, or one moment of it as a picture; the ending of the name says which.
with TemporaryDirectory() as folder:
    path = Path(folder) / "moment.png"
    write_video(trace, path, view="both", theme="light", at=240)
    picture = plt.imread(path)
figure = plt.figure(figsize=(8, 4.5))
figure.figimage(picture, resize=True)
plt.show()

# %%
# In a notebook a trace plays.
play(trace)
