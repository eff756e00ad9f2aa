"""Bed and real current of a scenario's area: flat and none, or read from files."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from kernels.types import Level
from usvauv_env.scenario import Scenario, ScenarioError
from usvauv_env.site.cf_ocean import Flow, read_bathymetry, read_flow
from usvauv_env.site.local_frame import LocalFrame

BED_CELLS = 256  # along the longer side of the area, of the bed that nodes lie on


@lru_cache(maxsize=4)
def still_depth(scenario: Scenario, cells: tuple[int, int]) -> np.ndarray:
    """Depth of still water at cell centres, (ny, nx), m; on land at most 0: minus the height, where it is known.

    Raises:
        OceanError: the file of the bathymetry does not serve.
    """
    area, water = scenario.area, scenario.water
    if not water.bathymetry:
        return np.broadcast_to(np.float64(area.depth), cells[::-1])
    return read_bathymetry(water.bathymetry, _frame(scenario), area.width, area.length, cells)


def mean_depth(scenario: Scenario) -> float:
    """Mean depth of the water, m."""
    depth = still_depth(scenario, _bed_cells(scenario))
    return float(depth[depth > 0].mean())


def bed(scenario: Scenario) -> np.ndarray:
    """Depth of still water as a field of `kernels.flow.regular_grid`, (1, rows, columns, 1), m.

    Raises:
        OceanError: the file of the bathymetry does not serve.
        ScenarioError: the bed rises to the AUVs.
    """
    if not scenario.water.bathymetry:
        return np.full((1, 2, 2, 1), scenario.area.depth)
    depth = still_depth(scenario, _bed_cells(scenario))
    for axis in (0, 1):  # from cell centres to the corners around them
        rows = np.moveaxis(depth, axis, 0)
        inner = (rows[1:] + rows[:-1]) / 2
        ends = 1.5 * rows[[0, -1]] - 0.5 * rows[[1, -2]]
        depth = np.moveaxis(np.concatenate([ends[:1], inner, ends[1:]]), 0, axis)
    if depth.min() <= scenario.auv.depth:
        i, j = np.unravel_index(depth.argmin(), depth.shape)
        x, y = j * scenario.area.width / (depth.shape[1] - 1), i * scenario.area.length / (depth.shape[0] - 1)
        raise ScenarioError(
            f"auv.depth = {scenario.auv.depth:g}: must be above the bed everywhere, and {scenario.water.bathymetry} "
            f"has {depth.min():.1f} m at x = {x:.0f} m, y = {y:.0f} m"
        )
    return depth[None, :, :, None]


@lru_cache(maxsize=4)
def real_current(scenario: Scenario) -> Flow | None:
    """The currents of the file at the depths of `kernels.mission.columns.Level` during a mission, if there is one.

    Raises:
        OceanError: the file does not serve.
    """
    area, water = scenario.area, scenario.water
    if not water.currents:
        return None
    depths = {Level.surface: 0.0, Level.cruise: scenario.auv.depth}
    levels = [depths[level] for level in sorted(depths)]
    duration = scenario.mission.steps * scenario.mission.step
    return read_flow(water.currents, _frame(scenario), area.width, area.length, levels, water.start, duration)


def _frame(scenario: Scenario) -> LocalFrame:
    return LocalFrame(scenario.water.longitude, scenario.water.latitude)


def _bed_cells(scenario: Scenario) -> tuple[int, int]:
    size = max(scenario.area.width, scenario.area.length) / BED_CELLS
    return max(3, round(scenario.area.width / size)), max(3, round(scenario.area.length / size))
