"""Short waves: Airy's theory in the kernel, the spectra, and the statistics of a drawn sea."""

import math
from itertools import pairwise

import numpy as np
import pytest
import torch
from scipy.integrate import quad, trapezoid
from scipy.signal import welch

from usvauv.env.scenario.environment import Storm
from usvauv.env.sea.storm import band, draw_storm, spread
from usvauv.env.sea.water import AirySea
from usvauv.kernels.flow import airy

G, H = 9.81, 120.0
STORM = {
    "spectrum": "jonswap",
    "significant_height": 6.5,
    "peak_period": 11.0,
    "gamma": 2.2,
    "direction": 2.0,
    "spreading": 10.0,
    "components": 64,
    "shortest_wave": 20.0,
    "swells": (),
    "depth": H,
    "gravity": G,
    "levels": (0.0, -100.0),
    "seas": [(3, sea) for sea in range(4)],
}


def storm(**changes) -> AirySea:
    about = {**STORM, **changes}
    section = Storm.model_construct(**{name: about.pop(name) for name in Storm.model_fields})  # also what it refuses
    levels, water = about.pop("levels"), {name: about[name] for name in ("depth", "gravity")}
    return AirySea(*draw_storm(section, section.systems, **about), **water, levels=levels)


def single(a=1.0, omega=0.6, direction=0.0, phase=0.0, depth=H, levels=(0.0,)) -> AirySea:
    """One regular wave."""
    numbers = (np.array([[value]], float) for value in (a, omega, direction, phase))
    return AirySea(*numbers, depth=depth, gravity=G, levels=levels)


def motion(sea: AirySea, points: np.ndarray, level: int = 0) -> np.ndarray:
    """(η, η_x, η_y, u, v, w, u_z, v_z) of every sea at points (P, 2): (seas, P, 8) in double precision."""
    points = torch.as_tensor(points, dtype=torch.float32, device=sea.wave.device)
    points = points.expand(sea.wave.shape[0], -1, -1)
    return airy.sample(sea.wave, sea.since, points, level).double().cpu().numpy()


def summed(sea: AirySea, points: np.ndarray, z: float, depth: float = H) -> np.ndarray:
    """The same as `motion`, from the formulas, in double precision."""
    kx, ky = sea.k * np.cos(sea.direction), sea.k * np.sin(sea.direction)
    theta = (kx[:, None] * points[:, :1] + ky[:, None] * points[:, 1:]) + (sea.phase - sea.omega * sea.time)[:, None]
    a, omega, k = (value[:, None] for value in (sea.amplitude, sea.omega, sea.k))
    C = np.cosh(k * (z + depth)) / np.sinh(k * depth)
    D = np.sinh(k * (z + depth)) / np.sinh(k * depth)
    terms = (
        a * np.cos(theta),
        -a * kx[:, None] * np.sin(theta),
        -a * ky[:, None] * np.sin(theta),
        a * omega * C * kx[:, None] / k * np.cos(theta),
        a * omega * C * ky[:, None] / k * np.cos(theta),
        a * omega * D * np.sin(theta),
        a * omega * D * kx[:, None] * np.cos(theta),
        a * omega * D * ky[:, None] * np.cos(theta),
    )
    return np.stack([term.sum(axis=-1) for term in terms], axis=-1)


def record(sea: AirySea, minutes: int) -> np.ndarray:
    """Elevation at the origin every half second, (seas, 120 minutes), in double precision."""
    start = np.exp(1j * (sea.phase[:, None] - sea.omega[:, None] * 60 * np.arange(minutes)[:, None]))
    within = np.exp(-1j * sea.omega[:, :, None] * 0.5 * np.arange(120))
    return ((sea.amplitude[:, None] * start) @ within).real.reshape(len(start), -1)


POINTS = np.random.default_rng(0).uniform(0, 200, (40, 2))


class TestDispersion:
    @pytest.mark.parametrize("depth", [0.5, 5.0, 120.0, 11000.0])
    def test_residual_is_round_off(self, depth):
        omega = np.logspace(-4, 2, 2000)
        k = airy.wavenumber(omega, depth, G)
        assert np.abs(G * k * np.tanh(k * depth) / omega**2 - 1).max() < 1e-15

    def test_limits(self):
        """ω²/g in deep water; in shallow water ω/√(gh) (1 + (kh)²/6)."""
        omega = 2 * math.pi / np.array([1.0, 5.0])
        np.testing.assert_allclose(airy.wavenumber(omega, 1000.0, G), omega**2 / G, rtol=1e-15)
        omega = 2 * math.pi / np.array([500.0, 2000.0])
        long = omega / math.sqrt(G * H)
        np.testing.assert_allclose(airy.wavenumber(omega, H, G), long * (1 + (long * H) ** 2 / 6), rtol=1e-4)
        assert airy.wavenumber(np.zeros(1), H, G) == 0


