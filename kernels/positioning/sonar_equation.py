"""Sonar equation: absorption, transmission loss, noise level, signal-to-noise ratio and data rate.

Scalar laws, callable from kernels (in f32) and from Python (in double precision). Levels are in dB re 1 µPa,
frequencies in Hz, also where the source's fit takes kHz. Laws of absorption are in
`usvauv.kernels.positioning.absorption`, laws of noise in `usvauv.kernels.positioning.ambient_noise`.

Source: Shannon, doi 10.1109/JRPROC.1949.232969.
"""

import taichi as ti

from usvauv.kernels.positioning.absorption import thorp

LN10 = 2.302585092994046
LOG2_OF_10 = 3.321928094887362
INV_LN2 = 1.4426950408889634


@ti.pyfunc
def log10(value: ti.f32) -> ti.f32:
    """Decimal logarithm."""
    return ti.log(value) / LN10


@ti.pyfunc
def power_of_10(exponent: ti.f32) -> ti.f32:
    """10 raised to a real exponent."""
    return ti.exp(exponent * LN10)


@ti.pyfunc
def path_loss(r: ti.f32, spreading: ti.f32, alpha: ti.f32) -> ti.f32:
    """TL = k log10 r + α r/1000 over the range r (m), dB; below 1 m as at 1 m.

    `spreading` is k, dB a decade of range: 20 spherical, 10 cylindrical, 15 between them; `alpha` is α, dB/km.
    """
    R = ti.max(r, 1.0)
    return spreading * log10(R) + alpha * R / 1000.0


@ti.pyfunc
def transmission_loss(r: ti.f32, f: ti.f32) -> ti.f32:
    """`path_loss` over the range r (m) at frequency f (Hz) with 15 log10 r and Thorp's absorption, dB."""
    return path_loss(r, 15.0, thorp(f))


@ti.pyfunc
def noise_level(density: ti.f32, bandwidth: ti.f32) -> ti.f32:
    """NL of a noise density (dB re 1 µPa²/Hz) taken as constant over a band of `bandwidth` Hz, dB re 1 µPa."""
    return density + 10.0 * log10(bandwidth)


@ti.pyfunc
def one_way_snr(source_level: ti.f32, noise: ti.f32, r: ti.f32, f: ti.f32) -> ti.f32:
    """SNR = SL − TL − NL of a direct signal, dB; `noise` is NL in the receiver's band."""
    return source_level - transmission_loss(r, f) - noise


@ti.pyfunc
def echo_snr(source_level: ti.f32, target_strength: ti.f32, noise: ti.f32, r: ti.f32, f: ti.f32) -> ti.f32:
    """SNR = SL − 2 TL + TS − NL of an echo, dB; `noise` is NL in the receiver's band."""
    return source_level - 2.0 * transmission_loss(r, f) + target_strength - noise


@ti.pyfunc
def acoustic_source_level(power: ti.f32) -> ti.f32:
    """Source level of an omnidirectional source of `power` W: 10 log10 P + 170.77, dB re 1 µPa at 1 m."""
    return 10.0 * log10(power) + 170.77


@ti.pyfunc
def shannon_rate(bandwidth: ti.f32, snr: ti.f32, demonstration: ti.i32) -> ti.f32:
    """Capacity B log2(1 + 10^(SNR/10)) of a band B (Hz) at an SNR in dB, bit/s.

    With `demonstration` not 0 it is the authors' public code's B log2(1 + 10^SNR), SNR still in dB: about ten times the
    rate, for comparison with the paper's Table 2 only.
    """
    exponent = snr / 10.0
    if demonstration != 0:
        exponent = snr
    # log2(1 + 10^e) without forming 10^e, which overflows single precision at e = 38.
    tail = ti.log(1.0 + power_of_10(-ti.abs(exponent))) * INV_LN2
    return bandwidth * (ti.max(exponent, 0.0) * LOG2_OF_10 + tail)
