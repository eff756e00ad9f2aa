"""Shallow water forward–backward in time on a packed Arakawa C grid: the CPU backend, which marches bands of rows.

The layout of the fields is in `usvauv.kernels.shallow_water.discretisation`.
"""

import itertools
import math
from collections import namedtuple
from collections.abc import Sequence

import numpy as np
import taichi as ti
import torch

from usvauv.kernels import runtime
from usvauv.kernels.functions import Launch, func, kernel
from usvauv.kernels.shallow_water.discretisation import (
    EAST,
    LANES,
    NORTH,
    SOUTH,
    WEST,
    BasinBoundaries,
    Packing,
    vector,
    vectors,
)
from usvauv.kernels.shallow_water.forcing import (
    Forcing,
    Waves,
    double_vectors,
    intervals_of_period,
    tabulate,
)
from usvauv.kernels.types import columns, double1, index1, index3, select, vec4

# Compile-time options: whether lanes are strips of one sea, any boundary radiates, the calling thread marches all
# bands, and whether it makes all copies.
Options = namedtuple("Options", "strips radiating serial copy_serially", defaults=(False, False))
# Arguments of a kernel that its functions share, as `march` describes them.
LinearBasin = namedtuple("LinearBasin", "eta U V Cx Cy resistance elevation_factor W nx ny a options")
# Vectors at which the row to advance, the row south of it and its coefficients begin.
Row = namedtuple("Row", "north south coefficients")

# Rows of the table of a band: for each of its rows from south to north the row of the packed field, the row of the
# basin it holds (a copy, if the two differ) and the row of coefficients; last the extent of the band.
BandTable = columns("packed", "source", "coefficients", "extent")
Extent = columns("rows", "copied_south", "copied_north")  # number of rows; whether a neighbour's lie south and north

# Rough costs that decide how a launch is cut, in s: waking the threads, one cell and substep, fetching a cell from
# memory, copying a cell. CACHE is the state that a wavefront may hold, half of a common second-level cache, bytes.
WAKE, CELL, FETCH, COPY, CACHE = 1e-4, 2e-10, 5e-10, 2e-10, 512 * 1024


