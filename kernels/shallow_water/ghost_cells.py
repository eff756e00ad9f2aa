"""Ghost cells of the nonlinear solver: what its cells see beyond their lane and beyond the boundaries of the basin.

Fields D, u and v lie one after the other, twice (the state and the first stage of a step), each of ny + 4 rows of W + 4
vectors, with two ghosts all round. A lane holds W neighbouring columns of the basin, and those beyond as ghosts. The
first lane begins at the western boundary and the last one ends at the eastern one, so that lanes overlap where W does
not divide the columns: all lanes hold water, and columns held twice are equal to the last bit. The bed, one field, lies
likewise, mirrored beyond the boundaries.
"""

from collections import namedtuple

import taichi as ti

from kernels.shallow_water.boundaries import SOUTH
from kernels.shallow_water.packing import LANES
from kernels.shallow_water.riemann import TINY
from kernels.types import columns

WALL, RADIATING, FORCED = range(3)

# Entries of the table `halo` for a ghost, the same in each row: its column and lane; the boundary beyond which it lies
# (−1 if it is a cell of another lane) and how many cells beyond; column and lane of the cell nearest to that boundary
# (or of the cell itself), and of the next nearest.
Halo = columns("column", "lane", "boundary", "layer", "first_column", "first_lane", "second_column", "second_lane")

# A ghost beyond a boundary: indices of the ghost and of the first and second cell inside; offsets of the velocities
# across and along the boundary and of the stage; cells beyond the boundary (1 or 2), and the sign of leaving water.
Ghost = namedtuple("Ghost", "at first second across along stage_offset layer outward")


@ti.func
def vector_index(field: ti.i32, i: ti.i32, j: ti.i32, ny: ti.i32, W: ti.i32) -> ti.i32:
    """Index of row i and column j of a field: 0, 1, 2 for D, u, v, and 3, 4, 5 for those of the first stage."""
    return (field * (ny + 4) + i + 2) * (W + 4) + j + 2


@ti.func
def fill_ghosts(basin: ti.template(), stage: ti.template(), task: ti.i32, level: ti.f32):
    """The ghosts of a row (tasks up to ny − 1), or one of the four rows of ghosts in the south and north.

    Args:
        basin: see `kernels.shallow_water.finite_volume.Basin`.
        stage: 0 for the state, 1 for the first stage.
        task: which of ny + 4.
        level: prescribed elevation of forced boundaries, m.
    """
    ny, W, cells, halo = ti.static((basin.ny, basin.W, basin.cells, basin.halo))
    size = (ny + 4) * (W + 4) * LANES
    stage_offset = 3 * stage * size
    if task < ny:
        row = vector_index(3 * stage, task, 0, ny, W)
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
                ghost = ti.static(Ghost(at, first, second, across, along, stage_offset, layer, outward))
                fill_ghost(basin, ghost, basin.boundaries[boundary], level)
    else:
        north = (task - ny) // 2
        layer = (task - ny) % 2 + 1
        row = vector_index(3 * stage, north * (ny - 1 + 2 * layer) - layer, 0, ny, W)
        edge_row = vector_index(3 * stage, north * (ny - 1), 0, ny, W)
        next_row = edge_row + (1 - 2 * north) * (W + 4)
        outward = 2.0 * ti.cast(north, ti.f32) - 1.0
        across = 2 * size
        along = size
        for n in range(W * LANES):
            at = row * LANES + n
            first = edge_row * LANES + n
            second = next_row * LANES + n
            ghost = ti.static(Ghost(at, first, second, across, along, stage_offset, layer, outward))
            fill_ghost(basin, ghost, basin.boundaries[SOUTH + north], level)


@ti.func
def fill_ghost(basin: ti.template(), ghost: ti.template(), kind: ti.i32, level: ti.f32):
    """A ghost beyond a boundary of a kind, from the first and the second cell inside."""
    if kind == WALL:
        fill_wall(basin, ghost)
    elif kind == RADIATING:
        fill_radiating(basin, ghost)
    else:
        fill_forced(basin, ghost, level)


