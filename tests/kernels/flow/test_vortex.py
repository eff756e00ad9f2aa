"""Lamb–Oseen currents: the identities of Eq. 8, the profile of one vortex, the core in single precision."""

import math

import numpy as np
import pytest
import taichi as ti
import torch
from scipy.integrate import solve_ivp
from scipy.special import lambertw

from usvauv.kernels import runtime
from usvauv.kernels.flow.vortex import ENDLESS, current_and_gradient, sample_current
from usvauv.kernels.flow.vortex_motion import evolution
from usvauv.kernels.functions import kernel
from usvauv.kernels.types import array2, array3

# Baseline reference of the paper (Zhang et al., doi 10.1109/JIOT.2024.3395568): three vortices in a 120 m square.
BASELINE = [(30.0, 23.0, 8.0, 48.0), (63.0, 45.0, 8.0, 48.0), (75.0, 77.0, 8.0, 48.0)]
STRONG = [(40.0, 60.0, 150.0, 30.0), (150.0, 120.0, -90.0, 25.0), (90.0, 170.0, 60.0, 40.0)]


def field(device, vortices, points):
    """Velocity (P, 2) of one world in double precision."""
    vortex = torch.tensor([vortices], dtype=torch.float32, device=device)
    points = torch.as_tensor(np.asarray(points), dtype=torch.float32, device=device)[None]
    return sample_current(vortex, points)[0].double().cpu().numpy()


@pytest.mark.parametrize("vortices", [BASELINE, STRONG], ids=["baseline", "strong"])
def test_curl_is_the_vorticity_and_divergence_vanishes(device, vortices):
    """∂V_y/∂x − ∂V_x/∂y = ϖ, ∇·V = 0, by differences of fourth order; the printed minus in V_y fails both."""
    h = 2.0
    points = np.random.default_rng(1).uniform(0, 200, (500, 2))
    derivative = np.zeros((2, 500, 2))
    for axis in (0, 1):
        for shift, weight in ((-2, 1 / 12), (-1, -2 / 3), (1, 2 / 3), (2, -1 / 12)):
            moved = points.copy()
            moved[:, axis] += shift * h
            derivative[axis] += weight / h * field(device, vortices, moved)
    vorticity = np.zeros(500)
    for x0, y0, Gamma, delta in vortices:
        r2 = ((points - (x0, y0)) ** 2).sum(axis=1)
        vorticity += Gamma / (math.pi * delta**2) * np.exp(-r2 / delta**2)
    scale = np.abs(vorticity).max()
    curl = derivative[0, :, 1] - derivative[1, :, 0]
    divergence = derivative[0, :, 0] + derivative[1, :, 1]
    assert np.abs(curl - vorticity).max() < 1e-4 * scale
    assert np.abs(divergence).max() < 1e-4 * scale
    # With the sign as printed the "curl" is −∂V_y/∂x − ∂V_x/∂y, which is far from ϖ.
    assert np.abs(-derivative[0, :, 1] - derivative[1, :, 0] - vorticity).max() > 0.5 * scale


@kernel
def sample(vortex: array3, points: array2, out: array2):
    for n in range(points.shape[0]):
        x, y = points[n, 0], points[n, 1]
        found = current_and_gradient(vortex, 0, x, y, ti.static(ENDLESS.pattern))
        for c in ti.static(range(5)):
            out[n, c] = found[c]


def test_gradient(device):
    """Of the velocity Γ/(2π) (−y, x) T, T = (1 − e^{−r²/δ²})/r², from the centre to where its core has ended."""
    x0, y0, Gamma, delta = STRONG[0]
    directions = np.random.default_rng(2).normal(size=(500, 2))
    away = np.stack([*np.geomspace(1, 200, 500)[:, None] * directions, (0, 0)])
    points = (away + np.array([x0, y0])).astype(np.float32)
    out = torch.zeros((len(points), 5), device=device)
    sample(torch.tensor([STRONG[:1]], device=device), torch.from_numpy(points).to(device), out)

    def flow(x, y):
        r2 = x * x + y * y + 1e-30
        return Gamma / (2 * math.pi) * -np.expm1(-r2 / delta**2) / r2 * np.array([-y, x])

    (x, y), h = (points.astype(float) - (x0, y0)).T, 1e-4
    of_x, of_y = ((flow(x + a, y + b) - flow(x - a, y - b)) / (2 * h) for a, b in ((h, 0), (0, h)))
    error = out.double().cpu().numpy().T - np.stack([*flow(x, y), of_x[0], of_y[0], of_x[1]])
    largest = Gamma / (2 * math.pi * delta**2)
    assert np.abs(error[:2]).max() < 2e-6 * largest * delta
    assert np.abs(error[2:]).max() < 2e-6 * largest


