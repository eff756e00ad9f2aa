"""Long waves of a scenario: their forcing, initial state and memory, and solvers side by side.

Sea s of a seed depends only on (seed, s), not on the number of seas, and is a continuous function of position and time:
a coarse and a fine solver compute the same sea.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import torch

from usvauv.env.scenario.environment import INFRAGRAVITY
from usvauv.env.scenario.fields import ScenarioError
from usvauv.env.scenario.scenario import Scenario
from usvauv.env.sea.storm import cumulative, density, total_height, wave_systems
from usvauv.env.site.site import Site
from usvauv.env.storage.memory import require
from usvauv.kernels import runtime
from usvauv.kernels.functions import DeviceFlag
from usvauv.kernels.shallow_water.discretisation import LANES, Boundary, Packing, Side
from usvauv.kernels.shallow_water.linear import COURANT, ShallowWater, beyond
from usvauv.kernels.shallow_water.nonlinear import NonlinearShallowWater

FEWEST_CELLS = 4
MOST_SUBSTEPS = 1_000_000
DRY = 1e4  # m, above every elevation where land may be dry
RESONANT_GAIN = 10.0  # |1/cos kL| above which a component starts from rest instead of in its steady state


class NonlinearSeas:
    """Nonlinear solvers side by side, with fields packed as `usvauv.kernels.flow.current.long_wave_surface` reads them.

    On dry land the elevation is that of the ground.

    Args:
        solvers: of equal size, cells and interval, with their states set.

    Attributes:
        eta: packed elevation, torch (blocks, rows, W, LANES).
        transports: packed transports at western and southern faces, m²/s, likewise; the mean of the cells beside them.
        fields, units, nx, ny, dx, dy, interval: as in `usvauv.kernels.shallow_water.linear.ShallowWater`.
    """

    units = 1.0, 1.0

    def __init__(self, solvers: Sequence[NonlinearShallowWater]) -> None:
        first = solvers[0]
        self.nx, self.ny, self.dx, self.dy, self.interval = first.nx, first.ny, first.dx, first.dy, first.interval
        self._solvers = solvers
        self._packing = Packing(len(solvers), self.nx, self.ny)
        shape = 3, self._packing.blocks, self.ny + 1, self._packing.columns, LANES
        self.eta, U, V = torch.zeros(shape, dtype=torch.float32, device=runtime.start().device)
        self.transports = U, V
        self.fields = self.eta, U, V
        self._flag = DeviceFlag(self.eta, DRY)
        self._pack()

    @property
    def time(self) -> float:
        """Time of the elevation, s."""
        return self._solvers[0].time

    def set_forcing(self, amplitude: np.ndarray, period: np.ndarray, phase: np.ndarray) -> None:
        """Set the waves at the forced edge from the next interval on.

        The arguments are those of `usvauv.kernels.shallow_water.linear.ShallowWater.set_forcing`.
        """
        for solver, *wave in zip(self._solvers, amplitude, period, phase, strict=True):
            solver.set_forcing(*wave)

    def advance(self) -> None:
        """One interval.

        Raises:
            FloatingPointError: (index of a sea, what is wrong with it).
        """
        for index, solver in enumerate(self._solvers):
            try:
                solver.advance()
            except FloatingPointError as error:
                raise FloatingPointError(index, str(error)) from None
        self._pack()
        if self._flag.raised():
            raise beyond(self.elevation(), DRY, self.time)

    def elevation(self) -> np.ndarray:
        """Elevation at cell centres, m, (num_seas, ny, nx); a copy."""
        return np.stack([solver.elevation() for solver in self._solvers])

    def velocity(self) -> tuple[np.ndarray, np.ndarray]:
        """Velocities (u, v) at cell centres, m/s, each (num_seas, ny, nx)."""
        u, v = zip(*(solver.velocity() for solver in self._solvers), strict=True)
        return np.stack(u), np.stack(v)

    def state(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Copies of all fields and clocks; `load_state` restores them bit for bit."""
        fields, clocks = zip(*(solver.state() for solver in self._solvers), strict=True)
        return torch.stack(fields), torch.stack(clocks)

    def load_state(self, fields: torch.Tensor, clock: torch.Tensor) -> None:
        """Restore what `state` returned."""
        for solver, own, time in zip(self._solvers, fields, clock, strict=True):
            solver.load_state(own, time)
        self._pack()

    def _pack(self) -> None:
        """Copy the solvers' fields to the packed ones."""
        self._packing.pack(self.elevation(), self.eta, 0)
        depth = np.stack([solver.depth() for solver in self._solvers])
        for axis, (velocity, packed) in enumerate(zip(self.velocity(), self.transports, strict=True)):
            cells = np.moveaxis(depth * velocity, 2 - axis, 0)
            faces = np.zeros((len(cells) + 1, *cells.shape[1:]), np.float32)
            faces[1:-1] = (cells[1:] + cells[:-1]) / 2
            faces[0], faces[-1] = cells[0], cells[-1]
            self._packing.pack(np.moveaxis(faces, 0, 2 - axis), packed, 0)


