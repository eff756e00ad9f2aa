"""Common parts of a sea's figure and video: its surface in colours, a section along the waves, its weather in words."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np

from usvauv.env.render import style
from usvauv.env.render.views.sea_surface import MapView, SeaSurface
from usvauv.env.sea.simulation import SeaSimulation
from usvauv.env.sea.storm import wave_systems
from usvauv.env.site.site import Site

SHADED = 480  # largest side of the surface as it is shaded, pixels
LEAST_LIMIT = 0.3  # m; ripples on a calm sea do not fill the scale
LEVEL_SHARE = 0.25  # a mean level below this share of the usual deviation counts as zero
LONG_WAVES = style.colour("#ffb020")
POINTS = 241  # of a section
INWARDS = {"west": 0.0, "south": math.pi / 2, "east": math.pi, "north": -math.pi / 2}  # from an edge, rad

SIDES = ("south", "south-east", "east", "north-east", "north", "north-west", "west", "south-west")


class LevelSurface(SeaSurface):
    """Relief of a sea."""

    def __init__(self, sample: np.ndarray, view: MapView, usual: np.ndarray) -> None:
        """Arguments are those of `SeaSurface`; `usual` are elevations of all times, whose median is the level."""
        median = float(np.median(usual))
        deviation = float(np.quantile(np.abs(usual - median), 0.99))
        # Elevation in the middle of the colour scale, m, to the decimetre; 0 where the sea moves much farther than it.
        self.level = round(median, 1) if abs(median) > LEVEL_SHARE * deviation else 0.0
        super().__init__(sample - np.float32(self.level), view, SHADED)
        if self.limit:
            self.limit = max(self.limit, LEAST_LIMIT)

    @property
    def stillness(self) -> str:
        """Why nothing moves; empty where something does."""
        if self.limit:
            return ""
        return f"level at η = {self.level:g} m" if self.level else "still: neither long waves nor a storm"

    def relief(self, field: np.ndarray) -> np.ndarray:
        return super().relief(field - np.float32(self.level))


class Section:
    """The line along the waves from A to B, A in the west, or in the south of a line from south to north.

    Attributes:
        direction: unit vector of the waves' travel, (2,).
        ends: A and B, (2, 2) m. length: from A to B, m. distance: of its points from A, (P,) m. points: (P, 2) m.
        words: where it goes, such as "A (west) to B (east)".
    """

    def __init__(self, site: Site) -> None:
        area, systems = site.scenario.area, wave_systems(site)
        # The mean of the wind sea, else inwards from the forced edge; rad from east towards north.
        angle = systems[0].direction if systems else INWARDS.get(site.scenario.sea.forced_edge, 0.0)
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


def thumbnail(field: np.ndarray) -> np.ndarray:
    """A field reduced to at most `SHADED` cells a side."""
    rows, columns = field.shape
    shrink = SHADED / max(rows, columns)
    if shrink >= 1.0:
        return field
    size = max(2, round(columns * shrink)), max(2, round(rows * shrink))
    return cv2.resize(field, size, interpolation=cv2.INTER_AREA)


def land(sea: SeaSimulation, width: int, height: int) -> np.ndarray:
    """Mask (height, width) of the land in a picture of the area, the north on top."""
    dry = (~sea.wet[::-1]).astype(np.float32)
    return cv2.resize(dry, (width, height), interpolation=cv2.INTER_AREA) > 0.5


def weather(sea: SeaSimulation) -> str:
    """The forcing of the sea in a few words."""
    storm, names = sea.scenario.storm, {"jonswap": "JONSWAP", "pm": "Pierson–Moskowitz", "tma": "TMA"}
    words = []
    if (waves := sea.site.waves) is not None:
        words += [
            f"{Path(waves.path).name} Hs {system.significant_height:.3g} m, Tp {system.peak_period:.3g} s"
            for system in wave_systems(sea.site)
        ]
    elif storm.spectrum != "none":
        words.append(f"{names[storm.spectrum]} Hs {storm.significant_height:g} m, Tp {storm.peak_period:g} s")
        words += [f"swell Hs {height:g} m, Tp {period:g} s" for height, period, *_ in storm.swells]
    if not getattr(sea.long_waves, "still", False):
        words.append("long waves")
    return " and ".join(words) or "still water"
