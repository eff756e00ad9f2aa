"""The kernels of the missions of a `World`, bound to its arrays: tables, workspaces, launches and flags."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Set
from contextlib import nullcontext
from typing import Any

import torch

from usvauv.env.scenario.fields import ScenarioError
from usvauv.env.scenario.scenario import Scenario
from usvauv.env.sea.water import Seeds, WorldWater
from usvauv.env.site.site import Site
from usvauv.env.world import mission_parameters
from usvauv.env.world.observation_layout import ObservationLayout
from usvauv.env.world.state import ALIGNMENT, StateBuffer, padded_length
from usvauv.env.world.strategy_choice import StrategyChoice
from usvauv.kernels import random, runtime
from usvauv.kernels.errors import blaming
from usvauv.kernels.flow import vortex_motion
from usvauv.kernels.functions import LANES, DeviceFlag, Launch, WholeVector, compiled_together, copy_finite
from usvauv.kernels.mission.arguments import PARAMETERS
from usvauv.kernels.mission.auvs.vehicles import ROWS, move
from usvauv.kernels.mission.boats.belief_planner import OTHER_GOALS
from usvauv.kernels.mission.boats.boat_strategies import boat_strategies
from usvauv.kernels.mission.boats.rollouts import STEPS, WAY
from usvauv.kernels.mission.columns import Division, ReceptionColumn
from usvauv.kernels.mission.draws import draw_numbers
from usvauv.kernels.mission.observation import observation_terms
from usvauv.kernels.mission.run import OF_EPISODES, OF_STEPS, Part, Stage, launches, run
from usvauv.kernels.mission.target_rules import target_rules
from usvauv.kernels.mission.tasks.task import tasks
from usvauv.kernels.mission.water import PROFILE_POINTS
from usvauv.kernels.mission.worlds import WORLDS_PER_BLOCK
from usvauv.kernels.registry import Registry
from usvauv.kernels.vehicles.definition import vehicles

AUV_STEP = 5  # µs, about, of an AUV's step in few worlds, one after the other
LEAST_AUVS = 64  # of all worlds, for whose step waking another thread takes no time that matters
BLOCK_STEP = 8  # µs, about, of the step of LANES vehicles with dynamics


def workspace_numbers(scenario: Scenario) -> int:
    """Numbers of a world's workspaces, at most."""
    drawn = draw_numbers(scenario.auv.count, scenario.boat.count, scenario.targets).size
    received = scenario.auv.count * (2 * PROFILE_POINTS + len(ReceptionColumn.names))
    room = scenario.task_definition.room * LANES
    return mission_parameters.rule_workspace(scenario) + 4 * drawn + received + room


