"""The tracker: closed forms, a filter in double precision, consistency, gate, and missions; beside Stone Soup."""

import math

import numpy as np
import pytest
import torch
from scipy import stats
from scipy.linalg import expm, solve_discrete_are

from usvauv.kernels.functions import kernel
from usvauv.kernels.positioning import tracker
from usvauv.kernels.types import array1, array2, array3, vec2, vec3

UPPER = np.triu_indices(4)


@kernel
def drift_together(track: array3, time: array1, carried: vec2, variance: float, correlation_time: float):
    for n in range(time.shape[0]):
        for k in range(track.shape[1]):
            tracker.drift(track, n, k, carried, time[n], variance, correlation_time)


@kernel
def follow_steps(
    carried: array3,
    adrift: array2,
    fix: array3,
    covariance: array3,
    variance: float,
    correlation_time: float,
    track: array3,
    squared: array2,
):
    """Tracks (T + 1, N, COLUMNS) over steps of 1 s; an AUV that is not adrift holds its place."""
    for n in range(track.shape[1]):
        for t in range(carried.shape[0]):
            for c in range(track.shape[2]):
                track[t + 1, n, c] = track[t, n, c]
            if adrift[t, n] > 0.0:
                moved = vec2(carried[t, n, 0], carried[t, n, 1])
                tracker.drift(track, t + 1, n, moved, 1.0, variance, correlation_time)
            else:
                tracker.renew(track, t + 1, n, 1.0, variance, correlation_time)
            track[t + 1, n, tracker.REJECTED_AGE] = track[t + 1, n, tracker.REJECTED_AGE] + 1.0
            squared[t, n] = -1.0
            if covariance[t, n, 0] > 0.0:
                place = vec2(fix[t, n, 0], fix[t, n, 1])
                R = vec3(covariance[t, n, 0], covariance[t, n, 1], covariance[t, n, 2])
                squared[t, n] = tracker.update(track, t + 1, n, place, R, variance, 5.0)


EXTREME_CURRENT = {"variance": 0.22, "correlation_time": 180.0}


def single(array, device):
    return torch.tensor(np.ascontiguousarray(array, np.float32), device=device)


def begin(position, covariance, variance, device):
    """Tracks (N, COLUMNS) at positions (N, 2) with covariances (N, 3) in an unknown current."""
    start = np.zeros((len(position), tracker.COLUMNS))
    start[:, [tracker.X, tracker.Y]] = position
    start[:, [tracker.XX, tracker.XY, tracker.YY]] = covariance
    start[:, [tracker.UU, tracker.VV]] = variance
    return single(start, device)


def covariances(track):
    """(..., 4, 4) of tracks (..., COLUMNS)."""
    full = np.zeros((*track.shape[:-1], 4, 4))
    full[..., UPPER[0], UPPER[1]] = full[..., UPPER[1], UPPER[0]] = track[..., tracker.XX : tracker.VV + 1]
    return full


def follow(device, start, velocity, adrift, fix, covariance, *, variance, correlation_time):
    """Tracks (T + 1, N, COLUMNS) in double precision and squared innovations (T, N), −1 without a fix.

    Args:
        start: (N, COLUMNS). velocity: (T, N, 2), measured, m/s. adrift: (T, N), 1 or 0 where the AUV holds its place.
        fix: (T, N, 2), m. covariance: (T, N, 3), m², 0 of a lost fix.
    """
    track = start.new_zeros((len(velocity) + 1, *start.shape))
    track[0] = start
    squared = start.new_zeros(adrift.shape)
    arrays = (single(array, device) for array in (velocity, adrift, fix, covariance))
    follow_steps(*arrays, variance, correlation_time, track, squared)
    return track.double().cpu().numpy(), squared.double().cpu().numpy()


def second_of(variance, correlation_time, adrift=1.0):
    """F and Q (4, 4) of the state over a second (Van Loan 1978, doi 10.1109/TAC.1978.1101743)."""
    A = np.kron([[0, adrift], [0, -1 / correlation_time]], np.eye(2))
    noise = np.diag([0, 0, 1, 1]) * 2 * variance / correlation_time
    both = expm(np.block([[-A, noise], [np.zeros((4, 4)), A.T]]))
    return both[4:, 4:].T, both[4:, 4:].T @ both[:4, 4:]


