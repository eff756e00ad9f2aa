"""USBL fixes from the tones themselves: four sampled hydrophones, phases by least squares, delay by correlation.

The reference that the statistical model of `kernels.positioning.usbl` is held against.

Signal. Hydrophone i at ±d/2 on x or y hears from t_i on sin 2π(νn − t_i), `periods` periods long, in white Gaussian
noise of the standard deviation σ_n of the sonar equation at the true slant range (`kernels.positioning.tone`). The
wavefront is a
sphere about the AUV, exact: r_i − S = (d²/4 − 2 r·p_i)/(r_i + S) has no cancellation. An echo leaves from the array's
centre.

Receiver. The gate opens GATE periods before the tone is expected, and the tone comes within the period that follows: a
search of the whole record has brought the receiver there (`docs/positioning.md` says why that search does not fail
where a fix is accepted). Then
1. the record is reduced to sums of y e^{−2πjνn} over blocks of one period;
2. the window of `periods` blocks with the most energy on the four hydrophones gives a phase each, their mean the delay
   but for whole periods, their differences the arrival on each hydrophone;
3. the envelope, correlated coherently at the delays left over, decides the period;
4. least squares at known frequency over exactly the samples that the tone then covers give the phases of the fix; their
   mean, less the curvature of the wavefront, is the delay. This supposes that the phase of the reflection or of the
   transponder's reply is known.

With SAMPLED the noise of every sample is drawn, some 10,000 numbers a fix; with PROJECTED the sums, some 100.
"""

import taichi as ti
import torch

from kernels import random
from kernels.positioning import usbl
from kernels.positioning.tone import (
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
)
from kernels.positioning.usbl import vec2, vec3, vec4, vec5

GATE = 2
UNITS = 4 * GATE + 3  # blocks of a period that some windows hold and others do not, and one of what all hold
FEWEST_PERIODS = 2 * GATE + 1

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

vec6 = ti.types.vector(6, ti.f32)


@ti.func
def boundary(unit: ti.i32, periods: ti.i32) -> ti.f32:
    """Where a unit begins, in periods: 0 to 2 GATE, what is common to all windows, `periods` to `periods` + 2 GATE."""
    return ti.cast(unit if unit <= 2 * GATE + 1 else unit + periods - 2 * GATE - 2, ti.f32)


@ti.func
def common_turn(turn: vec4) -> vec4:
    """Of arrivals at +x, −x, +y, −y known but for whole turns: mean, differences x and y, residual."""
    x = fraction(turn[1] - turn[0])
    y = fraction(turn[3] - turn[2])
    by_x = turn[0] + 0.5 * x
    residual = fraction(turn[2] + 0.5 * y - by_x)
    return vec4(by_x + 0.5 * residual, x, y, residual)


