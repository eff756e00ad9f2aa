"""The tracker: closed forms, a filter in double precision, consistency, gate, and missions; beside Stone Soup."""

import math

import numpy as np
import pytest
import torch
from scipy import stats
from scipy.linalg import expm, solve_discrete_are

from usvauv.kernels.functions import kernel
from usvauv.kernels.positioning import tracker
from usvauv.kernels.types import array1, array3, vec2

UPPER = np.triu_indices(4)


@kernel
def drift_together(track: array3, time: array1, carried: vec2, variance: float, correlation_time: float):
    for n in range(time.shape[0]):
        for k in range(track.shape[1]):
            tracker.drift(track, n, k, carried, time[n], variance, correlation_time)


EXTREME_CURRENT = {"variance": 0.22, "correlation_time": 180.0}


def single(array, device):
    return torch.tensor(np.asarray(array, np.float32), device=device)


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


def follow(
    device, start, velocity, adrift, fix, covariance, age, *, speed=5.0, step=1.0, reading=None, deviation=0.0, **model
):
    """`tracker.follow` on arrays: tracks (T + 1, N, COLUMNS) in double precision and squared innovations (T, N)."""
    track, squared = tracker.follow(
        start,
        *(single(array, device) for array in (velocity, adrift, fix, covariance, age)),
        speed=speed,
        step=step,
        reading=None if reading is None else single(reading, device),
        reading_deviation=deviation,
        **model,
    )
    return track.double().cpu().numpy(), squared.double().cpu().numpy()


def simulate(seed, steps, count, variance, correlation_time, *, age=0.0, lost=0.0, hover=0.1, step=1.0):
    """Truth and fixes of N AUVs as the filter's model has them: the arguments of `follow`, and the true states."""
    random = np.random.default_rng(seed)
    rho = math.exp(-step / correlation_time)
    position = random.uniform(50, 150, (count, 2))
    current = math.sqrt(variance) * random.standard_normal((count, 2))
    velocity = np.zeros((steps, count, 2))
    adrift = (random.random((steps, count)) >= hover).astype(float)
    angle = np.cumsum(0.2 * random.standard_normal((steps, count)), 0)
    velocity[:] = 1.5 * np.stack([np.cos(angle), np.sin(angle)], -1)
    root = random.normal(0, 0.2, (steps + 1, count, 2, 2)) + 0.3 * np.eye(2)
    R = root @ root.swapaxes(-1, -2)
    noise = np.einsum("tnij,tnj->tni", root, random.standard_normal((steps + 1, count, 2)))
    start = position + noise[-1]
    truth, fix = np.zeros((steps, count, 4)), np.zeros((steps, count, 2))
    for t in range(steps):
        moved = adrift[t, :, None] * (velocity[t] + current)
        fix[t] = position + (step - age) * moved + noise[t]
        position = position + step * moved
        current = rho * current + math.sqrt(variance * (1 - rho**2)) * random.standard_normal((count, 2))
        truth[t] = np.concatenate([position, current], -1)
    ages = np.where(random.random((steps, count)) < lost, -1.0, age)
    covariance = R[..., [0, 0, 1], [0, 1, 1]]
    return (start, covariance[-1]), (velocity, adrift, fix, covariance[:-1], ages), truth


def run(device, seed, steps, count, *, model=EXTREME_CURRENT, **changes):
    """Squared errors over their covariance, of all four states and of the position, and squared innovations."""
    (start, covariance), arrays, truth = simulate(seed, steps, count, *model.values(), **changes)
    track, squared = follow(device, begin(start, covariance, model["variance"], device), *arrays, **model)
    return (*nees(track[1:], truth), squared)


def nees(track, truth):
    error, P = truth - track[..., :4], covariances(track)
    part = error[..., :2], P[..., :2, :2]
    return tuple(np.einsum("...i,...ij,...j", e, np.linalg.inv(C), e) for e, C in ((error, P), part))


