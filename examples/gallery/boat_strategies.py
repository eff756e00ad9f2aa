"""
Boat strategies in the same worlds
==================================

Eight AUVs are out of acoustic range of one another: the data they collect depends on which of them the boat visits.
"""

import matplotlib.pyplot as plt
import numpy as np

from usvauv import Scenario, policies
from usvauv.cli.evaluation.comparison import interval
from usvauv.env import run_episodes
from usvauv.env.record.metrics import values_of

# %%
# Episode number e of every strategy takes place in the same world: same sea, nodes, currents and packets. So
# differences between strategies are taken episode by episode, which is far sharper than comparing two means.
scenario = Scenario.load("wide", ["mission.duration=600"])
strategies = ("centroid", "visit")
rows = {usv: run_episodes(scenario, policies.named("clear"), episodes=24, seed=1, usv=usv) for usv in strategies}
data = {usv: np.array(values_of(rows[usv], "delivered_mbit")) for usv in strategies}

# %%
# Mean of the paired difference and its 95 % interval, by sea: episodes that share one are not independent.
difference = data["visit"] - data["centroid"]
found = interval(difference, scenario.random_seas)
print(f"visit less centroid: {found.mean:.1f} ± {found.half:.1f} Mbit")

figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
axes.plot(strategies, [data[usv] for usv in strategies], color="0.7", lw=0.8)
axes.plot(strategies, [data[usv].mean() for usv in strategies], "o-", color="tab:blue", lw=2, label="mean")
axes.set(ylabel="data collected, Mbit", xlabel="boat strategy; each grey line is one world")
axes.legend(frameon=False)
plt.show()