@ti.func
def mirror_cell(ghost: ti.template()) -> ti.i32:
    """Index of the cell that is the mirror image of a ghost."""
    mirror = ghost.first
    if ghost.layer == 2:
        mirror = ghost.second
    return mirror


@ti.func
def fill_wall(basin: ti.template(), ghost: ti.template()):
    """Wall: the mirror image."""
    cells = ti.static(basin.cells)
    mirror = mirror_cell(ghost)
    cells[ghost.at] = cells[mirror]
    cells[ghost.at + ghost.across] = -cells[mirror + ghost.across]
    cells[ghost.at + ghost.along] = cells[mirror + ghost.along]


@ti.func
def fill_radiating(basin: ti.template(), ghost: ti.template()):
    """Radiating: the state between the first cell and a still sea outside.

    From the Riemann invariants u + 2 c that leaves the first cell and −2 c that leaves the sea outside.
    """
    cells, g = ti.static((basin.cells, basin.g))
    c0 = ti.sqrt(g * ti.max(-basin.bed_cells[ghost.at - ghost.stage_offset], 0.0))
    h0_first = ti.max(-basin.bed_cells[ghost.first - ghost.stage_offset], 0.0)
    u = ghost.outward * cells[ghost.first + ghost.across]
    leaving = u + 2.0 * celerity_difference(cells[ghost.first], 0.0, h0_first, g)
    excess = ti.max(0.25 * leaving, -c0)
    cells[ghost.at] = excess * (2.0 * c0 + excess) / g
    cells[ghost.at + ghost.across] = ghost.outward * (0.5 * leaving)
    cells[ghost.at + ghost.along] = cells[ghost.first + ghost.along]


@ti.func
def fill_forced(basin: ti.template(), ghost: ti.template(), level: ti.f32):
    """Forced: the elevation that has the prescribed one as its mean with the mirror cell.

    The velocity follows from the invariant that arrives there from inside. Surface and velocity inside are continued
    linearly where both cells are flooded. Water passes the boundary at most with the speed of waves: faster water would
    need other conditions.
    """
    cells, bed, g = ti.static((basin.cells, basin.bed_cells, basin.g))
    b = bed[ghost.at - ghost.stage_offset]
    b_1 = bed[ghost.first - ghost.stage_offset]
    b_2 = bed[ghost.second - ghost.stage_offset]
    h0 = ti.max(-b, 0.0)
    land = ti.max(b, 0.0)
    u = ghost.outward * cells[ghost.first + ghost.across]
    eta = cells[ghost.first] + ti.max(b_1, 0.0)
    eta_2 = cells[ghost.second] + ti.max(b_2, 0.0)
    if ti.min(eta, eta_2) > ti.max(b_1, b_2) + basin.dry:
        distance = ti.cast(ghost.layer, ti.f32)
        u = u + distance * (u - ghost.outward * cells[ghost.second + ghost.across])
        eta = eta + distance * (eta - eta_2)
    D = ti.max(2.0 * (level - land) - cells[mirror_cell(ghost)], -h0)
    u = u + 2.0 * celerity_difference(ti.max(eta - land, -h0), D, h0, g)
    c = ti.sqrt(g * (D + h0))
    cells[ghost.at] = D
    cells[ghost.at + ghost.across] = ghost.outward * ti.max(ti.min(u, c), -c)
    cells[ghost.at + ghost.along] = cells[ghost.first + ghost.along]


@ti.func
def celerity_difference(D: ti.f32, D_0: ti.f32, h0: ti.f32, g: ti.f32) -> ti.f32:
    """√(g (D + h0)) − √(g (D_0 + h0)), which rounds like D − D_0."""
    return g * (D - D_0) / (ti.sqrt(g * (D + h0)) + ti.sqrt(g * (D_0 + h0)) + TINY)