@ti.func
def arrivals(link: ti.template(), k: ti.i32, body: vec3, S: ti.f32) -> vec4:
    """Arrival at the hydrophones +x, −x, +y, −y less that at the array's centre, in periods."""
    wavelength = TWO_PI * link[k, usbl.RANGE_PER_PHASE] * link[k, usbl.PATHS]
    half = link[k, usbl.KAPPA] * wavelength / (2.0 * TWO_PI)
    later = vec4(0.0)
    for i in ti.static(range(4)):
        beside = body[i // 2] * (half if i % 2 == 0 else -half)
        numerator = half * half - 2.0 * beside
        later[i] = numerator / (ti.sqrt(ti.max(S * S + numerator, 0.0)) + S) / wavelength
    return later


@ti.func
def measure(
    link: ti.template(),
    k: ti.i32,
    body: vec3,
    S: ti.f32,
    address: random.uint4,
    key_low: ti.u32,
    key_high: ti.u32,
    sampled: ti.template(),
) -> vec6:
    """Hear one tone of AUV k at `body` (m, the array's frame, |body| = S) and measure it; columns from PHASE_X on.

    All draws belong to the address: the random words found there are the key and half the counter of all others.
    `sampled` is SAMPLED or PROJECTED.
    """
    periods = ti.cast(link[k, usbl.PERIODS], ti.i32)
    nu = link[k, usbl.PERIODS] / link[k, usbl.SAMPLES]
    half_cosecant = 0.5 / ti.sin(TWO_PI * nu)
    noise = 0.5 * usbl.phase_deviation(link, k, S) * ti.sqrt(link[k, usbl.SAMPLES])
    turns = S / (TWO_PI * link[k, usbl.RANGE_PER_PHASE])
    delay = GATE + turns - ti.floor(turns)
    arrival = delay + arrivals(link, k, body, S)
    first = edges4(0.0)
    last = edges4(0.0)
    for i in ti.static(range(4)):
        begin = edge(arrival[i], nu, half_cosecant)
        end = edge(arrival[i] + periods, nu, half_cosecant)
        for j in ti.static(range(3)):
            first[i, j] = begin[j]
            last[i, j] = end[j]
    record = Record(
        nu=nu,
        half_cosecant=half_cosecant,
        cosine=ti.cos(TWO_PI * fraction(arrival)),
        sine=ti.sin(TWO_PI * fraction(arrival)),
        first=first,
        last=last,
        noise=noise,
        stream=random.philox(address, key_low, key_high),
    )

    # 1. Blocks, each with its real and its imaginary part on every hydrophone.
    sums = ti.Matrix.zero(ti.f32, UNITS, 8)
    edges = ti.Matrix.zero(ti.f32, UNITS + 1, 3)
    begin = edge(0.0, nu, half_cosecant)
    for unit in range(UNITS):
        end = edge(boundary(unit + 1, periods), nu, half_cosecant)
        real = vec4(0.0)
        imaginary = vec4(0.0)
        if ti.static(sampled):
            real, imaginary = sampled_sums(record, vec4(begin[0]), vec4(end[0]))
        else:
            real, imaginary = projected_sums(record, begin, end)
        for i in ti.static(range(4)):
            sums[unit, i] = real[i]
            sums[unit, 4 + i] = imaginary[i]
        for j in ti.static(range(3)):
            edges[unit, j] = begin[j]
            edges[unit + 1, j] = end[j]
        begin = end

    # 2. The window with the most energy.
    c = vec4(0.0)
    s = vec4(0.0)
    for unit in range(2 * GATE + 2):
        for i in ti.static(range(4)):
            c[i] += sums[unit, i]
            s[i] += sums[unit, 4 + i]
    best_c = c
    best_s = s
    for m in range(2 * GATE):
        for i in ti.static(range(4)):
            c[i] += sums[2 * GATE + 2 + m, i] - sums[m, i]
            s[i] += sums[2 * GATE + 2 + m, 4 + i] - sums[m, 4 + i]
        if c.dot(c) + s.dot(s) > best_c.dot(best_c) + best_s.dot(best_s):
            best_c = c
            best_s = s
    turn = -ti.atan2(best_c, -best_s) / TWO_PI
    coarse = common_turn(turn)
    late = coarse[0] - ti.floor(coarse[0])

    # 3. The period: the envelope at delay m + late has the weights 1 − late, 1, …, 1, late on its blocks.
    strength = ti.sqrt(best_c * best_c + best_s * best_s)
    best_c /= strength
    best_s /= strength
    period = 0
    tallest = 0.0
    height = 0.0
    for m in range(2 * GATE):
        for i in ti.static(range(4)):
            # From m to m + 1: the four blocks whose weights change.
            for part in ti.static(range(4)):
                unit = ti.static([0, 1, 2 * GATE + 2, 2 * GATE + 3][part]) + m
                weight = ti.static([-1.0, 0.0, 1.0, 0.0][part]) + ti.static([1.0, -1.0, -1.0, 1.0][part]) * late
                height += weight * (sums[unit, i] * best_c[i] + sums[unit, 4 + i] * best_s[i])
        if height > tallest:
            tallest = height
            period = m + 1

    # 4. Least squares over the tone's samples: whole blocks, the end of the one before, the start of the one after.
    heard_first = edges4(0.0)
    heard_last = edges4(0.0)
    before = ti.Vector.zero(ti.i32, 4)
    for i in ti.static(range(4)):
        heard = ti.min(ti.max(period + late + fraction(turn[i] - coarse[0]), 0.0), 2.0 * GATE + 0.999)
        begin = edge(heard, nu, half_cosecant)
        end = edge(heard + periods, nu, half_cosecant)
        for j in ti.static(range(3)):
            heard_first[i, j] = begin[j]
            heard_last[i, j] = end[j]
        before[i] = ti.cast(heard, ti.i32)
        c[i] = 0.0
        s[i] = 0.0
        for unit in range(before[i] + 1, before[i] + 2 * GATE + 2):
            c[i] += sums[unit, i]
            s[i] += sums[unit, 4 + i]
    if ti.static(sampled):
        after_begin = vec4(0.0)
        before_end = vec4(0.0)
        first_heard = vec4(0.0)
        last_heard = vec4(0.0)
        for i in ti.static(range(4)):
            first_heard[i] = heard_first[i, 0]
            before_end[i] = edges[before[i] + 1, 0]
            after_begin[i] = edges[before[i] + 2 * GATE + 2, 0]
            last_heard[i] = heard_last[i, 0]
        real_before, imaginary_before = sampled_sums(record, first_heard, before_end)
        real_after, imaginary_after = sampled_sums(record, after_begin, last_heard)
        for i in ti.static(range(4)):  # Taichi 1.7.4 loses the second of two sums of whole vectors here
            c[i] += real_before[i] + real_after[i]
            s[i] += imaginary_before[i] + imaginary_after[i]
    else:
        for i in range(4):
            stream = record.stream
            draw = normals(random.uint4(ti.cast(i, ti.u32), ti.u32(3), stream[2], stream[3]), stream)
            for end in ti.static(range(2)):
                unit = before[i] + end * (2 * GATE + 2)
                block_begin = edge_of(edges, unit)
                block_end = edge_of(edges, unit + 1)
                part = sum_of_part(
                    record,
                    i,
                    block_begin,
                    block_end,
                    edge_of(heard_first, i) if end == 0 else block_begin,
                    block_end if end == 0 else edge_of(heard_last, i),
                    vec2(sums[unit, i], sums[unit, 4 + i]),
                    vec2(draw[2 * end], draw[2 * end + 1]),
                )
                c[i] += part[0]
                s[i] += part[1]
    energy = 0.0
    for i in ti.static(range(4)):
        g = gram(edge_of(heard_first, i), edge_of(heard_last, i))
        determinant = g[0] * g[2] - g[1] * g[1]
        cosine = (c[i] * g[2] - s[i] * g[1]) / determinant
        sine = (c[i] * g[1] - s[i] * g[0]) / determinant
        turn[i] = ti.atan2(-cosine, sine) / TWO_PI
        energy += (cosine * cosine + sine * sine) * 0.5 * (heard_last[i, 0] - heard_first[i, 0])
    fine = common_turn(turn)
    late_by = period + late + fraction(fine[0] - coarse[0]) - delay
    wavelength = TWO_PI * link[k, usbl.RANGE_PER_PHASE] * link[k, usbl.PATHS]
    # The mean of four hydrophones on a sphere is later than the centre by d²/8S (1 − (u_x² + u_y²)/2).
    spacing = link[k, usbl.KAPPA] * wavelength / TWO_PI
    across = wavelength * wavelength * (fine[1] * fine[1] + fine[2] * fine[2])
    curvature = (spacing * spacing - 0.5 * across) / (8.0 * S * link[k, usbl.PATHS])
    return vec6(
        TWO_PI * fine[1],
        TWO_PI * fine[2],
        TWO_PI * link[k, usbl.RANGE_PER_PHASE] * late_by - curvature,
        ti.sqrt(energy) / noise,
        TWO_PI * fine[3],
        ti.round(late_by),
    )


@ti.func
def fix(link: ti.template(), k: ti.i32, body: vec3, S: ti.f32, heard: vec6, axes: usbl.mat3) -> vec5:
    """The fix that follows from a measurement of sound that goes straight, as `usbl.fix` returns it."""
    true_phase = link[k, usbl.KAPPA] / S * vec2(body[0], body[1])
    phase = vec2(heard[PHASE_X], heard[PHASE_Y])
    found = usbl.located(link, k, true_phase, phase, heard[AMPLITUDE], axes, 1.0)
    r = S + heard[RANGE_ERROR]
    return vec5(r * found[0], r * found[1], r * found[2], usbl.phase_deviation(link, k, S), found[3])


@ti.kernel
def _fixes(
    link: ti.types.ndarray(dtype=ti.f32, ndim=2),
    auv: ti.types.ndarray(dtype=ti.i32, ndim=1),
    offset: ti.types.ndarray(dtype=ti.f32, ndim=2),
    slope: ti.types.ndarray(dtype=ti.f32, ndim=2),
    attitude_error: ti.f32,
    key_low: ti.u32,
    key_high: ti.u32,
    sampled: ti.template(),
    estimate: ti.types.ndarray(dtype=ti.f32, ndim=2),
    flags: ti.types.ndarray(dtype=ti.i32, ndim=1),
    measurement: ti.types.ndarray(dtype=ti.f32, ndim=2),
):
    for n in range(offset.shape[0]):
        k = auv[n]
        r = vec3(offset[n, 0], offset[n, 1], offset[n, 2])
        S = ti.max(r.norm(), 1e-3)
        angles = usbl.attitude(vec2(slope[n, 0], slope[n, 1]))
        body = usbl.array_axes(angles) @ r
        index = ti.cast(n, ti.u32)
        heard = measure(
            link, k, body, S, random.uint4(index, ti.u32(0), ti.u32(0), ti.u32(0)), key_low, key_high, sampled
        )
        tilt = random.normals(random.uint4(index, ti.u32(1), ti.u32(0), ti.u32(0)), key_low, key_high)
        axes = usbl.array_axes(angles + attitude_error * vec2(tilt[0], tilt[1]))
        found = fix(link, k, body, S, heard, axes)
        for j in ti.static(range(4)):
            estimate[n, j] = found[j]
        flags[n] = ti.cast(found[4], ti.i32)
        for j in ti.static(range(MEASURED)):
            measurement[n, j] = heard[j]


def fixes(
    link: torch.Tensor,
    auv: torch.Tensor,
    offset: torch.Tensor,
    slope: torch.Tensor,
    attitude_error: float,
    seed: int,
    *,
    sampled: bool = False,
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Many fixes at once from their tones; fix n depends on the seed and on n, not on how many are made.

    Args:
        link, auv, offset, slope, attitude_error: as in `usbl.fixes`.
        seed: 0 to 2⁶⁴ − 1.
        sampled: draw the noise of every sample, in place of the sums that follow from it (see above).

    Returns:
        (n, 4) estimated offset (m) and σ (rad); (n,) int32 flags, bits of `usbl`; (n, MEASURED) what was measured.

    Raises:
        ValueError: a tone that is not a whole number, at least FEWEST_PERIODS, of periods long.
    """
    periods = link[:, usbl.PERIODS]
    if bool(((periods < FEWEST_PERIODS) | (periods != periods.round())).any()):
        raise ValueError(f"periods: a waveform needs whole periods, at least {FEWEST_PERIODS}; got {periods.tolist()}")
    count = offset.shape[0]
    estimate = torch.empty((count, 4), dtype=torch.float32, device=offset.device)
    flags = torch.empty(count, dtype=torch.int32, device=offset.device)
    measurement = torch.empty((count, MEASURED), dtype=torch.float32, device=offset.device)
    keys = seed & 0xFFFFFFFF, seed >> 32
    _fixes(link, auv, offset, slope, attitude_error, *keys, bool(sampled), estimate, flags, measurement)
    return estimate, flags, measurement
