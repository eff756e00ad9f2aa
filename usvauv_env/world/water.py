"""The water that worlds sail on: long waves, storm and real current, on one clock; and the seeds that decide it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from usvauv.env.scenario import Scenario, ScenarioError
from usvauv.env.sea.build import LARGEST_SEED, boundary_waves, build_sea, build_short_waves, fine_cells, whole_number
from usvauv.env.sea.long_waves import LongWaves, SeaWatch
from usvauv.env.sea.storm import AirySea
from usvauv.env.site.site import Site
from usvauv.env.world import tables
from usvauv.kernels import runtime
from usvauv.kernels.mission.run import draw_vortices
from usvauv.kernels.types import Level


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
            whole_number("seed", number, 0, LARGEST_SEED)
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


NAMED = 8  # of the worlds on a sea, in a message
ROUNDING = 1e-6  # of a ratio of times


class WorldWater:
    """Seas of a batch of worlds, the storm upon them, and the real current. Begins with those of episode 0.

    Args:
        site: whose water it is.
        seeds: of all worlds whose seas are solved.
        worlds: which of these sail here.
        first_world: number of the first that sails here, for messages.
        fine: solve the sea on `sea.fine_cells` cells instead of on `sea.cell_size`.
        device: of the tensors.

    Attributes:
        seas: seed and index of each sea.
        sea_index: (W,) int32, on which of the seas a world sails.
        stream: (levels, rows, columns, 2) float32, the real current now, m/s, `usvauv.kernels.flow.current.Water`.
        long_waves, storm: of the episode.
        episode: of the seas. steps: of a mission since they started.
    """

    long_waves: LongWaves
    storm: AirySea
    episode: int
    steps: int

    def __init__(
        self, site: Site, seeds: Seeds, worlds: slice, *, first_world: int, fine: bool, device: torch.device
    ) -> None:
        self._site, self._first_world, self._fine = site, first_world, fine
        self.seas, index = seeds.seas(site.scenario.sea.realisations)
        self.sea_index = torch.from_numpy(index[worlds].astype(np.int32)).to(device)
        self._flow = site.current
        still = np.zeros((len(Level.names), 1, 1, 2), np.float32)
        self.stream = torch.from_numpy(still if self._flow is None else self._flow.at(0.0)).to(device)
        self.begin(0)

    def begin(self, episode: int) -> None:
        """Start the seas of an episode; all worlds that share one sail on it from the same moment."""
        seas, scenario = self.seas_of(episode), self._site.scenario
        self.long_waves = build_sea(self._site, seas, fine_cells(scenario) if self._fine else None)
        deepest = float(self._site.still_depth((self.long_waves.nx, self.long_waves.ny)).max())
        self._watch = SeaWatch(self.long_waves, deepest, self.named)
        self.storm = build_short_waves(self._site, seas)
        self.episode, self.steps = episode, 0
        self._set_clock()

    def is_at_beginning_of(self, episode: int) -> bool:
        """Whether the seas are those of an episode, and have not moved yet."""
        return (self.episode, self.steps) == (episode, 0)

    def advance(self) -> None:
        """One mission step.

        Raises:
            DivergenceError: a sea is not finite or has run away.
        """
        done = self._updates(self.steps)
        self.steps += 1
        for _ in range(self._updates(self.steps) - done):
            self._watch.advance()
        self._set_clock()

    def go_on_under(self, site: Site) -> None:
        """Go on with the forcing and the storm of another site, see `usvauv.env.world.state`."""
        self._site = site
        seas = self.seas_of(self.episode)
        self.long_waves.set_forcing(*boundary_waves(site, seas))
        self.storm = build_short_waves(site, seas)
        self._set_clock()

    def state(self) -> dict[str, torch.Tensor]:
        """Copies of what decides the future of the water; `load_state` brings it back bit for bit."""
        fields, clock = self.long_waves.state()
        return {"sea": fields, "sea_clock": clock, "sea_episode": torch.tensor([self.episode, self.steps])}

    def load_state(self, state: Mapping[str, torch.Tensor]) -> None:
        """Go back to what `state` gave."""
        episode, steps = state["sea_episode"].tolist()
        self.begin(episode)
        self.steps = steps
        self.long_waves.load_state(state["sea"], state["sea_clock"])
        self._set_clock()

    def arguments(self) -> dict[str, Any]:
        """What the mission's kernel reads of the water, by the names of its arguments."""
        sea = self.long_waves
        (eta, U, V), (unit_x, unit_y) = sea.fields, sea.units
        return {
            "stream": self.stream,
            "eta": eta,
            "U": U,
            "V": V,
            "unit_x": unit_x,
            "unit_y": unit_y,
            "nx": sea.nx,
            "ny": sea.ny,
            "sea_index": self.sea_index,
            "wave": self.storm.wave,
        }

    def mean_elevation(self, pixels: int, world: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Elevation of a world's long waves on at most `pixels` on the longer side, and from about half of that on:
        averaged over finer cells, or bilinear between coarser ones.

        Returns:
            (Y, X), row 0 in the south, m; the middles x (X,) and y (Y,) of what is averaged, m.
        """
        sea = self.long_waves
        elevation = sea.elevation()[int(self.sea_index[world])]
        finer = max(1, pixels // (2 * max(elevation.shape)))
        if finer > 1:
            planes = torch.from_numpy(elevation)[None, None]
            elevation = torch.nn.functional.interpolate(planes, scale_factor=finer, mode="bilinear")[0, 0].numpy()
        factor = -(-max(elevation.shape) // pixels)
        rows, columns = (size // factor for size in elevation.shape)
        blocks = elevation[: rows * factor, : columns * factor].reshape(rows, factor, columns, factor)
        x, y = (
            (np.arange(count) + 0.5) * (factor / finer * cell) for count, cell in ((columns, sea.dx), (rows, sea.dy))
        )
        return blocks.mean(axis=(1, 3), dtype=np.float32), x, y

    def seas_of(self, episode: int) -> list[tuple[int, int]]:
        """Seed and index of each sea of an episode."""
        return [(seed + (episode << 64), index) for seed, index in self.seas]

    def named(self, index: int) -> str:
        """A sea, by the worlds that sail on it."""
        worlds = ((self.sea_index == index).nonzero().flatten() + self._first_world).tolist()
        names = ", ".join(map(str, worlds[:NAMED])) + (
            f" and {len(worlds) - NAMED} more" if len(worlds) > NAMED else ""
        )
        return f"sea of world{'s' if len(worlds) > 1 else ''} {names}"

    def _updates(self, steps: int) -> int:
        """Updates of the long waves in some mission steps: as many as bring them to the steps' end or beyond it."""
        scenario = self._site.scenario
        return math.ceil(steps * scenario.mission.step / scenario.sea.update_interval - ROUNDING)

    def _set_clock(self) -> None:
        """Bring storm and real current to the time since the seas started."""
        time = self.steps * self._site.scenario.mission.step
        self.storm.set_time(time)
        if self._flow is not None and len(self._flow.times) > 1:
            # Seas run on where only some worlds are reset; the current then stays as it was at the end of the file.
            runtime.upload(self._flow.at(min(time, self._flow.times[-1])), self.stream)


def first_vortices(scenario: Scenario, seed: int, arch: str = "auto") -> torch.Tensor:
    """The vortices of world 0 of a seed as its first episode begins, (1, V, 4) as in `usvauv.kernels.flow.vortex`.

    Raises:
        ScenarioError: the seed is out of range.
        RuntimeUnavailable: `arch` cannot be used here.
    """
    seeds = Seeds.of(seed, 1)
    device = runtime.start(arch).device
    site, drawn = Site(scenario), torch.zeros((1, scenario.current.vortices, 4), device=device)
    if drawn.numel():
        parameters, fixed = (
            torch.from_numpy(np.ascontiguousarray(table, np.float32)).to(device)
            for table in (tables.pack_parameters(site, tables.link_table(site)), tables.fixed_vortices(scenario))
        )
        clock = torch.zeros((1, 2), dtype=torch.int32, device=device)
        draw_vortices(parameters, fixed, torch.from_numpy(seeds.keys()).to(device), clock, drawn)
    return drawn
