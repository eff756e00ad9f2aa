"""Rays: closed forms, numerical rays, an independent tracer, straight lines, convergence, there and back, shadows."""

import math

import numpy as np
import pytest
import torch
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

from tests.kernels.positioning import ray_tracer
from usvauv.env.site.sound_speed import SoundSpeedProfile
from usvauv.kernels.positioning import rays

THERMOCLINE = SoundSpeedProfile.from_table([(0, 1522.0), (20, 1522.3), (50, 1492.0), (200, 1490.0)])


MELTWATER = SoundSpeedProfile.from_table([(0, 1440.0), (3, 1440.0), (20, 1475.0), (60, 1480.0), (200, 1482.0)])


ISOTHERMAL = SoundSpeedProfile.from_table([(0, 1490.0), (200, 1493.3)])


DUCT = SoundSpeedProfile.from_table([(0, 1500.0), (30, 1510.0), (60, 1480.0), (90, 1495.0), (200, 1492.0)])


PROFILES = {"thermocline": THERMOCLINE, "meltwater": MELTWATER, "isothermal": ISOTHERMAL, "duct": DUCT}


def tensor(values, device) -> torch.Tensor:
    return torch.tensor(np.asarray(values), dtype=torch.float32, device=device)


def eigenrays(profile, ends, device, surface=0.0) -> np.ndarray:
    found = rays.eigenrays(tensor(profile.layers(), device), tensor(ends, device), surface)
    return found.double().cpu().numpy()


def there_and_back(profile, depth, offset, c, device, assumed=None) -> tuple[np.ndarray, np.ndarray]:
    """Arrivals (n, 5) and the positions found from them (n, 3), by another profile if one is assumed."""
    depth, offset = tensor(depth, device), tensor(offset, device)
    arrivals = rays.arrivals(tensor(profile.layers(), device), depth, offset, c)
    back = rays.positions(tensor((assumed or profile).layers(), device), depth, arrivals, c)
    return arrivals.double().cpu().numpy(), back.double().cpu().numpy()


def numerical_ray(speed, gradient, depth, angle, time, breaks=()):
    """Integrate dr/dt = c sin θ, dz/dt = c cos θ, dθ/dt = c' sin θ, anew from each depth where c' jumps."""

    def motion(_, y):
        c = speed(y[1])
        return [c * math.sin(y[2]), c * math.cos(y[2]), gradient(y[1]) * math.sin(y[2])]

    state, now = [0.0, depth, angle], 0.0
    for stop in [*(b for b in breaks if b > depth), math.inf]:

        def arrives(_, y, stop=stop):
            return y[1] - stop if math.isfinite(stop) else -1.0

        arrives.terminal = True
        found = solve_ivp(motion, (now, time), state, "DOP853", events=arrives, rtol=1e-9, atol=1e-8)
        state, now = found.y[:, -1].tolist(), found.t[-1]
        if found.status == 0:
            break
        state[1] = stop + 1e-9
    return state


def exact_eigenray(speed, shallow, deep, R, fastest) -> tuple[float, float]:
    """Slowness (s/m) and travel time (s) in a smooth profile by quadrature in double precision."""

    def integral(xi, power):
        return quad(lambda z: speed(z) ** power / math.sqrt(1 - (xi * speed(z)) ** 2), shallow, deep, epsabs=1e-13)[0]

    xi = brentq(lambda xi: xi * integral(xi, 1) - R, 0, (1 - 1e-9) / fastest, xtol=1e-18)
    return xi, integral(xi, -1)


