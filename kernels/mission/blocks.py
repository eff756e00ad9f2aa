"""Numbers of several AUVs or boats side by side: on a CPU vectors of `LANES`, on a GPU and as an episode begins single
numbers.

A function that works on a block takes lists, the worlds `w` and the AUVs or boats in them, of `LANES` or of one; with
`take` it gets columns of arrays, numbers or vectors alike, and with `put` it writes them.
"""

import taichi as ti

from usvauv.kernels.functions import LANES, func
from usvauv.kernels.mission.draws import normals, number_drawn, place_drawn
from usvauv.kernels.mission.worlds import WORLDS_PER_BLOCK, Program


def width(program: Program) -> int:
    """AUVs of a block. Where rays are bent their paths have no vectors."""
    return LANES if program.in_lanes and not program.refraction else 1


@func
def together(numbers: ti.template()):
    """One number as it is, several as a vector."""
    if ti.static(len(numbers) == 1):
        return numbers[0]
    else:  # noqa: RET505 - Taichi reads one of both
        return ti.Vector([numbers[n] for n in ti.static(range(LANES))])


@func
def take(array: ti.template(), w: ti.template(), i: ti.template(), c: ti.template()):
    """Column c of rows i of worlds w."""
    return together([array[w[n], i[n], c] for n in ti.static(range(len(w)))])


@func
def put(array: ti.template(), w: ti.template(), i: ti.template(), count, first: ti.template(), blocks: ti.template()):
    """Write blocks to the columns from `first` on, for the first `count` rows of the lists."""
    if ti.static(len(w) == 1):
        for c in ti.static(range(len(blocks))):
            array[w[0], i[0], first + c] = blocks[c]
    else:
        for n in ti.static(range(len(w))):
            if n < count:
                for c in ti.static(range(len(blocks))):
                    array[w[n], i[n], first + c] = blocks[c][n]


@func
def normal_numbers(
    worlds: ti.template(), w: ti.template(), i: ti.template(), draw: ti.template(), count: ti.template()
):
    """The first `count` of four normal numbers of a draw for AUVs or boats i of worlds w."""
    if ti.static(len(w) == 1):
        numbers = normals(worlds, w[0], draw, i[0])
        return [numbers[part] for part in ti.static(range(count))]
    else:  # noqa: RET505 - Taichi reads one of both
        first, each = place_drawn(worlds, draw)
        place = [first + each * i[n] for n in ti.static(range(LANES))]
        return [
            ti.Vector([number_drawn(worlds, w[n], place[n], part) for n in ti.static(range(LANES))])
            for part in ti.static(range(count))
        ]


@func
def for_auvs(worlds: ti.template(), function: ti.template(), n):
    """Call `function(worlds, w, k, count, link, row)` for all AUVs of the worlds of iteration n, a block at a time.

    The first `count` AUVs k of worlds w count; the others, the last AUV again, fill the block up. `link` and `row` are
    the AUVs' link table and its row, `row` the same for all of them.
    """
    auvs = worlds.auv.shape[1]
    first, worlds_here = n, 1
    if ti.static(worlds.program.in_lanes):
        first = WORLDS_PER_BLOCK * n
        worlds_here = ti.min(WORLDS_PER_BLOCK, worlds.clock.shape[0] - first)
    if ti.static(width(worlds.program) == 1):
        for w in range(first, first + worlds_here):
            for k in range(auvs):
                function(worlds, [w], [k], 1, worlds.link, k)
    else:
        many = auvs * worlds_here
        each = 1.0 / auvs
        for part in range((many + LANES - 1) // LANES):
            place = [ti.min(LANES * part + n, many - 1) for n in ti.static(range(LANES))]
            after = [ti.cast((place[n] + 0.5) * each, ti.i32) for n in ti.static(range(LANES))]
            w = [first + after[n] for n in ti.static(range(LANES))]
            k = [place[n] - auvs * after[n] for n in ti.static(range(LANES))]
            function(worlds, w, k, many - LANES * part, worlds.links, part % worlds.links.shape[0])
