"""Sampled pulses, codes and tones: at their bounds, equal to the statistical model, detected and lost as predicted.

Comparisons of samples are tests at a stated significance with fixed seeds.
"""

import functools
import math

import numpy as np
import pytest
import torch
from scipy import stats

from usvauv.kernels.positioning import acoustic_link, matched_filter, pulse, reflections, usbl
from usvauv.kernels.positioning.matched_filter import AMPLITUDE, PHASE_X, PHASE_Y, RANGE_ERROR, RESIDUAL, SLIP

SIGNIFICANCE = 1e-5
C = 1500.0
OFFSET = (70.0, -45.0, -104.0)
PERIODS = 10


@functools.cache
def tables_of(device, signal, chips, bandwidth, gate):
    """Codes (none of a tone), carriers, Hz, and tables of the pulses of two AUVs."""
    if signal == "tone":
        return None, (12000.0, 15000.0), pulse.tones(2, PERIODS, device)
    code, carriers = pulse.codes(2, chips), (31000.0, 25000.0)
    return code, carriers, pulse.pulses(code, carriers, bandwidth, gate, device)


class Batch:
    """Pulses of the second AUV from one place, its range spread over a chip and more, and statistical fixes of it."""

    def __init__(self, device, signal="code", *, chips=80, bandwidth=8000.0, gate=8, offset=OFFSET, slope=(0.0, 0.0),
                 **sonar):  # fmt: skip
        self.device, self.slope, self.offset, self.bandwidth = device, slope, np.array(offset), bandwidth
        self.code, carriers, self.tables = tables_of(device, signal, chips, bandwidth, gate)
        self.carrier, spacing = carriers[1], 0.02 if signal == "code" else 0.033
        self.sonar = acoustic_link.Sonar(
            **{"spacing": spacing, "sound_speed": C, "path": "transponder", "signal": signal, "periods": PERIODS,
               "pulse_length": chips / bandwidth, "bandwidth": bandwidth} | sonar
        )  # fmt: skip
        self.link = torch.from_numpy(acoustic_link.link_table(carriers, self.sonar)).to(device)
        self.rms_frequency = bandwidth / math.sqrt(12) if signal == "code" else self.carrier

    def geometry(self, count, spread=0.5):
        stretch = 1 + spread * np.linspace(-1, 1, count) / np.linalg.norm(self.offset)
        places = torch.tensor(np.outer(stretch, self.offset), dtype=torch.float32, device=self.device)
        slope = torch.tensor(self.slope, dtype=torch.float32, device=self.device).expand(count, 2).contiguous()
        return self.link, torch.ones(count, dtype=torch.int32, device=self.device), places, slope

    def measure(self, gamma, count, seed=1, spread=0.5, water=None):
        """(count, MEASURED) at the energy `gamma` over N0 on one hydrophone."""
        energy = torch.full((count,), float(gamma), device=self.device)
        case = *self.geometry(count, spread), energy, seed
        return matched_filter.measurements(self.tables, *case, water=water).double().cpu().numpy()

    def statistical(self, count, seed=2):
        """Errors (count, 3), flags, and γ by the link."""
        noise = torch.randn(count, 7, generator=torch.Generator().manual_seed(seed)).to(self.device)
        geometry = self.geometry(count)
        estimate, _, flags = usbl.fixes(*geometry, noise)
        error = (estimate[:, :3] - geometry[2]).double().cpu().numpy()
        return error, flags.cpu().numpy(), 1 / estimate[0, 3].item() ** 2

    def errors(self, measured):
        """Errors (n, 3) of a level array's fixes from measurements."""
        place = self.geometry(len(measured))[2].double().cpu().numpy()
        u = measured[:, [PHASE_X, PHASE_Y]] / self.link[1, acoustic_link.KAPPA].item()
        direction = np.column_stack([u, -np.sqrt(np.maximum(1 - (u**2).sum(1), 0))])
        return (np.linalg.norm(place, axis=1) + measured[:, RANGE_ERROR])[:, None] * direction - place

    def true_phases(self):
        """Phase differences (2,), rad, by the exact distances from a level array's hydrophones."""
        side = 0.5 * self.sonar.spacing * np.eye(3)[:2]
        distance = [np.linalg.norm(self.offset + s * side, axis=1) for s in (1, -1)]
        return 2 * np.pi * self.carrier / C * (distance[0] - distance[1])


def waveform_of(code, x):
    """The pulse at x chips after its begin, band-limited chips of ±1 without end."""
    return np.sinc(x[..., None] - np.arange(code.size)) @ code


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