class TestEigenray:
    @pytest.mark.parametrize("name", PROFILES)
    def test_a_fine_numerical_ray_ends_at_the_source(self, device, name):
        """Sent out from the array at the angle found, integrated for the time found."""
        profile = PROFILES[name]
        ends = np.array([(a, b, R) for a, b in ((0, 100), (-6, 40), (12, 150)) for R in (0.5, 60, 350)], float)
        for (shallow, deep, R), (xi, upper, lower, time, exists) in zip(
            ends, eigenrays(profile, ends, device), strict=True
        ):
            assert exists
            slopes = np.append(np.diff(profile.speeds) / np.diff(profile.depths), 0.0)

            def gradient(z, slopes=slopes):
                row = np.searchsorted(profile.depths, z, "right") - 1
                return 0.0 if row < 0 else slopes[row]

            angle = math.atan2(xi * profile.at(shallow), upper)
            r, z, final = numerical_ray(profile.at, gradient, shallow, angle, time, profile.depths)
            assert math.hypot(r - R, z - deep) < 5e-4 + 1e-6 * R
            assert math.cos(final) == pytest.approx(lower, abs=3e-6)

    @pytest.mark.parametrize("gradient", [0.0, 1e-7, -1e-5, 1e-3])
    def test_next_to_no_gradient_gives_straight_lines_to_rounding(self, device, gradient):
        profile = SoundSpeedProfile.from_table([(z, 1500 + gradient * z) for z in (0, 7, 60, 300)])
        R = np.array([0.0, 1e-3, 1.0, 30.0, 300.0, 5000.0])
        ends = np.stack([np.full_like(R, -5), np.full_like(R, 105), R], axis=1)
        xi, upper, lower, time, exists = eigenrays(profile, ends, device).T
        S, c = np.hypot(110, R), profile.harmonic_mean(-5, 105)
        bend = gradient * R / 1500  # by how much an arc's direction changes
        assert exists.all()
        assert time == pytest.approx(S / c, rel=5e-7 + np.max(bend**2) / 20)
        assert xi == pytest.approx(R / S / c, rel=8e-7 + gradient**2)
        assert np.abs(np.stack([upper, lower]) - 110 / S).max() < 4e-7 + np.abs(bend).max()

    @pytest.mark.parametrize(("top", "bottom"), [(1520.0, 1480.0), (1480.0, 1520.0)])
    def test_no_direct_ray_beyond_the_horizontal_one(self, device, top, bottom):
        profile = SoundSpeedProfile.from_table([(0, top), (100, bottom)])
        farthest = math.sqrt(1520**2 - 1480**2) / 0.4
        shares = np.array([0.5, 0.99, 0.9999, 1.0001, 1.01, 10.0])
        ends = np.stack([0 * shares, 0 * shares + 100, shares * farthest], axis=1)
        found = eigenrays(profile, ends, device)
        assert found[:, 4].tolist() == [1, 1, 1, 0, 0, 0]
        assert np.isfinite(found).all()
        time = np.arccosh(1 + 0.4**2 * (100**2 + ends[:, 2] ** 2) / (2 * 1520 * 1480)) / 0.4
        assert found[:3, 3] == pytest.approx(time[:3], rel=5e-7)

    @pytest.mark.parametrize(
        ("speed", "ends"),
        [
            (lambda z: 1490 + 30 * math.exp(-z / 25), (0.0, 100.0, 180.0)),
            (lambda z: 1500 * (1 + 0.00737 * (z / 650 - 3 + math.exp(2 - z / 650))), (0.0, 4000.0, 5000.0)),
        ],
        ids=["thermocline", "Munk"],
    )
    def test_layers_converge_to_a_smooth_profile_in_second_order(self, device, speed, ends):
        shallow, deep, R = ends
        exact = exact_eigenray(speed, shallow, deep, R, max(speed(z) for z in np.linspace(shallow, deep, 4001)))
        errors = []
        for layers in (8, 16, 32):
            z = np.linspace(0, deep, layers + 1)
            profile = SoundSpeedProfile.from_table([(d, speed(d)) for d in z])
            found = eigenrays(profile, [ends], device)[0, [0, 3]]
            errors.append(np.abs(found / exact - 1))
        order = np.log2(np.array(errors[:-1]) / errors[1:])
        assert errors[-1].max() < 2e-4
        assert errors[-1].min() > 1e-6  # well above rounding, or the order would mean nothing
        assert order[-1] == pytest.approx(2.0, abs=0.25)


class TestFix:
    def offsets(self, count=4000, reach=300.0):
        random = np.random.default_rng(5)
        elevation = random.uniform(-10, 10, count)
        across = random.uniform(-reach, reach, (count, 2))
        across[:10] *= 1e-3
        return -elevation, np.column_stack([across, -100 - elevation])

    @pytest.mark.parametrize("name", PROFILES)
    def test_down_the_ray_to_the_source(self, device, name):
        depth, offset = self.offsets()
        arrivals, back = there_and_back(PROFILES[name], depth, offset, 1500.0, device)
        assert (arrivals.shape, back.shape) == ((len(depth), 5), (len(depth), 3))
        assert (arrivals[:, 4] == 1).all()
        assert np.abs(back - offset).max() < 1e-3

    @pytest.mark.parametrize("name", PROFILES)
    def test_noise_near_the_horizontal_stays_finite(self, device, name):
        random = np.random.default_rng(2)
        arrivals = np.zeros((2000, 5))
        arrivals[:, :2] = random.uniform(-1.2, 1.2, (2000, 2))
        arrivals[:, 3] = random.uniform(1, 3000, 2000)
        place = rays.positions(
            tensor(PROFILES[name].layers(), device),
            tensor(random.uniform(-10, 10, 2000), device),
            tensor(arrivals, device),
            1500.0,
        )
        assert torch.isfinite(place).all()
        assert (place.double().norm(dim=1).cpu().numpy() < arrivals[:, 3] * 1.03).all()


