"""Run a policy in a world and record the states."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import nullcontext

import numpy as np
import torch

from usvauv.env.record.headings import headings
from usvauv.env.record.trace import Trace
from usvauv.env.scenario.scenario import Scenario
from usvauv.env.storage.memory import RowsOnDisk, require
from usvauv.env.world.state import array_shapes
from usvauv.env.world.world import World
from usvauv.kernels.errors import DivergenceError
from usvauv.kernels.mission.columns import AuvColumn, BoatColumn, BodyColumn, EstimateColumn, NodeColumn, TallyColumn
from usvauv.kernels.positioning.usbl import DETECTED
from usvauv.kernels.types import Level
from usvauv.kernels.vehicles.otter import HullColumn

SURFACE_PIXELS = 128
COPIES = 2.5  # of a state in memory: as recorded, once more while room for others is made, and derived arrays
EACH = 1000.0  # bytes of Python objects per state
OF_BODY = slice(BodyColumn.propeller + 1)  # what `of_bodies` reads
MEASURED = "node_range", "boat_range"
NO_STORM = np.zeros((0, 5))


class Diverged(DivergenceError):
    """Recorded worlds diverged: a number is not finite or out of range.

    Attributes:
        trace: the steps before.
    """

    def __init__(self, message: str, trace: Trace) -> None:
        super().__init__(message)
        self.trace = trace


def trace_bytes(scenario: Scenario, num_worlds: int, steps: int) -> float:
    """Estimated peak memory for recording some steps of worlds, bytes; the surface is on the disk."""
    shapes = array_shapes(scenario, num_worlds, foresees=False)
    numbers = sum(math.prod(shapes[name]) for name in ("auv", "boat", "reward_terms", "estimate"))
    numbers += num_worlds * (scenario.targets + 4 * scenario.current.vortices)
    return steps * (EACH + 4.0 * COPIES * numbers)


def check_room(scenario: Scenario, num_worlds: int, steps: int) -> None:
    """Refuse a record that does not fit into memory.

    Raises:
        MemoryNeeded: it does not.
    """
    what = f"mission.duration or --duration: a record of {steps} steps of {num_worlds} worlds"
    require(trace_bytes(scenario, num_worlds, steps), what)


class Recorder:
    """Copies the states of a world one by one and converts them into a trace."""

    def __init__(self, world: World) -> None:
        self._start, self._flow = world.site.start, world.site.current
        self._moving = world.scenario.task_definition.targets == "moving"
        self.watch(world)
        self.clear()

    def __len__(self) -> int:
        return self._count

    def clear(self) -> None:
        """Remove all states; earlier traces keep theirs."""
        self._rows: dict[str, np.ndarray] = {}
        self._count = 0

    def drop_last(self) -> None:
        """Remove the last state; the next one replaces it in earlier traces too."""
        self._count -= 1

    def add(self) -> None:
        """Append the present state of the world."""
        if not self._rows or self._count == len(self._rows["auv"]):
            self._make_room()
        for name, part in self._parts.items():
            self._rows[name][self._count] = part.numpy(force=True)
        self._count += 1

    def _make_room(self) -> None:
        """Make memory for the states of an episode, or for twice as many as there are."""
        for name, part in self._parts.items():
            rows = np.empty((2 * self._count or self.world.steps, *part.shape), part.numpy(force=True).dtype)
            if self._count:
                rows[: self._count] = self._rows[name]
            self._rows[name] = rows

    def watch(self, world: World) -> None:
        """Record this world from now on; it continues the mission of the one before."""
        self.world = world
        task, dynamic = world.scenario.task_definition, world.scenario.auv.dynamic
        ranges = zip(MEASURED, (world.task_pair, world.task_boat), (task.pair_columns, task.boat_columns), strict=True)
        self._parts = {  # views of the world's memory
            "auv": world.auv,
            "boat": world.boat,
            "hull": world.hull,
            "tally": world.tally,
            "backlog": world.node[..., NodeColumn.backlog],
            "terms": world.reward_terms,
            "estimate": world.estimate,
            "own": world.own_position,
            "foreseen": world.foreseen_position,
            "vortex": world.vortex[:, : world.scenario.current.vortices],
            **({"body": world.body[..., OF_BODY], "touched": world.body[..., BodyColumn.touched]} if dynamic else {}),
            **({"way": world.node[..., NodeColumn.span("x", "y")], "targets": world.task_node} if self._moving else {}),
            **{
                name: memory[..., columns.names.index("measured")]
                for name, memory, columns in ranges
                if columns and "measured" in columns.names
            },
        }

    def trace(
        self,
        policy: str,
        surface: np.ndarray,
        storm: np.ndarray = NO_STORM,
        *,
        first: int = 0,
        start: float = 0.0,
        worlds: slice = slice(None),
    ) -> Trace:
        """The trace from state number `first` on; nodes have their present positions.

        Args:
            policy: name of the policy.
            surface, storm: as in `Trace`.
            first: number of the first state.
            start: time of that state, s.
            worlds: the worlds to include.

        Raises:
            ScenarioError: each world has its own seed.
        """
        world = self.world
        of = {name: rows[first : self._count, worlds] for name, rows in self._rows.items()}
        vehicles, boats, hull, tally, known = (of[name] for name in ("auv", "boat", "hull", "tally", "estimate"))
        nodes = world.node[worlds].cpu().numpy()

        def column(name: str) -> np.ndarray:
            return vehicles[..., getattr(AuvColumn, name)]

        flags = column("fix_flags").astype(np.uint8)
        heard = (flags & DETECTED)[..., None] > 0
        if world.scenario.boat.model == "otter":
            turn = np.float32(0.5 * np.pi) - hull[..., HullColumn.heading]
        else:
            turn = headings(boats[..., BoatColumn.span("water_x", "water_y")], world.scenario.mission.step)
        return Trace(
            scenario=world.scenario,
            policy=policy,
            usv=world.strategy.name,
            seed=world.seeds.common(worlds),
            reward_names=world.reward_names,
            start=self._start,
            node_position=nodes[..., NodeColumn.span("x", "y")].copy(),
            node_rate=nodes[..., NodeColumn.rate].copy(),
            time=start + np.arange(len(vehicles)) * world.scenario.mission.step,
            auv_position=vehicles[..., AuvColumn.span("x", "y")],
            auv_velocity=vehicles[..., AuvColumn.span("water_x", "water_y")],
            fix=np.where(heard, vehicles[..., AuvColumn.span("fix_x", "fix_y")], np.float32(np.nan)),
            heard_position=vehicles[..., AuvColumn.span("heard_x", "heard_y")],
            fix_covariance=vehicles[..., AuvColumn.span("covariance_xx", "covariance_yy")],
            fix_flags=flags,
            fix_boat=column("fix_boat").astype(np.int8),
            served_by=known[..., EstimateColumn.served_by].astype(np.int8),
            estimate=known[..., EstimateColumn.span("x", "y")],
            estimate_covariance=known[..., EstimateColumn.span("covariance_xx", "covariance_yy")],
            own_position=of["own"],
            foreseen_position=of["foreseen"],
            target=column("target").astype(np.int16),
            hovering=column("hovering").astype(np.int8),
            power=column("power"),
            service_rate=column("service_rate"),
            delivered=column("delivered"),
            border=column("border").astype(np.int8),
            reward_terms=of["terms"],
            boat_position=boats[..., BoatColumn.span("x", "y")],
            boat_heading=turn,
            boat_goal=boats[..., BoatColumn.span("goal_x", "goal_y")],
            boat_surface=boats[..., BoatColumn.span("elevation", "slope_y")],
            backlog=of["backlog"],
            overflowing=tally[..., TallyColumn.overflowing].astype(np.int16),
            collisions=tally[..., TallyColumn.collisions].astype(np.int16),
            packets_created=tally[..., TallyColumn.packets_created].astype(np.int32),
            packets_lost=tally[..., TallyColumn.packets_lost].astype(np.int32),
            packets_delivered=column("packets_delivered").astype(np.int32),
            vortex=of["vortex"],
            stream_time=self._flow.times if self._flow else np.zeros(0),
            stream=self._flow.velocity[:, Level.cruise] if self._flow else np.zeros((0, 0, 0, 2), np.float32),
            surface=surface,
            storm=storm,
            **({**of_bodies(of["body"]), "auv_touched": of["touched"].astype(np.int8)} if "body" in of else {}),
            **({"auv_charge": column("charge")} if world.scenario.auv.battery else {}),
            **({"boat_power": boat_power(world.scenario, boats)} if world.scenario.boat.metered else {}),
            **({"node_way": of["way"], **estimates(world.scenario, of["targets"])} if self._moving else {}),
            **{name: of[name] for name in MEASURED if name in of},
        )


def estimates(scenario: Scenario, targets: np.ndarray) -> dict[str, np.ndarray]:
    """The arrays of a trace for estimates of nodes (..., M, ·) that move, where the task's memory has them."""
    columns = scenario.task_definition.node_columns
    if not columns or "estimate_x" not in columns.names:
        return {}
    return {
        "node_estimate": targets[..., columns.span("estimate_x", "estimate_y")],
        "node_covariance": targets[..., columns.span("covariance_xx", "covariance_yy")],
    }


