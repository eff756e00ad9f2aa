"""Links of the AUVs: energy of a signal over the noise and the deviations that follow from it; rates of the data link.

Sonar equation of an AUV's signal of the length T (s), in dB:

    E/N0 = SL − paths · TL − NL + TS + 10 log10 T,   TL = spreading · log10 S + α S/1000,

NL the noise density (dB re 1 µPa²/Hz), TS and paths = 2 for an echo. With γ = E/N0 as a ratio the phase of one
hydrophone has the variance 1/(2γ) (Cramér–Rao bound at known frequency: Kay, "Estimation Theory" (1993), §3.11), a
difference of two σ² = 1/γ. What counts is energy, SNR · B · T: neither the receiver's band nor its sampling rate.

The delay is measured with the four hydrophones together, of an energy 4γ. That of a tone is read from its carrier, that
of a code of the band B (flat, of the rms bandwidth B/√12) from its envelope:

    σ_τ = 1/(2π f_rms √(2 · 4γ)),   f_rms = f for a tone, B/√12 for a code,

independent of both differences (Kay §3.11). An echo's path is travelled twice, which halves the range error.

The demonstration's law, a convention of `paper-*`, takes the noise power of the receiver's band as that of every
sample, with the amplitude 10^(−SNR/10) of the tone's: σ² = 4/N · 10^(−2 SNR/10) for N = T f_s samples. Sampling faster
is then worth accuracy.

Detection. The receiver sums the energies of the four hydrophones over the noise, R² with the mean 8 + 8γ, and accepts a
signal where R² is at least 8 + 8γ_min. A tone needs γ_min = ½ PERIOD_ENERGY · periods, for the carrier's cycles to be
told apart; a code needs CODE_ENERGY, for its peak to be told from noise, or more where data come with it.

Data rate of the nodes' link. A law is a function (band B in Hz, ceiling in bit/s, SNR in the band in dB) → bit/s,
callable from kernels (in f32) and from Python (in double precision), chosen by name. A plugin's law is a `ti.pyfunc`
that registers itself in `rate_laws`.

The law "modem" has steps. Each is a way of sending that a modem changes to when the SNR allows: binary or quaternary
phase keying, coherent, with the convolutional code of constraint length 7 at rate 1/2 or punctured to 3/4, or without,
and at low SNR each bit spread over L symbols. With the spectral efficiency η (bit/s/Hz; one symbol a second and Hz) and
the E_b/N0 at which one bit in 10⁵ is wrong in white noise, the least SNR is E_b/N0 + 10 log10 η:

    way                    η      E_b/N0   least SNR
    BPSK, rate 1/2, L = 15   1/30   4.5 dB   −10.3 dB
    BPSK, rate 1/2, L = 7    1/14   4.5 dB    −7.0 dB
    BPSK, rate 1/2           1/2    4.5 dB     1.5 dB
    QPSK, rate 1/2           1      4.5 dB     4.5 dB
    QPSK, rate 3/4           3/2    5.5 dB     7.3 dB
    QPSK                     2      9.6 dB    12.6 dB

These are the modulations of modems as sold (the Micro-Modem spreads by 15 and 7) and their efficiencies, 0.03 to 2
bit/s/Hz. Multipath, Doppler and the receiver's own noise are in the ceiling only, which a data sheet gives.

Validity: one path, white noise; with the Doppler and multipath of a long horizontal link the thresholds are too low.

Sources

- Capacity: Shannon, doi 10.1109/JRPROC.1949.232969.
- E_b/N0 of the codes: Heller and Jacobs, IEEE Trans. Commun. Technol. 19 (1971) 835, doi 10.1109/TCOM.1971.1090711
  (rate 1/2, three-bit soft decisions); Yasuda, Kashiki and Hirata, IEEE Trans. Commun. 32 (1984) 315, doi
  10.1109/TCOM.1984.1096047 (punctured). A test computes both from the codes' distance spectra.
- Modems: Freitag et al., "The WHOI Micro-Modem", OCEANS 2005, doi 10.1109/OCEANS.2005.1639901; efficiency: Stojanovic
  and Preisig, IEEE Commun. Mag. 47 (2009) 84, doi 10.1109/MCOM.2009.4752682.
- Light: Farr et al., OCEANS 2010 Sydney, doi 10.1109/OCEANSSYD.2010.5603510.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.limits import MOST_EFFICIENT
from usvauv.kernels.positioning.laws import NoiseLaw, rate_laws
from usvauv.kernels.positioning.sonar import (
    LN10,
    LN_TYPICAL,
    LOG2_OF_10,
    bubble_loss,
    coates,
    exponential,
    logarithm_of_range,
    magnitude,
    path_loss,
    power_of_10,
    thorp,
)
from usvauv.kernels.types import select

# Columns of the link table, one row an AUV.
KAPPA = 0  # 2πf d/c, phase difference per direction cosine, rad
RATIO_AT_1M = 1  # E/N0, or the SNR of the demonstration's law, at 1 m, dB
PATHS = 2  # times the transmission loss counts: 1 transponder, 2 echo
SPREADING = 3  # loss a decade of range, dB
ABSORPTION = 4  # dB/km
NOISE_EXPONENT = 5  # σ² = VARIANCE · 10^(−exponent · ratio/10): 1, or 2 for the demonstration's law
VARIANCE = 6  # of a phase difference at a ratio of 0 dB, rad²
RANGE_PER_PHASE = 7  # c/(2πf_rms), halved for an echo, m/rad
THRESHOLD = 8  # least R²
LEVEL = 9  # the planner's information of one AUV at q = S², 1/m²: ln T = LEVEL − POWER ln(q/S_0²) − DECAY (√q − S_0)
POWER = 10
DECAY = 11
REFERENCE = 12  # S_0, m; near the ranges that occur, or single precision loses digits
ATTITUDE = 13  # variances of the errors other than noise, see `Accuracy`: of measured pitch and roll, rad²
ALIGNMENT = 14  # rad²
HEADING = 15  # rad²
SOUND_SPEED = 16  # relative
POSITION = 17  # m² per axis
OWN_NOISE = 18  # noise power of the boat at top speed over that of the sea
BUBBLES = 19  # loss in the bubbles above the array of a path straight up, dB
UNLOCATED = 20  # ln det of the information on an AUV's position without a fix, 1/m⁴
CERTAIN = 21  # least q T from which on a signal is certainly detected; 0: a planner takes all fixes as good
HORIZON = 22  # length of the phase differences up to which a fix is good, rad
COLUMNS = 23

MOST_BUBBLES = 7.5  # dB one way: the handbook's bound of 15 dB there and back
CERTAINTY = 6.0  # standard deviations beyond a limit from which on a planner takes a fix as good
LARGEST_DEVIATION = 1e3  # rad; nothing is detected long before, and squares of lengths stay within single precision
PERIOD_ENERGY = 25.0  # least energy of one carrier period on one hydrophone over the noise variance, 14 dB
CODE_ENERGY = 8.0  # γ_min of a code, 9 dB; a wrong peak is then the highest once in 10⁴

INV_LN2 = 1.4426950408889634
HALF, PUNCTURED, UNCODED = 4.5, 5.5, 9.6  # E_b/N0 of the code at one wrong bit in 10⁵, dB
WAYS = ((1 / 30, HALF), (1 / 14, HALF), (0.5, HALF), (1.0, HALF), (1.5, PUNCTURED), (MOST_EFFICIENT, UNCODED))
STEPS = tuple((ratio + 10 * math.log10(efficiency), efficiency) for efficiency, ratio in WAYS)  # least SNR, η


def silent(frequency: float) -> float:
    """Level of no noise at any frequency (Hz), dB."""
    return -math.inf


@dataclass(frozen=True)
class Accuracy:
    """Standard deviations of the errors of a fix beside noise. Only the first is independent from fix to fix.

    Attributes:
        attitude: of measured pitch and roll, each, rad.
        alignment: of the array's mounting in pitch and roll, each, rad.
        heading: of the array's heading, mounting included, rad.
        sound_speed: of the speed of sound that fixes are computed with, as a share of it.
        position: of the array in the world, per horizontal axis, m.
    """

    attitude: float = 0.0
    alignment: float = 0.0
    heading: float = 0.0
    sound_speed: float = 0.0
    position: float = 0.0


@dataclass(frozen=True)
class Sonar:
    """Acoustics of the array and the AUVs' transponders or echoes, and what the planner supposes of them.

    Attributes:
        sound_speed: c, m/s.
        source_level: dB re 1 µPa at 1 m.
        target_strength: of an AUV, dB; counts for an echo.
        path: "echo" or "transponder".
        spreading: loss a decade of range, dB.
        absorption: law of the absorption, Hz → dB/km.
        ambient_noise: law of the noise density, see `usvauv.kernels.positioning.sonar`.
        shipping, wind: arguments of that law, 0 to 1 and m/s.
        noise_law: "density" or "demonstration".
        signal: "tone" or "code".
        periods: length of a tone in periods of its carrier.
        pulse_length: of a code, s.
        bandwidth: of a code and of the receiver, Hz.
        sampling_rate: f_s, Hz.
        spacing: d, m.
        own_noise: Hz → noise density of the boat at its array at top speed, dB re 1 µPa²/Hz, −∞ for none; it grows by
            60 dB a decade of speed.
        array_depth: below the surface, m, for the bubbles above it.
        bubbles: whether the wind's bubbles weaken the signal.
        data_ratio: least E/N0 of a code at which the data that come with it can be read, dB.
        planner_noise: "range", the planner's σ grows with range as the real one does, or "constant", it is that of the
            slant range `reference_range` everywhere. The fixes themselves always have the real one.
        reference_range: m, at least 1; a slant range typical for the task, for example the AUVs' depth.
        accuracy: errors other than noise.
        unlocated: standard deviation per axis of an AUV's position without a fix, m, by which planners weigh fixes that
            may fail (`usvauv.kernels.planning.information`); 0: they take all fixes as good, as they do where planner
            noise is constant.

    Raises:
        ValueError: unknown path, noise law, signal or planner noise.
    """

    sound_speed: float = 1500.0
    source_level: float = 162.0
    target_strength: float = 3.0
    path: str = "echo"
    spreading: float = 15.0
    absorption: Callable[[float], float] = thorp
    ambient_noise: NoiseLaw = coates
    shipping: float = 0.5
    wind: float = 0.0
    noise_law: str = "density"
    signal: str = "tone"
    periods: float = 10.0
    pulse_length: float = 0.01
    bandwidth: float = 1000.0
    sampling_rate: float = 2.016e6
    spacing: float = 0.033
    own_noise: Callable[[float], float] = silent
    array_depth: float = 3.0
    bubbles: bool = False
    data_ratio: float = -math.inf
    planner_noise: str = "range"
    reference_range: float = 100.0
    accuracy: Accuracy = Accuracy()
    unlocated: float = 0.0

    def __post_init__(self) -> None:
        for name, allowed in (
            ("path", ("echo", "transponder")),
            ("noise_law", ("density", "demonstration")),
            ("signal", ("tone", "code")),
            ("planner_noise", ("range", "constant")),
        ):
            if getattr(self, name) not in allowed:
                raise ValueError(f"{name}: {getattr(self, name)!r} is not one of {', '.join(allowed)}")

    def length(self, carrier: float) -> float:
        """T, s, of the signal at a carrier frequency, Hz."""
        return self.pulse_length if self.signal == "code" else self.periods / carrier

    def ratio_at_1m(self, carrier: float) -> float:
        """E/N0, or the SNR of the demonstration's law, at 1 m without absorption, dB."""
        level = self.source_level + (self.target_strength if self.path == "echo" else 0.0)
        level -= self.ambient_noise(carrier, self.shipping, self.wind)
        band = 1.0 / self.length(carrier) if self.noise_law == "density" else self.bandwidth
        return level - 10.0 * math.log10(band)


