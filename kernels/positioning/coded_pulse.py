"""USBL fixes from coded pulses: four hydrophones, a matched filter over a range gate, phases and delay at its peak.

The reference for the statistical model of a coded pulse, and a model of missions: with γ = E/N0 on one hydrophone, E
the pulse's energy, a phase difference has the variance 1/γ and the delay 1/(8γβ²), β = 2πB/√12.

Signal. Hydrophone i receives √γ s(t − t_i) e^{−2πjf t_i} at complex baseband (`usvauv.kernels.positioning.codes`) in
white Gaussian noise. The wavefront is a sphere (`waveform.arrivals`). With `water` the AUV's images are heard too
(`usvauv.kernels.positioning.reflections`). An echo goes out and back; its reflections come back only.

Receiver. The gate is `gate` chips of 1/B long, its middle within half a chip of the arrival.

1. The filter matched to the AUV's code is sampled at COARSE lags a chip; the lag with the largest energy, summed over
   the hydrophones, is the peak. A parabola through it and its neighbours gives the lag to 1/60 chip.
2. A parabola through the outputs at the nearest three of FINE lags a chip gives it to 1/30,000 chip.
3. The outputs at the nearest lag give energy and phases. The delay, less the wavefront's curvature, gives the range.

Noise. Outputs of the filter are Gaussian with the covariance R(τ − τ'), real and imaginary parts independent: a matrix
N with N Nᵀ = R times independent normal numbers. With `sampled` the rows of N are the filter's coefficients, at
SAMPLING samples a chip of the record. By default N is the Karhunen–Loève expansion of the noise in the gate, cut where
an eigenvalue is below EIGENVALUE, which leaves some `gate` + 10 columns.
"""
# pyright: reportIndexIssue=false, reportOptionalCall=false
# (what Taichi's operations return exists only while a kernel is compiled)

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import taichi as ti
import torch

from usvauv.kernels import random
from usvauv.kernels.positioning import acoustic_link, codes, reflections, usbl, waveform
from usvauv.kernels.positioning.codes import FINE
from usvauv.kernels.positioning.tone import TWO_PI, fraction
from usvauv.kernels.positioning.waveform import MEASURED
from usvauv.kernels.types import array1, array2, array3, index1, mat3, vec2, vec3, vec4, vec6

COARSE = 4
STEP = FINE // COARSE
PARABOLAS = 4  # to the peak of noiseless sounds
SAMPLING = 2
EIGENVALUE = 1e-9
SOUNDS = 1 + reflections.REFLECTIONS
BOUNDARIES = len(reflections.Boundaries.members)


class Pulses(NamedTuple):
    """Tables of K pulses.

    Attributes:
        envelope: (K, …) float32, the autocorrelation R at the lags j/FINE chips from 0.
        noise: (K, gate · FINE + 1, columns) float32, rows for the lags of the gate.
        rate: (K,) float32, B/f, chips a period of the carrier.
    """

    envelope: torch.Tensor
    noise: torch.Tensor
    rate: torch.Tensor