class TestDecay:
    def test_deep_water_neither_overflows_nor_loses_digits(self):
        k = np.array([1.0, 30.0])
        for factor in airy.decay(k, -1.5, 11000.0):
            np.testing.assert_allclose(factor, np.exp(-1.5 * k), rtol=1e-15)


class TestMotion:
    @pytest.mark.parametrize(("level", "time"), [(0, 12.5), (1, 3e6 + 0.25)])
    def test_against_the_sum_in_double_precision(self, device, level, time):
        """Also a month later: the phases are exact, so single precision is as good as at the start."""
        sea = storm(components=61)
        sea.set_time(time)
        found = motion(sea, POINTS, level)
        expected = summed(sea, POINTS.astype(np.float32).astype(float), STORM["levels"][level])
        scale = np.sqrt((expected**2).mean(axis=(0, 1)))
        assert (np.abs(found - expected).max(axis=(0, 1)) < 2e-5 * scale).all()

    def test_no_divergence_and_no_rotation(self, device):
        """∇·u and ∇×u by differences of fourth order, at 10 m depth and close above the bed."""
        h = 1.0
        for middle in (-10.0, -H + 2 * h):
            sea = storm(levels=tuple(middle + n * h for n in range(-2, 3)))
            gradient = np.zeros((3, *motion(sea, POINTS)[..., 3:6].shape))
            for n, weight in ((-2, 1 / 12), (-1, -2 / 3), (1, 2 / 3), (2, -1 / 12)):
                gradient[0] += weight / h * motion(sea, POINTS + np.array([n * h, 0]), 2)[..., 3:6]
                gradient[1] += weight / h * motion(sea, POINTS + np.array([0, n * h]), 2)[..., 3:6]
                gradient[2] += weight / h * motion(sea, POINTS, 2 + n)[..., 3:6]
            scale = np.abs(gradient).max()
            divergence = gradient[0, ..., 0] + gradient[1, ..., 1] + gradient[2, ..., 2]
            assert np.abs(divergence).max() < 1e-3 * scale
            for i, j in ((0, 1), (0, 2), (1, 2)):
                assert np.abs(gradient[i, ..., j] - gradient[j, ..., i]).max() < 1e-3 * scale
            shear = motion(sea, POINTS, 2)[..., 6:]
            assert np.abs(gradient[2, ..., :2] - shear).max() < 1e-3 * scale

    @pytest.mark.parametrize("kh", [0.8, 1.5, 8.0])
    def test_stokes_drift(self, device, kh):
        """A float drifts with a² ω k cosh 2kh/(2 sinh² kh), what keeps its depth h/3 with a² ω k C²/2."""
        k, a = kh / H, 0.02 * H / kh  # a slope of 0.02
        omega = math.sqrt(G * k * math.tanh(kh))
        sea = single(a=a, omega=omega, phase=math.pi / 2, levels=(0.0, -H / 3))  # begins where it stands
        steps, periods = 60, 10
        dt = 2 * math.pi / omega / steps
        surface = a**2 * omega * k * math.cosh(2 * kh) / (2 * math.sinh(kh) ** 2)
        below = a**2 * omega * k * (math.cosh(2 * kh / 3) / math.sinh(kh)) ** 2 / 2
        for level, expected in ((0, surface), (1, below)):
            x = 0.0
            for step in range(steps * periods):
                start = x
                for part, time in ((0.5, step), (1.0, step + 0.5)):  # midpoint rule
                    sea.set_time(time * dt)
                    moved = motion(sea, np.array([[x, 0.0]]), level)[0, 0]
                    x = start + part * dt * (moved[3] + (moved[0] * moved[6] if level == 0 else 0.0))
            assert x / (steps * periods * dt) == pytest.approx(expected, rel=0.02)

    def test_linear_free_surface(self, device):
        """At z = 0 the water moves with the surface, w = η_t, and is accelerated down its slope, u_t = −g η_x."""
        sea, dt = storm(), 0.02
        series = []
        for step in (-1, 0, 1):
            sea.set_time(100.0 + step * dt)
            series.append(motion(sea, POINTS))
        rate, now = (series[2] - series[0]) / (2 * dt), series[1]
        assert np.abs(rate[..., 0] - now[..., 5]).max() < 2e-3 * now[..., 5].std()
        for axis in (0, 1):
            down = -G * now[..., 1 + axis]
            assert np.abs(rate[..., 3 + axis] - down).max() < 2e-3 * down.std()

    def test_no_flow_through_the_bed(self, device):
        sea = storm(levels=(-H,), peak_period=16.0)
        assert np.abs(motion(sea, POINTS)[..., 5]).max() < 1e-7 < np.abs(motion(sea, POINTS)[..., 3]).max()

    def test_grid_of_elevations(self, device):
        sea = storm()
        sea.set_time(77.0)
        x, y = np.linspace(0, 200, 7), np.linspace(0, 150, 5)
        points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        grid = sea.elevation(2, x, y)
        assert grid.dtype == np.float32
        np.testing.assert_allclose(grid.ravel(), motion(sea, points)[2, :, 0], atol=2e-5)


