"""Fixes from sampled tones: unbiased, at their bounds, equal to the statistical model, and honest where they fail.

Every comparison of samples is a test at a stated significance with fixed seeds. A case has three to six of them and
there are some 200 in all, so each must have p > 1e-5: chance alone fails one run of seeds in about 500.
"""

import math

import numpy as np
import pytest
import taichi as ti
import torch
from scipy import stats

from usvauv.kernels import random
from usvauv.kernels.positioning import acoustic_link, fix_probability, sonar_equation, tone, usbl, waveform
from usvauv.kernels.positioning.ambient_noise import coates
from usvauv.kernels.positioning.waveform import AMPLITUDE, PHASE_X, PHASE_Y, RANGE_ERROR, RESIDUAL, SLIP
from usvauv.kernels.types import array2, vec2, vec3, vec4

SIGNIFICANCE = 1e-5
SAMPLING_RATE = 2.016e6
COUNT = 10_000


def link_at(snr, offset, carrier=15000.0, path="echo", **settings):
    """Link table of one AUV whose tone at the true slant range is `snr` (dB) above the noise in each sample.

    That is A²/σ_n² of the tone's amplitude A; noise of the density N0 has σ_n² = N0 f_s/2, and E = A² T/2.
    """
    S, paths = math.hypot(*offset), 2 if path == "echo" else 1
    density = coates(carrier, 0.5, 0.0) + 10 * math.log10(SAMPLING_RATE / 4)
    level = snr + paths * sonar_equation.transmission_loss(S, carrier) + density
    table = acoustic_link.link_table(
        (carrier,), acoustic_link.Sonar(source_level=level, target_strength=0.0, path=path, **settings)
    )
    return torch.from_numpy(table)


def strength_db(a, carrier=15000.0):
    """SNR (dB) at which a tone of ten periods has the energy a² over the noise on one hydrophone."""
    return 20 * math.log10(a) - 10 * math.log10(10 * SAMPLING_RATE / carrier / 2)


@ti.kernel
def _roots(q: array2, out: array2):
    for n in range(q.shape[0]):
        found = tone.root(vec3(q[n, 0], q[n, 1], q[n, 2]))
        for j in ti.static(range(3)):
            out[n, j] = found[j]


def test_root_of_a_covariance(device):
    """L of C = L Lᵀ, also where C is singular."""
    L = np.array([(2.0, 1.5, 0.7), (1.0, -3.0, 0.5), (0.3, 0.0, 2.0), (1.0, 2.0, 0.0), (0.0, 0.0, 3.0)])
    a, b, c = L.T
    q = torch.tensor(np.stack([a * a, a * b, b * b + c * c], axis=1), dtype=torch.float32, device=device)
    out = torch.empty_like(q)
    _roots(q, out)
    assert out.cpu().numpy() == pytest.approx(L, abs=2e-3)


class Batch:
    """Many fixes of one geometry, by tones and by the statistical model."""

    def __init__(self, device, offset, link, count=COUNT, slope=(0.0, 0.0)):
        # The arrival's place in its period is that of the range: spread it over a wavelength of the path.
        stretch = np.linspace(-0.05, 0.05, count) / math.hypot(*offset)
        self.offset = torch.tensor(np.outer(1 + stretch, offset), dtype=torch.float32, device=device)
        self.slope = torch.tensor(slope, dtype=torch.float32, device=device).expand(count, 2).contiguous()
        self.link, self.count = link.to(device), count
        self.auv = torch.zeros(count, dtype=torch.int32, device=device)

    def tones(self, seed=1, sampled=False):
        """Errors of the fixes (n, 3), flags (n,), measurements (n, MEASURED)."""
        case = self.link, self.auv, self.offset, self.slope
        estimate, flags, measured = waveform.fixes(*case, seed, sampled=sampled)
        error = (estimate[:, :3] - self.offset).double().cpu().numpy()
        return error, flags.cpu().numpy(), measured.double().cpu().numpy()

    def statistical(self, seed=1):
        """Errors (n, 3), flags (n,), predicted covariance (2, 2), of independent draws."""
        noise = torch.randn(self.count, 6, generator=torch.Generator().manual_seed(seed)).to(self.offset.device)
        case = self.link, self.auv, self.offset, self.slope
        estimate, covariance, flags = usbl.flagged_fixes(*case, noise)
        xx, xy, yy = covariance.double().mean(0).tolist()
        error = (estimate[:, :3] - self.offset).double().cpu().numpy()
        return error, flags.cpu().numpy(), np.array([[xx, xy], [xy, yy]])

    def phase_differences(self):
        """True phase differences (n, 2) of a level array, plane wave, rad."""
        r = self.offset.double().cpu().numpy()
        return self.link[0, acoustic_link.KAPPA].item() * r[:, :2] / np.linalg.norm(r, axis=1)[:, None]