class TestOneVortex:
    Gamma, delta = 12.0, 30.0
    slope = Gamma / (2 * math.pi * delta**2)

    def speed(self, device, r):
        r = np.atleast_1d(np.asarray(r, dtype=float))
        points = np.stack([0.6 * r, 0.8 * r], axis=1)
        velocity = field(device, [(0.0, 0.0, self.Gamma, self.delta)], points)
        return np.linalg.norm(velocity, axis=1)

    def test_peak(self, device):
        """1 − e^{−s} = 2 s e^{−s} at the peak: s = −1/2 − W₋₁(−e^{−1/2}/2), r = 1.1209 δ, 0.6382 Γ/(2πδ)."""
        s = float(np.real(-0.5 - lambertw(-0.5 * math.exp(-0.5), -1)))
        assert math.sqrt(s) == pytest.approx(1.1209, abs=5e-5)
        r = np.linspace(0.5, 2.0, 3001) * self.delta
        speed = self.speed(device, r)
        assert speed.max() == pytest.approx(0.6382 * self.Gamma / (2 * math.pi * self.delta), rel=1e-4)
        assert r[speed.argmax()] == pytest.approx(math.sqrt(s) * self.delta, abs=0.05 * self.delta)

    def test_core_turns_as_a_solid(self, device):
        r = 10.0 ** np.arange(-20, 0)
        assert np.abs(self.speed(device, r) / (self.slope * r) - 1).max() < 1e-5

    def test_profile(self, device):
        """(1 − e^{−s})/s by NumPy, s from 1e-12 to 1e6, at lengths that single precision holds."""
        r = (32 * np.geomspace(1e-6, 1e3, 4001)).astype(np.float32).astype(float)
        velocity = field(device, [(0.0, 0.0, 2 * math.pi * 1024, 32.0)], np.stack([r, 0 * r], axis=1))
        s = (r / 32) ** 2
        assert np.abs(velocity[:, 1] / (r * -np.expm1(-s) / s) - 1).max() < 1e-6
        assert (velocity[:, 0] == 0).all()


def test_baseline_preset_is_below_5_cm_per_second(device):
    x, y = np.meshgrid(np.linspace(0, 120, 121), np.linspace(0, 120, 121))
    velocity = field(device, BASELINE, np.stack([x.ravel(), y.ravel()], axis=1))
    fastest = np.linalg.norm(velocity, axis=1).max()
    assert 0.04 < fastest <= 0.045


def carried(device, vortices, dt, steps, viscosity=0.0, mutual=True):
    """History (steps + 1, V, 4) of one world's vortices."""
    vortex = torch.tensor([vortices], dtype=torch.float32, device=device)
    history, step = [vortex[0].double().cpu().numpy()], evolution(vortex, dt, viscosity, mutual)
    for _ in range(steps):
        step()
        history.append(vortex[0].double().cpu().numpy())
    return np.stack(history)


