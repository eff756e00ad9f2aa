"""Simulation of the sea of a scenario without vehicles: long waves, storm and current."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import torch

from usvauv.env.scenario.fields import ScenarioError
from usvauv.env.scenario.scenario import Scenario
from usvauv.env.sea.long_waves import build_sea, check_sea
from usvauv.env.sea.water import LARGEST_SEED, advance, build_short_waves, whole_number
from usvauv.env.site.site import Site
from usvauv.kernels import runtime
from usvauv.kernels.flow import vortex, vortex_motion
from usvauv.kernels.types import Level

FEWEST, MOST = 3, 8192  # cells along a side of the area
VIEW_BYTES = 40.0  # a cell, of surface, velocity and current together
SURVEY_CELLS, SURVEY_MOMENTS = 64, 100


class Surface(NamedTuple):
    """Elevation at cell centres, row 0 in the south, m, (ny, nx) float32: total, and the storm's part.

    On land the storm's part is 0 and the total is the solver's: 0 (linear), or the ground and the water on it
    (nonlinear).
    """

    elevation: np.ndarray
    storm: np.ndarray


def cells(scenario: Scenario, spacing: float | None) -> tuple[int, int]:
    """Cells (nx, ny) of about `spacing` m; by default `sea.fine_cells` along the longer side.

    Raises:
        ScenarioError: fewer than 3 or more than 8192 cells along a side.
    """
    if spacing is None:
        return scenario.area.cells(scenario.sea.fine_cells)
    sides = scenario.area.width, scenario.area.length
    count = (round(sides[0] / spacing), round(sides[1] / spacing)) if spacing > 0 else (0, 0)
    if min(count) < FEWEST or max(count) > MOST:
        finest, coarsest = max(sides) / (MOST + 0.49), min(sides) / (FEWEST - 0.49)
        raise ScenarioError(
            f"resolution {spacing:g} m: must be from {_three_digits(finest, math.ceil)} to"
            f" {_three_digits(coarsest, math.floor)} m, which is from {FEWEST} to {MOST} cells a side of"
            f" {sides[0]:g} × {sides[1]:g} m"
        )
    return count


def _three_digits(value: float, rounded: Callable[[float], int]) -> str:
    power = 10.0 ** (math.floor(math.log10(value)) - 2)
    return f"{rounded(value / power) * power:g}"


class SeaSimulation:
    """The sea of world 0 of a seed in its first episode, without vehicles.

    Args:
        scenario: its sections `area`, `water`, `sea`, `storm` and `current` are used.
        seed: from 0 to 2⁶⁴ − 1, as of `World`.
        shape: cells (nx, ny).
        interval: time of one `advance`, s.
        vortices: as of `usvauv.env.world.mission_parameters.first_vortices`; none by default.

    Attributes:
        site: the place. long_waves: the solver. storm: the short waves.
        x, y: cell centres (nx,) and (ny,), m.
        depth: still-water depth at cell centres, at most 0 on land, (ny, nx), m. wet: where it is above 0.
        steady: whether the current is constant in time.

    Raises:
        ScenarioError: the seed is out of range, or as `usvauv.env.sea.long_waves.check_sea`.
        MemoryNeeded: likewise.
    """

    def __init__(
        self,
        scenario: Scenario,
        seed: int,
        shape: tuple[int, int],
        interval: float,
        vortices: torch.Tensor | None = None,
    ) -> None:
        whole_number("seed", seed, 0, LARGEST_SEED)
        self.scenario, self.seed, self.interval = scenario, seed, interval
        none = torch.zeros((1, 0, 4), dtype=torch.float32, device=runtime.start().device)
        self._vortex = none if vortices is None else vortices.clone()
        paced = scenario.sea.model_copy(update={"update_interval": interval})
        self.site = site = Site(scenario.model_copy(update={"sea": paced}))
        check_sea(site.scenario, shape, 1, VIEW_BYTES * shape[0] * shape[1])
        self.depth = site.still_depth(shape)
        self.wet = self.depth > 0
        self._evolve_vortices = None
        current, self._pieces = scenario.current, math.ceil(interval / scenario.mission.step)
        if (current.viscosity > 0 or current.mutual) and self._vortex.shape[1]:
            step = interval / self._pieces
            spread_and_move = current.viscosity, current.mutual
            self._evolve_vortices = vortex_motion.evolution(self._vortex, step, *spread_and_move, site.eddies)
        self._flow = site.current
        flow_changes = self._flow is not None and len(self._flow.times) > 1
        self.steady = self._evolve_vortices is None and not flow_changes
        self.long_waves = build_sea(site, [(seed, 0)], shape)
        self.storm = build_short_waves(site, [(seed, 0)])
        self.x = (np.arange(shape[0]) + 0.5) * (scenario.area.width / shape[0])
        self.y = (np.arange(shape[1]) + 0.5) * (scenario.area.length / shape[1])
        self._steps = 0

    @property
    def time(self) -> float:
        """Time since the start, s."""
        return self._steps * self.interval

    @property
    def vortices(self) -> np.ndarray:
        """Centre x and y (m), circulation (m²/s) and core radius (m) of the current's vortices now, (V, 4)."""
        return self._vortex[0].cpu().numpy()

    @property
    def spacing(self) -> tuple[float, float]:
        """Width and length of a cell, m."""
        return self.scenario.area.width / len(self.x), self.scenario.area.length / len(self.y)

    def advance(self) -> None:
        """Advance by one interval.

        Raises:
            DivergenceError: the long waves are not finite or have run away.
        """
        advance(self.long_waves)
        self._steps += 1
        self.storm.set_time(self.time)
        if self._evolve_vortices:
            for _ in range(self._pieces):
                self._evolve_vortices()

    def surface(self) -> Surface:
        """The present elevation."""
        storm = self.storm.elevation(0, self.x, self.y).astype(np.float32) * self.wet
        return Surface(self._grid(self.long_waves.elevation()) + storm, storm)

    def velocity(self) -> tuple[np.ndarray, np.ndarray]:
        """Depth-averaged velocity (u, v) of the long waves at cell centres, m/s, each (ny, nx) float32."""
        u, v = self.long_waves.velocity()
        return self._grid(u), self._grid(v)

    def stream(self) -> np.ndarray:
        """The present real current at the surface, m/s, (rows, columns, 2) as in `usvauv.kernels.flow.current`.

        Empty where the scenario has none.
        """
        if self._flow is None:
            return np.zeros((0, 0, 2), np.float32)
        return self._flow.at(self.time)[Level.surface]

    def current(self) -> np.ndarray:
        """Present velocity of vortices and real current at the surface, at cell centres, m/s, (ny, nx, 2) float32."""
        points = np.stack(np.meshgrid(self.x, self.y), axis=-1).astype(np.float32)
        flat = torch.from_numpy(points.reshape(1, -1, 2)).to(self._vortex.device)
        field = (
            vortex.sample_current(self._vortex, flat, self.site.eddies.period)[0].cpu().numpy().reshape(points.shape)
        )
        stream, area = self.stream(), self.scenario.area
        if stream.size:
            to_rows = _weights(self.y / area.length, stream.shape[0])
            to_columns = _weights(self.x / area.width, stream.shape[1])
            field += np.einsum("ya,abc,xb->yxc", to_rows, stream, to_columns, optimize=True)
        return np.where(self.wet[..., None], field, np.float32(0))

    def _grid(self, field: np.ndarray) -> np.ndarray:
        """A solver's field on the grid (ny, nx), float32; linear solvers have an axis for seas."""
        return field.reshape(len(self.y), len(self.x)).astype(np.float32)


def _weights(position: np.ndarray, nodes: int) -> np.ndarray:
    """Weights (P, nodes) of linear interpolation between evenly spaced nodes at positions from 0 to 1."""
    return np.maximum(0, 1 - np.abs(position[:, None] * (nodes - 1) - np.arange(nodes))).astype(np.float32)


def survey(scenario: Scenario, seed: int, duration: float) -> np.ndarray:
    """Elevations to expect: the same sea on few cells at `SURVEY_MOMENTS` + 1 times, (times, Y, X) m."""
    sea = SeaSimulation(scenario, seed, scenario.area.cells(SURVEY_CELLS), duration / SURVEY_MOMENTS)
    fields = [sea.surface().elevation]
    for _ in range(SURVEY_MOMENTS):
        sea.advance()
        fields.append(sea.surface().elevation)
    return np.stack(fields)