def p_of_equal_rates(one, other):
    """Two-sided p of equal probability of two arrays of booleans."""
    pooled = (one.sum() + other.sum()) / (one.size + other.size)
    variance = pooled * (1 - pooled) * (1 / one.size + 1 / other.size)
    return 1.0 if variance == 0 else 2 * stats.norm.sf(abs(one.mean() - other.mean()) / math.sqrt(variance))


def p_of_rate(sample, probability):
    """Two-sided p of an array of booleans having the given probability."""
    return stats.binomtest(int(sample.sum()), sample.size, float(np.clip(probability, 0, 1))).pvalue


def p_of_equal_means(one, other):
    """Hotelling's two-sample test, large samples: χ² with as many degrees of freedom as columns."""
    difference = one.mean(0) - other.mean(0)
    covariance = np.cov(one.T) / len(one) + np.cov(other.T) / len(other)
    return stats.chi2.sf(difference @ np.linalg.solve(covariance, difference), len(difference))


def p_of_equal_covariances(one, other):
    """`p_of_equal_means` of the products of centred columns; needs no normal distribution."""
    rows, columns = np.tril_indices(one.shape[1])
    scale = one.std(0)
    products = [(x / scale)[:, rows] * (x / scale)[:, columns] for x in (one - one.mean(0), other - other.mean(0))]
    return p_of_equal_means(*products)


class TestWithoutNoise:
    @pytest.mark.parametrize("sampled", [True, False])
    @pytest.mark.parametrize("carrier", [12000.0, 13371.0, 15000.0, 18000.0])
    @pytest.mark.parametrize("path", ["echo", "transponder"])
    def test_the_measurement_is_exact(self, device, rounding, carrier, path, sampled):
        for offset in ((0.0, 0.0, -100.0), (70.0, -45.0, -104.0), (-290.0, 30.0, -80.0), (0.5, 0.4, -2.0)):
            batch = Batch(device, offset, link_at(150.0, offset, carrier, path), count=64)
            _, flags, measured = batch.tones(sampled=sampled)
            # By the sample more or less at the tone's ends, where it is near zero; and a sphere instead of a plane wave
            # changes a phase difference by (d/2S)²/2 of itself at most.
            tolerance = 3e-5 * rounding + (0.0165 / math.hypot(*offset)) ** 2
            phase = measured[:, [PHASE_X, PHASE_Y]]
            assert np.abs(phase - batch.phase_differences()).max() < tolerance
            assert np.abs(measured[:, RANGE_ERROR]).max() < 1e-6
            assert np.all(measured[:, SLIP] == 0)
            assert np.all(flags == usbl.DETECTED)

    def test_a_near_source_is_a_sphere(self, device):
        """0.5 m away the tone arrives 0.27 mm later at the hydrophones than at the centre: the receiver corrects it."""
        offset = (0.0, 0.0, -0.5)
        _, _, measured = Batch(device, offset, link_at(150.0, offset, path="transponder"), count=8).tones()
        assert math.hypot(0.0165, 0.5) - 0.5 > 2.7e-4
        assert np.abs(measured[:, RANGE_ERROR]).max() < 2e-6

    @pytest.mark.parametrize("slope", [(0.0, 0.0), (0.2, -0.3)])
    def test_the_fix_is_the_place(self, device, slope):
        offset = (70.0, -45.0, -104.0)
        error, _, _ = Batch(device, offset, link_at(150.0, offset), count=64, slope=slope).tones()
        assert np.abs(error).max() < 2e-3