def link_table(carriers: Sequence[float], sonar: Sonar) -> np.ndarray:
    """Constants of every AUV's acoustic link, (K, COLUMNS) float32, for the carrier frequencies f of K AUVs, Hz."""
    s = sonar
    paths = 2 if s.path == "echo" else 1
    exponent = 2 if s.noise_law == "demonstration" else 1
    table = np.zeros((len(carriers), COLUMNS))
    for row, f in zip(table, carriers, strict=True):
        alpha = s.absorption(f)
        row[KAPPA] = 2.0 * math.pi * f * s.spacing / s.sound_speed
        row[RATIO_AT_1M] = s.ratio_at_1m(f)
        row[PATHS] = paths
        row[SPREADING] = s.spreading
        row[ABSORPTION] = alpha
        row[NOISE_EXPONENT] = exponent
        row[VARIANCE] = 1.0 if s.noise_law == "density" else 4.0 / (s.length(f) * s.sampling_rate)
        frequency = s.bandwidth / math.sqrt(12.0) if s.signal == "code" else f
        row[RANGE_PER_PHASE] = s.sound_speed / (2.0 * math.pi * frequency) / paths
        code_energy = max(CODE_ENERGY, 10.0 ** (0.1 * s.data_ratio))
        row[THRESHOLD] = 8.0 + (8.0 * code_energy if s.signal == "code" else 4.0 * PERIOD_ENERGY * s.periods)
        # T = κ²/(σ² q) with σ² = VARIANCE · 10^(−exponent · ratio/10).
        loss = path_loss(s.reference_range, s.spreading, alpha)
        row[LEVEL] = math.log(row[KAPPA] ** 2 / row[VARIANCE] / s.reference_range**2)
        row[LEVEL] += exponent * (row[RATIO_AT_1M] - paths * loss) * LN10 / 10.0
        by_range = exponent * paths if s.planner_noise == "range" else 0
        row[POWER] = 1.0 + 0.05 * s.spreading * by_range
        row[DECAY] = by_range * alpha * LN10 / 1e4
        sea = s.ambient_noise(f, s.shipping, s.wind)
        row[OWN_NOISE] = 10.0 ** ((s.own_noise(f) - sea) / 10.0)
        row[BUBBLES] = bubble_loss(f, s.wind, math.pi / 2, s.array_depth) if s.bubbles else 0.0
        row[REFERENCE] = s.reference_range
        row[ATTITUDE] = s.accuracy.attitude**2
        row[ALIGNMENT] = s.accuracy.alignment**2
        row[HEADING] = s.accuracy.heading**2
        row[SOUND_SPEED] = s.accuracy.sound_speed**2
        row[POSITION] = s.accuracy.position**2
        row[HORIZON] = min(row[KAPPA], math.pi)
        if s.unlocated > 0.0 and s.planner_noise == "range":
            row[UNLOCATED] = -4.0 * math.log(s.unlocated)
            dimmed = 10.0 ** (0.1 * exponent * paths * MOST_BUBBLES) if s.bubbles else 1.0
            row[CERTAIN] = dimmed * row[KAPPA] ** 2 / 8.0 * (math.sqrt(row[THRESHOLD]) + CERTAINTY) ** 2
    return table.astype(np.float32)


