"""Shallow water forward–backward in time on a packed Arakawa C grid (layout: `kernels.shallow_water.packing`)."""

import itertools
import math

import numpy as np
import taichi as ti
import torch

from kernels import runtime
from kernels.launch import Launch
from kernels.shallow_water.boundaries import Edges
from kernels.shallow_water.packing import LANES, Packing

vector = ti.types.vector(LANES, ti.f32)
vectors = ti.types.ndarray(dtype=vector, ndim=1)
integers = ti.types.ndarray(dtype=ti.i32, ndim=3)
sides = ti.types.vector(4, ti.f32)  # west, east, south, north

# Rough costs that decide how a launch is cut, in s: of waking the threads, of a cell and substep, of fetching a cell
# from memory and of copying it; and the bytes of state that a wavefront may keep warm, half of a common second-level
# cache.
WAKE, CELL, FETCH, COPY, CACHE = 1e-4, 2e-10, 5e-10, 2e-10, 512 * 1024


@ti.kernel
def march(
    eta: vectors,
    U: vectors,
    V: vectors,
    Cx: vectors,
    Cy: vectors,
    edge_elevation: vectors,
    resistance: vectors,
    kept: vectors,
    plan: integers,
    share: sides,
    blocks: ti.i32,
    W: ti.i32,
    nx: ti.i32,
    first: ti.i32,
    substeps: ti.i32,
    a: ti.f32,
    strips: ti.template(),
    radiating: ti.template(),
    sponge: ti.template(),
    serial: ti.template(),
    copy_serially: ti.template(),
):
    """Substeps `first` to `first + substeps − 1` of an interval, in place.

    U ← a U − Cx δx η,  V ← a V − Cy δy η,  η ← η − δx U − δy V.

    One thread marches a band of rows as a wavefront: each substep works one row behind the substep before it, so that a
    row is fetched once for all of them. Around a band lie copies of its neighbours' rows, of which every substep spoils
    one. No value depends on how the rows are cut into bands, or on the number of threads.

    At an open edge the outer cell is given the elevation E ± R U, with the transport U before the substep: prescribed
    with R = 0, and with 1/R the celerity of waves (and the fitting C) a passage for waves that leave (`ShallowWater`).

    In a sponge U and V keep shares Fx a and Fy a, and η ← B η − ½ (1 + B) (δx U + δy V), B = Gx Gy.

    Arrays are indexed by hand: Taichi works out the index of an array of several axes anew for every element, which
    costs up to half the speed.

    Args:
        eta, U, V: each (blocks, rows, W), m.
        Cx, Cy: (rows of coefficients, W): g h (Δt/Δx)²/(1 + r Δt/2) at western and southern faces, where rows that are
            equal may stand once.
        edge_elevation: (blocks, substeps of the interval), prescribed elevation, m.
        resistance: R of the faces south (W,) and north (W,), west (ny + 1,) and east (ny + 1,); anything if `radiating`
            is false.
        kept: Fx (W,), Gx (W,), Fy (ny + 1,) and Gy (ny + 1,); anything if `sponge` is false.
        plan: (bands, 4, longest): for each row k of a band from south to north its place in `eta`, the row it is a
            copy of (or its place), and its row of coefficients; last (number of rows, 1 if rows of a neighbour lie
            south, the same for north).
        share: E over the prescribed elevation on each side; negative for walls.
        nx: columns of water.
        a: (1 − r Δt/2)/(1 + r Δt/2).
        strips: whether lanes are strips of one sea.
        radiating: whether any R is above 0.
        sponge: whether anything is kept less than whole.
        serial: whether the calling thread does all tasks.
        copy_serially: whether it makes the copies.
    """
    bands = plan.shape[0]
    rows = eta.shape[0] // (blocks * W)
    table = edge_elevation.shape[0] // blocks
    ny = 0
    if ti.static(radiating):
        ny = (resistance.shape[0] - 2 * W) // 2 - 1
    if ti.static(sponge):
        ny = (kept.shape[0] - 2 * W) // 2 - 1
    east_column = nx
    east_lane = -1
    west_lane = -1
    if ti.static(strips):
        east_lane = nx // W
        east_column = nx % W
        west_lane = LANES - 1
    ti.loop_config(block_dim=1, serialize=copy_serially)
    for task in range(blocks * bands):
        band = task % bands
        for k in range(plan[band, 3, 0]):
            target = (task // bands * rows + plan[band, 0, k]) * W
            source = (task // bands * rows + plan[band, 1, k]) * W
            if target != source:
                for n in range(W):
                    eta[target + n] = eta[source + n]
                    U[target + n] = U[source + n]
                    V[target + n] = V[source + n]
    ti.loop_config(block_dim=1, serialize=serial)
    for task in range(blocks * bands):
        band = task % bands
        block = task // bands
        count = plan[band, 3, 0]
        copied_south = plan[band, 3, 1]
        copied_north = plan[band, 3, 2]
        west_lanes = only_lane(west_lane)
        east_lanes = only_lane(east_lane)
        for front in range(1, count + substeps - 1):
            for s in range(substeps):
                k = front - s
                if k > s * copied_south and k < count - s * copied_north:
                    north = (block * rows + plan[band, 0, k]) * W
                    south = (block * rows + plan[band, 0, k - 1]) * W
                    row = plan[band, 1, k]
                    prescribed = edge_elevation[block * table + first + s]
                    if share[0] >= 0:
                        n = north + W - 1
                        outside = share[0] * prescribed
                        if ti.static(radiating):
                            outside = outside - resistance[2 * W + row] * from_lane_above(U[north], strips)
                        eta[n] = west_lanes * outside + (1.0 - west_lanes) * eta[n]
                    if share[1] >= 0:
                        n = north + east_column
                        outside = share[1] * prescribed
                        if ti.static(radiating):
                            outside = outside + resistance[2 * W + ny + 1 + row] * U[n]
                        eta[n] = east_lanes * outside + (1.0 - east_lanes) * eta[n]
                    if share[2] >= 0 and k == 1 and copied_south == 0:
                        for j in range(W):
                            outside = share[2] * prescribed
                            if ti.static(radiating):
                                outside = outside - resistance[j] * V[north + j]
                            eta[south + j] = outside
                    if share[3] >= 0 and k == count - 1 and copied_north == 0:
                        for j in range(W):
                            outside = share[3] * prescribed
                            if ti.static(radiating):
                                outside = outside + resistance[W + j] * V[north + j]
                            eta[north + j] = outside
                    c = plan[band, 2, k] * W
                    kept_V = vector(1.0)
                    kept_eta = vector(1.0)
                    if ti.static(sponge):
                        kept_V = kept[2 * W + row]
                        kept_eta = kept[2 * W + ny + 1 + ti.min(plan[band, 1, k - 1], ny)]
                    advance_row(eta, U, V, Cx, Cy, kept, north, south, c, W, a, kept_V, kept_eta, strips, sponge)


@ti.func
def advance_row(
    eta: ti.template(),
    U: ti.template(),
    V: ti.template(),
    Cx: ti.template(),
    Cy: ti.template(),
    kept: ti.template(),
    north: ti.i32,
    south: ti.i32,
    c: ti.i32,
    W: ti.i32,
    a: ti.f32,
    kept_V: vector,
    kept_eta: vector,
    strips: ti.template(),
    sponge: ti.template(),
):
    """One substep of the transports of the row at `north` and then of the elevation of the row at `south` below it."""
    west = from_lane_below(eta[north + W - 1], strips)
    U_first = U[south]
    U_wrapped = from_lane_above(U_first, strips)
    U_west = U_first
    for j in range(W - 1):
        U_east = U[south + j + 1]
        west = advance_cell(
            eta, U, V, Cx, Cy, kept, north, south, c, j, W, a, kept_V, kept_eta, west, U_west, U_east, sponge
        )
        U_west = U_east
    j = W - 1
    advance_cell(eta, U, V, Cx, Cy, kept, north, south, c, j, W, a, kept_V, kept_eta, west, U_west, U_wrapped, sponge)


@ti.func
def advance_cell(
    eta: ti.template(),
    U: ti.template(),
    V: ti.template(),
    Cx: ti.template(),
    Cy: ti.template(),
    kept: ti.template(),
    north: ti.i32,
    south: ti.i32,
    c: ti.i32,
    j: ti.i32,
    W: ti.i32,
    a: ti.f32,
    kept_V: vector,
    kept_eta: vector,
    west: vector,
    U_west: vector,
    U_east: vector,
    sponge: ti.template(),
) -> vector:
    """Column j of `advance_row`; returns the elevation in the row at `north`, the western one of the next column."""
    n = north + j
    m = south + j
    here = eta[n]
    below = eta[m]
    V_south = V[m]
    if ti.static(sponge):
        B = kept[W + j] * kept_eta
        U[n] = a * kept[j] * U[n] - Cx[c + j] * (here - west)
        V_north = a * kept_V * V[n] - Cy[c + j] * (here - below)
        V[n] = V_north
        eta[m] = B * below - (0.5 + 0.5 * B) * ((U_east - U_west) + (V_north - V_south))
    else:
        U_here = a * U[n] - Cx[c + j] * (here - west)
        V_north = a * V[n] - Cy[c + j] * (here - below)
        U[n] = U_here
        V[n] = V_north
        eta[m] = below - (U_east - U_west) - (V_north - V_south)
    return here


@ti.func
def from_lane_below(v: vector, strips: ti.template()) -> vector:
    """The vector west of the first column: in strips, lane l lies east of lane l − 1."""
    shifted = v
    if ti.static(strips):
        for lane in ti.static(range(LANES)):
            shifted[lane] = v[(lane - 1) % LANES]
    return shifted


@ti.func
def from_lane_above(v: vector, strips: ti.template()) -> vector:
    """The vector east of the last column."""
    shifted = v
    if ti.static(strips):
        for lane in ti.static(range(LANES)):
            shifted[lane] = v[(lane + 1) % LANES]
    return shifted


@ti.func
def only_lane(lane: ti.i32) -> vector:
    """One in a lane, or in all if it is −1, and zero elsewhere."""
    mask = vector(0.0)
    for other in ti.static(range(LANES)):
        mask[other] = ti.cast(lane == -1 or lane == other, ti.f32)
    return mask


class Bands:
    """The way of a CPU to advance a sea: bands of rows, a thread each, several substeps a launch.

    Args:
        packing: of the fields.
        substeps: of an interval.
        threads: CPU threads.

    Attributes:
        rows: of the packed fields in all.
    """

    def __init__(self, packing: Packing, substeps: int, threads: int) -> None:
        self._packing, self._substeps = packing, substeps
        blocks, columns = packing.blocks, packing.columns
        self._tile, self._plan, self.rows = plan_bands(packing.ny, columns, blocks, substeps, threads)
        copies = np.count_nonzero(self._plan[:, 0] != self._plan[:, 1]) * blocks
        self._copy_serially = copies * LANES * columns * COPY < WAKE  # sooner than others wake up

    def plan(self, coefficient_row: np.ndarray) -> np.ndarray:
        """`plan` of `march`, for the row of coefficients of each row (ny + 1,)."""
        plan = self._plan.copy()
        plan[:, 2] = coefficient_row[plan[:, 2]]
        return plan

    def launches(self, arrays: tuple[torch.Tensor, ...], plan: torch.Tensor, edges: Edges, keep: float) -> list[Launch]:
        """What makes an interval.

        Args:
            arrays: η, U, V, Cx, Cy, the prescribed elevation, `resistance` and `kept` of `march`, each (…, LANES).
            plan: as tensor on the device.
            edges: of the basin.
            keep: a of `march`.
        """
        packing = self._packing
        count = math.ceil(self._substeps / self._tile)
        ends = [self._substeps * n // count for n in range(count + 1)]
        fixed = *(array.view(-1, LANES) for array in arrays), plan, edges.shares()
        grid = packing.blocks, packing.columns, packing.nx
        kinds = packing.strips, edges.radiating, edges.sponge
        serially = packing.blocks * len(plan) == 1, self._copy_serially
        with runtime.vectors_in_registers():
            return [
                Launch(march, *fixed, *grid, first, last - first, keep, *kinds, *serially)
                for first, last in itertools.pairwise(ends)
            ]


def plan_bands(ny: int, columns: int, blocks: int, substeps: int, threads: int) -> tuple[int, np.ndarray, int]:
    """Cut the rows of a packed field into bands so that every thread has one, and choose how far a launch goes.

    Args:
        ny: rows of cells.
        columns, blocks: columns W and blocks of the packed field.
        substeps: substeps wanted.
        threads: CPU threads.

    Returns:
        the number of substeps in a launch, `plan` of `march` (with the row itself in place of its row of coefficients),
        and the rows of the packed field in all.
    """
    cells_in_row = LANES * columns
    most_bands, longest = math.ceil(threads / blocks), max(2, CACHE // (3 * 4 * cells_in_row))

    def seconds(choice: tuple[int, int]) -> float:
        """Of an interval. With more than one band, rows next to a neighbour are copied and half of them marched."""
        bands, tile = choice
        rows = (ny + 1) / bands + tile / 2 * min(bands - 1, 2)
        turns = math.ceil(blocks * bands / threads)
        copies = min(WAKE, 2 * tile * (bands - 1) * blocks * cells_in_row * COPY)
        wake = 0 if blocks * bands == 1 else WAKE
        return math.ceil(substeps / tile) * (turns * rows * cells_in_row * (FETCH + tile * CELL) + copies + wake)

    bands, tile = min(itertools.product(range(1, most_bands + 1), range(1, min(longest, substeps) + 1)), key=seconds)
    free = ny + 1  # the first row without a use
    plan = np.zeros((bands, 4, ny + 2), np.int32)
    for band in range(bands):
        first, last = ((ny + 1) * n // bands for n in (band, band + 1))
        low, high = max(first - tile, 0), min(last + tile, ny + 1)
        row = np.arange(low, high)
        copied = (row < first) | (row >= last)
        place = np.where(copied, free - 1 + np.cumsum(copied), row)
        source = row
        free += np.count_nonzero(copied)
        if low == 0:  # the row south of the basin
            place, source, row = np.append(free, place), np.append(free, source), np.append(0, row)
            free += 1
        plan[band, :3, : len(row)] = place, source, row
        plan[band, 3, :3] = len(row), low > 0, high <= ny
    return tile, plan, free
