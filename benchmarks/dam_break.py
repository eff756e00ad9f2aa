"""The nonlinear solver beside PyClaw and a Numba loop on PDEBench's radial dam break: errors, steps and speed.

`python -m benchmarks.sea` prints it. PyClaw (Mandli et al. 2016, doi 10.7717/peerj-cs.68) is the package `clawpack`:
second-order wave propagation with Roe's solver, the monotonised-central limiter, dimensional splitting, Courant number
0.9, on one thread. The Numba loop is an unsplit MUSCL–Hancock scheme with HLLC fluxes on all threads.
"""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import logging
import math
import tempfile
import time
from collections.abc import Callable

import numba
import numpy as np

from tests.cases.case import relative_L1
from tests.cases.solutions import PDEBench

CASE = PDEBench()
SIZES = (128, 256, 512)
ROUNDS = 3
Run = Callable[[int], tuple[np.ndarray, int, float, float]]  # depth, steps, seconds and CPU seconds of n × n cells


def clocked(work: Callable[[], object]) -> tuple[float, float]:
    """Seconds and CPU seconds of all threads."""
    wall, cpu = time.perf_counter(), time.process_time()
    work()
    return time.perf_counter() - wall, time.process_time() - cpu


def ours(n: int) -> tuple[np.ndarray, int, float, float]:
    solver = CASE.solver(n)
    seconds = clocked(solver.advance)
    return solver.depth(), solver.steps, *seconds


def pyclaw_of(pyclaw, riemann) -> Run:
    def run(n: int) -> tuple[np.ndarray, int, float, float]:
        solver = pyclaw.ClawSolver2D(riemann.shallow_roe_with_efix_2D)
        solver.limiters = pyclaw.limiters.tvd.MC
        solver.dimensional_split = True
        solver.cfl_desired, solver.cfl_max = 0.9, 1.0
        solver.bc_lower = solver.bc_upper = [pyclaw.BC.extrap] * 2
        ends = -CASE.size / 2, CASE.size / 2
        domain = pyclaw.Domain([pyclaw.Dimension(*ends, n, name=name) for name in "xy"])
        state = pyclaw.State(domain, 3)
        state.problem_data["grav"] = CASE.gravity
        state.q[0], state.q[1:] = CASE.start(n), 0.0
        solution = pyclaw.Solution(state, domain)
        solver.dt_initial = 0.1 * CASE.size / n
        solver.setup(solution)
        seconds = clocked(lambda: solver.evolve_to_time(solution, CASE.time))
        return solution.state.q[0], solver.status["numsteps"], *seconds

    return run


@numba.njit
def limited(a, b):
    """Half the monotonised-central slope of two differences."""
    if a * b <= 0:
        return np.float32(0)
    return math.copysign(min(min(abs(a), abs(b)), np.float32(0.25) * abs(a + b)), a)


@numba.njit
def hllc(h_L, u_L, v_L, h_R, u_R, v_R):
    """Fluxes of mass and of momentum across and along a face for g = 1 m/s², all wet."""
    half = np.float32(0.5)
    c_L, c_R = math.sqrt(h_L), math.sqrt(h_R)
    u = half * (u_L + u_R) + c_L - c_R
    c = half * (c_L + c_R) + np.float32(0.25) * (u_L - u_R)
    low, high = min(u_L - c_L, u - c, np.float32(0)), max(u_R + c_R, u + c, np.float32(0))
    q_L, q_R, per_width = h_L * u_L, h_R * u_R, np.float32(1) / (high - low)
    mass = (high * q_L - low * q_R + low * high * (h_R - h_L)) * per_width
    p_L, p_R = q_L * u_L + half * h_L * h_L, q_R * u_R + half * h_R * h_R
    return mass, (high * p_L - low * p_R + low * high * (q_R - q_L)) * per_width, mass * (v_L if mass > 0 else v_R)