class TestCodes:
    def test_the_first_codes_do_not_depend_on_the_count(self):
        four = pulse.codes(4, 40, seed=3)
        assert np.all(np.abs(four) == 1)
        assert np.array_equal(four[:2], pulse.codes(2, 40, seed=3))
        assert not np.array_equal(four, pulse.codes(4, 40, seed=4))

    def test_short_codes_are_refused(self):
        with pytest.raises(ValueError, match="chips: a code has at least 16; got 8"):
            pulse.codes(2, 8)

    def test_bandwidth_is_flat(self):
        """Mean square bandwidth of the sampled pulse by its derivative, over that of a flat band, B²/12."""
        t = np.arange(-400, 440, 0.25)
        for code in pulse.codes(4, 40):
            rise = (waveform_of(code, t + 1e-4) - waveform_of(code, t - 1e-4)) / 2e-4
            square = (rise**2).sum() / (waveform_of(code, t) ** 2).sum() / (2 * math.pi) ** 2
            assert square * 12 == pytest.approx(1, abs=0.008)

    def test_codes_are_told_apart(self):
        """Chosen codes have lower peaks than the random ones they are chosen from, and 1/(2L) in the mean square."""
        random = np.random.default_rng(1).choice([-1.0, 1.0], (8, 80))

        def peaks(family):
            return [np.abs(pulse.correlation(a, b, 161)).max() for i, a in enumerate(family) for b in family[:i]]

        family = pulse.codes(8, 80)
        assert max(peaks(family)) < 0.9 * max(peaks(random))
        square = [np.mean(pulse.correlation(a, b, 161) ** 2) for i, a in enumerate(family) for b in family[:i]]
        assert np.mean(square) == pytest.approx(1 / 160, rel=0.1)


@pytest.mark.parametrize("signal", ["code", "tone"])
def test_the_noise_has_the_autocorrelation_of_the_pulse(device, signal):
    """N Nᵀ is the aperiodic autocorrelation of the code through band-limited chips; a tone's falls linearly."""
    batch = Batch(device, signal, chips=40, gate=4)
    code = batch.code[1] if signal == "code" else np.ones(PERIODS)
    N = batch.tables.noise[1].double().cpu().numpy()
    lag = np.arange(len(N)) / pulse.FINE
    aperiodic = np.correlate(code, code, "full") / code.size
    expected = np.sinc((lag[:, None] - lag)[..., None] - np.arange(1 - code.size, code.size)) @ aperiodic
    assert np.abs(N @ N.T - expected).max() < 3e-3


@pytest.mark.parametrize("gamma", [100.0, 6.0])
def test_a_receiver_in_numpy(device, gamma):
    """Sampled codes at exact distances, white noise, a correlator at 32 lags a chip: all quantities alike."""
    batch = Batch(device, chips=40)
    count, code = 1_500, batch.code[1]
    S, chip = np.linalg.norm(batch.offset), C / batch.bandwidth
    t = np.arange(-100, 140, 0.5)
    lag = np.arange(-4, 4 + 1e-9, 1 / 32) + np.round(S / chip) - S / chip
    norm = np.linalg.norm(waveform_of(code, t))
    filters = np.stack([waveform_of(code, t - x) for x in lag]) / norm
    draw = np.random.default_rng(5)
    outputs = np.empty((4, count, lag.size), complex)
    for out, side in zip(outputs, ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)), strict=True):
        late = np.linalg.norm(batch.offset - 0.5 * batch.sonar.spacing * np.array(side)) - S
        received = math.sqrt(gamma) / norm * waveform_of(code, t - late / chip)
        noise = draw.standard_normal((count, t.size)) + 1j * draw.standard_normal((count, t.size))
        out[:] = (received * np.exp(-2j * np.pi * batch.carrier / C * late) + noise / math.sqrt(2)) @ filters.T
    energy = (np.abs(outputs) ** 2).sum(0)
    best = energy.argmax(1).clip(1, lag.size - 2)
    before, top, after = (energy[np.arange(count), best + i] for i in (-1, 0, 1))
    at = outputs[:, np.arange(count), best]
    theirs = {
        PHASE_X: np.angle(at[0] * at[1].conj()),
        PHASE_Y: np.angle(at[2] * at[3].conj()),
        RANGE_ERROR: chip * (lag[best] + 0.5 * (before - after) / (before - 2 * top + after) / 32),
        AMPLITUDE: np.sqrt(2 * energy.max(1)),
    }
    ours = batch.measure(gamma, 30_000, 4, spread=0.0)
    for column, sample in theirs.items():
        assert stats.ks_2samp(ours[:, column], sample).pvalue > SIGNIFICANCE


