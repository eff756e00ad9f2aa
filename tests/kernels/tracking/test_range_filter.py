"""The filter of a moving target from ranges: closed forms, a Kalman filter, consistency, and a particle filter."""

import math

import numpy as np
import pytest

from tests.kernels.tracking.rules import LEVELS, NOISE, STEP, Filters, Particles, along, motion, simulate
from usvauv.kernels.functions import LANES
from usvauv.kernels.tracking.hypotheses import (
    CAPACITY,
    FIRST,
    KEPT,
    LEVEL,
    FilterColumn,
    HypothesisColumn,
    WorkColumn,
    columns_of,
)

NEVER = 1e6  # steps
COVARIANCE = HypothesisColumn.span("xx", "vv")
UPPER = np.triu_indices(4)


def straight(slowest: float, fastest: float, walk: float = 0.0) -> list[float]:
    """Numbers of `Motion` of a target that does not turn."""
    return [STEP, slowest, fastest, NEVER, NEVER, 0.6, 1.5, walk]


def hypotheses(filters: Filters) -> np.ndarray:
    """(F, KEPT, columns) in double precision; those beyond `count` are NaN."""
    rows = filters.rows[:, 0, 0].double().cpu().numpy()
    one = rows[:, FIRST:].reshape(len(rows), -1, KEPT).transpose(0, 2, 1).copy()
    one[np.arange(KEPT) >= rows[:, FilterColumn.count, None]] = np.nan
    return one


def full(covariance: np.ndarray) -> np.ndarray:
    """(..., 4, 4) of the upper triangles (..., 10)."""
    P = np.zeros((*covariance.shape[:-1], 4, 4))
    P[..., UPPER[0], UPPER[1]] = P[..., UPPER[1], UPPER[0]] = covariance
    return P


def set_one(filters: Filters, mean: np.ndarray, P: np.ndarray, age: float = 0.0) -> None:
    """Give filters one hypothesis each, of means (F, 4) and covariance (4, 4), before a step or within one."""
    rows = np.zeros((len(mean), columns_of(False)))
    one = rows[:, FIRST::KEPT]
    one[:, HypothesisColumn.share] = 1
    one[:, HypothesisColumn.age] = age
    one[:, HypothesisColumn.span("x", "vy")] = mean
    one[:, COVARIANCE] = P[UPPER]
    rows[:, [FilterColumn.known, FilterColumn.count]] = 1
    filters.rows[:, 0, 0] = filters.tensor(rows)
    work = np.zeros((len(mean), len(WorkColumn.names), CAPACITY))
    work[:, :LEVEL, 0] = one
    work[:, WorkColumn.volume] = 1
    filters.room[:] = filters.tensor(work.reshape(filters.room.shape))


def nees(filters: Filters, truth: np.ndarray) -> np.ndarray:
    """Squared errors (F,) over their covariance, halved: 1 on average."""
    error = filters.mean[:, :2] - truth
    return 0.5 * np.einsum("fa,fab,fb->f", error, np.linalg.inv(filters.covariance), error)