def jonswap(omega: float, period: float, gamma: float) -> float:
    """JONSWAP up to a factor, written out once more."""
    peak = 2 * math.pi / period
    sigma = 0.07 if omega <= peak else 0.09
    enhancement = gamma ** math.exp(-((omega - peak) ** 2) / (2 * sigma**2 * peak**2))
    return omega**-5 * math.exp(-5 / 4 * (peak / omega) ** 4) * enhancement


def integral(weight, shortest=20.0, period=11.0, gamma=2.2) -> float:
    """∫ S weight(ω) dω over the band of `STORM` in deep water."""
    peak, highest = 2 * math.pi / period, math.sqrt(G * 2 * math.pi / shortest)
    parts = [peak / 2, peak * 0.9, peak, peak * 1.2, highest]
    return sum(
        quad(lambda omega: jonswap(omega, period, gamma) * weight(omega), low, high)[0] for low, high in pairwise(parts)
    )


class TestSpectra:
    @pytest.mark.parametrize(("gamma", "T1", "T2"), [(1.0, 0.7718, 0.7104), (3.3, 0.8347, 0.7777)])
    def test_mean_periods(self, gamma, T1, T2):
        """T01/Tp and T02/Tp of JONSWAP: exact for γ = 1 (Γ functions), DNV-RP-C205's fit for γ = 3.3."""
        omega, S = band("jonswap", 12.0, gamma, 0.1, 5000.0, G)
        m0, m1, m2 = (trapezoid(omega**n * S, omega) for n in range(3))
        assert 2 * math.pi * m0 / m1 / 12 == pytest.approx(T1, rel=2e-3)
        assert 2 * math.pi * math.sqrt(m0 / m2) / 12 == pytest.approx(T2, rel=2e-3)

    def test_pierson_moskowitz_is_jonswap_without_enhancement(self):
        np.testing.assert_array_equal(band("pm", 9.0, 3.3, 20.0, H, G), band("jonswap", 9.0, 1.0, 20.0, H, G))

    def test_tma(self):
        """The factor is k⁻³ ∂k/∂ω over its value in deep water, 2 g² ω⁻⁵; ω² h/2g in shallow and 1 in deep water."""
        shallow = 15.0
        omega, S = band("tma", 14.0, 3.3, 20.0, shallow, G)
        factor = S / band("jonswap", 14.0, 3.3, 20.0, shallow, G)[1]
        k = airy.wavenumber(omega, shallow, G)
        definition = k**-3 * np.gradient(k, omega, edge_order=2) / (2 * G**2 * omega**-5)
        np.testing.assert_allclose(factor, definition, rtol=2e-6)
        assert factor[0] == pytest.approx(omega[0] ** 2 * shallow / G / 2, rel=0.05)
        assert factor[-1] == pytest.approx(1, abs=2e-3)
        deep = [band(name, 8.0, 3.3, 20.0, 5000.0, G)[1] for name in ("tma", "jonswap")]
        np.testing.assert_array_equal(*deep)

    @pytest.mark.parametrize("s", [0.0, 10.0, 1000.0])
    def test_spreading(self, s):
        """First two moments of cos^{2s}(θ/2): s/(s + 1) and s (s − 1)/((s + 1)(s + 2)); symmetric and normalised."""
        theta, probability = spread(s)
        D, middle = np.diff(probability), (theta[1:] + theta[:-1]) / 2
        assert probability[-1] == 1
        assert D @ np.cos(middle) == pytest.approx(s / (s + 1), abs=1e-6)
        assert D @ np.cos(2 * middle) == pytest.approx(s * (s - 1) / ((s + 1) * (s + 2)), abs=1e-6)
        assert D @ np.sin(middle) == pytest.approx(0, abs=1e-12)


class TestSeeds:
    def test_a_sea_does_not_depend_on_the_others(self):
        few, more, later = (storm(seas=[(3, sea) for sea in seas]) for seas in (range(3), range(20), (5, 6)))
        for sea in (few, more, later):
            sea.set_time(31.0)
        assert torch.equal(few.wave, more.wave[:3])
        assert torch.equal(later.wave, more.wave[5:7])

    def test_seeds_and_seas_differ(self):
        one, again, two = storm(), storm(), storm(seas=[(4, sea) for sea in range(4)])
        high = storm(seas=[(3 + (1 << 64), sea) for sea in range(4)])
        assert torch.equal(one.wave, again.wave)
        phases = [sea.phase[n] for sea in (one, two, high) for n in range(4)]
        assert all((a != b).all() for i, a in enumerate(phases) for b in phases[:i])