@pytest.mark.parametrize("signal", ["code", "tone"])
class TestWithoutNoise:
    @pytest.mark.parametrize("path", ["echo", "transponder"])
    @pytest.mark.parametrize("offset", [(0.0, 0.0, -100.0), OFFSET, (-290.0, 30.0, -80.0), (0.5, 0.4, -2.0)])
    def test_the_measurement_is_exact(self, device, rounding, signal, offset, path):
        batch = Batch(device, signal, offset=offset, path=path)
        measured = batch.measure(1e12, 64, spread=0.0 if offset[2] > -3 else 0.2)
        assert np.abs(measured[:, [PHASE_X, PHASE_Y]] - batch.true_phases()).max() < 5e-5 * rounding
        # To 1/30,000 of a chip of 0.19 m, on a range in single precision.
        assert np.abs(measured[:, RANGE_ERROR]).max() < 2e-5 + 1e-7 * np.linalg.norm(offset)
        assert np.abs(measured[:, RESIDUAL]).max() < 2e-4 * rounding  # 1e-4 by the sphere, 2 m away

    def test_a_wrapped_axis_shows_in_the_residual(self, device, signal):
        batch = Batch(device, signal, offset=(90.0, 0.0, -10.0))
        batch.link[1, acoustic_link.KAPPA] *= 1.6
        assert batch.link[1, acoustic_link.KAPPA] * 0.99 > math.pi
        assert np.all(np.abs(batch.measure(1e12, 8)[:, RESIDUAL]) > 3)


@pytest.mark.parametrize("signal", ["code", "tone"])
class TestBounds:
    def test_phases_and_delay(self, device, signal):
        """The Cramér–Rao bounds 1/γ and 1/(8γ (2π f_rms)²), no bias, no correlation; 100,000 pulses."""
        batch, gamma = Batch(device, signal), 1000.0
        error = batch.measure(gamma, 100_000)[:, [PHASE_X, PHASE_Y, RANGE_ERROR]]
        error[:, :2] -= batch.true_phases()
        delay = C / (2 * math.pi * batch.rms_frequency) / math.sqrt(8 * gamma)
        # Standard error 0.4 %; γ is finite, and hydrophones that are read at one lag lose 0.2 %.
        assert error.var(0) == pytest.approx([1 / gamma, 1 / gamma, delay**2], rel=0.025)
        assert np.abs(np.corrcoef(error.T) - np.eye(3)).max() < 4.5 / math.sqrt(len(error))
        assert (np.abs(error.mean(0)) / error.std(0)).max() < 4.5 / math.sqrt(len(error))


# Signal, offset (m), level (dB) and path: strong, far to the side, tilted, near the threshold.
MODELS = [
    ("tone", (0.0, 0.0, -100.0), 155.0, "echo"),
    ("tone", OFFSET, 160.0, "echo"),
    ("tone", (-130.0, 90.0, -98.0), 130.0, "transponder"),
    ("tone", (260.0, 10.0, -100.0), 130.0, "transponder"),
    ("code", (0.0, 0.0, -100.0), 105.0, "transponder"),
    ("code", OFFSET, 150.0, "echo"),
    ("code", (-130.0, 90.0, -98.0), 110.0, "transponder"),
]


@pytest.mark.parametrize(("signal", "offset", "level", "path"), MODELS)
def test_sampled_and_statistical_fixes_have_the_same_mean_and_covariance(device, signal, offset, level, path):
    """Ten thousand fixes each way."""
    batch = Batch(device, signal, offset=offset, source_level=level, path=path)
    drawn, flags, gamma = batch.statistical(10_000)
    assert np.all(flags == usbl.DETECTED)
    error = batch.errors(batch.measure(gamma, 10_000, seed=4))
    assert p_of_equal_means(error, drawn) > SIGNIFICANCE
    assert p_of_equal_covariances(error, drawn) > SIGNIFICANCE