UPWARD = SoundSpeedProfile.from_table([(0, 1450.0), (50, 1480.0), (200, 1490.0)])


LINEAR = SoundSpeedProfile.from_table([(0, 1480.0), (400, 1540.0)])


DEEP = SoundSpeedProfile.from_table([(0, 1522.0), (20, 1522.3), (50, 1492.0), (200, 1490.0), (1500, 1525.0)])


SURFACE_DUCT = SoundSpeedProfile.from_table([(0, 1500.0), (40, 1504.0), (60, 1485.0), (120, 1490.0), (300, 1508.0)])


STEPS = SoundSpeedProfile.from_table(
    [(0, 1470.0), (10, 1474.0), (20, 1471.0), (60, 1478.0), (70, 1476.0), (90, 1485.0), (160, 1495.0), (300, 1497.0)]
)


CAUSTIC = SoundSpeedProfile.from_table([(0, 1500.0), (44, 1478.3), (157, 1498.9), (363, 1498.6), (1500, 1520.0)])


BELOW, ABOVE = 1, -1


CASES = [  # profile, depths of array and source, range, and where the ray turns
    (UPWARD, 0.0, 30.0, 500.0, BELOW),
    (UPWARD, 0.0, 30.0, 1000.0, BELOW),
    (UPWARD, 3.0, 100.0, 2500.0, BELOW),
    (LINEAR, 0.0, 30.0, 1500.0, BELOW),
    (SURFACE_DUCT, 0.0, 30.0, 1000.0, BELOW),
    (DEEP, 45.0, 100.0, 800.0, ABOVE),
    (STEPS, 3.0, 100.0, 2500.0, BELOW),  # the first of three
    (STEPS, 0.0, 30.0, 2500.0, BELOW),
    (CAUSTIC, 5.0, 100.0, 2682.0, BELOW),  # the steeper, first by 7 mm, of two that turn in one layer
]


SHADOWS = [
    (DEEP, 0.0, 30.0, 4000.0),
    (DEEP, 45.0, 100.0, 850.0),
    (SURFACE_DUCT, 0.0, 30.0, 2500.0),
]


def munk(z):
    """Speed (m/s) of Munk's canonical profile (1974, doi 10.1121/1.1914492) and its derivative."""
    eta = 2 * (z - 1300) / 1300
    return 1500 * (1 + 0.00737 * (eta + np.exp(-eta) - 1)), 1500 * 0.00737 * 2 / 1300 * (1 - np.exp(-eta))


class TestTracer:
    def test_one_gradient_in_closed_form(self):
        """The tracer itself, and its order: the arc between two points of a medium of one gradient."""
        medium = ray_tracer.layered(LINEAR.depths, LINEAR.speeds, 30.0)
        time = math.acosh(1 + 0.15**2 * (30**2 + 1500**2) / (2 * 1480 * 1484.5)) / 0.15
        coarse, fine = (ray_tracer.eigenrays(medium, 0.0, 30.0, 1500.0, h)[0] for h in (500.0, 20.0))
        assert fine.turns == 1
        assert fine.time == pytest.approx(time, rel=1e-11)
        assert 1e-12 < abs(coarse.time / time - 1) < 1e-6


