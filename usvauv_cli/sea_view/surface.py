"""The surface of a sea as relief, coloured about its mean level."""

from __future__ import annotations

import numpy as np

from usvauv.env.render.layout import MapView
from usvauv.env.render.sea import SeaSurface

SHADED = 480  # largest side of the surface as it is shaded, pixels
LEAST_LIMIT = 0.3  # m; ripples on a calm sea do not fill the scale
LEVEL_SHARE = 0.25  # of the usual deviation, below which a mean level is none of its own


class LevelSurface(SeaSurface):
    """Relief of a sea.

    Attributes:
        level: elevation in the middle of the colour scale, m: the usual one to the decimetre, 0 where the sea moves
            much farther than that.
    """

    def __init__(self, sample: np.ndarray, view: MapView, usual: np.ndarray) -> None:
        """As `SeaSurface`; `usual` are elevations all over the time shown, whose median is the level."""
        median = float(np.median(usual))
        deviation = float(np.quantile(np.abs(usual - median), 0.99))
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
