"""Coded pulses: at their bounds, detected and lost as theory has it, disturbed by reflections as the closed form says.

Comparisons of samples are tests at a stated significance with fixed seeds, as in `test_waveform.py`.
"""

import math

import numpy as np
import pytest
import taichi as ti
import torch
from scipy import stats
from scipy.optimize import minimize_scalar

from tests.kernels.positioning.test_reflections import coefficient
from usvauv.kernels.positioning import acoustic_link, coded_pulse, codes, reflections, sonar_equation, usbl
from usvauv.kernels.positioning.acoustic_link import ABSORPTION, SPREADING
from usvauv.kernels.positioning.waveform import AMPLITUDE, PHASE_X, PHASE_Y, RANGE_ERROR, RESIDUAL, SLIP
from usvauv.kernels.types import array1, array2, array3, vec2, vec3

SIGNIFICANCE = 1e-5
C = 1500.0
CARRIER = 25000.0
CARRIERS = (31000.0, CARRIER)  # of the second AUV alone anything is measured
SPACING = 0.02
OFFSET = (70.0, -45.0, -104.0)


class Batch:
    """Pulses of the second AUV's code from one place, its range spread over a chip and more."""

    def __init__(self, device, bandwidth=8000.0, chips=80, gate=8, offset=OFFSET, slope=(0.0, 0.0), path="transponder"):
        self.device, self.slope, self.path, self.bandwidth, self.gate = device, slope, path, bandwidth, gate
        self.offset, self.code = np.array(offset), codes.codes(2, chips)
        self.pulse = self.tables()
        sonar = acoustic_link.Sonar(spacing=SPACING, sound_speed=C, path=path)
        self.link = torch.from_numpy(acoustic_link.link_table(CARRIERS, sonar)).to(device)

    def tables(self, sampled=False):
        return coded_pulse.pulses(self.code, CARRIERS, self.bandwidth, self.gate, self.device, sampled=sampled)

    def places(self, count, spread):
        stretch = 1 + spread * np.linspace(-1, 1, count) / np.linalg.norm(self.offset)
        return torch.tensor(np.outer(stretch, self.offset), dtype=torch.float32, device=self.device)

    def geometry(self, count, spread=0.5):
        slope = torch.tensor(self.slope, dtype=torch.float32, device=self.device).expand(count, 2).contiguous()
        return self.link, torch.ones(count, dtype=torch.int32, device=self.device), self.places(count, spread), slope

    def measure(self, gamma, count, seed=1, spread=0.5, pulse=None, water=None):
        """(count, MEASURED) at the energy `gamma` over N0 on one hydrophone."""
        energy = torch.full((count,), float(gamma), device=self.device)
        case = *self.geometry(count, spread), energy, seed
        return coded_pulse.measurements(pulse or self.pulse, *case, water=water).double().cpu().numpy()

    def true_phases(self):
        """Phase differences (2,), rad, by the exact distances from a level array's hydrophones."""
        side = 0.5 * SPACING * np.eye(3)[:2]
        distance = [np.linalg.norm(self.offset + s * side, axis=1) for s in (1, -1)]
        return 2 * np.pi * CARRIER / C * (distance[0] - distance[1])


def waveform_of(code, x):
    """The pulse at x chips after its begin, band-limited chips of ±1 without end."""
    return np.sinc(x[..., None] - np.arange(code.size)) @ code