@kernel
def march(
    eta: vectors,
    U: vectors,
    V: vectors,
    Cx: vectors,
    Cy: vectors,
    prescribed: vectors,
    resistance: vectors,
    amplitude: vectors,
    frequency: double_vectors,
    phase: double_vectors,
    clock: double1,
    interval: index1,
    outside: index1,
    bands: index3,
    elevation_factor: vec4,
    blocks: ti.i32,
    W: ti.i32,
    nx: ti.i32,
    ny: ti.i32,
    first: ti.i32,
    substeps: ti.i32,
    every: ti.i32,
    time_step: ti.f64,
    a: ti.f32,
    largest: ti.f32,
    options: ti.template(),
):
    """Substeps `first` to `first + substeps − 1` of an interval, in place.

    U ← a U − Cx δx η,  V ← a V − Cy δy η,  η ← η − δx U − δy V.

    One thread marches a band of rows as a wavefront: each substep works one row behind the substep before it, so that a
    row is fetched once for all of them. Around a band lie copies of its neighbours' rows; each substep
    invalidates one. No value depends on how the rows are cut into bands, or on the number of threads.

    At an open boundary the outer cell is given the elevation E ± R U, with the transport U before the substep:
    prescribed with R = 0; with 1/R the celerity of waves (and the fitting C) waves leave (`ShallowWater`).

    Arrays have one axis and their indices are written out: Taichi computes the index into several axes again for each
    element, which costs up to half the speed.

    Args:
        eta, U, V: each (blocks, rows, W), m.
        Cx, Cy: (rows of coefficients, W): g h (Δt/Δx)²/(1 + r Δt/2) at western and southern faces, where equal rows may
            be stored once.
        prescribed: (blocks, bands, substeps of a period), prescribed elevation, m; made here as a period begins.
        resistance: R of the faces south (W,) and north (W,), west (ny + 1,) and east (ny + 1,); read if
            `options.radiating`.
        amplitude, frequency, phase, clock, interval: of `usvauv.kernels.shallow_water.forcing.Waves`.
        outside: (1,), set to 1 if an elevation is not finite or beyond ±`largest`.
        bands: (bands, 4, longest), the table `BandTable` of each band.
        elevation_factor: factor on the prescribed elevation for each side (west, east, south, north); −1 for a wall.
        nx, ny: columns and rows of water.
        every: substeps of an interval.
        time_step: Δt, s.
        a: (1 − r Δt/2)/(1 + r Δt/2).
        options: see `Options`.
    """
    basin = ti.static(LinearBasin(eta, U, V, Cx, Cy, resistance, elevation_factor, W, nx, ny, a, options))
    rows = eta.shape[0] // (blocks * W)
    tasks = blocks * bands.shape[0]
    table = prescribed.shape[0] // tasks
    ti.loop_config(block_dim=1, serialize=options.copy_serially)
    for task in range(tasks):
        band = task % bands.shape[0]
        for k in range(bands[band, BandTable.extent, Extent.rows]):
            target = (task // bands.shape[0] * rows + bands[band, BandTable.packed, k]) * W
            source = (task // bands.shape[0] * rows + bands[band, BandTable.source, k]) * W
            if target != source:
                for n in range(W):
                    eta[target + n] = eta[source + n]
                    U[target + n] = U[source + n]
                    V[target + n] = V[source + n]
    ti.loop_config(block_dim=1, serialize=options.serial)
    for task in range(tasks):
        band = task % bands.shape[0]
        block = task // bands.shape[0]
        count = bands[band, BandTable.extent, Extent.rows]
        copied_south = bands[band, BandTable.extent, Extent.copied_south]
        copied_north = bands[band, BandTable.extent, Extent.copied_north]
        west_lanes = lane_mask(LANES - 1, options.strips)
        east_lanes = lane_mask(nx // W, options.strips)
        if interval[0] < 0 and first == 0:
            waves = ti.static(Waves(amplitude, frequency, phase, clock, interval))
            tabulate(waves, block, blocks, 0, table, time_step, prescribed, task * table)
        given = task * table + ti.max(interval[0], -1 - interval[0]) * every + first
        for front in range(1, count + substeps - 1):
            for s in range(substeps):
                k = front - s
                if k > s * copied_south and k < count - s * copied_north:
                    north = (block * rows + bands[band, BandTable.packed, k]) * W
                    south = (block * rows + bands[band, BandTable.packed, k - 1]) * W
                    c = bands[band, BandTable.coefficients, k] * W
                    source = bands[band, BandTable.source, k]
                    E = prescribed[given + s]
                    set_west_and_east(basin, north, source, E, west_lanes, east_lanes)
                    if k == 1 and copied_south == 0:
                        set_row_outside(basin, SOUTH, south, north, E)
                    if k == count - 1 and copied_north == 0:
                        set_row_outside(basin, NORTH, north, north, E)
                    advance_row(basin, ti.static(Row(north, south, c)))
        inside = vector(1.0)
        for k in range(count):
            if bands[band, BandTable.packed, k] == bands[band, BandTable.source, k]:
                row = (block * rows + bands[band, BandTable.packed, k]) * W
                for n in range(row, row + W):
                    inside = select(eta[n] * eta[n] <= largest * largest, inside, vector(0.0))
        if inside.sum() < LANES:
            outside[0] = 1


@func
def set_west_and_east(
    basin: ti.template(), first: ti.i32, row: ti.i32, E: vector, west_lanes: vector, east_lanes: vector
):
    """Give the outer cells at both ends of a row of the basin, which begins at `first`, the elevation outside."""
    W = basin.W
    if basin.elevation_factor[WEST] >= 0:
        n = first + W - 1
        transport = from_lane_above(basin.U[first], basin.options.strips)
        outside = elevation_outside(basin, WEST, E, 2 * W + row, transport)
        basin.eta[n] = west_lanes * outside + (1.0 - west_lanes) * basin.eta[n]
    if basin.elevation_factor[EAST] >= 0:
        n = first + basin.nx
        if ti.static(basin.options.strips):
            n = first + basin.nx % W
        outside = elevation_outside(basin, EAST, E, 2 * W + basin.ny + 1 + row, basin.U[n])
        basin.eta[n] = east_lanes * outside + (1.0 - east_lanes) * basin.eta[n]


@func
def set_row_outside(basin: ti.template(), side: ti.template(), outer: ti.i32, faces: ti.i32, E: vector):
    """Give the outer row south or north of the basin, which begins at `outer`, the elevation outside."""
    if basin.elevation_factor[side] >= 0:
        for j in range(basin.W):
            n = (side - SOUTH) * basin.W + j
            basin.eta[outer + j] = elevation_outside(basin, side, E, n, basin.V[faces + j])


@func
def elevation_outside(basin: ti.template(), side: ti.template(), E, n: ti.i32, transport):
    """Elevation that the outer cell of an open boundary is given, from the transport through face n of `resistance`."""
    outside = basin.elevation_factor[side] * E
    if ti.static(basin.options.radiating and side in (WEST, SOUTH)):
        outside = outside - basin.resistance[n] * transport
    if ti.static(basin.options.radiating and side in (EAST, NORTH)):
        outside = outside + basin.resistance[n] * transport
    return outside


@func
def advance_row(basin: ti.template(), row: ti.template()):
    """One substep of the transports of the northern row and then of the elevation of the southern one."""
    W = basin.W
    west = from_lane_below(basin.eta[row.north + W - 1], basin.options.strips)
    U_first = basin.U[row.south]
    U_wrapped = from_lane_above(U_first, basin.options.strips)
    U_west = U_first
    for j in range(W - 1):
        U_east = basin.U[row.south + j + 1]
        west = advance_cell(basin, row, j, west, U_west, U_east)
        U_west = U_east
    advance_cell(basin, row, W - 1, west, U_west, U_wrapped)


@func
def advance_cell(basin: ti.template(), row: ti.template(), j: ti.i32, west: vector, U_west: vector, U_east: vector):
    """Column j of `advance_row`; returns the elevation in the northern row, the western one of the next column."""
    eta, U, V = ti.static(basin.eta, basin.U, basin.V)
    n = row.north + j
    m = row.south + j
    c = row.coefficients + j
    here = eta[n]
    below = eta[m]
    V_south = V[m]
    U_here = basin.a * U[n] - basin.Cx[c] * (here - west)
    V_north = basin.a * V[n] - basin.Cy[c] * (here - below)
    U[n] = U_here
    V[n] = V_north
    eta[m] = below - (U_east - U_west) - (V_north - V_south)
    return here


@func
def from_lane_below(v: vector, strips: ti.template()) -> vector:
    """The vector west of the first column: in strips, lane l lies east of lane l − 1."""
    shifted = v
    if ti.static(strips):
        for lane in ti.static(range(LANES)):
            shifted[lane] = v[(lane - 1) % LANES]
    return shifted


@func
def from_lane_above(v: vector, strips: ti.template()) -> vector:
    """The vector east of the last column."""
    shifted = v
    if ti.static(strips):
        for lane in ti.static(range(LANES)):
            shifted[lane] = v[(lane + 1) % LANES]
    return shifted


@func
def lane_mask(only: ti.i32, strips: ti.template()) -> vector:
    """One in the lane `only` and zero elsewhere in strips; one in all lanes of a pool."""
    mask = vector(1.0)
    if ti.static(strips):
        for lane in ti.static(range(LANES)):
            mask[lane] = ti.cast(lane == only, ti.f32)
    return mask


class WavefrontBackend:
    """CPU backend: bands of rows, a thread each, several substeps a launch.

    Args:
        packing: of the fields.
        interval, substeps: time of an interval, s, and its substeps.
        largest: elevation, m.
        threads: CPU threads.

    Attributes:
        rows: rows of the packed fields, copies included.
        table: rows and substeps of the table of prescribed elevations.
    """

    def __init__(self, packing: Packing, interval: float, substeps: int, largest: float, threads: int) -> None:
        self._packing, self._time_step, self._substeps, self._largest = packing, interval / substeps, substeps, largest
        blocks, columns = packing.blocks, packing.columns
        self._tile, self._bands, self.rows = plan_bands(packing.ny, columns, blocks, substeps, threads)
        copies = np.count_nonzero(self._bands[:, BandTable.packed] != self._bands[:, BandTable.source]) * blocks
        cells = blocks * (packing.ny + 1) * columns * LANES
        alone = cells * (FETCH + substeps * CELL) < WAKE / 2
        # Done before another thread wakes up.
        self._copy_serially = copies * LANES * columns * COPY < WAKE
        self._serial = alone or blocks * len(self._bands) == 1
        self.table = blocks * len(self._bands), intervals_of_period(interval) * substeps
        self._outside = torch.zeros(1, dtype=torch.int32, device="cpu")
        self._seen = self._outside.numpy()

    def launches(
        self,
        arrays: Sequence[torch.Tensor],
        forcing: Forcing,
        coefficient_row: np.ndarray,
        boundaries: BasinBoundaries,
        a: float,
    ) -> list[Launch]:
        """Kernel launches of one interval.

        Args:
            arrays: η, U, V, Cx, Cy, prescribed elevation and resistance of `march`, each (…, LANES).
            forcing: of the seas.
            coefficient_row: (ny + 1,), the row of coefficients of each row of the basin.
            boundaries: of the basin.
            a: factor on the transports, of `march`.
        """
        packing, bands = self._packing, self._bands.copy()
        bands[:, BandTable.coefficients] = coefficient_row[bands[:, BandTable.coefficients]]
        count = math.ceil(self._substeps / self._tile)
        ends = [self._substeps * n // count for n in range(count + 1)]
        table = torch.tensor(bands, device=arrays[0].device)
        fixed = *(array.view(-1, LANES) for array in arrays), *forcing.waves, self._outside, table
        fixed = *fixed, boundaries.elevation_factors()
        grid = packing.blocks, packing.columns, packing.nx, packing.ny
        options = Options(packing.strips, boundaries.radiating, self._serial, self._copy_serially)
        settings = runtime.vectors_in_registers()
        numbers = self._substeps, self._time_step, a, self._largest, options
        return [
            Launch(march, *fixed, *grid, first, last - first, *numbers, settings=settings)
            for first, last in itertools.pairwise(ends)
        ]

    def exceeded(self) -> bool:
        """Whether an elevation has been beyond `largest` since `forget`."""
        return bool(self._seen[0])

    def forget(self) -> None:
        """Forget elevations seen so far."""
        self._seen[0] = 0


def plan_bands(ny: int, columns: int, blocks: int, substeps: int, threads: int) -> tuple[int, np.ndarray, int]:
    """Cut the rows of a packed field into bands so that every thread has one, and choose the substeps of a launch.

    Args:
        ny: rows of cells.
        columns, blocks: columns W and blocks of the packed field.
        substeps: substeps wanted.
        threads: CPU threads.

    Returns:
        the number of substeps in a launch, `bands` of `march` (each row's source in place of its row of coefficients),
        and the number of rows of the packed field.
    """
    cells_in_row = LANES * columns
    most_bands, longest = math.ceil(threads / blocks), max(2, CACHE // (3 * 4 * cells_in_row))

    def seconds(choice: tuple[int, int]) -> float:
        """Time of an interval. With several bands, rows next to a neighbour are copied, and half of them marched."""
        bands, tile = choice
        rows = (ny + 1) / bands + tile / 2 * min(bands - 1, 2)
        turns = math.ceil(blocks * bands / threads)
        copies = min(WAKE, 2 * tile * (bands - 1) * blocks * cells_in_row * COPY)
        wake = 0 if blocks * bands == 1 else WAKE
        return math.ceil(substeps / tile) * (turns * rows * cells_in_row * (FETCH + tile * CELL) + copies + wake)

    bands, tile = min(itertools.product(range(1, most_bands + 1), range(1, min(longest, substeps) + 1)), key=seconds)
    free = ny + 1  # the first row of the packed field that is not yet in use
    table = np.zeros((bands, len(BandTable.names), ny + 2), np.int32)
    for band in range(bands):
        first, last = ((ny + 1) * n // bands for n in (band, band + 1))
        low, high = max(first - tile, 0), min(last + tile, ny + 1)
        row = np.arange(low, high)
        copied = (row < first) | (row >= last)
        packed = np.where(copied, free - 1 + np.cumsum(copied), row)
        source = row
        free += np.count_nonzero(copied)
        if low == 0:  # the row south of the basin
            packed, source, row = np.append(free, packed), np.append(free, source), np.append(0, row)
            free += 1
        table[band, : BandTable.extent, : len(row)] = packed, source, row
        table[band, BandTable.extent, : len(Extent.names)] = len(row), low > 0, high <= ny
    return tile, table, int(free)