def simulate(seed, steps, count, variance, correlation_time, *, lost=0.0, hover=0.1):
    """Truth and fixes of N AUVs as the filter's model has them: the arguments of `follow`, and the true states."""
    random = np.random.default_rng(seed)
    F, Q = second_of(variance, correlation_time)
    still, Q_still = second_of(variance, correlation_time, 0.0)
    current = math.sqrt(variance) * random.standard_normal((count, 2))
    state = np.concatenate([random.uniform(50, 150, (count, 2)), current], -1)
    adrift = (random.random((steps, count)) >= hover).astype(float)
    angle = np.cumsum(0.2 * random.standard_normal((steps, count)), 0)
    velocity = 1.5 * np.stack([np.cos(angle), np.sin(angle)], -1)
    root = random.normal(0, 0.2, (steps + 1, count, 2, 2)) + 0.3 * np.eye(2)
    root = np.concatenate((root, np.broadcast_to(0.1 * np.eye(2), root.shape)), -1)  # no covariance is near singular
    covariance = (root @ root.swapaxes(-1, -2))[..., [0, 0, 1], [0, 1, 1]]
    noise = np.einsum("tnij,tnj->tni", root, random.standard_normal((steps + 1, count, 4)))
    start = state[:, :2] + noise[-1]
    truth, fix = np.zeros((steps, count, 4)), np.zeros((steps, count, 2))
    for t in range(steps):
        drawn = [random.multivariate_normal(np.zeros(4), each, count) for each in (Q, Q_still)]
        moved = state @ F.T + drawn[0]
        moved[:, :2] += velocity[t]
        state = np.where(adrift[t, :, None] > 0, moved, state @ still.T + drawn[1])
        fix[t], truth[t] = state[:, :2] + noise[t], state
    covariance[:-1][random.random((steps, count)) < lost] = 0.0
    return (start, covariance[-1]), (velocity, adrift, fix, covariance[:-1]), truth


def run(device, seed, steps, count, *, model=EXTREME_CURRENT, **changes):
    """Squared errors over their covariance, of all four states and of the position, and squared innovations."""
    (start, covariance), arrays, truth = simulate(seed, steps, count, *model.values(), **changes)
    track, squared = follow(device, begin(start, covariance, model["variance"], device), *arrays, **model)
    return (*nees(track[1:], truth), squared)


def nees(track, truth):
    error, P = truth - track[..., :4], covariances(track)
    part = error[..., :2], P[..., :2, :2]
    return tuple(np.einsum("...i,...ij,...j", e, np.linalg.inv(C), e) for e, C in ((error, P), part))


def reference(start, velocity, adrift, fix, covariance, *, variance, correlation_time):
    """The same filter in double precision, textbook form; one AUV.

    Fixes beyond the gate change nothing; a track that begins anew is not modelled.
    """
    x, P = start[:4].astype(float), covariances(start.astype(float))
    H, states, squared = np.eye(2, 4), [], []
    for t in range(len(velocity)):
        F, Q = second_of(variance, correlation_time, adrift[t])
        x, P = F @ x, F @ P @ F.T + Q
        x[:2] += adrift[t] * velocity[t]
        xx, xy, yy = covariance[t]
        if xx > 0:
            S = P[:2, :2] + [[xx, xy], [xy, yy]]
            gain, innovation = P[:, :2] @ np.linalg.inv(S), fix[t] - x[:2]
            squared.append(innovation @ np.linalg.inv(S) @ innovation)
            if squared[-1] <= stats.chi2.isf(1e-3, 2):
                x, P = x + gain @ innovation, (np.eye(4) - gain @ H) @ P
        states.append((x, P))
    return np.array([s for s, _ in states]), np.array([c for _, c in states]), np.array(squared)


def band(mean, count):
    """95 % band of the mean of `count` numbers from χ² with `mean` degrees of freedom (normal for so many)."""
    return mean + 1.96 * math.sqrt(2 * mean / count) * np.array([-1, 1])