class TestCodes:
    def test_the_first_codes_do_not_depend_on_the_count(self):
        four = codes.codes(4, 40, seed=3)
        assert four.shape == (4, 40)
        assert np.all(np.abs(four) == 1)
        assert np.array_equal(four[:2], codes.codes(2, 40, seed=3))
        assert not np.array_equal(four, codes.codes(4, 40, seed=4))

    def test_short_codes_are_refused(self):
        with pytest.raises(ValueError, match="chips: a code has at least 16; got 8"):
            codes.codes(2, 8)

    def test_correlation_is_that_of_band_limited_chips(self):
        """Against the integral over samples of both pulses; a record without end differs from one of 161 by 1/161²."""
        one, other = codes.codes(2, 40)
        t = np.arange(-300, 340, 0.5)
        ours = [codes.correlation(a, b, 161) for a, b in ((one, one), (one, other))]
        for j in (0, 5, 40, 77, 640):
            shifted = waveform_of(one, t + j / codes.FINE)
            for function, base in zip(ours, (one, other), strict=True):
                assert function[j] == pytest.approx(shifted @ waveform_of(base, t) * 0.5 / 40, abs=4e-3)

    def test_bandwidth_is_flat(self):
        """Mean square bandwidth of the sampled pulse by its derivative, over that of a flat band, B²/12."""
        t = np.arange(-400, 440, 0.25)
        for code in codes.codes(4, 40):
            rise = (waveform_of(code, t + 1e-4) - waveform_of(code, t - 1e-4)) / 2e-4
            square = (rise**2).sum() / (waveform_of(code, t) ** 2).sum() / (2 * math.pi) ** 2
            assert square * 12 == pytest.approx(1, abs=0.008)

    def test_codes_are_told_apart(self):
        """Chosen codes have lower peaks than the random ones they are chosen from, and 1/(2L) in the mean square."""
        random = np.random.default_rng(1).choice([-1.0, 1.0], (8, 80))

        def peaks(family):
            return [np.abs(codes.correlation(a, b, 161)).max() for i, a in enumerate(family) for b in family[:i]]

        family = codes.codes(8, 80)
        assert max(peaks(family)) < 0.9 * max(peaks(random))
        square = [np.mean(codes.correlation(a, b, 161) ** 2) for i, a in enumerate(family) for b in family[:i]]
        assert np.mean(square) == pytest.approx(1 / 160, rel=0.1)


def test_the_noise_has_the_codes_autocorrelation(device):
    """Both matrices of the noise, N Nᵀ: the aperiodic autocorrelation of the code through band-limited chips."""
    batch = Batch(device, chips=40, gate=4)
    lag = np.arange(4 * codes.FINE + 1) / codes.FINE
    aperiodic = np.correlate(batch.code[1], batch.code[1], "full") / 40
    expected = np.sinc((lag[:, None] - lag)[..., None] - np.arange(-39, 40)) @ aperiodic
    for sampled in (False, True):
        N = batch.tables(sampled).noise[1].double().cpu().numpy()
        assert np.abs(N @ N.T - expected).max() < 3e-3
    drawn, every = (batch.tables(sampled).noise[1].double() for sampled in (False, True))
    assert (drawn @ drawn.T - every @ every.T).abs().max() < 1e-6
    assert drawn.shape[1] < 16 < every.shape[1]


@ti.kernel
def interpolate(table: array2, x: array2, out: array2):
    for n in range(x.shape[0]):
        out[n, 0] = coded_pulse.envelope(table, 1, x[n, 0])
        out[n, 1] = coded_pulse.summit(vec3(x[n, 1], x[n, 2], x[n, 3]))


def test_between_the_lags_of_a_table(device):
    """The envelope by a cubic, nothing beyond the table; a parabola's summit, not beyond its outer points."""
    batch = Batch(device, chips=40)
    draw = np.random.default_rng(3)
    lag, at = draw.uniform(-60, 60, 3000), draw.uniform(-1.5, 1.5, 3000)
    parabola = -draw.uniform(0.1, 9, 3000) * (np.array([-1, 0, 1])[:, None] - at) ** 2 + draw.normal(size=3000)
    out = torch.empty((3000, 2), device=device)
    interpolate(
        batch.pulse.envelope, torch.tensor(np.stack([lag, *parabola], axis=1), dtype=torch.float32, device=device), out
    )
    spectrum = np.abs(np.fft.fft(batch.code[1], 97)) ** 2 / 40 / 97  # of a record of two codes and two gates of 8
    R = np.cos(2 * np.pi * np.outer(lag, np.fft.fftfreq(97))) @ spectrum
    found = out.double().cpu().numpy()
    assert found[:, 0] == pytest.approx(np.where(np.abs(lag) < 48, R, 0.0), abs=1e-5)
    assert found[:, 1] == pytest.approx(at.clip(-1, 1), abs=1e-4)
    valley = torch.tensor([[0.0, 3.0, 1.0, 2.0], [0.0, 2.0, 1.0, 3.0], [0.0, 1.0, 1.0, 1.0]], device=device)
    interpolate(batch.pulse.envelope, valley, out)
    assert out[:3, 1].tolist() == [-1.0, 1.0, 0.0]


