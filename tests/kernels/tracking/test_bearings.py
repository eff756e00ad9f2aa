"""Bearings in the filter of a moving target: closed forms, a Kalman filter's update, consistency, the bound."""

import math

import numpy as np
import pytest

from tests.kernels.tracking.rules import REACH, STEP, Filters, along, observe_bearings_all
from tests.kernels.tracking.test_range_filter import nees, set_one, straight
from usvauv.env.record.tracking_bound import bearing_information, rms, tracking_bound
from usvauv.kernels.tracking.bearings import SPAN

DEVIATION = 0.03  # rad


def bearing(place: np.ndarray, target: np.ndarray, noise: np.ndarray | float = 0.0) -> np.ndarray:
    """Measured bearings, rad, in ±π."""
    way = target - place
    return (np.arctan2(way[..., 1], way[..., 0]) + noise + np.pi) % (2 * np.pi) - np.pi


def observe(filters: Filters, place: np.ndarray, measured: np.ndarray, **more: np.ndarray) -> None:
    count = len(filters.rows)
    variance = np.full(count, DEVIATION**2)
    filters.observe(place, measured, np.ones(count, bool), variance=variance, kernel=observe_bearings_all, **more)


def test_the_first_bearing_tells_of_a_ray(device):
    """Across it σ r, along it a uniform density of the distance from the nearest to the farthest."""
    filters = Filters(1, straight(0, 1), device)
    filters.predict()
    observe(filters, np.array([[100.0, 50.0]]), np.array([math.pi / 2]))
    filters.finish()
    nearest = REACH / SPAN
    assert filters.mean[0, :2] == pytest.approx([100, 50 + (nearest + REACH) / 2], rel=1e-3)
    assert filters.covariance[0, 1, 1] == pytest.approx((REACH - nearest) ** 2 / 12, rel=5e-3)
    square = (REACH**3 - nearest**3) / (3 * (REACH - nearest))
    assert filters.covariance[0, 0, 0] == pytest.approx(DEVIATION**2 * square, rel=0.01)


def test_the_line_of_sight_bends(device):
    """One bearing at 100 m of a target known to 20 m, its errors along and across correlated: errors without a mean,
    and as large as their covariance says."""
    random, runs = np.random.default_rng(6), 40000
    P = np.diag([400.0, 400.0, 1e-4, 1e-4])
    P[0, 1] = P[1, 0] = 200.0
    truth, here = random.multivariate_normal([100, 0], P[:2, :2], runs), np.zeros((runs, 2))
    filters = Filters(runs, straight(0, 1), device)
    set_one(filters, np.tile([100.0, 0.0, 0.0, 0.0], (runs, 1)), P)
    observe(filters, here, bearing(here, truth, random.normal(0, DEVIATION, runs)))
    filters.finish()
    error = filters.mean[:, :2] - truth
    assert error.mean(0) == pytest.approx([0, 0], abs=0.4)
    assert (error**2).mean(0) == pytest.approx(filters.covariance[:, [0, 1], [0, 1]].mean(0), rel=0.05)
    assert nees(filters, truth).mean() == pytest.approx(1, abs=0.04)


def test_a_target_at_rest_seen_from_a_circle(device):
    """N bearings from all round it: rms 2σr/√N, from the first bearing on, and as large as the covariance says."""
    random, runs, steps, r = np.random.default_rng(1), 2000, 40, 200.0
    target = random.uniform(-5, 5, (runs, 2))
    filters = Filters(runs, straight(0.0, 1e-4), device)
    for n in range(steps):
        place = np.tile(r * along(np.array(2 * np.pi * n / steps * 7)), (runs, 1))
        filters.predict()
        observe(filters, place, bearing(place, target, random.normal(0, DEVIATION, runs)))
        filters.finish()
    error = math.sqrt(((filters.mean[:, :2] - target) ** 2).sum(1).mean())
    assert error == pytest.approx(2 * DEVIATION * r / math.sqrt(steps), rel=0.05)
    assert nees(filters, target).mean() == pytest.approx(1, abs=0.1)


def test_a_small_error_is_that_of_a_kalman_filter(device):
    """One bearing of a target known to a few metres, due west, with an observer whose place is uncertain."""
    P = np.diag([9.0, 4.0, 0.04, 0.01])
    P[1, 3] = P[3, 1] = 0.1
    filters = Filters(1, straight(0, 1), device)
    set_one(filters, np.array([[-400.0, 0.0, 0.1, 0.2]]), P)
    own = np.array([[50.0, 0.0, 6.0]])
    observe(filters, np.zeros((1, 2)), np.array([-math.pi + 0.01]), covariance=own)
    filters.finish()
    H = np.array([0, -1 / 400, 0, 0])  # to the south of due west the bearing, from −π on, grows
    gain = P @ H / (H @ P @ H + DEVIATION**2 + 6.0 / 400**2)
    assert filters.mean[0] == pytest.approx(np.array([-400, 0, 0.1, 0.2]) + gain * 0.01, rel=1e-3, abs=1e-3)
    assert filters.covariance[0] == pytest.approx((P - np.outer(gain, H @ P))[:2, :2], rel=2e-3, abs=1e-3)


@pytest.mark.parametrize("team", [1, 2])
def test_a_target_that_goes_straight_is_followed_consistently(device, team):
    """AUVs that weave, from the first bearing on: squared errors as large as covariances say, near the bound."""
    random, runs, steps, walk, speed = np.random.default_rng(7), 1000, 40, 0.005, 0.3
    place = np.zeros((runs, team, 2))
    place[:, 1:] = [0.0, 300.0]
    angle = random.uniform(0, 2 * np.pi, runs)
    target = random.uniform(60, 400, (runs, 1)) * along(angle)
    velocity = random.uniform(0, speed, (runs, 1)) * along(random.uniform(0, 2 * np.pi, runs))
    filters = Filters(runs, [STEP, 0.0, speed, 1e6, 1e6, 0.6, 1.5, walk], device)
    information, errors, squares = [], [], []
    for n in range(steps):
        velocity = velocity + walk * random.standard_normal((runs, 2))
        target = target + STEP * velocity
        legs = angle + (np.pi / 2 if n // 4 % 2 else -np.pi / 2) + 0.4
        place = place + 60 * along(legs)[:, None]
        filters.predict()
        for k in range(team):
            observe(filters, place[:, k], bearing(place[:, k], target, random.normal(0, DEVIATION, runs)))
        filters.finish()
        information.append(sum(bearing_information(place[:, k], target, DEVIATION) for k in range(team)))
        squares.append(nees(filters, target))
        errors.append(np.linalg.norm(filters.mean[:, :2] - target, axis=1))
    start = np.diag([REACH**2 / 6, REACH**2 / 6, speed**2 / 6, speed**2 / 6])
    bound = np.sqrt(np.mean(rms(tracking_bound(np.stack(information, 1), start, STEP, walk)) ** 2, 0))
    squared, error = np.array(squares)[10:], np.sqrt(np.mean(np.square(errors), 1))
    assert squared.mean() == pytest.approx(1, abs=0.15)
    assert np.mean(squared < -math.log(0.05)) == pytest.approx(0.95, abs=0.02)
    assert error[20:] == pytest.approx(bound[20:], rel=0.12)
