"""Error of the AUVs' positions by the spacing of the array: what whole turns of the phases do, and what undoes them.

    python -m benchmarks.studies.wide_array

`extreme`, AUVs steered by `straight`, with and without a tracker. For each spacing: the share of fixes whose phases
lack whole turns as measured; root mean square and 95th percentile of the error of all fixes if each were taken as it
is; the same of the estimates; the share of detected fixes that the receiver uses, and of these the share that is
wrong by whole turns. Fixes taken as they are belong to the same AUVs, boat and tilt, with noise of their own.
"""

from __future__ import annotations

import argparse
import json
from typing import Any

import numpy as np
import torch

from benchmarks.machine import describe
from usvauv import policies
from usvauv.env import Scenario, World
from usvauv.env.record.metrics import position_error
from usvauv.env.record.recorder import record
from usvauv.env.record.trace import Trace
from usvauv.env.site.site import Site
from usvauv.env.world.mission_parameters import link_table
from usvauv.kernels import runtime
from usvauv.kernels.positioning import usbl

SPACINGS = (0.033, 0.045, 0.06)
BOATS = ("fim", "hold:0,0")


def taken_as_they_are(trace: Trace, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Horizontal errors (n,) of fixes as they are measured, m, and which of them lack turns (n,)."""
    scenario, device = trace.scenario, runtime.start().device
    away = trace.auv_position - trace.boat_position
    z = -scenario.auv.depth - trace.boat_surface[..., :1].repeat(away.shape[2], 2)
    slope = scenario.usbl.tilt * trace.boat_surface[..., 1:].repeat(away.shape[2], 2)
    offset, tilt = (
        torch.tensor(part, dtype=torch.float32, device=device).flatten(0, -2)
        for part in (np.concatenate([away, z], -1), slope)
    )
    index = torch.arange(away.shape[2], dtype=torch.int32, device=device).repeat(len(offset) // away.shape[2])
    noise = torch.randn((len(offset), 7), generator=torch.Generator().manual_seed(seed)).to(device)
    link = torch.from_numpy(link_table(Site(scenario))).to(device)
    found, _, flags = usbl.fixes(link, index, offset, tilt, noise)
    error = (found[:, :2] - offset[:, :2]).norm(dim=1)
    return error.double().cpu().numpy(), (flags & usbl.WRAPPED > 0).cpu().numpy()


def spread(error: np.ndarray) -> dict[str, float]:
    return {"rms": float(np.sqrt(np.mean(np.square(error)))), "p95": float(np.quantile(error, 0.95))}


def measure(boat: str, spacing: float, tracked: bool, episodes: int, seed: int) -> dict[str, Any]:
    # A fix in each step, the estimate the last one or the tracker's.
    settings = ["channel.schedule=every-step", "navigation.sensor=none"]
    settings += [f"usbl.spacing={spacing}", f"tracker.enabled={str(tracked).lower()}"]
    world = World(Scenario.load("extreme", settings), episodes, seed, boat)
    trace = record(world, policies.load("straight", world).act, "straight")
    raw, wrapped = taken_as_they_are(trace, seed)
    heard = trace.fix_flags & usbl.DETECTED > 0
    used = heard & (trace.fix_flags & usbl.UNUSABLE == 0)
    return {
        "boat": boat,
        "spacing": spacing,
        "tracker": tracked,
        "wrapped": float(wrapped.mean()),
        "as_they_are": spread(raw),
        "estimates": spread(position_error(trace)),
        "used": float(used.sum() / heard.sum()),
        "wrong": float((trace.fix_flags[used] & usbl.WRAPPED > 0).mean()),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print JSON after the table")
    parser.add_argument("--episodes", type=int, default=16)
    parser.add_argument("--seed", type=int, default=2026)
    arguments = parser.parse_args()
    print(f"extreme, {arguments.episodes} episodes, seed {arguments.seed}; {describe()}")
    print("| boat | d, m | tracker | wrapped | raw: rms, p95, m | estimates: rms, p95, m | used | wrong |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    rows = []
    for boat in BOATS:
        for spacing in SPACINGS:
            for tracked in (False, True):
                row = measure(boat, spacing, tracked, arguments.episodes, arguments.seed)
                raw, found = row["as_they_are"], row["estimates"]
                print(
                    f"| {boat} | {spacing} | {'yes' if tracked else 'no'} | {row['wrapped']:.1%} "
                    f"| {raw['rms']:.2f}, {raw['p95']:.2f} | {found['rms']:.2f}, {found['p95']:.2f} "
                    f"| {row['used']:.2%} | {row['wrong']:.3%} |",
                    flush=True,
                )
                rows.append(row)
    if arguments.json:
        print(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
