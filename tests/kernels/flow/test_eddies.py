"""Vortices of a pattern that repeats: beside Fourier series, their invariants, and that the field is stationary."""

import math

import numpy as np
import torch
from scipy.integrate import solve_ivp
from scipy.special import exp1

from benchmarks.studies.eddies import PeriodicFlow, vorticity
from usvauv.kernels.flow.vortex import IMAGES, Eddies, sample_current
from usvauv.kernels.flow.vortex_motion import evolution

L = 300.0
CENTRE = (100.0, 80.0)
PATTERN = Eddies(L, CENTRE)


def drawn(worlds: int, count: int = 9, seed: int = 0) -> np.ndarray:
    """Vortices (W, V, 4) with uniform centres in the square."""
    draw = np.random.default_rng(seed)
    size = (worlds, count)
    Gamma = draw.uniform(120, 260, size) * draw.choice([-1, 1], size)
    x, y = (middle + draw.uniform(-L / 2, L / 2, size) for middle in CENTRE)
    return np.stack([x, y, Gamma, draw.uniform(15, 25, size)], axis=-1)


def field(device, vortices, points, period=L):
    """Velocity (W, P, 2) of vortices (W, V, 4) at points (P, 2)."""
    put = lambda array: torch.tensor(np.asarray(array), dtype=torch.float32, device=device)  # noqa: E731
    places = put(points).expand(len(vortices), -1, -1).contiguous()
    return sample_current(put(vortices), places, period).double().cpu().numpy()


class Carried:
    """Vortices that carry one another."""

    def __init__(self, device, vortices, dt, eddies=PATTERN) -> None:
        self.now = torch.tensor(np.asarray(vortices), dtype=torch.float32, device=device)
        self._step = evolution(self.now, dt, 0.0, True, eddies)

    def after(self, steps: int) -> np.ndarray:
        for _ in range(steps):
            self._step()
        return self.now.double().cpu().numpy()


def test_images():
    """The c_k, by which the pole and the mean vorticity are ζ to 1.3e-4, beside Eisenstein sums of the lattice."""
    whole = np.arange(-30, 31)[:, None] + 1j * np.arange(-30, 31)
    whole = whole[whole != 0]
    sums = [np.sum(whole ** (-4.0 * k)).real for k in range(1, 21)]
    sums[0] = math.gamma(0.25) ** 8 / (960 * math.pi**2)  # of which the sum leaves O(1/30²)
    edge = 0.5 + 0.5j * np.linspace(0, 1, 101)
    exact, found = (sum(c * edge ** (4 * k - 1) for k, c in enumerate(series, 1)) for series in (sums, IMAGES))
    assert np.abs(found - exact).max() < 1.3e-4


class TestField:
    N = 256

    def test_is_that_of_its_vorticity_by_fourier_series(self, device):
        """Which has no divergence, and the vorticity of the cores less the mean; also centres beyond the square."""
        vortices = drawn(2)
        vortices[0, 0, :2] += np.array([2 * L, -L])
        at = L / self.N * np.arange(self.N)
        points = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)
        found = field(device, vortices, points).reshape(2, self.N, self.N, 2)
        flow = PeriodicFlow(vorticity(vortices, L, self.N), L)
        exact = np.moveaxis(flow.velocity(), 0, -1)
        assert np.abs(exact).max() > 1
        np.testing.assert_allclose(found, exact, atol=3e-4)

    def test_seam(self, device):
        """Left and right of where the nearest image changes, and above and below."""
        Gamma, along, near = 200.0, np.linspace(-L / 2, L / 2, 400), L / 2 * (1 - 1e-6)
        for turned in (False, True):
            sides = [np.stack([0 * along + side, along], -1)[:, [1, 0] if turned else [0, 1]] for side in (near, -near)]
            one, other = (field(device, [[(0, 0, Gamma, 20.0)]], side) for side in sides)
            assert np.abs(one - other).max() < 1e-3 * Gamma / (2 * math.pi * L)

    def test_whole_periods_change_nothing(self, device):
        vortices, points = drawn(1), np.random.default_rng(1).uniform(-200, 400, (300, 2))
        np.testing.assert_allclose(
            field(device, vortices, points), field(device, vortices, points + np.array([2 * L, -3 * L])), atol=2e-4
        )


