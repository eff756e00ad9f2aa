"""The shallow-water solver against a Numba loop, PyTorch, scalar Taichi and this machine's streaming bandwidth.

    python -m benchmarks.sea --json [--largest 8192]

All solve the same linear equations on N × N cells over a flat bed in single precision. "bound" is what streaming the
three fields once a step allows: measured triad bandwidth over 24 B a cell and step. Then the nonlinear solver beside
PyClaw, where it is installed, and a Numba loop on a dam break with a known solution (`benchmarks.dam_break`).
"""

import numba
import numpy as np
import taichi as ti
import torch

from benchmarks import dam_break
from benchmarks.machine import best_time, command_line, describe, parse, show
from usvauv.kernels import runtime
from usvauv.kernels.shallow_water.linear import ShallowWater

DEPTH, GRAVITY = 120.0, 9.81
STEPS_PER_LAUNCH = 64
field = ti.types.ndarray(dtype=ti.f32, ndim=2)


@ti.kernel
def scalar_momentum(eta: field, u: field, v: field, c: ti.f32):
    for i, j in ti.ndrange(eta.shape[0], eta.shape[1]):
        if j > 0:
            u[i, j] = u[i, j] - c * (eta[i, j] - eta[i, j - 1])
        if i > 0:
            v[i, j] = v[i, j] - c * (eta[i, j] - eta[i - 1, j])


@ti.kernel
def scalar_continuity(eta: field, u: field, v: field, c: ti.f32):
    for i, j in ti.ndrange(eta.shape[0] - 1, eta.shape[1] - 1):
        eta[i, j] = eta[i, j] - c * (u[i, j + 1] - u[i, j] + v[i + 1, j] - v[i, j])


@numba.njit(parallel=True, fastmath=True)
def numba_step(eta, u, v, c):
    n = eta.shape[0]
    for i in numba.prange(n):
        for j in range(1, n):
            u[i, j] -= c * (eta[i, j] - eta[i, j - 1])
        if i > 0:
            for j in range(n):
                v[i, j] -= c * (eta[i, j] - eta[i - 1, j])
    for i in numba.prange(n - 1):
        for j in range(n - 1):
            eta[i, j] -= c * (u[i, j + 1] - u[i, j] + v[i + 1, j] - v[i, j])


def torch_step(eta: torch.Tensor, u: torch.Tensor, v: torch.Tensor, c: float) -> None:
    u[:, 1:].sub_(eta[:, 1:] - eta[:, :-1], alpha=c)
    v[1:].sub_(eta[1:] - eta[:-1], alpha=c)
    eta[:-1, :-1].sub_(u[:-1, 1:] - u[:-1, :-1] + v[1:, :-1] - v[:-1, :-1], alpha=c)


@numba.njit(parallel=True, fastmath=True)
def numba_triad(a, b, c, s):
    for i in numba.prange(a.shape[0]):
        a[i] = b[i] + s * c[i]


def triad_bandwidth(device: torch.device) -> float:
    """Bytes a second of a = b + s c over arrays far larger than any cache, 12 B an element (STREAM's count)."""
    n = 1 << 26
    if device.type == "cuda":  # torch's, whose arrays these are
        a, b, c = (torch.ones(n, device=device) for _ in range(3))
        return 12 * n / best_time(lambda: torch.add(b, c, alpha=0.5, out=a))
    a, b, c = (np.ones(n, np.float32) for _ in range(3))
    return 12 * n / best_time(lambda: numba_triad(a, b, c, np.float32(0.5)))


def solver_step(n: int, steps: int) -> float:
    """Seconds of one substep of `ShallowWater`, in an interval of `steps` of them."""
    dx = 4.0
    step = 0.9 * dx / np.sqrt(2 * GRAVITY * DEPTH)
    sea = ShallowWater(size=(n * dx, n * dx), cells=(n, n), depth=DEPTH, gravity=GRAVITY, interval=float(step * steps))
    wave = np.cos(np.pi * (np.arange(n) + 0.5) / n)
    sea.set_state(np.multiply.outer(wave, wave)[None].astype(np.float32))
    return best_time(sea.advance) / sea.substeps


def measure(largest: int) -> dict[str, object]:
    """All results, by number of cells on a side."""
    machine = describe()
    device = runtime.start().device
    bandwidth = triad_bandwidth(device)
    bound = bandwidth / 24
    rows = []
    n = 256
    while n <= largest:
        c = np.float32(0.4)
        arrays = [np.random.default_rng(0).random((n, n), np.float32) for _ in range(3)]
        tensors = [torch.from_numpy(a.copy()).to(device) for a in arrays]

        def scalar(tensors=tensors, c=c):
            scalar_momentum(*tensors, c)
            scalar_continuity(*tensors, c)

        # PyTorch gets all cores here; elsewhere the project gives it one.
        torch.set_num_threads(machine["threads"])
        seconds = {
            "PyTorch": best_time(lambda t=tensors, c=c: torch_step(*t, float(c))),
            "scalar Taichi": best_time(scalar),
            "single step": solver_step(n, 1),
            "many steps": solver_step(n, STEPS_PER_LAUNCH),
        }
        torch.set_num_threads(1)
        if machine["arch"] != "cuda":
            seconds["Numba"] = best_time(lambda a=arrays, c=c: numba_step(*a, c))
        rates = {name: n * n / value for name, value in seconds.items()}
        baseline = rates.get("Numba", rates["PyTorch"])
        rows.append(
            {
                "cells": n,
                "steps_per_second": {name: 1 / value for name, value in seconds.items()},
                "cell_steps_per_second": rates,
                "single_over_bound": rates["single step"] / bound,
                "many_over_bound": rates["many steps"] / bound,
                "many_over_numba_or_torch": rates["many steps"] / baseline,
            }
        )
        n *= 2
    pool = ShallowWater(size=(200, 200), cells=(50, 50), depth=DEPTH, interval=1.0, num_seas=512)
    wave = np.cos(np.pi * (np.arange(50) + 0.5) / 50)
    pool.set_state(np.broadcast_to(np.multiply.outer(wave, wave), (512, 50, 50)))
    return {
        "machine": machine,
        "triad_bytes_per_second": bandwidth,
        "bound_cell_steps_per_second": bound,
        "table_1_grid_seconds_per_sea": best_time(pool.advance) / 512,
        "sizes": rows,
        "dam_break": dam_break.measure(),
    }


def main() -> None:
    parser = command_line(__doc__)
    parser.add_argument("--largest", type=int, default=8192, help="cells on a side of the largest grid")
    arguments = parse(parser)
    show(measure(arguments.largest), arguments.json)


if __name__ == "__main__":
    main()