class TestTurningRay:
    @pytest.mark.parametrize("case", CASES)
    def test_the_first_arrival_of_an_independent_tracer(self, device, case):
        """Travel times within 2 mm of path, cosines within 2e-7: single precision. The tracer is better than 0.1 mm."""
        profile, array, source, R, turns = case
        medium = ray_tracer.layered(profile.depths, profile.speeds, source)
        expected = ray_tracer.eigenrays(medium, array, source, R, 20.0)[0]
        xi, upper, lower, time, exists = eigenrays(profile, [(array, source, R)], device)[0]
        assert exists
        assert expected.turns == 1
        assert (math.copysign(1, upper), math.copysign(1, lower)) == (turns, -turns)
        assert 1500 * (time - expected.time) == pytest.approx(0, abs=2e-3)
        assert (upper, lower) == pytest.approx((expected.at_array, expected.at_source), abs=2e-7)
        assert xi == pytest.approx(expected.slowness, rel=2e-7)

    @pytest.mark.parametrize("case", SHADOWS)
    def test_a_shadow_is_a_shadow_of_the_tracer(self, device, case):
        profile, array, source, R = case
        assert eigenrays(profile, [(array, source, R)], device)[0, 4] == 0
        assert not ray_tracer.eigenrays(
            ray_tracer.layered(profile.depths, profile.speeds, source), array, source, R, 20.0
        )

    def test_one_gradient_in_closed_form(self, device):
        """arcosh(1 + g² d²/(2 c₁ c₂))/|g|, before, at and beyond the range at which the ray is horizontal."""
        for top, bottom in ((1400.0, 1600.0), (1600.0, 1400.0), (1490.0, 1496.6)):
            profile = SoundSpeedProfile.from_table([(0, top), (400, bottom)])
            g = (bottom - top) / 400
            c = np.array([profile.at(150), profile.at(250)])
            horizontal = math.sqrt(abs(c[1] ** 2 - c[0] ** 2)) / abs(g)
            R = horizontal * np.array([0.3, 0.99, 0.9999, 1.0, 1.0001, 1.001, 1.1, 1.4])
            found = eigenrays(profile, np.stack([0 * R + 150, 0 * R + 250, R], axis=1), device)
            assert found[:, 4].all()
            time = np.arccosh(1 + g**2 * (100**2 + R**2) / (2 * c[0] * c[1])) / abs(g)
            assert found[:, 3] == pytest.approx(time, rel=6e-7)
            turned = found[:, 2] if bottom > top else found[:, 1]
            assert (turned[[0, 1]] > 0).all()
            assert (turned[5:] < 0).all()

    def test_convergence_to_munks_profile(self, device):
        """Layers of 200, 100 and 50 m: the error of the travel time falls with the square of the thickness."""
        array, source, R = 200.0, 1000.0, 53e3
        medium = ray_tracer.smooth(lambda z: munk(z)[0], lambda z: munk(z)[1], source)
        exact = ray_tracer.eigenrays(medium, array, source, R, 100.0)[0]
        assert exact.turns == 1
        errors = []
        for count in (25, 50, 100):
            z = np.linspace(0, 5000, count + 1)
            found = eigenrays(SoundSpeedProfile(z, munk(z)[0]), [(array, source, R)], device)
            errors.append([found[0, 3] / exact.time - 1, found[0, 1] / exact.at_array - 1])
        errors = np.abs(errors)
        assert errors[-1, 0] < 5e-6
        assert errors[-1, 1] < 2e-3
        assert np.log2(errors[0] / errors[2]) / 2 == pytest.approx([2, 2], abs=0.6)

    def test_no_ray_turns_above_the_surface(self, device):
        ends = [(45.0, 100.0, 800.0)]
        upper = eigenrays(DEEP, ends, device)[0]
        highest = 20 + (1522.3 - 1 / upper[0]) / (30.3 / 30)
        assert eigenrays(DEEP, ends, device, surface=highest - 0.1)[0, 4] == 1
        assert eigenrays(DEEP, ends, device, surface=highest + 0.1)[0, 4] == 0


class TestFixByTurningRays:
    @pytest.mark.parametrize("profile", [UPWARD, LINEAR, DEEP, SURFACE_DUCT, STEPS])
    @pytest.mark.parametrize("highest", [-6.0, 30.0])
    def test_there_and_back(self, device, profile, highest):
        """Within 1 cm, and what rounding of the slowness (5 parts in 10⁷) moves the fix by where that is more."""
        random = np.random.default_rng(4)
        count = 4000
        depth, R = random.uniform(highest, highest + 12, count), random.uniform(10, 3000, count)
        source, azimuth = random.uniform(50, 150, count), random.uniform(-math.pi, math.pi, count)
        offset = np.stack([R * np.cos(azimuth), R * np.sin(azimuth), depth - source], axis=1)
        layers, depths = tensor(profile.layers(), device), tensor(depth, device)
        arrivals = rays.arrivals(layers, depths, tensor(offset, device), 1500.0)
        error = rays.positions(layers, depths, arrivals, 1500.0).double().cpu().numpy() - offset
        moved = np.zeros(count)
        for share in (-6e-7, -3e-7, -1.5e-7, 1.5e-7, 3e-7, 6e-7):
            rounded = arrivals.clone()
            rounded[:, :2] *= 1 + share
            shifted = rays.positions(layers, depths, rounded, 1500.0).double().cpu().numpy() - offset
            moved = np.maximum(moved, np.abs(shifted - error).max(axis=1))
        exists = arrivals[:, 4].cpu().numpy() > 0
        assert exists.mean() > 0.2
        assert (np.abs(error).max(axis=1) < 0.01 + moved)[exists].all()