@pytest.mark.parametrize("gamma", [200.0, 8.0, 2.0])
def test_drawn_outputs_are_those_of_drawn_samples(device, gamma):
    batch = Batch(device, chips=40)
    ours, sampled = batch.measure(gamma, 20_000, 2), batch.measure(gamma, 5_000, 3, pulse=batch.tables(sampled=True))
    for column in (PHASE_X, PHASE_Y, RANGE_ERROR, AMPLITUDE, RESIDUAL):
        assert stats.ks_2samp(ours[:, column], sampled[:, column]).pvalue > SIGNIFICANCE


@pytest.mark.parametrize("gamma", [100.0, 6.0])
def test_a_receiver_in_numpy(device, gamma):
    """Sampled pulses at exact distances, white noise, a correlator at 32 lags a chip: all quantities alike."""
    batch = Batch(device, chips=40)
    count, code = 3_000, batch.code[1]
    S, chip = np.linalg.norm(batch.offset), C / batch.bandwidth
    t = np.arange(-100, 140, 0.5)
    lag = np.arange(-4, 4 + 1e-9, 1 / 32) + np.round(S / chip) - S / chip
    norm = np.linalg.norm(waveform_of(code, t))
    filters = np.stack([waveform_of(code, t - x) for x in lag]) / norm
    draw = np.random.default_rng(5)
    outputs = np.empty((4, count, lag.size), complex)
    for out, side in zip(outputs, ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)), strict=True):
        late = np.linalg.norm(batch.offset - 0.5 * SPACING * np.array(side)) - S
        received = math.sqrt(gamma) / norm * waveform_of(code, t - late / chip)
        noise = draw.standard_normal((count, t.size)) + 1j * draw.standard_normal((count, t.size))
        out[:] = (received * np.exp(-2j * np.pi * CARRIER / C * late) + noise / math.sqrt(2)) @ filters.T
    energy = (np.abs(outputs) ** 2).sum(0)
    pulse = np.arange(count)
    best = energy.argmax(1).clip(1, lag.size - 2)
    before, top, after = (energy[pulse, best + i] for i in (-1, 0, 1))
    at = outputs[:, pulse, best]
    theirs = {
        PHASE_X: np.angle(at[0] * at[1].conj()),
        PHASE_Y: np.angle(at[2] * at[3].conj()),
        RANGE_ERROR: chip * (lag[best] + 0.5 * (before - after) / (before - 2 * top + after) / 32),
        AMPLITUDE: np.sqrt(2 * energy.max(1)),
    }
    ours = batch.measure(gamma, 30_000, 4, spread=0.0)
    for column, sample in theirs.items():
        assert stats.ks_2samp(ours[:, column], sample).pvalue > SIGNIFICANCE


class TestWithoutNoise:
    @pytest.mark.parametrize("path", ["echo", "transponder"])
    @pytest.mark.parametrize("offset", [(0.0, 0.0, -100.0), OFFSET, (-290.0, 30.0, -80.0), (0.5, 0.4, -2.0)])
    def test_the_measurement_is_exact(self, device, rounding, offset, path):
        batch = Batch(device, offset=offset, path=path)
        measured = batch.measure(1e12, 64, spread=0.0 if offset[2] > -3 else 0.2)
        assert np.abs(measured[:, [PHASE_X, PHASE_Y]] - batch.true_phases()).max() < 5e-5 * rounding
        # To 1/30,000 of a chip of 0.19 m, on a range in single precision.
        assert np.abs(measured[:, RANGE_ERROR]).max() < 2e-5 + 1e-7 * np.linalg.norm(offset)
        assert np.abs(measured[:, RESIDUAL]).max() < 1e-4 * rounding  # 5e-5 by the sphere, 2 m away

    def test_a_wrapped_axis_shows_in_the_residual(self, device):
        batch = Batch(device, offset=(90.0, 0.0, -10.0))
        batch.link[1, acoustic_link.KAPPA] *= 1.6
        assert batch.link[1, acoustic_link.KAPPA] * 0.99 > math.pi
        assert np.all(np.abs(batch.measure(1e12, 8)[:, RESIDUAL]) > 3)


