"""
Where should the boat be?
=========================

The map of the Fisher information of all fixes, its best place, and the errors to expect from there and elsewhere.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Ellipse

from usvauv.env import Scenario
from usvauv.env.accuracy.boat_place import solve

# %%
# Three AUVs, at x, y and depth in metres. This is what ``usvauv plan`` computes.
auvs = [(60.0, 80.0, 100.0), (150.0, 120.0, 90.0), (90.0, 160.0, 60.0)]
scenario = Scenario.load("extreme", ["auv.count=3"])
plan, landscape = solve(scenario, auvs, [(0.0, 0.0)], objective="d", measurement="fix")
for name, place in {"optimum": plan.optimum, "centroid": plan.centroid, "corner": plan.compare[0]}.items():
    print(f"{name} ({place.x:.1f}, {place.y:.1f}) m: rms error of a fix {place.rms:.2f} m")

# %%
# The determinant of the information on all positions has the unit m\ :sup:`-2` once for each axis of each ellipse: the
# geometric mean of the errors, beside that from the best place, follows from its logarithm.
ratio = np.exp((plan.optimum.log_objective - landscape.log_objective) / (4 * len(auvs)))
figure, axes = plt.subplots(figsize=(6.5, 5.2), layout="constrained")
filled = axes.contourf(landscape.x, landscape.y, ratio, levels=20, cmap="viridis_r")
figure.colorbar(filled, label="error as a multiple of the best")
for (x, y, _), best, corner in zip(auvs, plan.optimum.errors, plan.compare[0].errors, strict=True):
    axes.plot(x, y, "o", color="white", mec="black")
    for error, colour in ((best, "white"), (corner, "tab:red")):
        size = 2 * 20 * error.major, 2 * 20 * error.minor
        axes.add_patch(Ellipse((x, y), *size, angle=np.degrees(error.angle), fill=False, ec=colour, lw=1.5))
axes.plot(plan.optimum.x, plan.optimum.y, "*", color="white", mec="black", ms=18)
axes.plot(0, 0, "s", color="tab:red", ms=12, clip_on=False)
axes.set(xlabel="x (east), m", ylabel="y (north), m", aspect="equal", title="1-σ ellipses × 20, white from the star")
plt.show()
