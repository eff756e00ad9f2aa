"""Linear shallow water on an Arakawa C grid, forward–backward in time (Eq. 6)."""

import math
from collections.abc import Mapping
from functools import cached_property

import numpy as np
import torch

from usvauv.kernels import runtime
from usvauv.kernels.functions import DeviceArrays, Launch
from usvauv.kernels.shallow_water.cellwise import CellwiseBackend
from usvauv.kernels.shallow_water.discretisation import (
    GEOMETRY,
    LANES,
    BasinBoundaries,
    Boundary,
    Discretisation,
    Packing,
    Side,
)
from usvauv.kernels.shallow_water.forcing import Forcing
from usvauv.kernels.shallow_water.wavefront import WavefrontBackend

COURANT = 0.95  # fraction of the stability limit that a substep may use


def beyond(elevation: np.ndarray, largest: float, time: float) -> FloatingPointError:
    """The error of the first of some seas whose elevation (num_seas, ny, nx) is not finite or beyond ±`largest`."""
    places = np.argwhere(~(abs(elevation) <= largest))
    sea, *cell = places[0] if len(places) else (0, 0, 0)
    found = f"the elevation is {elevation[(sea, *cell)]:g} m at {time:g} s: must be within {largest:g} m"
    return FloatingPointError(int(sea), found)