class TestBounds:
    @pytest.mark.parametrize(("bandwidth", "chips"), [(8000.0, 80), (4000.0, 40)])
    def test_phases_and_delay(self, device, bandwidth, chips):
        """Against the information matrix of amplitudes, phases and delay of four sampled pulses; 40,000 pulses."""
        batch, gamma = Batch(device, bandwidth, chips), 1000.0
        t = np.arange(-400, chips + 400, 0.5)
        s = waveform_of(batch.code[1], t) * math.sqrt(gamma / (2 * chips))
        rise = (waveform_of(batch.code[1], t + 1e-4) - waveform_of(batch.code[1], t - 1e-4)) / 2e-4
        derivatives = np.zeros((9, 4, t.size), complex)
        for i in range(4):
            derivatives[i, i], derivatives[4 + i, i] = s, 1j * s
        derivatives[8] = rise * math.sqrt(gamma / (2 * chips))
        flat = derivatives.reshape(9, -1)
        bound = np.linalg.inv(2 * (flat @ flat.conj().T).real)
        difference = bound[4, 4] + bound[5, 5] - 2 * bound[4, 5]
        assert difference == pytest.approx(1 / gamma, rel=0.01)
        assert bound[8, 8] == pytest.approx(12 / (2 * math.pi) ** 2 / (8 * gamma), rel=0.01)
        error = batch.measure(gamma, 40_000)[:, [PHASE_X, PHASE_Y, RANGE_ERROR]]
        chip = C / bandwidth
        # Standard error 0.7 %; γ is finite, and hydrophones that are read at one lag lose 0.2 %.
        assert error.var(0) == pytest.approx([difference, difference, chip**2 * bound[8, 8]], rel=0.035)
        assert np.abs(np.corrcoef(error.T) - np.eye(3)).max() < 4.5 / math.sqrt(len(error))
        error[:, :2] -= batch.true_phases()
        assert (np.abs(error.mean(0)) / error.std(0)).max() < 4.5 / math.sqrt(len(error))

    def test_an_echo_halves_the_range_error(self, device):
        spread = [
            Batch(device, path=path).measure(50, 10_000)[:, RANGE_ERROR].std() for path in ("echo", "transponder")
        ]
        assert spread[1] / spread[0] == pytest.approx(2, rel=0.04)


def wrong_peak(gamma, gate):
    """Probability that noise more than half a chip off exceeds the pulse's own peak, by the crossings of its energy."""
    u = np.linspace(0, 200, 20_001)
    rate = math.sqrt(math.pi / 3) * (u / 2) ** 3.5 * np.exp(-u / 2) / 6
    exceeded = 1 - stats.chi2.cdf(u, 8) * np.exp(-(gate - 2) * rate)
    return np.trapezoid(stats.ncx2.pdf(u, 9, 8 * gamma) * exceeded, u)


class TestDetection:
    @pytest.mark.parametrize("gamma", [4.0, 6.0, 9.0, 20.0])
    def test_energy(self, device, gamma):
        """Noncentral χ² of the amplitudes and phases of four hydrophones, and a ninth degree of freedom, the delay."""
        energy = Batch(device).measure(gamma, 40_000, 6)[:, AMPLITUDE] ** 2
        for quantile in (0.2, 0.5, 0.8):
            level = stats.ncx2.ppf(quantile, 9, 8 * gamma)
            assert (energy < level).mean() == pytest.approx(quantile, abs=0.015)

    @pytest.mark.parametrize("gate", [4, 16])
    def test_false_alarms(self, device, gate):
        energy = Batch(device, gate=gate).measure(0.0, 60_000, 7)[:, AMPLITUDE] ** 2 / 2
        for probability in (0.1, 0.02, 0.003):
            level = codes.threshold(probability, gate)
            assert codes.false_alarm(level, gate) == pytest.approx(probability, rel=1e-6)
            count = (energy > level).sum()
            assert (
                abs(count - 60_000 * probability) < 4.5 * math.sqrt(60_000 * probability) + 0.06 * 60_000 * probability
            )

    def test_thresholds_by_the_chi_square(self):
        """Without a gate the false alarms are those of a χ² of 8 degrees of freedom."""
        assert codes.threshold(1e-4, 0.0) == pytest.approx(stats.chi2.isf(1e-4, 8) / 2, rel=1e-9)

    @pytest.mark.parametrize("gamma", [1.0, 2.0, 4.0])
    def test_wrong_peaks(self, device, gamma):
        wrong = Batch(device, gate=16).measure(gamma, 40_000, 8)[:, SLIP] != 0
        expected = wrong_peak(gamma, 16)
        assert abs(wrong.mean() - expected) < 4.5 * math.sqrt(expected / wrong.size) + 0.06 * expected

    def test_few_wrong_peaks_above_the_threshold(self, device):
        """At the false alarm rate 1e-4: of 100,000 weak pulses some 10 to 20 are accepted at a wrong lag."""
        measured = Batch(device, gate=16).measure(3.0, 100_000, 9)
        accepted = measured[:, AMPLITUDE] ** 2 / 2 >= codes.threshold(1e-4, 16)
        assert 0.15 < accepted.mean() < 0.25
        assert (accepted & (measured[:, SLIP] != 0)).mean() < 4e-4