class TestSwells:
    SWELLS = ((2.0, 16.0, 3.3, 0.5, 40.0), (1.0, 14.0, 1.0, -1.0, 5.0))

    def test_wind_sea_is_as_without_them(self):
        alone, both, n = storm(), storm(swells=self.SWELLS), STORM["components"]
        for name in ("amplitude", "omega", "direction", "phase"):
            assert getattr(both, name).shape == (4, 3 * n)
            np.testing.assert_array_equal(getattr(both, name)[:, :n], getattr(alone, name))


@pytest.fixture(scope="module")
def many():
    """128 seas, and their elevation at one place for an hour, every half second."""
    sea = storm(seas=[(3, sea) for sea in range(128)])
    return sea, record(sea, 60)


class TestStatistics:
    def test_significant_height_of_each_realisation_is_exact(self, many):
        np.testing.assert_allclose(4 * np.sqrt((many[0].amplitude ** 2 / 2).sum(axis=1)), 6.5, rtol=1e-12)

    def test_periodogram(self, many):
        """The spectrum itself, and its peak at Tp within a bin of 1/300 Hz.

        Some 200 of all components fall into a bin, which makes it good to a few per cent.
        """
        f, found = welch(many[1], fs=2.0, nperseg=600)
        found = found.mean(axis=0)
        expected = np.array([jonswap(2 * math.pi * x, 11.0, 2.2) if x else 0.0 for x in f])
        expected *= 2 * math.pi * 6.5**2 / 16 / integral(lambda omega: 1)
        inside = expected > expected.max() / 20
        deviation = found[inside] / expected[inside] - 1
        assert np.sqrt((deviation**2).mean()) < 0.05
        assert deviation.mean() == pytest.approx(0, abs=0.02)
        assert f[found.argmax()] == pytest.approx(1 / 11, abs=1 / 300)

    def test_gaussian(self, many):
        """Skewness 0, and the kurtosis 3 − 1.5 Σa⁴/(Σa²)² of so many components, 2.97."""
        sea, eta = many
        unit = eta / eta.std(axis=1, keepdims=True)
        a2 = sea.amplitude**2
        expected = 3 - 1.5 * ((a2**2).sum(axis=1) / a2.sum(axis=1) ** 2).mean()
        assert expected == pytest.approx(2.97, abs=0.01)
        assert (unit**4).mean() == pytest.approx(expected, abs=0.03)
        assert (unit**3).mean() == pytest.approx(0, abs=0.02)

    def test_direction_and_spreading(self, many):
        """Mean direction 2.0 and first moment s/(s + 1) of energy, in the mean and for each realisation; whatever the
        frequency."""
        sea = many[0]
        moment = (sea.amplitude**2 * np.exp(1j * (sea.direction - 2.0))).sum(axis=1) / (sea.amplitude**2).sum(axis=1)
        assert np.angle(moment).mean() == pytest.approx(0, abs=0.01)
        assert np.abs(np.angle(moment)).max() < 0.1
        assert moment.real.mean() == pytest.approx(10 / 11, abs=0.005)
        ranks = np.argsort(np.argsort(sea.omega, axis=1), axis=1)
        assert np.corrcoef(ranks.ravel(), sea.direction.ravel())[0, 1] == pytest.approx(0, abs=0.04)

    def test_heave_slope_and_water_speed(self, device):
        """Variances in the kernel, over places and times of many seas, against the integrals over the spectrum: of
        elevation, slope, and horizontal speed at the surface and at 100 m depth (5.1 cm/s rms)."""
        sea = storm(seas=[(3, sea) for sea in range(64)])
        seen = []
        for time in range(0, 3000, 60):
            sea.set_time(time)
            seen.append(np.concatenate([motion(sea, POINTS), motion(sea, POINTS, 1)[..., 3:5]], axis=-1))
        square = (np.array(seen) ** 2).mean(axis=(0, 1, 2))

        def k(omega):
            return float(airy.wavenumber(omega, H, G))

        def speed(omega, z):
            return omega * math.cosh(k(omega) * (z + H)) / math.sinh(k(omega) * H)

        weights = (lambda o: 1, lambda o: k(o) ** 2, lambda o: speed(o, 0) ** 2, lambda o: speed(o, -100) ** 2)
        expected = [integral(weight) for weight in weights]
        scale = 6.5**2 / 16 / expected[0]
        found = [square[0], square[1:3].sum(), square[3:5].sum(), square[8:].sum()]
        assert found == pytest.approx([scale * value for value in expected], rel=0.03)
        assert np.sqrt(found) == pytest.approx([1.625, 0.106, 1.17, 0.051], rel=0.02)  # of the scenario `extreme`