def reference(
    start, velocity, adrift, fix, covariance, age, *, variance, correlation_time, step, reading=None, deviation=0.0
):
    """The same filter in double precision, textbook form, a late fix by rolling back to its time; one AUV.

    Fixes beyond the gate change nothing; a track that begins anew is not modelled.
    """
    x, P = start[:4].astype(float), covariances(start.astype(float))
    rho, H = math.exp(-step / correlation_time), np.eye(2, 4)
    states, squared = [], []
    for t in range(len(velocity)):
        parts = (step - age[t], age[t]) if age[t] >= 0 else (step, 0.0)
        for number, time in enumerate(parts):
            F = np.eye(4)
            F[0, 2] = F[1, 3] = adrift[t] * time
            x = F @ x
            x[:2] += adrift[t] * time * velocity[t]
            P = F @ P @ F.T
            if number == 0 and age[t] >= 0:
                xx, xy, yy = covariance[t]
                S = P[:2, :2] + [[xx, xy], [xy, yy]]
                gain, innovation = P[:, :2] @ np.linalg.inv(S), fix[t] - x[:2]
                squared.append(innovation @ np.linalg.inv(S) @ innovation)
                if squared[-1] <= stats.chi2.isf(1e-3, 2):
                    x, P = x + gain @ innovation, (np.eye(4) - gain @ H) @ P
        decay = np.diag([1, 1, rho, rho])
        x, P = decay @ x, decay @ P @ decay + np.diag([0, 0, 1, 1]) * variance * (1 - rho**2)
        if reading is not None:
            gain = P[:, 2:] @ np.linalg.inv(P[2:, 2:] + deviation**2 * np.eye(2))
            x, P = x + gain @ (reading[t] - x[2:]), P - gain @ P[2:]
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
        rho = math.exp(-1 / correlation_time)
        F = np.array([[1, 1], [0, rho]])
        Q = np.diag([0, variance * (1 - rho**2)])
        prior = solve_discrete_are(F.T, np.array([[1.0], [0]]), Q, np.array([[R]]))
        posterior = prior - np.outer(prior[:, 0], prior[0]) / (prior[0, 0] + R)
        zeros = np.zeros((steps, 1, 2))
        covariance = np.tile([R, 0, R], (steps, 1, 1))
        start = begin(np.zeros((1, 2)), np.array([[R, 0, R]]), variance, device)
        model = {"variance": variance, "correlation_time": correlation_time}
        now = np.zeros((steps, 1))
        track, _ = follow(device, start, zeros, now + 1, zeros, covariance, now, **model)
        P = covariances(track[-1, 0])
        assert P[np.ix_([0, 2], [0, 2])] == pytest.approx(posterior, rel=1e-5)
        assert P[np.ix_([1, 3], [1, 3])] == pytest.approx(posterior, rel=1e-5)
        assert P[np.ix_([0, 2], [1, 3])] == pytest.approx(np.zeros((2, 2)), abs=1e-9)

    def test_without_fixes_the_current_keeps_its_variance_and_the_position_drifts(self, device):
        steps = 2000
        zeros, ones = np.zeros((steps, 1, 2)), np.ones((steps, 1))
        start = begin(np.zeros((1, 2)), np.array([[0.04, 0, 0.04]]), 0.22, device)
        covariance = np.tile([1.0, 0, 1.0], (steps, 1, 1))
        track, squared = follow(device, start, zeros, ones, zeros, covariance, -ones, **EXTREME_CURRENT)
        assert np.all(squared == -1)
        assert track[:, 0, tracker.UU] == pytest.approx(0.22, rel=1e-4)
        # Var x = 0.04 + Σ_ij σ² ρ^|i−j|
        lag = np.arange(1, steps)
        drift = 0.22 * (steps + 2 * ((steps - lag) * np.exp(-lag / 180)).sum())
        assert track[-1, 0, tracker.XX] == pytest.approx(0.04 + drift, rel=1e-4)


