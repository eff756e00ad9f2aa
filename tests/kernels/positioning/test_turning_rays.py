"""Rays that turn: against closed forms, an independent ray tracer, and there and back; true shadows."""

import math

import numpy as np
import pytest
import torch

from tests.kernels.positioning import ray_tracer
from usvauv.env.site.sound_speed import SoundSpeedProfile
from usvauv.kernels.positioning import rays

UPWARD = SoundSpeedProfile.from_table([(0, 1450.0), (50, 1480.0), (200, 1490.0)])
LINEAR = SoundSpeedProfile.from_table([(0, 1480.0), (400, 1540.0)])
THERMOCLINE = SoundSpeedProfile.from_table([(0, 1522.0), (20, 1522.3), (50, 1492.0), (200, 1490.0), (1500, 1525.0)])
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
    (THERMOCLINE, 45.0, 100.0, 800.0, ABOVE),
    (STEPS, 3.0, 100.0, 2500.0, BELOW),  # the first of three
    (STEPS, 0.0, 30.0, 2500.0, BELOW),
    (CAUSTIC, 5.0, 100.0, 2682.0, BELOW),  # the steeper, first by 7 mm, of two that turn in one layer
]
SHADOWS = [(THERMOCLINE, 0.0, 30.0, 4000.0), (THERMOCLINE, 45.0, 100.0, 850.0), (SURFACE_DUCT, 0.0, 30.0, 2500.0)]


def tensor(values, device) -> torch.Tensor:
    return torch.tensor(np.asarray(values), dtype=torch.float32, device=device)


def eigenrays(profile, ends, device, surface=0.0) -> np.ndarray:
    found = rays.eigenrays(tensor(profile.layers(), device), tensor(ends, device), surface)
    return found.double().cpu().numpy()


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


class TestEigenray:
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
        upper = eigenrays(THERMOCLINE, ends, device)[0]
        highest = 20 + (1522.3 - 1 / upper[0]) / (30.3 / 30)
        assert eigenrays(THERMOCLINE, ends, device, surface=highest - 0.1)[0, 4] == 1
        assert eigenrays(THERMOCLINE, ends, device, surface=highest + 0.1)[0, 4] == 0

    def test_ranges_next_to_each_other_have_rays_next_to_each_other(self, device):
        """No gap where the direct ray ends and the turning one begins: time grows by ξ dR from range to range."""
        R = np.linspace(380, 420, 4001)
        xi, _, lower, time, exists = eigenrays(UPWARD, np.stack([0 * R, 0 * R + 35, R], axis=1), device).T
        assert exists.all()
        assert (lower > 0).any()
        assert (lower < 0).any()
        assert 1500 * (np.diff(time) - 0.5 * (xi[1:] + xi[:-1]) * np.diff(R)) == pytest.approx(0, abs=5e-4)


class TestFix:
    @pytest.mark.parametrize("profile", [UPWARD, LINEAR, THERMOCLINE, SURFACE_DUCT, STEPS])
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

    def test_there_and_back_in_one_gradient(self, device):
        """Where no layer ends near the turning point the fix is within 1 cm at all ranges; most rays have turned."""
        random = np.random.default_rng(1)
        R = random.uniform(50, 3000, 4000)
        depth, source = random.uniform(-5, 5, 4000), random.uniform(20, 150, 4000)
        offset = np.stack([0.6 * R, -0.8 * R, depth - source], axis=1)
        layers, depths = tensor(LINEAR.layers(), device), tensor(depth, device)
        arrivals = rays.arrivals(layers, depths, tensor(offset, device), 1500.0)
        back = rays.positions(layers, depths, arrivals, 1500.0).double().cpu().numpy()
        assert arrivals[:, 4].all()
        assert (arrivals[:, 2] < 0).all()  # from below, whether it has turned or not
        assert np.abs(back - offset).max() < 0.01
