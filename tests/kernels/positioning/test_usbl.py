"""USBL fixes: geometry, noise, covariance as predicted, tilt and attitude error, validity, gate and whole turns."""

import math

import numpy as np
import pytest
import taichi as ti
import torch
from scipy import stats

from tests.kernels.planning.reference import loss
from usvauv.env.accuracy.fix_errors import reception
from usvauv.kernels.positioning import acoustic_link, sonar, usbl
from usvauv.kernels.positioning.sonar import coates
from usvauv.kernels.types import array2, vec2, vec3

CARRIERS = (15000.0, 18000.0)
LEVEL = (0.0, 0.0)
DRAWS = 200_000


def fixes(device, offset, *, slope=LEVEL, attitude_error=0.0, noise=None, auv=0, **link):
    """Fixes of one geometry: errors (n, 3), σ, predicted covariance (2, 2), all in double precision."""
    if noise is None:
        noise = torch.randn(DRAWS, 5, generator=torch.Generator().manual_seed(7))
    n = noise.shape[0]
    true = torch.tensor(offset, dtype=torch.float32, device=device).expand(n, 3).contiguous()
    sonar = acoustic_link.Sonar(accuracy=acoustic_link.Accuracy(attitude=attitude_error), **link)
    estimate, covariance, _ = usbl.fixes(
        torch.from_numpy(acoustic_link.link_table(CARRIERS, sonar)).to(device),
        torch.full((n,), auv, dtype=torch.int32, device=device),
        true,
        torch.tensor(slope, dtype=torch.float32, device=device).expand(n, 2).contiguous(),
        noise.to(device),
    )
    error = (estimate[:, :3] - true).double().cpu().numpy()
    xx, xy, yy = covariance[0].double().tolist()
    return error, estimate[0, 3].item(), np.array([[xx, xy], [xy, yy]])


class TestNoise:
    @pytest.mark.parametrize("path", ["echo", "transponder"])
    @pytest.mark.parametrize("noise_law", ["density", "demonstration"])
    @pytest.mark.parametrize("auv", [0, 1])
    def test_sigma_from_the_sonar_equation(self, device, path, noise_law, auv):
        f, offset = CARRIERS[auv], (80.0, -30.0, -100.0)
        S = math.hypot(*offset)
        NL = sonar.noise_level(coates(f, 0.5, 0.0), 1000.0)
        snr = 150.0 - NL - (2 * loss(S, f) - 3.0 if path == "echo" else loss(S, f))
        if noise_law == "density":
            expected = math.sqrt(1 / (10 ** (snr / 10) * 1000.0 * 10 / f))  # E/N0 = SNR · B · T
        else:
            expected = math.sqrt(4 * 10 ** (-2 * snr / 10) / (10 * 2.016e6 / f))
        link = {"path": path, "noise_law": noise_law, "source_level": 150.0}
        _, sigma, _ = fixes(device, offset, noise=torch.zeros(1, 5), auv=auv, **link)
        assert sigma == pytest.approx(expected, rel=1e-5)


class TestGeometry:
    @pytest.mark.parametrize("slope", [LEVEL, (0.2, 0.0), (0.0, -0.2), (-0.3, 0.25)])
    @pytest.mark.parametrize("offset", [(0.0, 0.0, -100.0), (70.0, -45.0, -104.0), (-150.0, 130.0, -120.0)])
    def test_without_noise_the_fix_is_exact(self, device, offset, slope):
        error, _, _ = fixes(device, offset, slope=slope, noise=torch.zeros(1, 5))
        assert np.abs(error).max() < 2e-4


@pytest.mark.parametrize("attitude_error", [0.0, 0.002])
@pytest.mark.parametrize("slope", [LEVEL, (0.1, -0.15)])
@pytest.mark.parametrize("offset", [(0.0, 0.0, -100.0), (70.0, -45.0, -104.0), (-130.0, 90.0, -98.0)])
class TestStatistics:
    def test_unbiased_with_the_predicted_covariance(self, device, offset, slope, attitude_error):
        error, _, predicted = fixes(device, offset, slope=slope, attitude_error=attitude_error)
        horizontal = error[:, :2]
        scale = math.sqrt(np.trace(predicted))
        # The second term is the bias of second order in the noise, from z' = −√(S² − x'² − y'²) under tilt.
        assert np.abs(horizontal.mean(axis=0)).max() < 5 * scale / math.sqrt(DRAWS) + 2 * scale**2 / 100
        assert np.abs(np.cov(horizontal.T) - predicted).max() < 0.02 * np.trace(predicted)


