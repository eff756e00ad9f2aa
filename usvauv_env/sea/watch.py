"""Long waves that are watched: a sea that is not finite, or deeper than its bed, stops at once."""

from __future__ import annotations

from collections.abc import Callable

import torch

from usvauv.env.sea.long_waves import LongWaves
from usvauv.kernels.device_flag import DeviceFlag
from usvauv.kernels.errors import DivergenceError

DRY = 1e4  # m, above every elevation where land may be dry


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
        self._limit = DRY if sea.units == (1.0, 1.0) else deepest
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
