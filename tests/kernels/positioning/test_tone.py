"""Sums over the record of a tone, and the receiver's search in them, beside sums over its samples by NumPy."""

import math

import numpy as np
import pytest
import taichi as ti
import torch

from usvauv.kernels import random
from usvauv.kernels.positioning import tone, waveform
from usvauv.kernels.types import array1, array2, vec2, vec4

NU = 15.0 / 2016.0  # periods a sample
PERIODS = 10.0


@ti.kernel
def functions(x: array2, out: array2):
    for n in range(x.shape[0]):
        turned = tone.direction(x[n, 0])
        address = random.uint4(ti.cast(n, ti.u32), ti.u32(5), ti.u32(6), ti.u32(7))
        stream = random.uint4(ti.u32(8), ti.u32(9), ti.u32(10), ti.u32(11))
        fast = tone.normals(address, stream)
        plain = random.normals(address, random.uint2(ti.u32(8), ti.u32(9)))
        out[n, 0] = turned[0]
        out[n, 1] = turned[1]
        out[n, 2] = tone.rayleigh(x[n, 1])
        out[n, 3] = tone.fraction(x[n, 0])
        out[n, 4] = (fast - plain).norm()


def test_functions_without_the_c_library(device, rounding):
    """Cosine and sine of turns of either sign, √(−2 ln u), the turn's fraction, and the same numbers as `random`."""
    turns = np.linspace(-2.0, 2.0, 4001).astype(np.float32)
    u = np.concatenate([np.geomspace(2**-24, 0.5, 2001), 1 - np.geomspace(2**-24, 0.5, 2000)]).astype(np.float32)
    out = torch.empty((4001, 5), device=device)
    functions(torch.tensor(np.stack([turns, u], axis=1), device=device), out)
    out, angle = out.double().cpu().numpy(), 2 * np.pi * turns.astype(float)
    assert np.abs(out[:, :2] - np.stack([np.cos(angle), np.sin(angle)], axis=1)).max() < 4e-7 * rounding
    np.testing.assert_allclose(out[:, 2] ** 2, -2 * np.log(u.astype(float)), rtol=3e-7 * rounding, atol=5e-7)
    assert np.abs(out[:, 3]).max() == 0.5
    assert np.abs((turns - out[:, 3]) % 1).max() < 1e-6
    assert out[:, 4].max() < 2e-3


@ti.kernel
def parts(time: array1, given: array2, arrival: array1, noise: ti.f32, out: array2):
    """Of a block between two times and a part of it: the tone's sums on each hydrophone, the part drawn from the
    block's sum, and the triangle of the covariance of sums of the noise.
    """
    for i in range(4):
        half_cosecant = 0.5 / ti.sin(tone.TWO_PI * NU)
        late = vec4(arrival[0], arrival[1], arrival[2], arrival[3])
        first, last = tone.tone_edges(late, PERIODS, NU, half_cosecant)
        record = tone.Record(
            nu=NU,
            half_cosecant=half_cosecant,
            cosine=ti.cos(tone.TWO_PI * late),
            sine=ti.sin(tone.TWO_PI * late),
            first=first,
            last=last,
            noise=noise,
            stream=random.uint4(0),
        )
        block_begin, block_end = tone.edge(time[0], NU, half_cosecant), tone.edge(time[1], NU, half_cosecant)
        begin, end = tone.edge(time[2], NU, half_cosecant), tone.edge(time[3], NU, half_cosecant)
        total, draw = vec2(given[i, 0], given[i, 1]), vec2(given[i, 2], given[i, 3])
        whole = tone.tone_sum(record, i, block_begin, block_end)
        part = tone.sum_of_part(record, i, block_begin, block_end, begin, end, total, draw)
        L = tone.root(tone.gram(begin, end))
        for j in ti.static(range(2)):
            out[i, j] = whole[j]
            out[i, 2 + j] = part[j]
        for j in ti.static(range(3)):
            out[i, 4 + j] = L[j]