class TestAgainstDoublePrecision:
    @pytest.mark.parametrize(("age", "lost"), [(0.0, 0.0), (0.0, 0.4), (0.2, 0.2), (1.0, 0.0)])
    def test_same_estimates_and_covariances(self, device, age, lost):
        (start, covariance), arrays, _ = simulate(11, 300, 3, *EXTREME_CURRENT.values(), age=age, lost=lost)
        start = begin(start, covariance, 0.22, device)
        track, squared = follow(device, start, *arrays, **EXTREME_CURRENT)
        for n in range(3):
            own = (array[:, n] for array in arrays)
            x, P, chi2 = reference(start[n].cpu().numpy(), *own, **EXTREME_CURRENT, step=1.0)
            assert np.abs(track[1:, n, :4] - x).max() < 1e-3
            assert np.abs(covariances(track[1:, n]) - P).max() < 2e-5
            assert squared[squared[:, n] >= 0, n] == pytest.approx(chi2, rel=2e-3, abs=2e-3)

    def test_with_readings_of_the_current(self, device):
        (start, covariance), arrays, truth = simulate(13, 100, 3, *EXTREME_CURRENT.values())
        start = begin(start, covariance, 0.22, device)
        reading = truth[..., 2:] + np.random.default_rng(1).normal(0, 0.1, truth[..., 2:].shape)
        track, _ = follow(device, start, *arrays, reading=reading, deviation=0.1, **EXTREME_CURRENT)
        for n in range(3):
            own = (array[:, n] for array in arrays)
            options = {"reading": reading[:, n], "deviation": 0.1, "step": 1.0}
            x, P, _ = reference(start[n].cpu().numpy(), *own, **EXTREME_CURRENT, **options)
            assert np.abs(track[1:, n, :4] - x).max() < 1e-3
            assert np.abs(covariances(track[1:, n]) - P).max() < 2e-5

    def test_positive_definite_for_a_hundred_thousand_steps(self, device):
        steps, count = 100_000, 2
        random = np.random.default_rng(2)
        axes = np.linalg.qr(random.standard_normal((steps, count, 2, 2)))[0]
        spread = 10 ** (random.uniform(-6, 2, (steps, count, 1)) + random.uniform(0, 3, (steps, count, 2)))
        R = np.einsum("tnij,tnj,tnkj->tnik", axes, spread, axes)[..., [0, 0, 1], [0, 1, 1]]
        zeros = np.zeros((steps, count, 2))
        hover = (random.random((steps, count)) < 0.9).astype(float)
        age = random.choice([-1.0, 0.0, 0.3], (steps, count))
        start = begin(np.zeros((count, 2)), np.tile([1e4, 0, 1e4], (count, 1)), 0.22, device)
        track, _ = follow(device, start, zeros, hover, zeros, R, age, **EXTREME_CURRENT)
        assert np.isfinite(track).all()
        P = covariances(track[1:])
        scale = np.sqrt(np.einsum("...ii->...i", P))
        assert scale.min() > 0
        correlation = P / (scale[..., None] * scale[..., None, :])
        assert np.linalg.eigvalsh(correlation).min() > 0


class TestConsistency:
    """Truth as the model has it: squared errors over their covariance are χ², of 4 states and of 2 innovations."""

    @pytest.mark.parametrize(
        "changes", [{}, {"lost": 0.5}, {"age": 0.2}, {"age": 0.2, "lost": 0.3, "hover": 0.5}], ids=str
    )
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
        (start, covariance), (velocity, adrift, fix, R, age), truth = simulate(31, steps, count, 0.22, 180.0)
        spoil(np.random.default_rng(32), fix, truth)
        start = begin(start, covariance, 0.22, device)
        track, squared = follow(device, start, velocity, adrift, fix, R, age, **EXTREME_CURRENT)
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
            age = np.array([0.0, 0, -1, 0, -1, 0])[:, None]
            fix[3, 0, 0], fix[5, 0, 0] = 100 + apart, 100 + 2 * apart
            R = np.tile([0.04, 0, 0.04], (6, 1, 1))
            start = begin(np.zeros((1, 2)), R[0], 0.01, device)
            model = {"variance": 0.01, "correlation_time": 180.0}
            track, _ = follow(device, start, np.zeros((6, 1, 2)), np.ones((6, 1)), fix, R, age, **model)
            assert (abs(track[-1, 0, tracker.X] - fix[5, 0, 0]) < 1e-3) == confirmed
            assert (abs(track[-1, 0, tracker.X]) < 5) != confirmed
