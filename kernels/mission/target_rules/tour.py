"""Rules that follow a closed tour of the nodes: all AUVs one tour, spaced along it, or each a sector of it.

The tour is a nearest-neighbour tour improved until no exchange of two edges shortens it (2-opt: G. A. Croes, 1958,
Operations Research 6(6), doi 10.1287/opre.6.6.791). It depends only on the positions of the nodes.
"""

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.mission.choices import TargetRule
from usvauv.kernels.mission.target_rules import knowledge
from usvauv.kernels.mission.target_rules.rule import distance
from usvauv.kernels.types import vec2

LEAST_GAIN = 1e-3  # m, of an exchange; below it rounding could undo and redo one for ever


@func
def around(place, count):
    """A place of a closed tour of `count` stops, counted around at most once."""
    return ti.select(place < count, place, place - count)


@func
def stop(worlds: ti.template(), w, place):
    """The node at a place of the tour, counted around."""
    return ti.cast(worlds.node.tour[w, around(place, worlds.node.shape[1])], ti.i32)


@func
def put(worlds: ti.template(), w, place, i):
    """Put node i at a place of the tour, counted around."""
    worlds.node.tour[w, around(place, worlds.node.shape[1])] = ti.cast(i, ti.f32)


@func
def spot(worlds: ti.template(), w, i) -> vec2:
    """Where node i is, m."""
    return vec2(worlds.node.x[w, i], worlds.node.y[w, i])


@func
def apart(worlds: ti.template(), w, i, j):
    """Distance between two nodes, m."""
    return (spot(worlds, w, i) - spot(worlds, w, j)).norm()


@func
def reverse(worlds: ti.template(), w, first, last):
    """Reverse the tour from place `first` to `last`."""
    a = first
    b = last
    while a < b:
        i = stop(worlds, w, a)
        put(worlds, w, a, stop(worlds, w, b))
        put(worlds, w, b, i)
        a += 1
        b -= 1


@func
def shorten(worlds: ti.template(), w, first, count):
    """Exchange edges of the closed tour of `count` stops from place `first` on until none shortens it.

    The stop at `first` stays there. One of the two new edges of a shorter tour is shorter than the old one that it
    begins or ends with, so that few exchanges need roots.
    """
    improved = True
    while improved:
        improved = False
        for a in range(count - 2):
            here = spot(worlds, w, stop(worlds, w, first + a))
            after = spot(worlds, w, stop(worlds, w, first + a + 1))
            there = spot(worlds, w, stop(worlds, w, first + a + 2))
            for b in range(a + 2, count):
                beyond = spot(worlds, w, stop(worlds, w, first + around(b + 1, count)))
                own = (here - after).norm_sqr()
                other = (there - beyond).norm_sqr()
                across = (here - there).norm_sqr()
                back = (after - beyond).norm_sqr()
                if across < own or back < other:
                    if ti.sqrt(across) + ti.sqrt(back) < ti.sqrt(own) + ti.sqrt(other) - LEAST_GAIN:
                        reverse(worlds, w, first + a + 1, first + b)
                        after = there
                        improved = True
                there = beyond


@func
def close(worlds: ti.template(), w, first, count):
    """Make each of `count` stops from place `first` on lead to the next, and the last to the first."""
    i = stop(worlds, w, first + count - 1)
    for a in range(count):
        following = stop(worlds, w, first + a)
        worlds.node.successor[w, i] = ti.cast(following, ti.f32)
        i = following


@func
def make_tour(worlds: ti.template(), w):
    """The tour of all nodes; returns its length, m."""
    count = worlds.node.shape[1]
    for i in range(count):
        put(worlds, w, i, i)
    for place in range(count - 2):
        here = stop(worlds, w, place)
        nearest = place + 1
        least = apart(worlds, w, here, stop(worlds, w, nearest))
        for other in range(place + 2, count):
            away = apart(worlds, w, here, stop(worlds, w, other))
            if away < least:
                nearest = other
                least = away
        i = stop(worlds, w, nearest)
        put(worlds, w, nearest, stop(worlds, w, place + 1))
        put(worlds, w, place + 1, i)
    shorten(worlds, w, 0, count)
    length = 0.0
    here = stop(worlds, w, 0)
    for place in range(count):
        there = stop(worlds, w, place + 1)
        length += apart(worlds, w, here, there)
        here = there
    return length


