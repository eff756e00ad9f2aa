"""The tracker: Riccati's equation, a filter in double precision, positive definite, consistent; and on the mission."""

import math

import numpy as np
import pytest
import taichi as ti
import torch
from scipy import stats
from scipy.linalg import expm, solve_discrete_are

from tests.links import TILTING
from usvauv import policies
from usvauv.env.scenario import Scenario
from usvauv.env.site.site import Site
from usvauv.env.world import current_statistics
from usvauv.env.world.current_statistics import current_model
from usvauv.env.world.tables import link_table
from usvauv.env.world.world import World
from usvauv.kernels.mission.columns import AuvColumn
from usvauv.kernels.positioning import tracker
from usvauv.kernels.types import array1, array2, array3, vec2, vec3

UPPER = np.triu_indices(4)
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

    def test_holding_position_averages_the_fixes(self, device):
        random = np.random.default_rng(5)
        fix = 100 + random.standard_normal((49, 1, 2))
        ones = np.ones((49, 1))
        start = begin(fix[0], np.array([[1.0, 0, 1.0]]), 0.2, device)
        covariance = np.tile([1.0, 0, 1.0], (49, 1, 1))
        wind = np.ones((49, 1, 2))  # a commanded velocity that nothing comes of
        track, _ = follow(device, start, wind, 0 * ones, fix, covariance, 0 * ones, **EXTREME_CURRENT)
        mean = (fix.sum(0) + fix[0]) / 50
        assert track[-1, 0, :2] == pytest.approx(mean[0], abs=2e-5)
        assert track[-1, 0, tracker.XX] == pytest.approx(1 / 50, rel=1e-5)
        assert track[-1, 0, tracker.UU] == pytest.approx(0.2 * math.exp(-98 / 180) + 0.22 * -math.expm1(-98 / 180))

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

    def test_a_reading_of_the_current_beside_a_fix(self, device):
        start = begin(np.zeros((1, 2)), np.array([[0.04, 0, 0.04]]), 0.22, device)
        one = np.ones((1, 1))
        arrays = (np.zeros((1, 1, 2)), one, np.zeros((1, 1, 2)), np.ones((1, 1, 3)), -one)
        reading = np.array([[[0.5, -0.2]]])
        track, _ = follow(device, start, *arrays, reading=reading, deviation=0.1, **EXTREME_CURRENT)
        rho = math.exp(-1 / 180)
        S = 0.22 + 0.01
        assert track[1, 0, [2, 3]] == pytest.approx(reading[0, 0] * 0.22 / S, rel=1e-5)
        assert track[1, 0, [0, 1]] == pytest.approx(reading[0, 0] * 0.22 * rho / S, rel=1e-5)
        assert track[1, 0, tracker.UU] == pytest.approx(0.22 * 0.01 / S, rel=1e-5)
        assert track[1, 0, tracker.XX] == pytest.approx(0.04 + 0.22 - (0.22 * rho) ** 2 / S, rel=1e-4)


@ti.kernel
def operate(name: ti.template(), x: array1, track: array3, found: array2):
    """An operation of the tracker on the second AUV of each world, with its arguments in `x`."""
    for w in range(track.shape[0]):
        way, R = vec2(x[0], x[1]), vec3(x[2], x[3], x[4])
        if ti.static(name == "begin"):
            tracker.begin(track, w, 1, x[0], x[1], R, x[5])
        if ti.static(name == "spread"):
            tracker.spread(track, w, 1, x[0])
        if ti.static(name == "drift"):
            tracker.drift(track, w, 1, way, x[2], x[3], x[4])
        if ti.static(name == "sense"):
            tracker.sense(track, w, 1, way, x[2])
        if ti.static(name == "earlier"):
            place, A = tracker.earlier(track, w, 1, x[2], way)
            for i in ti.static(range(2)):
                found[w, i] = place[i]
            for i in ti.static(range(3)):
                found[w, 2 + i] = A[i]
        if ti.static(name == "update"):
            fix = tracker.Fix(place=way, covariance=R, lag=x[5], carried=vec2(x[6], x[7]))
            found[w, 0] = tracker.update(track, w, 1, fix, x[8], x[9])