# Of the block and of the part, in periods; the tone is there from 2.1 to 2.7 on, for ten periods.
@pytest.mark.parametrize("times", [(2.0, 3.0, 2.4, 3.0), (11.0, 12.9, 11.0, 12.3), (4.0, 5.0, 4.3, 4.6), (0, 2, 0, 1)])
def test_a_part_of_a_block_is_drawn_from_the_blocks_sum(device, times):
    """Mean P Q⁻¹ e and covariance P − P Q⁻¹ P, of sums of cosines and sines over the samples."""
    arrival, noise = np.array([2.1, 2.7, 2.35, 2.5]), 0.3
    given = np.random.default_rng(4).normal(0, 30, (4, 4))
    out = torch.empty((4, 7), device=device)
    put = [torch.tensor(np.array(part), dtype=torch.float32, device=device) for part in (times, given, arrival)]
    parts(*put, noise, out)

    def samples(begin, end):
        n = np.arange(math.ceil(begin / NU - 1e-6), math.ceil(end / NU - 1e-6))
        return n, np.stack([np.cos(2 * np.pi * NU * n), -np.sin(2 * np.pi * NU * n)])

    for late, numbers, found in zip(arrival, given, out.double().cpu().numpy(), strict=True):
        (n, block), (m, part) = samples(*times[:2]), samples(*times[2:])
        heard = [
            waves @ np.where((at * NU >= late) & (at * NU < late + PERIODS), np.sin(2 * np.pi * (NU * at - late)), 0.0)
            for at, waves in ((n, block), (m, part))
        ]
        P, K = part @ part.T, part @ part.T @ np.linalg.inv(block @ block.T)
        rest = P - K @ P
        mean = heard[1] + K @ (numbers[:2] - heard[0])
        assert found[:2] == pytest.approx(heard[0], abs=2e-3)
        assert found[2:4] == pytest.approx(mean + noise * np.linalg.cholesky(rest) @ numbers[2:], rel=1e-3, abs=2e-2)
        assert found[4:] == pytest.approx(np.linalg.cholesky(P)[[0, 1, 1], [0, 0, 1]], rel=1e-4, abs=1e-3)


@ti.kernel
def search(blocks: array2, late: array1, window: array2, period: array1):
    for n in range(late.shape[0]):
        sums = ti.Matrix.zero(ti.f32, waveform.BLOCKS, 8)
        for block in range(waveform.BLOCKS):
            for i in ti.static(range(8)):
                sums[block, i] = blocks[waveform.BLOCKS * n + block, i]
        real, imaginary = waveform.strongest_window(sums)
        for i in ti.static(range(4)):
            window[n, i] = real[i]
            window[n, 4 + i] = imaginary[i]
        period[n] = waveform.arrival_period(sums, real, imaginary, late[n])


def test_the_strongest_window_and_the_highest_envelope(device):
    """Of noise: the energies of all windows, the envelopes at all whole periods; each is the largest now and then."""
    count, inner = 400, waveform.COMMON
    draw = np.random.default_rng(8)
    sums, late = draw.normal(size=(count, waveform.BLOCKS, 8)), draw.random(count)
    window, period = torch.empty((count, 8), device=device), torch.empty(count, device=device)
    put = [torch.tensor(part, dtype=torch.float32, device=device) for part in (sums.reshape(-1, 8), late)]
    search(*put, window, period)
    begins = range(waveform.LAST_WINDOW + 1)
    windows = np.stack([sums[:, m : m + inner + 1].sum(1) for m in begins])
    strongest = (windows**2).sum(-1).argmax(0)
    best = windows[strongest, np.arange(count)]
    np.testing.assert_allclose(window.cpu(), best, atol=1e-4)
    phase = best / np.tile(np.hypot(best[:, :4], best[:, 4:]), 2)
    along = (sums * phase[:, None]).sum(-1)
    heights = np.stack(
        [
            (1 - late) * along[:, m] + along[:, m + 1 : m + inner + 1].sum(1) + late * along[:, m + inner + 1]
            for m in begins
        ]
    )
    assert period.int().tolist() == heights.argmax(0).tolist()
    for chosen in (strongest, heights.argmax(0)):
        assert set(chosen) == set(begins)
