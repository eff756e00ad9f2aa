"""The sea of a scenario: its long waves and the storm upon them, on any grid, for any seeds.

Sea s of a seed depends on (seed, s) alone, whatever the number of seas, and is a continuous function of position and
time: a coarse and a fine solver carry on the same sea.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np

from usvauv.env.scenario import Scenario, ScenarioError
from usvauv.env.sea.long_waves import LongWaves, NonlinearSeas
from usvauv.env.sea.storm import AirySea, build_storm, wave_systems
from usvauv.env.site.site import Site
from usvauv.env.storage.memory import require
from usvauv.kernels import runtime
from usvauv.kernels.shallow_water.boundaries import Boundary, Side
from usvauv.kernels.shallow_water.discretisation import LANES
from usvauv.kernels.shallow_water.linear import COURANT, ShallowWater
from usvauv.kernels.shallow_water.nonlinear import NonlinearBoundary, NonlinearShallowWater

MOST_SUBSTEPS = 1_000_000
RESONANT_GAIN = 10.0  # |1/cos kL| above which a component starts from rest instead of in its steady state


def coarse_cells(scenario: Scenario) -> tuple[int, int]:
    """Cells (nx, ny) of about `sea.cell_size`, for training and evaluating."""
    size = scenario.sea.cell_size
    return round(scenario.area.width / size), round(scenario.area.length / size)


def fine_cells(scenario: Scenario) -> tuple[int, int]:
    """Cells (nx, ny) with `sea.fine_cells` along the longer side, for a sea that is drawn."""
    size = max(scenario.area.width, scenario.area.length) / scenario.sea.fine_cells
    return max(3, round(scenario.area.width / size)), max(3, round(scenario.area.length / size))


def check_seed(seed: object) -> None:
    """Refuse what is not a seed.

    Raises:
        ScenarioError: it is not a whole number from 0 to 2⁶⁴ − 1.
    """
    whole_number("seed", seed, 0, (1 << 64) - 1)


def whole_number(name: str, value: object, least: int, most: int) -> int:
    """A whole number of any type as Python's.

    Raises:
        ScenarioError: it is another thing, or out of range.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not least <= value <= most:
        raise ScenarioError(f"{name} = {value!r}: must be a whole number from {least} to {most}")
    return int(value)


def sea_bytes(scenario: Scenario, cells: tuple[int, int], num_seas: int) -> float:
    """Estimate of the memory that building and solving a sea takes at its peak, bytes."""
    nx, ny = cells
    count, blocks = nx * ny, math.ceil(num_seas / LANES)
    strips = num_seas == 1 and nx >= LANES
    if scenario.sea.equations == "nonlinear":
        return count * (130.0 * num_seas + (12.0 if strips else 12.0 * LANES * blocks))
    packed = 20.0 if strips else 12.0 * LANES * blocks + 8.0 * LANES
    drawn = 48.0 * num_seas  # three fields in double precision, apart and together
    forcing = 24.0 * num_seas * (scenario.sea.irregular_components + 1) + 4.0 * LANES * blocks
    return count * (packed + drawn) + substeps(scenario, cells) * forcing


def substeps(scenario: Scenario, cells: tuple[int, int]) -> float:
    """About the substeps of the linear solver in `sea.update_interval`, over a flat bed at `area.depth`."""
    area, sea = scenario.area, scenario.sea
    rate = math.sqrt(sea.gravity * area.depth) * math.hypot(cells[0] / area.width, cells[1] / area.length)
    return max(1.0, sea.update_interval * rate / COURANT)


def check_sea(scenario: Scenario, cells: tuple[int, int], num_seas: int, further: float = 0.0) -> None:
    """Refuse a sea that does not fit into memory, or that is solved in too many substeps.

    Args:
        scenario: whose sea it is.
        cells: (nx, ny).
        num_seas: number of seas.
        further: bytes that its use takes beside it.

    Raises:
        ScenarioError: too many substeps.
        MemoryNeeded: too much memory.
    """
    steps = substeps(scenario, cells)
    if scenario.sea.equations == "linear" and steps > MOST_SUBSTEPS:
        raise ScenarioError(
            f"sea.update_interval = {scenario.sea.update_interval:g}: takes {steps:.3g} substeps on {cells[0]} ×"
            f" {cells[1]} cells over {scenario.area.depth:g} m; at most {MOST_SUBSTEPS}"
        )
    seas = f"{num_seas} seas of " if num_seas > 1 else ""
    what = f"sea.cell_size, sea.fine_cells or --resolution: {seas}{cells[0]} × {cells[1]} cells"
    require(sea_bytes(scenario, cells, num_seas) + further, what, runtime.start().device)


