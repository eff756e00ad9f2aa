"""Depths and currents of an area from files, as a figure, to look at before a mission uses them.

python examples/real_water.py bathymetry.nc currents.nc 0.5 58.5 --width 2000 --length 2000
"""

import argparse
from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np

from usvauv.env.site.ocean import read_bathymetry, read_flow
from usvauv.env.site.place import LocalFrame


def main(arguments: Sequence[str] | None = None) -> None:
    """Read both files, print the extremes, and draw the currents at all levels over the depth."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("bathymetry")
    parser.add_argument("currents")
    parser.add_argument("longitude", type=float, help="of the area's south-west corner, degrees")
    parser.add_argument("latitude", type=float)
    parser.add_argument("--width", type=float, default=5000.0, help="m")
    parser.add_argument("--length", type=float, default=5000.0, help="m")
    parser.add_argument("--level", type=float, action="append", help="depth, m; may be repeated (default: 0 and 100)")
    parser.add_argument("--start", default="", help="ISO 8601 (default: the first time of the file)")
    parser.add_argument("--out", default="real-water.png")
    asked = parser.parse_args(arguments)

    area = LocalFrame(asked.longitude, asked.latitude), asked.width, asked.length
    depth = read_bathymetry(asked.bathymetry, *area, cells=(200, 200))
    flow = read_flow(asked.currents, *area, asked.level or (0.0, 100.0), asked.start)
    speed = np.linalg.norm(flow.velocity[0], axis=-1)

    axes = plt.figure(figsize=(7, 6), layout="constrained").subplots()
    colours = plt.get_cmap("viridis_r").with_extremes(bad="tan")  # land
    extent = (0, asked.width, 0, asked.length)
    image = axes.imshow(np.where(depth > 0, depth, np.nan), origin="lower", extent=extent, cmap=colours)
    axes.figure.colorbar(image, label="depth (m)")
    _, ny, nx = speed.shape
    x, y = np.linspace(0, asked.width, nx), np.linspace(0, asked.length, ny)
    for index, level in enumerate(flow.levels):
        east, north = np.moveaxis(flow.velocity[0, index], -1, 0)
        axes.quiver(x, y, east, north, color=f"C{index + 1}", label=f"{level:g} m")
    axes.set(xlabel="x east (m)", ylabel="y north (m)", title=flow.start)
    margin = 0.1 * max(asked.width, asked.length)  # room for the arrows on the edges
    axes.set(xlim=(-margin, asked.width + margin), ylim=(-margin, asked.length + margin))
    axes.legend(title="current at")
    plt.savefig(asked.out, dpi=150)
    plt.close()
    print(f"{asked.out}: depth {depth.min():.1f} to {depth.max():.1f} m, current up to {speed.max():.2f} m/s")


if __name__ == "__main__":
    main()