@func
def loss_in_bubbles(link: ti.template(), k, slope):
    """Loss in the ratio of a signal of AUV k by bubbles, dB; `slope` is its slant range over its height difference."""
    loss = link[k, BUBBLES] * slope
    return link[k, PATHS] * select(loss < MOST_BUBBLES, loss, MOST_BUBBLES)


@func
def noise_ratio(own_noise, effort):
    """Noise with the boat's own over that of the sea.

    Args:
        own_noise: OWN_NOISE. effort: the boat's speed through the water over its top speed.
    """
    cube = effort * effort * effort
    return 1.0 + own_noise * cube * cube


@func
def phase_deviation(link: ti.template(), k, S, height, noise):
    """Standard deviation σ of a phase difference of AUV k, rad. For numbers, and for vectors of several AUVs.

    Within 1e-5 of itself from 1 m to 20 km; at most LARGEST_DEVIATION, and in the sea's noise at least 1e-10 √VARIANCE.

    Args:
        link: link table, (K, COLUMNS).
        S: slant range, m. height: of the AUV over the array, m, of either sign. noise: `noise_ratio`.
    """
    above = magnitude(height)
    path = select(S > 1.0, S, 1.0)
    decades = (1.0 / LN10) * (logarithm_of_range(path) + LN_TYPICAL)
    along = link[k, PATHS] * (link[k, SPREADING] * decades + 0.001 * link[k, ABSORPTION] * path)
    ratio = link[k, RATIO_AT_1M] - along - loss_in_bubbles(link, k, S / select(above > 1e-3, above, 1e-3))
    exponent = link[k, NOISE_EXPONENT]
    variance = link[k, VARIANCE] * select(exponent > 1.5, noise * noise, noise)
    sigma = ti.sqrt(variance) / exponential(0.05 * LN10 * exponent * ratio)
    return select(sigma < LARGEST_DEVIATION, sigma, LARGEST_DEVIATION)


