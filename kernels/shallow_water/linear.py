"""Linear shallow water on an Arakawa C grid, forward–backward in time (Eq. 6)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from functools import cached_property

import numpy as np
import torch

from kernels import runtime
from kernels.launch import Launch
from kernels.shallow_water.boundaries import PLACES, RADIATING, SHARE, Edge, Edges, Side
from kernels.shallow_water.cellwise import Cells
from kernels.shallow_water.packing import LANES, Packing, sample
from kernels.shallow_water.wavefront import Bands

__all__ = ["Edge", "ShallowWater", "Side", "sample"]

COURANT = 0.95  # share of the stability limit that a substep may use
CHUNK = 1 << 15  # cells that the host works on at a time: its f64 copies stay small against the fields


class ShallowWater:
    """Linear shallow-water seas over one bed, in time steps chosen by the solver.

        U_t = −g h η_x − r U,   V_t = −g h η_y − r V,   η_t = −U_x − V_y

    with the transports U = h u, V = h v on the faces of a C grid, η at cell centres, U and V half a substep behind η.
    Second order in space and time. The border of dry cells is a reflecting wall. On the faces of an open edge the
    difference of η is that over half a cell to the elevation η_f at the face, which leaves the stability limit as it
    is. With outward transport U and celerity c = √(g h) of the cell at the edge, the kinds of edges are

        wall        U = 0
        forced      η_f = E, prescribed: waves from inside are reflected upside down
        incident    η_f = 2 E + U/c: a wave of elevation E enters, and waves from inside leave
        radiating   η_f = U/c (Flather 1976 with a still sea outside): waves leave
        sponge      the same behind a layer of `sponge_width` in which η and the transport towards the edge are damped

    At an angle θ from the normal a radiating (or incident) edge reflects (1 − cos θ)/(1 + cos θ). The resistance U/c is
    centred in time, as is all damping, so that energy can only be lost. In the sponge the transport along the edge is
    free: damping it as well makes layers of up to a wave reflect oblique waves more. `docs/validation.md` has how much.

    The three-field form is kept although for constant forcing and no drag the potential form needs only two arrays:
    in f32 its rounding is far worse, because a potential is large against its differences between cells (measured in
    `tests/kernels/shallow_water/test_linear.py`).

    Args:
        size: (width, length) of the basin X × Y, m.
        cells: (nx, ny) cells, at least 3 each way.
        depth: still-water depth h at cell centres, m: one number or (ny, nx), kept and not copied; 0 is land. A face
            has the mean of its two cells, and none beside land.
        interval: time of one `advance`, s.
        gravity: g, m/s².
        drag: rate r of the linear drag, 1/s; taken half at the old and half at the new time.
        edges: what the edges are that are not a "wall".
        sponge_width: width of the sponges, m, where there are any. One of the longest wave reflects under 1% up to 45°.
        num_seas: independent seas over the same bed.

    Attributes:
        limit: largest stable substep 1/√(g h_max (1/Δx² + 1/Δy²)), s.
        substeps, time_step: substeps of an interval, and their length Δt ≤ 0.95 limit, s.
        edges: kinds of the edges.
        eta: packed elevation, torch (blocks, rows, W, LANES); see `kernels.shallow_water.packing`.

    Raises:
        ValueError: fewer than 3 cells, no water at all, a negative or non-finite depth, an unknown edge, or a sponge
            that does not fit.
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
        edges: Mapping[Side, Edge] | None = None,
        sponge_width: float | None = None,
        num_seas: int = 1,
    ) -> None:
        running = runtime.start()
        self.nx, self.ny = cells
        if min(cells) < 3:
            raise ValueError(f"cells: {cells} must be at least 3 each way")
        self.dx, self.dy = size[0] / self.nx, size[1] / self.ny
        self.gravity, self.drag = gravity, drag
        self.num_seas, self.interval = num_seas, interval
        self.depth = np.broadcast_to(depth, (self.ny, self.nx))
        deepest = float(self.depth.max())
        if not (0 < deepest < math.inf and self.depth.min() >= 0):
            raise ValueError("depth: must be finite, nowhere negative and somewhere above 0")
        self.edges = Edges(edges, sponge_width, size)
        self.limit = 1 / math.sqrt(gravity * deepest * (self.dx**-2 + self.dy**-2))
        self.substeps = math.ceil(interval / (COURANT * self.limit))
        self.time_step = interval / self.substeps

        device = running.device
        self._packing = Packing(num_seas, self.nx, self.ny, self.edges.outer_columns)
        blocks, columns = self._packing.blocks, self._packing.columns
        if device.type == "cpu":
            self._way = Bands(self._packing, self.substeps, running.threads)
        else:
            self._way = Cells(self._packing, self.substeps)
        self._keep = (1 - drag * self.time_step / 2) / (1 + drag * self.time_step / 2)
        self._kept = [
            self.edges.kept(axis, self.depth, gravity, cell, self.time_step)
            for axis, cell in enumerate((self.dx, self.dy))
        ]
        self._C, coefficient_row = self._coefficients(device)
        self._plan = torch.tensor(self._way.plan(coefficient_row), device=device)
        self._state = torch.zeros((3, blocks, self._way.rows, columns, LANES), device=device)
        self.eta, self._U, self._V = self._state
        self._edge_elevation = torch.zeros((blocks, self.substeps, LANES), device=device)
        self._resistance = self._along_edges(self._resistances(), self.edges.radiating).to(device)
        (face_x, cell_x), (face_y, cell_y) = self._kept
        self._shares_kept = self._along_edges([face_x, cell_x, face_y, cell_y], self.edges.sponge).to(device)
        self._intervals, self._start = 0, 0.0
        self._at_rest = True
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

    @property
    def transports(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Packed transports in units of a cell in a substep, half a substep before the elevation; see `units`."""
        return self._U, self._V

    @property
    def units(self) -> tuple[float, float]:
        """What makes m²/s of `transports`: Δx/Δt and Δy/Δt."""
        return self.dx / self.time_step, self.dy / self.time_step

    def set_forcing(self, amplitude: np.ndarray, period: np.ndarray, phase: np.ndarray) -> None:
        """Prescribe the elevation Σ a cos(2πt/T + φ) all along the forced edges; at incident ones that of the wave.

        To be called before `set_state`, whose half substep back needs the elevation at the edge.

        Args:
            amplitude, period, phase: a (m), T (s) and φ (rad), (num_seas, components).
        """
        self._amplitude, self._phase = np.asarray(amplitude, np.float64), np.asarray(phase, np.float64)
        self._omega = 2 * math.pi / np.asarray(period, np.float64)
        self._silent = not self.edges.forced or not self._amplitude.any()
        angle = self._omega[:, None, :] * (self.time_step * np.arange(self.substeps))[:, None]
        self._turn = np.concatenate([np.cos(angle), -np.sin(angle)], axis=2)
        self._edge_elevation.zero_()

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
        self._at_rest = True
        self._state.zero_()
        eta = np.broadcast_to(eta, (self.num_seas, self.ny, self.nx))
        scales = self.time_step / self.dx, self.time_step / self.dy
        for first, last in self._chunks(0, self.ny + 1):
            wet = self._rows(first, last, lambda low, high: self.depth[None, low:high] > 0)
            surface = np.where(wet, self._rows(first, last, lambda low, high: eta[:, low:high]), 0.0)
            slopes = self._slopes(surface, first, last)
            h, damping = self._faces(first, last)
            self._packing.pack(surface[:, 1:], self.eta, first)
            self._at_rest = self._at_rest and not surface.any()
            for axis, (velocity, packed) in enumerate(((u, self._U), (v, self._V))):
                transport = self.time_step / 2 * self.gravity * h[axis] * slopes[axis]
                if velocity is not None:
                    part = np.asarray(velocity[:, first:last], np.float64)
                    rows, columns = part.shape[1:]
                    mass = (1 + damping[axis]) * h[axis]
                    transport[:, :rows, :columns] += mass[:rows, :columns] * part
                self._packing.pack(transport * scales[axis], packed, first)
                self._at_rest = self._at_rest and not transport.any()

    def advance(self) -> None:
        """One interval."""
        if not self.still:
            if not self._silent:
                self._tabulate_edge()
            for launch in self._launches:
                launch()
            self._at_rest = False
        self._intervals += 1

    @cached_property
    def _launches(self) -> list[Launch]:
        """What makes an interval."""
        arrays = self.eta, self._U, self._V, *self._C, self._edge_elevation, self._resistance, self._shares_kept
        return self._way.launches(arrays, self._plan, self.edges, self._keep)

    def state(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Copies of the packed fields and of the clock; with the same forcing, `load` brings them back bit for bit."""
        return self._state.clone(), torch.tensor([self._intervals, self._start, self._at_rest], dtype=torch.float64)

    def load(self, fields: torch.Tensor, clock: torch.Tensor) -> None:
        """Go back to what `state` gave."""
        self._state.copy_(fields)
        self._intervals, self._start, self._at_rest = int(clock[0]), float(clock[1]), bool(clock[2])

    def elevation(self) -> np.ndarray:
        """Elevation at cell centres, m, (num_seas, ny, nx), f32; a copy."""
        eta = np.empty((self.num_seas, self.ny, self.nx), np.float32)
        for first, last in self._chunks(0, self.ny):
            eta[:, first:last] = self._packing.unpack(self.eta, first, last)[:, :, :-1]
        return eta

    def velocity(self) -> tuple[np.ndarray, np.ndarray]:
        """Velocities (u, v) at cell centres at `time`, m/s, each (num_seas, ny, nx), f32; zero on land."""
        u, v = np.empty((2, self.num_seas, self.ny, self.nx), np.float32)
        for first, last in self._chunks(0, self.ny):
            h, before, after = self._transports(first, last + 1)
            faces = (before + after) / (2 * np.where(h > 0, h, math.inf)[:, None])
            u[:, first:last] = (faces[0, :, :-1, 1:] + faces[0, :, :-1, :-1]) / 2
            v[:, first:last] = (faces[1, :, 1:, :-1] + faces[1, :, :-1, :-1]) / 2
        return u, v

    def mass(self) -> np.ndarray:
        """Volume above the mean level Σ η Δx Δy, m³, (num_seas,)."""
        eta = (self._packing.unpack(self.eta, *rows)[:, :, :-1] for rows in self._chunks(0, self.ny))
        return sum(part.sum(axis=(1, 2), dtype=np.float64) for part in eta) * self.dx * self.dy

    def energy(self) -> np.ndarray:
        """The scheme's own energy, per density, m⁵/s², (num_seas,).

        ½ Δx Δy (g Σ η² + Σ U⁻U⁺/h + Σ V⁻V⁺/h), U⁻ and U⁺ half a substep before and after η: positive below the
        stability limit, within O(Δt²) the energy ½ g η² + ½ h u², and in exact arithmetic constant without drag where
        edges are walls or held at zero. The faces of an open edge have half a cell each.
        """
        total = np.zeros(self.num_seas)
        for first, last in self._chunks(0, self.ny + 1):
            h, before, after = self._transports(first, last)
            eta = self._packing.unpack(self.eta, first, min(last, self.ny))[:, :, :-1].astype(np.float64)
            total += self.gravity * (eta**2).sum(axis=(1, 2))
            for axis, side in enumerate(before * after / np.where(h > 0, h, math.inf)[:, None]):
                for place in self._open_faces(axis, first, last):
                    side[place] /= 2
                total += side.sum(axis=(1, 2))
        return total * self.dx * self.dy / 2

    def _transports(self, first: int, last: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Depth (2, rows, nx + 1) and transports U and V, m²/s, half a substep before and half a substep after the
        elevation, each (2, num_seas, rows, nx + 1), on western and southern faces of rows `first` to `last` − 1.
        """
        packed = zip((self._U, self._V), self.units, strict=True)
        before = np.stack([self._packing.unpack(W, first, last).astype(np.float64) * unit for W, unit in packed])
        h, damping = self._faces(first, last)
        eta = self._rows(first, last, lambda low, high: self._packing.unpack(self.eta, low, high)[:, :, :-1])
        push = self.time_step * self.gravity * h[:, None] * self._slopes(eta, first, last)
        return h, before, ((1 - damping)[:, None] * before - push) / (1 + damping)[:, None]

    def _chunks(self, first: int, last: int) -> Iterator[tuple[int, int]]:
        """Ranges of rows of about `CHUNK` cells of all seas."""
        step = max(1, CHUNK // (self.num_seas * (self.nx + 1)))
        return ((row, min(row + step, last)) for row in range(first, last, step))

    def _rows(self, first: int, last: int, given: Callable[[int, int], np.ndarray]) -> np.ndarray:
        """Rows `first` − 1 to `last` − 1 of a field of cells, f64; zero beyond the basin."""
        low, high = max(first - 1, 0), min(last, self.ny)
        rows = np.asarray(given(low, high), np.float64)
        return np.pad(rows, ((0, 0), (low - first + 1, last - high), (0, 0)))

    def _open_sides(self, axis: int, first: int, last: int) -> list[Side]:
        """Sides across an axis that are open and have faces in rows `first` to `last` − 1 of 0 to ny."""
        present = {"west": True, "east": True, "south": first == 0, "north": last == self.ny + 1}
        return [side for side, place in PLACES.items() if place[0] == axis and present[side] and self.edges.open(side)]

    def _open_faces(self, axis: int, first: int, last: int) -> list[tuple]:
        return [PLACES[side][2] for side in self._open_sides(axis, first, last)]

    def _faces(self, first: int, last: int) -> tuple[np.ndarray, np.ndarray]:
        """Depth h, m, and damping s of western and southern faces of rows `first` to `last` − 1, (2, rows, nx + 1).

        h = 0 is a wall. s is half the rate of damping times Δt: (1 + s) U⁺ = (1 − s) U⁻ − g h Δt η_x.
        """
        cells = self._rows(first, last, lambda low, high: self.depth[None, low:high])[0]
        h, keep = np.zeros((2, 2, last - first, self.nx + 1))
        h[0, :, 1:-1] = _mean_if_wet(cells[1:, :-1], cells[1:, 1:])
        h[1, :, :-1] = _mean_if_wet(cells[:-1], cells[1:])
        keep[0], keep[1] = self._keep * self._kept[0][0], self._keep * self._kept[1][0][first:last, None]
        damping = (1 - keep) / (1 + keep)
        for axis, size in enumerate((self.dx, self.dy)):
            for side in self._open_sides(axis, first, last):
                _, _, faces, along = PLACES[side]
                h[axis][faces] = cells[along]
                if self.edges.kind[side] in RADIATING:
                    damping[axis][faces] += np.sqrt(self.gravity * cells[along]) * self.time_step / size
        return h, damping

    def _slopes(self, eta: np.ndarray, first: int, last: int) -> np.ndarray:
        """η_x and η_y on the faces of rows `first` to `last` − 1, (2, num_seas, rows, nx + 1), of an elevation with the
        row south of them; at an open edge over the half cell to what is prescribed there.
        """
        slopes = np.zeros((2, self.num_seas, last - first, self.nx + 1))
        slopes[0, :, :, 1:-1] = np.diff(eta[:, 1:], axis=2) / self.dx
        slopes[1, :, :, :-1] = np.diff(eta, axis=1) / self.dy
        prescribed = (self._amplitude * np.cos(self._omega * self.time + self._phase)).sum(axis=1)[:, None]
        for axis, size in enumerate((self.dx, self.dy)):
            for side in self._open_sides(axis, first, last):
                _, end, faces, along = PLACES[side]
                slopes[axis][faces] = end * (SHARE[self.edges.kind[side]] * prescribed - eta[along]) / (size / 2)
        return slopes

    def _coefficients(self, device: torch.device) -> tuple[torch.Tensor, np.ndarray]:
        """C of `march` with equal neighbouring rows once, and which of its rows each row 0 to ny takes."""
        depth, keep = self.depth, self._kept[1][0]
        changes = [] if depth.strides[0] == 0 else [i for i in range(1, self.ny) if (depth[i] != depth[i - 1]).any()]
        damped = np.flatnonzero(np.diff(keep)) + 1
        rows = np.unique([0, 1, *changes, *(i + 1 for i in changes), *damped, self.ny])
        C = torch.empty((2, len(rows), self._packing.columns, LANES), device=device)
        done = 0
        for run in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
            for first, last in self._chunks(run[0], run[-1] + 1):
                h, damping = self._faces(first, last)
                for axis, size in enumerate((self.dx, self.dy)):
                    for place in self._open_faces(axis, first, last):  # the difference is over half a cell
                        h[axis][place] *= 2
                    part = self.gravity * (self.time_step / size) ** 2 * h[axis] / (1 + damping[axis])
                    C[axis, done : done + last - first] = torch.as_tensor(self._packing.spread(part))
                done += last - first
        return C, (np.searchsorted(rows, np.arange(self.ny + 1), side="right") - 1).astype(np.int32)

    def _resistances(self) -> list[np.ndarray]:
        """R of `march` along south (nx,) and north (nx,), west (ny,) and east (ny,).

        With λ = c Δt/Δx and s of the face without its radiation, (1 + s + λ) U⁺ = (1 − s − λ) U⁻ − 2 λ² (η − E) is
        U⁺ = a U⁻ − C (η − (E − R U⁻)), a = (1 − s)/(1 + s), C = 2 λ²/(1 + s + λ), R = 1/(λ (1 + s)).
        """
        resistances = []
        for side, along in (("south", np.s_[0]), ("north", np.s_[-1]), ("west", np.s_[:, 0]), ("east", np.s_[:, -1])):
            axis, end, _, _ = PLACES[side]
            depth = self.depth[along].astype(np.float64)
            keep = self._keep * self._kept[axis][0][0 if end < 0 else -1]
            wave = np.sqrt(self.gravity * depth) * self.time_step / (self.dx, self.dy)[axis]
            passes = (depth > 0) & (self.edges.kind[side] in RADIATING)
            R = np.where(passes, (1 + keep) / 2 / np.where(passes, wave, 1.0), 0.0)
            resistances.append(R)
        return resistances

    def _along_edges(self, fields: list[np.ndarray], used: bool) -> torch.Tensor:
        """Two fields along a row, (n ≤ nx + 1,), and two along a column, (n ≤ ny + 1,), as one array of vectors."""
        if not used:
            return torch.zeros((1, LANES))
        *rows, west, east = fields
        columns = [np.repeat(np.pad(f, (0, self.ny + 1 - len(f)))[:, None], LANES, axis=1) for f in (west, east)]
        vectors = np.concatenate([*(self._packing.spread(f[None])[0] for f in rows), *columns])
        return torch.tensor(vectors, dtype=torch.float32)  # a copy, which begins at a whole vector

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
