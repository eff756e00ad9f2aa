"""The sea of a scenario: its forcing and its start, drawn from a seed, and the solver that carries them on.

Both are continuous functions of position and time, evaluated on whatever grid is asked for, so that a coarse and a fine
solver sail on the same sea. Sea s of a seed is drawn from (seed, s) alone, whatever the number of seas.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kernels.shallow_water import ShallowWater
from usvauv_env.scenario import Scenario
from usvauv_env.storm import AirySea, build_storm

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
    scenario: Scenario, seed: int, num_seas: int, cells: tuple[int, int] | None = None, first: int = 0
) -> ShallowWater:
    """Seas `first` to `first` + `num_seas` − 1 of a seed at t = 0; `advance` moves them on by `sea.update_interval`.

    Args:
        scenario: its sections `area` and `sea` are used.
        seed: any non-negative integer.
        num_seas: number of seas.
        cells: (nx, ny); default `coarse_cells`.
        first: index of the first sea.
    """
    area, sea = scenario.area, scenario.sea
    solver = ShallowWater(
        size=(area.width, area.length),
        cells=cells or coarse_cells(scenario),
        depth=area.depth,
        gravity=sea.gravity,
        drag=sea.drag,
        forced_edge=sea.forced_edge,
        num_seas=num_seas,
        interval=sea.update_interval,
    )
    nx, ny = solver.nx, solver.ny
    eta, u, v = np.zeros((num_seas, ny, nx)), np.zeros((num_seas, ny, nx + 1)), np.zeros((num_seas, ny + 1, nx))
    waves = []
    for index in range(num_seas):
        edge_seed, start_seed = np.random.SeedSequence(seed, spawn_key=(first + index,)).spawn(2)
        wave = draw_edge_wave(scenario, np.random.Generator(np.random.Philox(edge_seed)))
        eta[index] = start_elevation(scenario, np.random.Generator(np.random.Philox(start_seed)), nx, ny)
        add_seiche(scenario, wave, eta[index], u[index], v[index])
        waves.append(wave)
    solver.set_forcing(*(np.stack([getattr(w, name) for w in waves]) for name in ("amplitude", "period", "phase")))
    solver.set_state(eta, u, v)
    return solver


def build_short_waves(scenario: Scenario, seed: int, num_seas: int, first: int = 0) -> AirySea:
    """The storm upon the seas of `build_sea`, with velocities at the levels `kernels.layout.Level`."""
    area, sea, storm, cruise = scenario.area, scenario.sea, scenario.storm, scenario.auv.depth
    return build_storm(
        spectrum=storm.spectrum,
        significant_height=storm.significant_height,
        peak_period=storm.peak_period,
        gamma=storm.gamma,
        direction=storm.direction,
        spreading=storm.spreading,
        components=storm.components,
        shortest_wave=storm.shortest_wave,
        depth=area.depth,
        gravity=sea.gravity,
        levels=(0.0, -min(cruise, area.depth)),
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


def add_seiche(scenario: Scenario, wave: EdgeWave, eta: np.ndarray, u: np.ndarray, v: np.ndarray) -> None:
    """Add the steady response of the basin to the edge wave at t = 0 (Eq. 7), so that the forcing sets in smoothly.

    With s the distance from the wall opposite the edge at s = L and Z = a e^{i(ωt + φ)}:
        η = Re Z cos(ks)/cos(kL),   u_s = Re Z g k sin(ks) / ((iω + r) cos(kL)),   g h k² = ω² − i ω r.
    Components with |1/cos kL| above `RESONANT_GAIN` start from rest: their steady state is out of reach without drag.

    Args:
        eta, u, v: (ny, nx), (ny, nx + 1) and (ny + 1, nx) elevation and face velocities, changed in place.
    """
    area, sea = scenario.area, scenario.sea
    if sea.forced_edge == "none":
        return
    west_east = sea.forced_edge in ("west", "east")
    backwards = sea.forced_edge in ("west", "south")
    length = area.width if west_east else area.length
    omega = 2 * math.pi / wave.period
    k = np.sqrt((omega**2 - 1j * omega * sea.drag) / (sea.gravity * area.depth))
    gain = 1 / np.cos(k * length)
    Z = np.where(abs(gain) > RESONANT_GAIN, 0.0, gain) * wave.amplitude * np.exp(1j * wave.phase)

    cells = eta.shape[1 if west_east else 0]
    centres = (np.arange(cells) + 0.5) * (length / cells)
    faces = np.arange(cells + 1) * (length / cells)
    if backwards:
        centres, faces = length - centres, length - faces
    elevation = (Z * np.cos(np.outer(centres, k))).real.sum(axis=1)
    speed = (Z * sea.gravity * k / (1j * omega + sea.drag) * np.sin(np.outer(faces, k))).real.sum(axis=1)
    speed = -speed if backwards else speed
    if west_east:
        eta += elevation
        u += speed
    else:
        eta += elevation[:, None]
        v += speed[:, None]