@func
def range_deviation(link: ti.template(), k, sigma):
    """Standard deviation (m) of the slant range Ŝ where phase differences have the standard deviation σ (rad)."""
    # σ_τ = σ/(2π f_rms √8): a hydrophone's phase has half the variance of a difference, the mean of four a quarter of
    # that.
    return link[k, RANGE_PER_PHASE] * sigma * 0.3535533905932738


@func
def detection_threshold(link: ti.template(), k):
    """Least amplitude R over the noise, all hydrophones together, at which a signal of AUV k counts as detected."""
    return ti.sqrt(link[k, THRESHOLD])


@ti.pyfunc
def capacity(bandwidth: ti.f32, exponent: ti.f32) -> ti.f32:
    """B log2(1 + 10^e), bit/s, without forming 10^e, which overflows single precision at e = 38."""
    tail = ti.log(1.0 + power_of_10(-ti.abs(exponent))) * INV_LN2
    return bandwidth * (ti.max(exponent, 0.0) * LOG2_OF_10 + tail)


@ti.pyfunc
def shannon(bandwidth: ti.f32, ceiling: ti.f32, snr: ti.f32) -> ti.f32:
    """Capacity B log2(1 + 10^(SNR/10)), a bound that no modem reaches; without the ceiling."""
    return capacity(bandwidth, snr / 10.0)