def boat_power(scenario: Scenario, boats: np.ndarray) -> np.ndarray:
    """Power of boats (..., F), W: the hotel load, and propulsion by the cube of the speed through the water."""
    return scenario.boat.hotel + scenario.boat.propulsion_power * boats[..., BoatColumn.effort] ** 3


def of_bodies(body: np.ndarray) -> dict[str, np.ndarray]:
    """The arrays of a trace for vehicles with dynamics, from columns of their bodies from the first on, `OF_BODY`."""
    q0, q1, q2, q3 = np.moveaxis(body[..., BodyColumn.span("q0", "q3")], -1, 0)
    yaw = np.arctan2(2 * (q1 * q2 + q0 * q3), 1 - 2 * (q2**2 + q3**2))
    pitch = np.arcsin(np.clip(2 * (q0 * q2 - q3 * q1), -1, 1))
    roll = np.arctan2(2 * (q2 * q3 + q0 * q1), 1 - 2 * (q1**2 + q2**2))
    heading = (1.5 * np.pi - yaw) % (2 * np.pi) - np.pi
    return {
        "auv_depth": body[..., BodyColumn.depth],
        "auv_attitude": np.stack([heading, pitch, roll], -1).astype(np.float32),
        "auv_fins": body[..., BodyColumn.span("rudder", "propeller")],
    }


