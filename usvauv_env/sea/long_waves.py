"""Long waves as worlds use them, by the linear solver or by several nonlinear ones, and a watch for divergence."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import torch

from usvauv.kernels import runtime
from usvauv.kernels.errors import DivergenceError
from usvauv.kernels.launch import DeviceFlag
from usvauv.kernels.shallow_water.discretisation import LANES, Packing
from usvauv.kernels.shallow_water.linear import ShallowWater
from usvauv.kernels.shallow_water.nonlinear import NonlinearShallowWater

DRY = 1e4  # m, above every elevation where land may be dry


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
        self.eta, U, V = torch.zeros(shape, device=runtime.start().device)
        self.transports = U, V
        self.fields = self.eta, U, V
        self._pack()

    @property
    def time(self) -> float:
        """Time of the elevation, s."""
        return self._solvers[0].time

    def set_forcing(self, amplitude: np.ndarray, period: np.ndarray, phase: np.ndarray) -> None:
        """As `usvauv.kernels.shallow_water.linear.ShallowWater.set_forcing`, from the next interval on."""
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


class SeaWatch:
    """Advances long waves and looks at their elevation.

    Args:
        sea: to be watched.
        deepest: depth of still water at the deepest place, m; the elevation of a linear sea stays within it.
        named: index of a sea → what to call it in a message.
    """

    def __init__(self, sea: LongWaves, deepest: float, named: Callable[[int], str] = lambda index: "the sea") -> None:
        self._sea = sea
        self._named = named
        self._limit = DRY if isinstance(sea, NonlinearSeas) else deepest
        self._flag = DeviceFlag(sea.fields[0], self._limit)

    def advance(self) -> None:
        """One interval.

        Raises:
            DivergenceError: the sea is not finite or has run away.
        """
        sea = self._sea
        try:
            sea.advance()
        except FloatingPointError as error:
            index, problem = error.args
            raise DivergenceError(f"{self._named(index)}: {problem}") from None
        if self._flag.raised():
            index, value = self._worst()
            problem = f"the elevation is {value:g} m at {sea.time:g} s: must be within {self._limit:g} m"
            raise DivergenceError(f"{self._named(index)}: {problem}")

    def _worst(self) -> tuple[int, float]:
        """The sea that has the first elevation out of bounds, and that elevation, m."""
        elevation = torch.from_numpy(self._sea.elevation())
        elevation = elevation.reshape(-1, self._sea.ny * self._sea.nx)
        places = (~(elevation.abs() <= self._limit)).nonzero()
        index, cell = places[0].tolist() if len(places) else (0, 0)
        return index, float(elevation[index, cell])