class TestClosedForms:
    def test_the_first_range_tells_of_a_ring(self, device):
        """Mean at the observer; covariance r²/2, half of the variances along and across, and the observer's own."""
        filters = Filters(3, straight(0, 1), device)
        place = np.array([[10.0, -20.0], [0, 0], [3000, 4000]])
        r, own = np.array([80.0, 400.0, 150.0]), np.array([25.0, -7.0, 9.0])
        filters.predict()
        filters.observe(place, r, np.array([True, True, False]), np.tile(own, (3, 1)))
        filters.finish()
        assert filters.known.tolist() == [True, True, False]
        across = np.maximum(np.pi * r / KEPT, NOISE) ** 2
        for n in range(2):
            expected = np.diag([0.5, 0.5]) * (r[n] ** 2 + NOISE**2 + across[n]) + [[25, -7], [-7, 9]]
            assert filters.mean[n] == pytest.approx([*place[n], 0, 0], abs=1e-3)
            assert filters.covariance[n] == pytest.approx(expected, rel=1e-5, abs=0.01)
        assert not np.any(filters.rows[2, 0, 0, [FilterColumn.x, FilterColumn.y]].cpu().numpy())

    def test_a_turn_has_the_moments_of_its_angles(self, device):
        """A step in which the target turns or not, by quadrature over the angles, from a known and an unknown state."""
        least, greatest, least_turn, greatest_turn = 3, 5, 0.4, 1.6
        numbers = [STEP, 0.0, 100.0, least, greatest, least_turn, greatest_turn, 0.01]
        root = np.random.default_rng(3).normal(size=(4, 4)) * np.array([[9.0], [9.0], [0.1], [0.1]])
        mean = np.array([40.0, 70.0, 0.5, -0.3])
        theta = least_turn + (np.arange(20000) + 0.5) / 20000 * (greatest_turn - least_turn)
        for age, probability in ((1.0, 0.0), (2.0, 1 / 3), (3.0, 1 / 2)):
            for P in (1e-4 * np.eye(4), root @ root.T):
                filters = Filters(1, numbers, device)
                set_one(filters, mean[None], P, age)
                filters.predict()
                filters.finish()
                angles, share = np.concatenate([[0.0], theta, -theta]), np.full(40001, probability / 40000)
                share[0] = 1 - probability
                F = np.zeros((len(angles), 4, 4))
                c, s = np.cos(angles), np.sin(angles)
                F[:, 2:, 2:] = np.array([[c, -s], [s, c]]).transpose(2, 0, 1)
                F[:, :2, 2:] = STEP * F[:, 2:, 2:]
                F[:, [0, 1], [0, 1]] = 1
                noise = np.kron([[STEP**2, STEP], [STEP, 1]], 1e-4 * np.eye(2))
                means = F @ mean
                expected = share @ means
                error = means - expected
                second = np.einsum("n,nab,bc,ndc->ad", share, F, P, F) + np.einsum("n,na,nb->ab", share, error, error)
                assert filters.mean[0] == pytest.approx(expected, rel=1e-4, abs=1e-4)
                assert filters.covariance[0] == pytest.approx((second + noise)[:2, :2], rel=1e-3, abs=0.02)

    def test_a_target_at_rest_seen_from_a_circle(self, device):
        """After N ranges all round it the information is N/(2σ²) per axis: rms 2σ/√N."""
        random, runs, steps = np.random.default_rng(1), 2000, 40
        target = random.uniform(-30, 30, (runs, 2))
        filters = Filters(runs, straight(0.0, 1e-4), device)
        for n in range(steps):
            place = 500 * np.tile(along(np.array(2 * np.pi * n / steps * 7)), (runs, 1))
            distance = np.linalg.norm(target - place, axis=1) + random.normal(0, NOISE, runs)
            filters.predict()
            filters.observe(place, distance, np.ones(runs, bool))
            filters.finish()
        rms = math.sqrt(((filters.mean[:, :2] - target) ** 2).sum(1).mean())
        assert rms == pytest.approx(2 * NOISE / math.sqrt(steps), rel=0.04)
        assert nees(filters, target).mean() == pytest.approx(1, abs=0.08)

    def test_the_observers_uncertainty_counts_along_the_line_of_sight(self, device):
        """R + uᵀ P u: the same as a noisier range; uncertainty across adds nothing from so far away."""
        P, mean = np.diag([400.0, 400.0, 0.01, 0.01]), np.array([[0.0, 0.0, 0.1, 0.2]])
        u = np.array([0.6, 0.8])
        place, across = np.array([[-0.6, -0.8]]) * 5000, np.array([0.8, -0.6])
        own = 300 * np.outer(u, u) + 9 * np.outer(across, across)
        results = []
        for covariance, variance in ((own, 100.0), (np.zeros((2, 2)), 400.0)):
            filters = Filters(1, straight(0, 1), device)
            set_one(filters, mean, P)
            upper = covariance[[0, 0, 1], [0, 1, 1]][None]
            filters.observe(place, np.array([5030.0]), np.array([True]), upper, np.array([variance]))
            filters.finish()
            results.append((filters.mean, filters.covariance))
        assert results[0][0] == pytest.approx(results[1][0], abs=1e-3)
        assert results[0][1] == pytest.approx(results[1][1], rel=1e-4, abs=0.05)
        assert u @ results[0][1][0] @ u == pytest.approx(1 / (1 / 400 + 1 / 400), rel=1e-3)


