"""Shallow water forward–backward in time with a thread for each cell: the GPU backend.

The same sums in the same order on the same packed fields as in `usvauv.kernels.shallow_water.wavefront`, in two
launches a substep: all transports, then all elevations. Neighbouring threads work on neighbouring numbers. A wavefront
has too few threads for a GPU.
"""

from collections.abc import Sequence

import numpy as np
import taichi as ti
import torch

from usvauv.kernels import runtime
from usvauv.kernels.functions import DeviceArray, DeviceFlag, Launch, kernel
from usvauv.kernels.shallow_water.discretisation import (
    EAST,
    LANES,
    NORTH,
    SOUTH,
    WEST,
    BasinBoundaries,
    Packing,
    vectors,
)
from usvauv.kernels.shallow_water.forcing import Forcing, Waves, double_vectors, tabulate
from usvauv.kernels.shallow_water.wavefront import LinearBasin, Options, elevation_outside
from usvauv.kernels.types import array1, double1, index1, vec4


@kernel
def prescribe(
    amplitude: vectors,
    frequency: double_vectors,
    phase: double_vectors,
    clock: double1,
    interval: index1,
    time_step: ti.f64,
    blocks: ti.i32,
    prescribed: vectors,
):
    """Elevations (blocks, substeps) that the seas are given in the present interval, of `forcing.Waves`."""
    waves = ti.static(Waves(amplitude, frequency, phase, clock, interval))
    substeps = prescribed.shape[0] // blocks
    for block in range(blocks):
        first = ti.max(interval[0], -1 - interval[0]) * substeps
        tabulate(waves, block, blocks, first, substeps, time_step, prescribed, block * substeps)


@kernel
def transports(
    eta: array1,
    U: array1,
    V: array1,
    Cx: array1,
    Cy: array1,
    prescribed: array1,
    resistance: array1,
    coefficient_row: index1,
    elevation_factor: vec4,
    blocks: ti.i32,
    W: ti.i32,
    nx: ti.i32,
    ny: ti.i32,
    substep: ti.i32,
    a: ti.f32,
    options: ti.template(),
):
    """U ← a U − Cx δx η and V ← a V − Cy δy η, in place; at an open boundary η outside is E ± R U.

    Args:
        coefficient_row: (ny + 1,), the row of coefficients of each row.
        substep: of the interval, which `prescribed` is read at.

    All else is what `wavefront.march` takes, its vectors' numbers one after the other.
    """
    basin = ti.static(LinearBasin(eta, U, V, Cx, Cy, resistance, elevation_factor, W, nx, ny, a, options))
    rows = ny + 1
    width = W * LANES
    table = prescribed.shape[0] // (blocks * LANES)
    for task in range(blocks * rows * width):
        r = task // width
        m = task % width
        row = r % rows
        lane = m % LANES
        column = m // LANES
        if ti.static(options.strips):
            column += lane * W
        n = r * width + m
        c = coefficient_row[row] * width + m
        E = prescribed[(r // rows * table + substep) * LANES + lane]
        U_here = U[n]
        V_here = V[n]
        east = eta[n]
        north = eta[n]
        west = 0.0
        south = 0.0
        if column > 0:
            west = eta[n - LANES if m >= LANES else n + width - LANES - 1]
        elif elevation_factor[WEST] >= 0:
            west = elevation_outside(basin, WEST, E, 2 * width + row * LANES + lane, U_here)
        if column == nx and elevation_factor[EAST] >= 0:
            east = elevation_outside(basin, EAST, E, 2 * width + (rows + row) * LANES + lane, U_here)
        if row > 0:
            south = eta[n - width]
        elif elevation_factor[SOUTH] >= 0:
            south = elevation_outside(basin, SOUTH, E, m, V_here)
        if row == ny and elevation_factor[NORTH] >= 0:
            north = elevation_outside(basin, NORTH, E, width + m, V_here)
        U[n] = a * U_here - Cx[c] * (east - west)
        V[n] = a * V_here - Cy[c] * (north - south)


@kernel
def elevations(
    eta: array1,
    U: array1,
    V: array1,
    blocks: ti.i32,
    W: ti.i32,
    nx: ti.i32,
    ny: ti.i32,
    options: ti.template(),
):
    """η ← η − δx U − δy V of the water, in place; arguments as for `transports`. Outer columns stay as they are."""
    width = W * LANES
    rows = ny + 1
    for task in range(blocks * ny * width):
        r = task // width
        m = task % width
        column = m // LANES
        if ti.static(options.strips):
            column += m % LANES * W
        if column >= nx:
            continue
        row = r % ny
        n = (r // ny * rows + row) * width + m
        next_column = n + LANES
        if m >= width - LANES:  # the first column of the next lane: only strips have water there
            next_column = n + LANES - width
            if ti.static(options.strips):
                next_column += 1
        eta[n] = eta[n] - (U[next_column] - U[n]) - (V[n + width] - V[n])


class CellwiseBackend:
    """GPU backend; arguments, attributes and methods as of `wavefront.WavefrontBackend`."""

    def __init__(self, packing: Packing, interval: float, substeps: int, largest: float) -> None:
        self._packing, self._time_step, self._substeps, self._largest = packing, interval / substeps, substeps, largest
        self.rows = packing.ny + 1
        self.table = packing.blocks, substeps
        self._flag: DeviceFlag | None = None

    def launches(
        self,
        arrays: Sequence[torch.Tensor | DeviceArray],
        forcing: Forcing,
        coefficient_row: np.ndarray,
        boundaries: BasinBoundaries,
        a: float,
    ) -> list[Launch]:
        """Kernel launches of one interval."""
        packing = self._packing
        self._flag = DeviceFlag(arrays[0], self._largest)
        prescribed = arrays[5].view(-1, LANES)
        arrays = [array.view(-1) for array in arrays]
        table = torch.tensor(coefficient_row, device=runtime.start().device)
        blocks, W, nx, ny = packing.blocks, packing.columns, packing.nx, packing.ny
        options = Options(packing.strips, boundaries.radiating)
        fixed = *arrays, table, boundaries.elevation_factors(), blocks, W, nx, ny
        second = Launch(elevations, *arrays[:3], blocks, W, nx, ny, options)
        first = (Launch(transports, *fixed, substep, a, options) for substep in range(self._substeps))
        given = Launch(prescribe, *forcing.waves, self._time_step, blocks, prescribed)
        return [given, *(launch for step in first for launch in (step, second))]

    def exceeded(self) -> bool:
        """Whether an elevation is beyond `largest`, or with CUDA was at the last call."""
        return self._flag is not None and self._flag.raised()

    def forget(self) -> None:
        """Forget elevations seen so far."""
        if self._flag:
            self._flag.forget()
