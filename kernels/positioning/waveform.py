"""USBL fixes from the tones themselves: four sampled hydrophones, phases by least squares, delay by correlation.

The reference for the statistical model of `usvauv.kernels.positioning.usbl`.

Signal. Hydrophone i at ±d/2 on x or y receives, from t_i on, sin 2π(νn − t_i), `periods` periods long, in white
Gaussian noise of the standard deviation σ_n of the sonar equation at the true slant range
(`usvauv.kernels.positioning.tone`). The wavefront is a sphere about the AUV, computed without cancellation: r_i − S =
(d²/4 − 2 r·p_i)/(r_i + S). An echo is sent from the array's centre.

Receiver. The gate opens GATE periods before the expected arrival, and the tone arrives within the period that follows
the expected arrival. A search of the whole record is supposed to have brought the receiver there;
`docs/positioning.md` says why that search does not fail where a fix is accepted. Then

1. `block_sums` reduces the record to sums of y e^{−2πjνn} over blocks of one period;
2. `strongest_window` finds the `periods` consecutive blocks with the most energy on the four hydrophones. Their phases
   give the arrival on each hydrophone modulo one period;
3. `arrival_period` decides the period by the envelope, correlated coherently at the delays that remain;
4. `tone_sums` and `least_squares` fit a tone of known frequency to exactly the samples that it then covers. Their
   phases are those of the fix; the mean phase, less the curvature of the wavefront, is the delay. This supposes that
   the phase of the reflection or of the transponder's reply is known.

With SAMPLED the noise of every sample is drawn, some 10,000 numbers a fix; with PROJECTED the sums, some 100.
"""
# pyright: reportIndexIssue=false
# (the elements of Taichi's vectors exist only while a kernel is compiled)

from typing import NamedTuple

import taichi as ti
import torch

from usvauv.kernels import random, runtime
from usvauv.kernels.positioning import acoustic_link, usbl
from usvauv.kernels.positioning.tone import (
    TWO_PI,
    Record,
    edge,
    edge_of,
    edges4,
    fraction,
    gram,
    normals,
    projected_sums,
    sampled_sums,
    sum_of_part,
    tone_edges,
)
from usvauv.kernels.types import array2, index1, mat3, vec2, vec3, vec4, vec5, vec6

GATE = 2
LAST_WINDOW = 2 * GATE  # windows begin at the periods 0 to LAST_WINDOW
COMMON = LAST_WINDOW + 1  # index of the block that all windows contain; all other blocks are one period long
BLOCKS = 2 * COMMON + 1
FEWEST_PERIODS = COMMON

SAMPLED = True
PROJECTED = False

# What the receiver measures, columns of a measurement.
PHASE_X = 0  # rad
PHASE_Y = 1
RANGE_ERROR = 2  # measured minus true slant range, m
AMPLITUDE = 3  # of the tone over the noise, all hydrophones together
RESIDUAL = 4  # rad, mean phase by the y pair minus that by the x pair: near ±π where one of them has wrapped
SLIP = 5  # error of the delay in whole periods
MEASURED = 6


class Blocks(NamedTuple):
    """The record reduced to blocks, local matrices of a kernel.

    Attributes:
        sums: (BLOCKS, 8), of each block the real parts on the four hydrophones, then the imaginary parts.
        edges: (BLOCKS + 1, 3), the edges between them, see `usvauv.kernels.positioning.tone`.
    """

    sums: ti.Matrix
    edges: ti.Matrix


@ti.func
def block_start(block: ti.i32, periods: ti.i32) -> ti.f32:
    """Time at which a block begins, in periods. Block COMMON reaches from the period COMMON to `periods`."""
    return ti.cast(block if block <= COMMON else block + periods - COMMON - 1, ti.f32)


@ti.func
def common_turn(turn: vec4) -> vec4:
    """Mean, difference x, difference y and residual of arrivals at +x, −x, +y, −y that are known modulo one turn."""
    x = fraction(turn[1] - turn[0])
    y = fraction(turn[3] - turn[2])
    by_x = turn[0] + 0.5 * x
    residual = fraction(turn[2] + 0.5 * y - by_x)
    return vec4(by_x + 0.5 * residual, x, y, residual)


@ti.func
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