@ti.kernel
def covariances(link: array2, case: array2, out: array2):
    """What is new in each fix of the second AUV at offsets and slopes (n, 5), and what fixes have in common."""
    for n in range(case.shape[0]):
        offset = vec3(case[n, 0], case[n, 1], case[n, 2])
        axes = usbl.array_axes(usbl.attitude(vec2(case[n, 3], case[n, 4])))
        new = usbl.horizontal_covariance(link, 1, offset, axes, 0.05)
        common = usbl.systematic_covariance(link, 1, offset, axes)
        for j in ti.static(range(3)):
            out[n, j] = new[j]
            out[n, 3 + j] = common[j]


def test_covariances_are_those_of_the_derivatives_of_a_fix(device):
    """By each error alone, by central differences of the geometry in double precision."""
    accuracy = acoustic_link.Accuracy(0.003, 0.004, 0.006, 0.005, 0.3)
    sonar = acoustic_link.Sonar(accuracy=accuracy, signal="code", bandwidth=500.0)
    link = acoustic_link.link_table((9000.0, 15000.0), sonar)
    draw = np.random.default_rng(5)
    cases = np.concatenate(
        [draw.uniform((-200, -200, -120), (200, 200, -60), (40, 3)), draw.uniform(-0.3, 0.3, (40, 2))], 1
    )
    out = torch.empty((40, 6), device=device)
    covariances(torch.from_numpy(link).to(device), torch.tensor(cases, dtype=torch.float32, device=device), out)

    def axes(pitch, roll, heading):
        about_y = [[math.cos(pitch), 0, math.sin(pitch)], [0, 1, 0], [-math.sin(pitch), 0, math.cos(pitch)]]
        about_x = [[1, 0, 0], [0, math.cos(roll), math.sin(roll)], [0, -math.sin(roll), math.cos(roll)]]
        about_z = [[math.cos(heading), math.sin(heading), 0], [-math.sin(heading), math.cos(heading), 0], [0, 0, 1]]
        return np.array(about_x) @ about_y @ about_z

    def fix(case, phase_x=0.0, phase_y=0.0, stretch=0.0, pitch=0.0, roll=0.0, heading=0.0, speed=0.0):
        """With errors of the cosines, the range (m), the attitude and heading (rad), and the speed of sound."""
        offset, slope = case[:3], case[3:]
        true = math.atan(slope[0]), math.atan(slope[1] * math.cos(math.atan(slope[0])))
        S = np.linalg.norm(offset)
        u, v, _ = (axes(*true, 0.0) @ offset / S) * (1 + speed)
        S = (S + stretch) * (1 + speed)
        x, y = S * (u + phase_x), S * (v + phase_y)
        body = x, y, -math.sqrt(S * S - x * x - y * y)
        return (axes(true[0] + pitch, true[1] + roll, heading).T @ body)[:2]

    def by(case, **errors):
        total = np.zeros((2, 2))
        for name, deviation in errors.items():
            moved = [fix(case, **{name: side * 1e-5}) for side in (1, -1)]
            derivative = (moved[0] - moved[1]) / 2e-5
            total += deviation**2 * np.outer(derivative, derivative)
        return total

    phase = 0.05 / link[1, acoustic_link.KAPPA]
    metres = 1500 / (2 * math.pi * 500 / math.sqrt(12)) * 0.05 / math.sqrt(8) / 2
    for case, found in zip(cases, out.double().cpu().numpy(), strict=True):
        new = by(case, phase_x=phase, phase_y=phase, stretch=metres, pitch=0.003, roll=0.003)
        common = by(case, pitch=0.004, roll=0.004, heading=0.006, speed=0.005) + 0.3**2 * np.eye(2)
        for part, C in ((found[:3], new), (found[3:], common)):
            assert part == pytest.approx(C[[0, 0, 1], [0, 1, 1]], rel=2e-4, abs=1e-4 * np.trace(C))


def flagged(device, offset, *, slope=LEVEL, seed=9, **link):
    """Flags (DRAWS,) of fixes of one geometry, and the two probabilities predicted for it."""
    table = torch.from_numpy(acoustic_link.link_table(CARRIERS, acoustic_link.Sonar(**link))).to(device)
    auv = torch.zeros(DRAWS, dtype=torch.int32, device=device)
    true = torch.tensor(offset, dtype=torch.float32, device=device).expand(DRAWS, 3).contiguous()
    tilt = torch.tensor(slope, dtype=torch.float32, device=device).expand(DRAWS, 2).contiguous()
    noise = torch.randn(DRAWS, 6, generator=torch.Generator().manual_seed(seed)).to(device)
    _, _, flags = usbl.fixes(table, auv, true, tilt, noise)
    detected, usable = reception(table, auv[:1], true[:1], tilt[:1])[2:]
    return flags.cpu().numpy(), detected.item(), usable.item()