def build_sea(site: Site, seas: Sequence[tuple[int, int]], cells: tuple[int, int] | None = None) -> LongWaves:
    """Long waves at t = 0, in intervals `sea.update_interval`.

    Args:
        site: of a scenario, whose sections `area`, `water` and `sea` are used.
        seas: seed, any non-negative integer, and index of each sea.
        cells: (nx, ny); default `coarse_cells`.

    Raises:
        ScenarioError, MemoryNeeded: as `check_sea`.
    """
    scenario, sea = site.scenario, site.scenario.sea
    cells = cells or coarse_cells(scenario)
    check_sea(scenario, cells, len(seas))
    depth = site.still_depth(cells)
    size = scenario.area.width, scenario.area.length
    mean_depth = float(depth[depth > 0].mean())
    drawn = [draw_sea(scenario, seed, index, cells, mean_depth) for seed, index in seas]
    if sea.equations == "nonlinear":
        solvers = []
        for wave, eta, u, v in drawn:
            solver = NonlinearShallowWater(
                size=size,
                cells=cells,
                bed=-depth,
                interval=sea.update_interval,
                gravity=sea.gravity,
                drag=sea.drag,
                manning=sea.manning,
                boundaries=cast(dict[Side, NonlinearBoundary], boundaries(scenario)),
            )
            solver.set_forcing(wave.amplitude, wave.period, wave.phase)
            solver.set_state(eta, (u[:, 1:] + u[:, :-1]) / 2, (v[1:] + v[:-1]) / 2)
            solvers.append(solver)
        return NonlinearSeas(solvers)
    solver = ShallowWater(
        size=size,
        cells=cells,
        depth=np.maximum(depth, 0),
        interval=sea.update_interval,
        gravity=sea.gravity,
        drag=sea.drag,
        boundaries=boundaries(scenario),
        sponge_width=sea.sponge_width if sea.sponge_edges else None,
        num_seas=len(seas),
    )
    _, eta, u, v = zip(*drawn, strict=True)
    solver.set_forcing(*stacked_forcing(scenario, seas))
    solver.set_state(np.stack(eta), np.stack(u), np.stack(v))
    return solver


def stacked_forcing(scenario: Scenario, seas: Sequence[tuple[int, int]]) -> BoundaryWave:
    """Waves at the forced edges of the seas of `build_sea`, each array (seas, components)."""
    waves = [boundary_wave(scenario, seed, index) for seed, index in seas]
    return BoundaryWave(*map(np.stack, zip(*waves, strict=True)))


def boundaries(scenario: Scenario) -> dict[Side, Boundary]:
    """Kind of each boundary that is not a wall, as the solvers name them."""
    sea = scenario.sea
    kinds: dict[Side, Boundary] = dict.fromkeys(sea.radiating_edges, "radiating")
    kinds |= dict.fromkeys(sea.sponge_edges, "sponge")
    if sea.forced_edge != "none":
        kinds[sea.forced_edge] = "forced" if sea.forcing == "elevation" else "incident"
    return kinds


def build_short_waves(site: Site, seas: Sequence[tuple[int, int]]) -> AirySea:
    """The storm upon the seas of `build_sea`, with velocities at the levels `usvauv.kernels.types.Level`."""
    scenario, depth = site.scenario, site.mean_depth
    levels = 0.0, -min(scenario.auv.depth, depth)
    return build_storm(
        scenario.storm,
        wave_systems(site),
        depth=depth,
        gravity=scenario.sea.gravity,
        levels=levels,
        seas=seas,
    )


class BoundaryWave(NamedTuple):
    """Elevation Σ a cos(2πt/T + φ) at the forced boundary of one sea: amplitude a (m), period T (s), phase φ (rad)."""

    amplitude: np.ndarray
    period: np.ndarray
    phase: np.ndarray


def draw_sea(
    scenario: Scenario, seed: int, index: int, cells: tuple[int, int], depth: float
) -> tuple[BoundaryWave, np.ndarray, np.ndarray, np.ndarray]:
    """Forcing of one sea, and its start: elevation (ny, nx) and velocities (ny, nx + 1), (ny + 1, nx)."""
    nx, ny = cells
    wave = boundary_wave(scenario, seed, index)
    eta = start_elevation(scenario, _streams(seed, index)[1], nx, ny)
    u, v = np.zeros((ny, nx + 1)), np.zeros((ny + 1, nx))
    add_response(scenario, wave, depth, eta, u, v)
    return wave, eta, u, v


def _streams(seed: int, index: int) -> list[np.random.Generator]:
    """Random numbers of one sea: of its forcing, and of its start."""
    seeds = np.random.SeedSequence(seed, spawn_key=(index,)).spawn(2)
    return [np.random.Generator(np.random.Philox(own)) for own in seeds]


def boundary_wave(scenario: Scenario, seed: int, index: int) -> BoundaryWave:
    """Forcing of one sea."""
    return draw_boundary_wave(scenario, _streams(seed, index)[0])


def draw_boundary_wave(scenario: Scenario, random: np.random.Generator) -> BoundaryWave:
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
    return BoundaryWave(
        np.concatenate([[sea.regular_amplitude], amplitude]),
        np.concatenate([[sea.regular_period], 1 / frequency]),
        np.concatenate([[0.0], phase]),
    )


