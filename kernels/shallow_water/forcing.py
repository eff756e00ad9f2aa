"""The elevation that a linear sea is given along its open boundaries: E(t) = Σ a cos(2πt/T + φ)."""

import math

import numpy as np
import taichi as ti
import torch

from usvauv.kernels import runtime
from usvauv.kernels.functions import DeviceArray, Launch, kernel
from usvauv.kernels.shallow_water.discretisation import LANES, Packing, vector, vectors
from usvauv.kernels.trigonometry import half_sine

double1 = ti.types.ndarray(dtype=ti.f64, ndim=1)
double_vectors = ti.types.ndarray(dtype=ti.types.vector(LANES, ti.f64), ndim=1)


@kernel
def tabulate(
    amplitude: vectors,
    frequency: double_vectors,
    phase: double_vectors,
    clock: double1,
    time_step: ti.f64,
    blocks: ti.i32,
    prescribed: vectors,
    serial: ti.template(),
):
    """E at each substep of an interval, within 4e-7 Σ a: phases are reduced to one turn in double precision.

    Args:
        amplitude, frequency, phase: a (m), 1/T (Hz) and φ/2π, each (blocks × components,).
        clock: (1,), time of the first substep, s.
        time_step: of a substep, s.
        prescribed: E, (blocks × substeps,), m.
        serial: the calling thread does it all.
    """
    components = amplitude.shape[0] // blocks
    substeps = prescribed.shape[0] // blocks
    ti.loop_config(serialize=serial)
    for task in range(prescribed.shape[0]):
        time = clock[0] + time_step * (task % substeps)
        first = task // substeps * components
        E = vector(0.0)
        for n in range(first, first + components):
            turns = frequency[n] * time + phase[n]
            half = half_sine(ti.cast(turns - ti.floor(turns + 0.5), ti.f32))
            E += amplitude[n] * (1.0 - 2.0 * half * half)
        prescribed[task] = E


class PrescribedElevation:
    """The elevation E that the seas of a packed field are given.

    Args:
        amplitude, period, phase: a (m), T (s) and φ (rad), (num_seas, components).
        packing: of the field.
        time_step: of a substep, s.
        table: E at each substep of an interval, (blocks, substeps, LANES), an argument of a `Launch`.

    Attributes:
        silent: E is 0 at all times.
    """

    def __init__(
        self,
        amplitude: np.ndarray,
        period: np.ndarray,
        phase: np.ndarray,
        packing: Packing,
        time_step: float,
        table: torch.Tensor | DeviceArray,
    ) -> None:
        tensor = table.tensor if isinstance(table, DeviceArray) else table
        self._amplitude = np.asarray(amplitude, np.float64)
        self._frequency, self._phase = 1 / np.asarray(period, np.float64), np.asarray(phase) / (2 * math.pi)
        self.silent = not self._amplitude.any()
        if self.silent:
            return
        self._clock = tensor.new_zeros(1, dtype=torch.float64)
        seas = LANES if packing.strips else packing.num_seas
        lanes = np.zeros((3, packing.blocks * LANES, self._amplitude.shape[1]))
        lanes[:, :seas] = self._amplitude, self._frequency, self._phase
        columns = (
            torch.from_numpy(part.reshape(packing.blocks, LANES, -1).swapaxes(1, 2).reshape(-1, LANES).copy())
            for part in lanes
        )
        a, *turns = (part.to(tensor.device) for part in columns)
        each = table.view(-1, LANES)
        serial = runtime.better_alone(tensor.numel() // LANES)
        self._tabulate = Launch(tabulate, a.float(), *turns, self._clock, time_step, packing.blocks, each, serial)

    def at(self, time: float) -> np.ndarray:
        """E at a time (s), m, (num_seas, 1)."""
        angle = 2 * math.pi * (self._frequency * time + self._phase)
        return (self._amplitude * np.cos(angle)).sum(axis=1)[:, None]

    def tabulate_from(self, time: float) -> None:
        """Write E at each substep of the interval that begins at a time (s) into the table."""
        self._clock.fill_(time)
        self._tabulate()
