"""Binary codes of transponder pulses, their correlation functions, and the rates of detection and false alarm.

A pulse is L chips of ±1, one each 1/B, with chips of the flat spectrum of the band B: at complex baseband

    s(t) = Σ_l c_l D(B t − l),   R(τ) = Σ_k A_k D(B τ − k),   A_k = Σ_l c_l c_{l+k}/L,

R is the pulse's autocorrelation. D is sin πx/(M sin πx/M), the sinc function on a record of M chips, M odd; on such a
record correlations are exact sums over its M frequencies. The rms bandwidth of a flat band is B √((1 − 1/M²)/12).

Family. Gold's codes (IEEE Trans. Inf. Theory 13 (1967) 619, doi 10.1109/TIT.1967.1054048) have low correlations where
they repeat without a pause. A single pulse has aperiodic ones (Sarwate and Pursley, Proc. IEEE 68 (1980) 593,
doi 10.1109/PROC.1980.11697). Those of random codes have the mean square 1/(2L) over the 2L lags where pulses overlap,
and random codes exist at every length. `codes` takes, of CANDIDATES random ones, the one with the lowest peak of its
correlations among those whose mean square bandwidth is that of the flat band to FLATNESS.
"""

import math

import numpy as np

FINE = 32  # lags a chip in tables
CANDIDATES = 1024
FLATNESS = 0.003  # of the mean square bandwidth
FEWEST_CHIPS = 16


def mean_square_bandwidth(spectrum: np.ndarray) -> np.ndarray:
    """Mean square frequency of two-sided power spectra (..., M), M odd, over that of a flat band."""
    M = spectrum.shape[-1]
    f = np.fft.fftfreq(M)
    return (f * f * spectrum).sum(-1) / spectrum.sum(-1) / ((1 - 1 / M**2) / 12)


def correlation(one: np.ndarray, other: np.ndarray, record: int) -> np.ndarray:
    """Mean of one(t + τ) other(t) of the pulses of codes (..., L), on a record of M = `record` chips, M odd.

    Returns:
        (..., M · FINE), at the lags τ = j/FINE chips modulo the record.
    """
    spectrum = np.fft.rfft(one, record) * np.fft.rfft(other, record).conj()
    return np.fft.irfft(spectrum, record * FINE) * FINE / one.shape[-1]


def sidelobe(code: np.ndarray, others: list[np.ndarray]) -> np.ndarray:
    """Largest |correlation| of codes (n, L) with themselves, more than a chip off, and with each of the others (L,)."""
    record = 2 * code.shape[-1] + 1
    peak = np.abs(correlation(code, code, record)[:, FINE:-FINE]).max(-1)
    for other in others:
        peak = np.maximum(peak, np.abs(correlation(code, other, record)).max(-1))
    return peak


def codes(count: int, chips: int, seed: int = 0) -> np.ndarray:
    """Codes (count, chips) of ±1, one an AUV; the first ones do not depend on the count.

    Raises:
        ValueError: fewer than FEWEST_CHIPS chips.
    """
    if chips < FEWEST_CHIPS:
        raise ValueError(f"chips: a code has at least {FEWEST_CHIPS}; got {chips}")
    random = np.random.default_rng(seed)
    chosen: list[np.ndarray] = []
    for _ in range(count):
        candidates = random.choice([-1.0, 1.0], (CANDIDATES, chips))
        spectrum = np.abs(np.fft.fft(candidates, 2 * chips + 1)) ** 2
        uneven = np.abs(mean_square_bandwidth(spectrum) - 1)
        even = candidates[uneven <= max(FLATNESS, uneven.min())]
        chosen.append(even[sidelobe(even, chosen).argmin()])
    return np.array(chosen).reshape(count, chips)


def false_alarm(energy: float, gate: float) -> float:
    """Probability that the noise of four hydrophones reaches an energy within a gate of lags.

    The energy is χ² of 8 degrees of freedom at the gate's begin. Its root crosses a level upwards at the rate of its
    density there times β/√2π, β = 2πB/√12 (Rice, Bell Syst. Tech. J. 24 (1945) 46,
    doi 10.1002/j.1538-7305.1945.tb00453.x); crossings so rare are independent.

    Args:
        energy: sum over the hydrophones of |correlator output|², over N0.
        gate: length of the gate in chips, 1/B.
    """
    at_once = math.exp(-energy) * sum(energy**k / math.factorial(k) for k in range(4))
    crossings = gate * math.sqrt(math.pi / 3) * energy**3.5 * math.exp(-energy) / 6
    return 1 - (1 - at_once) * math.exp(-crossings)


def threshold(probability: float, gate: float) -> float:
    """Energy over N0, summed over four hydrophones, that noise in a gate reaches with a probability of at most 0.1."""
    low, high = 4.0, 400.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if false_alarm(middle, gate) > probability else (low, middle)
    return high