# offset (m), slope, bandwidth (Hz), array's and water's depth (m), roughness (m), bottom's density, speed of sound and
# absorption (dB a wavelength): surface unresolved, near the horizon, resolved; bottom near and far.
WATERS = [
    ((70.0, -45.0, -104.0), (0.3, -0.2), 2000.0, 0.3, 1e5, 0.012, 1.9, 1.1, 0.8),
    ((170.0, -45.0, -20.0), (0.3, -0.2), 2000.0, 3.0, 1e5, 0.055, 1.9, 1.1, 0.8),
    ((70.0, -45.0, -104.0), (0.3, -0.2), 2000.0, 3.0, 1e5, 0.01, 1.9, 1.1, 0.8),
    ((70.0, -45.0, -104.0), (0.0, 0.0), 2000.0, 3.0, 105.0, 1e3, 1.5, 1.0, 0.2),
    ((170.0, -45.0, -20.0), (0.0, 0.0), 4000.0, 3.0, 30.0, 1e3, 1.7, 1.05, 1.0),
]


def mirrored(which, water, offset, link):
    """The image (3,) of a place at surface or bottom, its excess path (m) and amplitude."""
    array_depth, water_depth, roughness, *bottom = water
    plane = array_depth if which == 0 else array_depth - water_depth
    image = np.array([offset[0], offset[1], 2 * plane - offset[2]])
    direct, length = np.linalg.norm(offset), np.linalg.norm(image)
    share = coefficient(which, abs(image[2]) / length, 2 * np.pi * CARRIER / C, roughness, bottom)
    loss = [sonar_equation.path_loss(r, *link[1, [SPREADING, ABSORPTION]].tolist()) for r in (length, direct)]
    return image, length - direct, share * 10 ** (-(loss[0] - loss[1]) / 20)


