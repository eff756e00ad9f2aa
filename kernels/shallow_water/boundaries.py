"""Edges of the linear sea: what happens where the basin ends."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

Side = Literal["west", "east", "south", "north"]
Edge = Literal["wall", "forced", "incident", "radiating", "sponge"]

SIDES = ("west", "east", "south", "north")

# Elevation outside each kind of edge, in shares of the prescribed one. A wave that enters past the resistance U/c
# halves: the elevation at the face is E − U/c, and of a wave that runs inwards η = U/c.
SHARE = {"wall": 0.0, "forced": 1.0, "incident": 2.0, "radiating": 0.0, "sponge": 0.0}
RADIATING = ("incident", "radiating", "sponge")  # kinds that let waves out

# The sponge's σ = σ0 d², d from 0 at its inner border to 1 at the edge, with ∫ 2σ/c dx = ABSORPTION. Of the powers 1 to
# 3 and absorptions 1.5 to 5 this pair reflects least where it counts, up to 45° from a layer of one wavelength.
POWER, ABSORPTION = 2, 2.5

# For each side: 0 if it cuts the axis of U, 1 for V; which end of it; its faces in (…, rows, nx + 1), and the cells
# along it in (…, rows + 1, nx), a block of rows with the row south of it.
PLACES = {
    "west": (0, -1, np.s_[..., :, 0], np.s_[..., 1:, 0]),
    "east": (0, 1, np.s_[..., :, -1], np.s_[..., 1:, -1]),
    "south": (1, -1, np.s_[..., 0, :-1], np.s_[..., 1, :]),
    "north": (1, 1, np.s_[..., -1, :-1], np.s_[..., -2, :]),
}


class Edges:
    """Kinds of the four edges of a basin, and the sponges before them.

    Args:
        kinds: kind by side; sides that are missing are walls.
        sponge_width: width of each sponge, m.
        size: (width, length) of the basin, m.

    Attributes:
        kind: of each side.
        forced: whether an elevation is prescribed somewhere.
        radiating, sponge: whether there are edges of these kinds.

    Raises:
        ValueError: unknown side or kind; sponges without a width, or that do not fit into the basin.
    """

    def __init__(
        self, kinds: Mapping[Side, Edge] | None, sponge_width: float | None, size: tuple[float, float]
    ) -> None:
        kinds = dict(kinds or {})
        for side, kind in kinds.items():
            if side not in SIDES or kind not in SHARE:
                raise ValueError(f"edges: {side!r}: {kind!r} is not one of {SIDES} with one of {tuple(SHARE)}")
        self.kind = {side: kinds.get(side, "wall") for side in SIDES}
        self.forced = any(SHARE[kind] > 0 for kind in kinds.values())
        self.radiating = any(kind in RADIATING for kind in kinds.values())
        self.sponge = "sponge" in kinds.values()
        self.sponge_width = sponge_width
        if self.sponge != (sponge_width is not None):
            raise ValueError("sponge_width: is needed where an edge is a sponge, and nowhere else")
        for length, ends in zip(size, (SIDES[:2], SIDES[2:]), strict=True):
            sponges = sum(self.kind[side] == "sponge" for side in ends)
            if sponges and not 0 < sponges * sponge_width <= length:
                raise ValueError(f"sponge_width: {sponge_width} m must be above 0 and fit into {length} m")

    def open(self, side: Side) -> bool:
        """Whether water passes this side."""
        return self.kind[side] != "wall"

    @property
    def outer_columns(self) -> int:
        """Columns of outer cells that a packed field needs: the western and the eastern edge can share one."""
        return 1 + (self.open("west") and self.open("east"))

    def shares(self) -> list[float]:
        """Elevation outside each side in shares of the prescribed one; −1 for walls."""
        return [SHARE[self.kind[side]] if self.open(side) else -1.0 for side in SIDES]

    def kept(
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
        places = np.arange(n + 1.0), np.arange(n) + 0.5
        rates = [np.zeros(n + 1), np.zeros(n)]
        for side in SIDES[2 * axis : 2 * axis + 2]:
            if self.kind[side] == "sponge":
                width = self.sponge_width / cell
                reached = min(n, int(np.ceil(width)))
                layer = slice(reached) if PLACES[side][1] < 0 else slice(n - reached, None)
                deepest = depth[:, layer].max() if axis == 0 else depth[layer].max()
                greatest = (POWER + 1) * ABSORPTION / 2 * np.sqrt(gravity * deepest) / self.sponge_width
                for rate, place in zip(rates, places, strict=True):
                    distance = place if PLACES[side][1] < 0 else n - place
                    rate += greatest * np.maximum(1 - distance / width, 0) ** POWER
        return tuple(np.exp(-rate * time_step) for rate in rates)