class ShallowWater:
    """Linear shallow-water seas over one bed, in time steps chosen by the solver.

        U_t = −g h η_x − r U,   V_t = −g h η_y − r V,   η_t = −U_x − V_y

    with the transports U = h u, V = h v on the faces of a C grid, η at cell centres, U and V half a substep behind η.
    Second order in space and time. The border of dry cells is a reflecting wall. On the faces of an open boundary the
    difference of η is that over half a cell to the elevation η_f at the face, which leaves the stability limit as it
    is. With outward transport U and celerity c = √(g h) of the cell at the boundary, the kinds of boundaries are

        wall        U = 0
        forced      η_f = E, prescribed: waves from inside are reflected upside down
        incident    η_f = 2 E + U/c: a wave of elevation E enters, and waves from inside leave
        radiating   η_f = U/c (Flather 1976 with a still sea outside): waves leave

    At an angle θ from the normal a radiating (or incident) boundary reflects (1 − cos θ)/(1 + cos θ). The resistance
    U/c is centred in time, as is the drag, so that energy can only be lost.

    For constant forcing and no drag the potential form needs two arrays instead of three, but its rounding in f32 is
    far worse, because a potential is large against its differences between cells (`docs/model.md`).

    Args:
        size: (width, length) of the basin X × Y, m.
        cells: (nx, ny) cells, at least 3 each way.
        depth: still-water depth h at cell centres, m: one number or (ny, nx), not copied; 0 is land. A face has the
            mean depth of its two cells, and 0 beside land.
        interval: time of one `advance`, s.
        gravity: g, m/s².
        drag: rate r of the linear drag, 1/s; taken half at the old and half at the new time.
        boundaries: kind by side; a side that is missing is a "wall".
        num_seas: independent seas over the same bed.
        largest: magnitude, m, of an elevation at which `advance` still goes on.

    Attributes:
        limit: largest stable substep 1/√(g h_max (1/Δx² + 1/Δy²)), s.
        substeps, time_step: substeps of an interval, and their length Δt ≤ 0.95 limit, s.
        boundaries: kinds of the four sides.
        fields: packed η, U and V, as arguments of a `usvauv.kernels.functions.Launch`.

    Raises:
        ValueError: fewer than 3 cells, no water at all, a negative or non-finite depth, an unknown side or kind.
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
        boundaries: Mapping[Side, Boundary] | None = None,
        num_seas: int = 1,
        largest: float = math.inf,
    ) -> None:
        running = runtime.start()
        self.nx, self.ny = cells
        if min(cells) < 3:
            raise ValueError(f"cells: {cells} must be at least 3 each way")
        self.dx, self.dy = size[0] / self.nx, size[1] / self.ny
        self.gravity, self.drag = gravity, drag
        self.num_seas, self.interval, self.largest = num_seas, interval, largest
        self.depth = np.broadcast_to(depth, (self.ny, self.nx))
        deepest = float(self.depth.max())
        if not (0 < deepest < math.inf and self.depth.min() >= 0):
            raise ValueError("depth: must be finite, nowhere negative and somewhere above 0")
        self.boundaries = BasinBoundaries(boundaries)
        self.limit = 1 / math.sqrt(gravity * deepest * (self.dx**-2 + self.dy**-2))
        self.substeps = math.ceil(interval / (COURANT * self.limit))
        self.time_step = interval / self.substeps

        device = running.device
        self._packing = Packing(num_seas, self.nx, self.ny, self.boundaries.outer_columns)
        blocks, columns = self._packing.blocks, self._packing.columns
        cut = self._packing, interval, self.substeps, largest
        if running.on_cpu:
            self._backend = WavefrontBackend(*cut, running.threads)
        else:
            self._backend = CellwiseBackend(*cut)
        spacing = self.dx, self.dy
        self._scheme = Discretisation(
            self._packing, self.depth, spacing, gravity, drag, self.time_step, self.boundaries
        )
        self._C, self._coefficient_row = self._scheme.coefficients(device)
        self._state = torch.zeros((3, blocks, self._backend.rows, columns, LANES), dtype=torch.float32, device=device)
        self._held = DeviceArrays(tuple(self._state))
        self.fields = self._held.arguments
        self._prescribed = torch.zeros((*self._backend.table, LANES), dtype=torch.float32, device=device)
        self._constant = DeviceArrays((*self._C, self._prescribed, self._scheme.resistances().to(device)))
        self._intervals, self._start = 0, 0.0
        self._at_rest = True
        zero = np.zeros((num_seas, 1))
        self.set_forcing(zero, zero + 1, zero)

    @property
    def time(self) -> float:
        """Time of the elevation, s."""
        return self._start + self._intervals * self.interval

    @property
    def still(self) -> bool:
        """Whether nothing moves and nothing forces: `advance` then only counts the time."""
        return self._silent and self._at_rest

    @property
    def eta(self) -> torch.Tensor:
        """Packed elevation (blocks, rows, W, LANES), m; see `usvauv.kernels.shallow_water.discretisation`."""
        return self._packed()[0]

    @property
    def transports(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Packed transports in units of a cell in a substep, half a substep before the elevation; see `units`."""
        _, U, V = self._packed()
        return U, V

    @property
    def units(self) -> tuple[float, float]:
        """Factors Δx/Δt and Δy/Δt that turn `transports` into m²/s."""
        return self.dx / self.time_step, self.dy / self.time_step

    def set_forcing(self, amplitude: np.ndarray, period: np.ndarray, phase: np.ndarray) -> None:
        """Prescribe the elevation Σ a cos(2πt/T + φ) all along forced boundaries; at incident ones that of the wave.

        To be called before `set_state`, whose half substep back needs the elevation at the boundary.

        Args:
            amplitude, period, phase: a (m), T (s) and φ (rad), (num_seas, components).
        """
        self._forcing = Forcing(amplitude, period, phase, self._packing, self.interval, self._prescribed.device)
        self._silent = not self.boundaries.forced or self._forcing.silent
        self.__dict__.pop("_launches", None)

    def set_state(
        self, eta: np.ndarray, u: np.ndarray | None = None, v: np.ndarray | None = None, time: float = 0.0
    ) -> None:
        """Start from an elevation and velocities, all at the same time; the transports are set half a substep back.

        Args:
            eta: (num_seas, ny, nx) elevation at cell centres, m.
            u: (num_seas, ny, nx + 1) eastward velocity at western and eastern faces, m/s; default at rest.
            v: (num_seas, ny + 1, nx) northward velocity at southern and northern faces, m/s; default at rest.
            time: time of the state, s.
        """
        self._start, self._intervals = time, 0
        self._at_rest = True
        self._backend.forget()
        self._state.zero_()
        packed_eta, *packed_transports = self._state
        eta = np.broadcast_to(eta, (self.num_seas, self.ny, self.nx))
        scales = self.time_step / self.dx, self.time_step / self.dy
        scheme, prescribed = self._scheme, self._forcing.at(self.time)
        for first, last in scheme.chunks(0, self.ny + 1):
            wet = scheme.cell_rows(first, last, lambda low, high: self.depth[None, low:high] > 0)
            surface = np.where(wet, scheme.cell_rows(first, last, lambda low, high: eta[:, low:high]), 0.0)
            slopes = scheme.slopes(surface, first, last, prescribed)
            h, damping = scheme.faces(first, last)
            self._packing.pack(surface[:, 1:], packed_eta, first)
            self._at_rest = self._at_rest and not surface.any()
            for axis, (velocity, packed) in enumerate(zip((u, v), packed_transports, strict=True)):
                transport = self.time_step / 2 * self.gravity * h[axis] * slopes[axis]
                if velocity is not None:
                    part = np.asarray(velocity[:, first:last], np.float64)
                    rows, columns = part.shape[1:]
                    damped_depth = (1 + damping[axis]) * h[axis]
                    transport[:, :rows, :columns] += damped_depth[:rows, :columns] * part
                self._packing.pack(transport * scales[axis], packed, first)
                self._at_rest = self._at_rest and not transport.any()

    def advance(self) -> None:
        """One interval.

        Raises:
            FloatingPointError: (index of a sea, what is wrong with it); an elevation is not finite or beyond `largest`.
                With CUDA the next interval raises it.
        """
        if not self.still:
            self._forcing.go_to(self._start, self._intervals)
            for launch in self._launches:
                launch()
            self._at_rest = False
        self._intervals += 1
        if self._backend.exceeded():
            self._backend.forget()
            raise beyond(self.elevation(), self.largest, self.time)

    @cached_property
    def _launches(self) -> list[Launch]:
        """Kernel launches of one interval."""
        return self._backend.launches(
            (*self.fields, *self._constant.arguments),
            self._forcing,
            self._coefficient_row,
            self.boundaries,
            self._scheme.drag_factor,
        )

    def state(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Copies of the packed fields and of the clock; with equal forcing `load_state` restores them bit for bit.

        Without the rows above ny, which depend on the number of threads and are made anew before they are read.
        """
        clock = [self._intervals, self._start, self._at_rest]
        fields = self._packed()[:, :, : self.ny + 1].clone()
        return fields, torch.tensor(clock, dtype=torch.float64, device="cpu")

    def load_state(self, fields: torch.Tensor, clock: torch.Tensor) -> None:
        """Restore what `state` returned."""
        self._backend.forget()
        self._state.zero_()
        self._state[:, :, : self.ny + 1] = fields
        self._intervals, self._start, self._at_rest = int(clock[0]), float(clock[1]), bool(clock[2])

    def elevation(self) -> np.ndarray:
        """Elevation at cell centres, m, (num_seas, ny, nx), f32; a copy."""
        packing = self._packing
        eta = np.empty((packing.num_seas, packing.ny, packing.nx), np.float32)
        for first, last in self._scheme.chunks(0, packing.ny):
            eta[:, first:last] = self._eta(first, last)
        return eta

    def velocity(self) -> tuple[np.ndarray, np.ndarray]:
        """Velocities (u, v) at cell centres at the time of η, m/s, each (num_seas, ny, nx), f32; zero on land."""
        packing = self._packing
        u, v = np.empty((2, packing.num_seas, packing.ny, packing.nx), np.float32)
        for first, last in self._scheme.chunks(0, packing.ny):
            h, before, after = self._transports(first, last + 1)
            faces = (before + after) / (2 * np.where(h > 0, h, math.inf)[:, None])
            u[:, first:last] = (faces[0, :, :-1, 1:] + faces[0, :, :-1, :-1]) / 2
            v[:, first:last] = (faces[1, :, 1:, :-1] + faces[1, :, :-1, :-1]) / 2
        return u, v

    def mass(self) -> np.ndarray:
        """Volume above the mean level Σ η Δx Δy, m³, (num_seas,)."""
        packing, (dx, dy) = self._packing, self._scheme.spacing
        total = np.zeros(packing.num_seas)
        for first, last in self._scheme.chunks(0, packing.ny):
            total += self._eta(first, last).sum(axis=(1, 2), dtype=np.float64)
        return total * dx * dy

    def energy(self) -> np.ndarray:
        """The scheme's own energy, per density, m⁵/s², (num_seas,).

        ½ Δx Δy (g Σ η² + Σ U⁻U⁺/h + Σ V⁻V⁺/h), U⁻ and U⁺ half a substep before and after η: positive below the
        stability limit, within O(Δt²) the energy ½ g η² + ½ h u², and in exact arithmetic constant without drag where
        boundaries are walls or held at zero. The faces of an open boundary count half.
        """
        packing, (dx, dy) = self._packing, self._scheme.spacing
        total = np.zeros(packing.num_seas)
        for first, last in self._scheme.chunks(0, packing.ny + 1):
            h, before, after = self._transports(first, last)
            total += self._scheme.gravity * (self._eta(first, min(last, packing.ny)).astype(np.float64) ** 2).sum(
                (1, 2)
            )
            for axis, faces in enumerate(before * after / np.where(h > 0, h, math.inf)[:, None]):
                for side in self._scheme.open_sides(axis, first, last):
                    faces[GEOMETRY[side].faces] /= 2
                total += faces.sum(axis=(1, 2))
        return total * dx * dy / 2

    def _packed(self) -> torch.Tensor:
        """Packed η, U and V as they are now, (3, blocks, rows, W, LANES)."""
        self._held.fetch()
        return self._state

    def _eta(self, first: int, last: int) -> np.ndarray:
        return self._packing.unpack(self._packed()[0], first, last)[:, :, :-1]

    def _transports(self, first: int, last: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Depth (2, rows, nx + 1) and transports U and V, m²/s, half a substep before and half a substep after the
        elevation, each (2, num_seas, rows, nx + 1), on western and southern faces of rows `first` to `last` − 1.
        """
        scheme = self._scheme
        packed = zip(self._packed()[1:], scheme.spacing, strict=True)
        before = np.stack(
            [scheme.packing.unpack(W, first, last).astype(np.float64) * (d / scheme.time_step) for W, d in packed]
        )
        h, damping = scheme.faces(first, last)
        slopes = scheme.slopes(scheme.cell_rows(first, last, self._eta), first, last, self._forcing.at(self.time))
        push = scheme.time_step * scheme.gravity * h[:, None] * slopes
        return h, before, ((1 - damping)[:, None] * before - push) / (1 + damping)[:, None]
