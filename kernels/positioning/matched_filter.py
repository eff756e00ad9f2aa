"""USBL fixes from sampled pulses: four hydrophones, a matched filter over a range gate, phases and delay at its peak.

The reference for the statistical model of `usvauv.kernels.positioning.usbl`, and a model of missions: with γ = E/N0 on
one hydrophone, E the pulse's energy, a phase difference has the variance 1/γ, and the delay 1/(8γ (2π f_rms)²).

Signal. Hydrophone i receives √γ s(t − t_i) e^{−2πjf t_i} (`usvauv.kernels.positioning.pulse`) in white Gaussian noise.
The wavefront is a sphere about the AUV, computed without cancellation: r_i − S = (d²/4 − 2 r·p_i)/(r_i + S). With
`water` the AUV's images are heard too (`usvauv.kernels.positioning.reflections`). An echo is sent from the array's
centre; its reflections come back only.

Receiver. The gate is `gate` chips of 1/B long, its middle within half a chip of the arrival. Of a code

1. the filter matched to it is sampled at COARSE lags a chip; the lag with the largest energy, summed over the
   hydrophones, is the peak. A parabola through it and its neighbours gives the lag to 1/60 chip;
2. a parabola through the outputs at the nearest three of FINE lags a chip gives it to 1/30,000 chip.

Of a tone the phases at the middle of the gate give the delay modulo one period; of the delays that remain, to PERIODS
periods off, the one with the most energy is taken. This supposes that the phase of the reflection or of the
transponder's reply is known. A search of the whole record is supposed to have brought the receiver there.

The outputs at the nearest lag give energy and phases. The delay, for a tone that of the mean phase, less the
wavefront's curvature, gives the range.
"""
# pyright: reportIndexIssue=false, reportOptionalCall=false
# (what Taichi's operations return exists only while a kernel is compiled)

import taichi as ti
import torch

from usvauv.kernels import random
from usvauv.kernels.functions import func, kernel
from usvauv.kernels.positioning import acoustic_link, reflections
from usvauv.kernels.positioning.pulse import FINE, PERIODS, Pulses, chip, envelope
from usvauv.kernels.positioning.usbl import TWO_PI
from usvauv.kernels.types import array1, array2, array3, index1, mat3, vec2, vec3, vec4, vec6

COARSE = 4
STEP = FINE // COARSE
PARABOLAS = 4  # to the peak of noiseless sounds
SOUNDS = 1 + reflections.REFLECTIONS
BOUNDARIES = len(reflections.Boundaries.members)

# The receiver's results, columns of a measurement.
PHASE_X = 0  # rad
PHASE_Y = 1
RANGE_ERROR = 2  # measured minus true slant range, m
AMPLITUDE = 3  # of the pulse over the noise, all hydrophones together
RESIDUAL = 4  # rad, mean phase by the y pair minus that by the x pair: near ±π where one of them has wrapped
SLIP = 5  # error of the delay in whole chips
MEASURED = 6


@func
def fraction(turns):
    """Turns modulo one, in [−½, ½]."""
    return turns - ti.round(turns)


@func
def turns(real: vec4, imaginary: vec4) -> vec4:
    """Arrivals at the four hydrophones by the phases there, in turns."""
    return vec4([-ti.atan2(imaginary[i], real[i]) / TWO_PI for i in ti.static(range(4))])


@func
def common_turn(turn: vec4) -> vec4:
    """Mean, difference x, difference y and residual of arrivals at +x, −x, +y, −y that are known modulo one turn."""
    x = fraction(turn[1] - turn[0])
    y = fraction(turn[3] - turn[2])
    by_x = turn[0] + 0.5 * x
    residual = fraction(turn[2] + 0.5 * y - by_x)
    return vec4(by_x + 0.5 * residual, x, y, residual)