class TestBounds:
    """Variances against the Cramér–Rao bounds written out here; 200,000 fixes, standard error 0.3 %."""

    @pytest.mark.parametrize("carrier", [12000.0, 13371.0, 15000.0, 18000.0])
    @pytest.mark.parametrize("snr", [21.0, 5.0])
    def test_phase_and_delay(self, device, carrier, snr):
        offset = (70.0, -45.0, -104.0)
        batch = Batch(device, offset, link_at(snr, offset, carrier, "transponder"), count=200_000)
        _, _, measured = batch.tones()
        N, sigma_n = 10 * SAMPLING_RATE / carrier, 10 ** (-snr / 20)
        error = measured[:, [PHASE_X, PHASE_Y, RANGE_ERROR]]
        error[:, :2] -= batch.phase_differences()
        difference = 2 * (2 * sigma_n**2 / N)
        delay = 2 * sigma_n**2 / (4 * N) / (2 * math.pi * carrier) ** 2
        assert error.var(axis=0) == pytest.approx([difference, difference, 1500**2 * delay], rel=0.015)
        assert np.abs(np.corrcoef(error.T) - np.eye(3)).max() < 4.5 / math.sqrt(batch.count)
        bias = np.abs(error.mean(0)) / np.sqrt(error.var(0) / batch.count)
        assert bias.max() < 4.5

    def test_an_echo_halves_the_range_error(self, device):
        offset = (0.0, 0.0, -100.0)
        spread = [
            Batch(device, offset, link_at(10.0, offset, path=path)).tones()[2][:, RANGE_ERROR].std()
            for path in ("echo", "transponder")
        ]
        assert spread[1] / spread[0] == pytest.approx(2, rel=0.03)

    def test_the_demonstrations_estimator(self, device):
        """NumPy's lstsq on one hydrophone's samples has the distribution of our phases."""
        carrier, snr, offset = 15000.0, 3.0, (70.0, -45.0, -104.0)
        N = round(10 * SAMPLING_RATE / carrier)
        angle = 2 * np.pi * carrier / SAMPLING_RATE * np.arange(N)
        basis = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        draw = np.random.default_rng(5)
        phases = []
        for _ in range(2):
            y = np.sin(angle + 0.7) + 10 ** (-snr / 20) * draw.standard_normal((COUNT, N))
            cosine, sine = np.linalg.lstsq(basis, y.T, rcond=None)[0]
            phases.append(np.arctan2(cosine, sine) - 0.7)
        batch = Batch(device, offset, link_at(snr, offset, carrier))
        ours = batch.tones(sampled=True)[2][:, PHASE_X] - batch.phase_differences()[:, 0]
        assert stats.ks_2samp(phases[0] - phases[1], ours).pvalue > SIGNIFICANCE


@pytest.mark.parametrize("carrier", [13371.0, 15000.0, 18000.0])
@pytest.mark.parametrize("a", [200.0, 16.0, 6.0, 2.0])
def test_drawn_sums_are_those_of_drawn_samples(device, carrier, a):
    """Ten thousand fixes each way: every measured quantity, its extremes included, has the same distribution."""
    offset = (70.0, -45.0, -104.0)
    batch = Batch(device, offset, link_at(strength_db(a, carrier), offset, carrier))
    _, sampled_flags, sampled = batch.tones(seed=2, sampled=True)
    _, projected_flags, projected = batch.tones(seed=3)
    for column in (PHASE_X, PHASE_Y, RANGE_ERROR, AMPLITUDE, RESIDUAL):
        assert stats.ks_2samp(sampled[:, column], projected[:, column]).pvalue > SIGNIFICANCE
    assert p_of_equal_rates(sampled_flags == usbl.DETECTED, projected_flags == usbl.DETECTED) > SIGNIFICANCE
    for shift in (-2, -1, 0, 1, 2):
        assert p_of_equal_rates(sampled[:, SLIP] == shift, projected[:, SLIP] == shift) > SIGNIFICANCE
    if a > 10:
        columns = [PHASE_X, PHASE_Y, RANGE_ERROR, AMPLITUDE, RESIDUAL]
        assert p_of_equal_covariances(sampled[:, columns], projected[:, columns]) > SIGNIFICANCE


