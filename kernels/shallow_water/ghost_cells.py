"""Ghost cells of the nonlinear solver: what its cells see beyond their lane and beyond the boundaries of the basin.

Fields D, u and v lie one after the other, twice (the state, and what a sweep along x makes of it), each of ny + 4 rows
of W + 4 vectors, with two ghosts all round. A lane holds W neighbouring columns of the basin, and those beyond as
ghosts. The first lane begins at the western boundary and the last one ends at the eastern one, so that lanes overlap
where W does not divide the columns: all lanes hold water, and columns held twice are equal to the last bit. The bed,
one field, lies likewise, mirrored beyond the boundaries.
"""

from collections import namedtuple

import taichi as ti

from usvauv.kernels.shallow_water.boundaries import SOUTH
from usvauv.kernels.shallow_water.packing import LANES
from usvauv.kernels.shallow_water.riemann import TINY
from usvauv.kernels.types import columns, vec2

WALL, RADIATING, FORCED, INCIDENT = range(4)

# Entries of the table `halo` for a ghost, the same in each row: its column and lane; the boundary beyond which it lies
# (−1 if it is a cell of another lane) and how many cells beyond; column and lane of the cell nearest to that boundary
# (or of the cell itself), and of the next nearest.
Halo = columns("column", "lane", "boundary", "layer", "first_column", "first_lane", "second_column", "second_lane")

# A ghost beyond a boundary: indices of the ghost and of the first and second cell inside (of the bed, less
# `bed_offset`); offsets of the velocities across and along the boundary; cells beyond the boundary (1 or 2), the sign
# of leaving water, and the length of the sweep over the size of a cell.
Ghost = namedtuple("Ghost", "at first second across along bed_offset layer outward r")


@ti.func
def vector_index(field: ti.i32, i: ti.i32, j: ti.i32, ny: ti.i32, W: ti.i32) -> ti.i32:
    """Index of row i and column j of a field: 0, 1, 2 for D, u, v, and 3, 4, 5 for those after a sweep along x."""
    return (field * (ny + 4) + i + 2) * (W + 4) + j + 2


@ti.func
def fill_row_ghosts(basin: ti.template(), i: ti.i32, r: ti.f32, tide: vec2):
    """The ghosts of row i of the state.

    Args:
        basin: see `usvauv.kernels.shallow_water.finite_volume.Basin`.
        i: the row.
        r: length of the sweep over the size of a cell, s/m.
        tide: prescribed elevation at the beginning of the sweep and at its end, m.
    """
    ny, W, cells, halo = ti.static((basin.ny, basin.W, basin.cells, basin.halo))
    size = (ny + 4) * (W + 4) * LANES
    row = vector_index(0, i, 0, ny, W)
    for n in range(halo.shape[0]):
        at = (row + halo[n, Halo.column]) * LANES + halo[n, Halo.lane]
        first = (row + halo[n, Halo.first_column]) * LANES + halo[n, Halo.first_lane]
        boundary = halo[n, Halo.boundary]
        if boundary < 0:
            for field in ti.static(range(3)):
                cells[at + field * size] = cells[first + field * size]
        else:
            second = (row + halo[n, Halo.second_column]) * LANES + halo[n, Halo.second_lane]
            layer = halo[n, Halo.layer]
            outward = 2.0 * ti.cast(boundary, ti.f32) - 1.0
            across = size
            along = 2 * size
            bed_offset = 0
            ghost = ti.static(Ghost(at, first, second, across, along, bed_offset, layer, outward, r))
            fill_ghost(basin, ghost, basin.boundaries[boundary], tide)


@ti.func
def fill_column_ghosts(basin: ti.template(), j: ti.i32, north: ti.i32, r: ti.f32, tide: vec2):
    """The southern (`north` 0) or northern (1) ghosts of column j after a sweep along x; others as above."""
    ny, W = ti.static((basin.ny, basin.W))
    size = (ny + 4) * (W + 4) * LANES
    edge = vector_index(3, north * (ny - 1), j, ny, W)
    inwards = (1 - 2 * north) * (W + 4)
    outward = 2.0 * ti.cast(north, ti.f32) - 1.0
    across = 2 * size
    along = size
    bed_offset = 3 * size
    for n in range(2 * LANES):
        layer = n // LANES + 1
        at = (edge - layer * inwards) * LANES + n % LANES
        first = edge * LANES + n % LANES
        second = (edge + inwards) * LANES + n % LANES
        ghost = ti.static(Ghost(at, first, second, across, along, bed_offset, layer, outward, r))
        fill_ghost(basin, ghost, basin.boundaries[SOUTH + north], tide)