@func
def enter(worlds: ti.template(), w, first, length):
    """Send AUVs to stops evenly spaced along the tour from place `first` on, to each the nearest AUV that is left.

    Where no more stops are left than AUVs each has one. Returns the sum of the AUVs' distances, m.
    """
    auv = ti.static(worlds.auv)
    num_auvs = auv.shape[1]
    for k in range(num_auvs):
        auv.target[w, k] = -1.0
    total = 0.0
    travelled = 0.0
    entered = 0
    for place in range(worlds.node.shape[1]):
        i = stop(worlds, w, first + place)
        due = travelled >= length * entered / num_auvs or worlds.node.shape[1] - place <= num_auvs - entered
        if entered < num_auvs and due:
            nearest = -1
            for k in range(num_auvs):
                if auv.target[w, k] < 0.0:
                    if nearest < 0:
                        nearest = k
                    elif distance(worlds, w, k, i) < distance(worlds, w, nearest, i):
                        nearest = k
            auv.target[w, nearest] = ti.cast(i, ti.f32)
            total += distance(worlds, w, nearest, i)
            entered += 1
        if entered == num_auvs:
            break
        travelled += apart(worlds, w, i, stop(worlds, w, first + place + 1))
    return total


@func
def spread(worlds: ti.template(), w, length):
    """Enter the tour where the AUVs' ways to it are shortest; returns the place of the first stop entered."""
    best = 0
    least = 1e30
    for first in range(worlds.node.shape[1]):
        total = enter(worlds, w, first, length)
        if total < least:
            best = first
            least = total
    enter(worlds, w, best, length)
    return best


@func
def prepare_tour(worlds: ti.template(), w):
    """One closed tour for all."""
    spread(worlds, w, make_tour(worlds, w))
    close(worlds, w, 0, worlds.node.shape[1])


@func
def prepare_sectors(worlds: ti.template(), w):
    """The tour in pieces of about one length, one an AUV, each closed and shortened again."""
    count = worlds.node.shape[1]
    first = spread(worlds, w, make_tour(worlds, w))
    start = 0
    for place in range(1, count + 1):
        entered = place == count
        for k in range(worlds.auv.shape[1]):
            if ti.cast(worlds.auv.target[w, k], ti.i32) == stop(worlds, w, first + place):
                entered = True
        if entered:
            shorten(worlds, w, first + start, place - start)
            close(worlds, w, first + start, place - start)
            start = place


@func
def share_nodes(worlds: ti.template(), w):
    """Give each node to the AUV in whose sector it lies; no AUV has a target yet."""
    prepare_sectors(worlds, w)
    for k in range(worlds.auv.shape[1]):
        i = ti.cast(worlds.auv.target[w, k], ti.i32)
        worlds.auv.target[w, k] = -1.0
        for _ in range(worlds.node.shape[1]):
            if i >= 0:
                worlds.node.owner[w, i] = ti.cast(k, ti.f32)
                i = ti.cast(worlds.node.successor[w, i], ti.i32)


@func
def follow(worlds: ti.template(), w, k):
    """The next free stop of the tour; at first the stop at which AUV k enters it."""
    target = ti.cast(worlds.auv.target[w, k], ti.i32)
    if worlds.clock[w, 1] > 0:
        searching = True
        for _ in range(worlds.node.shape[1]):
            if searching:
                target = ti.cast(worlds.node.successor[w, target], ti.i32)
                searching = not knowledge.is_free(worlds, w, k, target)
    if target < 0:  # more AUVs than nodes
        target = k % worlds.node.shape[1]
    return target


@func
def successor(worlds: ti.template(), w, i):
    """The node after node i on its tour."""
    return ti.cast(worlds.node.successor[w, i], ti.i32)


@func
def tour(worlds: ti.template(), w, k):
    """All AUVs follow one closed tour of the nodes, spaced along it."""
    return follow(worlds, w, k)


@func
def sectors(worlds: ti.template(), w, k):
    """Each AUV follows a closed tour of its own part of the nodes."""
    return follow(worlds, w, k)


TOUR = TargetRule(tour, prepare=prepare_tour, foreseen=successor)
SECTORS = TargetRule(sectors, prepare=prepare_sectors, foreseen=successor)