def test_the_observers_uncertainty_across_the_line_of_sight_bends_it(device):
    """As that of the target does: what a range of 75 m tells along it is the same where either is known to 30 m."""
    along, across, found = np.diag([400.0, 1e-6, 1e-4, 1e-4]), np.diag([0.0, 900.0]), []
    for covariance in (np.zeros((2, 2)), across):
        filters = Filters(1, straight(0, 1), device)
        P = along.copy()
        P[:2, :2] += across - covariance
        set_one(filters, np.array([[60.0, 0.0, 0.0, 0.0]]), P)
        filters.observe(np.zeros((1, 2)), np.array([75.0]), np.array([True]), covariance[[0, 0, 1], [0, 1, 1]][None])
        filters.finish()
        found.append((filters.mean[0, 0], filters.covariance[0, 0, 0]))
    assert found[0] == pytest.approx(found[1], rel=1e-4)
    assert found[0][0] < 60 + 0.8 * 15 - 3  # the gain, and 15 m of which 6.7 m are by the bend


def test_the_line_of_sight_bends(device):
    """One range at 60 m of a target known to 20 m along and 30 m across: errors as large as their covariance says."""
    random, runs = np.random.default_rng(6), 20000
    P = np.diag([400.0, 900.0, 1e-4, 1e-4])
    truth = random.multivariate_normal([60, 0], P[:2, :2], runs)
    filters = Filters(runs, straight(0, 1), device)
    set_one(filters, np.tile([60.0, 0.0, 0.0, 0.0], (runs, 1)), P)
    distance = np.linalg.norm(truth, axis=1) + random.normal(0, NOISE, runs)
    filters.observe(np.zeros((runs, 2)), distance, np.ones(runs, bool))
    filters.finish()
    error = filters.mean[:, :2] - truth
    assert (error[:, 0] ** 2).mean() == pytest.approx(filters.covariance[:, 0, 0].mean(), rel=0.04)
    assert error.mean(0) == pytest.approx([0, 0], abs=0.6)


def test_from_far_away_it_is_a_kalman_filter(device):
    """Observers so far away that lines of sight stay as they are, and a target without turns."""
    random, runs, steps, walk = np.random.default_rng(2), 5, 60, 0.005
    P = np.diag([90.0, 40.0, 0.02, 0.01])
    P[0, 2] = P[2, 0] = 0.5
    F = np.eye(4)
    F[0, 2] = F[1, 3] = STEP
    Q = walk**2 * np.kron([[STEP**2, STEP], [STEP, 1]], np.eye(2))
    truth = random.multivariate_normal(np.zeros(4), P, runs)
    mean = np.zeros((runs, 4))
    filters = Filters(runs, straight(0.0, 90.0, walk), device)
    set_one(filters, mean, P)
    for n in range(steps):
        truth = truth @ F.T + random.multivariate_normal(np.zeros(4), Q, runs)
        u = along(np.array(2.4 * n))
        mean, P = mean @ F.T, F @ P @ F.T + Q
        z = truth[:, :2] @ u + random.normal(0, NOISE, runs)
        filters.predict()
        # Each observer stands so that its line of sight to where the target is expected has the direction u.
        place = mean[:, :2] - 40000 * u
        filters.observe(place, 40000 + z - mean[:, :2] @ u, np.full(runs, n % 5 != 0))
        filters.finish()
        if n % 5:
            H = np.array([*u, 0, 0])
            gain = P @ H / (H @ P @ H + NOISE**2)
            mean = mean + np.outer(z - mean @ H, gain)
            P = P - np.outer(gain, H @ P)
        assert np.linalg.norm(filters.mean[:, :2] - mean[:, :2], axis=1).max() < 0.02 * math.sqrt(np.trace(P[:2, :2]))
        assert filters.covariance == pytest.approx(np.tile(P[:2, :2], (runs, 1, 1)), rel=0.01, abs=0.1)


