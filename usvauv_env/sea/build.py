"""The sea of a scenario: its long waves and the storm upon them, on any grid, for any seeds.

Sea s of a seed depends on (seed, s) alone, whatever the number of seas, and is a continuous function of position and
time (`usvauv_env.sea.forcing`): a coarse and a fine solver carry on the same sea.
"""

from __future__ import annotations

from typing import cast

import numpy as np

from kernels.shallow_water.boundaries import Boundary, Side
from kernels.shallow_water.linear import ShallowWater
from kernels.shallow_water.nonlinear import NonlinearBoundary, NonlinearShallowWater
from usvauv_env.scenario import Scenario
from usvauv_env.sea.forcing import draw_sea
from usvauv_env.sea.long_waves import LongWaves
from usvauv_env.sea.nonlinear_pool import NonlinearSeas
from usvauv_env.sea.storm import AirySea, build_storm
from usvauv_env.site.site import Site


def coarse_cells(scenario: Scenario) -> tuple[int, int]:
    """Cells (nx, ny) of about `sea.cell_size`, for training and evaluating."""
    size = scenario.sea.cell_size
    return max(3, round(scenario.area.width / size)), max(3, round(scenario.area.length / size))


def fine_cells(scenario: Scenario) -> tuple[int, int]:
    """Cells (nx, ny) with `sea.fine_cells` along the longer side, for a sea that is drawn."""
    size = max(scenario.area.width, scenario.area.length) / scenario.sea.fine_cells
    return max(3, round(scenario.area.width / size)), max(3, round(scenario.area.length / size))


def build_sea(site: Site, seed: int, num_seas: int, cells: tuple[int, int] | None = None, first: int = 0) -> LongWaves:
    """Long waves of seas `first` to `first` + `num_seas` − 1 of a seed at t = 0, in intervals `sea.update_interval`.

    Args:
        site: of a scenario, whose sections `area`, `water` and `sea` are used.
        seed: any non-negative integer.
        num_seas: number of seas.
        cells: (nx, ny); default `coarse_cells`.
        first: index of the first sea.
    """
    scenario, sea = site.scenario, site.scenario.sea
    cells = cells or coarse_cells(scenario)
    depth = site.still_depth(cells)
    size = scenario.area.width, scenario.area.length
    mean_depth = float(depth[depth > 0].mean())
    drawn = [draw_sea(scenario, seed, first + index, cells, mean_depth) for index in range(num_seas)]
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
        num_seas=num_seas,
    )
    waves, eta, u, v = zip(*drawn, strict=True)
    solver.set_forcing(*(np.stack([getattr(w, name) for w in waves]) for name in ("amplitude", "period", "phase")))
    solver.set_state(np.stack(eta), np.stack(u), np.stack(v))
    return solver


def boundaries(scenario: Scenario) -> dict[Side, Boundary]:
    """Kind of each boundary that is not a wall, as the solvers name them."""
    sea = scenario.sea
    kinds: dict[Side, Boundary] = dict.fromkeys(sea.radiating_edges, "radiating")
    kinds |= dict.fromkeys(sea.sponge_edges, "sponge")
    if sea.forced_edge != "none":
        kinds[sea.forced_edge] = "forced" if sea.forcing == "elevation" else "incident"
    return kinds


def build_short_waves(site: Site, seed: int, num_seas: int, first: int = 0) -> AirySea:
    """The storm upon the seas of `build_sea`, with velocities at the levels `kernels.types.Level`."""
    scenario, depth = site.scenario, site.mean_depth
    levels = 0.0, -min(scenario.auv.depth, depth)
    return build_storm(
        scenario.storm,
        depth=depth,
        gravity=scenario.sea.gravity,
        levels=levels,
        seed=seed,
        num_seas=num_seas,
        first=first,
    )
