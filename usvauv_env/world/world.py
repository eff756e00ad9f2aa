"""The batched world: many missions side by side, stepped by one kernel."""

from __future__ import annotations

import reprlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch

from usvauv.env.scenario.fields import ScenarioError
from usvauv.env.scenario.scenario import Scenario
from usvauv.env.sea.long_waves import LongWaves
from usvauv.env.sea.water import AirySea, Seeds, WorldWater, whole_number
from usvauv.env.site.site import Site
from usvauv.env.storage.memory import require
from usvauv.env.world import boat_speed, mission_parameters
from usvauv.env.world.mission_kernels import MissionKernels, workspace_numbers
from usvauv.env.world.observation_layout import ObservationLayout
from usvauv.env.world.state import (
    ADJUSTABLE,
    DECISIONS,
    Numbers,
    allocate,
    array_shapes,
    check_same,
    checked_state,
    first_fault,
    mask_of,
    numbers_of,
    padded_length,
)
from usvauv.env.world.strategy_choice import StrategyChoice
from usvauv.kernels import runtime
from usvauv.kernels.errors import DivergenceError
from usvauv.kernels.flow import current
from usvauv.kernels.flow.vortex import Vortex
from usvauv.kernels.mission.boats.boat_strategies import AGENT
from usvauv.kernels.mission.columns import (
    AuvColumn,
    BoatColumn,
    EstimateColumn,
    ExchangeColumn,
    ForesightColumn,
    NodeColumn,
    Parameter,
)
from usvauv.kernels.mission.episode import draw_vortices
from usvauv.kernels.mission.worlds import REWARDS, STATE
from usvauv.kernels.positioning import tracker

NOT_BEGUN = "no episode has begun: call reset first"
ARRAYS = *STATE, *REWARDS
MAX_WORLDS = 1 << 22
MOST_WORLDS = 1 << 32  # of a seed
MEASURED, CURRENT = AuvColumn.span("power", "position_error"), AuvColumn.span("current_x", "current_y")
WORKSPACE = 1.5  # memory of worlds, including temporary arrays of a step, over the memory of their state


class Step(NamedTuple):
    """The result of a step of `World`. W worlds, K AUVs.

    All tensors are views of the worlds' memory: the next step or reset overwrites them. To keep them, take a `clone`.

    Attributes:
        observation: (W, K, O) float32, the terms of `World.observation_layout`.
        reward: (W, K) float32, the sum of the weighted reward terms.
        horizon_ended: (W, K) bool, a service ended the learner's value horizon; the episode goes on.
        truncated: (W, K) bool, the episode's time is over: call `World.reset`.
        info: "reward_terms" (W, K, R) float32, weighted, named `World.reward_names`; "measures" (W, K, 6) float32, cost
            and yield of the step, named `World.measure_names`.
    """

    observation: torch.Tensor
    reward: torch.Tensor
    horizon_ended: torch.Tensor
    truncated: torch.Tensor
    info: dict[str, torch.Tensor]

    def clone(self) -> Step:
        """Copies, which later steps do not change."""
        info = {name: part.clone() for name, part in self.info.items()}
        parts = (self.observation, self.reward, self.horizon_ended, self.truncated)
        return Step._make([*(part.clone() for part in parts), info])


