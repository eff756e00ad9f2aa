"""The elevation that linear seas are given along open boundaries, E(t) = Σ a cos(2πt/T + φ)."""

import math
from collections import namedtuple

import numpy as np
import taichi as ti
import torch

from usvauv.kernels import runtime
from usvauv.kernels.functions import func
from usvauv.kernels.shallow_water.discretisation import LANES, Packing, vector
from usvauv.kernels.transcendental import half_sine, narrowed

double_vectors = ti.types.ndarray(dtype=ti.types.vector(LANES, ti.f64), ndim=1)
# Longest time, s, and most intervals for which phases are those of the beginning and what they have gained since.
PERIOD, MOST_INTERVALS = 16.0, 16
# Arguments of a kernel, as `Forcing` describes them.
Waves = namedtuple("Waves", "amplitude frequency phase clock interval")


class Forcing:
    """The waves that the seas of a packed field are given.

    Args:
        amplitude, period, phase: a (m), T (s) and φ (rad), (num_seas, components).
        packing: of the field.
        interval: of the solver, s.
        device: of the arguments.

    Attributes:
        silent: E is 0 at all times.
        intervals: in a period, in which phases are reduced to one turn once.
        waves: arguments of kernels: a (m), 1/T (Hz) and φ/2π, each (blocks × components, LANES), the time that begins
            the present period (s), (1,), the last three in double precision, and the number n of the present interval
            in it, (1,) int32; −1 − n if no table has been made for this period.
    """

    def __init__(
        self,
        amplitude: np.ndarray,
        period: np.ndarray,
        phase: np.ndarray,
        packing: Packing,
        interval: float,
        device: torch.device,
    ) -> None:
        self._amplitude = np.asarray(amplitude, np.float64)
        self._frequency, self._phase = 1 / np.asarray(period, np.float64), np.asarray(phase) / (2 * math.pi)
        self.silent = not self._amplitude.any()
        self.intervals, self._interval = intervals_of_period(interval), interval
        seas = LANES if packing.strips else packing.num_seas
        lanes = np.zeros((3, packing.blocks * LANES, self._amplitude.shape[1]))
        lanes[:, :seas] = self._amplitude, self._frequency, self._phase
        columns = (part.reshape(packing.blocks, LANES, -1).swapaxes(1, 2).reshape(-1, LANES) for part in lanes)
        a, frequency, phases = (torch.tensor(part.copy(), device=device) for part in columns)
        clock = torch.zeros(1, dtype=torch.float64, device=device)
        number = torch.zeros(1, dtype=torch.int32, device=device)
        self.waves = Waves(a.float(), frequency, phases, clock, number)
        self._write = runtime.writer(number)
        self._begun: float | None = None

    def at(self, time: float) -> np.ndarray:
        """E at a time (s), m, (num_seas, 1)."""
        angle = 2 * math.pi * (self._frequency * time + self._phase)
        return (self._amplitude * np.cos(angle)).sum(axis=1)[:, None]

    def go_to(self, start: float, intervals: int) -> None:
        """Go to the interval that begins some intervals after a time (s) at which a period begins."""
        number = intervals % self.intervals
        begin = start + (intervals - number) * self._interval
        self._write(number if begin == self._begun else -1 - number)
        if begin != self._begun:
            self.waves.clock.fill_(begin)
            self._begun = begin


def intervals_of_period(interval: float) -> int:
    """Intervals (s) of a period of phases."""
    return max(1, int(min(PERIOD / interval, MOST_INTERVALS)))


@func
def tabulate(
    waves: ti.template(),
    block: ti.i32,
    blocks: ti.i32,
    first: ti.i32,
    substeps: ti.i32,
    time_step: ti.f64,
    prescribed: ti.template(),
    row: ti.i32,
):
    """Write E of a block at substeps of the present period, the `first` and those after it, from a row of a table on.

    Phases are reduced to one turn in double precision as the period begins: E of waves of 9 s and more is within
    1e-6 Σ a.

    Args:
        waves: `Waves`. time_step: of a substep, s. prescribed: the table, (rows,), m.
    """
    components = waves.amplitude.shape[0] // blocks
    for s in range(substeps):
        prescribed[row + s] = vector(0.0)
    for n in range(block * components, (block + 1) * components):
        turns = waves.frequency[n] * waves.clock[0] + waves.phase[n]
        begin = narrowed(turns - ti.floor(turns + 0.5))
        each = narrowed(waves.frequency[n] * time_step)
        for s in range(substeps):
            later = begin + ti.cast(first + s, ti.f32) * each
            half = half_sine(later - ti.floor(later + 0.5))
            prescribed[row + s] = prescribed[row + s] + waves.amplitude[n] * (1.0 - 2.0 * half * half)