def velocities(vortices: np.ndarray) -> np.ndarray:
    """Of the centres of one pattern, (V, 2) float64."""
    z = (vortices[:, 0] + 1j * vortices[:, 1]) / L
    z = z[:, None] - z
    z -= np.round(z.real) + 1j * np.round(z.imag)
    r2 = np.abs(z) ** 2 + np.eye(len(z))
    pole = -np.expm1(-r2 * L**2 / np.add.outer(vortices[:, 3] ** 2, vortices[:, 3] ** 2)) / r2 * (1 - np.eye(len(z)))
    zeta = (pole - math.pi) * z.conj() - sum(c * z ** (4 * k - 1) for k, c in enumerate(IMAGES, 1))
    w = zeta @ vortices[:, 2] / (2j * math.pi * L)
    return np.stack([w.real, -w.imag], axis=1)


def energy(vortices: np.ndarray) -> np.ndarray:
    """−Σ Γ_i Γ_j/(2π) (½ (ln s + E1(s)) … less the images) of pairs, (W,): what the motion keeps."""
    d = vortices[:, :, None, :2] - vortices[:, None, :, :2]
    d -= L * np.round(d / L)
    r2 = (d**2).sum(-1) + np.eye(vortices.shape[1])
    s = r2 / (vortices[:, :, None, 3] ** 2 + vortices[:, None, :, 3] ** 2)
    z4 = ((d[..., 0] + 1j * d[..., 1]) / L) ** 4
    images = sum(c / (4 * k) * (z4**k).real for k, c in enumerate(IMAGES, 1))
    psi = 0.5 * (np.log(r2 / L**2) + exp1(s)) - math.pi * r2 / (2 * L**2) - images
    psi[:, np.arange(psi.shape[1]), np.arange(psi.shape[1])] = 0
    return -(vortices[:, :, None, 2] * vortices[:, None, :, 2] * psi).sum((1, 2)) / (4 * math.pi)


class TestMotion:
    def test_energy_and_impulse(self, device):
        """The Hamiltonian over 1000 s; of Σ Γ X only whole periods are lost as centres leave and enter."""
        start = drawn(6)
        end = Carried(device, start, 0.5).after(2000)
        scale = np.abs(start[..., 2]).max() ** 2 / (2 * math.pi)
        assert np.ptp(energy(start)) > scale
        assert np.abs(energy(end) - energy(start)).max() < 5e-3 * scale
        assert (np.abs(end[..., :2] - CENTRE) <= L / 2 + 1e-3).all()
        assert (np.abs(end[..., :2] - start[..., :2]) > L / 2).any()

    def test_steps_of_a_second(self, device):
        """100 s beside SciPy: of a method of second order the errors would be tenfold."""
        start = drawn(3)
        end = Carried(device, start, 1.0).after(100)[..., :2]
        for own, found in zip(start, end, strict=True):
            exact = solve_ivp(
                lambda _, at, own=own: velocities(np.column_stack([at.reshape(-1, 2), own[:, 2:]])).ravel(),
                (0.0, 100.0),
                own[:, :2].ravel(),
                rtol=1e-9,
                atol=1e-9,
            ).y[:, -1]
            way = found - exact.reshape(-1, 2)
            assert np.abs(way - L * np.round(way / L)).max() < 2e-3

    def test_impulse_while_none_leaves(self, device):
        start = np.array([[(80, 80, 150, 20), (120, 90, -90, 15), (100, 60, 60, 25)]], float)
        end = Carried(device, start, 0.5).after(100)
        moved = end[..., :2] - start[..., :2]
        assert 10 < np.abs(moved).max() < 100
        assert np.abs((start[..., 2:3] * moved).sum(1)).max() < 0.05

    def test_a_lone_vortex_stays(self, device):
        start = np.array([[(240.0, 229.9, 300.0, 20.0)]])
        np.testing.assert_array_equal(Carried(device, start, 1.0).after(50)[..., :2], start[..., :2].astype(np.float32))

    def test_a_pair_crosses_the_seam(self, device):
        """As the same pair elsewhere, with the field it makes."""
        pair = np.array([[(-20.0, 80.0, 150.0, 15.0), (-20.0, 110.0, -150.0, 15.0)]])
        shift = np.array([110.0, 40.0])
        there = pair + np.array([*shift, 0, 0])
        a, b = Carried(device, pair, 1.0), Carried(device, there, 1.0)
        at = np.random.default_rng(2).uniform(-50, 250, (100, 2))
        jumped = False
        for _ in range(10):
            before = a.now[0, 0, 0].item()
            one, other = a.after(10), b.after(10)
            jumped |= abs(one[0, 0, 0] - before) > L / 2
            way = other[..., :2] - one[..., :2] - shift
            assert np.abs(way - L * np.round(way / L)).max() < 2e-2
            np.testing.assert_allclose(field(device, one, at), field(device, other, at + shift), atol=3e-3)
        assert jumped

    def test_a_column_moves_at_its_share_of_the_speed(self, device):
        start = drawn(1)
        slow = Carried(device, start, 2.0, PATTERN._replace(column=0.5)).after(50)
        np.testing.assert_allclose(slow, Carried(device, start, 1.0).after(50), atol=1e-2)


