"""The batched world: many missions side by side, stepped by one kernel."""

from __future__ import annotations

import numpy as np
import torch

from kernels import runtime
from kernels.flow import current, vortex
from kernels.launch import Launch
from kernels.mission import poisson_table, reset, step
from kernels.mission.columns import MEASURES, AuvColumn, BoatColumn, EstimateColumn, NodeColumn, RewardTerm
from kernels.positioning import tracker
from kernels.types import Level
from usvauv_env.scenario import Scenario, ScenarioError
from usvauv_env.sea.forcing import build_sea, build_short_waves, fine_cells
from usvauv_env.site.bed_and_current import bed, real_current
from usvauv_env.world.tables import (
    CURRENT_COMPONENTS,
    UsvStrategy,
    fixed_vortices,
    link_table,
    options,
    pack_parameters,
    sound_layers,
)

MAX_WORLDS = 1 << 22
STATE = ("auv", "node", "vortex", "boat", "estimate", "track", "observation")


def observation_size(scenario: Scenario) -> int:
    """Numbers in one AUV's observation."""
    return 2 * (scenario.auv.count - 1) + 6 + CURRENT_COMPONENTS[scenario.observation.current]


class World:
    """Many independent missions of one scenario, advanced together.

    World w of seed s is the same mission, bit for bit, whatever `num_worlds`, the number of threads and what the other
    worlds do: every random number is addressed by (seed, first_world + w, episode, step, draw). World w sails on sea
    (first_world + w) modulo `sea.realisations`; the seas start anew when all worlds are reset together and run on when
    only some are.

    Observation of AUV k, float32 (num_worlds, num_auvs, observation_size); K AUVs, D the area's diagonal. Positions are
    the estimated ones: of the last fix, or of the tracker:

        index            quantity                                      unit   range
        0 .. 2K-3        for each other AUV j: (x_j − x_k, y_j − y_k)  D      −1 .. 1
        2K-2, 2K-1       target node minus own position                D      −1 .. 1
        2K, 2K+1         own position                                  D      0 .. 1
        2K+2             own last move was refused at the border       –      0 or 1
        2K+3             share of nodes overflowing                    –      0 .. 1
        2K+4             current speed at the AUV (Eq. 4)              m/s    ≥ 0     if observation.current ≠ "none"
        2K+5, 2K+6       current at the AUV, x and y                   m/s    any     if it is "vector" or "profile"
        2K+7 .. 2K+18    current around the AUV, x and y               m/s    any     if it is "profile"

    A current profiler (a horizontal ADCP) measures at 25 m, then at 50 m, on three beams: 1 rad to the right of the
    target's bearing, towards it, 1 rad to the left. It averages over waves: what it sees is vortices and real currents.

    Action, float32 (num_worlds, num_auvs, 2) in [−1, 1]: with auv.action = "vector" the velocity through the water over
    speed_max, its norm clamped into [speed_min, speed_max]; with "polar" heading/π and speed, linear from
    speed_min (−1)
    to speed_max (1).

    Args:
        scenario: what to simulate.
        num_worlds: W ≥ 1.
        seed: any integer from 0 to 2⁶⁴ − 1.
        usv: "fim", "fim-greedy", "fim-horizon", "hold:X,Y" or "centroid", see `UsvStrategy`.
        first_world: index of the first world; World(n, first_world=f) are worlds f .. f+n−1 of a larger batch.
        fine_sea: solve one sea on `sea.fine_cells` cells instead of a pool on `sea.cell_size`; for one world only.
        arch: where to run, see `kernels.runtime.start`.

    Raises:
        ScenarioError: an argument out of range, or an unknown strategy.
        OceanError: a file of `water` does not serve.
        RuntimeUnavailable: `arch` cannot be used here.
    """

    measure_names = MEASURES
    reward_names = RewardTerm.names

    def __init__(
        self,
        scenario: Scenario,
        num_worlds: int = 1,
        seed: int = 0,
        usv: str = "fim",
        *,
        first_world: int = 0,
        fine_sea: bool = False,
        arch: str = "auto",
    ) -> None:
        if not 1 <= num_worlds <= MAX_WORLDS:
            raise ScenarioError(f"num_worlds = {num_worlds}: must be from 1 to {MAX_WORLDS}")
        if not 0 <= seed < 1 << 64:
            raise ScenarioError(f"seed = {seed}: must be from 0 to 2**64 - 1")
        if fine_sea and num_worlds != 1:
            raise ScenarioError(f"num_worlds = {num_worlds}: a finely resolved sea carries exactly one world")
        self.scenario = scenario
        self.num_worlds = num_worlds
        self.num_auvs = scenario.auv.count
        self.seed = seed
        self.strategy = UsvStrategy.parse(usv, scenario)
        self.steps = scenario.mission.steps
        self.observation_size = observation_size(scenario)
        self.device = runtime.start(arch).device
        self._key = (seed & 0xFFFFFFFF, seed >> 32)
        self._first_world = first_world
        self._sea_interval = max(1, round(scenario.sea.update_interval / scenario.mission.step))
        self._fine_sea = fine_sea

        def array(*shape: int) -> torch.Tensor:
            return torch.zeros(shape, dtype=torch.float32, device=self.device)

        num_nodes, num_vortices = scenario.targets, max(scenario.current.vortices, 1)
        team = (num_worlds, self.num_auvs)
        self.auv = array(*team, len(AuvColumn.names))
        self.node = array(num_worlds, num_nodes, len(NodeColumn.names))
        self.vortex = array(num_worlds, num_vortices, 4)
        self.boat = array(num_worlds, len(BoatColumn.names))
        self.estimate = array(*team, len(EstimateColumn.names))
        self.track = array(*(team if scenario.tracker.enabled else (1, 1)), tracker.COLUMNS)
        self.observation = array(*team, self.observation_size)
        self.reward = array(*team)
        self.reward_terms = array(*team, len(RewardTerm.names))
        self._clock = torch.full((num_worlds, 2), -1, dtype=torch.int32, device=self.device)
        self._parameters = self._upload(pack_parameters(scenario, self.strategy, first_world))
        alone = runtime.better_alone(num_worlds * self.num_auvs)
        self._options = options(scenario, self.strategy)._replace(serial=alone)
        self._link = self._upload(link_table(scenario))
        self._layers = self._upload(sound_layers(scenario))
        self._arrivals = self._upload(poisson_table.table(scenario.nodes.arrival_rates, scenario.mission.step))
        self._fixed_vortex = self._upload(fixed_vortices(scenario))
        self._bed = self._upload(bed(scenario))
        self._flow = real_current(scenario)
        self._stream = array(len(Level.names), 1, 1, 2) if self._flow is None else self._upload(self._flow.at(0.0))
        self._evolve_vortices = None
        eddies = scenario.current
        if eddies.viscosity > 0 or eddies.mutual:
            self._room = array(num_worlds, num_vortices, 7)
            self._evolve_vortices = vortex.evolution(
                self.vortex, self._room, scenario.mission.step, eddies.viscosity, eddies.mutual
            )
        self._action = array(*team, 2)
        self._begin_sea(episode=0)

    def reset(self, mask: torch.Tensor | None = None) -> torch.Tensor:
        """Begin the next episode of all worlds, or of those where `mask` (num_worlds,) is true; returns observation."""
        if mask is None:
            episode = int(self._clock[0, 0]) + 1
            if (episode, 0) != (self._sea_episode, self._steps_since_sea):  # else they stand at its beginning
                self._begin_sea(episode)
            mask = torch.ones(self.num_worlds, dtype=torch.bool, device=self.device)
        with runtime.compiled_quickly():
            reset.begin_episodes(
                self._options,
                self._parameters,
                self._arrivals,
                self._link,
                self._layers,
                self._fixed_vortex,
                *self._key,
                mask.to(self.device, torch.uint8).contiguous(),
                *self._sea_arguments,
                self._clock,
                self.auv,
                self.node,
                self.vortex,
                self.boat,
                self.estimate,
                self.track,
                self.observation,
            )
        return self.observation

    def step(self, action: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor, dict]:
        """Advance all worlds by one mission step.

        Args:
            action: (num_worlds, num_auvs, 2) in [−1, 1].

        Raises:
            ValueError: an action of another shape.

        Returns:
            observation (W, K, O); reward (W, K); terminated (W, K): a service ended the learner's value horizon, the
            episode goes on; truncated (W, K): the episode's time is over, call `reset`; info with "reward_terms"
            (W, K, R) named `reward_names` and "measures" (W, K, 6) named `measure_names`. All but terminated and
            truncated are overwritten by the next step.
        """
        if action.shape != self._action.shape:
            raise ValueError(f"action has shape {tuple(action.shape)}: must be {tuple(self._action.shape)}")
        if self._steps_since_sea % self._sea_interval == 0:
            self.sea.advance()
        self._steps_since_sea += 1
        self._set_clock()
        if self._evolve_vortices:
            self._evolve_vortices()
        self._action.copy_(action)
        self._step()
        served = self.auv[..., AuvColumn.service_rate] > 0
        terminated = served if self.scenario.reward.service_terminates else torch.zeros_like(served)
        truncated = (self._clock[:, 1:] >= self.steps).expand(-1, self.num_auvs)
        info = {"reward_terms": self.reward_terms, "measures": self.measures()}
        return self.observation, self.reward, terminated, truncated, info

    def rewind(self) -> None:
        """Make the next `reset` begin the first episode again, as in a new world of the same seed."""
        self._clock.fill_(-1)

    def state(self) -> dict[str, torch.Tensor]:
        """Everything that decides the future of the worlds, as copies; `load` brings it back bit for bit."""
        own = {name: getattr(self, name).clone() for name in STATE}
        own["clock"] = self._clock.clone()
        own["sea"], own["sea_clock"] = self.sea.state()
        own["sea_episode"] = torch.tensor([self._sea_episode, self._steps_since_sea])
        return own

    def load(self, state: dict[str, torch.Tensor]) -> None:
        """Go back to a state that `state` gave for a world of the same scenario, seed and size."""
        episode, steps = state["sea_episode"].tolist()
        self._begin_sea(episode)
        self._steps_since_sea = steps
        self.sea.load_state(state["sea"], state["sea_clock"])
        self._set_clock()
        for name in STATE:
            getattr(self, name).copy_(state[name])
        self._clock.copy_(state["clock"])

    def measures(self) -> torch.Tensor:
        """What the last step cost and brought, (num_worlds, num_auvs, 6), columns `measure_names`."""
        return self.auv[..., AuvColumn.power : AuvColumn.position_error + 1]

    def current(self) -> torch.Tensor:
        """True velocity of the water at each AUV, (num_worlds, num_auvs, 2), m/s: all that `kernels.flow.current`
        names, and the storm.
        """
        return self.auv[..., AuvColumn.current_x : AuvColumn.current_y + 1]

    def current_field(self, flow: torch.Tensor, mask: torch.Tensor, margin: float = 0.0) -> None:
        """True velocity of the water at cruise level, without the storm, into `flow`, m/s.

        Args:
            flow: (num_worlds, rows, columns, 2) float32 on a grid of at least 2 rows and columns, row 0 in the south.
            mask: (num_worlds,) bool, the worlds of which it is wanted; the others' stays.
            margin: distance of the grid's edges from those of the area, m.
        """
        current.on_grid(
            self._parameters,
            self.vortex,
            self._stream,
            *self.sea.transports,
            *self.sea.units,
            self._bed,
            self._lane,
            self.sea.nx,
            self.sea.ny,
            mask.to(self.device, torch.uint8).contiguous(),
            margin,
            flow,
        )

    def _begin_sea(self, episode: int) -> None:
        """Start the seas of an episode; all worlds that share one sail on it from the same moment."""
        pool = self.scenario.sea.realisations
        seed = self.seed + (episode << 64)
        if self._fine_sea:
            first = self._first_world % pool
            self.sea = build_sea(self.scenario, seed, 1, fine_cells(self.scenario), first)
            self.storm = build_short_waves(self.scenario, seed, 1, first)
            lane = torch.zeros(1, dtype=torch.int32)
        else:
            first = self._first_world % pool
            count = min(self.num_worlds, pool)
            if first + count > pool:  # around the end of the pool
                first, count = 0, pool
            self.sea = build_sea(self.scenario, seed, count, first=first)
            self.storm = build_short_waves(self.scenario, seed, count, first=first)
            lane = (torch.arange(self.num_worlds) + self._first_world) % pool - first
        self._lane = lane.to(self.device, torch.int32)
        water = (self.sea.eta, *self.sea.transports, *self.sea.units, self.storm.wave, self._stream, self._bed)
        self._sea_arguments = (*water, self._lane, self.sea.nx, self.sea.ny)
        with runtime.compiled_quickly():
            self._step = Launch(
                step.step,
                self._options,
                self._parameters,
                self._arrivals,
                self._link,
                self._layers,
                *self._key,
                *self._sea_arguments,
                self._action,
                self._clock,
                self.auv,
                self.node,
                self.vortex,
                self.boat,
                self.estimate,
                self.track,
                self.observation,
                self.reward_terms,
                self.reward,
            )
        self._steps_since_sea = 0
        self._sea_episode = episode
        self._set_clock()

    def _set_clock(self) -> None:
        """Bring storm and real current to the time since the seas started."""
        time = self._steps_since_sea * self.scenario.mission.step
        self.storm.set_time(time)
        if self._flow is not None and len(self._flow.times) > 1:
            # Seas run on where only some worlds are reset; the current then stays as it was at the end of the file.
            self._stream.copy_(torch.from_numpy(self._flow.at(min(time, self._flow.times[-1]))))

    def _upload(self, numbers: np.ndarray) -> torch.Tensor:
        return torch.from_numpy(np.ascontiguousarray(numbers, np.float32)).to(self.device)

    def stream(self, level: int) -> np.ndarray:
        """Real current on its grid at a `kernels.mission.columns.Level`, (rows, columns, 2), m/s; empty when there is
        none.
        """
        return self._stream[level].cpu().numpy() if self._flow is not None else np.zeros((0, 0, 2), np.float32)

    def surface(self, pixels: int, world: int = 0) -> np.ndarray:
        """Elevation of a world's sea averaged to at most `pixels` on the longer side, (Y, X), row 0 in the south, m."""
        lane = int(self._lane[world])
        elevation = self.sea.elevation()[lane]
        factor = -(-max(elevation.shape) // pixels)
        rows, columns = (size // factor for size in elevation.shape)
        blocks = elevation[: rows * factor, : columns * factor].reshape(rows, factor, columns, factor)
        x, y = (
            (np.arange(count) + 0.5) * (factor * cell) for count, cell in ((columns, self.sea.dx), (rows, self.sea.dy))
        )
        return blocks.mean(axis=(1, 3), dtype=np.float32) + self.storm.elevation(lane, x, y)