def p_of_rate(sample, probability):
    return stats.binomtest(int(sample.sum()), sample.size, min(max(probability, 0.0), 1.0)).pvalue


class TestValidity:
    @pytest.mark.parametrize("a", [14.8, 15.5, 15.81, 16.2, 17.0])
    def test_detection_follows_the_tones_energy(self, device, a):
        """Four hydrophones' energy over the noise is noncentral χ² of 8 degrees of freedom."""
        S, f = 100.0, CARRIERS[0]
        energy = 10 * math.log10(a * a / 2)  # a² is twice E/N0
        level = energy + loss(S, f) + coates(f, 0.5, 0.0) - 10 * math.log10(10 / f)
        flags, detected, _ = flagged(device, (0.0, 0.0, -S), source_level=level, path="transponder")
        exact = stats.ncx2.sf(8 + 4 * acoustic_link.PERIOD_ENERGY * 10, 8, 4 * a * a)
        assert detected == pytest.approx(exact, abs=1e-3)
        assert abs((flags & usbl.DETECTED > 0).mean() - exact) < 1e-3 + 5 * math.sqrt(0.25 / DRAWS)

    @pytest.mark.parametrize(
        "case",
        [
            {"offset": (100.0, 0.0, -3.0)},  # the horizon
            {"offset": (70.0, 70.0, -12.0), "source_level": 145.0},
            {"offset": (83.2, 5.0, -55.2), "spacing": 0.06},  # π on one axis
            {"offset": (69.45, 69.45, -18.8), "spacing": 0.072},  # π on both
            {"offset": (-70.0, 60.0, -42.2), "slope": (0.3, -0.35)},  # an array tilted towards the horizon
        ],
    )
    def test_wraps_and_directions_without_depth(self, device, case):
        flags, _, usable = flagged(device, **case)
        usable_here = flags & (usbl.WRAPPED | usbl.NO_DEPTH) == 0
        assert 0.02 < usable < 0.98
        assert p_of_rate(usable_here, usable) > 1e-4

    @pytest.mark.parametrize("spacing", [0.033, 0.1, 0.17])
    def test_without_noise_a_wrap_is_what_it_is(self, device, spacing):
        """The place and the flags by whole turns lost; of an odd number of them the residual tells the receiver."""
        draw, n = np.random.default_rng(3), 500
        place = draw.uniform((-200, -200, -150), (200, 200, -5), (n, 3)).astype(np.float32)
        link = acoustic_link.link_table(CARRIERS, acoustic_link.Sonar(spacing=spacing))
        table, offset = torch.from_numpy(link).to(device), torch.tensor(place, device=device)
        none = offset.new_zeros(n, 6)
        auv = torch.ones(n, dtype=torch.int32, device=device)
        estimate, covariance, flags = usbl.fixes(table, auv, offset, offset.new_zeros(n, 2), none)
        assert (estimate.shape, covariance.shape, flags.shape) == ((n, 4), (n, 3), (n,))
        S = np.linalg.norm(place.astype(float), axis=1)
        kappa = 2 * math.pi * CARRIERS[1] * spacing / 1500
        turns = kappa * place[:, :2] / S[:, None] / (2 * math.pi)
        lost = np.round(turns)
        u = (turns - lost) * 2 * math.pi / kappa
        clear = (np.abs(np.abs(turns - lost) - 0.5).min(1) > 1e-4) & (np.abs(1 - (u**2).sum(1)) > 1e-4)
        expected = usbl.DETECTED + usbl.WRAPPED * lost.any(1)
        expected += usbl.AMBIGUOUS * (lost.sum(1) % 2 == 1) + usbl.NO_DEPTH * ((u**2).sum(1) > 1)
        assert np.array_equal(flags.cpu().numpy()[clear], expected[clear])
        assert estimate.cpu().numpy()[clear, :2] == pytest.approx((S[:, None] * u)[clear], rel=1e-4, abs=1e-3)
        assert lost.any() == (spacing > 0.05)


def test_the_gate_is_a_quantile_of_chi_square():
    assert pytest.approx(stats.chi2.isf(1e-3, 2)) == usbl.GATE


@pytest.mark.parametrize(
    ("spacing", "periods", "possible"), [(0.033, 10, False), (0.045, 10, True), (0.036, 10, False), (0.036, 1, True)]
)
def test_turns_are_possible_from_half_a_wavelength_on(spacing, periods, possible):
    table = acoustic_link.link_table((15000.0, 18000.0), acoustic_link.Sonar(spacing=spacing, periods=periods))
    assert usbl.turns_possible(table) == possible
