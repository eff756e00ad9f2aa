"""Shallow water forward–backward in time with a thread for each cell: `kernels.shallow_water.wavefront` for a GPU.

The same sums in the same order on the same packed fields, in two launches a substep: all transports, then all
elevations. Neighbouring threads work on neighbouring numbers. A GPU has threads for that, and none to march with.
"""

import numpy as np
import taichi as ti
import torch

from kernels.launch import Launch
from kernels.shallow_water.boundaries import Edges
from kernels.shallow_water.packing import LANES, Packing
from kernels.shallow_water.wavefront import sides

numbers = ti.types.ndarray(dtype=ti.f32, ndim=1)
integers = ti.types.ndarray(dtype=ti.i32, ndim=1)


@ti.kernel
def transports(
    eta: numbers,
    U: numbers,
    V: numbers,
    Cx: numbers,
    Cy: numbers,
    edge_elevation: numbers,
    resistance: numbers,
    kept: numbers,
    coefficient_row: integers,
    share: sides,
    blocks: ti.i32,
    W: ti.i32,
    nx: ti.i32,
    substep: ti.i32,
    a: ti.f32,
    strips: ti.template(),
    radiating: ti.template(),
    sponge: ti.template(),
):
    """U ← a U − Cx δx η and V ← a V − Cy δy η, in place; at an open edge η outside is E ± R U.

    Args:
        coefficient_row: (ny + 1,), the row of coefficients of each row.
        substep: of the interval, which `edge_elevation` is read at.

    All else is what `forward_backward.march` takes, its vectors' numbers one after the other.
    """
    rows = coefficient_row.shape[0]
    width = W * LANES
    table = edge_elevation.shape[0] // (blocks * LANES)
    west_edge = 2 * width
    east_edge = west_edge + rows * LANES
    for r, m in ti.ndrange(blocks * rows, width):
        row = r % rows
        lane = m % LANES
        column = m // LANES
        if ti.static(strips):
            column += lane * W
        n = r * width + m
        c = coefficient_row[row] * width + m
        E = edge_elevation[(r // rows * table + substep) * LANES + lane]
        U_here = U[n]
        V_here = V[n]
        east = eta[n]
        north = eta[n]
        west = 0.0
        south = 0.0
        if column > 0:
            west = eta[n - LANES if m >= LANES else n + width - LANES - 1]
        elif share[0] >= 0:
            west = share[0] * E
            if ti.static(radiating):
                west = west - resistance[west_edge + row * LANES + lane] * U_here
        if column == nx and share[1] >= 0:
            east = share[1] * E
            if ti.static(radiating):
                east = east + resistance[east_edge + row * LANES + lane] * U_here
        if row > 0:
            south = eta[n - width]
        elif share[2] >= 0:
            south = share[2] * E
            if ti.static(radiating):
                south = south - resistance[m] * V_here
        if row == rows - 1 and share[3] >= 0:
            north = share[3] * E
            if ti.static(radiating):
                north = north + resistance[width + m] * V_here
        if ti.static(sponge):
            U[n] = a * kept[m] * U_here - Cx[c] * (east - west)
            V[n] = a * kept[2 * width + row * LANES + lane] * V_here - Cy[c] * (north - south)
        else:
            U[n] = a * U_here - Cx[c] * (east - west)
            V[n] = a * V_here - Cy[c] * (north - south)


@ti.kernel
def elevations(
    eta: numbers,
    U: numbers,
    V: numbers,
    kept: numbers,
    blocks: ti.i32,
    rows: ti.i32,
    W: ti.i32,
    strips: ti.template(),
    sponge: ti.template(),
):
    """η ← η − δx U − δy V of the water, in place; arguments as for `transports`, `rows` of them in each block."""
    width = W * LANES
    for r, m in ti.ndrange(blocks * (rows - 1), width):
        row = r % (rows - 1)
        n = (r // (rows - 1) * rows + row) * width + m
        next_column = n + LANES
        if m >= width - LANES:  # the first column, in strips that of the next lane; the very last column is no water
            next_column = n + LANES - width
            if ti.static(strips):
                next_column += 1
        if ti.static(sponge):
            B = kept[width + m] * kept[2 * width + (rows + row) * LANES + m % LANES]
            eta[n] = B * eta[n] - (0.5 + 0.5 * B) * ((U[next_column] - U[n]) + (V[n + width] - V[n]))
        else:
            eta[n] = eta[n] - (U[next_column] - U[n]) - (V[n + width] - V[n])


class Cells:
    """The way of a GPU to advance a sea; arguments, attributes and methods as of `forward_backward.Bands`."""

    def __init__(self, packing: Packing, substeps: int) -> None:
        self._packing, self._substeps = packing, substeps
        self.rows = packing.ny + 1

    def plan(self, coefficient_row: np.ndarray) -> np.ndarray:
        """`coefficient_row` of `transports`."""
        return coefficient_row

    def launches(self, arrays: tuple[torch.Tensor, ...], plan: torch.Tensor, edges: Edges, keep: float) -> list[Launch]:
        """What makes an interval."""
        packing = self._packing
        arrays = tuple(array.view(-1) for array in arrays)
        grid = packing.blocks, packing.columns, packing.nx
        kinds = packing.strips, edges.radiating, edges.sponge
        water = packing.blocks, self.rows, packing.columns, packing.strips, edges.sponge
        second = Launch(elevations, *arrays[:3], arrays[-1], *water)
        first = (
            Launch(transports, *arrays, plan, edges.shares(), *grid, substep, keep, *kinds)
            for substep in range(self._substeps)
        )
        return [launch for step in first for launch in (step, second)]