class TestOperations:
    """One by one, on dense covariances in two worlds, beside matrices in double precision."""

    @pytest.fixture
    def tracks(self):
        """(worlds, AUVs, COLUMNS), all columns in use."""
        random = np.random.default_rng(17)
        track = random.uniform(-9, 9, (2, 2, tracker.COLUMNS)).astype(np.float32)
        root = random.normal(0, 1, (2, 4, 4))
        track[:, 1, tracker.XX : tracker.VV + 1] = (root @ root.swapaxes(1, 2))[:, UPPER[0], UPPER[1]]
        return track

    def operated(self, device, name, arguments, tracks, written=()):
        """Tracks (worlds, COLUMNS) of the second AUVs after an operation, and what it returned.

        It leaves the first AUVs alone, and of the others all columns but the state, its covariance and `written`.
        """
        track, found = torch.tensor(tracks, device=device), torch.zeros((2, 5), device=device)
        operate(name, single([*arguments, *[0.0] * 9], device), track, found)
        new = track.cpu().numpy()
        kept = [c for c in range(tracker.VV + 1, tracker.COLUMNS) if c not in written]
        assert np.array_equal(new[:, 0], tracks[:, 0])
        assert np.array_equal(new[:, 1, kept], tracks[:, 1, kept])
        return new[:, 1].astype(float), found.cpu().numpy().astype(float)

    def compare(self, new, tracks, expected, rel=1e-5):
        """States and covariances with those that `expected` makes of the ones before."""
        for before, after in zip(tracks[:, 1].astype(float), new, strict=True):
            x, P = expected(before[:4], covariances(before))
            assert after[:4] == pytest.approx(x, rel=rel, abs=1e-5)
            assert covariances(after) == pytest.approx(P, rel=rel, abs=1e-5 if covariances(before).any() else 0.0)

    @pytest.mark.parametrize("turns", [2e-5, 0.02, 0.149, 0.9, 8.0])
    @pytest.mark.parametrize("certain", [True, False])
    def test_drift_solves_the_stochastic_differential_equation(self, device, rounding, tracks, turns, certain):
        """By the matrix exponential of Van Loan (1978), doi 10.1109/TAC.1978.1101743."""
        variance, tau, way = 0.3, 50.0, (3.0, -7.0)
        if certain:
            tracks[:, 1, tracker.XX : tracker.VV + 1] = 0.0
        A = np.kron([[0, 1], [0, -1 / tau]], np.eye(2))
        Q = np.kron(np.diag([0, 2 * variance / tau]), np.eye(2))
        E = expm(turns * tau * np.block([[-A, Q], [np.zeros((4, 4)), A.T]]))
        F = E[4:, 4:].T
        new, _ = self.operated(device, "drift", (*way, turns * tau, variance, tau), tracks)
        rel = 2e-4 if turns > 1e-3 else 2e-3 * rounding  # e^(−t/τ) is rounded to 6e-8
        self.compare(new, tracks, lambda x, P: (F @ x + [*way, 0, 0], F @ P @ F.T + F @ E[:4, 4:]), rel)

    def test_begin_and_spread(self, device, tracks):
        new, _ = self.operated(device, "begin", (5.0, -6.0, 1.0, 0.25, 2.0, 0.5), tracks, range(tracker.COLUMNS))
        expected = np.zeros(tracker.COLUMNS)
        expected[[tracker.X, tracker.Y, tracker.XX, tracker.XY, tracker.YY]] = 5.0, -6.0, 1.0, 0.25, 2.0
        expected[[tracker.UU, tracker.VV]] = 0.5
        assert np.array_equal(new, [expected, expected])
        new, _ = self.operated(device, "spread", (3.0,), tracks)
        self.compare(new, tracks, lambda x, P: (x, P + np.diag([3.0, 3.0, 0.0, 0.0])))

    def test_a_reading_of_the_current(self, device, tracks):
        reading, variance = np.array([0.7, -0.4]), 0.3

        def expected(x, P):
            gain = P[:, 2:] @ np.linalg.inv(P[2:, 2:] + variance * np.eye(2))
            return x + gain @ (reading - x[2:]), P - gain @ P[2:]

        new, _ = self.operated(device, "sense", (*reading, variance), tracks)
        self.compare(new, tracks, expected)

    def test_a_late_fix(self, device, tracks):
        """Where the track was at its time, and what it makes of the track now."""
        lag, way, R = 1.5, np.array([4.0, -3.0]), np.array([[2.0, 0.5], [0.5, 1.0]])
        back = np.eye(4) - lag * np.eye(4, k=2)
        fix = tracks[:, 1, :2].mean(0)
        tracks[:, 1, :4] = [[*fix + way, 1.0, -0.5], [*fix + way + 2, 0.5, 1.0]]

        def then(x, P):
            return back @ x - [*way, 0, 0], back @ P @ back.T

        def expected(x, P):
            x, P = then(x, P)
            gain = P[:, :2] @ np.linalg.inv(P[:2, :2] + R)
            x, P = x + gain @ (fix - x[:2]), P - gain @ P[:2]
            forth = np.linalg.inv(back)
            return forth @ x + [*way, 0, 0], forth @ P @ forth.T

        arguments = *fix, R[0, 0], R[0, 1], R[1, 1], lag, *way, 0.3, 5.0
        new, squared = self.operated(device, "update", arguments, tracks, [tracker.REJECTIONS])
        self.compare(new, tracks, expected, 1e-4)
        assert np.all(new[:, tracker.REJECTIONS] == 0)
        _, earlier = self.operated(device, "earlier", (*way, lag), tracks)
        for before, chi2, found in zip(tracks[:, 1].astype(float), squared[:, 0], earlier, strict=True):
            x, P = then(before[:4], covariances(before))
            assert chi2 == pytest.approx((fix - x[:2]) @ np.linalg.solve(P[:2, :2] + R, fix - x[:2]), rel=1e-4)
            assert found == pytest.approx([*x[:2], P[0, 0], P[0, 1], P[1, 1]], rel=1e-5)

    def test_the_third_of_three_rejected_fixes_that_agree_begins_a_track(self, device, tracks):
        """At its own time: what the AUV has gone since is added, and the current is unknown."""
        lag, way, R, variance = 2.0, np.array([4.0, -3.0]), (2.0, 0.5, 1.0), 0.25
        counted = [tracker.REJECTIONS, tracker.REJECTED_X, tracker.REJECTED_Y, tracker.REJECTED_AGE]
        tracks[:, 1, counted] = 0.0
        for fixes in (1, 2, 3):
            fix = 900.0 + fixes, -800.0
            new, squared = self.operated(device, "update", (*fix, *R, lag, *way, variance, 5.0), tracks, counted)
            assert squared[:, 0].min() > tracker.GATE
            if fixes < 3:
                self.compare(new, tracks, lambda x, P: (x, P))
                assert np.array_equal(new[:, counted], [[fixes, *fix, 0.0]] * 2)
                tracks[:, 1, counted] = new[:, counted]
        P = np.diag([R[0], R[2], variance, variance])
        P[0, 1] = P[1, 0] = R[1]
        F = np.eye(4) + lag * np.eye(4, k=2)
        self.compare(new, tracks, lambda *_: ([fix[0] + way[0], fix[1] + way[1], 0, 0], F @ P @ F.T))
        assert np.all(new[:, counted] == 0)


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
        steps, count = 100_000, 8
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
        runs = 4000
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

    def test_a_wrong_model_is_noticed(self, device):
        (start, covariance), arrays, truth = simulate(21, 120, 500, *EXTREME_CURRENT.values())
        wrong = {"variance": 0.22, "correlation_time": 2000.0}
        track, _ = follow(device, begin(start, covariance, 0.22, device), *arrays, **wrong)
        assert nees(track[1:], truth)[0].mean() > 5

    def test_the_same_seed_gives_the_same_track(self, device):
        for one, other in zip(run(device, 7, 30, 20), run(device, 7, 30, 20), strict=True):
            assert np.array_equal(one, other)


