"""The water of worlds: long waves, storm and real current, on one clock; and the seeds that decide it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from usvauv.env.scenario.fields import ScenarioError
from usvauv.env.sea.hull import Hull
from usvauv.env.sea.long_waves import LongWaves, boundary_waves, build_sea, speed_bound
from usvauv.env.sea.storm import density, draw_storm, elevation, wave_systems
from usvauv.env.site.site import Site
from usvauv.kernels import runtime
from usvauv.kernels.errors import DivergenceError
from usvauv.kernels.flow import airy
from usvauv.kernels.flow.at_depth import deep_columns
from usvauv.kernels.functions import Launch
from usvauv.kernels.types import Level

LARGEST_SEED = (1 << 64) - 1
SEAS_A_MICROSECOND = 8  # of which a thread sets the phases of the storm
LEAST_CURRENT_BOUND = 0.1  # m/s; a box without extent is not a valid space
NAMED = 8  # of the worlds on a sea, in a message
ROUNDING = 1e-6  # of a ratio of times


def whole_number(name: str, value: object, least: int, most: int) -> int:
    """A whole number of any type as Python's.

    Raises:
        ScenarioError: it is another thing, or out of range.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not least <= value <= most:
        raise ScenarioError(f"{name} = {value!r}: must be a whole number from {least} to {most}")
    return int(value)


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
        """Keys read by the kernels, (W, 3) int32, columns `usvauv.kernels.mission.columns.KeyColumn`."""
        words = self.seed & np.uint64(0xFFFFFFFF), self.seed >> np.uint64(32), self.index
        return np.stack([word.astype(np.uint32) for word in words], axis=1).view(np.int32)

    def seas(self, realisations: int) -> tuple[list[tuple[int, int]], np.ndarray]:
        """Seed and index of each sea that the worlds sail on, and which of these is each world's, (W,).

        World i of a seed sails on the seed's sea i modulo `realisations`.
        """
        seeds, which = np.unique(self.seed, return_inverse=True)
        seas, own = np.unique(which * realisations + self.index % realisations, return_inverse=True)
        return [(int(seeds[sea // realisations]), int(sea % realisations)) for sea in seas], own


class AirySea:
    """Seas of given components at any time.

    Args:
        amplitude, omega, direction, phase: a (m), ω > 0 (rad/s), direction of travel θ (rad from east towards north), φ
            (rad), each (seas, N); N may be 0.
        depth: h, m.
        gravity: g, m/s².
        levels: heights z of the water velocities, −h ≤ z ≤ 0, m.
        step: mission step, s, where the motion is wanted at any depth too, as `usvauv.kernels.flow.at_depth` has it.
        hull: of a boat; without one it follows all waves.

    Attributes:
        k: wave number (seas, N), rad/m.
        wave: table of the components for kernels, torch (seas, groups, columns, LANES); see `usvauv.kernels.flow.airy`.
        felt: groups of these that are felt at the last level, (seas,) int32, `usvauv.kernels.flow.airy.felt`.
        time: s. since: (1,) time since that of the table's phases, s.
    """

    def __init__(
        self,
        amplitude: np.ndarray,
        omega: np.ndarray,
        direction: np.ndarray,
        phase: np.ndarray,
        *,
        depth: float,
        gravity: float,
        levels: Sequence[float],
        step: float | None = None,
        hull: Hull | None = None,
    ) -> None:
        device = runtime.start().device
        self.amplitude, self.omega, self.direction, self.phase = amplitude, omega, direction, phase
        self.k = airy.wavenumber(omega, depth, gravity)
        deep = deep_columns(amplitude, self.k, omega, depth, step) if step else ()
        followed = hull.motion(self.k) if hull else (1.0, 1.0)
        packed = airy.pack(
            amplitude, self.k, direction, omega, depth=depth, levels=levels, followed=followed, more=deep
        )
        self.wave = torch.tensor(packed, device=device)
        self.felt = torch.from_numpy(airy.felt(packed, len(levels) - 1)).to(device)
        start, frequency = (torch.tensor(airy.group(part / airy.TWO_PI), device=device) for part in (phase, omega))
        self._clock = torch.zeros(1, dtype=torch.float64, device=device)
        self._begin = math.nan
        self.since = torch.zeros(1, dtype=torch.float32, device=device)
        self._write_since = runtime.writer(self.since)
        serial = runtime.too_few_for_threads(len(omega) // SEAS_A_MICROSECOND)
        self._set_phases = None
        if omega.size:
            arguments = start, frequency, self._clock, self.wave, serial
            self._set_phases = Launch(airy.set_phases, *arguments, settings=runtime.vectors_in_registers())
        self.set_time(0.0)

    def set_time(self, time: float) -> None:
        """Set the time, s. Phases are reduced in double precision now and then, so that late times lose no digits."""
        self.time = time
        begin = time // airy.PHASES_LAST * airy.PHASES_LAST
        if self._set_phases and begin != self._begin:
            self._clock.fill_(begin)
            self._set_phases()
            self._begin = begin
        self._write_since(time - begin)

    def components(self, sea: int) -> np.ndarray:
        """Waves of one sea: a (m), kx, ky (rad/m), ω (rad/s), φ (rad), (N, 5)."""
        k, direction = self.k[sea], self.direction[sea]
        own = self.amplitude[sea], k * np.cos(direction), k * np.sin(direction), self.omega[sea], self.phase[sea]
        return np.stack(own, axis=-1)

    def elevation(self, sea: int, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Elevation of one sea on the grid of the points x (X,) and y (Y,), (Y, X) float32, m."""
        return elevation(self.components(sea), x, y, self.time)


def build_short_waves(site: Site, seas: Sequence[tuple[int, int]]) -> AirySea:
    """The storm upon the seas of `build_sea`, with velocities at the levels `usvauv.kernels.types.Level`."""
    scenario, boat = site.scenario, site.scenario.boat
    water = {"depth": site.mean_depth, "gravity": scenario.sea.gravity}
    storm = scenario.storm.model_copy(update={"shortest_wave": scenario.shortest_wave})
    drawn = draw_storm(storm, wave_systems(site), seas, **water)
    step = scenario.mission.step if scenario.auv.dynamic else None
    hull = Hull(boat.length, boat.beam, boat.draught) if boat.length else None
    return AirySea(*drawn, **water, levels=(0.0, -min(scenario.auv.depth, site.mean_depth)), step=step, hull=hull)


def advance(sea: LongWaves, named: Callable[[int], str] = lambda index: "the sea") -> None:
    """One interval of long waves; `named` tells what a message calls the sea of an index.

    Raises:
        DivergenceError: a sea is not finite or has run away.
    """
    try:
        sea.advance()
    except FloatingPointError as error:
        index, problem = error.args
        raise DivergenceError(f"{named(index)}: {problem}") from None


class WorldWater:
    """Seas of a batch of worlds, the storm upon them, and the real current. Begins with those of episode 0.

    Args:
        site: whose water it is.
        seeds: of the worlds.
        first_world: number of the first, for messages.
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

    def __init__(self, site: Site, seeds: Seeds, *, first_world: int, fine: bool, device: torch.device) -> None:
        self._site, self._first_world, self._fine = site, first_world, fine
        self.seas, index = seeds.seas(site.scenario.sea.realisations)
        self.sea_index = torch.from_numpy(index.astype(np.int32)).to(device)
        self._flow = site.current
        still = np.zeros((len(Level.names), 1, 1, 2), np.float32)
        self.stream = torch.from_numpy(still if self._flow is None else self._flow.at(0.0)).to(device)
        self.begin(0)

    @torch.inference_mode(False)  # tensors made in torch's inference mode could not be written outside it
    def begin(self, episode: int) -> None:
        """Start the seas of an episode; all worlds that share one sail on it from the same moment."""
        seas, scenario = self.seas_of(episode), self._site.scenario
        cells = scenario.area.cells(scenario.sea.fine_cells) if self._fine else None
        self.long_waves = build_sea(self._site, seas, cells)
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
            advance(self.long_waves, self.named)
        self._set_clock()

    def go_on_under(self, site: Site) -> None:
        """Go on with the forcing and the storm of another site, see `usvauv.env.world.state`."""
        self._site = site
        seas = self.seas_of(self.episode)
        self.long_waves.set_forcing(*boundary_waves(site, seas))
        self.storm = build_short_waves(site, seas)
        self._set_clock()

    def state(self) -> dict[str, torch.Tensor]:
        """Copies of the state that decides the water's future; `load_state` restores it bit for bit."""
        fields, clock = self.long_waves.state()
        episode = torch.tensor([self.episode, self.steps], device="cpu")
        return {"sea": fields, "sea_clock": clock, "sea_episode": episode}

    def load_state(self, state: Mapping[str, torch.Tensor]) -> None:
        """Go back to what `state` gave."""
        episode, steps = state["sea_episode"].tolist()
        self.begin(episode)
        self.steps = steps
        self.long_waves.load_state(state["sea"], state["sea_clock"])
        self._set_clock()

    def arguments(self) -> dict[str, Any]:
        """The water's arguments of the mission's kernel, by name."""
        sea = self.long_waves
        return {
            "stream": self.stream,
            **dict(zip(("eta", "U", "V"), sea.fields, strict=True)),
            **dict(zip(("unit_x", "unit_y"), sea.units, strict=True)),
            "nx": sea.nx,
            "ny": sea.ny,
            "sea_index": self.sea_index,
            "wave": self.storm.wave,
            "since": self.storm.since,
            "felt": self.storm.felt,
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
        more = f" and {len(worlds) - NAMED} more" if len(worlds) > NAMED else ""
        return f"sea of world{'s' if len(worlds) > 1 else ''} {', '.join(map(str, worlds[:NAMED]))}{more}"

    def _updates(self, steps: int) -> int:
        """Number of updates of the long waves in some mission steps: they reach the steps' end or pass it."""
        scenario = self._site.scenario
        return math.ceil(steps * scenario.mission.step / scenario.sea.update_interval - ROUNDING)

    def _set_clock(self) -> None:
        """Bring storm and real current to the time since the seas started."""
        time = self.steps * self._site.scenario.mission.step
        self.storm.set_time(time)
        if self._flow is not None and len(self._flow.times) > 1:
            # Seas run on where only some worlds are reset; the current then stays as it was at the end of the file.
            runtime.upload(self._flow.at(time), self.stream)


def current_bound(site: Site) -> float:
    """Largest speed of the water at an AUV, m/s.

    The sum of all vortices' peak speeds, which no superposition exceeds, the fastest real current, at the surface too
    where AUVs may be shallower than `auv.depth`, the bound of the
    long waves, and six times the rms orbital speed of the storm at cruise depth, exceeded less than once in 10⁸ if
    Gaussian.
    """
    scenario = site.scenario
    current = scenario.current
    shallowest = scenario.auv.shallowest
    fade = math.exp(-shallowest / current.decay_depth) if current.decay_depth else 1.0
    peak = current.fastest * fade + speed_bound(site)
    if (flow := site.current) is not None:
        above = flow.velocity if shallowest < scenario.auv.depth else flow.velocity[:, Level.cruise]
        peak += float(np.linalg.norm(above, axis=-1).max())
    orbital = []
    for waves in wave_systems(site):
        depth, gravity = site.mean_depth, scenario.sea.gravity
        omega, S = density(waves, scenario.shortest_wave, depth, gravity)
        C, _ = airy.decay(airy.wavenumber(omega, depth, gravity), -min(shallowest, depth), depth)
        orbital.append(6 * waves.significant_height / 4 * math.sqrt(np.sum((omega * C) ** 2 * S) / np.sum(S)))
    peak += math.hypot(*orbital)
    return max(1.001 * peak, LEAST_CURRENT_BOUND)  # 0.1 % covers single precision
