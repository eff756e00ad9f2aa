"""Reduction of a mixture: light hypotheses merge into heavy ones that they resemble, and the lightest are forgotten.

From the heaviest on, each hypothesis takes in those within a squared distance D of its mean, in units of its own
covariance: D < `ALIKE`, or D times the lighter one's share of all weights below `LIGHT`, since what a light one adds to
the mixture's error is in proportion to its weight. The merged Gaussian has the moments of both.

Source: Salmond, "Mixture reduction algorithms for point and extended object tracking in clutter", IEEE Trans. AES 45
(2009), doi 10.1109/TAES.2009.5089549.
"""

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.tracking.hypotheses import (
    KEPT,
    FilterColumn,
    Hypothesis,
    HypothesisColumn,
    count_of,
    load,
    move,
    place_of,
    store,
)
from usvauv.kernels.types import mat2, vec2

ALIKE = 0.5
LIGHT = 0.015  # both by simulations: smaller ones cost time, larger ones lose turns among the straight ways
AGES = 0.25  # squared distance of two hypotheses whose last turns are a step apart
LEAST = 1e-9  # m²/s²


@ti.dataclass
class Metric:
    """Inverse of a hypothesis's covariance by blocks: A⁻¹, A⁻¹ B and (C − Bᵀ A⁻¹ B)⁻¹."""

    A: mat2
    G: mat2
    C: mat2


@func
def metric(one: Hypothesis) -> Metric:
    """The metric of a hypothesis's covariance."""
    A = one.A.inverse()
    G = A @ one.B
    C = one.C - one.B.transpose() @ G
    # In single precision what is left can be less than 0 where a velocity is known by positions alone.
    C[0, 0] = ti.max(C[0, 0], 1e-3 * one.C[0, 0] + LEAST)
    C[1, 1] = ti.max(C[1, 1], 1e-3 * one.C[1, 1] + LEAST)
    most = 0.99 * ti.sqrt(C[0, 0] * C[1, 1])
    shear = ti.math.clamp(0.5 * (C[0, 1] + C[1, 0]), -most, most)
    C[0, 1] = shear
    C[1, 0] = shear
    return Metric(A=A, G=G, C=C.inverse())


@func
def bring_heaviest(filters: ti.template(), w, k, i, first, count):
    """Exchange hypothesis `first` with the heaviest one from it on."""
    heaviest = first
    weight = filters[w, k, i, place_of(first, HypothesisColumn.weight)]
    for h in range(first + 1, count):
        other = filters[w, k, i, place_of(h, HypothesisColumn.weight)]
        if other > weight:
            heaviest = h
            weight = other
    if heaviest != first:
        one = load(filters, w, k, i, first)
        move(filters, w, k, i, heaviest, first)
        store(filters, w, k, i, heaviest, one)


@func
def take_in(filters: ti.template(), w, k, i, first, count) -> ti.i32:
    """Merge into hypothesis `first` those after it that it resembles; how many are left of all."""
    one = load(filters, w, k, i, first)
    m = metric(one)
    # Moments over those merged, times their weights, from the mean of the first.
    weight, age = one.weight, 0.0
    way, change = vec2(0.0), vec2(0.0)
    A, B, C = one.weight * one.A, one.weight * one.B, one.weight * one.C
    left = count
    h = first + 1
    while h < left:
        share = filters[w, k, i, place_of(h, HypothesisColumn.weight)]
        older = filters[w, k, i, place_of(h, HypothesisColumn.age)] - one.age
        dx = vec2(
            filters[w, k, i, place_of(h, HypothesisColumn.x)] - one.position[0],
            filters[w, k, i, place_of(h, HypothesisColumn.y)] - one.position[1],
        )
        dv = vec2(0.0)
        most = ti.max(ALIKE, LIGHT / share)
        distance = AGES * older * older + dx.dot(m.A @ dx)
        if distance < most:
            dv = vec2(
                filters[w, k, i, place_of(h, HypothesisColumn.vx)] - one.velocity[0],
                filters[w, k, i, place_of(h, HypothesisColumn.vy)] - one.velocity[1],
            )
            rest = dv - m.G.transpose() @ dx
            distance += rest.dot(m.C @ rest)
        if distance < most:
            other = load(filters, w, k, i, h)
            weight += share
            age += share * older
            way += share * dx
            change += share * dv
            A += share * (other.A + dx.outer_product(dx))
            B += share * (other.B + dx.outer_product(dv))
            C += share * (other.C + dv.outer_product(dv))
            left -= 1
            move(filters, w, k, i, left, h)
        else:
            h += 1
    if left < count:
        whole = 1.0 / weight
        way *= whole
        change *= whole
        one.weight = weight
        one.age += whole * age
        one.position += way
        one.velocity += change
        one.A = whole * A - way.outer_product(way)
        one.B = whole * B - way.outer_product(change)
        one.C = whole * C - change.outer_product(change)
        store(filters, w, k, i, first, one)
    return left


@func
def reduce(filters: ti.template(), w, k, i):
    """Reduce the hypotheses, whose weights are shares of 1, to `KEPT`; then weights are logarithms."""
    count = count_of(filters, w, k, i)
    for first in range(KEPT):
        if first < count:
            bring_heaviest(filters, w, k, i, first, count)
            count = take_in(filters, w, k, i, first, count)
    count = ti.min(count, KEPT)
    for h in range(count):
        n = place_of(h, HypothesisColumn.weight)
        filters[w, k, i, n] = ti.log(filters[w, k, i, n])
    filters[w, k, i, FilterColumn.count] = count