# offset (m), carrier (Hz), SNR (dB), path, spacing (m), slope, attitude error (rad)
MODELS = [
    ((0.0, 0.0, -100.0), 15000.0, 21.0, "echo", 0.033, (0.0, 0.0), 0.0),
    ((70.0, -45.0, -104.0), 15000.0, 21.0, "echo", 0.033, (0.0, 0.0), 0.0),
    ((70.0, -45.0, -104.0), 18000.0, 5.0, "transponder", 0.033, (0.1, -0.15), 0.0),
    ((-130.0, 90.0, -98.0), 18000.0, 12.0, "echo", 0.033, (0.0, 0.0), 0.002),
    ((-20.0, -150.0, -120.0), 12000.0, 0.0, "echo", 0.033, (0.2, 0.05), 0.002),
    ((10.0, 4.0, -12.0), 16500.0, 30.0, "transponder", 0.033, (-0.1, 0.1), 0.001),
    ((300.0, 120.0, -250.0), 13371.0, -2.0, "transponder", 0.033, (0.0, 0.0), 0.0),
    ((70.0, -45.0, -104.0), 15000.0, -4.3, "echo", 0.033, (0.0, 0.0), 0.0),
    ((70.0, 45.0, -104.0), 18000.0, -3.4, "echo", 0.033, (0.0, 0.0), 0.0),
    ((260.0, 10.0, -100.0), 15000.0, 2.0, "echo", 0.033, (0.0, 0.0), 0.0),
    ((110.0, -12.0, -75.0), 15000.0, 8.0, "echo", 0.06, (0.0, 0.0), 0.0),
]


@pytest.mark.parametrize("case", MODELS)
def test_both_models_agree(device, case):
    """Ten thousand fixes by samples and as many statistical ones: validity, mean and covariance of the good ones."""
    offset, carrier, snr, path, spacing, slope, attitude_error = case
    accuracy = acoustic_link.Accuracy(attitude=attitude_error)
    link = link_at(snr, offset, carrier, path, spacing=spacing, accuracy=accuracy)
    batch = Batch(device, offset, link, slope=slope)
    error, flags, _ = batch.tones(seed=4, sampled=True)
    drawn, drawn_flags, predicted = batch.statistical(seed=5)
    for bit in (usbl.DETECTED, usbl.WRAPPED, usbl.NO_DEPTH):
        assert p_of_equal_rates(flags & bit > 0, drawn_flags & bit > 0) > SIGNIFICANCE
    good, drawn_good = flags == usbl.DETECTED, drawn_flags == usbl.DETECTED
    detected, usable = fix_probability.good_probability(batch.link, batch.auv[:1], batch.offset[:1], batch.slope[:1])
    assert p_of_rate(good, (detected * usable).item()) > SIGNIFICANCE
    assert p_of_rate(drawn_good, (detected * usable).item()) > SIGNIFICANCE
    # The depth of a fix near the horizon is not normal, nor is what a limit cuts off: those have the horizontal alone.
    columns = slice(0, 3) if math.hypot(*offset[:2]) < -1.7 * offset[2] else slice(0, 2)
    assert p_of_equal_means(error[good, columns], drawn[drawn_good, columns]) > SIGNIFICANCE
    assert p_of_equal_covariances(error[good, columns], drawn[drawn_good, columns]) > SIGNIFICANCE
    if good.mean() > 0.99:
        horizontal = np.cov(error[good, :2].T)
        assert np.abs(horizontal - predicted).max() < 0.06 * np.trace(predicted)