class TestGate:
    """Fixes that are none do not move a track, and a track that has lost its AUV finds it again."""

    def run(self, device, spoil, steps=120, count=400):
        """Squared errors of position and state over their covariance (T, N) and the tracks, after `spoil`."""
        (start, covariance), (velocity, adrift, fix, R, age), truth = simulate(31, steps, count, 0.22, 180.0)
        spoil(np.random.default_rng(32), fix, truth)
        start = begin(start, covariance, 0.22, device)
        track, squared = follow(device, start, velocity, adrift, fix, R, age, **EXTREME_CURRENT)
        return *nees(track[1:], truth), track[1:], squared

    def test_one_of_a_thousand_is_beyond_it(self, device):
        *_, track, squared = self.run(device, lambda *_: None)
        rejected = track[..., tracker.REJECTIONS] > 0
        assert np.array_equal(rejected, squared > -2 * math.log(1e-3))
        assert stats.binomtest(int(rejected.sum()), rejected.size, 1e-3).pvalue > 1e-4

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

    def test_a_run_of_outliers(self, device):
        def spoil(random, fix, truth):
            distance, angle = random.uniform(60, 200, (20, 400)), random.uniform(0, 2 * math.pi, (20, 400))
            fix[60:80] += np.stack([distance * np.cos(angle), distance * np.sin(angle)], -1)

        states, position, track, _ = self.run(device, spoil)
        assert (track[60:80, :, tracker.REJECTIONS] > 0).mean() > 0.998
        for values, dimension in ((position, 2), (states, 4)):
            for part in (slice(60, 80), slice(80, 120)):
                assert values[part].mean() == pytest.approx(dimension, rel=0.08)

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


