"""Poisson arrivals at nodes, each with one of a few rates, by inversion of the distribution from a table.

A row of the table holds one rate, a guide, and the cumulative distribution of the number of arrivals in a mission step.
The guide holds for each of GUIDE equal parts of (0, 1) the smallest count that a number in it can give: the search
begins there and rarely needs a second step. Source: Chen and Asau (1974), "On generating random variates from an
empirical distribution", AIIE Transactions 6(2), doi 10.1080/05695557408974949.
"""

import math
from collections.abc import Sequence

import numpy as np
import taichi as ti

GUIDE = 64
RATE = 0  # column of the rate; the guide and the cumulative distribution follow
CUMULATIVE = 1 + GUIDE
TAIL = 2.0**-26  # probability beyond the end of a table; 1 − 2⁻²⁶ rounds to 1 in single precision


def _cumulative(mean: float) -> np.ndarray:
    """P(N ≤ 0), P(N ≤ 1), … of a Poisson number until `TAIL` is left."""
    probability = below = math.exp(-mean)
    values = [below]
    while 1.0 - below > TAIL:
        probability *= mean / len(values)
        below += probability
        values.append(below)
    return np.array(values)


def table(rates: Sequence[float], step: float) -> np.ndarray:
    """The table of some rates (packets/s) and a mission step (s), (len(rates), CUMULATIVE + counts) float32."""
    rows = [_cumulative(rate * step) for rate in rates]
    filled = np.ones((len(rows), CUMULATIVE + max(map(len, rows))), np.float32)
    for row, rate, cumulative in zip(filled, rates, rows, strict=True):
        row[RATE] = rate
        row[CUMULATIVE : CUMULATIVE + len(cumulative) - 1] = cumulative[:-1]  # the last is 1
        row[1:CUMULATIVE] = np.searchsorted(row[CUMULATIVE:], np.arange(GUIDE) / GUIDE)
    return filled


@ti.func
def draw(arrivals: ti.template(), row: ti.i32, u: ti.f32) -> ti.f32:
    """The Poisson number of a row at a uniform number u in (0, 1): the smallest count with P(N ≤ count) ≥ u."""
    count = ti.cast(arrivals[row, 1 + ti.cast(u * GUIDE, ti.i32)], ti.i32)
    while u > arrivals[row, CUMULATIVE + count]:
        count += 1
    return ti.cast(count, ti.f32)