def test_a_drift_of_any_length_in_one_pass(device):
    """From a covariance and from none, by the matrix exponential of the model and of its noise (Van Loan 1978)."""
    variance, tau, carried = 0.22, 180.0, np.array([3.0, -2.0])
    times = np.array([1e-3, 0.1, 0.9, 17.0, 19.0, 180.0, 1800.0])
    random = np.random.default_rng(5)
    root = random.normal(size=(4, 4)) * np.array([[2.0], [2.0], [0.4], [0.4]])
    state, P = random.normal(size=4), np.array([root @ root.T, np.zeros((4, 4))])
    track = np.zeros((len(times), 2, tracker.COLUMNS))
    track[..., :4], track[..., tracker.XX : tracker.VV + 1] = state, P[:, UPPER[0], UPPER[1]]
    track = single(track, device)
    drift_together(track, single(times, device), vec2(*carried), variance, tau)
    track = track.double().cpu().numpy()
    F, noise = np.kron([[0, 1], [0, -1 / tau]], np.eye(2)), np.diag([0, 0, 1, 1]) * 2 * variance / tau
    for n, time in enumerate(times):
        both = expm(np.block([[-F, noise], [np.zeros((4, 4)), F.T]]) * time)
        moved = both[4:, 4:].T
        expected = moved @ P @ moved.T + moved @ both[:4, 4:]
        assert track[n, :, :4] == pytest.approx(np.tile(moved @ state + [*carried, 0, 0], (2, 1)), rel=1e-5, abs=1e-6)
        assert covariances(track[n, 0]) == pytest.approx(expected[0], rel=2e-5, abs=5e-6)
        assert covariances(track[n, 1]) == pytest.approx(expected[1], rel=2e-4, abs=1e-15)


class TestClosedForms:
    def test_steady_state_solves_riccatis_equation(self, device):
        variance, correlation_time, R, steps = 0.3, 60.0, 0.09, 400
        F, Q = second_of(variance, correlation_time)
        prior = solve_discrete_are(F.T, np.eye(4, 2), Q, R * np.eye(2))
        posterior = prior - prior[:, :2] @ np.linalg.inv(prior[:2, :2] + R * np.eye(2)) @ prior[:2]
        zeros = np.zeros((steps, 1, 2))
        covariance = np.tile([R, 0, R], (steps, 1, 1))
        start = begin(np.zeros((1, 2)), np.array([[R, 0, R]]), variance, device)
        model = {"variance": variance, "correlation_time": correlation_time}
        track, _ = follow(device, start, zeros, np.ones((steps, 1)), zeros, covariance, **model)
        assert covariances(track[-1, 0]) == pytest.approx(posterior, rel=1e-5, abs=1e-9)

    def test_without_fixes_the_current_keeps_its_variance_and_the_position_drifts(self, device):
        """Of an Ornstein–Uhlenbeck velocity: Var x = 2 σ² τ² (t/τ − 1 + e^(−t/τ)) (Uhlenbeck, Ornstein 1930)."""
        steps, tau = 2000, 180.0
        zeros, ones = np.zeros((steps, 1, 2)), np.ones((steps, 1))
        start = begin(np.zeros((1, 2)), np.array([[0.04, 0, 0.04]]), 0.22, device)
        track, squared = follow(device, start, zeros, ones, zeros, np.zeros((steps, 1, 3)), **EXTREME_CURRENT)
        assert np.all(squared == -1)
        assert track[:, 0, tracker.UU] == pytest.approx(0.22, rel=1e-4)
        drift = 2 * 0.22 * tau**2 * (steps / tau - 1 + math.exp(-steps / tau))
        assert track[-1, 0, tracker.XX] == pytest.approx(0.04 + drift, rel=1e-4)


class TestAgainstDoublePrecision:
    @pytest.mark.parametrize("lost", [0.0, 0.4])
    def test_same_estimates_and_covariances(self, device, lost):
        (start, covariance), arrays, _ = simulate(12, 300, 3, *EXTREME_CURRENT.values(), lost=lost)
        start = begin(start, covariance, 0.22, device)
        track, squared = follow(device, start, *arrays, **EXTREME_CURRENT)
        for n in range(3):
            own = (array[:, n] for array in arrays)
            x, P, chi2 = reference(start[n].cpu().numpy(), *own, **EXTREME_CURRENT)
            assert np.abs(track[1:, n, :4] - x).max() < 1e-3
            assert np.abs(covariances(track[1:, n]) - P).max() < 2e-5
            assert squared[squared[:, n] >= 0, n] == pytest.approx(chi2, rel=2e-3, abs=2e-3)

    def test_positive_definite_for_a_hundred_thousand_steps(self, device):
        steps, count = 100_000, 2
        random = np.random.default_rng(2)
        axes = np.linalg.qr(random.standard_normal((steps, count, 2, 2)))[0]
        spread = 10 ** (random.uniform(-6, 2, (steps, count, 1)) + random.uniform(0, 3, (steps, count, 2)))
        R = np.einsum("tnij,tnj,tnkj->tnik", axes, spread, axes)[..., [0, 0, 1], [0, 1, 1]]
        R[random.random((steps, count)) < 0.3] = 0.0
        zeros = np.zeros((steps, count, 2))
        hover = (random.random((steps, count)) < 0.9).astype(float)
        start = begin(np.zeros((count, 2)), np.tile([1e4, 0, 1e4], (count, 1)), 0.22, device)
        track, _ = follow(device, start, zeros, hover, zeros, R, **EXTREME_CURRENT)
        assert np.isfinite(track).all()
        P = covariances(track[1:])
        scale = np.sqrt(np.einsum("...ii->...i", P))
        assert scale.min() > 0
        correlation = P / (scale[..., None] * scale[..., None, :])
        assert np.linalg.eigvalsh(correlation).min() > 0


