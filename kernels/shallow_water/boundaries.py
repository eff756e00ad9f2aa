"""Boundaries of a basin: sides, kinds, and the sponges of the linear solver."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, NamedTuple

import numpy as np

Side = Literal["west", "east", "south", "north"]
Boundary = Literal["wall", "forced", "incident", "radiating", "sponge"]

SIDES: tuple[Side, ...] = ("west", "east", "south", "north")
WEST, EAST, SOUTH, NORTH = range(4)

# Elevation outside each kind of boundary as a multiple of the prescribed one. A wave that enters past the resistance
# U/c halves: the elevation at the face is E − U/c, and of a wave that runs inwards η = U/c.
ELEVATION_FACTOR = {"wall": 0.0, "forced": 1.0, "incident": 2.0, "radiating": 0.0, "sponge": 0.0}
RADIATING = ("incident", "radiating", "sponge")  # kinds that let waves out

# The sponge's σ = σ0 d², d from 0 at its inner border to 1 at the boundary, with ∫ 2σ/c dx = ABSORPTION. Of the powers
# 1 to 3 and absorptions 1.5 to 5 this pair reflects least up to 45° from a layer of one wavelength.
POWER, ABSORPTION = 2, 2.5


class SideGeometry(NamedTuple):
    """Where a side lies."""

    axis: int  # 0 if it cuts the axis of U, 1 for V
    outward: int  # sign of the transport that leaves
    faces: tuple  # its faces in an array (…, rows, nx + 1)
    cells: tuple  # the cells along it in an array (…, rows + 1, nx) that begins one row further south


GEOMETRY: dict[Side, SideGeometry] = {
    "west": SideGeometry(0, -1, np.s_[..., :, 0], np.s_[..., 1:, 0]),
    "east": SideGeometry(0, 1, np.s_[..., :, -1], np.s_[..., 1:, -1]),
    "south": SideGeometry(1, -1, np.s_[..., 0, :-1], np.s_[..., 1, :]),
    "north": SideGeometry(1, 1, np.s_[..., -1, :-1], np.s_[..., -2, :]),
}


def complete_kinds(kinds: Mapping[Side, str] | None, known: tuple[str, ...]) -> dict[Side, str]:
    """Kind of each of the four sides; those that `kinds` leaves out are walls.

    Raises:
        ValueError: unknown side, or a kind that is not in `known`.
    """
    kinds = dict(kinds or {})
    for side, kind in kinds.items():
        if side not in SIDES or kind not in known:
            raise ValueError(f"boundaries: {side!r}: {kind!r} is not one of {SIDES} with one of {known}")
    return {side: kinds.get(side, "wall") for side in SIDES}


class BasinBoundaries:
    """Kinds of the four boundaries of a basin, and the sponges before them.

    Args:
        kinds: kind by side; sides that are missing are walls.
        sponge_width: width of each sponge, m; needed if there is one, else None.
        size: (width, length) of the basin, m.

    Attributes:
        kind: of each side.
        forced: whether an elevation is prescribed somewhere.
        radiating, sponge: whether there are boundaries of these kinds.

    Raises:
        ValueError: unknown side or kind; sponges without a width, or that do not fit into the basin.
    """

    def __init__(
        self, kinds: Mapping[Side, Boundary] | None, sponge_width: float | None, size: tuple[float, float]
    ) -> None:
        self.kind = complete_kinds(kinds, tuple(ELEVATION_FACTOR))
        self.forced = any(ELEVATION_FACTOR[kind] > 0 for kind in self.kind.values())
        self.radiating = any(kind in RADIATING for kind in self.kind.values())
        self.sponge = "sponge" in self.kind.values()
        if self.sponge != (sponge_width is not None):
            raise ValueError("sponge_width: is needed where a boundary is a sponge, and nowhere else")
        self.sponge_width = sponge_width or 0.0
        for length, ends in zip(size, (SIDES[:2], SIDES[2:]), strict=True):
            sponges = sum(self.kind[side] == "sponge" for side in ends)
            if sponges and not 0 < sponges * self.sponge_width <= length:
                raise ValueError(f"sponge_width: {sponge_width} m must be above 0 and fit into {length} m")

    def open(self, side: Side) -> bool:
        """Whether water passes this side."""
        return self.kind[side] != "wall"

    @property
    def outer_columns(self) -> int:
        """Columns of outer cells that a packed field needs: the western and the eastern boundary can share one."""
        return 1 + (self.open("west") and self.open("east"))

    def elevation_factors(self) -> list[float]:
        """Factor on the prescribed elevation for each side; −1 for a wall."""
        return [ELEVATION_FACTOR[self.kind[side]] if self.open(side) else -1.0 for side in SIDES]

    def sponge_factors(
        self, axis: int, depth: np.ndarray, gravity: float, cell: float, time_step: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Factors e^{−σΔt} ≤ 1 of the sponges of an axis, at faces (n + 1,) and at cell centres (n,).

        Args:
            axis: 0 for west and east, 1 for south and north.
            depth: (ny, nx), m; the celerity in σ is that of the deepest water in the layer.
            gravity: m/s².
            cell: size of a cell, m.
            time_step: Δt, s.
        """
        n = depth.shape[1 - axis]
        faces, centres = np.arange(n + 1.0), np.arange(n) + 0.5
        rates = np.zeros(n + 1), np.zeros(n)
        for side in SIDES[2 * axis : 2 * axis + 2]:
            if self.kind[side] == "sponge":
                width = self.sponge_width / cell
                reached = min(n, int(np.ceil(width)))
                low_end = GEOMETRY[side].outward < 0
                layer = slice(reached) if low_end else slice(n - reached, None)
                deepest = depth[:, layer].max() if axis == 0 else depth[layer].max()
                greatest = (POWER + 1) * ABSORPTION / 2 * np.sqrt(gravity * deepest) / self.sponge_width
                for rate, points in zip(rates, (faces, centres), strict=True):
                    distance = points if low_end else n - points
                    rate += greatest * np.maximum(1 - distance / width, 0) ** POWER
        return np.exp(-rates[0] * time_step), np.exp(-rates[1] * time_step)
