"""Seeds of the worlds of a batch: what each world's random numbers and its sea depend on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from usvauv.env.scenario import ScenarioError
from usvauv.env.sea.build import check_seed


@dataclass(frozen=True)
class Seeds:
    """The seed of each world, and which of that seed's worlds it is.

    Attributes:
        seed: (W,) uint64.
        index: (W,) int64, from 0.
    """

    seed: np.ndarray
    index: np.ndarray

    @classmethod
    def of(cls, seed: int | Sequence[int] | np.ndarray, num_worlds: int, first_world: int = 0) -> Seeds:
        """Worlds `first_world` to `first_world` + `num_worlds` − 1 of a seed, or world 0 of each of several.

        Raises:
            ScenarioError: a seed is not a whole number from 0 to 2⁶⁴ − 1; there are several, but not one a world, or
                with a `first_world`.
        """
        several = isinstance(seed, Sequence | np.ndarray)
        numbers = list(seed) if several else [seed]
        for number in numbers:
            check_seed(number)
        if several and len(numbers) != num_worlds:
            raise ScenarioError(f"seed: {len(numbers)} for {num_worlds} worlds; must be one for all, or one for each")
        if several and first_world:
            raise ScenarioError(f"first_world = {first_world}: must be 0 where each world has a seed of its own")
        index = np.zeros(num_worlds, np.int64) if several else np.arange(first_world, first_world + num_worlds)
        return cls(np.broadcast_to(np.array(numbers, np.uint64), num_worlds), index)

    def common(self, chosen: slice = slice(None)) -> int:
        """The seed of which all worlds, or those chosen, are one after another.

        Raises:
            ScenarioError: they have seeds of their own.
        """
        seed, index = self.seed[chosen], self.index[chosen]
        if (seed != seed[0]).any() or (np.diff(index) != 1).any():
            raise ScenarioError("seed: each world has one of its own; must be one for all that are recorded together")
        return int(seed[0])

    def keys(self) -> np.ndarray:
        """What the kernels read, (W, 3) int32, columns `usvauv.kernels.mission.columns.KeyColumn`."""
        words = self.seed & np.uint64(0xFFFFFFFF), self.seed >> np.uint64(32), self.index
        return np.stack([word.astype(np.uint32) for word in words], axis=1).view(np.int32)

    def seas(self, realisations: int) -> tuple[list[tuple[int, int]], np.ndarray]:
        """Seed and index of each sea that the worlds sail on, and which of these is each world's, (W,).

        World i of a seed sails on the seed's sea i modulo `realisations`.
        """
        seeds, which = np.unique(self.seed, return_inverse=True)
        seas, own = np.unique(which * realisations + self.index % realisations, return_inverse=True)
        return [(int(seeds[sea // realisations]), int(sea % realisations)) for sea in seas], own