class TestReflections:
    @pytest.mark.parametrize("case", WATERS)
    def test_extra_variance(self, device, case):
        """Strong pulses, boundaries spread over four turns of the reflection's phase: closed form and waveform."""
        offset, slope, bandwidth, array_depth, water_depth, *_ = case
        batch, count = Batch(device, bandwidth, 40, offset=offset, slope=slope), 8_000
        water = torch.tensor([case[3:]], dtype=torch.float32, device=device).repeat(count, 1)
        surface = water_depth == 1e5
        level = array_depth if surface else array_depth - water_depth
        sine = abs(2 * level - offset[2]) / math.hypot(offset[0], offset[1], 2 * level - offset[2])
        turns = torch.linspace(0, 4, count, device=device) * C / CARRIER / (2 * sine)
        water[:, 0 if surface else 1] += turns
        disturbed = batch.measure(1e10, count, spread=0.0, water=water)[:, [PHASE_X, PHASE_Y, RANGE_ERROR]]
        clean = batch.measure(1e12, count, spread=0.0)[:, [PHASE_X, PHASE_Y, RANGE_ERROR]]
        error = disturbed - clean
        variance = coded_pulse.multipath_variances(batch.pulse, *batch.geometry(count, 0.0), water).double().mean(0)
        assert error.var(0) == pytest.approx(variance.cpu().numpy(), rel=0.12)
        assert (np.abs(error.mean(0)) / error.std(0)).max() < 0.35

    def test_the_series_is_the_mean_over_the_phase(self, device):
        """Phase difference by two phasors at every mean phase, for reflections up to nine tenths."""
        cases = [(0.1, 0.3), (0.5, 2.0), (0.9, 0.5), (-0.7, 3.0)]
        given = torch.tensor(cases, dtype=torch.float32, device=device)
        out = torch.empty((len(cases), 1), dtype=torch.float32, device=device)

        @ti.kernel
        def take(given: array2, out: array2):
            for n in range(given.shape[0]):
                out[n, 0] = reflections.difference_variance(given[n, 0], given[n, 1])

        take(given, out)
        psi = np.arange(4096) * 2 * np.pi / 4096
        for (rho, delta), value in zip(cases, out[:, 0].tolist(), strict=True):
            ratio = (1 + rho * np.exp(1j * (psi + delta))) / (1 + rho * np.exp(1j * psi))
            assert value == pytest.approx(np.angle(ratio).var(), rel=0.01)

    def test_weak_reflections_are_the_means_over_their_phase(self, device):
        """Two phasors on each hydrophone, of unequal strength where both are read at one lag; and the energy's peak."""
        draw, count = np.random.default_rng(6), 60
        body, image = (part / np.linalg.norm(part, axis=0) for part in draw.normal(size=(2, 3, count)))
        rho, slope = draw.uniform(-0.01, 0.01, count), draw.uniform(-0.1, 0.1, count)
        kappa, rate, beta2 = 2.5, 0.3, 3.0
        out = torch.empty((count, 3), device=device)

        @ti.kernel
        def take(given: array2, out: array2):
            for n in range(given.shape[0]):
                body, image = (vec3(given[n, 0], given[n, 1], given[n, 2]), vec3(given[n, 3], given[n, 4], given[n, 5]))
                width = vec2(rate, beta2)
                found = reflections.extra_variance(kappa, body, image, given[n, 6], given[n, 7], width)
                for j in ti.static(range(3)):
                    out[n, j] = found[j]

        given = np.stack([*body, *image, rho, slope], axis=1)
        take(torch.tensor(given, dtype=torch.float32, device=device), out)
        psi = np.arange(64)[:, None] * 2 * np.pi / 64
        expected, together = [], 0.0
        for axis in range(2):
            half = 0.5 * kappa * (image - body)[axis]
            uneven = 0.5 * slope * rate * kappa * image[axis] / (2 * np.pi)
            one, other = (1 + (rho + s * uneven) * np.exp(1j * (psi + s * half)) for s in (1, -1))
            expected.append(np.angle(one / other).var(0))
            together = together + np.cos(psi + half) / 4 + np.cos(psi - half) / 4
        expected.append((slope / beta2 * together).var(0))
        assert out.double().cpu().numpy() == pytest.approx(np.stack(expected, axis=1), rel=5e-3, abs=1e-8)

    @pytest.mark.parametrize("which", [0, 1])
    def test_images(self, device, which):
        """Mirror images, distances and amplitudes in double precision."""
        array_depth, water_depth, roughness = 3.0, 130.0, 0.02
        bottom = reflections.SEDIMENTS["silt"]
        link = Batch(device).link
        out = torch.empty((1, 6), dtype=torch.float32, device=device)

        @ti.kernel
        def take(which: ti.i32, link: array2, out: array2):
            boundaries = reflections.Boundaries(array_depth, water_depth, roughness, bottom[0], bottom[1], bottom[2])
            around = ti.static(reflections.Surroundings(boundaries))
            r = reflections.reflection(which, vec3(OFFSET[0], OFFSET[1], OFFSET[2]), around, link, 1)
            for j in ti.static(range(3)):
                out[0, j] = r.source[j]
            out[0, 3] = r.slant_range
            out[0, 4] = r.excess
            out[0, 5] = r.amplitude

        take(which, link, out)
        image, excess, amplitude = mirrored(which, (array_depth, water_depth, roughness, *bottom), OFFSET, link)
        assert out[0].tolist() == pytest.approx([*image, np.linalg.norm(image), excess, amplitude], rel=2e-5)

    @pytest.mark.parametrize("path", ["echo", "transponder"])
    def test_the_peak_of_all_sounds_together(self, device, path):
        """Delays, phases and amplitudes at exact distances; the highest energy by golden sections."""
        water = (3.0, 112.0, 0.02, *reflections.SEDIMENTS["gravel"])
        places = [(70.0, -45.0, -104.0), (170.0, 60.0, -108.0), (-90.0, 140.0, -6.0), (1.0, 4.0, -0.8)]
        batch = Batch(device, chips=40, path=path)
        heard, found = (torch.zeros((len(places), n, 4), device=device) for n in (12, 1))

        @ti.kernel
        def take(
            envelopes: array2, noise: array3, rate: array1, link: array2, place: array2, heard: array3, found: array3
        ):
            for n in range(place.shape[0]):
                tables = ti.static(coded_pulse.Pulses(envelopes, noise, rate))
                r = vec3(place[n, 0], place[n, 1], place[n, 2])
                axes = usbl.array_axes(vec2(0.1, -0.2))
                boundaries = reflections.Boundaries(water[0], water[1], water[2], water[3], water[4], water[5])
                around = ti.static(reflections.Surroundings(boundaries))
                sounds = coded_pulse.sounds(tables, link, 1, axes @ r, r.norm(), r, axes, around)
                disturbed = coded_pulse.disturbance(tables, link, 1, sounds)
                for row in range(12):
                    for j in ti.static(range(3)):
                        heard[n, row, j] = sounds[row, j]
                for j in ti.static(range(4)):
                    found[n, 0, j] = disturbed[j]

        take(*batch.pulse, batch.link, torch.tensor(places, device=device), heard, found)
        pitch, roll = np.eye(3), np.eye(3)
        pitch[::2, ::2] = [[math.cos(0.1), math.sin(0.1)], [-math.sin(0.1), math.cos(0.1)]]
        roll[1:, 1:] = [[math.cos(-0.2), math.sin(-0.2)], [-math.sin(-0.2), math.cos(-0.2)]]
        sides = 0.5 * SPACING * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]]) @ roll @ pitch
        frequency = np.arange(0.5, 2000) / 4000  # of the code, by a record that is much longer
        spectrum = np.abs(np.exp(-2j * np.pi * np.outer(frequency, np.arange(40))) @ batch.code[1]) ** 2 / 40 / 2000

        def received(lag, late, phasor):
            R = np.cos(2 * np.pi * np.outer(lag - late, frequency)) @ spectrum
            return (phasor * R).reshape(3, 4).sum(0)

        for place, sounds, disturbed in zip(
            np.array(places), heard.cpu().numpy(), found.cpu().numpy()[:, 0], strict=True
        ):
            images = [(place, 0.0, 1.0), *(mirrored(which, water, place, batch.link) for which in (0, 1))]
            S, late, phasor = np.linalg.norm(place), np.zeros(12), np.zeros(12, complex)
            for n, (image, _, amplitude) in enumerate(images):
                late[4 * n : 4 * n + 4] = np.linalg.norm(image - sides, axis=1) - S
                phasor[4 * n : 4 * n + 4] = amplitude
            phasor *= np.exp(-2j * np.pi * CARRIER / C * late)
            late *= batch.bandwidth / C
            assert sounds[:, 0] == pytest.approx(late, rel=1e-4, abs=1e-5)
            assert sounds[:, 1] + 1j * sounds[:, 2] == pytest.approx(phasor, abs=2e-4)
            best = minimize_scalar(
                lambda lag, *heard: -(abs(received(lag, *heard)) ** 2).sum(),
                bounds=(-0.7, 0.7), args=(late, phasor), options={"xatol": 1e-7},
            )  # fmt: skip
            out = received(best.x, late, phasor)
            turns = np.angle(phasor[:4] / out)
            by_hand = turns[1] - turns[0], turns[3] - turns[2]
            metres = best.x * C / batch.bandwidth / (2 if path == "echo" else 1)
            expected = *by_hand, metres, np.sqrt((abs(out) ** 2).mean())
            assert disturbed == pytest.approx(expected, rel=1e-3, abs=2e-4)

    def test_water_that_reflects_nothing_changes_nothing(self, device):
        batch = Batch(device)
        silent = torch.tensor([[3.0, 1e5, 1e3, 1.9, 1.1, 0.8]], device=device).repeat(50, 1)
        assert np.array_equal(batch.measure(10.0, 50, water=silent), batch.measure(10.0, 50))


def test_a_measurement_depends_on_seed_and_index_only(device):
    batch = Batch(device, gate=4)
    whole = batch.measure(5.0, 300, 2**64 - 1, spread=0.0)
    assert np.array_equal(whole[:100], batch.measure(5.0, 100, 2**64 - 1, spread=0.0))
    for seed in (2**64 - 2, 2**32 - 1):
        assert not np.any(whole[:, PHASE_X] == batch.measure(5.0, 300, seed, spread=0.0)[:, PHASE_X])