class MissionKernels:
    """Begins episodes of worlds, and advances worlds by a mission step.

    Args:
        site, strategy, layout: of the worlds; the last of their observations.
        seeds: of each world. water: of the worlds.
        memory: of the worlds' arrays.

    Attributes:
        clock: (W, 2) int32, episode, and mission steps done.
        chosen: (W,) uint8, which worlds `begin` begins anew.
        action: (W, K, A) float32, what `advance` takes.
        horizon_ended, truncated: (W, K) bool, written by `advance`.
        tables: constant arguments of the mission's kernel, and its workspaces, by name.
        before_stages: what comes in a step before the mission's kernel.
    """

    def __init__(
        self,
        site: Site,
        strategy: StrategyChoice,
        layout: ObservationLayout,
        seeds: Seeds,
        water: WorldWater,
        memory: StateBuffer,
    ) -> None:
        scenario, running = site.scenario, runtime.start()
        self._strategy, self._layout, self._seeds, self._water = strategy, layout, seeds, water
        self._memory = memory
        self._device, self._on_cpu, self._on_host = running.device, running.on_cpu, running.torch_on_host
        worlds, auvs = len(seeds.seed), scenario.auv.count
        self.clock = torch.full((worlds, 2), -1, dtype=torch.int32, device=self._device)
        self.chosen = torch.ones(worlds, dtype=torch.uint8, device=self._device)
        self.action = self._zeros(worlds, auvs, scenario.auv.action_size)
        self._ends = torch.zeros((2, worlds, auvs), dtype=torch.uint8, device=self._device)
        self.horizon_ended, self.truncated = self._ends.view(torch.bool)
        groups = -(-worlds * auvs // LANES) if scenario.auv.dynamic else 0
        self._blocks = self._zeros(groups, ROWS, LANES)
        # Flags that kernels set; on a CPU NumPy's views of them are faster to read.
        self._fault = torch.zeros(1, dtype=torch.int32, device=self._device)
        self._due = torch.ones(1, dtype=torch.int32, device=self._device)
        self._not_finite = torch.zeros(1, dtype=torch.int32, device=self._device)
        flags = self._fault, self._due, self._not_finite
        self._seen_fault, self._seen_due, self._seen_not_finite = (flag.numpy(force=True) for flag in flags)
        self.use(site)
        self._evolve_vortices = self._evolution()
        self._apart: Set[str] = frozenset()  # kinds of plugins that do not compile with vectors in registers
        self._flag = None if self.tables["program"].checks else DeviceFlag(memory.numbers, memory.limits, self._fault)
        self.bind()

    def _zeros(self, *shape: int) -> torch.Tensor:
        return torch.zeros(shape, dtype=torch.float32, device=self._device)

    def use(self, site: Site) -> None:
        """Make the tables of a site; `bind` is to follow."""
        scenario, uploaded = site.scenario, mission_parameters.kernel_tables(site, self._strategy)
        self._site = site
        program = mission_parameters.program(site, self._strategy.strategy, uploaded["link"])
        worlds, auvs = self.action.shape[:2]
        few = runtime.too_few_for_threads(AUV_STEP * worlds * auvs)
        one_block = worlds <= WORLDS_PER_BLOCK and worlds * auvs < LEAST_AUVS
        division = Division.one_block if one_block else Division.lanes
        if few:
            division = Division.calling_thread
        elif not self._on_cpu:
            division = Division.threads
        program = program._replace(
            division=division,
            vortices_move=self._on_cpu and self._vortices_move,
            checks=self._on_cpu and self._on_host,
        )
        losses = scenario.boat.count * (auvs + OTHER_GOALS) if program.weighs_apart else 0
        ways = (1, 1)
        if program.in_lanes and program.strategy.weigh:
            ways = -(-worlds // WORLDS_PER_BLOCK), WAY * STEPS * program.abreast // random.LANES
        task = scenario.task_definition
        draws = draw_numbers(auvs, scenario.boat.count, scenario.targets)
        drawn = (worlds, 4 * len(draws)) if program.in_lanes else (1, 1)
        arrays = self._memory.arrays
        self.tables: dict[str, Any] = {
            **{name: torch.from_numpy(table).to(self._device) for name, table in uploaded.items()},
            "key": torch.from_numpy(self._seeds.keys()).to(self._device),
            "draw_numbers": torch.tensor(draws, device=self._device),
            "drawn": self._zeros(*drawn, random.LANES),
            "profile": self._zeros(worlds, auvs, 2 * PROFILE_POINTS),
            "reception": self._zeros(worlds, auvs, len(ReceptionColumn.names)),
            "links": torch.tensor(uploaded["links"], device=self._device),  # aligned
            "program": program,
            "numbers": self._rows(self._memory.numbers, program.checks).view(torch.int32),
            "spans": self._memory.spans,
            "which": self._memory.limits.which,
            "bounds": self._memory.limits.bits,
            "fault": self._fault,
            "due": self._due,
            "vortex_rows": self._rows(arrays["vortex"], program.in_lanes),
            "drift_rows": self._rows(arrays["drift"], program.in_lanes),
            "pair_rows": self._rows(arrays["task_pair"], self._on_cpu and task.pair_columns is not None),
            "room": self._zeros(worlds, task.room, LANES),
            "workspace": self._zeros(worlds, mission_parameters.rule_workspace(scenario) + losses),
            "ways": self._zeros(*ways, random.LANES),
        }

    def _rows(self, array: torch.Tensor, read: bool) -> torch.Tensor:
        """An array of the state as rows of `ALIGNMENT` numbers with what aligns the next one; some row if not read."""
        first = array.storage_offset()
        part = self._memory.numbers[first : first + padded_length(array.shape)] if read else self._zeros(ALIGNMENT)
        return part.view(-1, ALIGNMENT)

    @property
    def _vortices_move(self) -> bool:
        """Whether vortices move or spread."""
        return self._site.scenario.current.viscosity > 0 or self._site.scenario.current.mutual

    def _evolution(self) -> Callable[[], None] | None:
        """What comes before the mission's kernel where vortices move; on a CPU only where their motion is renewed."""
        current, eddies = self._site.scenario.current, self._site.eddies
        vortex, drift = (self._memory.arrays[name] for name in ("vortex", "drift"))
        moving = self._site.scenario.mission.step, current.viscosity
        if self._on_cpu:
            return vortex_motion.renewal(vortex, drift, self.clock, *moving, eddies) if current.mutual else None
        if not self._vortices_move:
            return None
        return vortex_motion.evolution(vortex, *moving, current.mutual, eddies, drift=drift, clock=self.clock)

    def bind(self) -> None:
        """Compile the kernels, unless compiled already, for the present tables and sea."""
        arguments = {
            **self.tables,
            **self._water.arguments(),
            "begins": 0,
            "chosen": self.chosen,
            "clock": self.clock,
            "action": self.action,
            **dict(zip(("horizon_ended", "truncated"), self._ends, strict=True)),
            **self._memory.arrays,
        }
        self._arguments = arguments
        self._due.fill_(1)
        self._bound_in = runtime.start()
        self._copy = None
        if self._on_cpu and self._on_host:
            self._copy = Launch(copy_finite, self.action.view(-1), self.action.view(-1), self._not_finite)
        for registry, name in self._parts():
            registry.check_fields(name)
        plugins = self.plugins()  # whose Taichi functions may not compile
        kinds = {registry.kind for registry, name in self._parts() if registry.file(name)}
        with compiled_together(), blaming(plugins, ScenarioError) if plugins else nullcontext():
            try:
                self._bind_mission(arguments, kinds)
            except WholeVector:
                self._apart = kinds
                self._bind_mission(arguments, kinds)
            self._deploy, self._sail = (
                self._moving(deploys, arguments) if self._site.scenario.auv.dynamic else None
                for deploys in (True, False)
            )
        self.before_stages = [self._renew_vortices, *([self._sail] if self._sail else [])]

    def _bind_mission(self, arguments: Mapping[str, Any], plugins: Set[str]) -> None:
        """Make the launches that begin episodes and those of a step, with plugins of some kinds."""
        parts = launches(arguments["program"], plugins, self._apart)
        beginning = {**arguments, "begins": 1}
        self._begin = tuple(self._mission(beginning, part) for part in parts if not OF_STEPS.issuperset(part.stages))
        self._step = tuple(self._mission(arguments, part) for part in parts if not OF_EPISODES.issuperset(part.stages))

    def _mission(self, arguments: Mapping[str, Any], part: Part) -> Launch:
        """A launch of the mission's kernel."""
        program, settings = arguments["program"], runtime.vectors_in_registers()
        if part.plain:
            program, settings = program.world_by_world, runtime.NONE
        given = (arguments[name] for name in PARAMETERS)
        return Launch(run, part.stages, program, *given, settings={**runtime.fast_compilation(), **settings})

    def _moving(self, deploys: bool, arguments: Mapping[str, Any]) -> Launch:
        """The kernel that deploys the vehicles with dynamics, or moves them through a mission step."""
        scenario = self._site.scenario
        table = torch.from_numpy(mission_parameters.vehicle_table(scenario)).to(self._device)
        given = (arguments[name] for name in ("key", "clock", "chosen", "action", "auv"))
        body = arguments["body"].view(-1, arguments["body"].shape[-1])
        return Launch(
            move,
            deploys,
            runtime.too_few_for_threads(BLOCK_STEP * self._blocks.shape[0]),
            mission_parameters.vehicle_motion(scenario),
            mission_parameters.vehicle_substeps(scenario),
            arguments["p"],
            table,
            *given,
            body,
            self._blocks,
            self._blocks,
            settings=runtime.vectors_in_registers(),
        )

    def follow_taichi(self) -> None:
        """Bind the kernels again if other code has started Taichi anew."""
        if runtime.start() is not self._bound_in:
            self.bind()

    def begin(self) -> None:
        """Begin the next episode of the worlds in `chosen`."""
        if self._deploy:
            self._deploy()
        for part in self._begin:
            part()
        self._due.fill_(1)

    def take(self, action: torch.Tensor) -> bool:
        """Copy actions (W, K, A) into `action`; whether they are finite, which nobody looks at on a device."""
        if self._copy and action.dtype == torch.float32 and action.is_cpu and action.is_contiguous():
            self._copy.take(0, action)
            self._copy()
            return not self._seen_not_finite[0]
        self.action.copy_(action)
        return not self._on_host or bool(self.action.isfinite().all())

    def advance(self) -> None:
        """Advance all worlds by a mission step under `action`; their water has been before."""
        for part in self.before_stages:
            part()
        for part in self._step:
            part()

    def _renew_vortices(self) -> None:
        """Find out how the vortices move, on a CPU only where that is due."""
        if self._evolve_vortices and (self._seen_due[0] or not self._on_cpu):
            self._seen_due[0] = 0
            self._evolve_vortices()

    def launch_of(self, stage: Stage) -> Launch:
        """A launch of one stage of a step, for measurements; a step is all of `STEP` one after another."""
        return self._mission(self._arguments, Part((stage,), False))

    def found_fault(self) -> bool:
        """Whether a number of the worlds is not finite or out of range; with CUDA whether it was a step ago."""
        return self._flag.raised() if self._flag else bool(self._seen_fault[0])

    def forget_fault(self) -> None:
        """Go on after a fault."""
        self._fault.zero_()
        if self._flag:
            self._flag.forget()

    def _parts(self) -> list[tuple[Registry[Any], str]]:
        """Registered parts of these worlds, which may be a plugin's, each with its registry."""
        scenario = self._site.scenario
        return [
            (tasks, scenario.task),
            (boat_strategies, self._strategy.name.partition(":")[0]),
            (target_rules, scenario.nodes.target_rule.partition(":")[0]),
            *((observation_terms, term) for term in self._layout.terms),
            *([(vehicles, scenario.auv.model)] if scenario.auv.dynamic else []),
        ]

    def plugins(self) -> str:
        """The parts of these worlds that plugins have registered, in words; empty without any."""
        return ", ".join(filter(None, (registry.described(name) for registry, name in self._parts())))