class TestThreshold:
    @pytest.mark.parametrize("a", [14.8, 15.3, 15.8, 16.3, 17.0])
    @pytest.mark.parametrize("carrier", [12000.0, 18000.0])
    def test_detection(self, device, a, carrier):
        """Near the threshold: a noncentral χ² of the tone's energy on four hydrophones."""
        offset = (0.0, 30.0, -100.0)
        batch = Batch(device, offset, link_at(strength_db(a, carrier), offset, carrier), count=40_000)
        _, flags, measured = batch.tones(seed=6)
        detected = flags & usbl.DETECTED > 0
        S = batch.offset.double().norm(dim=1).mean().item()
        assert pytest.approx(math.hypot(*offset), rel=1e-4) == S
        assert p_of_rate(detected, stats.ncx2.sf(8 + 1000, 8, 4 * a * a)) > SIGNIFICANCE
        assert p_of_equal_rates(detected, batch.statistical(seed=7)[1] & usbl.DETECTED > 0) > SIGNIFICANCE
        assert np.all(measured[detected, SLIP] == 0)

    @pytest.mark.parametrize("a", [7.0, 8.0, 10.0])
    def test_wrong_periods(self, device, a):
        """The delay's slips by a period, over all places of the arrival in its period.

        With B = δ − sin(4πδ)/4π of its energy in the last block, the right delay leads the next by
        (1 − δ)(1 − 2B) + δ, that before by 1 − δ + δ(2B − 1), blocks of the noise variance 2 ((1 − δ)² + δ²); the sum
        of four hydrophones has twice the strength of one.
        """
        offset = (0.0, 0.0, -100.0)
        batch = Batch(device, offset, link_at(strength_db(a), offset, path="transponder"), count=200_000)
        slips = np.abs(batch.tones(seed=8)[2][:, SLIP])
        delta = np.linspace(0, 1, 2001)
        last = delta - np.sin(4 * np.pi * delta) / (4 * np.pi)
        scale = 2 * a / math.sqrt(10) / np.sqrt(2 * ((1 - delta) ** 2 + delta**2))
        later = stats.norm.sf(scale * ((1 - delta) * (1 - 2 * last) + delta))
        earlier = stats.norm.sf(scale * (1 - delta + delta * (2 * last - 1)))
        assert (slips == 1).mean() == pytest.approx((later + earlier).mean(), rel=0.25)

    def test_none_above_the_threshold(self, device):
        """A million tones at the threshold: of the accepted ones none has slipped, and phases keep their bound."""
        offset = (70.0, -45.0, -104.0)
        batch = Batch(device, offset, link_at(strength_db(math.sqrt(250)), offset), count=1_000_000)
        _, flags, measured = batch.tones(seed=9)
        detected = flags == usbl.DETECTED
        assert 0.4 < detected.mean() < 0.6
        assert np.abs(measured[detected, SLIP]).max() == 0
        error = measured[:, PHASE_X] - batch.phase_differences()[:, 0]
        assert error.var() == pytest.approx(2 / 250, rel=0.02)

    def test_far_below_it_phases_are_uniform(self, device):
        offset = (70.0, -45.0, -104.0)
        _, flags, measured = Batch(device, offset, link_at(-60.0, offset)).tones(seed=10)
        assert not np.any(flags & usbl.DETECTED)
        for column in (PHASE_X, PHASE_Y):
            assert stats.kstest(measured[:, column], "uniform", args=(-math.pi, 2 * math.pi)).pvalue > SIGNIFICANCE


