"""The bound of tracking errors: closed forms, Riccati's equation, and a filter that reaches it."""

import math

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from usvauv.env.record.tracking_bound import bearing_information, range_information, rms, tracking_bound

SIGMA = 7.0  # m
FREE = 1e6 * np.eye(4)


def round_about(directions, distance):
    """Places at a distance from the origin, (N, 2)."""
    return distance * np.stack([np.cos(directions), np.sin(directions)], -1)


def equally_spaced(count):
    return 2 * np.pi * np.arange(count) / count + 0.3


class TestRanges:
    @pytest.mark.parametrize("count", [3, 4, 7])
    def test_equal_spacing_reaches_the_greatest_determinant(self, count):
        J = range_information(round_about(equally_spaced(count), 80.0), np.zeros(2), SIGMA).sum(0)
        assert np.linalg.det(J) == pytest.approx(count**2 / (4 * SIGMA**4))
        assert rms(np.linalg.inv(J)) == pytest.approx(2 * SIGMA / math.sqrt(count))

    def test_two_are_best_at_right_angles_and_worthless_opposite(self):
        right, opposite = (
            range_information(round_about(np.array([0.2, 0.2 + angle]), 80.0), np.zeros(2), SIGMA).sum(0)
            for angle in (np.pi / 2, np.pi)
        )
        assert np.linalg.det(right) == pytest.approx(1 / SIGMA**4)
        assert np.linalg.det(opposite) == pytest.approx(0, abs=1e-9)

    def test_no_geometry_exceeds_it(self):
        random = np.random.default_rng(1)
        observers = random.normal(0, 100, (5000, 5, 2))
        J = range_information(observers, np.zeros(2), SIGMA).sum(1)
        determinant = np.linalg.det(J) * 4 * SIGMA**4 / 25
        assert 0.95 < determinant.max() <= 1 + 1e-9
        assert np.einsum("nii->n", J) == pytest.approx(np.full(5000, 5 / SIGMA**2))

    def test_a_known_depth_leaves_a_share(self):
        r, h = 60.0, 80.0
        flat, deep = (range_information(np.array([r, 0.0]), np.zeros(2), SIGMA, depth)[0, 0] for depth in (0.0, h))
        assert deep / flat == pytest.approx(r**2 / (r**2 + h**2))

    def test_it_is_the_gradients(self):
        """Of a slant range by differences."""
        observer, target, h, small = np.array([30.0, -40.0]), np.array([5.0, 8.0]), 25.0, 1e-4

        def slant(place):
            return math.sqrt(((place - observer) ** 2).sum() + h**2)

        gradient = [(slant(target + small * axis) - slant(target - small * axis)) / (2 * small) for axis in np.eye(2)]
        assert range_information(observer, target, SIGMA, h) == pytest.approx(np.outer(gradient, gradient) / SIGMA**2)

    def test_unknown_depth_is_best_seen_from_root_two_times_it(self):
        """det J and tr J⁻¹ of (x, y, z) have their extremes at r = √2 h."""
        h, distance = 50.0, np.linspace(20, 200, 1801)
        places = round_about(equally_spaced(3), 1.0)[None] * distance[:, None, None]
        J = range_information(np.pad(places, ((0, 0), (0, 0), (0, 1))), np.array([0.0, 0.0, h]), SIGMA).sum(1)
        horizontal = range_information(places, np.zeros(2), SIGMA, h).sum(1)
        assert J[:, :2, :2] == pytest.approx(horizontal)
        for best in (np.linalg.det(J).argmax(), np.einsum("rii->r", np.linalg.inv(J)).argmin()):
            assert distance[best] == pytest.approx(math.sqrt(2) * h, abs=0.06)


class TestBearings:
    def test_the_error_grows_with_the_distance(self):
        for r in (40.0, 160.0):
            J = bearing_information(round_about(equally_spaced(5), r), np.zeros(2), 0.02).sum(0)
            assert rms(np.linalg.inv(J)) == pytest.approx(2 * 0.02 * r / math.sqrt(5))

    def test_it_is_the_gradients(self):
        observer, target, small = np.array([30.0, -40.0]), np.array([5.0, 8.0]), 1e-4

        def bearing(place):
            return math.atan2(*(place - observer)[::-1])

        gradient = [
            (bearing(target + small * axis) - bearing(target - small * axis)) / (2 * small) for axis in np.eye(2)
        ]
        assert bearing_information(observer, target, 0.1) == pytest.approx(np.outer(gradient, gradient) / 0.01)