@pytest.fixture(scope="module")
def log(device):
    """150 steps of `crab` in 64 worlds of `extreme`: arguments of `follow`, truth, the model from the scenario."""
    scenario = Scenario.load("extreme", [*TILTING, "usbl.propagation=false"])
    world = World(scenario, 64, seed=4)
    policy = policies.load("crab", world)
    observation = world.reset()
    logged, fixes = [world.auv.cpu().numpy().copy()], [world.estimate.cpu().numpy().copy()]
    for _ in range(150):
        observation = world.step(policy.act(observation))[0]
        logged.append(world.auv.cpu().numpy().copy())
        fixes.append(world.estimate.cpu().numpy().copy())
    auv, fix = (np.stack(a).astype(float).reshape(151, 128, -1) for a in (logged, fixes))
    column = {name: auv[..., getattr(AuvColumn, name)] for name in AuvColumn.names}
    adrift = ((column["hovering"] == 0) & (column["border"] == 0)).astype(float)
    velocity = np.stack([column["water_x"], column["water_y"]], -1)
    covariance = np.stack([column["covariance_xx"], column["covariance_xy"], column["covariance_yy"]], -1)
    truth = np.stack([column["x"], column["y"], column["current_x"], column["current_y"]], -1)
    model = dict(
        zip(("variance", "correlation_time"), current_model(Site(scenario), link_table(Site(scenario))), strict=True)
    )
    start = begin(fix[0, :, :2], covariance[0], model["variance"], device)
    arrays = velocity[1:], adrift[1:], fix[1:, :, :2], covariance[1:], np.zeros((150, 128))
    return start, arrays, truth[1:], model


class TestMission:
    def test_the_current_is_what_the_scenario_says(self, log):
        _, _, truth, model = log
        current = truth[..., 2:]
        assert model["variance"] == pytest.approx((current**2).mean(), rel=0.4)
        # The walk has the increment that was met over the filter's memory of 2 to 3 s.
        increment = sum(((current[m:] - current[:-m]) ** 2).mean() / m for m in (2, 3)) / 2
        assert 2 * model["variance"] / model["correlation_time"] == pytest.approx(increment, rel=0.4)

    def test_errors_fall_and_are_as_large_as_predicted(self, device, log):
        start, arrays, truth, model = log
        track, squared = follow(device, start, *arrays, **model)
        _, position = nees(track[1:], truth)
        position, squared = position[20:], squared[20:]
        # The two AUVs of a world share its attitude error, so 64 runs count.
        low, high = band(2, 64)
        for values in (position, squared):
            mean = values.mean(1)
            assert np.mean((mean > low) & (mean < high)) > 0.9
        fix_error = np.linalg.norm(arrays[2] - truth[..., :2], axis=-1)[20:]
        error = np.linalg.norm(track[1:, :, :2] - truth[..., :2], axis=-1)[20:]
        assert np.median(fix_error) / np.median(error) > 1.5
        assert math.sqrt((fix_error**2).mean() / (error**2).mean()) > 1.5
        # Fixes that the gate drops though nothing is wrong with them.
        assert np.mean(squared > 13.816) < 3e-3

    def test_a_reading_of_the_current_halves_what_remains(self, device, log):
        start, arrays, truth, model = log
        reading = truth[..., 2:] + 0.1 * np.random.default_rng(9).standard_normal(truth[..., 2:].shape)
        track, _ = follow(device, start, *arrays, reading=reading, deviation=0.1, **model)
        fix_error = np.linalg.norm(arrays[2] - truth[..., :2], axis=-1)[20:]
        error = np.linalg.norm(track[1:, :, :2] - truth[..., :2], axis=-1)[20:]
        assert np.median(fix_error) / np.median(error) > 2.0