def record(
    world: World,
    act: Callable[[torch.Tensor], torch.Tensor],
    policy: str,
    *,
    steps: int | None = None,
    surface: bool = False,
    on_step: Callable[[int], None] = lambda done: None,
) -> Trace:
    """Reset the world, run it for `steps` mission steps (default: one episode) and return the trace.

    Args:
        act: observation (W, K, O) → action (W, K, 2).
        policy: name of the policy.
        surface: also record the elevation of world 0's sea, at most `SURFACE_PIXELS` per side, on the disk.
        on_step: called with the number of steps done; an exception that it raises ends the run.

    Raises:
        ScenarioError: each world has its own seed.
        MemoryNeeded: the record does not fit into memory.
        OutputError: the surface does not fit on the disk.
        Diverged: a number is not finite or out of range; the error has the trace of the steps before.
    """
    world.seeds.common()  # refuses, before the run, worlds of which there can be no trace
    steps = steps or world.steps
    check_room(world.scenario, world.num_worlds, steps)
    recorder, problem = Recorder(world), None
    observation = world.reset()
    where = f"the sea of {steps} steps"
    with RowsOnDisk(steps, world.surface(SURFACE_PIXELS).shape, where) if surface else nullcontext() as sea:
        for done in range(1, steps + 1):
            action = act(observation)
            try:
                observation = world.step(action)[0]
            except DivergenceError as error:
                if done == 1:
                    raise
                problem = error
                break
            recorder.add()
            if sea:
                sea.append(world.surface(SURFACE_PIXELS)[None])
            on_step(done)
        elevation = sea.array() if sea else np.zeros((0, 0, 0), np.float32)
    storm = world.short_waves() if surface else NO_STORM
    trace = recorder.trace(policy, elevation, storm, start=world.scenario.mission.step)
    if problem:
        raise Diverged(str(problem), trace) from problem
    return trace
