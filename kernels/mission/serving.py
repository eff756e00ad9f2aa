"""Which boat serves which AUV: it plans for it, and asks it where AUVs are asked one at a time.

Each AUV is served by the boat that is nearest to where it is estimated; it changes to another one that is nearer by
more than the share `RELUCTANCE`. Where there is one boat, nothing of this is compiled.
"""

import taichi as ti

from usvauv.kernels.mission.columns import BoatColumn, EstimateColumn
from usvauv.kernels.types import vec2

RELUCTANCE = 0.1  # of the distance to the boat that serves it
LLOYD_ITERATIONS = 8


@ti.func
def server(worlds: ti.template(), w, k) -> ti.i32:
    """Index of the boat that serves AUV k."""
    b = 0
    if ti.static(worlds.program.fleet):
        b = ti.cast(worlds.estimate[w, k, EstimateColumn.served_by], ti.i32)
    return b


@ti.func
def serves(worlds: ti.template(), w, b, k) -> bool:
    """Whether boat b serves AUV k."""
    found = True
    if ti.static(worlds.program.fleet):
        found = server(worlds, w, k) == b
    return found


@ti.func
def num_served(worlds: ti.template(), w, b) -> ti.i32:
    """Number of AUVs that boat b serves."""
    count = worlds.estimate.shape[1]
    if ti.static(worlds.program.fleet):
        count = 0
        for k in range(worlds.estimate.shape[1]):
            count += ti.cast(serves(worlds, w, b, k), ti.i32)
    return count


@ti.func
def place_of(worlds: ti.template(), w, b) -> vec2:
    """Where boat b is, m."""
    return vec2(worlds.boat[w, b, BoatColumn.x], worlds.boat[w, b, BoatColumn.y])


@ti.func
def estimated(worlds: ti.template(), w, k) -> vec2:
    """Where AUV k is estimated, m."""
    return vec2(worlds.estimate[w, k, EstimateColumn.x], worlds.estimate[w, k, EstimateColumn.y])


@ti.func
def middle(worlds: ti.template(), w, b) -> vec2:
    """Mean of the estimated positions of the AUVs that boat b serves; where it serves none, its own place, m."""
    count = num_served(worlds, w, b)
    mean = vec2(0.0, 0.0)
    for k in range(worlds.estimate.shape[1]):
        if serves(worlds, w, b, k):
            mean += estimated(worlds, w, k) / count
    if count == 0:
        mean = place_of(worlds, w, b)
    return mean


@ti.func
def allot(worlds: ti.template(), w, reluctance):
    """Decide which boat serves each AUV from now on; `reluctance` is a share of the distance to the present one."""
    if ti.static(worlds.program.fleet):
        for k in range(worlds.estimate.shape[1]):
            here = estimated(worlds, w, k)
            best = server(worlds, w, k)
            least = (1.0 - reluctance) * (place_of(worlds, w, best) - here).norm()
            for b in range(worlds.boat.shape[1]):
                distance = (place_of(worlds, w, b) - here).norm()
                if distance < least:
                    best = b
                    least = distance
            worlds.estimate[w, k, EstimateColumn.served_by] = ti.cast(best, ti.f32)


@ti.func
def move_to(worlds: ti.template(), w, b, place: vec2):
    """Put boat b at a place, m."""
    worlds.boat[w, b, BoatColumn.x] = place[0]
    worlds.boat[w, b, BoatColumn.y] = place[1]


@ti.func
def split(worlds: ti.template(), w):
    """Split the AUVs among the boats by their places, and put each boat in the middle of its AUVs (k-means).

    The first boat begins at the first AUV and each other one at the AUV that is farthest from the boats before it;
    then Lloyd's iteration, Lloyd (1982), doi:10.1109/TIT.1982.1056489.
    """
    if ti.static(worlds.program.fleet):
        for b in range(worlds.boat.shape[1]):
            farthest = 0
            largest = -1.0
            for k in range(worlds.estimate.shape[1]):
                nearest = 1e30
                for other in range(b):
                    nearest = ti.min(nearest, (place_of(worlds, w, other) - estimated(worlds, w, k)).norm())
                if nearest > largest:
                    largest = nearest
                    farthest = k
            move_to(worlds, w, b, estimated(worlds, w, farthest))
        for _ in range(LLOYD_ITERATIONS):
            allot(worlds, w, 0.0)
            for b in range(worlds.boat.shape[1]):
                move_to(worlds, w, b, middle(worlds, w, b))