class TestRules:
    """Targets by the rules of UTracking, from the first range on."""

    @pytest.mark.parametrize(
        ("level", "pairs"), [("easy", 1), ("medium", 1), ("hard", 1), ("medium", 3), ("hard", 3)], ids=str
    )
    def test_squared_errors_are_as_large_as_their_covariances_say(self, device, level, pairs):
        """Mean 1, but for the few in which the AUV has lost its target unawares, and 95 % of ellipses hold it."""
        outcome = simulate(
            lambda count, level: Filters(count, motion(level), device),
            LEVELS[level],
            runs=400 if pairs == 1 else 40,
            pairs=pairs,
            seed=11,
        )
        squared = outcome.nees[np.isfinite(outcome.nees)]
        unawares = squared > 20  # of a χ² of two degrees of freedom 2e-9
        assert unawares.mean() < 0.006
        assert squared[~unawares].mean() == pytest.approx(1, abs=0.14)
        assert np.mean(squared < -math.log(0.05)) == pytest.approx(0.95, abs=0.015)

    @pytest.mark.slow
    def test_filters_of_targets_as_fast_as_auvs_are_consistent(self, device):
        """Setting expert, where mirror images last: mean near 1 with all that were lost unawares, which are few."""
        outcome = simulate(
            lambda count, level: Filters(count, motion(level), device), LEVELS["expert"], runs=150, pairs=3, seed=11
        )
        squared = outcome.nees[np.isfinite(outcome.nees)]
        assert np.mean(squared > 20) < 0.003
        assert squared.mean() == pytest.approx(1, abs=0.25)

    def test_reduced_hypotheses_keep_the_moments_of_all(self, device):
        """Shares sum to 1, and mean and covariance are those before, also of filters that keep as many as they can."""
        most = []

        class Weighed(Filters):
            def finish(self) -> None:
                super().finish()
                one = np.nan_to_num(hypotheses(self)[self.known])
                share = one[..., HypothesisColumn.share]
                assert share.sum(axis=1) == pytest.approx(1, abs=1e-4)
                error = one[..., HypothesisColumn.span("x", "vy")] - self.mean[self.known, None]
                assert np.einsum("fh,fha->fa", share, error) == pytest.approx(0, abs=0.01)
                second = full(one[..., COVARIANCE]) + error[..., None] * error[..., None, :]
                covariance = np.einsum("fh,fhab->fab", share, second)[:, :2, :2]
                assert covariance == pytest.approx(self.covariance[self.known], rel=1e-3, abs=0.05)
                most.append(int(self.rows[:, 0, 0, FilterColumn.count].max()))

        simulate(lambda count, level: Weighed(count, motion(level), device), LEVELS["expert"], runs=10, pairs=3, seed=3)
        assert max(most) == KEPT

    @pytest.mark.slow
    def test_nearly_as_good_as_particles_that_know_the_rules(self, device):
        """Each by itself: AUVs circle what their own filter says."""
        level, setting = LEVELS["medium"], {"runs": 150, "pairs": 1, "seed": 5}
        ours = simulate(lambda count, level: Filters(count, motion(level), device), level, **setting)
        best = simulate(lambda count, level: Particles(count, level, 15000, seed=1), level, **setting)
        assert np.nanmedian(ours.error) < 1.15 * np.nanmedian(best.error)
        assert np.nanmean(ours.error) < 1.2 * np.nanmean(best.error)


