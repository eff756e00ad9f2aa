"""
Waves from a file
=================

A wind sea and a swell that cross it, from a file as WAVEWATCH III writes them, and the component waves of a sea that is
drawn from it. What a file needs, and where to get one, is in :doc:`/real-water`.
"""

import math
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import xarray

from usvauv.env import Scenario
from usvauv.env.sea.water import build_short_waves
from usvauv.env.site.site import Site

# %%
# Spectra by Pierson and Moskowitz: Hs, Tp, the direction that waves travel to, clockwise from north, and s of the
# spreading cos^2s(½Δθ).
frequency, direction = 0.035 * 1.1 ** np.arange(28), np.arange(0.0, 360.0, 10.0)
efth = np.zeros((28, 36))
for height, period, towards, s in ((3.5, 9.0, 70.0, 8), (2.0, 15.0, 150.0, 40)):
    S = 5 / 16 * height**2 / period**4 * frequency**-5.0 * np.exp(-1.25 / (period * frequency) ** 4)
    D = np.abs(np.cos(np.radians(direction - towards) / 2)) ** (2 * s)
    efth += np.outer(S, D / (D.sum() * math.radians(10.0)))

# %%
# One time and one station, in the North Sea.
waves = xarray.Dataset(
    {"efth": (("time", "station", "frequency", "direction"), efth[None, None], {"units": "m2 s rad-1"})},
    {
        "time": ("time", [0.0], {"standard_name": "time", "units": "days since 2026-11-01 00:00:00"}),
        "longitude": ("station", [0.5], {"units": "degrees_east"}),
        "latitude": ("station", [58.5], {"units": "degrees_north"}),
        "frequency": ("frequency", frequency, {"units": "s-1"}),
        "direction": ("direction", direction, {"units": "degree", "standard_name": "sea_surface_wave_to_direction"}),
    },
)
path = Path(tempfile.mkdtemp()) / "waves.nc"
waves.to_netcdf(path, engine="h5netcdf")

# %%
# A scenario at that place, and the sea of its first mission.
scenario = Scenario.load("extreme", [f"water.waves={path}", "water.longitude=0.5", "water.latitude=58.5"])
site = Site(scenario)
sea = build_short_waves(site, [(0, 0)])
print(f"Hs {4 * math.sqrt((sea.amplitude**2 / 2).sum()):.2f} m at {site.start}")

# %%
# The density of the file, and each component wave as a circle whose area is its energy, by where they travel to.
figure, axes = plt.subplots(figsize=(5.5, 5), layout="constrained", subplot_kw={"projection": "polar"})
axes.set(theta_zero_location="N", theta_direction=-1, ylim=(0, 0.3))
colours = axes.pcolormesh(
    np.radians(np.append(direction, 360.0)), frequency, np.hstack([efth, efth[:, :1]]), cmap="Blues"
)
axes.scatter(
    math.pi / 2 - sea.direction[0],
    sea.omega[0] / (2 * math.pi),
    s=2000 * sea.amplitude[0] ** 2,
    facecolors="none",
    edgecolors="C1",
)
axes.set(yticks=[0.1, 0.2, 0.3], title="towards; radius is the frequency, Hz")
figure.colorbar(colours, label="density, m²/(Hz rad)")
plt.show()
