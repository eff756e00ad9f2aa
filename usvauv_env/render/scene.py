"""Places of a mission in the perspective view's scene, and the scales of its heights and depths."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from usvauv.env.render import style
from usvauv.env.render.frame_layout import nice, nice_above
from usvauv.env.render.map import TRAIL
from usvauv.env.scenario import Scenario

LEAST_HEIGHT = 0.012  # of the waves' scale over the area's longer side, below which heights are exaggerated
DEPTHS = (0.3, 0.7)  # of the bed's depth over the longer side, beyond which depths are scaled
MOST = 100.0  # exaggeration of heights
WATER = style.colour("#123b56")  # to which lines in the water fade


class Scene(NamedTuple):
    """Scene coordinates are metres from the area's centre at mean sea level: east, north, up.

    Attributes:
        sides: of the area, m. heights, depths: factors by which they are drawn.
        bed, auvs, nodes: heights at which they are drawn, m, below 0.
    """

    sides: tuple[float, float]
    heights: float
    depths: float
    bed: float
    auvs: float
    nodes: float

    @classmethod
    def of(cls, scenario: Scenario, limit: float) -> Scene:
        """The scene of a scenario whose waves have a colour scale that ends at `limit` m; 0 for none."""
        area, longer = scenario.area, max(scenario.area.width, scenario.area.length)
        wanted = LEAST_HEIGHT * longer / limit if limit else 1.0
        heights = min(nice_above(wanted, (1, 2, 5, 10)), MOST) if wanted > 1 else 1.0
        deep = max(area.depth, scenario.auv.depth)
        least, most = DEPTHS[0] * longer / deep, DEPTHS[1] * longer / deep
        depths = nice_above(least, (1, 2, 5, 10)) if least > 1 else nice(most) if most < 1 else 1.0
        bed, auvs = -depths * deep, -depths * scenario.auv.depth
        nodes = auvs if scenario.task == "station-keeping" else bed
        return cls((area.width, area.length), heights, depths, bed, auvs, nodes)

    def place(self, position: np.ndarray, up: float | np.ndarray) -> np.ndarray:
        """Scene coordinates (..., 3) of positions (..., 2) in m, at heights as drawn."""
        flat = np.asarray(position, float) - 0.5 * np.array(self.sides)
        return np.concatenate([flat, np.broadcast_to(np.asarray(up, float)[..., None], (*flat.shape[:-1], 1))], -1)

    def inside(self, line: np.ndarray) -> list[np.ndarray]:
        """The pieces of a line (N, 3) of at least two points that lie within the area and not below the bed."""
        beyond = np.maximum(np.abs(line[:, :2]) - 0.5 * np.array(self.sides), self.bed - line[:, 2:])
        within = np.all(beyond < 1e-6, axis=1)
        breaks = np.flatnonzero(np.diff(within)) + 1
        return [piece for piece in np.split(line, breaks)[0 if within[0] else 1 :: 2] if len(piece) > 1]

    def afloat(self, flat: np.ndarray, heights: np.ndarray) -> np.ndarray:
        """Places (N, 3) on the surface, of heights (Y, X) as drawn, above or below places (N, 2)."""
        x, y = ((flat / self.sides + 0.5) * heights.shape[::-1] - 0.5).astype(np.float32).T
        up = cv2.remap(heights, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.column_stack([flat, up.ravel()])

    @property
    def note(self) -> str:
        """What is exaggerated, in words."""
        parts = [("heights", self.heights), ("depths", self.depths)]
        told = [f"{name} × {factor:g}" for name, factor in parts if factor != 1]
        return ", ".join(told) if told else "true to scale"


def track(t: int, step: float) -> np.ndarray:
    """Steps, at most 60, of a trail that ends at step t, with a mission step in s."""
    first = max(0, t - round(TRAIL / step))
    return np.unique(np.linspace(first, t, min(t - first, 60) + 1).astype(int))