@numba.njit(parallel=True, fastmath=True)
def numba_step(state, faces, flux_x, flux_y, r):
    """States (h, u, v) of cells, of their four faces, and fluxes; r is the time step over the cell size."""
    n = len(state)
    for i in numba.prange(n):
        for j in range(n):
            h, u, v = state[i, j, 0], state[i, j, 1], state[i, j, 2]
            w, e, s, t = max(j - 1, 0), min(j + 1, n - 1), max(i - 1, 0), min(i + 1, n - 1)
            hx, hy = limited(h - state[i, w, 0], state[i, e, 0] - h), limited(h - state[s, j, 0], state[t, j, 0] - h)
            ux, uy = limited(u - state[i, w, 1], state[i, e, 1] - u), limited(u - state[s, j, 1], state[t, j, 1] - u)
            vx, vy = limited(v - state[i, w, 2], state[i, e, 2] - v), limited(v - state[s, j, 2], state[t, j, 2] - v)
            p = h - r * (u * hx + h * (ux + vy) + v * hy)
            q = u - r * (u * ux + v * uy + hx)
            k = v - r * (u * vx + v * vy + hy)
            faces[i, j, 0], faces[i, j, 1], faces[i, j, 2] = p - hx, q - ux, k - vx
            faces[i, j, 3], faces[i, j, 4], faces[i, j, 5] = p + hx, q + ux, k + vx
            faces[i, j, 6], faces[i, j, 7], faces[i, j, 8] = p - hy, k - vy, q - uy
            faces[i, j, 9], faces[i, j, 10], faces[i, j, 11] = p + hy, k + vy, q + uy
    for i in numba.prange(1, n):
        for j in range(1, n):
            a, b = faces[i, j - 1], faces[i, j]
            flux_x[i, j, 0], flux_x[i, j, 1], flux_x[i, j, 2] = hllc(a[3], a[4], a[5], b[0], b[1], b[2])
            a = faces[i - 1, j]
            flux_y[i, j, 0], flux_y[i, j, 2], flux_y[i, j, 1] = hllc(a[9], a[10], a[11], b[6], b[7], b[8])
    for i in numba.prange(1, n - 1):
        for j in range(1, n - 1):
            h = state[i, j, 0]
            depth = h - r * (flux_x[i, j + 1, 0] - flux_x[i, j, 0] + flux_y[i + 1, j, 0] - flux_y[i, j, 0])
            for k in range(1, 3):
                change = flux_x[i, j + 1, k] - flux_x[i, j, k] + flux_y[i + 1, j, k] - flux_y[i, j, k]
                state[i, j, k] = (h * state[i, j, k] - r * change) / depth
            state[i, j, 0] = depth


@numba.njit(parallel=True, fastmath=True)
def greatest_speed(state):
    """Greatest |u| + |v| + 2 c."""
    greatest = 0.0
    for i in numba.prange(len(state)):
        for j in range(len(state)):
            speed = abs(state[i, j, 1]) + abs(state[i, j, 2]) + 2 * math.sqrt(state[i, j, 0])
            greatest = max(greatest, speed)
    return greatest


def numba_hllc(n: int) -> tuple[np.ndarray, int, float, float]:
    """Cells at the border stay as they are: no wave arrives there."""
    state = np.zeros((n, n, 3), np.float32)
    state[:, :, 0] = CASE.start(n)
    faces, flux_x, flux_y = np.zeros((n, n, 12), np.float32), *np.zeros((2, n, n, 3), np.float32)
    cell, steps = CASE.size / n, 0

    def run() -> None:
        nonlocal steps
        left = CASE.time
        while left > 1e-9:
            dt = left / math.ceil(left * greatest_speed(state) / (0.9 * cell))
            numba_step(state, faces, flux_x, flux_y, np.float32(dt / cell))
            left, steps = left - dt, steps + 1

    seconds = clocked(run)
    return state[:, :, 0], steps, *seconds


def solvers() -> dict[str, Run]:
    """Those that are installed."""
    found: dict[str, Run] = {"nonlinear sea": ours, "Numba HLLC": numba_hllc}
    if importlib.util.find_spec("clawpack"):
        with contextlib.chdir(tempfile.gettempdir()):  # it opens a log file where it is imported
            names = ("clawpack.pyclaw", "clawpack.riemann")
            found["PyClaw"] = pyclaw_of(*(importlib.import_module(name) for name in names))
        logging.disable(logging.INFO)  # of which it writes a line each second
    return found


def measure() -> list[dict[str, object]]:
    """For each size the solvers in turn, the best of several rounds."""
    rows, found = [], solvers()
    for n in SIZES:
        exact = CASE.exact(n)
        best: dict[str, dict[str, float]] = {}
        for turn in range(ROUNDS + 1):
            for name, run in found.items():
                depth, steps, seconds, cpu_seconds = run(n)
                if turn == 0:  # warms up
                    rms = float(np.linalg.norm(depth - exact) / np.linalg.norm(exact))
                    best[name] = {"L1": float(relative_L1(depth, exact)), "L2": rms, "steps": steps}
                    best[name] |= {"seconds": math.inf, "cpu_seconds": math.inf}
                    continue
                best[name]["seconds"] = min(best[name]["seconds"], seconds)
                best[name]["cpu_seconds"] = min(best[name]["cpu_seconds"], cpu_seconds)
        for result in best.values():
            result["cell_steps_per_cpu_second"] = n * n * result["steps"] / result["cpu_seconds"]
            result["over_nonlinear_sea"] = result["cpu_seconds"] / best["nonlinear sea"]["cpu_seconds"]
        rows.append({"cells": n, "solvers": best})
    return rows