class TestDetection:
    @pytest.mark.parametrize(
        ("signal", "gamma", "freedom"),
        [("code", 4.0, 9), ("code", 9.0, 9), ("code", 20.0, 9), ("tone", 110.0, 8), ("tone", 125.0, 8)],
    )
    def test_energy(self, device, signal, gamma, freedom):
        """Noncentral χ² of the amplitudes and phases of four hydrophones, and of a code a ninth degree, the delay."""
        energy = Batch(device, signal, offset=(0.0, 30.0, -100.0)).measure(gamma, 40_000, 6)[:, AMPLITUDE] ** 2
        for quantile in (0.2, 0.5, 0.8):
            level = stats.ncx2.ppf(quantile, freedom, 8 * gamma)
            assert (energy < level).mean() == pytest.approx(quantile, abs=0.015)

    def test_no_wrong_period_from_the_threshold_on(self, device):
        """Tones at the threshold of detection, γ = 125: none has slipped, and phases keep their bound."""
        measured = Batch(device, "tone").measure(125.0, 400_000, 9)
        detected = measured[:, AMPLITUDE] >= math.sqrt(8 + 4 * acoustic_link.PERIOD_ENERGY * PERIODS)
        assert 0.4 < detected.mean() < 0.6
        assert np.all(measured[:, SLIP] == 0)
        assert (measured[:, PHASE_X]).var() == pytest.approx(1 / 125, rel=0.02)

    @pytest.mark.parametrize("gamma", [1.0, 2.0, 4.0])
    def test_wrong_peaks(self, device, gamma):
        """Noise more than half a chip off exceeds the code's own peak, by the crossings of its energy (Rice)."""
        wrong = Batch(device, gate=16).measure(gamma, 40_000, 8)[:, SLIP] != 0
        u = np.linspace(0, 200, 20_001)
        rate = math.sqrt(math.pi / 3) * (u / 2) ** 3.5 * np.exp(-u / 2) / 6
        exceeded = 1 - stats.chi2.cdf(u, 8) * np.exp(-(16 - 2) * rate)
        expected = np.trapezoid(stats.ncx2.pdf(u, 9, 8 * gamma) * exceeded, u)
        assert abs(wrong.mean() - expected) < 4.5 * math.sqrt(expected / wrong.size) + 0.06 * expected

    @pytest.mark.parametrize("signal", ["code", "tone"])
    def test_without_a_signal_phases_are_uniform(self, device, signal):
        measured = Batch(device, signal).measure(0.0, 10_000, 10)
        for column in (PHASE_X, PHASE_Y):
            assert stats.kstest(measured[:, column], "uniform", args=(-math.pi, 2 * math.pi)).pvalue > SIGNIFICANCE


# offset (m), slope, bandwidth (Hz), array's and water's depth (m), roughness (m), bottom's density, speed of sound and
# absorption (dB a wavelength): surface unresolved, near the horizon, resolved; bottom near and far.
WATERS = [
    (OFFSET, (0.3, -0.2), 2000.0, 0.3, 1e5, 0.012, 1.9, 1.1, 0.8),
    ((170.0, -45.0, -20.0), (0.3, -0.2), 2000.0, 3.0, 1e5, 0.055, 1.9, 1.1, 0.8),
    (OFFSET, (0.3, -0.2), 2000.0, 3.0, 1e5, 0.01, 1.9, 1.1, 0.8),
    (OFFSET, (0.0, 0.0), 2000.0, 3.0, 105.0, 1e3, 1.5, 1.0, 0.2),
    ((170.0, -45.0, -20.0), (0.0, 0.0), 4000.0, 3.0, 30.0, 1e3, 1.7, 1.05, 1.0),
]


class TestReflections:
    @pytest.mark.parametrize("case", WATERS)
    def test_extra_variance(self, device, case):
        """Strong pulses, boundaries spread over four turns of the reflection's phase: closed form and waveform."""
        offset, slope, bandwidth, array_depth, water_depth, *_ = case
        batch, count = Batch(device, bandwidth=bandwidth, chips=40, offset=offset, slope=slope), 8_000
        water = torch.tensor([case[3:]], dtype=torch.float32, device=device).repeat(count, 1)
        surface = water_depth == 1e5
        level = array_depth if surface else array_depth - water_depth
        sine = abs(2 * level - offset[2]) / math.hypot(offset[0], offset[1], 2 * level - offset[2])
        turns = torch.linspace(0, 4, count, device=device) * C / batch.carrier / (2 * sine)
        water[:, 0 if surface else 1] += turns
        disturbed = batch.measure(1e10, count, spread=0.0, water=water)[:, [PHASE_X, PHASE_Y, RANGE_ERROR]]
        clean = batch.measure(1e12, count, spread=0.0)[:, [PHASE_X, PHASE_Y, RANGE_ERROR]]
        error = disturbed - clean
        variance = reflections.multipath_variances(batch.tables, *batch.geometry(count, 0.0), water).double().mean(0)
        assert error.var(0) == pytest.approx(variance.cpu().numpy(), rel=0.12)
        assert (np.abs(error.mean(0)) / error.std(0)).max() < 0.35


def test_a_measurement_depends_on_seed_and_index_only(device):
    batch = Batch(device, gate=4)
    whole = batch.measure(5.0, 300, 2**64 - 1, spread=0.0)
    assert np.array_equal(whole[:100], batch.measure(5.0, 100, 2**64 - 1, spread=0.0))
    for seed in (2**64 - 2, 2**32 - 1):
        assert not np.any(whole[:, PHASE_X] == batch.measure(5.0, 300, seed, spread=0.0)[:, PHASE_X])