LongWaves = ShallowWater | NonlinearSeas  # solvers of independent seas over one bed, advanced together


def coarse_cells(scenario: Scenario) -> tuple[int, int]:
    """Cells (nx, ny) of about `sea.cell_size`, for training and evaluating; at least `FEWEST_CELLS` a side."""
    width, length = (side / scenario.sea.cell_size for side in (scenario.area.width, scenario.area.length))
    return max(FEWEST_CELLS, round(width)), max(FEWEST_CELLS, round(length))


def sea_bytes(scenario: Scenario, cells: tuple[int, int], num_seas: int) -> float:
    """Estimate of the memory that building and solving a sea takes at its peak, bytes."""
    nx, ny = cells
    count, blocks = nx * ny, math.ceil(num_seas / LANES)
    strips = num_seas == 1 and nx >= LANES
    if scenario.sea.equations == "nonlinear":
        return count * (130.0 * num_seas + (12.0 if strips else 12.0 * LANES * blocks))
    packed = 20.0 if strips else 12.0 * LANES * blocks + 8.0 * LANES
    drawn = 24.0 * num_seas  # three fields in double precision
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
        further: bytes that its use takes in addition.

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
    waves = boundary_waves(site, seas)
    eta, u, v = start(scenario, waves, cells, mean_depth)
    like: dict[str, Any] = {"size": size, "cells": cells, "boundaries": boundaries(scenario)}
    like |= {"interval": sea.update_interval, "gravity": sea.gravity, "drag": sea.drag}
    if sea.equations == "nonlinear":
        solvers = []
        for row, wave in enumerate(zip(*waves, strict=True)):
            solver = NonlinearShallowWater(bed=-depth, manning=sea.manning, **like)
            solver.set_forcing(*wave)
            solver.set_state(eta[row], (u[row, :, 1:] + u[row, :, :-1]) / 2, (v[row, 1:] + v[row, :-1]) / 2)
            solvers.append(solver)
        return NonlinearSeas(solvers)
    depth = np.maximum(depth, 0)
    solver = ShallowWater(depth=depth, num_seas=len(seas), largest=float(depth.max()), **like)
    solver.set_forcing(*waves)
    solver.set_state(eta, u, v)
    return solver


def boundaries(scenario: Scenario) -> dict[Side, Boundary]:
    """Kind of each boundary that is not a wall, as the solvers name them."""
    sea = scenario.sea
    kinds: dict[Side, Boundary] = dict.fromkeys(sea.radiating_edges, "radiating")
    if sea.forced_edge != "none":
        kinds[sea.forced_edge] = "forced" if sea.forcing == "elevation" else "incident"
    return kinds


class BoundaryWaves(NamedTuple):
    """Elevations Σ a cos(2πt/T + φ) at the forced boundary: a (m), T (s) and φ (rad), each (seas, components)."""

    amplitude: np.ndarray
    period: np.ndarray
    phase: np.ndarray


def boundary_waves(site: Site, seas: Sequence[tuple[int, int]]) -> BoundaryWaves:
    """Forcing of the seas of `build_sea`: the regular component, then `irregular_components` of equal energy.

    Their frequencies are drawn one in each of equally wide bands between 1/`irregular_period_max` and
    1/`irregular_period_min`, so that no two coincide and the record does not repeat; phases are uniform.
    """
    sea = site.scenario.sea
    count = sea.irregular_components
    low, high = 1 / sea.irregular_period_max, 1 / sea.irregular_period_min
    keys = [np.random.SeedSequence(seed, spawn_key=(index, 0)) for seed, index in seas]
    drawn = np.stack([np.random.Generator(np.random.Philox(key)).random((2, count)) for key in keys])
    frequency = low + (high - low) * (np.arange(count) + drawn[:, 0]) / count
    irregular = long_wave_rms(site) * math.sqrt(2 / count), 1 / frequency, 2 * math.pi * drawn[:, 1]
    table = np.empty((3, len(seas), count + 1))
    for part, regular, rest in zip(table, (sea.regular_amplitude, sea.regular_period, 0.0), irregular, strict=True):
        part[:, 0], part[:, 1:] = regular, rest
    return BoundaryWaves(*table)