@ti.func
def received_record(link: ti.template(), k: ti.i32, arrival: vec4, sigma: ti.f32, stream: random.uint4) -> Record:
    """Record of a tone of AUV k that begins at `arrival` (periods) on each hydrophone; σ as of `measure`."""
    nu = link[k, acoustic_link.PERIODS] / link[k, acoustic_link.SAMPLES]
    half_cosecant = 0.5 / ti.sin(TWO_PI * nu)
    first, last = tone_edges(arrival, link[k, acoustic_link.PERIODS], nu, half_cosecant)
    return Record(
        nu=nu,
        half_cosecant=half_cosecant,
        cosine=ti.cos(TWO_PI * fraction(arrival)),
        sine=ti.sin(TWO_PI * fraction(arrival)),
        first=first,
        last=last,
        noise=0.5 * sigma * ti.sqrt(link[k, acoustic_link.SAMPLES]),
        stream=stream,
    )


@ti.func
def block_sums(record: ti.template(), periods: ti.i32, sampled: ti.template()):
    """Stage 1: `Blocks.sums` and `Blocks.edges` of a record of a tone of `periods` periods."""
    sums = ti.Matrix.zero(ti.f32, BLOCKS, 8)
    edges = ti.Matrix.zero(ti.f32, BLOCKS + 1, 3)
    begin = edge(0.0, record.nu, record.half_cosecant)
    for block in range(BLOCKS):
        end = edge(block_start(block + 1, periods), record.nu, record.half_cosecant)
        real = vec4(0.0)
        imaginary = vec4(0.0)
        if ti.static(sampled):
            real, imaginary = sampled_sums(record, vec4(begin[0]), vec4(end[0]))
        else:
            real, imaginary = projected_sums(record, begin, end)
        for i in ti.static(range(4)):
            sums[block, i] = real[i]
            sums[block, 4 + i] = imaginary[i]
        for j in ti.static(range(3)):
            edges[block, j] = begin[j]
            edges[block + 1, j] = end[j]
        begin = end
    return sums, edges


@ti.func
def strongest_window(sums: ti.template()):
    """Stage 2: real and imaginary parts of the window with the most energy, on each hydrophone."""
    real = vec4(0.0)
    imaginary = vec4(0.0)
    for block in range(COMMON + 1):
        for i in ti.static(range(4)):
            real[i] += sums[block, i]
            imaginary[i] += sums[block, 4 + i]
    best_real = real
    best_imaginary = imaginary
    for m in range(LAST_WINDOW):
        for i in ti.static(range(4)):
            real[i] += sums[COMMON + 1 + m, i] - sums[m, i]
            imaginary[i] += sums[COMMON + 1 + m, 4 + i] - sums[m, 4 + i]
        energy = real.dot(real) + imaginary.dot(imaginary)
        if energy > best_real.dot(best_real) + best_imaginary.dot(best_imaginary):
            best_real = real
            best_imaginary = imaginary
    return best_real, best_imaginary


@ti.func
def arrival_period(sums: ti.template(), real: vec4, imaginary: vec4, late: ti.f32) -> ti.i32:
    """Stage 3: the whole periods of the arrival, 0 to LAST_WINDOW, where the envelope is highest.

    At the arrival m + late the envelope has the weights 1 − late, 1, …, 1, late on its blocks.

    Args:
        sums: `Blocks.sums`.
        real, imaginary: of the strongest window. late: fraction of a period of the arrival.
    """
    strength = ti.sqrt(real * real + imaginary * imaginary)
    cosine = real / strength
    sine = imaginary / strength
    period = 0
    highest = 0.0
    height = 0.0
    for m in range(LAST_WINDOW):
        for i in ti.static(range(4)):
            # From m to m + 1: the four blocks whose weights change.
            for part in ti.static(range(4)):
                block = ti.static([0, 1, COMMON + 1, COMMON + 2][part]) + m
                weight = ti.static([-1.0, 0.0, 1.0, 0.0][part]) + ti.static([1.0, -1.0, -1.0, 1.0][part]) * late
                height += weight * (sums[block, i] * cosine[i] + sums[block, 4 + i] * sine[i])
        if height > highest:
            highest = height
            period = m + 1
    return period


