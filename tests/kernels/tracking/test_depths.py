"""Depths in the filter of a moving target: closed forms, consistency, the bound."""

import numpy as np
import pytest

from tests.kernels.tracking.rules import NOISE, STEP, Filters, along
from tests.kernels.tracking.test_range_filter import hypotheses, nees, straight
from usvauv.env.record.tracking_bound import range_information, rms, tracking_bound
from usvauv.kernels.tracking.hypotheses import HypothesisColumn

LIMITS = 5.0, 80.0  # m
VARIANCE = (LIMITS[1] - LIMITS[0]) ** 2 / 12


def depth(filters: Filters) -> tuple[np.ndarray, np.ndarray]:
    """Mean and variance of each filter's depth, (F,)."""
    one = np.nan_to_num(hypotheses(filters))
    share, z, zz = (one[..., c] for c in (HypothesisColumn.share, HypothesisColumn.z, HypothesisColumn.zz))
    mean = (share * z).sum(1)
    return mean, (share * (zz + z * z)).sum(1) - mean**2


def observe(filters: Filters, place: np.ndarray, target: np.ndarray, noise: np.ndarray) -> None:
    """Slant ranges to targets (F, 3) from places (F, 2) at the surface."""
    way = target - np.c_[place, np.zeros(len(place))]
    filters.observe(place, np.linalg.norm(way, axis=1) + noise, np.ones(len(place), bool))


@pytest.mark.parametrize("radius", [60.0, 300.0])
def test_a_target_at_rest_seen_from_a_circle(device, radius):
    """From the first range on: errors of place and depth as large as their covariances say, near the bound."""
    random, runs, steps = np.random.default_rng(1), 2000, 40
    target = np.c_[random.uniform(-10, 10, (runs, 2)), random.uniform(*LIMITS, runs)]
    filters = Filters(runs, straight(0.0, 1e-4), device, depths=LIMITS)
    information = np.zeros((runs, steps, 3, 3))
    for n in range(steps):
        place = np.tile(radius * along(np.array(2 * np.pi * n / steps * 7)), (runs, 1))
        filters.predict()
        observe(filters, place, target, random.normal(0, NOISE, runs))
        filters.finish()
        information[:, n] = range_information(np.c_[place, np.zeros(runs)], target, NOISE)
    start = np.diag([radius**2 / 2, radius**2 / 2, 1e-8, 1e-8, VARIANCE])
    bound = tracking_bound(information, start, STEP, 0.0)[:, -1]
    z, zz = depth(filters)
    assert np.mean((z - target[:, 2]) ** 2 / zz) == pytest.approx(1, abs=0.1)
    assert nees(filters, target[:, :2]).mean() == pytest.approx(1, abs=0.1)
    error = np.sqrt(np.mean(np.sum((filters.mean[:, :2] - target[:, :2]) ** 2, 1)))
    assert error == pytest.approx(np.sqrt(np.mean(rms(bound) ** 2)), rel=0.05)


@pytest.mark.parametrize("team", [1, 3])
def test_a_target_that_goes_straight_is_followed_consistently(device, team):
    """AUVs on circles of 80 m, from the first range on."""
    random, runs, steps, walk, speed = np.random.default_rng(7), 1000, 60, 0.005, 0.3
    target, velocity = np.zeros((runs, 2)), random.uniform(0, speed, (runs, 1)) * along(random.uniform(0, 7, runs))
    deep = random.uniform(*LIMITS, runs)
    filters = Filters(runs, [STEP, 0.0, speed, 1e6, 1e6, 0.6, 1.5, walk], device, depths=LIMITS)
    information, errors, squares, scaled = [], [], [], []
    for n in range(steps):
        velocity = velocity + walk * random.standard_normal((runs, 2))
        target = target + STEP * velocity
        both = np.c_[target, deep]
        filters.predict()
        information.append(np.zeros((runs, 3, 3)))
        for k in range(team):
            place = target + 80 * along(0.37 * n + 2 * np.pi * k / team + random.normal(0, 0.3, runs))
            observe(filters, place, both, random.normal(0, NOISE, runs))
            information[-1] += range_information(np.c_[place, np.zeros(runs)], both, NOISE)
        filters.finish()
        z, zz = depth(filters)
        squares.append(nees(filters, target))
        known = zz > 0  # not of those that begin anew
        scaled.append((z - deep)[known] ** 2 / zz[known])
        errors.append(np.linalg.norm(filters.mean[:, :2] - target, axis=1))
    start = np.diag([80.0**2 / 2, 80.0**2 / 2, speed**2 / 6, speed**2 / 6, VARIANCE])
    bound = np.sqrt(np.mean(rms(tracking_bound(np.stack(information, 1), start, STEP, walk)) ** 2, 0))
    assert np.mean(squares[10:]) == pytest.approx(1, abs=0.1)
    assert np.concatenate(scaled[10:]).mean() == pytest.approx(1, abs=0.15)
    assert np.sqrt(np.mean(np.square(errors), 1))[30:] == pytest.approx(bound[30:], rel=0.08)