@func
def arrivals(link: ti.template(), k: ti.i32, body: vec3, S: ti.f32) -> vec4:
    """Arrival at the hydrophones +x, −x, +y, −y less that at the array's centre, in periods."""
    wavelength = link[k, acoustic_link.WAVELENGTH]
    half = link[k, acoustic_link.KAPPA] * wavelength / (2.0 * TWO_PI)
    later = vec4(0.0)
    for i in ti.static(range(4)):
        beside = body[i // 2] * (half if i % 2 == 0 else -half)
        numerator = half * half - 2.0 * beside
        later[i] = numerator / (ti.sqrt(ti.max(S * S + numerator, 0.0)) + S) / wavelength
    return later


@func
def draw(normals: ti.template(), n: ti.i32, address: random.uint4, key: random.uint2):
    """Fill row n of `normals`, (…, columns, 8), from the draws that belong to an address."""
    stream = random.philox(address, key)
    for r in range(normals.shape[1]):
        for half in ti.static(range(2)):
            column = random.uint4(ti.cast(r, ti.u32), ti.u32(half), stream[2], stream[3])
            drawn = random.normals(column, random.uint2(stream[0], stream[1]))
            for i in ti.static(range(4)):
                normals[n, r, 4 * half + i] = drawn[i]


@func
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
    """Signals at the hydrophones of a pulse of AUV k: a row for each sound and hydrophone.

    Args:
        body: where the direct sound comes from, in the frame of the array: `path` (m) times the direction, which is
            longer than 1 where sound is slower at the array than the link supposes.
        offset: from array to AUV, m, and `axes` of the array: of the reflections.
        around: `reflections.Waveguide`.

    Returns:
        (4 · SOUNDS, 3): delay after the direct sound at the array's centre (chips), real and imaginary amplitude over
        the direct sound's.
    """
    heard = ti.Matrix.zero(ti.f32, 4 * SOUNDS, 3)
    later = arrivals(link, k, body, path)
    rate = tables.rate[k]
    for i in ti.static(range(4)):
        heard[i, 0] = rate * later[i]
        heard[i, 1] = ti.cos(TWO_PI * later[i])
        heard[i, 2] = -ti.sin(TWO_PI * later[i])
    if ti.static(around.reflect):
        for which in range(reflections.REFLECTIONS):
            r = reflections.reflection(which, offset, around, link, k)
            image = arrivals(link, k, axes @ r.source, r.slant_range)
            for i in ti.static(range(4)):
                periods = r.excess / link[k, acoustic_link.WAVELENGTH] + image[i]
                row = 4 * (which + 1) + i
                heard[row, 0] = rate * periods
                heard[row, 1] = r.amplitude * ti.cos(TWO_PI * fraction(periods))
                heard[row, 2] = -r.amplitude * ti.sin(TWO_PI * fraction(periods))
    return heard


@func
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


@func
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


@func
def summit(beside: vec3) -> ti.f32:
    """Where the parabola through values at −1, 0 and 1 is highest, not beyond them."""
    bend = ti.min(beside[0] - 2.0 * beside[1] + beside[2], -1e-9)
    return ti.min(ti.max(0.5 * (beside[0] - beside[2]) / bend, -1.0), 1.0)


@func
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


@func
def curvature(link: ti.template(), k: ti.i32, S: ti.f32, x: ti.f32, y: ti.f32) -> ti.f32:
    """How much longer the mean path to four hydrophones is than that to the array's centre, as slant range, m.

    On a sphere of radius S it is d²/8S (1 − (u_x² + u_y²)/2). `x` and `y` are the differences of the arrivals, periods.
    """
    wavelength = link[k, acoustic_link.WAVELENGTH]
    spacing = link[k, acoustic_link.KAPPA] * wavelength / TWO_PI
    across = wavelength * wavelength * (x * x + y * y)
    return (spacing * spacing - 0.5 * across) / (8.0 * S * link[k, acoustic_link.PATHS])


@func
def tone_peak(tables: ti.template(), k: ti.i32, heard: ti.template(), level: vec2, normals: ti.template(), n) -> ti.f32:
    """Lag, in FINE lags a period, of the largest energy among those that the phase of a tone leaves."""
    last = tables.noise.shape[1] - 1
    real, imaginary = output(tables, k, heard, level, normals, n, last // 2)
    late = fraction(common_turn(turns(real, imaginary))[0])
    found = 0.0
    highest = -1.0
    for period in range(-PERIODS, PERIODS + 1):
        lag = FINE * (level[1] + late + period)
        real, imaginary = output(tables, k, heard, level, normals, n, ti.cast(ti.round(lag), ti.i32))
        energy = real.dot(real) + imaginary.dot(imaginary)
        if energy > highest:
            highest = energy
            found = lag
    return found


@func
def disturbance(tables: ti.template(), link: ti.template(), k: ti.i32, heard: ti.template()) -> vec4:
    """Effect of reflections on the direct sound's peak, without noise.

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
    turn = common_turn(turns)
    strength = ti.sqrt(0.25 * (real.dot(real) + imaginary.dot(imaginary)))
    return vec4(TWO_PI * turn[1], TWO_PI * turn[2], chip(tables, link, k) * lag, strength)


@func
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
    """Receive a pulse of AUV k at the slant range S (m) and measure it; columns from PHASE_X on.

    Args:
        tables: `Pulses`. link: `acoustic_link.link_table`. energy: γ = E/N0 of the direct sound on one hydrophone.
        heard: from `sounds`. normals, n: from `draw`.
    """
    metres = chip(tables, link, k)
    half_gate = 0.5 * (tables.noise.shape[1] - 1) / FINE
    level = vec2(ti.sqrt(energy), half_gate + fraction(S / metres))
    lag = 0.0
    if ti.static(tables.tone):
        lag = tone_peak(tables, k, heard, level, normals, n)
    else:
        lag = peak(tables, k, heard, level, normals, n)
    real, imaginary = output(tables, k, heard, level, normals, n, ti.cast(ti.round(lag), ti.i32))
    turn = common_turn(turns(real, imaginary))
    late_by = lag / FINE - level[1]
    if ti.static(tables.tone):
        late_by += fraction(turn[0] - late_by)
    return vec6(
        TWO_PI * turn[1],
        TWO_PI * turn[2],
        metres * late_by - curvature(link, k, S, turn[1], turn[2]),
        ti.sqrt(2.0 * (real.dot(real) + imaginary.dot(imaginary))),
        TWO_PI * turn[3],
        ti.round(late_by),
    )


@kernel
def _measurements(
    envelopes: array2,
    noise: array3,
    rate: array1,
    tone: ti.template(),
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
        tables = ti.static(Pulses(envelopes, noise, rate, tone))
        r, axes, boundaries = reflections.situation(offset, slope, water, n)
        address = random.uint4(ti.cast(n, ti.u32), ti.u32(0), ti.u32(0), ti.u32(0))
        draw(normals, n, address, random.uint2(key_low, key_high))
        around = ti.static(reflections.Waveguide(boundaries if reflecting else None))
        heard = sounds(tables, link, auv[n], axes @ r, r.norm(), r, axes, around)
        measured = measure(tables, link, auv[n], r.norm(), energy[n], heard, normals, n)
        for j in ti.static(range(MEASURED)):
            measurement[n, j] = measured[j]


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
        link, auv, offset, slope: as in `usbl.fixes`; the link's levels are not used.
        energy: (n,) float32, γ = E/N0 of the direct sound on one hydrophone, a ratio of energies.
        seed: 0 to 2⁶⁴ − 1.
        water: (n, 6) float32, fields of `reflections.Boundaries`; None: no reflections.

    Returns:
        (n, MEASURED), columns from PHASE_X on.
    """
    count = offset.shape[0]
    normals = torch.empty((count, tables.noise.shape[2], 8), dtype=torch.float32, device=offset.device)
    measurement = torch.empty((count, MEASURED), dtype=torch.float32, device=offset.device)
    keys = seed & 0xFFFFFFFF, seed >> 32
    boundaries = offset.new_zeros((count, BOUNDARIES)) if water is None else water
    case = link, auv, offset, slope, energy, boundaries
    _measurements(*tables, *case, *keys, water is not None, normals, measurement)
    return measurement