@ti.pyfunc
def demonstration(bandwidth: ti.f32, ceiling: ti.f32, snr: ti.f32) -> ti.f32:
    """The authors' public code's B log2(1 + 10^SNR), SNR still in dB: about ten times the capacity.

    For comparison with the paper's Table 2 only; without the ceiling.
    """
    return capacity(bandwidth, snr)


@ti.pyfunc
def modem(bandwidth: ti.f32, ceiling: ti.f32, snr: ti.f32) -> ti.f32:
    """η B of the best of `STEPS` that the SNR allows, at most the ceiling; 0 below the lowest."""
    efficiency = 0.0
    for step in ti.static(range(len(STEPS))):
        if snr >= STEPS[step][0]:
            efficiency = STEPS[step][1]
    return ti.min(efficiency * bandwidth, ceiling)


@ti.pyfunc
def optical(bandwidth: ti.f32, ceiling: ti.f32, snr: ti.f32) -> ti.f32:
    """The ceiling where what arrives is at least what the receiver needs, here 0 dB, else 0."""
    rate = 0.0
    if snr >= 0.0:
        rate = ceiling
    return rate


rate_laws.register("shannon", shannon)
rate_laws.register("demonstration", demonstration)
rate_laws.register("modem", modem)
rate_laws.register("optical", optical)


def bit_energy(efficiency: float) -> float:
    """Least E_b/N0 (dB) with which the law "modem" sends at an efficiency (bit/s/Hz), at most `MOST_EFFICIENT`."""
    return next(ratio for most, ratio in WAYS if efficiency <= most)


def optical_budget(distance: float, attenuation: float) -> float:
    """Loss of light over a distance r, 20 log10 r + 10 c r log10 e, dB: spherical spreading and Beer–Lambert.

    Args:
        distance: r, m; below 1 m as at 1 m.
        attenuation: beam attenuation c of the water, 1/m.
    """
    return 20.0 * math.log10(max(distance, 1.0)) + attenuation_per_km(attenuation) * distance / 1000.0


def attenuation_per_km(attenuation: float) -> float:
    """Beam attenuation c (1/m) of light as dB/km."""
    return 1e4 * attenuation / math.log(10.0)
