"""Data rate of the nodes' link: laws that give bit/s for a band and an SNR, one of them chosen by name.

A law is a function (band B in Hz, ceiling in bit/s, SNR in the band in dB) → bit/s, callable from kernels (in f32) and
from Python (in double precision). A plugin's law is a `ti.pyfunc` that registers itself in `rate_laws`.

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
from collections.abc import Callable

import taichi as ti

from usvauv.kernels.positioning.sonar import LOG2_OF_10, power_of_10
from usvauv.kernels.registry import Registry

INV_LN2 = 1.4426950408889634
HALF, PUNCTURED, UNCODED = 4.5, 5.5, 9.6  # E_b/N0 of the code at one wrong bit in 10⁵, dB
WAYS = ((1 / 30, HALF), (1 / 14, HALF), (0.5, HALF), (1.0, HALF), (1.5, PUNCTURED), (2.0, UNCODED))
STEPS = tuple((ratio + 10 * math.log10(efficiency), efficiency) for efficiency, ratio in WAYS)  # least SNR, η

RateLaw = Callable[[float, float, float], float]
rate_laws: Registry[RateLaw] = Registry("rate law")


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