class TestRecursion:
    def test_a_target_at_rest_from_one_observer_that_circles(self):
        """N ranges of one observer that goes round: as N observers at once, 2σ/√N."""
        count = 24
        start = np.diag([1e6, 1e6, 1e-12, 1e-12])
        J = range_information(round_about(equally_spaced(count), 60.0), np.zeros(2), SIGMA)
        assert rms(tracking_bound(J, start, 30.0, 0.0)[-1]) == pytest.approx(2 * SIGMA / math.sqrt(count), rel=1e-4)

    def test_a_target_at_rest_of_unknown_depth(self):
        """From all round it the horizontal error is as with known depth, 2σ √(1 + h²/r²)/√N, that of depth
        σ √(r² + h²)/(h √N).
        """
        count, r, h = 24, 60.0, 40.0
        places = np.pad(round_about(equally_spaced(count), r), ((0, 0), (0, 1)))
        J = range_information(places, np.array([0.0, 0.0, h]), SIGMA)
        bound = tracking_bound(J, np.diag([1e6, 1e6, 1e-12, 1e-12, 1e6]), 30.0, 0.0)[-1]
        assert rms(bound) == pytest.approx(2 * SIGMA * math.hypot(1, h / r) / math.sqrt(count), rel=1e-4)
        assert math.sqrt(bound[4, 4]) == pytest.approx(SIGMA * math.hypot(r, h) / h / math.sqrt(count), rel=1e-4)

    @pytest.mark.parametrize("count", [2, 10, 40])
    def test_a_straight_way_is_a_regression(self, count):
        """The end of a straight line through N points of the variance s²: s² 2(2N − 1)/(N(N + 1)), per axis."""
        observers = round_about(equally_spaced(3), 60.0)
        along = np.arange(count)[:, None] * np.array([17.0, -5.0])
        J = range_information(observers + along[:, None], along[:, None], SIGMA).sum(1)
        start = np.diag([1e8, 1e8, 1e6, 1e6])
        variance = 2 * SIGMA**2 / 3 * 2 * (2 * count - 1) / (count * (count + 1))
        assert rms(tracking_bound(J, start, 30.0, 0.0)[-1]) == pytest.approx(math.sqrt(2 * variance), rel=1e-4)

    def test_a_circle_that_moves_along_soon_does_as_well(self):
        """One observer on a circle round a moving target: as a third as many steps of three, but for the unevenness."""
        count = 120
        along = np.arange(count)[:, None] * np.array([17.0, -5.0])
        J = range_information(along + round_about(2.4 * np.arange(count), 60.0), along, SIGMA)
        variance = 2 * SIGMA**2 * 2 * (2 * count - 1) / (count * (count + 1))
        bound = tracking_bound(J, np.diag([1e8, 1e8, 1e6, 1e6]), 30.0, 0.0)[-1]
        assert rms(bound) == pytest.approx(math.sqrt(2 * variance), rel=0.01)

    def test_it_settles_where_riccatis_equation_says(self):
        step, walk, count = 30.0, 0.03, 4
        J = range_information(round_about(equally_spaced(count), 60.0), np.zeros(2), SIGMA).sum(0)
        bound = tracking_bound(np.tile(J, (300, 1, 1)), FREE, step, walk)[-1]
        F = np.array([[1, step], [0, 1]])
        Q = walk**2 * np.array([[step**2, step], [step, 1]])
        R = np.array([[2 * SIGMA**2 / count]])
        prior = solve_discrete_are(F.T, np.array([[1.0], [0]]), Q, R)
        posterior = prior - np.outer(prior[:, 0], prior[0]) / (prior[0, 0] + R)
        assert bound[np.ix_([0, 2], [0, 2])] == pytest.approx(posterior, rel=1e-6)
        assert rms(bound) == pytest.approx(math.sqrt(2 * posterior[0, 0]), rel=1e-6)

    def test_runs_side_by_side(self):
        random = np.random.default_rng(3)
        J = range_information(random.normal(0, 90, (6, 20, 2, 2)), np.zeros(2), SIGMA).sum(2)
        together = tracking_bound(J, FREE, 30.0, 0.02)
        for n in range(6):
            assert together[n] == pytest.approx(tracking_bound(J[n], FREE, 30.0, 0.02))
