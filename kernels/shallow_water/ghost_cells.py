"""Ghost cells of the nonlinear solver: what its cells see beyond their lane and beyond the edges of the basin.

Fields D, u and v lie one after the other, twice (the state and the first stage of a step), each of ny + 4 rows of W + 4
vectors, with two ghosts all round. A lane holds W neighbouring columns of the basin, and those beyond as ghosts. The
first lane begins at the western edge and the last one ends at the eastern edge, so that lanes overlap where W does not
divide the columns: all lanes hold water, and what stands twice is equal to the last bit. The bed, one field, lies
likewise, mirrored beyond the edges.
"""

import taichi as ti

from kernels.shallow_water.packing import LANES
from kernels.shallow_water.riemann import TINY

WALL, RADIATING, FORCED = range(3)
WEST, EAST, SOUTH, NORTH = range(4)


@ti.func
def place(field: ti.i32, i: ti.i32, j: ti.i32, ny: ti.i32, W: ti.i32) -> ti.i32:
    """Where row i and column j of a field lie: 0, 1, 2 for D, u, v, and 3, 4, 5 for those of the first stage."""
    return (field * (ny + 4) + i + 2) * (W + 4) + j + 2


@ti.func
def fill_ghosts(
    cells: ti.template(),
    bed_cells: ti.template(),
    halo: ti.template(),
    edges: ti.template(),
    stage: ti.template(),
    task: ti.i32,
    ny: ti.i32,
    W: ti.i32,
    g: ti.f32,
    dry: ti.f32,
    level: ti.f32,
):
    """The ghosts of a row (tasks up to ny − 1), or one of the four rows of ghosts in the south and north."""
    size = (ny + 4) * (W + 4) * LANES
    if task < ny:
        row = place(3 * stage, task, 0, ny, W)
        for n in range(halo.shape[0]):
            at = (row + halo[n, 0]) * LANES + halo[n, 1]
            first = (row + halo[n, 4]) * LANES + halo[n, 5]
            edge = halo[n, 2]
            if edge < 0:
                for field in ti.static(range(3)):
                    cells[at + field * size] = cells[first + field * size]
            else:
                second = (row + halo[n, 6]) * LANES + halo[n, 7]
                outward = 2.0 * ti.cast(edge, ti.f32) - 1.0
                fill_ghost(
                    cells, bed_cells, stage, at, first, second, size, 1, halo[n, 3], outward, edges[edge], g, dry, level
                )
    else:
        north = (task - ny) // 2
        layer = (task - ny) % 2
        row = place(3 * stage, north * (ny + 1 + 2 * layer) - 1 - layer, 0, ny, W)
        edge_row = place(3 * stage, north * (ny - 1), 0, ny, W)
        next_row = edge_row + (1 - 2 * north) * (W + 4)
        outward = 2.0 * ti.cast(north, ti.f32) - 1.0
        for n in range(W * LANES):
            fill_ghost(
                cells,
                bed_cells,
                stage,
                row * LANES + n,
                edge_row * LANES + n,
                next_row * LANES + n,
                size,
                2,
                layer + 1,
                outward,
                edges[SOUTH + north],
                g,
                dry,
                level,
            )


@ti.func
def fill_ghost(
    cells: ti.template(),
    bed_cells: ti.template(),
    stage: ti.template(),
    at: ti.i32,
    first: ti.i32,
    second: ti.i32,
    size: ti.i32,
    axis: ti.i32,
    layer: ti.i32,
    outward: ti.f32,
    kind: ti.i32,
    g: ti.f32,
    dry: ti.f32,
    level: ti.f32,
):
    """A ghost from the first and the second cell inside the edge.

    Wall: the mirror image.

    Radiating: the state between the first cell and a still sea outside, by the Riemann invariants u + 2 c that leaves
    the one and −2 c that leaves the other.

    Forced: the elevation that has the prescribed one as its mean with the mirror cell, and the velocity by the
    invariant that arrives there from inside. Surface and velocity inside are continued linearly where both cells are
    flooded. The edge is passed at most with the speed of waves: faster water would need other conditions.

    Args:
        at, first, second: places of the ghost and of the two cells.
        size: numbers in a field.
        axis: 1 or 2, the velocity across the edge.
        layer: 1 or 2, how many cells beyond the edge the ghost lies.
        outward: sign of that velocity when water leaves.
    """
    across = axis * size
    along = (3 - axis) * size
    mirror = first
    if layer == 2:
        mirror = second
    if kind == WALL:
        cells[at] = cells[mirror]
        cells[at + across] = -cells[mirror + across]
        cells[at + along] = cells[mirror + along]
    else:
        under = 3 * stage * size
        b = bed_cells[at - under]
        h0 = ti.max(-b, 0.0)
        land = ti.max(b, 0.0)
        u = outward * cells[first + across]
        D = 0.0
        if kind == RADIATING:
            c0 = ti.sqrt(g * h0)
            leaving = u + 2.0 * celerity_difference(cells[first], 0.0, ti.max(-bed_cells[first - under], 0.0), g)
            excess = ti.max(0.25 * leaving, -c0)
            D = excess * (2.0 * c0 + excess) / g
            u = 0.5 * leaving
        else:
            b_1 = bed_cells[first - under]
            b_2 = bed_cells[second - under]
            eta = cells[first] + ti.max(b_1, 0.0)
            eta_2 = cells[second] + ti.max(b_2, 0.0)
            if ti.min(eta, eta_2) > ti.max(b_1, b_2) + dry:
                reach = ti.cast(layer, ti.f32)
                u = u + reach * (u - outward * cells[second + across])
                eta = eta + reach * (eta - eta_2)
            D = ti.max(2.0 * (level - land) - cells[mirror], -h0)
            u = u + 2.0 * celerity_difference(ti.max(eta - land, -h0), D, h0, g)
            c = ti.sqrt(g * (D + h0))
            u = ti.max(ti.min(u, c), -c)
        cells[at] = D
        cells[at + across] = outward * u
        cells[at + along] = cells[first + along]


@ti.func
def celerity_difference(D: ti.f32, D_0: ti.f32, h0: ti.f32, g: ti.f32) -> ti.f32:
    """√(g (D + h0)) − √(g (D_0 + h0)), which rounds like D − D_0."""
    return g * (D - D_0) / (ti.sqrt(g * (D + h0)) + ti.sqrt(g * (D_0 + h0)) + TINY)
