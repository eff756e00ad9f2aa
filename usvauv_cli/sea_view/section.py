"""A vertical section through the middle of the area, along the waves."""

from __future__ import annotations

import math

import cv2
import numpy as np

from usvauv.env.sea.storm import wave_systems
from usvauv.env.site.site import Site

POINTS = 241
INWARDS = {"west": 0.0, "south": math.pi / 2, "east": math.pi, "north": -math.pi / 2}  # from an edge, rad

SIDES = ("south", "south-east", "east", "north-east", "north", "north-west", "west", "south-west")


def heading(site: Site) -> float:
    """Direction of the waves, rad from east towards north: the wind sea's mean, else inwards from the forced edge."""
    if systems := wave_systems(site):
        return systems[0].direction
    return INWARDS.get(site.scenario.sea.forced_edge, 0.0)


class Section:
    """The line along the waves from A to B, A in the west, or in the south of a line from south to north.

    Attributes:
        direction: unit vector of the waves' travel, (2,).
        ends: A and B, (2, 2) m. length: from A to B, m. distance: of its points from A, (P,) m. points: (P, 2) m.
        words: where it goes, such as "A (west) to B (east)".
    """

    def __init__(self, site: Site) -> None:
        area, angle = site.scenario.area, heading(site)
        self._size = np.array([area.width, area.length])
        self.direction = direction = np.array([math.cos(angle), math.sin(angle)])
        if round(direction[0], 6) < 0 or (round(direction[0], 6) == 0 and direction[1] < 0):
            direction = -direction
        with np.errstate(divide="ignore"):
            reach = float(np.min(self._size / 2 / np.abs(direction)))
        self.ends = np.stack([self._size / 2 - reach * direction, self._size / 2 + reach * direction])
        self.length = 2 * reach
        self.distance = np.linspace(0, self.length, POINTS)
        self.points = self.ends[0] + self.distance[:, None] * direction
        sector = round(math.atan2(direction[1], direction[0]) / (math.pi / 4))  # −2 to 2
        self.words = f"A ({SIDES[(sector + 6) % 8]}) to B ({SIDES[sector + 2]})"

    def along(self, field: np.ndarray) -> np.ndarray:
        """Values (P,) of a field (Y, X) over the area, row 0 in the south, at the section's points."""
        column, row = (self.points / self._size * (field.shape[1], field.shape[0]) - 0.5).astype(np.float32).T[:, None]
        return cv2.remap(field, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[0].astype(float)
