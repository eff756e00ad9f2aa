"""The sea of a scenario: its forcing and its start, drawn from a seed, and the solver that carries them on.

Both are continuous functions of position and time, evaluated on whatever grid is asked for, so that a coarse and a fine
solver sail on the same sea. Sea s of a seed is drawn from (seed, s) alone, whatever the number of seas.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kernels.shallow_water.linear import ShallowWater
from kernels.shallow_water.nonlinear import NonlinearShallowWater
from usvauv_env.scenario import Scenario
from usvauv_env.sea.nonlinear_pool import NonlinearSeas
from usvauv_env.sea.storm import AirySea, build_storm
from usvauv_env.site.site import Site

RESONANT_GAIN = 10.0  # |1/cos kL| from which a component starts from rest instead of in its steady state


@dataclass(frozen=True)
class EdgeWave:
    """Elevation Σ a cos(2πt/T + φ) at the forced edge of one sea: amplitude a (m), period T (s), phase φ (rad)."""

    amplitude: np.ndarray
    period: np.ndarray
    phase: np.ndarray


def coarse_cells(scenario: Scenario) -> tuple[int, int]:
    """Cells (nx, ny) of about `sea.cell_size`, for training and evaluating."""
    size = scenario.sea.cell_size
    return max(3, round(scenario.area.width / size)), max(3, round(scenario.area.length / size))


def fine_cells(scenario: Scenario) -> tuple[int, int]:
    """Cells (nx, ny) with `sea.fine_cells` along the longer side, for a sea that is looked at."""
    size = max(scenario.area.width, scenario.area.length) / scenario.sea.fine_cells
    return max(3, round(scenario.area.width / size)), max(3, round(scenario.area.length / size))


def build_sea(
    site: Site, seed: int, num_seas: int, cells: tuple[int, int] | None = None, first: int = 0
) -> ShallowWater | NonlinearSeas:
    """Seas `first` to `first` + `num_seas` − 1 of a seed at t = 0; `advance` moves them on by `sea.update_interval`.

    Args:
        site: its bed, and the sections `area` and `sea` of its scenario, are used.
        seed: any non-negative integer.
        num_seas: number of seas.
        cells: (nx, ny); default `coarse_cells`.
        first: index of the first sea.
    """
    scenario, sea = site.scenario, site.scenario.sea
    cells = cells or coarse_cells(scenario)
    depth = site.still_depth(cells)
    size = scenario.area.width, scenario.area.length
    about = {"size": size, "cells": cells, "interval": sea.update_interval, "gravity": sea.gravity, "drag": sea.drag}
    drawn = [_draw(scenario, seed, first + index, cells, float(depth[depth > 0].mean())) for index in range(num_seas)]
    if sea.equations == "nonlinear":
        solvers = []
        for wave, eta, u, v in drawn:
            solver = NonlinearShallowWater(**about, bed=-depth, boundaries=boundaries(scenario))
            solver.set_forcing(wave.amplitude, wave.period, wave.phase)
            solver.set_state(eta, (u[:, 1:] + u[:, :-1]) / 2, (v[1:] + v[:-1]) / 2)
            solvers.append(solver)
        return NonlinearSeas(solvers)
    about["sponge_width"] = sea.sponge_width if sea.sponge_edges else None
    solver = ShallowWater(**about, depth=np.maximum(depth, 0), boundaries=boundaries(scenario), num_seas=num_seas)
    waves, eta, u, v = zip(*drawn, strict=True)
    solver.set_forcing(*(np.stack([getattr(w, name) for w in waves]) for name in ("amplitude", "period", "phase")))
    solver.set_state(np.stack(eta), np.stack(u), np.stack(v))
    return solver


def boundaries(scenario: Scenario) -> dict[str, str]:
    """Kind of each edge that is not a wall, as the solvers name them."""
    sea = scenario.sea
    kinds = dict.fromkeys(sea.radiating_edges, "radiating") | dict.fromkeys(sea.sponge_edges, "sponge")
    if sea.forced_edge != "none":
        kinds[sea.forced_edge] = "forced" if sea.forcing == "elevation" else "incident"
    return kinds


def _draw(
    scenario: Scenario, seed: int, index: int, cells: tuple[int, int], depth: float
) -> tuple[EdgeWave, np.ndarray, np.ndarray, np.ndarray]:
    """Forcing of one sea, and its start: elevation (ny, nx) and velocities (ny, nx + 1), (ny + 1, nx)."""
    nx, ny = cells
    edge_seed, start_seed = np.random.SeedSequence(seed, spawn_key=(index,)).spawn(2)
    wave = draw_edge_wave(scenario, np.random.Generator(np.random.Philox(edge_seed)))
    eta = start_elevation(scenario, np.random.Generator(np.random.Philox(start_seed)), nx, ny)
    u, v = np.zeros((ny, nx + 1)), np.zeros((ny + 1, nx))
    add_response(scenario, wave, depth, eta, u, v)
    return wave, eta, u, v


def build_short_waves(site: Site, seed: int, num_seas: int, first: int = 0) -> AirySea:
    """The storm upon the seas of `build_sea`, with velocities at the levels `kernels.mission.columns.Level`."""
    scenario, depth = site.scenario, site.mean_depth
    sea, storm, cruise = scenario.sea, scenario.storm, scenario.auv.depth
    return build_storm(
        spectrum=storm.spectrum,
        significant_height=storm.significant_height,
        peak_period=storm.peak_period,
        gamma=storm.gamma,
        direction=storm.direction,
        spreading=storm.spreading,
        components=storm.components,
        shortest_wave=storm.shortest_wave,
        depth=depth,
        gravity=sea.gravity,
        levels=(0.0, -min(cruise, depth)),
        seed=seed,
        num_seas=num_seas,
        first=first,
    )


def draw_edge_wave(scenario: Scenario, random: np.random.Generator) -> EdgeWave:
    """The regular component, then `irregular_components` of equal energy.

    Their frequencies are drawn one in each of equally wide bands between 1/`irregular_period_max` and
    1/`irregular_period_min`, so that no two coincide and the record does not repeat; phases are uniform.
    """
    sea = scenario.sea
    count = sea.irregular_components
    low, high = 1 / sea.irregular_period_max, 1 / sea.irregular_period_min
    frequency = low + (high - low) * (np.arange(count) + random.random(count)) / count
    phase = 2 * math.pi * random.random(count)
    amplitude = np.full(count, sea.irregular_rms * math.sqrt(2 / count))
    return EdgeWave(
        np.concatenate([[sea.regular_amplitude], amplitude]),
        np.concatenate([[sea.regular_period], 1 / frequency]),
        np.concatenate([[0.0], phase]),
    )


def start_elevation(scenario: Scenario, random: np.random.Generator, nx: int, ny: int) -> np.ndarray:
    """Sum of standing waves at their crests, (ny, nx), m, with the rms elevation `start_rms` over the area.

    Along an axis between walls they are cos(nπx/L), n = 0 … `start_modes`; between a wall and the forced edge
    cos((n + ½)πs/L), n below `start_modes`, s the distance from the wall. Each carries an equal share of the variance
    in the mean; the constant is left out.
    """
    sea = scenario.sea
    axes = []
    for cells, edges in ((ny, ("south", "north")), (nx, ("west", "east"))):
        along = (np.arange(cells) + 0.5) / cells
        if sea.forced_edge in edges:
            numbers = np.arange(sea.start_modes) + 0.5
            along = along if sea.forced_edge == edges[1] else 1 - along
        else:
            numbers = np.arange(sea.start_modes + 1.0)
        mean_square = np.where(numbers == 0, 1.0, 0.5)
        axes.append((np.cos(math.pi * along[:, None] * numbers), mean_square))
    (modes_y, square_y), (modes_x, square_x) = axes
    share = random.standard_normal((len(square_y), len(square_x)))
    if sea.forced_edge == "none":
        share[0, 0] = 0.0
    share *= sea.start_rms / math.sqrt((share**2).sum())
    return modes_y @ (share / np.sqrt(np.outer(square_y, square_x))) @ modes_x.T


def add_response(
    scenario: Scenario, wave: EdgeWave, depth: float, eta: np.ndarray, u: np.ndarray, v: np.ndarray
) -> None:
    """Add the steady response of the basin to the edge wave at t = 0, so that the forcing sets in smoothly.

    With s the distance from the opposite edge, the forced one at s = L, and R = 1 for a wall at s = 0, 0 for an open or
    absorbing edge:
        η = Re B (e^{iks} + R e^{−iks}),   u_s = −Re i g k B (e^{iks} − R e^{−iks})/(iω + r),   g h k² = ω² − i ω r,
    B = Z/(e^{ikL} + R e^{−ikL}) where Z = a e^{iφ} is the elevation at the edge (with R = 1 that is Eq. 7), and
    B = Z e^{−ikL} where it is the incoming wave there. Components with |1/cos kL| above `RESONANT_GAIN` start from
    rest: their steady state is out of reach without drag. Over an uneven bed this is the response of the mean depth,
    and only nearly steady.

    Args:
        depth: h, m.
        eta, u, v: (ny, nx), (ny, nx + 1) and (ny + 1, nx) elevation and face velocities, changed in place.
    """
    sea = scenario.sea
    if sea.forced_edge == "none":
        return
    west_east = sea.forced_edge in ("west", "east")
    backwards = sea.forced_edge in ("west", "south")
    length = _fetch(scenario)
    omega = 2 * math.pi / wave.period
    k, R, at_edge = _response(scenario, omega, depth)
    B = np.where(abs(at_edge) * RESONANT_GAIN < 2 * R, 0.0, wave.amplitude * np.exp(1j * wave.phase) / at_edge)

    cells = eta.shape[1 if west_east else 0]
    centres = (np.arange(cells) + 0.5) * (length / cells)
    faces = np.arange(cells + 1) * (length / cells)
    if backwards:
        centres, faces = length - centres, length - faces
    there, back = (np.exp(sign * 1j * np.outer(centres, k)) for sign in (1, -1))
    elevation = (B * (there + R * back)).real.sum(axis=1)
    there, back = (np.exp(sign * 1j * np.outer(faces, k)) for sign in (1, -1))
    speed = -(1j * sea.gravity * k * B / (1j * omega + sea.drag) * (there - R * back)).real.sum(axis=1)
    speed = -speed if backwards else speed
    if west_east:
        eta += elevation
        u += speed
    else:
        eta += elevation[:, None]
        v += speed[:, None]


def fastest(site: Site) -> float:
    """Bound on the speed of the water in long waves, m/s, except in resonance without drag.

    Forced components in their steady state, all in phase, and the start's modes likewise (by Cauchy and Schwarz), each
    mode with the speed √(g/h) of a progressive wave of its elevation.
    """
    scenario, sea, depth = site.scenario, site.scenario.sea, site.mean_depth
    start = 2 * sea.start_rms * (sea.start_modes + 1) * math.sqrt(sea.gravity / depth)
    if sea.forced_edge == "none":
        return start
    band = np.linspace(1 / sea.irregular_period_max, 1 / sea.irregular_period_min, 257)
    gains = []
    for frequency in (np.array([1 / sea.regular_period]), band):
        omega = 2 * math.pi * frequency
        k, R, at_edge = _response(scenario, omega, depth)
        shape = np.exp(1j * np.outer(np.linspace(0, _fetch(scenario), 65), k))
        speed = np.abs(sea.gravity * k / ((1j * omega + sea.drag) * at_edge) * (shape - R / shape)).max()
        gains.append(min(float(speed), RESONANT_GAIN))
    irregular = sea.irregular_rms * math.sqrt(2 * sea.irregular_components)
    return start + sea.regular_amplitude * gains[0] + irregular * gains[1]


def _fetch(scenario: Scenario) -> float:
    """Distance from the forced edge to the opposite one, m."""
    return scenario.area.width if scenario.sea.forced_edge in ("west", "east") else scenario.area.length


def _response(scenario: Scenario, omega: np.ndarray, depth: float) -> tuple[np.ndarray, float, np.ndarray]:
    """Wave number k, reflection R opposite to the forced edge, and Z/B there; see `add_response`."""
    sea = scenario.sea
    opposite = {"west": "east", "east": "west", "south": "north", "north": "south"}[sea.forced_edge]
    R = 0.0 if opposite in (*sea.radiating_edges, *sea.sponge_edges) else 1.0
    k = np.sqrt((omega**2 - 1j * omega * sea.drag) / (sea.gravity * depth))
    arriving = np.exp(1j * k * _fetch(scenario))
    return k, R, arriving if sea.forcing == "incident" else arriving + R / arriving
