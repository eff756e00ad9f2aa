"""Linear shallow water on an Arakawa C grid, forward–backward in time (Eq. 6)."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Literal

import numpy as np
import torch

from kernels import runtime
from kernels.c_grid import LANES, Packing, sample
from kernels.forward_backward import FORCED_COLUMN, FORCED_NORTH, FORCED_SOUTH, WALLS, march, plan_bands

__all__ = ["Edge", "ShallowWater", "sample"]

Edge = Literal["none", "west", "east", "south", "north"]

COURANT = 0.95  # share of the stability limit that a substep may use

# For each edge: 0 if it cuts the axis of U, 1 for V; which side it is; its faces in (…, ny + 1, nx + 1) and the cells
# along it in (…, ny, nx).
_EDGES = {
    "west": (0, -1, np.s_[..., :-1, 0], np.s_[..., 0]),
    "east": (0, 1, np.s_[..., :-1, -1], np.s_[..., -1]),
    "south": (1, -1, np.s_[..., 0, :-1], np.s_[..., 0, :]),
    "north": (1, 1, np.s_[..., -1, :-1], np.s_[..., -1, :]),
}


class ShallowWater:
    """Linear shallow-water seas over one bed, in time steps chosen by the solver.

        U_t = −g h η_x − r U,   V_t = −g h η_y − r V,   η_t = −U_x − V_y

    with the transports U = h u, V = h v on the faces of a C grid, η at cell centres, U and V half a substep behind η.
    Second order in space and time. Edges and the border of dry cells are reflecting walls; at one edge the elevation
    may be prescribed at the face itself (the difference over the half cell to it leaves the stability limit as it is).

    The three-field form is kept although for constant forcing and no drag the potential form needs only two arrays:
    in f32 its rounding is far worse, because a potential is large against its differences between cells (measured in
    `tests/test_shallow_water.py`).

    Args:
        size: (width, length) of the basin X × Y, m.
        cells: (nx, ny) cells, at least 3 each way.
        depth: still-water depth h at cell centres, m: one number or (ny, nx); 0 is land. A face has the mean of its two
            cells, and none beside land.
        gravity: g, m/s².
        drag: rate r of the linear drag, 1/s; taken half at the old and half at the new time.
        forced_edge: edge of prescribed elevation, or "none".
        num_seas: independent seas over the same bed.
        interval: time of one `advance`, s.

    Attributes:
        limit: largest stable substep 1/√(g h_max (1/Δx² + 1/Δy²)), s.
        substeps, time_step: substeps of an interval, and their length Δt ≤ 0.95 limit, s.
        eta: packed elevation, torch (blocks, rows, W, LANES); see `kernels.c_grid`.

    Raises:
        ValueError: fewer than 3 cells, no water at all, or a negative or non-finite depth.
    """

    def __init__(
        self,
        *,
        size: tuple[float, float],
        cells: tuple[int, int],
        depth: float | np.ndarray,
        interval: float,
        gravity: float = 9.81,
        drag: float = 0.0,
        forced_edge: Edge = "none",
        num_seas: int = 1,
    ) -> None:
        running = runtime.start()
        self.nx, self.ny = cells
        if min(cells) < 3:
            raise ValueError(f"cells: {cells} must be at least 3 each way")
        self.dx, self.dy = size[0] / self.nx, size[1] / self.ny
        self.gravity, self.drag, self.forced_edge = gravity, drag, forced_edge
        self.num_seas, self.interval = num_seas, interval
        self.depth = np.broadcast_to(np.asarray(depth, np.float64), (self.ny, self.nx))
        deepest = self.depth.max()
        if not (0 < deepest < math.inf and self.depth.min() >= 0):
            raise ValueError("depth: must be finite, nowhere negative and somewhere above 0")
        self.limit = 1 / math.sqrt(gravity * deepest * (self.dx**-2 + self.dy**-2))
        self.substeps = math.ceil(interval / (COURANT * self.limit))
        self.time_step = interval / self.substeps

        device = running.device
        self._packing = Packing(num_seas, self.nx, self.ny)
        blocks, columns = self._packing.blocks, self._packing.columns
        self._tile, plan, rows = plan_bands(self.ny, columns, blocks, self.substeps, running.threads)
        C, coefficient_row = self._coefficients()
        plan[:, 2] = coefficient_row[plan[:, 2]]
        self._plan = torch.tensor(plan, device=device)
        self._C = torch.tensor(C, dtype=torch.float32, device=device).contiguous()
        self._state = torch.zeros((3, blocks, rows, columns, LANES), device=device)
        self.eta, self._U, self._V = self._state
        self._edge_elevation = torch.zeros((blocks, self.substeps, LANES), device=device)
        self._half_drag = drag * self.time_step / 2
        self._intervals, self._start = 0, 0.0
        self._silent = True
        nothing = np.zeros((num_seas, 1))
        self.set_forcing(nothing, nothing + 1, nothing)

    @property
    def time(self) -> float:
        """Time of the elevation, s."""
        return self._start + self._intervals * self.interval

    @property
    def still(self) -> bool:
        """Nothing moves and nothing forces: `advance` then only counts the time."""
        return self._silent and self._at_rest

    def set_forcing(self, amplitude: np.ndarray, period: np.ndarray, phase: np.ndarray) -> None:
        """Prescribe the elevation Σ a cos(2πt/T + φ) all along the forced edge.

        To be called before `set_state`, whose half substep back needs the elevation at the edge.

        Args:
            amplitude, period, phase: a (m), T (s) and φ (rad), (num_seas, components).
        """
        self._amplitude, self._phase = np.asarray(amplitude, np.float64), np.asarray(phase, np.float64)
        self._omega = 2 * math.pi / np.asarray(period, np.float64)
        self._silent = self.forced_edge == "none" or not self._amplitude.any()
        angle = self._omega[:, None, :] * (self.time_step * np.arange(self.substeps))[:, None]
        self._turn = np.concatenate([np.cos(angle), -np.sin(angle)], axis=2)
        self._edge_elevation.zero_()
        self._at_rest = not self._state.any()

    def set_state(
        self, eta: np.ndarray, u: np.ndarray | None = None, v: np.ndarray | None = None, time: float = 0.0
    ) -> None:
        """Start from an elevation and velocities, all at the same time; the transports are set half a substep back.

        Args:
            eta: (num_seas, ny, nx) elevation at cell centres, m.
            u: (num_seas, ny, nx + 1) eastward velocity at western and eastern faces, m/s; default at rest.
            v: (num_seas, ny + 1, nx) northward velocity at southern and northern faces, m/s; default at rest.
            time: the clock, s.
        """
        self._start, self._intervals = time, 0
        eta = np.where(self.depth > 0, np.broadcast_to(eta, (self.num_seas, self.ny, self.nx)), 0.0)
        back = self.time_step / 2
        fields = [eta]
        for velocity, h, slope in zip((u, v), self._face_depths(), self._slopes(eta), strict=True):
            transport = back * self.gravity * h * slope
            if velocity is not None:
                rows, columns = velocity.shape[1:]
                transport[:, :rows, :columns] += (1 + self.drag * back) * h[:rows, :columns] * velocity
            fields.append(transport)
        scales = 1.0, self.time_step / self.dx, self.time_step / self.dy
        for packed, field, scale in zip((self.eta, self._U, self._V), fields, scales, strict=True):
            self._packing.pack(field * scale, packed)
        self._at_rest = not any(field.any() for field in fields)

    def advance(self) -> None:
        """One interval."""
        if not self.still:
            if not self._silent:
                self._tabulate_edge()
            a = (1 - self._half_drag) / (1 + self._half_drag)
            launches = math.ceil(self.substeps / self._tile)
            ends = [self.substeps * n // launches for n in range(launches + 1)]
            arrays = (array.view(-1, LANES) for array in (self._state, self._C, self._edge_elevation))
            arguments = (*arrays, self._plan, self._packing.blocks, self._packing.columns)
            with runtime.vectors_in_registers():
                for first, last in pairwise(ends):
                    march(*arguments, first, last - first, a, *self._edge_place(), self._packing.strips)
        self._intervals += 1

    def state(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Copies of the packed fields and of the clock; with the same forcing, `load` brings them back bit for bit."""
        return self._state.clone(), torch.tensor([self._intervals, self._start, self._at_rest], dtype=torch.float64)

    def load(self, fields: torch.Tensor, clock: torch.Tensor) -> None:
        """Go back to what `state` gave."""
        self._state.copy_(fields)
        self._intervals, self._start, self._at_rest = int(clock[0]), float(clock[1]), bool(clock[2])

    def elevation(self) -> np.ndarray:
        """Elevation at cell centres, m, (num_seas, ny, nx); a copy."""
        return self._packing.unpack(self.eta)[:, :-1, :-1]

    def velocity(self) -> tuple[np.ndarray, np.ndarray]:
        """Velocities (u, v) at cell centres at `time`, m/s, each (num_seas, ny, nx); zero on land."""
        (U, V), after = self._transports()
        hx, hy = (np.where(h > 0, h, math.inf) for h in self._face_depths())
        u, v = (U + after[0]) / (2 * hx), (V + after[1]) / (2 * hy)
        return ((u[:, :, 1:] + u[:, :, :-1]) / 2)[:, :-1], ((v[:, 1:] + v[:, :-1]) / 2)[:, :, :-1]

    def mass(self) -> np.ndarray:
        """Volume above the mean level Σ η Δx Δy, m³, (num_seas,)."""
        return self.elevation().sum(axis=(1, 2), dtype=np.float64) * self.dx * self.dy

    def energy(self) -> np.ndarray:
        """The scheme's own invariant between walls without drag, per density, m⁵/s², (num_seas,).

        ½ Δx Δy (g Σ η² + Σ U⁻U⁺/h + Σ V⁻V⁺/h), U⁻ and U⁺ half a substep before and after η: exactly constant in exact
        arithmetic, positive below the stability limit, and within O(Δt²) the energy ½ g η² + ½ h u².
        """
        before, after = self._transports()
        total = self.gravity * (self.elevation().astype(np.float64) ** 2).sum(axis=(1, 2))
        for minus, plus, h in zip(before, after, self._face_depths(), strict=True):
            total += (minus * plus / np.where(h > 0, h, math.inf)).sum(axis=(1, 2))
        return total * self.dx * self.dy / 2

    def _transports(self) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
        """Transports (U, V), m²/s, half a substep before and half a substep after the elevation."""
        U = self._packing.unpack(self._U).astype(np.float64) * (self.dx / self.time_step)
        V = self._packing.unpack(self._V).astype(np.float64) * (self.dy / self.time_step)
        kept, push = 1 - self._half_drag, self.time_step * self.gravity
        faces = zip((U, V), self._face_depths(), self._slopes(self.elevation().astype(np.float64)), strict=True)
        after = tuple((kept * W - push * h * slope) / (1 + self._half_drag) for W, h, slope in faces)
        return (U, V), after

    def _face_depths(self, rows: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Depth of western and southern faces, m, each (rows, nx + 1); 0 is a wall.

        Args:
            rows: the wanted ones of 0 to ny, beginning with 0 and ending with ny; default all.
        """
        rows = np.arange(self.ny + 1) if rows is None else rows
        here = self.depth[rows[:-1]]
        hx, hy = np.zeros((2, len(rows), self.nx + 1))
        hx[:-1, 1:-1] = _mean_if_wet(here[:, :-1], here[:, 1:])
        hy[1:-1, :-1] = _mean_if_wet(self.depth[rows[1:-1] - 1], here[1:])
        if self.forced_edge != "none":
            axis, _, faces, cells = _EDGES[self.forced_edge]
            (hx, hy)[axis][faces] = here[cells]
        return hx, hy

    def _slopes(self, eta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """η_x and η_y on the faces, (num_seas, ny + 1, nx + 1); at a forced edge over the half cell to it."""
        slopes = np.zeros((2, self.num_seas, self.ny + 1, self.nx + 1))
        slopes[0, :, :-1, 1:-1] = np.diff(eta, axis=2) / self.dx
        slopes[1, :, 1:-1, :-1] = np.diff(eta, axis=1) / self.dy
        if self.forced_edge != "none":
            axis, side, faces, cells = _EDGES[self.forced_edge]
            edge = (self._amplitude * np.cos(self._omega * self.time + self._phase)).sum(axis=1)[:, None]
            slopes[axis][faces] = side * (edge - eta[cells]) / ((self.dx, self.dy)[axis] / 2)
        return slopes[0], slopes[1]

    def _coefficients(self) -> tuple[np.ndarray, np.ndarray]:
        """C of `march` with equal neighbouring rows once, and which of its rows each row 0 to ny takes."""
        depth = self.depth
        changes = [] if depth.strides[0] == 0 else [i for i in range(1, self.ny) if (depth[i] != depth[i - 1]).any()]
        rows = np.unique([0, 1, *changes, *(i + 1 for i in changes), self.ny])
        hx, hy = self._face_depths(rows)
        if self.forced_edge != "none":  # the difference over half a cell
            axis, _, faces, _ = _EDGES[self.forced_edge]
            (hx, hy)[axis][faces] *= 2
        pace = self.gravity * self.time_step**2 / (1 + self.drag * self.time_step / 2)
        C = np.stack([self._packing.spread(h * (pace / d**2)) for h, d in ((hx, self.dx), (hy, self.dy))], axis=1)
        return C, (np.searchsorted(rows, np.arange(self.ny + 1), side="right") - 1).astype(np.int32)

    def _edge_place(self) -> tuple[int, int, int]:
        """Kind of forced edge, and the packed column and lane that hold the elevation of a western or eastern one."""
        kind = {"none": WALLS, "south": FORCED_SOUTH, "north": FORCED_NORTH}.get(self.forced_edge, FORCED_COLUMN)
        columns = self._packing.columns
        if not self._packing.strips:
            return kind, self.nx, -1
        lane, column = divmod(self.nx, columns) if self.forced_edge == "east" else (LANES - 1, columns - 1)
        return kind, column, lane

    def _tabulate_edge(self) -> None:
        """Prescribed elevation at each substep of the coming interval; the phase at its beginning is exact."""
        angle = self._omega * self.time + self._phase
        now = np.concatenate([self._amplitude * np.cos(angle), self._amplitude * np.sin(angle)], axis=1)
        edge = torch.as_tensor((self._turn @ now[:, :, None])[:, :, 0], dtype=torch.float32)
        if self._packing.strips:
            self._edge_elevation[0] = edge[0, :, None]
        else:
            blocks = self._packing.blocks
            padded = torch.nn.functional.pad(edge, (0, 0, 0, blocks * LANES - self.num_seas))
            self._edge_elevation.copy_(padded.view(blocks, LANES, self.substeps).transpose(1, 2))


def _mean_if_wet(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.where((a > 0) & (b > 0), (a + b) / 2, 0.0)