@ti.func
def tone_sums(record: ti.template(), blocks: ti.template(), arrival: vec4, first, last, sampled: ti.template()):
    """Stage 4: sums over the tone's samples, whole blocks, the end of the block before, the start of the one after.

    Args:
        record, blocks: of the tone. arrival: on each hydrophone, periods. first, last: its edges there, `tone_edges`.
        sampled: SAMPLED or PROJECTED.

    Returns:
        Real and imaginary parts on each hydrophone.
    """
    before = ti.cast(arrival, ti.i32)
    real = vec4(0.0)
    imaginary = vec4(0.0)
    for i in ti.static(range(4)):
        for block in range(before[i] + 1, before[i] + COMMON + 1):
            real[i] += blocks.sums[block, i]
            imaginary[i] += blocks.sums[block, 4 + i]
    if ti.static(sampled):
        after_begin = vec4(0.0)
        before_end = vec4(0.0)
        first_sample = vec4(0.0)
        last_sample = vec4(0.0)
        for i in ti.static(range(4)):
            first_sample[i] = first[i, 0]
            before_end[i] = blocks.edges[before[i] + 1, 0]
            after_begin[i] = blocks.edges[before[i] + COMMON + 1, 0]
            last_sample[i] = last[i, 0]
        real_before, imaginary_before = sampled_sums(record, first_sample, before_end)
        real_after, imaginary_after = sampled_sums(record, after_begin, last_sample)
        for i in ti.static(range(4)):  # Taichi 1.7.4 loses the second of two sums of whole vectors here
            real[i] += real_before[i] + real_after[i]
            imaginary[i] += imaginary_before[i] + imaginary_after[i]
    else:
        for i in range(4):
            stream = record.stream
            draw = normals(random.uint4(ti.cast(i, ti.u32), ti.u32(3), stream[2], stream[3]), stream)
            for end in ti.static(range(2)):
                block = before[i] + end * (COMMON + 1)
                block_begin = edge_of(blocks.edges, block)
                block_end = edge_of(blocks.edges, block + 1)
                part = sum_of_part(
                    record,
                    i,
                    block_begin,
                    block_end,
                    edge_of(first, i) if end == 0 else block_begin,
                    block_end if end == 0 else edge_of(last, i),
                    vec2(blocks.sums[block, i], blocks.sums[block, 4 + i]),
                    vec2(draw[2 * end], draw[2 * end + 1]),
                )
                real[i] += part[0]
                imaginary[i] += part[1]
    return real, imaginary


@ti.func
def least_squares(real: vec4, imaginary: vec4, first: edges4, last: edges4):
    """Stage 4: arrival (modulo one period) of the tone fitted to sums between edges, and the energy of the fit."""
    turn = vec4(0.0)
    energy = 0.0
    for i in ti.static(range(4)):
        g = gram(edge_of(first, i), edge_of(last, i))
        determinant = g[0] * g[2] - g[1] * g[1]
        cosine = (real[i] * g[2] - imaginary[i] * g[1]) / determinant
        sine = (real[i] * g[1] - imaginary[i] * g[0]) / determinant
        turn[i] = ti.atan2(-cosine, sine) / TWO_PI
        energy += (cosine * cosine + sine * sine) * 0.5 * (last[i, 0] - first[i, 0])
    return turn, energy


@ti.func
def curvature(link: ti.template(), k: ti.i32, S: ti.f32, x: ti.f32, y: ti.f32) -> ti.f32:
    """How much longer the mean path to four hydrophones is than that to the array's centre, as slant range, m.

    On a sphere of radius S it is d²/8S (1 − (u_x² + u_y²)/2). `x` and `y` are the differences of the arrivals, periods.
    """
    wavelength = link[k, acoustic_link.WAVELENGTH]
    spacing = link[k, acoustic_link.KAPPA] * wavelength / TWO_PI
    across = wavelength * wavelength * (x * x + y * y)
    return (spacing * spacing - 0.5 * across) / (8.0 * S * link[k, acoustic_link.PATHS])


@ti.func
def measure(
    link: ti.template(),
    k: ti.i32,
    body: vec3,
    S: ti.f32,
    sigma: ti.f32,
    stream: random.uint4,
    sampled: ti.template(),
) -> vec6:
    """Receive one tone of AUV k at `body` (m, the array's frame, |body| = S) and measure it; columns from PHASE_X on.

    Args:
        sigma: standard deviation of a phase difference that belongs to the tone's energy over the noise, rad.
        stream: four random words, of `random.philox`: the key and half the counter of all draws.
        sampled: SAMPLED or PROJECTED.
    """
    periods = ti.cast(link[k, acoustic_link.PERIODS], ti.i32)
    turns = S / (TWO_PI * link[k, acoustic_link.RANGE_PER_PHASE])
    delay = GATE + turns - ti.floor(turns)
    record = received_record(link, k, delay + arrivals(link, k, body, S), sigma, stream)

    sums, edges = block_sums(record, periods, sampled)
    blocks = ti.static(Blocks(sums, edges))
    real, imaginary = strongest_window(sums)
    turn = -ti.atan2(real, -imaginary) / TWO_PI
    coarse = common_turn(turn)
    late = coarse[0] - ti.floor(coarse[0])
    period = arrival_period(sums, real, imaginary, late)

    arrival = ti.min(ti.max(period + late + fraction(turn - coarse[0]), 0.0), LAST_WINDOW + 0.999)
    first, last = tone_edges(arrival, link[k, acoustic_link.PERIODS], record.nu, record.half_cosecant)
    real, imaginary = tone_sums(record, blocks, arrival, first, last, sampled)
    turn, energy = least_squares(real, imaginary, first, last)
    fine = common_turn(turn)
    late_by = period + late + fraction(fine[0] - coarse[0]) - delay
    return vec6(
        TWO_PI * fine[1],
        TWO_PI * fine[2],
        TWO_PI * link[k, acoustic_link.RANGE_PER_PHASE] * late_by - curvature(link, k, S, fine[1], fine[2]),
        ti.sqrt(energy) / record.noise,
        TWO_PI * fine[3],
        ti.round(late_by),
    )