class TestRobustness:
    def run(self, device, numbers, velocity, *, steps, lost, runs=64, seed=4, in_lanes=None):
        """Filters after `steps`, an AUV on a circle of 60 m round where the target really is; yields each step."""
        random = np.random.default_rng(seed)
        filters = Filters(runs, numbers, device)
        filters.in_lanes = filters.in_lanes if in_lanes is None else in_lanes
        target = np.zeros((runs, 2))
        for n in range(steps):
            target = target + STEP * velocity(n, random, runs)
            place = target + 60 * along(np.full(runs, 0.5 * n))
            distance = np.linalg.norm(target - place, axis=1) + random.normal(0, NOISE, runs)
            filters.predict()
            filters.observe(place, distance, random.random(runs) >= lost)
            filters.finish()
            yield n, filters, target

    def test_covariances_stay_positive_definite(self, device):
        """In 2,000 steps, each hypothesis, scaled to correlations."""

        def velocity(n, random, runs):
            return 0.5 * along(random.normal(0, 0.02, runs) + (n // 10) * 1.2)

        level = LEVELS["hard"]
        for last in self.run(device, motion(level), velocity, steps=2000, lost=0.3, runs=16):
            n, filters, _ = last
            if n % 50 == 0 and n > 0:
                one = hypotheses(filters)
                P = full(one[~np.isnan(one[..., 0])][:, COVARIANCE])
                scale = np.sqrt(np.einsum("nii->ni", P))
                assert scale.min() > 0
                correlation = P / (scale[:, :, None] * scale[:, None])
                assert np.linalg.eigvalsh(correlation).min() > 0
                assert np.linalg.eigvalsh(filters.covariance).min() > 0
        _, filters, target = last
        assert np.median(np.linalg.norm(filters.mean[:, :2] - target, axis=1)) < 40

    @pytest.mark.parametrize("speed", [0.0, 1.2, 3.0])
    def test_a_target_beyond_its_rule(self, device, speed):
        """Filters that assume 0.49 to 0.69 m/s stay finite, and near where the target is."""

        def velocity(n, random, runs):
            return np.tile([speed, 0.0], (runs, 1))

        *_, (_, filters, target) = self.run(device, motion(LEVELS["hard"]), velocity, steps=400, lost=0.1)
        assert np.isfinite(filters.rows.cpu().numpy()).all()
        assert np.median(np.linalg.norm(filters.mean[:, :2] - target, axis=1)) < 150

    def test_a_filter_that_ranges_contradict_begins_anew(self, device):
        """From a place 400 m off of which it is sure, and a velocity that leads away, within 30 steps."""

        def velocity(n, random, runs):
            return np.tile([0.6, 0.0], (runs, 1))

        for n, filters, target in self.run(device, motion(LEVELS["hard"]), velocity, steps=60, lost=0.1):
            if n == 29:
                wrong = np.concatenate([target - [400.0, 0.0], np.tile([-0.6, 0.0], (len(target), 1))], 1)
                set_one(filters, wrong, np.diag([25.0, 25.0, 1e-4, 1e-4]))
        assert np.median(np.linalg.norm(filters.mean[:, :2] - target, axis=1)) < 40

    def test_hypotheses_by_themselves_are_those_side_by_side(self, device):
        """As on a GPU: for 12 steps from the first range on, in which they turn and merge, but for rounding."""

        def velocity(n, random, runs):
            return np.tile([0.5, 0.3], (runs, 1))

        results = []
        for in_lanes in (False, True):
            made = self.run(device, motion(LEVELS["hard"]), velocity, steps=12, lost=0.1, in_lanes=in_lanes)
            results.append(
                np.array([np.c_[f.mean[:, :2], f.rows[:, 0, 0, FilterColumn.count].cpu()] for _, f, _ in made])
            )
        difference = np.abs(results[0] - results[1])
        assert np.median(difference[..., :2].max(-1), axis=1).max() < 0.01
        assert results[1][..., 2].max() > LANES
        assert np.median(difference[..., 2]) == 0

    def test_without_ranges_it_knows_nothing(self, device):
        filters = Filters(2, motion(LEVELS["hard"]), device)
        for _ in range(30):
            filters.predict()
            filters.observe(np.zeros((2, 2)), np.ones(2), np.zeros(2, bool))
            filters.finish()
        assert not filters.known.any()
        assert np.isfinite(filters.rows.cpu().numpy()).all()