class TestAmbiguity:
    @pytest.mark.parametrize("lean", [-0.03, -0.01, 0.0, 0.01, 0.03])
    def test_wraps_where_noise_carries_a_phase_over(self, device, lean):
        """d = 0.6 λ, and a direction whose phase difference is π + lean: rates by the normal integral."""
        kappa = 2 * math.pi * 0.6
        cosine = (math.pi + lean) / kappa
        offset = (100 * cosine, 5.0, -math.sqrt(100**2 * (1 - cosine**2) - 25))
        batch = Batch(device, offset, link_at(10.0, offset, spacing=0.06))
        _, flags, measured = batch.tones(seed=11)
        wrapped = flags & usbl.WRAPPED > 0
        sigma = 2 * 10 ** (-10 / 20) / math.sqrt(1344)
        assert p_of_rate(wrapped, stats.norm.sf(-lean / sigma)) > SIGNIFICANCE
        assert p_of_equal_rates(wrapped, batch.statistical(seed=12)[1] & usbl.WRAPPED > 0) > SIGNIFICANCE
        # Four hydrophones see by themselves that one axis has wrapped: its mean phase is half a turn off.
        assert np.array_equal(wrapped, np.abs(measured[:, RESIDUAL]) > 0.5 * math.pi)

    @pytest.mark.parametrize(
        ("cosines", "turns"), [((0.2, -0.1), 0), ((0.75, 0.1), 1), ((-0.1, -0.7), 1), ((0.67, -0.66), 2)]
    )
    @pytest.mark.parametrize("snr", [10.0, -4.3])
    def test_both_models_have_the_same_residual(self, device, cosines, turns, snr):
        """d = 0.9 λ: normal about π times the turns missing, half the variance of a phase difference, independent."""
        spacing = 0.09
        offset = (*(100 * u for u in cosines), -100 * math.sqrt(1 - cosines[0] ** 2 - cosines[1] ** 2))
        batch = Batch(device, offset, link_at(snr, offset, spacing=spacing))
        kappa = batch.link[0, acoustic_link.KAPPA].item()
        assert sum(abs(kappa * u) > math.pi for u in cosines) == turns
        _, flags, tones = batch.tones(seed=15)
        body = torch.nn.functional.normalize(batch.offset, dim=1)
        noise = torch.randn(batch.count, 5, generator=torch.Generator().manual_seed(16)).to(device)
        drawn = torch.empty((batch.count, 3), dtype=torch.float32, device=device)

        @ti.kernel
        def draw(
            link: ti.types.ndarray(dtype=ti.f32, ndim=2),
            body: ti.types.ndarray(dtype=ti.f32, ndim=2),
            noise: ti.types.ndarray(dtype=ti.f32, ndim=2),
            drawn: ti.types.ndarray(dtype=ti.f32, ndim=2),
        ):
            for n in range(drawn.shape[0]):
                u = vec3(body[n, 0], body[n, 1], body[n, 2])
                first = vec4(noise[n, 0], noise[n, 1], noise[n, 2], noise[n, 3])
                sigma = acoustic_link.phase_deviation(link, 0, 100.0, 0.0)
                m = usbl.measure(link, 0, u, 100.0, sigma, first, noise[n, 4])
                drawn[n, 0] = m.residual
                drawn[n, 1] = m.phase[0]
                drawn[n, 2] = m.phase[1]

        draw(batch.link, body, noise, drawn)
        drawn = drawn.double().cpu().numpy()
        one, other = (np.angle(np.exp(1j * (r - math.pi * turns))) for r in (tones[:, RESIDUAL], drawn[:, 0]))
        sigma = 2 * 10 ** (-snr / 20) / math.sqrt(1344)
        assert stats.ks_2samp(one, other).pvalue > SIGNIFICANCE
        for residual, phase in ((one, tones[:, [PHASE_X, PHASE_Y]]), (other, drawn[:, 1:])):
            # A hydrophone of a wrapped pair is measured in a window that is a period off: nine tenths of its tone.
            assert residual.std() == pytest.approx(sigma / math.sqrt(2), rel=0.08 if turns else 0.03)
            assert np.abs(np.corrcoef(residual, phase.T)[0, 1:]).max() < 4.5 / math.sqrt(batch.count)
        odd = flags & usbl.AMBIGUOUS > 0
        assert np.all(odd == (turns == 1))
        assert np.array_equal(odd, batch.statistical(seed=17)[1] & usbl.AMBIGUOUS > 0)

    @pytest.mark.parametrize("depth", [30.0, 15.0, 5.0, 0.5])
    def test_near_the_horizon_some_have_no_depth(self, device, depth):
        offset = (80.0, 60.0, -depth)
        batch = Batch(device, offset, link_at(6.0, offset), count=40_000)
        none = batch.tones(seed=13)[1] & usbl.NO_DEPTH > 0
        _, usable = fix_probability.good_probability(batch.link, batch.auv[:1], batch.offset[:1], batch.slope[:1])
        assert p_of_rate(~none, usable.item()) > SIGNIFICANCE
        assert p_of_equal_rates(none, batch.statistical(seed=14)[1] & usbl.NO_DEPTH > 0) > SIGNIFICANCE