class TestEvolution:
    def test_two_equal_vortices_orbit_with_the_exact_period(self, device):
        """Ω = Γ/(πd²) (1 − e^{−d²/2δ²}) about their middle, at distance d: back home after 2π/Ω."""
        Gamma, d, delta = 150.0, 50.0, 30.0
        period = 2 * math.pi / (Gamma / (math.pi * d**2) * (1 - math.exp(-((d / delta) ** 2) / 2)))
        history = carried(device, [(75.0, 100.0, Gamma, delta), (125.0, 100.0, Gamma, delta)], period / 400, 400)
        assert np.abs(history[-1] - history[0]).max() < 2e-3
        assert np.abs(history[200, 0, :2] - history[0, 1, :2]).max() < 2e-3
        quarter = history[100]
        assert np.abs(quarter[:, :2] - [(100, 75), (100, 125)]).max() < 2e-3  # anticlockwise

    def test_a_centre_moves_with_the_mean_velocity_over_its_core(self, device):
        """The mean of the other's velocity over a Gaussian core by Gauss–Hermite quadrature, and the first step."""
        other, own = (130.0, 110.0, 150.0, 25.0), (100.0, 100.0, 40.0, 35.0)
        nodes, weights = np.polynomial.hermite.hermgauss(40)
        x, y = np.meshgrid(100 + 35 * nodes, 100 + 35 * nodes)
        V = field(device, [other], np.stack([x.ravel(), y.ravel()], axis=1))
        mean = (np.outer(weights, weights).ravel()[:, None] * V).sum(axis=0) / math.pi
        history = carried(device, [own, other], 0.1, 1)
        np.testing.assert_allclose((history[1, 0, :2] - history[0, 0, :2]) / 0.1, mean, atol=2e-4)

    def test_fourth_order(self, device):
        """Errors of coarse steps shrink 16-fold when they are halved, before single precision is reached."""
        vortices = [(90.0, 100.0, 15.0, 5.0), (110.0, 100.0, 15.0, 5.0)]
        period = 2 * math.pi / (15 / (math.pi * 20**2) * (1 - math.exp(-8)))
        errors = [np.abs(carried(device, vortices, period / n, n)[-1] - vortices).max() for n in (16, 32)]
        assert 3.6 < math.log2(errors[0] / errors[1]) < 4.4

    def test_between_renewals(self, device):
        """Two vortices 20 m apart after each second, of which four make an interval, beside their exact circle."""
        vortices = [(90.0, 100.0, 150.0, 10.0), (110.0, 100.0, 150.0, 10.0)]
        way = carried(device, vortices, 1.0, 40)[:, 0, :2] - (100, 100)
        angle = np.arange(41) * 150 / (math.pi * 20**2) * (1 - math.exp(-2))
        exact = 10 * np.stack([-np.cos(angle), -np.sin(angle)], axis=1)
        assert np.abs(way - exact).max() < 4e-2

    def test_a_pair_of_opposite_sign_goes_straight_on(self, device):
        """At Γ/(2πd) (1 − e^{−d²/2δ²}), across the line between them."""
        Gamma, d, delta = 100.0, 40.0, 30.0
        speed = Gamma / (2 * math.pi * d) * (1 - math.exp(-((d / delta) ** 2) / 2))
        end = carried(device, [(80.0, 50.0, Gamma, delta), (120.0, 50.0, -Gamma, delta)], 1.0, 300)[-1]
        assert np.abs(end[:, :2] - [(80, 50 + 300 * speed), (120, 50 + 300 * speed)]).max() < 2e-3

    @pytest.mark.parametrize("count", [1, 8, 9, 17, 40])
    def test_a_world_moves_as_ever_beside_others(self, device, count):
        """In worlds side by side and in one by one, and where their number fills no vector."""
        low, high = torch.tensor([[0.0, 0.0, -200.0, 18.0], [200.0, 200.0, 200.0, 25.0]])
        shape = 32 * runtime.start().threads + 6, count, 4
        many = (low + (high - low) * torch.rand(shape, generator=torch.Generator().manual_seed(1))).to(device)
        few = many[-3:].clone()
        for vortex in (many, few):
            step = evolution(vortex, 1.0, 0.1, True)
            for _ in range(5):
                step()
        assert torch.equal(many[-3:], few)

    def test_invariants(self, device):
        """Circulation to the last bit; without viscosity the centre of circulation and the turning moment Σ Γ X²."""
        history = carried(device, STRONG, 1.0, 1000)
        assert (history[:, :, 2] == history[0, :, 2]).all()
        for moment in (history[:, :, 0], history[:, :, 1], history[:, :, 0] ** 2 + history[:, :, 1] ** 2):
            sums = (history[:, :, 2] * moment).sum(axis=1)
            assert np.ptp(sums) < 1e-4 * np.abs(history[0, :, 2] * moment[0]).sum()
        assert np.abs(history[-1, :, :2] - history[0, :, :2]).max() > 20

    def test_cores_that_grow_while_they_move(self, device):
        """Beside the differential equation of the centres with δ² = δ0² + 4νt, by SciPy."""
        nu, time, vortices = 3.0, 200.0, np.array(STRONG)
        Gamma, delta2 = vortices[:, 2], vortices[:, 3] ** 2

        def velocities(t, state):
            d = state.reshape(3, 1, 2) - state.reshape(1, 3, 2)
            r2 = (d**2).sum(-1) + np.eye(3)
            turn = Gamma / (2 * np.pi * r2) * -np.expm1(-r2 / (delta2[:, None] + delta2 + 8 * nu * t))
            turn[np.diag_indices(3)] = 0.0
            return np.stack([-(turn * d[..., 1]).sum(1), (turn * d[..., 0]).sum(1)], -1).ravel()

        exact = solve_ivp(velocities, (0.0, time), vortices[:, :2].ravel(), rtol=1e-10, atol=1e-10).y[:, -1]
        end = carried(device, STRONG, 20.0, 10, viscosity=nu)[-1, :, :2]
        assert np.abs(end - exact.reshape(3, 2)).max() < 1e-3

    def test_growth(self, device):
        """δ² = δ0² + 4νt, whether the centres move or not; the velocity is then that of Eq. 8 with the wider core."""
        for mutual in (False, True):
            history = carried(device, STRONG, 2.0, 500, viscosity=0.3, mutual=mutual)
            np.testing.assert_allclose(history[-1, :, 3] ** 2, history[0, :, 3] ** 2 + 4 * 0.3 * 1000, rtol=3e-5)
            assert (history[-1, :, :2] == history[0, :, :2]).all() == (not mutual)
