"""Hypotheses of a target: Gaussians of position and velocity with weights, in the columns of `filters[w, k, i]`.

AUV k of world w has a filter of target i, a row of float32 numbers: its estimate, `FilterColumn`, then the hypotheses
one after another, each with the columns `HypothesisColumn`.
"""

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.types import Columns, mat2, vec2, vec3

KEPT = 24  # hypotheses from one step to the next
CAPACITY = 96  # and within a step, in which some turn


class FilterColumn(Columns):
    """The estimate, and where the filter stands."""

    x: int  # mean position over all hypotheses, m
    y: int
    vx: int  # mean velocity, m/s
    vy: int
    xx: int  # covariance of the position, m²
    xy: int
    yy: int
    known: int  # 0 before the first range
    fresh: int  # 1 from the first range to the next prediction: velocities are unknown
    elapsed: int  # steps since `begin`
    count: int  # of hypotheses
    surprise: int  # how far ranges contradict the hypotheses, see `usvauv.kernels.tracking.range_filter`


class HypothesisColumn(Columns):
    """A hypothesis."""

    weight: int  # logarithm of it
    age: int  # steps since the last turn
    x: int  # mean, m
    y: int
    vx: int  # m/s
    vy: int
    xx: int  # covariance
    xy: int
    xu: int
    xv: int
    yy: int
    yu: int
    yv: int
    uu: int
    uv: int
    vv: int


FIRST = len(FilterColumn.names)
WIDTH = len(HypothesisColumn.names)
COLUMNS = FIRST + CAPACITY * WIDTH
# Least and greatest number of each column.
ANYWHERE, FLAG, STEPS = (-1e12, 1e12), (0.0, 1.0), (0.0, 1e8)
BOUNDS = (7 * (ANYWHERE,)) + (FLAG, FLAG, STEPS, (0.0, float(CAPACITY)), ANYWHERE) + CAPACITY * WIDTH * ((-1e25, 1e25),)


@ti.dataclass
class Hypothesis:
    """A Gaussian of the state (position, velocity).

    Attributes:
        weight: its logarithm, up to a constant common to all.
        age: steps since the last turn.
        position, velocity: mean, m and m/s.
        A, B, C: covariance of the position, of position (rows) and velocity, and of the velocity.
    """

    weight: ti.f32
    age: ti.f32
    position: vec2
    velocity: vec2
    A: mat2
    B: mat2
    C: mat2


@func
def seen_at(weight, place: vec2, covariance: vec3, direction: vec2, distance, along, across) -> Hypothesis:
    """A hypothesis by a first measurement from a place; its velocity is unknown, and 0 until it is set.

    Args:
        place, covariance: of the observer, m, and (xx, xy, yy), m².
        direction: of the line of sight, a unit vector. distance: m.
        along, across: variances of the measurement along and across the line of sight, m².
    """
    c, s = direction[0], direction[1]
    off = c * s * (along - across)
    return Hypothesis(
        weight=weight,
        age=0.0,
        position=place + distance * direction,
        velocity=vec2(0.0),
        A=mat2(
            [
                [covariance[0] + c * c * along + s * s * across, covariance[1] + off],
                [covariance[1] + off, covariance[2] + s * s * along + c * c * across],
            ]
        ),
        B=mat2(0.0),
        C=mat2(0.0),
    )


@func
def corrected(one: Hypothesis, of_position: vec2, of_velocity: vec2, innovation, S, variance) -> Hypothesis:
    """A hypothesis after a measurement of one number, by the Kalman filter.

    Args:
        of_position, of_velocity: covariances of the number with position and velocity.
        innovation: the number less what was expected. S: variance of that. variance: of the measurement alone.
    """
    precision = 1.0 / S
    weighted = precision * innovation
    return Hypothesis(
        weight=one.weight - 0.5 * (weighted * innovation + ti.log(S / variance)),
        age=one.age,
        position=one.position + weighted * of_position,
        velocity=one.velocity + weighted * of_velocity,
        A=one.A - precision * of_position.outer_product(of_position),
        B=one.B - precision * of_position.outer_product(of_velocity),
        C=one.C - precision * of_velocity.outer_product(of_velocity),
    )


@func
def place_of(h, column):
    """Index of a column of hypothesis h."""
    return FIRST + h * WIDTH + column


@func
def count_of(filters: ti.template(), w, k, i):
    """Number of hypotheses."""
    return ti.cast(filters[w, k, i, FilterColumn.count], ti.i32)


@func
def load(filters: ti.template(), w, k, i, h) -> Hypothesis:
    """Hypothesis h."""
    n = [filters[w, k, i, place_of(h, c)] for c in ti.static(range(WIDTH))]
    return Hypothesis(
        weight=n[0],
        age=n[1],
        position=vec2(n[2], n[3]),
        velocity=vec2(n[4], n[5]),
        A=mat2([[n[6], n[7]], [n[7], n[10]]]),
        B=mat2([[n[8], n[9]], [n[11], n[12]]]),
        C=mat2([[n[13], n[14]], [n[14], n[15]]]),
    )


@func
def store(filters: ti.template(), w, k, i, h, one: Hypothesis):
    """Write hypothesis h."""
    A, B, C = one.A, one.B, one.C
    head = [one.weight, one.age, one.position[0], one.position[1], one.velocity[0], one.velocity[1]]
    rows = [A[0, 0], A[0, 1], B[0, 0], B[0, 1], A[1, 1], B[1, 0], B[1, 1], C[0, 0], C[0, 1], C[1, 1]]
    n = ti.static(head + rows)
    for c in ti.static(range(WIDTH)):
        filters[w, k, i, place_of(h, c)] = n[c]


@func
def move(filters: ti.template(), w, k, i, source, to):
    """Copy hypothesis `source` to place `to`."""
    for c in ti.static(range(WIDTH)):
        filters[w, k, i, place_of(to, c)] = filters[w, k, i, place_of(source, c)]