class TestDraws:
    case = (70.0, -45.0, -104.0), 5.0

    def batch(self, device, count):
        offset, snr = self.case
        batch = Batch(device, offset, link_at(snr, offset), count=count)
        batch.offset = torch.tensor(offset, device=device).expand(count, 3).contiguous()
        return batch

    @pytest.mark.parametrize("sampled", [True, False])
    def test_a_fix_depends_on_seed_and_index_only(self, device, sampled):
        whole = self.batch(device, 500).tones(2**64 - 1, sampled)[2]
        assert np.array_equal(whole[:100], self.batch(device, 100).tones(2**64 - 1, sampled)[2])
        for seed in (2**64 - 2, 2**32 - 1):
            assert not np.any(whole[:, PHASE_X] == self.batch(device, 500).tones(seed, sampled)[2][:, PHASE_X])

    def test_neighbours_are_uncorrelated(self, device):
        measured = self.batch(device, 100_000).tones(15)[2][:, :5]
        z = (measured - measured.mean(0)) / measured.std(0)
        assert np.abs(z[1:].T @ z[:-1]).max() / len(z) < 5 / math.sqrt(len(z))

    def test_one_fix_inside_a_kernel(self, device):
        """`waveform.fix` at an address is the fix that `waveform.fixes` makes there."""
        batch = self.batch(device, 20)
        estimate, flags, _ = waveform.fixes(batch.link, batch.auv, batch.offset, batch.slope, 16)
        out = torch.empty((20, 5), dtype=torch.float32, device=device)

        @ti.kernel
        def take(
            link: ti.types.ndarray(dtype=ti.f32, ndim=2),
            offset: ti.types.ndarray(dtype=ti.f32, ndim=2),
            out: ti.types.ndarray(dtype=ti.f32, ndim=2),
        ):
            for n in range(out.shape[0]):
                r = vec3(offset[n, 0], offset[n, 1], offset[n, 2])
                address = random.uint4(ti.cast(n, ti.u32), ti.u32(0), ti.u32(0), ti.u32(0))
                S = r.norm()
                sigma = acoustic_link.phase_deviation(link, 0, S, 0.0)
                stream = random.philox(address, random.uint2(ti.u32(16), ti.u32(0)))
                measured = waveform.measure(link, 0, r, S, sigma, stream, waveform.PROJECTED)
                f = waveform.fix(link, 0, r, S, sigma, measured, usbl.array_axes(vec2(0.0, 0.0)))
                for j in ti.static(range(5)):
                    out[n, j] = f[j]

        take(batch.link, batch.offset, out)
        assert torch.equal(out[:, :4], estimate)
        assert torch.equal(out[:, 4].int(), flags)


@pytest.mark.parametrize("periods", [10.5, 4.0])
def test_a_tone_that_the_receiver_cannot_take_is_refused(device, periods):
    offset = (0.0, 0.0, -100.0)
    batch = Batch(device, offset, link_at(20.0, offset, periods=periods), count=4)
    with pytest.raises(ValueError, match="periods: a waveform needs whole periods, at least 5"):
        batch.tones()