@ti.func
def fill_ghost(basin: ti.template(), ghost: ti.template(), kind: ti.i32, tide: vec2):
    """A ghost beyond a boundary of a kind, from the first and the second cell inside."""
    if kind == WALL:
        fill_wall(basin, ghost)
    else:
        fill_open(basin, ghost, kind, tide)


@ti.func
def fill_wall(basin: ti.template(), ghost: ti.template()):
    """Wall: the mirror image."""
    cells = ti.static(basin.cells)
    mirror = ghost.first
    if ghost.layer == 2:
        mirror = ghost.second
    cells[ghost.at] = cells[mirror]
    cells[ghost.at + ghost.across] = -cells[mirror + ghost.across]
    cells[ghost.at + ghost.along] = cells[mirror + ghost.along]


@ti.func
def fill_open(basin: ti.template(), ghost: ti.template(), kind: ti.i32, tide: vec2):
    """Radiating, incident and forced: a state by the Riemann invariants that leave and that enter.

    With c0 of the still sea, c1 under the prescribed elevation and outward velocity u: u + 2 (c − c0) = R leaves, of
    surface and velocity continued from the two cells inside where both are flooded: linearly, but less the more the bed
    rises or falls between them. u − 2 (c − c0) enters: 0 from a still sea; −4 (c1 − c0) of a simple wave in still
    water; R − 4 (c1 − c0) where the boundary has that elevation. What is in a ghost arrives at the boundary later, so
    it has the elevation, and the R, of then. Water passes a forced boundary at most with the speed of waves: faster
    water would need other conditions.
    """
    cells, bed, g = ti.static((basin.cells, basin.bed_cells, basin.g))
    b = bed[ghost.at - ghost.bed_offset]
    b_1 = bed[ghost.first - ghost.bed_offset]
    b_2 = bed[ghost.second - ghost.bed_offset]
    h0 = ti.max(-b, 0.0)
    land = ti.max(b, 0.0)
    c0 = ti.sqrt(g * h0)
    u_1 = ghost.outward * cells[ghost.first + ghost.across]
    u_2 = ghost.outward * cells[ghost.second + ghost.across]
    eta_1 = cells[ghost.first] + ti.max(b_1, 0.0)
    eta_2 = cells[ghost.second] + ti.max(b_2, 0.0)
    leaving = u_1 + 2.0 * celerity_difference(cells[ghost.first], 0.0, ti.max(-b_1, 0.0), g)
    returning = leaving
    if ti.min(eta_1, eta_2) > ti.max(b_1, b_2) + basin.dry:
        even = ti.max(1.0 - ti.abs(b_1 - b_2) / ti.max(h0, basin.dry), 0.0)
        beyond = even * ti.cast(ghost.layer, ti.f32)
        within = even * (ti.cast(ghost.layer, ti.f32) - 1.0)
        eta = ti.max(eta_1 + beyond * (eta_1 - eta_2) - land, -h0)
        leaving = u_1 + beyond * (u_1 - u_2) + 2.0 * celerity_difference(eta, 0.0, h0, g)
        eta = ti.max(eta_1 + within * (eta_2 - eta_1) - land, -h0)
        returning = u_1 + within * (u_2 - u_1) + 2.0 * celerity_difference(eta, 0.0, h0, g)
    if kind != FORCED:
        returning = 0.0

    D = 0.0
    rise = 0.0
    if kind != RADIATING:
        D = ti.max(tide[0] - land, -h0)
        rise = celerity_difference(D, 0.0, h0, g)
        inward_speed = c0 - 0.25 * leaving - 0.75 * (returning - 4.0 * rise)
        later = (ti.cast(ghost.layer, ti.f32) - 0.5) / ti.max(ghost.r * inward_speed, 0.25)
        D = ti.max(tide[0] + later * (tide[1] - tide[0]) - land, -h0)
        rise = celerity_difference(D, 0.0, h0, g)
    entering = returning - 4.0 * rise
    excess = ti.max(0.25 * (leaving - entering), -c0)
    u = 0.5 * (leaving + entering)
    if kind == FORCED:
        u = ti.max(ti.min(u, c0 + excess), -c0 - excess)
    # D + (c² − c1²)/g, which is D itself where nothing moves.
    cells[ghost.at] = ti.max(D + (excess - rise) * (2.0 * c0 + excess + rise) / g, -h0)
    cells[ghost.at + ghost.across] = ghost.outward * u
    cells[ghost.at + ghost.along] = cells[ghost.first + ghost.along]


@ti.func
def celerity_difference(D: ti.f32, D_0: ti.f32, h0: ti.f32, g: ti.f32) -> ti.f32:
    """√(g (D + h0)) − √(g (D_0 + h0)), which rounds like D − D_0."""
    return g * (D - D_0) / (ti.sqrt(g * (D + h0)) + ti.sqrt(g * (D_0 + h0)) + TINY)
