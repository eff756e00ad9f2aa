"""What a world needs of the solver of its long waves, linear or nonlinear."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import torch


class LongWaves(Protocol):
    """Independent seas over one bed on nx × ny cells, advanced together.

    Attributes:
        fields: packed elevation and transports, each (blocks, rows, W, LANES), as arguments of a `Launch`; see
            `usvauv.kernels.shallow_water.discretisation`.
        nx, ny: cells. dx, dy: their size, m.
        interval: time of one `advance`, s. time: that of the elevation, s.
        eta: packed elevation as it is now, m.
        transports: packed transports U, V through western and southern faces as they are now; times `units` in m²/s.
        units: factors that turn `transports` into m²/s.
    """

    fields: tuple[Any, ...]
    nx: int
    ny: int
    dx: float
    dy: float
    interval: float

    @property
    def time(self) -> float: ...

    @property
    def eta(self) -> torch.Tensor: ...

    @property
    def transports(self) -> tuple[torch.Tensor, torch.Tensor]: ...

    @property
    def units(self) -> tuple[float, float]: ...

    def set_forcing(self, amplitude: np.ndarray, period: np.ndarray, phase: np.ndarray) -> None:
        """Prescribe the elevation Σ a cos(2πt/T + φ) along the forced edge, or the wave that comes in there.

        Args:
            amplitude, period, phase: a (m), T (s) and φ (rad), (num_seas, components).
        """

    def advance(self) -> None:
        """One interval.

        Raises:
            FloatingPointError: (index of a sea, what is wrong with it).
        """

    def elevation(self) -> np.ndarray:
        """Elevation at cell centres, m, (num_seas, ny, nx), f32; a copy."""
        ...

    def velocity(self) -> tuple[np.ndarray, np.ndarray]:
        """Velocities (u, v) at cell centres, m/s, each (num_seas, ny, nx), f32; zero on land."""
        ...

    def state(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Copies of fields and clocks."""
        ...

    def load_state(self, fields: torch.Tensor, clock: torch.Tensor) -> None:
        """Restore what `state` returned, bit for bit."""
