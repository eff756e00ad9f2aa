"""Nonlinear shallow water with wetting and drying, by well-balanced finite volumes of second order."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from typing import Literal

import numpy as np
import torch

from usvauv.kernels import runtime
from usvauv.kernels.functions import Launch
from usvauv.kernels.shallow_water.discretisation import EAST, LANES, WEST, Side, complete_kinds
from usvauv.kernels.shallow_water.finite_volume import Clock, step
from usvauv.kernels.shallow_water.riemann import FORCED, INCIDENT, RADIATING, WALL

NonlinearBoundary = Literal["wall", "radiating", "forced", "incident"]

_KINDS = {"wall": WALL, "radiating": RADIATING, "forced": FORCED, "incident": INCIDENT}

ALONE = 16384  # fewest cells a thread for which others, and a launch for each step, pay
FIRST_STEP = 10.0  # how many times shorter than others: a dam that breaks is fastest at first


class NonlinearShallowWater:
    """A sea by the nonlinear shallow-water equations over any bed, dry land included.

        h_t + (h u)_x + (h v)_y = 0
        (h u)_t + (h u² + g h²/2)_x + (h u v)_y = −g h b_x − r h u − g n² |u| u/h^(1/3)
        (h v)_t + (h u v)_x + (h v² + g h²/2)_y = −g h b_y − r h v − g n² |u| v/h^(1/3)

    with the depth h = η − b between the surface z = η and the bed z = b; z = 0 is the mean level. Finite volumes on
    cell averages: limited linear reconstruction of surface, depth and velocity, half a step from these slopes
    (van Leer's MUSCL–Hancock scheme), hydrostatic reconstruction at the faces, HLLE flux, and Strang's splitting into
    steps along x and along y (`usvauv.kernels.shallow_water.riemann`, `usvauv.kernels.shallow_water.finite_volume`).
    Second order where the flow is smooth; bores have the right speed; lakes at rest stay at rest; depth stays positive
    and mass is conserved to rounding. Steps are chosen on the device: Δt times the speed of the fastest wave over Δx or
    Δy is 0.95, and less beside dry land and where the bed jumps from cell to cell (`SHORE` and `ROUGH` of
    `usvauv.kernels.shallow_water.finite_volume`). Flow that is mirrored stays mirrored to the last bit; x and y
    exchanged give the same within the error of the splitting.

    It costs more than the linear solver and damps short waves, which that one does not: it is for waves that are high
    against the depth, currents that are fast against the celerity, and land that gets wet.

    Args:
        size: (width, length) of the basin X × Y, m.
        cells: (nx, ny) cells, at least 3 each way.
        bed: b at cell centres, m: one number or (ny, nx); at sea minus the depth of still water, on land its height.
        interval: time of one `advance`, s.
        gravity: g, m/s².
        drag: rate r of the linear drag, 1/s.
        manning: Manning's n, s/m^(1/3).
        boundaries: kind by side; a side that is missing is a "wall". Others are "radiating" to a still sea outside
            (waves leave), "incident" (waves leave, and one whose elevation `set_forcing` prescribes enters), or
            "forced", where the elevation is prescribed and waves from inside are reflected. Where water leaves faster
            than waves travel a forced boundary cannot hold its level.
        dry: depth under which water does not move, m. Choose about 1e-5 of the greatest depth; with less the time steps
            are shorter, because thin water runs fast.

    Attributes:
        bed: b as it is used, rounded to f32, (ny, nx).
        steps: steps taken since `set_state`.

    Raises:
        ValueError: fewer than 3 cells, a bed that is not finite, an unknown side or kind.
        Unsupported: on an architecture other than CPU and CUDA.
    """

    def __init__(
        self,
        *,
        size: tuple[float, float],
        cells: tuple[int, int],
        bed: float | np.ndarray,
        interval: float,
        gravity: float = 9.81,
        drag: float = 0.0,
        manning: float = 0.0,
        boundaries: Mapping[Side, NonlinearBoundary] | None = None,
        dry: float = 1e-4,
    ) -> None:
        running = runtime.start()
        if not running.shares_memory_with_torch:
            raise runtime.Unsupported("the nonlinear sea takes cosines in double precision")
        self.nx, self.ny = cells
        if min(cells) < 3:
            raise ValueError(f"cells: {cells} must be at least 3 each way")
        self.dx, self.dy = size[0] / self.nx, size[1] / self.ny
        self.gravity, self.drag, self.manning, self.dry = gravity, drag, manning, dry
        self.interval = interval
        self.bed = np.broadcast_to(np.asarray(bed, np.float32), (self.ny, self.nx)).astype(np.float64)
        if not np.isfinite(self.bed).all():
            raise ValueError("bed: must be finite")
        kinds = complete_kinds(boundaries, tuple(_KINDS))
        self.steps = 0
        self._start, self._intervals = 0.0, 0
        self._sea, self._land = np.maximum(-self.bed, 0), np.maximum(self.bed, 0)

        self._columns = W = math.ceil(self.nx / LANES)
        self._first_column = np.arange(LANES) * (self.nx - W) // (LANES - 1)
        cells_a_thread = self.nx * self.ny // running.threads
        self._alone = running.on_cpu and (running.threads == 1 or cells_a_thread < ALONE)
        self._parts = min(4 * running.threads, self.ny) if running.on_cpu else self.ny
        # On a CPU there are enough columns for its threads, elsewhere a piece is worth the two rows read beforehand.
        self._pieces = max(1, min(math.ceil(running.threads / W), self.ny // 4) if running.on_cpu else self.ny // 8)
        numbers = {"dtype": torch.float32, "device": running.device}
        self._state = torch.zeros((2, 3, self.ny + 4, W + 4, LANES), **numbers)
        self._bed = torch.tensor(self._spread(np.pad(self.bed, 2, mode="symmetric"), 2), **numbers).contiguous()
        self._fastest = torch.zeros(1, **numbers)
        self._clock = torch.zeros(len(Clock.names), dtype=torch.float64, device=running.device)
        self._halo = torch.tensor(self._halo_table(), dtype=torch.int32, device=running.device)
        codes = [_KINDS[kind] for kind in kinds.values()]
        self._boundaries = torch.tensor(codes, dtype=torch.int32, device=running.device)
        self.set_forcing(np.zeros(1), np.ones(1), np.zeros(1))

    @property
    def time(self) -> float:
        """Time of the state, s."""
        return self._start + self._intervals * self.interval

    def set_forcing(self, amplitude: np.ndarray, period: np.ndarray, phase: np.ndarray) -> None:
        """Prescribe the elevation Σ a cos(2πt/T + φ) along all forced boundaries.

        Args:
            amplitude, period, phase: a (m), T (s) and φ (rad), (components,).
        """
        components = np.stack([amplitude, 2 * math.pi / np.asarray(period, np.float64), phase], axis=1)
        self._tide = torch.tensor(components, dtype=torch.float64, device=self._clock.device)
        self.__dict__.pop("_launch", None)  # it holds the former tide

    def set_state(
        self, eta: float | np.ndarray, u: float | np.ndarray = 0.0, v: float | np.ndarray = 0.0, time: float = 0.0
    ) -> None:
        """Start from a surface and velocities.

        Args:
            eta: surface at cell centres, m, (ny, nx) or a number; where it is not above the bed there is no water.
            u, v: velocities at cell centres, m/s, likewise; default at rest.
            time: time of the state, s.

        Raises:
            ValueError: something is not finite.
        """
        shape = self.ny, self.nx
        eta, u, v = (np.broadcast_to(f, shape).astype(np.float64) for f in (eta, u, v))
        if not all(np.isfinite(f).all() for f in (eta, u, v)):
            raise ValueError("state: must be finite")
        # A surface given as the bed itself may differ from it by the rounding of the bed: that is no water.
        wet = eta - self.bed > 1e-6 * np.abs(self.bed)
        fields = np.where(wet, eta - self._land, -self._sea), np.where(wet, u, 0), np.where(wet, v, 0)
        for packed, field in zip(self._state[0], fields, strict=True):
            packed[2:-2, 2:-2] = torch.from_numpy(self._spread(field, 0))
        celerity = np.sqrt(self.gravity * (fields[0] + self._sea))
        fastest = (np.maximum(np.abs(fields[1]), np.abs(fields[2])) + celerity).max() / min(self.dx, self.dy)
        self._fastest.fill_(FIRST_STEP * float(fastest))
        self._start, self._intervals, self.steps = time, 0, 0

    def advance(self) -> None:
        """One interval.

        Raises:
            FloatingPointError: the flow has become infinitely fast.
        """
        self._clock.zero_()
        self._clock[Clock.start] = self.time
        launches = 1
        while launches > 0:
            for _ in range(launches):
                self._launch()
            runtime.synchronize()
            done, dt = float(self._clock[Clock.done]), float(self._clock[Clock.step])
            launches = math.ceil((self.interval - done) / (2 * dt)) if dt > 0 else 0  # steps may get longer
        if done < self.interval:
            raise FloatingPointError(f"the flow has become infinitely fast, {done} s after {self.time} s")
        self.steps += int(self._clock[Clock.steps])
        self._intervals += 1

    @cached_property
    def _launch(self) -> Launch:
        """The next step, or all of an interval."""
        state, bed = self._state.view(-1, LANES), self._bed.view(-1, LANES)
        return Launch(
            step,
            *(state, state.view(-1), bed, bed.view(-1), self._fastest, self._clock, self._tide, self._halo),
            *(self._boundaries, self.ny, self._columns, self._parts, self._pieces, self.dx, self.dy, self.gravity),
            *(self.dry, self.drag, self.manning, self.interval, self.drag > 0 or self.manning > 0, self._alone),
            settings=runtime.vectors_in_registers(),
        )

    def state(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Copies of the fields and of the clock; with equal forcing `load_state` restores them bit for bit."""
        clock = [self._start, self._intervals, self.steps, float(self._fastest)]
        return self._state[0].clone(), torch.tensor(clock, dtype=torch.float64, device="cpu")

    def load_state(self, fields: torch.Tensor, clock: torch.Tensor) -> None:
        """Restore what `state` returned."""
        self._state[0].copy_(fields)
        self._start, self._intervals, self.steps = float(clock[0]), int(clock[1]), int(clock[2])
        self._fastest.fill_(float(clock[3]))

    def elevation(self) -> np.ndarray:
        """Surface at cell centres, m, (ny, nx), f32; on dry land the bed."""
        return (self._gather(0) + self._land).astype(np.float32)

    def depth(self) -> np.ndarray:
        """Depth h at cell centres, m, (ny, nx), f32; nowhere negative."""
        return (self._gather(0) + self._sea).astype(np.float32)

    def velocity(self) -> tuple[np.ndarray, np.ndarray]:
        """Velocities (u, v) at cell centres, m/s, each (ny, nx), f32; zero on dry land."""
        return self._gather(1), self._gather(2)

    def mass(self) -> float:
        """Volume of the water Σ h Δx Δy, m³."""
        return float((self._gather(0) + self._sea).sum()) * self.dx * self.dy

    def _gather(self, field: int) -> np.ndarray:
        """A field (ny, nx) of the state, a copy."""
        packed = self._state[0, field, 2:-2, 2:-2].cpu().numpy()
        column, lane = self._owner(np.arange(self.nx))
        return packed[:, column, lane]

    def _spread(self, field: np.ndarray, ghosts: int) -> np.ndarray:
        """A field (rows, nx + 2 ghosts) as (rows, W + 2 ghosts, LANES)."""
        return field[:, np.arange(self._columns + 2 * ghosts)[:, None] + self._first_column]

    def _owner(self, column: int | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Packed column and lane of a column of the basin; of the last lane that has it."""
        lane = np.searchsorted(self._first_column, column, side="right") - 1
        return column - self._first_column[lane], lane

    def _halo_table(self) -> list[tuple[int, ...]]:
        """The table `halo` of `usvauv.kernels.shallow_water.finite_volume.step`."""
        table = []
        for j in (-2, -1, self._columns, self._columns + 1):
            for lane in range(LANES):
                column = self._first_column[lane] + j
                if column < 0:
                    source = WEST, -column, *self._owner(0), *self._owner(1)
                elif column >= self.nx:
                    source = EAST, column - self.nx + 1, *self._owner(self.nx - 1), *self._owner(self.nx - 2)
                else:
                    source = -1, 0, *self._owner(column), 0, 0
                table.append((j, lane, *map(int, source)))
        return table
