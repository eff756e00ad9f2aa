"""Random numbers of the mission, each addressed by (world, episode, step, draw), so that none depends on the others.

Where many worlds take a step side by side, the normal numbers of AUVs and boats and the uniform numbers of arrivals at
nodes, which each step needs, are drawn before it in vectors.
"""

import numpy as np
import taichi as ti

from usvauv.kernels import random
from usvauv.kernels.functions import func
from usvauv.kernels.mission.columns import Draw
from usvauv.kernels.types import vec4

PURPOSE = 1 << 16  # of a draw, as part of its address
# Purposes of normal numbers drawn in each step for each AUV and each boat. Many worlds draw them side by side before a
# step, and after them the uniform numbers of arrivals at nodes, four for each address.
OF_AUV = Draw.speed, Draw.depth, Draw.navigation, Draw.fix, Draw.residual
OF_BOAT, OF_NODES = (Draw.gnss, Draw.attitude), Draw.arrival
EACH_AUV, EACH_BOAT = len(OF_AUV), len(OF_BOAT)


def draw_numbers(num_auvs: int, num_boats: int, num_nodes: int) -> np.ndarray:
    """Last words of the addresses of these draws, (groups, `random.LANES`) int64."""
    normal = [(draw, k) for k in range(num_auvs) for draw in OF_AUV]
    normal += [(draw, b) for b in range(num_boats) for draw in OF_BOAT]
    uniform = [(OF_NODES, n) for n in range(-(-num_nodes // 4))]
    rows = [part + [(0, 0)] * (-len(part) % random.LANES) for part in (normal, uniform)]
    return np.array([draw * PURPOSE + index for draw, index in rows[0] + rows[1]], np.int64).reshape(-1, random.LANES)


@func
def address(worlds: ti.template(), w, step, draw, index):
    """Counter of a random draw: the world's index in its seed, its episode, a step, what the draw is for (`Draw`)."""
    return random.uint4(
        ti.cast(worlds.key.world[w], ti.u32),
        ti.cast(worlds.clock[w, 0], ti.u32),
        ti.cast(step, ti.u32),
        ti.cast(draw * PURPOSE + index, ti.u32),
    )


@func
def key(worlds: ti.template(), w):
    """Key of all random draws of a world: its seed."""
    return random.uint2(
        ti.cast(worlds.key.low[w], ti.u32),
        ti.cast(worlds.key.high[w], ti.u32),
    )


@func
def groups_of_normals(worlds: ti.template()):
    """Vectors of `random.LANES` draws that have the normal numbers of a step."""
    return (EACH_AUV * worlds.auv.shape[1] + EACH_BOAT * worlds.boat.shape[1] + random.LANES - 1) // random.LANES


@func
def draw_ahead(worlds: ti.template(), w):
    """Draw random numbers of the present step of world w, `draw_numbers`, for where vectors stay in registers."""
    start, word = address(worlds, w, worlds.clock[w, 1], 0, 0), key(worlds, w)
    c = [random.long_lanes(ti.cast(start[part], ti.u64)) for part in ti.static(range(3))]
    seed = [ti.cast(word[part], ti.u64) for part in ti.static(range(2))]
    normal = groups_of_normals(worlds)
    for group in range(worlds.draw_numbers.shape[0]):
        words = random.rounds(c[0], c[1], c[2], worlds.draw_numbers[group], seed[0], seed[1])
        for half in ti.static((0, 2)):
            a, b = random.uniform_lanes(words[half]), random.uniform_lanes(words[half + 1])
            if group < normal:
                a, b = random.gaussian_lanes(a, b)
            worlds.drawn[w, 4 * group + half] = a
            worlds.drawn[w, 4 * group + half + 1] = b


@func
def place_drawn(worlds: ti.template(), draw: ti.template()):
    """Place of a draw's first index among those of a world that `draw_ahead` makes, and the distance of the next."""
    first, each = 0, 1
    if ti.static(draw in OF_AUV):
        first += ti.static(OF_AUV.index(draw))
        each = EACH_AUV
    elif ti.static(draw in OF_BOAT):
        first += EACH_AUV * worlds.auv.shape[1] + ti.static(OF_BOAT.index(draw))
        each = EACH_BOAT
    else:
        first += random.LANES * groups_of_normals(worlds)
    return first, each


@func
def number_drawn(worlds: ti.template(), w, place, part):
    """Number `part` of 4 of a draw at a place of world w."""
    return worlds.drawn[w, 4 * (place >> random.LANE_BITS) + part][place & (random.LANES - 1)]


@func
def drawn(worlds: ti.template(), w, draw: ti.template(), index) -> vec4:
    """The four numbers of a draw that `draw_ahead` has made for the present step."""
    first, each = place_drawn(worlds, draw)
    return vec4([number_drawn(worlds, w, first + each * index, part) for part in ti.static(range(4))])


@func
def uniforms(worlds: ti.template(), w, draw: ti.template(), index):
    """Four independent numbers uniform in (0, 1), of the present step."""
    found = vec4(0.0)
    if ti.static(worlds.program.in_lanes and draw == OF_NODES):
        found = drawn(worlds, w, draw, index)
    else:
        found = random.uniforms(address(worlds, w, worlds.clock[w, 1], draw, index), key(worlds, w))
    return found


@func
def normals(worlds: ti.template(), w, draw: ti.template(), index):
    """Four independent standard normal numbers, of the present step."""
    found = vec4(0.0)
    if ti.static(worlds.program.in_lanes and draw in OF_AUV + OF_BOAT):
        found = drawn(worlds, w, draw, index)
    else:
        found = random.normals(address(worlds, w, worlds.clock[w, 1], draw, index), key(worlds, w))
    return found