def test_stationary(device):
    """Speeds, and differences 40 m apart, at 0, 500, 1000 and 5000 s over 300 draws, within four standard errors.

    Where centres are independent and uniform once they are so for ever.
    """
    draw = np.random.default_rng(5)
    points = draw.uniform(0, L, (40, 2))
    points = np.concatenate([points, points + np.array([40.0, 0.0])])
    eddies = Carried(device, drawn(300), 2.0)
    times = []
    for steps in (0, 250, 250, 2000):
        V = field(device, eddies.after(steps), points)
        speed = np.hypot(*np.moveaxis(V, -1, 0))
        change = ((V[:, 40:] - V[:, :40]) ** 2).sum(-1)
        shares = [np.mean(speed > limit, axis=1) for limit in (0.3, 0.7, 1.0, 1.5, 2.0)]
        times.append(np.stack([speed.mean(1), (speed**2).mean(1), change.mean(1), *shares]))
    first = times[0]
    for later in times[1:]:
        error = np.sqrt((first.var(1) + later.var(1)) / first.shape[1])
        assert (np.abs(later.mean(1) - first.mean(1)) < 4 * error).all()


class TestReference:
    """The solver by which `benchmarks.studies.eddies` judges them."""

    def test_taylor_green_decays(self):
        k, nu = 2 * math.pi / L * 3, 2.0
        at = L / 32 * np.arange(32)
        start = np.cos(k * at) * np.cos(k * at[:, None])
        flow = PeriodicFlow(start, L, viscosity=nu)
        flow.advance(100.0)
        np.testing.assert_allclose(np.fft.irfft2(flow.spectrum), start * math.exp(-2 * nu * k * k * 100), atol=1e-6)

    def test_a_lone_vortex_spreads(self):
        """As Lamb and Oseen say, δ² = δ0² + 4νt."""
        vortices = np.array([[(150.0, 150.0, 200.0, 15.0)]])
        flow = PeriodicFlow(vorticity(vortices, L, 128), L, viscosity=1.0)
        flow.advance(50.0)
        vortices[..., 3] = math.sqrt(15.0**2 + 4 * 50)
        exact = PeriodicFlow(vorticity(vortices, L, 128), L).velocity()
        assert np.abs(flow.velocity() - exact).max() < 0.01 * np.abs(exact).max()

    def test_small_cores_far_apart_move_as_the_model_says(self, device):
        vortices = np.array([[(100.0, 100.0, 200.0, 10.0), (200.0, 100.0, 150.0, 10.0), (140.0, 220.0, -180.0, 10.0)]])
        flow = PeriodicFlow(vorticity(vortices, L, 128), L, advection=0.8)
        flow.advance(100.0)
        end = Carried(device, vortices, 1.0, PATTERN._replace(column=0.8)).after(100)
        assert np.abs(end[..., :2] - vortices[..., :2]).max() > 10
        exact = PeriodicFlow(vorticity(end, L, 128), L).velocity()
        assert np.sqrt(np.mean((flow.velocity() - exact) ** 2) / np.mean(exact**2)) < 0.05