def pulses(
    code: np.ndarray, carriers: Sequence[float], bandwidth: float, gate: int, device: torch.device, *, sampled=False
) -> Pulses:
    """Tables of the pulses of codes (K, L), their carriers (Hz) and common bandwidth B (Hz); `gate` in chips, even."""
    chips = code.shape[1]
    record = 2 * chips + 2 * gate + 1
    R = codes.correlation(code, code, record)
    spectrum = np.fft.rfft(code, record)
    lag = np.arange(gate * FINE + 1)
    noise = []
    for k in range(len(code)):
        if sampled:
            s = np.fft.irfft(spectrum[k], record * FINE) * FINE / math.sqrt(SAMPLING * chips)
            sample = np.arange(SAMPLING * record) * (FINE // SAMPLING)
            noise.append(s[(sample - lag[:, None]) % s.size])
        else:
            # R(τ − τ') = Σ_m |S_m|² e^{2πjm(τ − τ')/M}: the real and imaginary parts of e^{…} factorise it.
            turn = lag[:, None] * np.arange(spectrum.shape[1]) / (record * FINE)
            root = np.abs(spectrum[k]) * np.sqrt(np.where(np.arange(spectrum.shape[1]) > 0, 2, 1) / (record * chips))
            factor = np.concatenate([root * np.cos(TWO_PI * turn), root[1:] * np.sin(TWO_PI * turn[:, 1:])], axis=1)
            left, scale, _ = np.linalg.svd(factor, full_matrices=False)
            noise.append((left * scale)[:, scale**2 > EIGENVALUE])
    columns = max(part.shape[1] for part in noise)
    noise = np.stack([np.pad(part, ((0, 0), (0, columns - part.shape[1]))) for part in noise])
    tables = (R[:, : (record // 2) * FINE], noise, bandwidth / np.array(carriers))
    return Pulses(*(torch.from_numpy(np.ascontiguousarray(part, np.float32)).to(device) for part in tables))


@ti.func
def envelope(table: ti.template(), k: ti.i32, lag: ti.f32) -> ti.f32:
    """R of pulse k at a lag in chips, from `Pulses.envelope` by the cubic through four of its values; exact to 1e-6."""
    at = ti.abs(lag) * FINE
    j = ti.cast(at, ti.i32)
    x = at - j
    value = 0.0
    if j + 2 < table.shape[1]:
        weight = vec4(
            -x * (x - 1.0) * (x - 2.0) / 6.0,
            (x + 1.0) * (x - 1.0) * (x - 2.0) / 2.0,
            -(x + 1.0) * x * (x - 2.0) / 2.0,
            (x + 1.0) * x * (x - 1.0) / 6.0,
        )
        for i in ti.static(range(4)):
            value += weight[i] * table[k, ti.abs(j - 1 + i)]
    return value


@ti.func
def draw(normals: ti.template(), n: ti.i32, address: random.uint4, key: random.uint2):
    """Fill row n of `normals`, (…, columns, 8), from the draws that belong to an address."""
    stream = random.philox(address, key)
    for r in range(normals.shape[1]):
        for half in ti.static(range(2)):
            column = random.uint4(ti.cast(r, ti.u32), ti.u32(half), stream[2], stream[3])
            drawn = random.normals(column, random.uint2(stream[0], stream[1]))
            for i in ti.static(range(4)):
                normals[n, r, 4 * half + i] = drawn[i]


@ti.func
def sounds(
    tables: ti.template(),
    link: ti.template(),
    k: ti.i32,
    body: vec3,
    path: ti.f32,
    offset: vec3,
    axes: mat3,
    around: ti.template(),
):
    """What the hydrophones receive of a pulse of AUV k: a row for each sound and hydrophone.

    Args:
        body: where the direct sound comes from, in the frame of the array: `path` (m) times the direction, which is
            longer than 1 where sound is slower at the array than the link supposes.
        offset: from array to AUV, m, and `axes` of the array: of the reflections.
        around: `reflections.Surroundings`.

    Returns:
        (4 · SOUNDS, 3): delay after the direct sound at the array's centre (chips), real and imaginary amplitude over
        the direct sound's.
    """
    heard = ti.Matrix.zero(ti.f32, 4 * SOUNDS, 3)
    later = waveform.arrivals(link, k, body, path)
    rate = tables.rate[k]
    for i in ti.static(range(4)):
        heard[i, 0] = rate * later[i]
        heard[i, 1] = ti.cos(TWO_PI * later[i])
        heard[i, 2] = -ti.sin(TWO_PI * later[i])
    if ti.static(around.reflect):
        for which in range(reflections.REFLECTIONS):
            r = reflections.reflection(which, offset, around, link, k)
            image = waveform.arrivals(link, k, axes @ r.source, r.slant_range)
            for i in ti.static(range(4)):
                periods = r.excess / link[k, acoustic_link.WAVELENGTH] + image[i]
                row = 4 * (which + 1) + i
                heard[row, 0] = rate * periods
                heard[row, 1] = r.amplitude * ti.cos(TWO_PI * fraction(periods))
                heard[row, 2] = -r.amplitude * ti.sin(TWO_PI * fraction(periods))
    return heard


@ti.func
def signal(tables: ti.template(), k: ti.i32, heard: ti.template(), lag: ti.f32):
    """Output of the matched filter on each hydrophone without noise, over √γ: real parts, imaginary parts.

    `heard` from `sounds`; `lag` in chips after the direct sound.
    """
    real = vec4(0.0)
    imaginary = vec4(0.0)
    for row in range(4 * SOUNDS):
        if heard[row, 1] != 0.0 or heard[row, 2] != 0.0:
            R = envelope(tables.envelope, k, lag - heard[row, 0])
            real[row % 4] += heard[row, 1] * R
            imaginary[row % 4] += heard[row, 2] * R
    return real, imaginary


@ti.func
def output(tables: ti.template(), k: ti.i32, heard: ti.template(), level: vec2, normals: ti.template(), n, lag: ti.i32):
    """Output of the matched filter on each hydrophone at a lag of the gate, over √N0: real parts, imaginary parts.

    Args:
        heard: from `sounds`. level: √γ, and the direct sound's arrival in chips after the gate opens.
        normals, n: from `draw`. lag: in FINE lags a chip.
    """
    real, imaginary = signal(tables, k, heard, ti.cast(lag, ti.f32) / FINE - level[1])
    real *= level[0]
    imaginary *= level[0]
    for column in range(normals.shape[1]):
        # Half of the noise's power is in each part.
        weight = 0.7071067811865476 * tables.noise[k, lag, column]
        for i in ti.static(range(4)):
            real[i] += weight * normals[n, column, i]
            imaginary[i] += weight * normals[n, column, 4 + i]
    return real, imaginary


@ti.func
def summit(beside: vec3) -> ti.f32:
    """Where the parabola through values at −1, 0 and 1 is highest, not beyond them."""
    bend = ti.min(beside[0] - 2.0 * beside[1] + beside[2], -1e-9)
    return ti.min(ti.max(0.5 * (beside[0] - beside[2]) / bend, -1.0), 1.0)


@ti.func
def peak(tables: ti.template(), k: ti.i32, heard: ti.template(), level: vec2, normals: ti.template(), n) -> ti.f32:
    """Lag of the largest energy in the gate, in FINE lags a chip."""
    last = tables.noise.shape[1] - 1
    centre = 0
    step = STEP
    highest = -1.0
    for coarse in range(last // STEP + 1):
        real, imaginary = output(tables, k, heard, level, normals, n, coarse * STEP)
        energy = real.dot(real) + imaginary.dot(imaginary)
        if energy > highest:
            highest = energy
            centre = coarse * STEP
    lag = ti.cast(centre, ti.f32)
    for _ in range(2):
        centre = ti.min(ti.max(ti.cast(ti.round(lag), ti.i32), step), last - step)
        beside = vec3(0.0)
        for i in range(3):
            real, imaginary = output(tables, k, heard, level, normals, n, centre + (i - 1) * step)
            beside[i] = real.dot(real) + imaginary.dot(imaginary)
        lag = centre + step * summit(beside)
        step = 1
    return lag


@ti.func
def chip(tables: ti.template(), link: ti.template(), k: ti.i32) -> ti.f32:
    """Slant range that a chip's delay stands for, m."""
    return link[k, acoustic_link.WAVELENGTH] / link[k, acoustic_link.PATHS] / tables.rate[k]


@ti.func
def disturbance(tables: ti.template(), link: ti.template(), k: ti.i32, heard: ti.template()) -> vec4:
    """What reflections do to the direct sound's peak, without noise.

    They add to both phase differences (rad) and to the slant range (m), and are a factor on the amplitude.
    """
    lag = 0.0
    for parabola in range(PARABOLAS):
        step = ti.select(parabola < PARABOLAS - 1, 1.0 / COARSE, 1.0 / FINE)
        beside = vec3(0.0)
        for i in range(3):
            real, imaginary = signal(tables, k, heard, lag + (i - 1) * step)
            beside[i] = real.dot(real) + imaginary.dot(imaginary)
        lag += step * summit(beside)
    real, imaginary = signal(tables, k, heard, lag)
    turns = vec4(0.0)
    for i in ti.static(range(4)):
        along = real[i] * heard[i, 1] + imaginary[i] * heard[i, 2]
        across = imaginary[i] * heard[i, 1] - real[i] * heard[i, 2]
        turns[i] = -ti.atan2(across, along) / TWO_PI
    turn = waveform.common_turn(turns)
    strength = ti.sqrt(0.25 * (real.dot(real) + imaginary.dot(imaginary)))
    return vec4(TWO_PI * turn[1], TWO_PI * turn[2], chip(tables, link, k) * lag, strength)


@ti.func
def measure(
    tables: ti.template(),
    link: ti.template(),
    k: ti.i32,
    S: ti.f32,
    energy: ti.f32,
    heard: ti.template(),
    normals: ti.template(),
    n: ti.i32,
) -> vec6:
    """Receive a pulse of AUV k at the slant range S (m) and measure it; the columns of `waveform`, SLIP in chips.

    Args:
        tables: `Pulses`. link: link table of `usbl`. energy: γ = E/N0 of the direct sound on one hydrophone.
        heard: from `sounds`. normals, n: from `draw`.
    """
    metres = chip(tables, link, k)
    half_gate = 0.5 * (tables.noise.shape[1] - 1) / FINE
    level = vec2(ti.sqrt(energy), half_gate + fraction(S / metres))
    lag = peak(tables, k, heard, level, normals, n)
    real, imaginary = output(tables, k, heard, level, normals, n, ti.cast(ti.round(lag), ti.i32))
    turn = waveform.common_turn(-ti.atan2(imaginary, real) / TWO_PI)
    late_by = lag / FINE - level[1]
    return vec6(
        TWO_PI * turn[1],
        TWO_PI * turn[2],
        metres * late_by - waveform.curvature(link, k, S, turn[1], turn[2]),
        ti.sqrt(2.0 * (real.dot(real) + imaginary.dot(imaginary))),
        TWO_PI * turn[3],
        ti.round(late_by),
    )


@ti.func
def multipath_variance(
    tables: ti.template(), link: ti.template(), k: ti.i32, offset: vec3, axes: mat3, around: ti.template()
) -> vec3:
    """Extra variance of both phase differences (rad²) and of the slant range (m²) by reflections of unknown phase.

    The sum over the reflections (`reflections.extra_variance`), to add to the variance by noise.
    """
    metres = chip(tables, link, k)
    h = 1.0 / FINE
    width = vec2(tables.rate[k], 2.0 * (1.0 - tables.envelope[k, 1]) / (h * h))
    variance = vec3(0.0)
    for which in range(reflections.REFLECTIONS):
        r = reflections.reflection(which, offset, around, link, k)
        excess = r.excess / link[k, acoustic_link.WAVELENGTH] * tables.rate[k]
        rho = r.amplitude * envelope(tables.envelope, k, excess)
        later, earlier = envelope(tables.envelope, k, excess + h), envelope(tables.envelope, k, excess - h)
        slope = r.amplitude * 0.5 * (later - earlier) / h
        towards, image = axes @ offset / offset.norm(), axes @ r.source / r.slant_range
        added = reflections.extra_variance(link[k, acoustic_link.KAPPA], towards, image, rho, slope, width)
        variance += vec3(added[0], added[1], added[2] * metres * metres)
    return variance


@ti.func
def situation(offset: ti.template(), slope: ti.template(), water: ti.template(), n: ti.i32):
    """Row n of offsets (m), slopes and boundaries: offset, axes of the array, boundaries."""
    r = vec3(offset[n, 0], offset[n, 1], offset[n, 2])
    axes = usbl.array_axes(usbl.attitude(vec2(slope[n, 0], slope[n, 1])))
    boundaries = reflections.Boundaries(water[n, 0], water[n, 1], water[n, 2], water[n, 3], water[n, 4], water[n, 5])
    return r, axes, boundaries


@ti.kernel
def _measurements(
    envelopes: array2,
    noise: array3,
    rate: array1,
    link: array2,
    auv: index1,
    offset: array2,
    slope: array2,
    energy: array1,
    water: array2,
    key_low: ti.u32,
    key_high: ti.u32,
    reflecting: ti.template(),
    normals: array3,
    measurement: array2,
):
    for n in range(offset.shape[0]):
        tables = ti.static(Pulses(envelopes, noise, rate))
        r, axes, boundaries = situation(offset, slope, water, n)
        address = random.uint4(ti.cast(n, ti.u32), ti.u32(0), ti.u32(0), ti.u32(0))
        draw(normals, n, address, random.uint2(key_low, key_high))
        around = ti.static(reflections.Surroundings(boundaries if reflecting else None))
        heard = sounds(tables, link, auv[n], axes @ r, r.norm(), r, axes, around)
        measured = measure(tables, link, auv[n], r.norm(), energy[n], heard, normals, n)
        for j in ti.static(range(MEASURED)):
            measurement[n, j] = measured[j]


@ti.kernel
def _multipath_variances(
    envelopes: array2,
    noise: array3,
    rate: array1,
    link: array2,
    auv: index1,
    offset: array2,
    slope: array2,
    water: array2,
    variance: array2,
):
    for n in range(offset.shape[0]):
        tables = ti.static(Pulses(envelopes, noise, rate))
        r, axes, boundaries = situation(offset, slope, water, n)
        around = ti.static(reflections.Surroundings(boundaries))
        added = multipath_variance(tables, link, auv[n], r, axes, around)
        for j in ti.static(range(3)):
            variance[n, j] = added[j]


def measurements(
    tables: Pulses,
    link: torch.Tensor,
    auv: torch.Tensor,
    offset: torch.Tensor,
    slope: torch.Tensor,
    energy: torch.Tensor,
    seed: int,
    *,
    water: torch.Tensor | None = None,
) -> torch.Tensor:
    """Measurements of many pulses; number n depends on the seed and on n only. Needs memory for the noise of all.

    Args:
        link, auv, offset, slope: as in `usbl.flagged_fixes`; the link's levels are not used.
        energy: (n,) float32, γ = E/N0 of the direct sound on one hydrophone, a ratio of energies.
        seed: 0 to 2⁶⁴ − 1.
        water: (n, 6) float32, fields of `reflections.Boundaries`; None: no reflections.

    Returns:
        (n, MEASURED), the columns of `waveform` with SLIP in chips.
    """
    count = offset.shape[0]
    normals = torch.empty((count, tables.noise.shape[2], 8), dtype=torch.float32, device=offset.device)
    measurement = torch.empty((count, MEASURED), dtype=torch.float32, device=offset.device)
    keys = seed & 0xFFFFFFFF, seed >> 32
    boundaries = offset.new_zeros((count, BOUNDARIES)) if water is None else water
    case = link, auv, offset, slope, energy, boundaries
    _measurements(*tables, *case, *keys, water is not None, normals, measurement)
    return measurement


def multipath_variances(
    tables: Pulses,
    link: torch.Tensor,
    auv: torch.Tensor,
    offset: torch.Tensor,
    slope: torch.Tensor,
    water: torch.Tensor,
) -> torch.Tensor:
    """`multipath_variance` of many pulses, (n, 3): phase differences in rad², slant range in m²; see `measurements`."""
    variance = torch.empty((offset.shape[0], 3), dtype=torch.float32, device=offset.device)
    _multipath_variances(*tables, link, auv, offset, slope, water, variance)
    return variance
