"""
The sea alone
=============

Long waves by shallow-water equations and a storm upon them, without vehicles, and the spectrum that comes out.
"""

import matplotlib.pyplot as plt
import numpy as np

from usvauv.cli.sea_view.figure import spectrum, target_spectrum
from usvauv.env import Scenario
from usvauv.env.sea.simulation import SeaSimulation

# %%
# The sea that a mission of the same scenario and seed has, on 64 × 64 cells, every half second for five minutes.
scenario = Scenario.load("extreme")
sea = SeaSimulation(scenario, seed=2, shape=(64, 64), interval=0.5)
surfaces = []
for _ in range(600):
    sea.advance()
    surfaces.append(sea.surface().elevation)
eta = np.stack(surfaces)

# %%
figure, axes = plt.subplots(figsize=(6, 4.6), layout="constrained")
image = axes.imshow(eta[-1], origin="lower", extent=(0, 200, 0, 200), cmap="RdBu_r", vmin=-6, vmax=6)
axes.set(xlabel="x (east), m", ylabel="y (north), m", title=f"Elevation at {sea.time:g} s")
figure.colorbar(image, label="η, m")
plt.show()

# %%
# Spectral density by Welch's method, mean over 64 points, beside the JONSWAP spectrum that the storm is drawn from.
# What is left of the peak are the long waves.
frequency, density = spectrum(eta[:, ::8, ::8].reshape(len(eta), -1), sea.interval, piece=150.0)
figure, axes = plt.subplots(figsize=(6.5, 4), layout="constrained")
axes.loglog(frequency, density, label="simulated")
axes.loglog(*target_spectrum(sea.site), label=f"target, Hs {scenario.storm.significant_height:g} m")
axes.set(xlabel="frequency, Hz", ylabel="spectral density of η, m²/Hz", xlim=(0.006, 0.5), ylim=(1e-2, 1e3))
axes.legend(frameon=False)
plt.show()