class TestConsistency:
    """Truth as the model has it: squared errors over their covariance are χ², of 4 states and of 2 innovations."""

    @pytest.mark.parametrize("changes", [{}, {"lost": 0.5}, {"lost": 0.3, "hover": 0.5}], ids=str)
    def test_nees_and_nis_in_their_bands(self, device, changes):
        runs = 2000
        states, position, squared = run(device, 21, 120, runs, **changes)
        # At each step the mean over runs; 95 % of the steps should lie inside, errors of near steps being alike.
        for values, dimension in ((states, 4), (position, 2)):
            low, high = band(dimension, runs)
            mean = values.mean(1)
            assert np.mean((mean > low) & (mean < high)) > 0.8
            assert mean.mean() == pytest.approx(dimension, rel=0.02)
        seen = squared >= 0
        assert np.mean(~seen) == pytest.approx(changes.get("lost", 0.0), abs=0.01)
        low, high = band(2, seen.sum())
        assert 0.99 * low < squared[seen].mean() < 1.01 * high
        assert np.mean(squared[seen] > 13.816) == pytest.approx(1e-3, rel=0.3)


class TestGate:
    """Fixes that are none do not move a track, and a track that has lost its AUV finds it again."""

    def run(self, device, spoil, steps=120, count=400):
        """Squared errors of position and state over their covariance (T, N) and the tracks, after `spoil`."""
        (start, covariance), (velocity, adrift, fix, R), truth = simulate(31, steps, count, 0.22, 180.0)
        spoil(np.random.default_rng(32), fix, truth)
        start = begin(start, covariance, 0.22, device)
        track, squared = follow(device, start, velocity, adrift, fix, R, **EXTREME_CURRENT)
        return *nees(track[1:], truth), track[1:], squared

    def test_a_tenth_of_outliers(self, device):
        outlier = np.zeros(0)

        def spoil(random, fix, truth):
            nonlocal outlier
            outlier = random.random(fix.shape[:2]) < 0.1
            fix[outlier] += random.uniform(-200, 200, (outlier.sum(), 2))

        states, position, track, _ = self.run(device, spoil)
        rejected = track[..., tracker.REJECTIONS] > 0
        assert rejected[outlier].mean() > 0.999
        assert rejected[~outlier].mean() < 3e-3
        assert position[10:].mean() == pytest.approx(2, rel=0.03)
        assert states[10:].mean() == pytest.approx(4, rel=0.03)

    def test_a_kidnapped_auv_is_found_by_three_fixes(self, device):
        def spoil(random, fix, truth):
            fix[60:] += (70.0, -40.0)
            truth[60:, :, :2] += (70.0, -40.0)

        states, position, _, _ = self.run(device, spoil)
        error = np.sqrt(position)
        assert error[60:62].min() > 20
        # Three fixes in a row agree unless one is an outlier of its own or lies close by.
        assert (error[62] < 6).mean() > 0.99
        assert position[70:].mean() == pytest.approx(2, rel=0.05)
        assert states[70:].mean() == pytest.approx(4, rel=0.05)

    def test_rejected_fixes_out_of_reach_of_one_another_confirm_nothing(self, device):
        """At 5 m/s an AUV makes 10 m in two steps, not 60."""
        for apart, confirmed in ((8.0, True), (60.0, False)):
            fix = np.zeros((6, 1, 2))
            fix[1::2, 0, 0] = 100 + apart * np.arange(3)
            fix[3, 0, 0], fix[5, 0, 0] = 100 + apart, 100 + 2 * apart
            R = np.tile([0.04, 0, 0.04], (6, 1, 1))
            R[[2, 4]] = 0.0
            start = begin(np.zeros((1, 2)), R[0], 0.01, device)
            model = {"variance": 0.01, "correlation_time": 180.0}
            track, _ = follow(device, start, np.zeros((6, 1, 2)), np.ones((6, 1)), fix, R, **model)
            assert (abs(track[-1, 0, tracker.X] - fix[5, 0, 0]) < 1e-3) == confirmed
            assert (abs(track[-1, 0, tracker.X]) < 5) != confirmed
