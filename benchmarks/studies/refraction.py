"""Error of a fix that supposes straight rays, and the speed of the ray kernels.

    python -m benchmarks.studies.refraction --out docs/refraction.png

A level array at the mean surface receives a source 100 m deep without noise: the horizontal slowness and the travel
time of the true ray. Fixes follow from them by three methods: straight lines with the speed at the array, straight
lines with the harmonic mean of the speed between surface and source, and down the ray through the profile. What is
new in each fix in `extreme`, noise with pitch and roll, is shown for comparison.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import torch
from matplotlib.figure import Figure

from benchmarks.machine import batch, best_time, describe
from usvauv.env import Scenario
from usvauv.env.render.figures import write_pair
from usvauv.env.render.style import Ground
from usvauv.env.site.site import Site
from usvauv.env.site.sound_speed import SoundSpeedProfile
from usvauv.env.world.mission_parameters import link_table
from usvauv.kernels import runtime
from usvauv.kernels.positioning import rays, usbl

DEPTH = 100.0  # of the source, m
PROFILES = {  # depth, m, and speed, m/s
    "isothermal, 10 °C": [(0, 1490.0), (200, 1493.3)],
    "summer thermocline": [(0, 1522.0), (20, 1522.3), (50, 1492.0), (200, 1490.0)],
    "strong gradient: meltwater": [(0, 1440.0), (3, 1440.0), (20, 1475.0), (60, 1480.0), (200, 1482.0)],
}
UPWARD = [(0, 1450.0), (50, 1480.0), (200, 1490.0)]  # under which rays from 30 m depth turn beyond 400 m
ARRAYS = (0.0, 3.25, 6.5)  # depths of arrays for which a profile is thinned, m
BED = 199.0  # m
LONGEST = (283.0, 566.0, 1500.0, 3000.0)  # ranges for which a profile is thinned, m
METHODS = ("speed at the array", "harmonic mean", "down the ray")
RANGES = (10, 50, 100, 200, 300, 400)  # of the table, m


def tensor(values: np.ndarray) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float32, device=runtime.start().device)


def errors(profile: SoundSpeedProfile, R: np.ndarray) -> dict[str, np.ndarray]:
    """Horizontal and vertical error (n, 2), m, of each method at the horizontal ranges R (n,), m."""
    offset = np.stack([R, np.zeros_like(R), np.full_like(R, -DEPTH)], axis=1)
    layers, depth = tensor(profile.layers()), tensor(np.zeros_like(R))
    found = {}
    for method, c in zip(METHODS, (profile.at(0.0), *[profile.harmonic_mean(0.0, DEPTH)] * 2), strict=True):
        arrivals = rays.arrivals(layers, depth, tensor(offset), c)
        if method == "down the ray":
            place = rays.positions(layers, depth, arrivals, c).double().cpu().numpy()
        else:
            x, y, _, S, _ = arrivals.double().cpu().numpy().T
            place = S[:, None] * np.stack([x, y, -np.sqrt(np.maximum(1 - x * x - y * y, 0))], axis=1)
        exists = arrivals[:, 4].cpu().numpy() > 0
        found[method] = np.where(exists[:, None], (place - offset)[:, [0, 2]], np.nan)
    return found


def covariance_ratio(profile: SoundSpeedProfile, R: np.ndarray) -> np.ndarray:
    """Horizontal spread of a fix down the ray over that of one along a straight line, (n, 3).

    For an error across the line of sight, one in its plane, and one of the range: the derivatives of the position.
    """
    c = profile.harmonic_mean(0.0, DEPTH)
    offset = np.stack([R, np.zeros_like(R), np.full_like(R, -DEPTH)], axis=1)
    layers, depth = tensor(profile.layers()), tensor(np.zeros_like(R))
    arrivals = rays.arrivals(layers, depth, tensor(offset), c)
    S = np.hypot(R, DEPTH)
    ratios = []
    for column, axis, step, straight in ((1, 1, 4e-3, S), (0, 0, 4e-3, S), (3, 0, 1.0, R / S)):
        ends = []
        for sign in (1, -1):
            moved = arrivals.clone()
            moved[:, column] += sign * step
            ends.append(rays.positions(layers, depth, moved, c).double().cpu().numpy()[:, axis])
        ratios.append((ends[0] - ends[1]) / (2 * step) / straight)
    return np.stack(ratios, axis=1)


def noise(R: np.ndarray) -> np.ndarray:
    """Standard deviation of what is new in each fix in `extreme`: noise, pitch and roll; level array, both axes, m."""
    device = runtime.start().device
    link = torch.from_numpy(link_table(Site(Scenario.load("extreme")))).to(device)
    offset = tensor(np.stack([R, np.zeros_like(R), np.full_like(R, -DEPTH)], axis=1))
    zero = torch.zeros((len(R), 5), device=device)
    index = torch.zeros(len(R), dtype=torch.int32, device=device)
    covariance = usbl.fixes(link, index, offset, zero[:, :2].contiguous(), zero)[1].double().cpu().numpy()
    return np.sqrt(covariance[:, 0] + covariance[:, 2])


def rates(
    profile: SoundSpeedProfile, seconds: float, source: float = DEPTH, nearest: float = 0.0, farthest: float = 200.0
) -> dict[str, float]:
    """Rays and positions a second, boats within 10 m of the surface, sources at a depth and at horizontal ranges, m."""
    count = batch(1 << 18, 1 << 24)
    random = np.random.default_rng(0)
    elevation = random.uniform(-10, 10, count)
    R, azimuth = random.uniform(nearest, farthest, count), random.uniform(-np.pi, np.pi, count)
    offset = tensor(np.column_stack([R * np.cos(azimuth), R * np.sin(azimuth), -source - elevation]))
    layers, depth = tensor(profile.layers()), tensor(-elevation)
    arrivals = rays.arrivals(layers, depth, offset, 1500.0)
    back = rays.positions(layers, depth, arrivals, 1500.0)
    return {
        "depths": len(profile.depths),
        "rays_per_second": count / best_time(lambda: rays.arrivals(layers, depth, offset, 1500.0), seconds),
        "positions_per_second": count / best_time(lambda: rays.positions(layers, depth, arrivals, 1500.0), seconds),
        "heard": float(arrivals[:, 4].mean()),
        "largest_error_there_and_back": float(((back - offset) * arrivals[:, 4:]).abs().max()),
    }


def cast(thickness: float = 1.0) -> SoundSpeedProfile:
    """A smooth summer profile measured every `thickness` metres."""
    z = np.arange(0.0, 200.0, thickness)
    return SoundSpeedProfile.from_table(np.column_stack([z, 1506 - 15 * np.tanh((z - 35) / 12) + 0.016 * z]))


def draw(ground: Ground) -> Figure:
    """The profiles and the horizontal error against horizontal range."""
    R = np.concatenate([np.linspace(1, 10, 19), np.linspace(11, 400, 390)])
    figure = Figure(figsize=(9.6, 5.2), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1, 2.4))
    exact = 0.0
    for color, (name, table) in zip(ground.colours, PROFILES.items(), strict=False):
        profile = SoundSpeedProfile.from_table(table)
        z = np.linspace(0, 120, 241)
        left.plot(np.interp(z, profile.depths, profile.speeds), z, color=color)
        found = errors(profile, R)
        for method, style in zip(METHODS[:2], ("--", "-"), strict=True):
            right.plot(R, np.abs(found[method][:, 0]), style, color=color, label=f"{name}, {method}")
        exact = max(exact, np.abs(found["down the ray"][:, 0]).max())
    right.plot(R, noise(R), color=ground.muted, lw=4, alpha=0.6, label="noise of one fix in extreme, 1 σ", zorder=1)
    bound = f"down the ray, all three: below {1e3 * exact:.1f} mm"
    right.axhline(exact, color=ground.text, lw=0.8, ls=":", label=bound)
    left.set(xlabel="speed of sound, m/s", ylabel="depth, m", ylim=(120, 0))
    left.axhline(DEPTH, color=ground.muted, lw=0.8)
    left.text(1443, DEPTH - 1, "source", color=ground.muted, fontsize=9)
    right.set(xlabel="horizontal range, m", ylabel="horizontal error of the fix, m", yscale="log")
    right.set(xlim=(0, 400), ylim=(1e-4, 40))
    right.yaxis.set_major_formatter("{x:g}")
    figure.legend(*right.get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return figure


def measure(seconds: float) -> dict[str, object]:
    """All figures."""
    R = np.array(RANGES, float)
    profiles = {name: SoundSpeedProfile.from_table(table) for name, table in PROFILES.items()}
    fine = cast()
    return {
        "machine": describe(),
        "ranges": RANGES,
        "noise": noise(R).tolist(),
        "errors": {
            name: {method: found.tolist() for method, found in errors(profile, R).items()}
            for name, profile in profiles.items()
        },
        "covariance_ratio": {name: covariance_ratio(profile, R).tolist() for name, profile in profiles.items()},
        "rates": [
            rates(profile, seconds)
            for profile in (
                SoundSpeedProfile.constant(1500.0),
                *profiles.values(),
                fine.thinned(ARRAYS, DEPTH, LONGEST[0], BED),
                fine,
            )
        ],
        "turning": rates(SoundSpeedProfile.from_table(UPWARD), seconds, 30.0, 600.0, 3000.0),
        "shadow": rates(SoundSpeedProfile.from_table(PROFILES["summer thermocline"]), seconds, DEPTH, 3500.0, 4000.0),
        "thinning": [
            thinning_error(fine, fine.thinned(ARRAYS, DEPTH, longest, BED), longest) | {"longest": longest}
            for longest in LONGEST
        ],
    }


def thinning_error(fine: SoundSpeedProfile, thin: SoundSpeedProfile, longest: float) -> dict[str, float]:
    """How much sound through a thinned profile differs from sound through the other, up to a range.

    Largest error of the travel time times 1500 m/s (m), over arrays; where the first array hears last by each (m);
    largest horizontal error (m) of a fix up to 300 m.
    """
    R = np.linspace(1, longest, 1000)
    worst, edges = 0.0, []
    for array in ARRAYS:
        ends = tensor(np.stack([np.full_like(R, array), np.full_like(R, DEPTH), R], axis=1))
        found = [rays.eigenrays(tensor(p.layers()), ends, array).double().cpu().numpy() for p in (fine, thin)]
        heard = [rays_found[:, 4] > 0 for rays_found in found]
        both = heard[0] & heard[1]
        worst = max(worst, 1500 * np.abs(found[1][:, 3] - found[0][:, 3])[both].max())
        edges += [float(R[some].max()) for some in heard]
    near = np.linspace(1, 300, 300)
    depth = tensor(np.zeros_like(near))
    offset = tensor(np.stack([near, np.zeros_like(near), np.full_like(near, -DEPTH)], axis=1))
    arrivals = rays.arrivals(tensor(fine.layers()), depth, offset, 1500.0)
    back = rays.positions(tensor(thin.layers()), depth, arrivals, 1500.0)
    place = float((back - offset)[:, 0].abs().max())
    return {
        "depths": len(thin.depths),
        "time": float(worst),
        "place": place,
        "edge": edges[0],
        "thinned_edge": edges[1],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")
    parser.add_argument("--out", type=Path, help="X.png: figures X-light.png and X-dark.png to write")
    parser.add_argument("--seconds", type=float, default=1.0, help="time spent on each rate, s")
    arguments = parser.parse_args()
    if arguments.out:
        write_pair(arguments.out, draw)
    result = measure(arguments.seconds)
    if arguments.json:
        print(json.dumps(result, indent=1))
        return
    print(result["machine"])
    print("horizontal range, m".ljust(50), *(f"{R:>15g}" for R in RANGES))
    print("noise in extreme, 1 σ, m".ljust(50), *(f"{sigma:>15.2f}" for sigma in result["noise"]))
    for name, methods in result["errors"].items():
        for method, found in methods.items():
            print(f"{name}, {method}".ljust(50), *(f"{x:>8.3f}{z:>7.2f}" for x, z in found))
    print(
        "horizontal and vertical error, m; spread down the ray over that of a straight line (across, in plane, range):"
    )
    for name, ratios in result["covariance_ratio"].items():
        print(name.ljust(47), *(" ".join(f"{value:.2f}" for value in ratio).rjust(15) for ratio in ratios))
    for row in result["rates"]:
        print(
            f"{row['depths']:3d} depths: {row['rays_per_second'] / 1e6:.1f} million rays/s,"
            f" {row['positions_per_second'] / 1e6:.1f} million positions/s,"
            f" there and back within {1e3 * row['largest_error_there_and_back']:.2f} mm"
        )
    for kind in ("turning", "shadow"):
        row = result[kind]
        heard, rate = 100 * row["heard"], row["rays_per_second"] / 1e6
        print(f"{kind}, {row['depths']} depths, {heard:.0f} % heard: {rate:.2f} million rays/s")
    for row in result["thinning"]:
        print(
            f"thinned for {row['longest']:g} m: {row['depths']} depths, travel times within {1e3 * row['time']:.1f} mm,"
            f" fixes within {1e3 * row['place']:.1f} mm up to 300 m;"
            f" heard up to {row['thinned_edge']:.0f} m, by all depths up to {row['edge']:.0f} m"
        )


if __name__ == "__main__":
    main()