class World:
    """Many independent missions of one scenario, advanced together.

    World w of seed s is the same mission, bit for bit, for any `num_worlds`, number of threads and actions in other
    worlds: every random number is addressed by (seed, first_world + w, episode, step, draw). World w uses sea
    (first_world + w) modulo `sea.realisations` of the seed; the seas start anew when all worlds are reset together and
    continue when only some are. If each world has its own seed, it is world 0 of that seed, on its sea 0.

    Observation of AUV k, float32 (num_worlds, num_auvs, observation_size): the terms of `observation_layout`, which
    `usvauv.kernels.mission.observation` and `docs/interfaces.md` tabulate. Positions are estimates: from the last fix,
    or with `navigation.sensor` from filters.

    Action, float32 (num_worlds, num_auvs, action_size) in [−1, 1]: with auv.action = "vector" the velocity through the
    water over speed_max, its norm clamped into [speed_min, speed_max], which vehicles with dynamics (`auv.model`) take
    as heading and speed of their autopilot; with "vector-depth" a third number is their depth, linear from depth_min
    (−1) to depth_max (1); with "fins" the action is rudder (to starboard), stern plane (diving) and propeller, as
    shares of their limits.

    Args:
        scenario: a scenario, or its shipped name or path.
        num_worlds: W ≥ 1.
        seed: any integer from 0 to 2⁶⁴ − 1, or one for each world; then a sea is solved for each different seed.
        usv: strategy of the boats, in place of the scenario's `boat.strategy`: "fim", "fim-greedy",
            "visit", "belief", "hold:X,Y" (or a point for each boat, "hold:X,Y,X,Y"), "centroid",
            "agent" (see `step`) or a plugin's.
        targets: rule by which AUVs choose nodes, in place of the scenario's `nodes.target_rule`.
        first_world: index of the first world; World(n, first_world=f) are worlds f .. f+n−1 of a larger batch. Only
            with one seed.
        fine_sea: solve one sea on `sea.fine_cells` cells instead of a pool on `sea.cell_size`; for one world only.
        arch: where to run, see `usvauv.kernels.runtime.start`.

    Raises:
        ScenarioError: an argument out of range, or an unknown strategy.
        OceanError: a file of `water` cannot be used.
        MemoryNeeded: worlds or seas do not fit into memory.
        RuntimeUnavailable: `arch` cannot be used here.
    """

    measure_names = AuvColumn.names[MEASURED]

    # Arrays of `usvauv.kernels.mission.worlds`: the kernels change them in place, and callers may write into them.
    auv: torch.Tensor
    body: torch.Tensor
    node: torch.Tensor
    vortex: torch.Tensor
    drift: torch.Tensor
    boat: torch.Tensor
    hull: torch.Tensor
    tally: torch.Tensor
    estimate: torch.Tensor
    track: torch.Tensor
    own: torch.Tensor
    exchange: torch.Tensor
    foresight: torch.Tensor
    belief: torch.Tensor
    task_auv: torch.Tensor
    task_node: torch.Tensor
    task_pair: torch.Tensor
    task_boat: torch.Tensor
    observation: torch.Tensor
    reward: torch.Tensor
    reward_terms: torch.Tensor

    @runtime.taichi_lock()
    @torch.inference_mode(False)  # tensors made in torch's inference mode could not be written outside it
    def __init__(
        self,
        scenario: Scenario | str | Path,
        num_worlds: int = 1,
        seed: int | Sequence[int] = 0,
        usv: str | None = None,
        targets: str | None = None,
        *,
        first_world: int = 0,
        fine_sea: bool = False,
        arch: str = "auto",
    ) -> None:
        num_worlds = whole_number("num_worlds", num_worlds, 1, MAX_WORLDS)
        first_world = whole_number("first_world", first_world, 0, MOST_WORLDS - num_worlds)
        seeds = Seeds.of(seed, num_worlds, first_world)
        if fine_sea and num_worlds != 1:
            raise ScenarioError(f"num_worlds = {num_worlds}: a finely resolved sea carries exactly one world")
        self.scenario = scenario = Scenario.of(scenario).with_targets(targets)
        self.site = Site(scenario)
        self.num_worlds = num_worlds
        self.num_auvs = scenario.auv.count
        self.seeds = seeds
        self.strategy = StrategyChoice.parse(usv, scenario)
        self.reward_names = scenario.task_definition.reward_names
        self.steps = scenario.mission.steps
        self.observation_layout = ObservationLayout.of(scenario)
        self.observation_size = self.observation_layout.size
        self.action_size = scenario.auv.action_size
        running = runtime.start(arch)
        self.device = running.device
        self._made_with = num_worlds, seed, usv, first_world, fine_sea, arch
        self._first_world = first_world
        self._area = torch.tensor([scenario.area.width, scenario.area.length], dtype=torch.float32, device=self.device)

        self._foresees = foresees = self.strategy.strategy.functions.foresees
        shapes = array_shapes(scenario, num_worlds, foresees)
        workspaces = num_worlds * workspace_numbers(scenario)
        size = 4.0 * (WORKSPACE * sum(map(padded_length, shapes.values())) + workspaces)
        require(size, f"num_worlds = {num_worlds} of {self.num_auvs} AUVs", self.device)
        memory = allocate(shapes, scenario, num_worlds, self.device)
        for name, array in memory.arrays.items():
            setattr(self, name, array)
        self._measures = self.auv[..., MEASURED]  # making it anew in each step would take longer
        self._water = WorldWater(self.site, seeds, first_world=first_world, fine=fine_sea, device=self.device)
        self._kernels = MissionKernels(*(self.site, self.strategy, self.observation_layout, seeds), self._water, memory)
        self._clock, self._action = self._kernels.clock, self._kernels.action
        self._begun = self._diverged = False

    def __setattr__(self, name: str, value: object) -> None:
        """Refuse to rebind a public attribute: the kernels would continue to use the old one."""
        if name[0] != "_" and name in self.__dict__:
            raise AttributeError(f"World.{name}: cannot be rebound; a tensor can be written in place, {name}[:] = ...")
        super().__setattr__(name, value)

    def __repr__(self) -> str:
        """Number of missions, seed and device, boat strategy and target rule, and the scenario."""
        scenario, seed = self.scenario, self._made_with[1]
        targets = f", targets {scenario.nodes.target_rule}" if scenario.task_definition.targets == "nodes" else ""
        of = f"seeds {reprlib.repr(list(seed))}" if isinstance(seed, Sequence | np.ndarray) else f"seed {seed}"
        team = f"({self.num_worlds}, {self.num_auvs},"
        lines = [
            f"World of {self.num_worlds} mission{'s' * (self.num_worlds > 1)}, {of}, on {self.device}",
            f"boat {self.strategy.name}{targets}, {self.steps} steps of {scenario.mission.step:g} s",
            f"observation {team} {self.observation_size}), action {team} {self.action_size})",
            *repr(scenario).splitlines(),
        ]
        return "\n  ".join(lines)

    @property
    def seed(self) -> int:
        """The seed of all worlds; a ScenarioError if each world has its own."""
        return self.seeds.common()

    @property
    def sea(self) -> LongWaves:
        """The long waves of the worlds."""
        return self._water.long_waves

    @property
    def storm(self) -> AirySea:
        """The short waves."""
        return self._water.storm

    @property
    def rule_workspace(self) -> torch.Tensor:
        """The target rule's workspace after the last step, (W, ≥ 1)."""
        return self._kernels.tables["workspace"][:, : mission_parameters.rule_workspace(self.scenario)]

    @property
    def begun(self) -> bool:
        """Whether an episode has begun in all worlds, so that a step can follow."""
        return self._begun

    def reset(self, mask: torch.Tensor | np.ndarray | Sequence[bool] | None = None) -> torch.Tensor:
        """Begin the next episode of all worlds, or of those where `mask` (num_worlds,) is true; returns observation.

        Raises:
            ScenarioError: the mask is not one bool per world, or leaves a world out of the first reset.
            DivergenceError: as `step`; after one, reset all worlds, or all those whose state has diverged.
        """
        self._kernels.follow_taichi()
        if mask is None:
            episode = int(self._clock[0, 0]) + 1
            if not self._water.is_at_beginning_of(episode):
                self._water.begin(episode)
                self._kernels.bind()
            self._kernels.chosen.fill_(1)
        else:
            self._kernels.chosen.copy_(mask_of(mask, self.num_worlds, self._begun))
        if self._diverged:
            self._forget_divergence()
        self._kernels.begin()
        self._begun = True
        self._stop_at_fault()
        return self.observation

    def _forget_divergence(self) -> None:
        """Clear the arrays of the worlds that begin anew."""
        for name in ARRAYS:
            array = getattr(self, name)
            if len(array) == self.num_worlds:
                array[self._kernels.chosen.bool()] = 0
        self._kernels.forget_fault()
        self._diverged = False

    def step(self, action: Numbers, boat_action: Numbers | None = None) -> Step:
        """Advance all worlds by one mission step.

        Args:
            action: (num_worlds, num_auvs, action_size) in [−1, 1]; a tensor of any real type on any device, or anything
                that NumPy converts to an array.
            boat_action: (num_worlds, boats, 2) in [−1, 1], only with the strategy "agent": velocity through the water
                over the boat's top speed, its norm clamped to 1.

        Returns:
            the result of the step, valid until the next one: take a `Step.clone` to keep it.

        Raises:
            ScenarioError: `reset` was not called; an action is not numeric, has another shape, or on a CPU is not
                finite; a boat's action is missing, or is given although the strategy is not "agent".
            DivergenceError: a number of the state is not finite or out of range, on a GPU also after an action that is
                not finite; there the next step raises it.
        """
        if not self._begun:
            raise ScenarioError(NOT_BEGUN)
        self._kernels.follow_taichi()
        if not self._kernels.take(numbers_of("action", action, self._action.shape)):
            raise ScenarioError("action: all numbers must be finite")
        if (boat_action is None) == (self.strategy.name == AGENT):
            needs = "missing" if boat_action is None else "given"
            raise ScenarioError(f"boat_action: {needs}, but the boat's strategy is {self.strategy.name!r}")
        if boat_action is not None:
            boats = numbers_of("boat_action", boat_action, (*self.boat.shape[:2], 2))
            self._steer_boats(boats.to(self.device, torch.float32))
        try:
            self._water.advance()
        except DivergenceError:
            self._diverged = True
            raise
        self._kernels.advance()
        self._stop_at_fault()
        info = {"reward_terms": self.reward_terms, "measures": self._measures}
        return Step(self.observation, self.reward, self._kernels.horizon_ended, self._kernels.truncated, info)

    def _steer_boats(self, action: torch.Tensor) -> None:
        """Set each boat's goal so that it commands the velocity through the water in its action (W, B, 2)."""
        if not torch.isfinite(action).all():
            raise ScenarioError("boat_action: all numbers must be finite")
        boat = self.scenario.boat
        top_speed = self._kernels.tables["p"][Parameter.top_speed]
        velocity = top_speed * action / action.norm(dim=-1, keepdim=True).clamp(min=1.0)
        place = self.boat[..., BoatColumn.span("x", "y")]
        if response := boat_speed.response_time(self.scenario):
            drift = self.boat[..., BoatColumn.span("drift_x", "drift_y")]
            velocity = velocity + drift
            place = place + response * (self.boat[..., BoatColumn.span("water_x", "water_y")] + drift)
            place = place + boat.dead_band * velocity / velocity.norm(dim=-1, keepdim=True).clamp(min=1e-6)
        elif boat.drifts:
            velocity = velocity + self.boat[..., BoatColumn.span("current_x", "current_y")]
        place = place + boat_speed.control_time(self.scenario) * velocity
        self.boat[..., BoatColumn.span("goal_x", "goal_y")] = place.clamp(torch.zeros_like(self._area), self._area)

    @property
    def own_position(self) -> torch.Tensor:
        """Each AUV's own position estimate, (W, K, 2), m: by dead reckoning, or else the boat's estimate."""
        if self.scenario.navigation.sensor != "none":
            return self.own[..., tracker.X : tracker.Y + 1]
        return self.estimate[..., EstimateColumn.span("x", "y")]

    @property
    def foreseen_position(self) -> torch.Tensor:
        """Each AUV's position as the boats predict it, (W, K, 2), m; their estimate if their strategy does not."""
        places, names = (self.foresight, ForesightColumn) if self._foresees else (self.estimate, EstimateColumn)
        return places[..., names.span("x", "y")]

    def rewind(self) -> None:
        """Make the next `reset` begin the first episode again, as in a new world of the same seed."""
        self._clock.fill_(-1)
        self._begun = False

    def state(self) -> dict[str, torch.Tensor]:
        """Everything that decides the worlds' future, as copies; `load_state` restores it bit for bit."""
        own = {name: getattr(self, name).clone() for name in STATE}
        return {**own, "clock": self._clock.clone(), **self._water.state()}

    def load_state(self, state: Mapping[str, torch.Tensor]) -> None:
        """Restore a state that `state` returned for a world of the same scenario, seed and size.

        Raises:
            ScenarioError: a tensor is missing, has another shape or type, or a number out of range; nothing changes.
        """
        state = checked_state(state, self.state(), self.scenario)
        self._water.load_state(state)
        self._kernels.bind()
        for name in STATE:
            getattr(self, name).copy_(state[name])
        self._clock.copy_(state["clock"])
        self._begun = bool((self._clock >= 0).all())

    def __reduce__(self) -> tuple[Any, ...]:
        """A copy, also by `pickle` in another process, is a new world with this one's state."""
        last = {name: getattr(self, name) for name in REWARDS}
        # Torch sends a tensor to a process that is being spawned as a file, which would be closed with these copies.
        state, last = ({name: array.numpy(force=True) for name, array in part.items()} for part in (self.state(), last))
        return _remade, (type(self), self.scenario, self._made_with, state, last)

    def set_parameters(self, scenario: Scenario) -> None:
        """Continue under a scenario that differs from the present one only in the fields `ADJUSTABLE`.

        It takes effect from the next step on, and the state is kept. Vortices keep their positions; their circulations
        are those that the beginning of the episode draws from the new bounds. Forced long waves change at their edge
        and propagate from there.

        Raises:
            ScenarioError: another field differs, or in the wind of the new storm boats move too fast.
        """
        check_same(self.scenario, scenario, ADJUSTABLE, "cannot change while worlds run")
        redrawn, site = scenario.current != self.scenario.current, self.site.under(scenario)
        self._kernels.use(site)
        for name, value in (("scenario", scenario), ("site", site)):
            object.__setattr__(self, name, value)
        if redrawn:
            self._redraw_circulations()
        self._water.go_on_under(self.site)
        self._kernels.bind()

    def _redraw_circulations(self) -> None:
        tables, clock, drawn = self._kernels.tables, self._clock.clone(), self.vortex.clone()
        clock[:, 1] = 0  # vortices are drawn as an episode begins
        draw_vortices(*(tables[name] for name in ("p", "flag", "fixed_vortex", "key")), clock.contiguous(), drawn)
        self.vortex[..., Vortex.Gamma] = drawn[..., Vortex.Gamma]

    def continue_from(self, other: World) -> None:
        """Continue from the state of `other`, bit for bit, except for what another strategy or rule decides.

        An AUV keeps its target until it chooses the next one. This world's rule makes tours and sectors from the nodes'
        positions as the episode begins. A boat that predicts AUVs starts from their last replies.

        Args:
            other: a world of the same size, seed and scenario, except for the boat's strategy and
                `nodes.target_rule`, on the same kind of sea.

        Raises:
            ScenarioError: it is another kind of world.
        """
        if not other.begun:
            raise ScenarioError(f"continue_from: in the other world {NOT_BEGUN}")
        check_same(other.scenario, self.scenario, DECISIONS, "must be as in the world that is continued")
        taken = other.state()
        self._clock[:, 0] = taken["clock"][:, 0] - 1
        self.reset()  # for its tours
        planned = [NodeColumn.tour, NodeColumn.successor, NodeColumn.owner]
        taken["node"][..., planned] = self.node[..., planned]
        if self.foresight.shape != other.foresight.shape:
            taken["foresight"] = self._last_told(taken) if self._foresees else self.foresight
        self.load_state(taken)

    def _last_told(self, taken: Mapping[str, torch.Tensor]) -> torch.Tensor:
        """Prediction of the AUVs from their last replies."""
        foresight, exchange, track = torch.zeros_like(self.foresight), taken["exchange"], taken["track"]
        place = track[..., [tracker.X, tracker.Y]]
        foresight[..., ForesightColumn.span("x", "y")] = place.clamp(torch.zeros_like(self._area), self._area)
        for column in ("heads_for", "hovers"):
            foresight[..., getattr(ForesightColumn, column)] = exchange[..., getattr(ExchangeColumn, column)]
        foresight[..., ForesightColumn.speed] = self.scenario.reference.straight_speed
        return foresight

    def _stop_at_fault(self) -> None:
        """Check all numbers of the worlds; on a GPU without waiting, as they were a step ago.

        Raises:
            DivergenceError: one is not finite or out of range; the message has world, quantity and time.
        """
        if self._kernels.found_fault():
            self._diverged = True
            self._kernels.forget_fault()
            terms = [name for name, place in self.observation_layout for _ in range(place.start, place.stop)]
            columns = {"observation": terms, "reward_terms": self.reward_names}
            world, problem = first_fault({name: getattr(self, name) for name in ARRAYS}, self.scenario, columns)
            time = int(self._clock[world, 1]) * self.scenario.mission.step
            plugins = self._kernels.plugins()
            raise DivergenceError(
                f"world {self._first_world + world} at {time:g} s: {problem}"
                + (f" (uses {plugins})" if plugins else "")
            )

    def measures(self) -> torch.Tensor:
        """Cost and yield of the last step, (num_worlds, num_auvs, 6), columns `measure_names`."""
        return self._measures

    def current(self) -> torch.Tensor:
        """True velocity of the water at each AUV, (num_worlds, num_auvs, 2), m/s: all that
        `usvauv.kernels.flow.current` names, and the storm.
        """
        return self.auv[..., CURRENT]

    def water_velocity(self) -> torch.Tensor:
        """True velocity of each AUV through the water at the end of the last step, (num_worlds, num_auvs, 2), m/s."""
        return self.auv[..., AuvColumn.span("velocity_x", "velocity_y")]

    def current_field(self, flow: torch.Tensor, margin: float = 0.0) -> None:
        """True velocity of the water at cruise level, without the storm, into `flow`, m/s.

        Args:
            flow: (num_worlds, rows, columns, 2) float32 on a grid of at least 2 rows and columns, row 0 in the south.
            margin: distance of the grid's edges from those of the area, m.
        """
        current.on_grid(
            self._area,
            self.vortex,
            self._water.stream,
            self._kernels.tables["bed"],
            *self.sea.transports,
            *self.sea.units,
            self.sea.nx,
            self.sea.ny,
            self._water.sea_index,
            margin,
            flow,
            *self.site.eddies.pattern,
        )

    def surface(self, pixels: int, world: int = 0) -> np.ndarray:
        """Elevation of a world's sea averaged to at most `pixels` on the longer side, (Y, X), row 0 in the south, m."""
        elevation, x, y = self.long_waves(pixels, world)
        return elevation + self.storm.elevation(int(self._water.sea_index[world]), x, y)

    def short_waves(self, world: int = 0) -> np.ndarray:
        """The storm waves on a world's sea, (N, 5), see `usvauv.env.sea.water.AirySea.components`."""
        return self.storm.components(int(self._water.sea_index[world]))

    def long_waves(self, pixels: int, world: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Elevation of the long waves alone, averaged as in `surface`, and its cells' centres x (X,) and y (Y,), m."""
        return self._water.mean_elevation(pixels, world)


def _remade(
    kind: type[World], scenario: Scenario, made_with: tuple[Any, ...], state: dict[str, Any], last: dict[str, Any]
) -> World:
    """The world that `World.__reduce__` describes."""
    num_worlds, seed, usv, first_world, fine_sea, arch = made_with
    world = kind(scenario, num_worlds, seed, usv, first_world=first_world, fine_sea=fine_sea, arch=arch)
    world.load_state({name: torch.from_numpy(array) for name, array in state.items()})
    for name, array in last.items():
        getattr(world, name).copy_(torch.from_numpy(array))
    return world