def long_wave_rms(site: Site) -> float:
    """Rms elevation of the irregular long waves at the forced boundary, m; where that is "storm":

        H = α1 Hs Tm² √(g/h),   rms = H/4,   Tm = √(m₋₂/m0),   α1 = 1.2e-3 1/s,

    the height of the free infragravity waves that coasts send out while these waves break on them, over the mean depth
    h, by Ardhuin, Rawat and Aucan (2014), doi 10.1016/j.ocemod.2014.02.006. m are moments of the spectrum of all
    systems of short waves over frequencies in Hz.
    """
    rms = site.scenario.sea.irregular_rms
    if rms != "storm":
        return rms
    shortest, depth, gravity = site.scenario.shortest_wave, site.mean_depth, site.scenario.sea.gravity
    systems = wave_systems(site)
    squares = 0.0  # Σ Hs² Tm²
    for system in systems:
        omega, S = density(system, shortest, depth, gravity)
        mean_square = float(cumulative(omega, S / omega**2)[-1] / cumulative(omega, S)[-1])
        squares += (2 * math.pi * system.significant_height) ** 2 * mean_square
    return INFRAGRAVITY / 4 * squares / max(total_height(systems), 1e-9) * math.sqrt(gravity / depth)


def start(
    scenario: Scenario, waves: BoundaryWaves, cells: tuple[int, int], depth: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The steady response of the basins to their boundary waves at t = 0, so that the forcing sets in smoothly.

    With s the distance from the opposite boundary, the forced one at s = L, and R = 1 for a wall at s = 0, 0 for a
    boundary that lets waves out:

        η = Re B (e^{iks} + R e^{−iks}),   u_s = −Re i g k B (e^{iks} − R e^{−iks})/(iω + r),   g h k² = ω² − i ω r,

    B = Z/(e^{ikL} + R e^{−ikL}) where Z = a e^{iφ} is the elevation at the boundary (with R = 1 that is Eq. 7), and
    B = Z e^{−ikL} where it is the incoming wave there. Components with |1/cos kL| above `RESONANT_GAIN` start from
    rest: without drag they never reach the steady state. Over an uneven bed this is the response of the mean depth, and
    only nearly steady.

    Args:
        depth: h, m.

    Returns:
        elevation (seas, ny, nx) and velocities at faces (seas, ny, nx + 1), (seas, ny + 1, nx).
    """
    sea, (nx, ny), seas = scenario.sea, cells, len(waves.period)
    eta, u, v = (np.zeros((seas, *shape)) for shape in ((ny, nx), (ny, nx + 1), (ny + 1, nx)))
    if sea.forced_edge == "none":
        return eta, u, v
    west_east = sea.forced_edge in ("west", "east")
    backwards = sea.forced_edge in ("west", "south")
    length = _fetch(scenario)
    omega = 2 * math.pi / waves.period
    k, R, at_boundary = _response(scenario, omega, depth)
    Z = waves.amplitude * np.exp(1j * waves.phase)
    B = np.where(abs(at_boundary) * RESONANT_GAIN < 2 * R, 0.0, Z / at_boundary)
    C = -1j * sea.gravity * k * B / (1j * omega + sea.drag)

    count = nx if west_east else ny
    centres = (np.arange(count) + 0.5) * (length / count)
    faces = np.arange(count + 1) * (length / count)
    if backwards:
        centres, faces, C = length - centres, length - faces, -C
    velocity, axis = (u, 1) if west_east else (v, 2)
    for component in range(k.shape[1]):  # one at a time: many seas of many cells take little memory
        own = k[:, component, None]
        there, back = (np.exp(sign * 1j * (own * centres)) for sign in (1, -1))
        eta += np.expand_dims((B[:, component, None] * (there + R * back)).real, axis)
        there, back = (np.exp(sign * 1j * (own * faces)) for sign in (1, -1))
        velocity += np.expand_dims((C[:, component, None] * (there - R * back)).real, axis)
    return eta, u, v


def speed_bound(site: Site) -> float:
    """Bound on the speed of the water in long waves, m/s, except in resonance without drag: all components in phase."""
    scenario, sea, depth = site.scenario, site.scenario.sea, site.mean_depth
    if sea.forced_edge == "none":
        return 0.0
    band = np.linspace(1 / sea.irregular_period_max, 1 / sea.irregular_period_min, 257)
    gains = []
    for frequency in (np.array([1 / sea.regular_period]), band):
        omega = 2 * math.pi * frequency
        k, R, at_boundary = _response(scenario, omega, depth)
        shape = np.exp(1j * np.outer(np.linspace(0, _fetch(scenario), 65), k))
        speed = np.abs(sea.gravity * k / ((1j * omega + sea.drag) * at_boundary) * (shape - R / shape)).max()
        gains.append(min(float(speed), RESONANT_GAIN))
    irregular = long_wave_rms(site) * math.sqrt(2 * sea.irregular_components)
    return sea.regular_amplitude * gains[0] + irregular * gains[1]


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
    """Wave number k, reflection R opposite to the forced boundary, and Z/B there; see `start`."""
    sea = scenario.sea
    opposite = {"west": "east", "east": "west", "south": "north", "north": "south"}[sea.forced_edge]
    R = 0.0 if opposite in sea.radiating_edges else 1.0
    k = np.sqrt((omega**2 - 1j * omega * sea.drag) / (sea.gravity * depth))
    arriving = np.exp(1j * k * _fetch(scenario))
    return k, R, arriving if sea.forcing == "incident" else arriving + R / arriving