def start_elevation(scenario: Scenario, random: np.random.Generator, nx: int, ny: int) -> np.ndarray:
    """Sum of standing waves at their crests, (ny, nx), m, with the rms elevation `start_rms` over the area.

    Along an axis between walls they are cos(nπx/L), n = 0 … `start_modes`; between a wall and the forced boundary
    cos((n + ½)πs/L), n below `start_modes`, s the distance from the wall. All carry the same variance in the mean; the
    constant is left out.
    """
    sea = scenario.sea
    axes = []
    for cells, ends in ((ny, ("south", "north")), (nx, ("west", "east"))):
        along = (np.arange(cells) + 0.5) / cells
        if sea.forced_edge in ends:
            numbers = np.arange(sea.start_modes) + 0.5
            along = along if sea.forced_edge == ends[1] else 1 - along
        else:
            numbers = np.arange(sea.start_modes + 1.0)
        mean_square = np.where(numbers == 0, 1.0, 0.5)
        axes.append((np.cos(math.pi * along[:, None] * numbers), mean_square))
    (modes_y, square_y), (modes_x, square_x) = axes
    amplitude = random.standard_normal((len(square_y), len(square_x)))
    if sea.forced_edge == "none":
        amplitude[0, 0] = 0.0
    amplitude *= sea.start_rms / math.sqrt((amplitude**2).sum())
    return modes_y @ (amplitude / np.sqrt(np.outer(square_y, square_x))) @ modes_x.T


def add_response(
    scenario: Scenario, wave: BoundaryWave, depth: float, eta: np.ndarray, u: np.ndarray, v: np.ndarray
) -> None:
    """Add the steady response of the basin to the boundary wave at t = 0, so that the forcing sets in smoothly.

    With s the distance from the opposite boundary, the forced one at s = L, and R = 1 for a wall at s = 0, 0 for a
    boundary that lets waves out:

        η = Re B (e^{iks} + R e^{−iks}),   u_s = −Re i g k B (e^{iks} − R e^{−iks})/(iω + r),   g h k² = ω² − i ω r,

    B = Z/(e^{ikL} + R e^{−ikL}) where Z = a e^{iφ} is the elevation at the boundary (with R = 1 that is Eq. 7), and
    B = Z e^{−ikL} where it is the incoming wave there. Components with |1/cos kL| above `RESONANT_GAIN` start from
    rest: without drag they never reach the steady state. Over an uneven bed this is the response of the mean depth, and
    only nearly steady.

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
    k, R, at_boundary = _response(scenario, omega, depth)
    B = np.where(abs(at_boundary) * RESONANT_GAIN < 2 * R, 0.0, wave.amplitude * np.exp(1j * wave.phase) / at_boundary)

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


def speed_bound(site: Site) -> float:
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
        k, R, at_boundary = _response(scenario, omega, depth)
        shape = np.exp(1j * np.outer(np.linspace(0, _fetch(scenario), 65), k))
        speed = np.abs(sea.gravity * k / ((1j * omega + sea.drag) * at_boundary) * (shape - R / shape)).max()
        gains.append(min(float(speed), RESONANT_GAIN))
    irregular = sea.irregular_rms * math.sqrt(2 * sea.irregular_components)
    return start + sea.regular_amplitude * gains[0] + irregular * gains[1]


def forced_gain(scenario: Scenario, shortest: float, longest: float, depth: float) -> tuple[float, float]:
    """Period (s) between two at which the sea answers its forced boundary most, and that answer at the far end.

    It is |1/cos kL| of Eq. 7, with drag, where the elevation is forced before a wall, and else 1; `depth` is h, m.
    """
    periods = 1 / np.linspace(1 / longest, 1 / shortest, 2049)
    _, R, at_boundary = _response(scenario, 2 * math.pi / periods, depth)
    if scenario.sea.forcing == "incident" or not R:
        return shortest, 1.0
    gain = 2 / np.abs(at_boundary)
    most = int(gain.argmax())
    return float(periods[most]), float(gain[most])


def _fetch(scenario: Scenario) -> float:
    """Distance from the forced boundary to the opposite one, m."""
    return scenario.area.width if scenario.sea.forced_edge in ("west", "east") else scenario.area.length


def _response(scenario: Scenario, omega: np.ndarray, depth: float) -> tuple[np.ndarray, float, np.ndarray]:
    """Wave number k, reflection R opposite to the forced boundary, and Z/B there; see `add_response`."""
    sea = scenario.sea
    opposite = {"west": "east", "east": "west", "south": "north", "north": "south"}[sea.forced_edge]
    R = 0.0 if opposite in (*sea.radiating_edges, *sea.sponge_edges) else 1.0
    k = np.sqrt((omega**2 - 1j * omega * sea.drag) / (sea.gravity * depth))
    arriving = np.exp(1j * k * _fetch(scenario))
    return k, R, arriving if sea.forcing == "incident" else arriving + R / arriving
