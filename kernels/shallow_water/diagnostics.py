"""Diagnostics of the linear solver, in f64 by chunks of rows: velocity, mass and energy from the packed fields."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import numpy as np
import torch

from usvauv.kernels.shallow_water.boundaries import GEOMETRY
from usvauv.kernels.shallow_water.discretisation import Discretisation


class Diagnostics(ABC):
    """Diagnostics of a solver that has a discretisation and the packed fields η, U and V."""

    _scheme: Discretisation

    @abstractmethod
    def _packed(self) -> torch.Tensor:
        """Packed η, U and V, (3, blocks, rows, W, LANES)."""

    @abstractmethod
    def _prescribed_now(self) -> np.ndarray:
        """Prescribed elevation at the time of η, m, (num_seas, 1)."""

    def elevation(self) -> np.ndarray:
        """Elevation at cell centres, m, (num_seas, ny, nx), f32; a copy."""
        packing = self._scheme.packing
        eta = np.empty((packing.num_seas, packing.ny, packing.nx), np.float32)
        for first, last in self._scheme.chunks(0, packing.ny):
            eta[:, first:last] = self._eta(first, last)
        return eta

    def velocity(self) -> tuple[np.ndarray, np.ndarray]:
        """Velocities (u, v) at cell centres at the time of η, m/s, each (num_seas, ny, nx), f32; zero on land."""
        packing = self._scheme.packing
        u, v = np.empty((2, packing.num_seas, packing.ny, packing.nx), np.float32)
        for first, last in self._scheme.chunks(0, packing.ny):
            h, before, after = self._transports(first, last + 1)
            faces = (before + after) / (2 * np.where(h > 0, h, math.inf)[:, None])
            u[:, first:last] = (faces[0, :, :-1, 1:] + faces[0, :, :-1, :-1]) / 2
            v[:, first:last] = (faces[1, :, 1:, :-1] + faces[1, :, :-1, :-1]) / 2
        return u, v

    def mass(self) -> np.ndarray:
        """Volume above the mean level Σ η Δx Δy, m³, (num_seas,)."""
        packing, (dx, dy) = self._scheme.packing, self._scheme.spacing
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
        packing, (dx, dy) = self._scheme.packing, self._scheme.spacing
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

    def _eta(self, first: int, last: int) -> np.ndarray:
        return self._scheme.packing.unpack(self._packed()[0], first, last)[:, :, :-1]

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
        slopes = scheme.slopes(scheme.cell_rows(first, last, self._eta), first, last, self._prescribed_now())
        push = scheme.time_step * scheme.gravity * h[:, None] * slopes
        return h, before, ((1 - damping)[:, None] * before - push) / (1 + damping)[:, None]
