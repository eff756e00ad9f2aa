"""The sea of a scenario: its long waves and the storm upon them, on any grid, for any seeds.

Sea s of a seed depends on (seed, s) alone, whatever the number of seas, and is a continuous function of position and
time (`usvauv.env.sea.forcing`): a coarse and a fine solver carry on the same sea.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import cast

import numpy as np

from usvauv.env.scenario import Scenario, ScenarioError
from usvauv.env.sea.forcing import BoundaryWave, boundary_wave, draw_sea
from usvauv.env.sea.long_waves import LongWaves
from usvauv.env.sea.nonlinear_pool import NonlinearSeas
from usvauv.env.sea.storm import AirySea, build_storm, wave_systems
from usvauv.env.site.site import Site
from usvauv.env.storage.memory import require
from usvauv.kernels import runtime
from usvauv.kernels.shallow_water.boundaries import Boundary, Side
from usvauv.kernels.shallow_water.discretisation import LANES
from usvauv.kernels.shallow_water.linear import COURANT, ShallowWater
from usvauv.kernels.shallow_water.nonlinear import NonlinearBoundary, NonlinearShallowWater

MOST_SUBSTEPS = 1_000_000


def coarse_cells(scenario: Scenario) -> tuple[int, int]:
    """Cells (nx, ny) of about `sea.cell_size`, for training and evaluating."""
    size = scenario.sea.cell_size
    return round(scenario.area.width / size), round(scenario.area.length / size)


def fine_cells(scenario: Scenario) -> tuple[int, int]:
    """Cells (nx, ny) with `sea.fine_cells` along the longer side, for a sea that is drawn."""
    size = max(scenario.area.width, scenario.area.length) / scenario.sea.fine_cells
    return max(3, round(scenario.area.width / size)), max(3, round(scenario.area.length / size))


def sea_bytes(scenario: Scenario, cells: tuple[int, int], num_seas: int) -> float:
    """Estimate of the memory that building and solving a sea takes at its peak, bytes."""
    nx, ny = cells
    count, blocks = nx * ny, math.ceil(num_seas / LANES)
    strips = num_seas == 1 and nx >= LANES
    if scenario.sea.equations == "nonlinear":
        return count * (130.0 * num_seas + (12.0 if strips else 12.0 * LANES * blocks))
    packed = 20.0 if strips else 12.0 * LANES * blocks + 8.0 * LANES
    drawn = 48.0 * num_seas  # three fields in double precision, apart and together
    forcing = 24.0 * num_seas * (scenario.sea.irregular_components + 1) + 4.0 * LANES * blocks
    return count * (packed + drawn) + substeps(scenario, cells) * forcing


def substeps(scenario: Scenario, cells: tuple[int, int]) -> float:
    """About the substeps of the linear solver in `sea.update_interval`, over a flat bed at `area.depth`."""
    area, sea = scenario.area, scenario.sea
    rate = math.sqrt(sea.gravity * area.depth) * math.hypot(cells[0] / area.width, cells[1] / area.length)
    return max(1.0, sea.update_interval * rate / COURANT)


def check_sea(scenario: Scenario, cells: tuple[int, int], num_seas: int, further: float = 0.0) -> None:
    """Refuse a sea that does not fit into memory, or that is solved in too many substeps.

    Args:
        scenario: whose sea it is.
        cells: (nx, ny).
        num_seas: number of seas.
        further: bytes that its use takes beside it.

    Raises:
        ScenarioError: too many substeps.
        MemoryNeeded: too much memory.
    """
    steps = substeps(scenario, cells)
    if scenario.sea.equations == "linear" and steps > MOST_SUBSTEPS:
        raise ScenarioError(
            f"sea.update_interval = {scenario.sea.update_interval:g}: takes {steps:.3g} substeps on {cells[0]} ×"
            f" {cells[1]} cells over {scenario.area.depth:g} m; at most {MOST_SUBSTEPS}"
        )
    seas = f"{num_seas} seas of " if num_seas > 1 else ""
    what = f"sea.cell_size, sea.fine_cells or --resolution: {seas}{cells[0]} × {cells[1]} cells"
    require(sea_bytes(scenario, cells, num_seas) + further, what, runtime.start().device)


def build_sea(site: Site, seas: Sequence[tuple[int, int]], cells: tuple[int, int] | None = None) -> LongWaves:
    """Long waves at t = 0, in intervals `sea.update_interval`.

    Args:
        site: of a scenario, whose sections `area`, `water` and `sea` are used.
        seas: seed, any non-negative integer, and index of each sea.
        cells: (nx, ny); default `coarse_cells`.

    Raises:
        ScenarioError, MemoryNeeded: as `check_sea`.
    """
    scenario, sea = site.scenario, site.scenario.sea
    cells = cells or coarse_cells(scenario)
    check_sea(scenario, cells, len(seas))
    depth = site.still_depth(cells)
    size = scenario.area.width, scenario.area.length
    mean_depth = float(depth[depth > 0].mean())
    drawn = [draw_sea(scenario, seed, index, cells, mean_depth) for seed, index in seas]
    if sea.equations == "nonlinear":
        solvers = []
        for wave, eta, u, v in drawn:
            solver = NonlinearShallowWater(
                size=size,
                cells=cells,
                bed=-depth,
                interval=sea.update_interval,
                gravity=sea.gravity,
                drag=sea.drag,
                manning=sea.manning,
                boundaries=cast(dict[Side, NonlinearBoundary], boundaries(scenario)),
            )
            solver.set_forcing(wave.amplitude, wave.period, wave.phase)
            solver.set_state(eta, (u[:, 1:] + u[:, :-1]) / 2, (v[1:] + v[:-1]) / 2)
            solvers.append(solver)
        return NonlinearSeas(solvers)
    solver = ShallowWater(
        size=size,
        cells=cells,
        depth=np.maximum(depth, 0),
        interval=sea.update_interval,
        gravity=sea.gravity,
        drag=sea.drag,
        boundaries=boundaries(scenario),
        sponge_width=sea.sponge_width if sea.sponge_edges else None,
        num_seas=len(seas),
    )
    _, eta, u, v = zip(*drawn, strict=True)
    solver.set_forcing(*stacked_forcing(scenario, seas))
    solver.set_state(np.stack(eta), np.stack(u), np.stack(v))
    return solver


def stacked_forcing(scenario: Scenario, seas: Sequence[tuple[int, int]]) -> BoundaryWave:
    """Waves at the forced edges of the seas of `build_sea`, each array (seas, components)."""
    waves = [boundary_wave(scenario, seed, index) for seed, index in seas]
    return BoundaryWave(*map(np.stack, zip(*waves, strict=True)))


def boundaries(scenario: Scenario) -> dict[Side, Boundary]:
    """Kind of each boundary that is not a wall, as the solvers name them."""
    sea = scenario.sea
    kinds: dict[Side, Boundary] = dict.fromkeys(sea.radiating_edges, "radiating")
    kinds |= dict.fromkeys(sea.sponge_edges, "sponge")
    if sea.forced_edge != "none":
        kinds[sea.forced_edge] = "forced" if sea.forcing == "elevation" else "incident"
    return kinds


def build_short_waves(site: Site, seas: Sequence[tuple[int, int]]) -> AirySea:
    """The storm upon the seas of `build_sea`, with velocities at the levels `usvauv.kernels.types.Level`."""
    scenario, depth = site.scenario, site.mean_depth
    levels = 0.0, -min(scenario.auv.depth, depth)
    return build_storm(
        scenario.storm,
        wave_systems(site),
        depth=depth,
        gravity=scenario.sea.gravity,
        levels=levels,
        seas=seas,
    )