class TestCurrentModel:
    def test_still_water_needs_no_noise(self):
        assert current_statistics.ornstein_uhlenbeck([], 0.1, 1.0) == (0.0, current_statistics.FOREVER)
        assert current_statistics.eddies(0, (0.0, 0.0), (30.0, 30.0), 4e4, 1.5) == (0.0, 0.0)

    def test_eddies(self):
        """Means of Lamb and Oseen's velocity squared over a disc of the same area, and of a quarter of their vorticity
        squared, by quadrature; circulations and cores between limits.
        """
        count, Gamma, delta, area, speed = 5, np.linspace(100, 300, 4001), np.linspace(20, 40, 4001), 2e5, 1.5
        core = (1 / delta**2).mean() ** -0.5
        r = np.linspace(0, math.sqrt(area / math.pi), 200_001)[1:]
        ring = 2 * math.pi * r * r[0] * count * (Gamma**2).mean() / area
        V = -np.expm1(-((r / core) ** 2)) / (2 * math.pi * r)
        vorticity = np.exp(-((r / core) ** 2)) / (math.pi * core**2)
        variance, frequency = current_statistics.eddies(count, (100.0, 300.0), (20.0, 40.0), area, speed)
        assert variance == pytest.approx((0.5 * V**2 * ring).sum(), rel=3e-3)
        change = speed**2 * (0.25 * vorticity**2 * ring).sum()
        assert frequency == pytest.approx(math.sqrt(change / variance), rel=3e-3)

    @pytest.mark.parametrize("drag", [0.0, 1e-3])
    def test_standing_waves(self, drag):
        """Means over the pairs of numbers of half waves, and of the energy over the mission."""
        rms, modes, length, depth, duration = 0.4, 3, 500.0, 20.0, 900.0
        n = np.arange(modes + 1)
        k = math.pi / length * math.sqrt((n[:, None] ** 2 + n**2).mean())
        left = np.exp(-drag * np.linspace(0, duration, 100_001)).mean()
        found = current_statistics.standing_waves(rms, modes, length, depth, 9.81, drag, duration)
        # Half of the energy at the crests is that of the mean elevation, g rms²/2, which the two axes share.
        assert found == pytest.approx((9.81 * rms**2 / 2 / depth / 2 * left, k * math.sqrt(9.81 * depth)), rel=1e-4)

    def test_dead_reckoning_in_still_water(self, device):
        (start, covariance), arrays, truth = simulate(3, 200, 50, 0.0, current_statistics.FOREVER)
        start = begin(start, covariance, 0.0, device)
        track, _ = follow(device, start, *arrays, variance=0.0, correlation_time=current_statistics.FOREVER)
        error = np.linalg.norm(track[-1, :, :2] - truth[-1, :, :2], axis=-1)
        assert np.sqrt((error**2).mean()) < 0.06
        assert np.abs(track[..., 2:4]).max() == 0

    def test_memory_is_that_of_the_filter(self):
        R, interval = 0.09, 2.0
        variance, time = current_statistics.ornstein_uhlenbeck([(0.2, 0.03), (0.003, 0.6)], R, interval)
        walk = 2 * variance / time
        memory = (R * interval / walk) ** 0.25
        increment = 2 * 0.2 * -math.expm1(-0.5 * (0.03 * memory) ** 2) + 2 * 0.003 * -math.expm1(
            -0.5 * (0.6 * memory) ** 2
        )
        assert walk == pytest.approx(increment / memory, rel=1e-6)

    def test_orbital_motion_of_one_wave(self):
        """A narrow band in deep water: u² + v² has the mean a² ω² e^{2kz}, half of it per axis, and its frequency."""
        omega = np.linspace(0.999, 1.001, 101)
        variance, frequency = current_statistics.orbital_motion(
            omega, np.ones(101), 4 * math.sqrt(0.5), -5.0, 1000.0, 9.81
        )
        assert variance == pytest.approx(0.25 * math.exp(-2 * 5 / 9.81), rel=1e-3)
        assert frequency == pytest.approx(1.0, rel=1e-3)