@ti.func
def fix(link: ti.template(), k: ti.i32, body: vec3, S: ti.f32, sigma: ti.f32, measurement: vec6, axes: mat3) -> vec5:
    """The fix from a measurement where rays are straight, as `usbl.fix` returns it; `axes` of the array as measured."""
    true_phase = link[k, acoustic_link.KAPPA] / S * vec2(body[0], body[1])
    phase = vec2(measurement[PHASE_X], measurement[PHASE_Y])
    found = usbl.located(link, k, true_phase, phase, measurement[AMPLITUDE], axes, 1.0)
    r = S + measurement[RANGE_ERROR]
    offset = r * found.vector
    flags = found.flags | usbl.AMBIGUOUS * usbl.odd_turns(measurement[RESIDUAL])
    return vec5(offset[0], offset[1], offset[2], sigma, ti.cast(flags, ti.f32))


@ti.kernel
def _fixes(
    link: array2,
    auv: index1,
    offset: array2,
    slope: array2,
    key_low: ti.u32,
    key_high: ti.u32,
    sampled: ti.template(),
    estimate: array2,
    flags: index1,
    measurement: array2,
):
    for n in range(offset.shape[0]):
        k = auv[n]
        r = vec3(offset[n, 0], offset[n, 1], offset[n, 2])
        S = ti.max(r.norm(), 1e-3)
        angles = usbl.attitude(vec2(slope[n, 0], slope[n, 1]))
        body = usbl.array_axes(angles) @ r
        index = ti.cast(n, ti.u32)
        key = random.uint2(key_low, key_high)
        sigma = acoustic_link.phase_deviation(link, k, S, acoustic_link.further_loss(link, k, r, 0.0))
        stream = random.philox(random.uint4(index, ti.u32(0), ti.u32(0), ti.u32(0)), key)
        measured = measure(link, k, body, S, sigma, stream, sampled)
        tilt = random.normals(random.uint4(index, ti.u32(1), ti.u32(0), ti.u32(0)), key)
        axes = usbl.array_axes(angles + ti.sqrt(link[k, acoustic_link.ATTITUDE]) * vec2(tilt[0], tilt[1]))
        found = fix(link, k, body, S, sigma, measured, axes)
        for j in ti.static(range(4)):
            estimate[n, j] = found[j]
        flags[n] = ti.cast(found[4], ti.i32)
        for j in ti.static(range(MEASURED - 1)):
            measurement[n, j] = measured[j]
        measurement[n, MEASURED - 1] = runtime.or_nan(measured[MEASURED - 1], measurement.shape[1])


def fixes(
    link: torch.Tensor,
    auv: torch.Tensor,
    offset: torch.Tensor,
    slope: torch.Tensor,
    seed: int,
    *,
    sampled: bool = False,
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Many fixes from their tones; fix n depends on the seed and on n only.

    Args:
        link, auv, offset, slope: as in `usbl.fixes`.
        seed: 0 to 2⁶⁴ − 1.
        sampled: draw the noise of every sample instead of the sums.

    Returns:
        (n, 4) estimated offset (m) and σ (rad); (n,) int32 flags, bits of `usbl`; (n, MEASURED) what was measured.

    Raises:
        ValueError: a tone that is shorter than FEWEST_PERIODS or not a whole number of periods long.
    """
    periods = link[:, acoustic_link.PERIODS]
    if bool(((periods < FEWEST_PERIODS) | (periods != periods.round())).any()):
        raise ValueError(f"periods: a waveform needs whole periods, at least {FEWEST_PERIODS}; got {periods.tolist()}")
    count = offset.shape[0]
    estimate = torch.empty((count, 4), dtype=torch.float32, device=offset.device)
    flags = torch.empty(count, dtype=torch.int32, device=offset.device)
    measurement = torch.empty((count, MEASURED), dtype=torch.float32, device=offset.device)
    keys = seed & 0xFFFFFFFF, seed >> 32
    _fixes(link, auv, offset, slope, *keys, bool(sampled), estimate, flags, measurement)
    return estimate, flags, runtime.whole(measurement, "the samples of a tone take")
