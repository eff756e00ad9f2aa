"""The arrays of all worlds, declared once, and the argument that a mission's functions pass on: `Worlds`.

The kernel's parameters (`usvauv.kernels.mission.run`), the memory of `World`, the contents of a stored state and their
ranges follow from `ARRAYS`.
"""

import functools
from collections import namedtuple
from collections.abc import Callable
from typing import Annotated, Any, NamedTuple

import taichi as ti

from usvauv.kernels import random
from usvauv.kernels.flow import airy
from usvauv.kernels.flow.vortex import Vortex
from usvauv.kernels.flow.vortex_motion import VortexDrift
from usvauv.kernels.functions import LANES, beyond, func, lanes, lanes_below_zero
from usvauv.kernels.mission.boats.boat_strategies import Strategy
from usvauv.kernels.mission.columns import (
    AuvColumn,
    BeliefColumn,
    BoatColumn,
    BodyColumn,
    Division,
    EstimateColumn,
    ExchangeColumn,
    Flag,
    ForesightColumn,
    KeyColumn,
    NodeColumn,
    Parameter,
    Range,
    ReceptionColumn,
    Sensor,
    StateColumns,
    TallyColumn,
)
from usvauv.kernels.mission.tasks.task import Task
from usvauv.kernels.positioning import tracker
from usvauv.kernels.taichi_internals import impl
from usvauv.kernels.types import Columns
from usvauv.kernels.vehicles import otter_numbers
from usvauv.kernels.vehicles.otter import HullColumn


class Program(NamedTuple):
    """Options compiled into the mission's kernels; options not chosen cost neither time nor compilation.

    Attributes:
        task: the AUVs' task.
        strategy: of the boats.
        target_rule: a `usvauv.kernels.mission.choices.TargetRule`, which chooses an AUV's next node.
        information: of `Information`.
        rate_law: of the data link, of `usvauv.kernels.positioning.acoustic_link`.
        observation: a function (worlds, w, k, first) for each term of an observation, which it writes from `first` on.
        objective_code: the boat's objective, from `usvauv.kernels.planning.objectives.objective_code`.
        refraction: sound is refracted in layers, and fixes include this.
        schedule: of `Schedule`.
        urgency: with `Schedule.one`: a function (worlds, w, b, k) → how urgent it is that boat b asks AUV k.
        messages: data take time on the channel, `usvauv.kernels.mission.link.messages`.
        sensor: of `Sensor`.
        turns: phases of a fix can lack whole turns, see `usvauv.kernels.positioning.usbl`.
        fleet: there is more than one boat.
        vehicle: AUVs are vehicles with dynamics, see `usvauv.kernels.mission.auvs.vehicles`.
        otter: boats move as in `usvauv.kernels.vehicles.otter`; else they are points.
        repeats: the pattern of vortices has a period.
        passing: nodes are served in passing, not hovering.
        battery: the AUVs' batteries end.
        abreast: AUVs side by side in a boat's rollouts, at least all; 0 if there are none.
        division: of `Division`.
        vortices_move: here, not in a launch of their own.
        checks: on a CPU the kernel looks for faults, with vectors in registers.
    """

    task: Task
    strategy: Strategy
    target_rule: Any
    rate_law: Callable[..., Any]
    observation: tuple[Callable[..., Any], ...]
    information: int
    objective_code: int
    refraction: bool
    schedule: int
    urgency: Callable[..., Any] | None
    messages: bool
    sensor: int
    turns: bool
    fleet: bool
    vehicle: bool
    otter: bool
    repeats: bool
    passing: bool
    battery: bool
    abreast: int
    division: int = Division.worlds
    vortices_move: bool = False
    checks: bool = False

    @property
    def serial(self) -> bool:
        """Whether the calling thread takes all worlds."""
        return self.division in (Division.calling_thread, Division.one_block)

    @property
    def in_lanes(self) -> bool:
        """Whether worlds take a step side by side."""
        return self.division in (Division.lanes, Division.one_block)

    @property
    def world_by_world(self) -> "Program":
        """The program in which worlds do not take a step side by side."""
        division = Division.calling_thread if self.serial else Division.worlds
        return self._replace(division=division) if self.in_lanes else self

    @property
    def in_threads(self) -> bool:
        """Whether the parts of a step are launches of their own."""
        return self.division == Division.threads

    @property
    def reckoning(self) -> bool:
        """Whether AUVs reckon their positions by a sensor of velocity."""
        return self.sensor != Sensor.none

    @property
    def weighs_apart(self) -> bool:
        """Whether a separate launch computes the losses of boats' goals."""
        return self.in_threads and self.strategy.weigh is not None


class Array(NamedTuple):
    """An array of all worlds.

    Attributes:
        axes: a letter each: W worlds, G groups of `LANES` AUVs of all worlds, K AUVs, B boats, M nodes, V
            vortices, I 1, or K where AUVs have beliefs of their own, O numbers of an observation, R reward terms; "."
            has another length.
        meaning: in words.
        columns: of a last axis that is numbered.
        dtype: of Taichi.
        whose: in a message: what the second axis counts.
        column_ranges: of the columns where `columns` does not have them.
    """

    axes: str
    meaning: str
    columns: type[Columns] | None = None
    dtype: Any = ti.f32
    whose: str = ""
    column_ranges: tuple[Range, ...] = ()

    @property
    def type(self) -> Any:
        """Taichi's type of the kernel's parameter."""
        return ti.types.ndarray(dtype=self.dtype, ndim=len(self.axes) + bool(self.columns or self.column_ranges))

    @property
    def ranges(self) -> tuple[Range, ...]:
        """Range of each column; empty if the last axis has no columns with ranges."""
        columns: Any = self.columns
        return columns.ranges if columns and issubclass(columns, StateColumns) else self.column_ranges

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return self.columns.names if self.columns else tuple(f"column {n}" for n in range(len(self.column_ranges)))


side_by_side = ti.types.vector(LANES, ti.f32)
WORLDS_PER_BLOCK = (
    32  # worlds that a thread takes through a stage, whose code stays in its cache, before it begins the next
)
ANYWHERE = Range(-1e12, 1e12)
TRACK = tracker.COLUMNS * (Range(-1e25, 1e25),)
SPEED, SPIN = (Range(-most, most) for most in (otter_numbers.FASTEST, otter_numbers.SPINNING))
REVOLUTIONS, SUM = Range(-1001.0, 1001.0), Range(-1e6, 1e6)
HULL = SUM, SPEED, SPEED, SPIN, REVOLUTIONS, REVOLUTIONS, SUM, SUM  # of `HullColumn`; the heading is that of all turns
DRIFT = (Range(-1e6, 1e6),) * len(VortexDrift.names)
VORTEX = ANYWHERE, ANYWHERE, Range(-1e5, 1e5), Range(0.0, 1e6)


class NoColumns(StateColumns):
    """Columns of a task's memory that it does not have."""

    unused: Annotated[int, Range(0.0, 0.0)]


def state_arrays(task: Task) -> dict[str, Array]:
    """`STATE` with the columns of a task's own memory."""
    own = {
        "task_auv": task.auv_columns,
        "task_node": task.node_columns,
        "task_pair": task.pair_columns,
        "task_boat": task.boat_columns,
    }
    return STATE | {name: STATE[name]._replace(columns=columns) for name, columns in own.items() if columns}


# Nothing changes these while worlds run.
TABLES = {
    "p": Array("", "numbers of the scenario", Parameter),
    "flag": Array("", "choices of the scenario", Flag, ti.i32),
    "link": Array("K.", "acoustic constants of each AUV, `usvauv.kernels.positioning.acoustic_link.link_table`"),
    "links": Array("G.", "columns of `link` of AUVs side by side, as often as these differ", dtype=side_by_side),
    "layers": Array("..", "sound speed profile, `usvauv.kernels.positioning.rays`"),
    "arrivals": Array("..", "Poisson arrivals, `usvauv.kernels.mission.tasks.data_collection.arrival_table`"),
    "fixed_vortex": Array("V", "vortices that are not drawn at random", Vortex),
    "strategy_arguments": Array(".", "numbers that the boat strategy was given, at least one"),
    "rule_numbers": Array(".", "numbers of the target rule, at least one"),
    "task_parameters": Array(".", "numbers that the task declares, at least one"),
    "otter": Array(".", "boats with dynamics, `usvauv.kernels.vehicles.otter_numbers.Number`"),
    "reward_weights": Array("R", "weights of the reward terms"),
    "observation_first": Array(".", "index of the first number of each term of an observation", dtype=ti.i32),
    "key": Array("W", "seed of each world", KeyColumn, ti.i32),
    "draw_numbers": Array(".", "what a step's draws are for, `usvauv.kernels.mission.draws`", dtype=random.long_lanes),
}
# Together with the clock and the sea everything that decides the worlds' future. A fault's cause is looked for in this
# order: what moves by itself comes before what depends on it in the same step.
STATE = {
    "vortex": Array("WV", "vortices of the water", Vortex, whose="vortex", column_ranges=VORTEX),
    "drift": Array("WV", "motion of their centres", VortexDrift, whose="the drift of vortex", column_ranges=DRIFT),
    "hull": Array("WB", "boats' hulls", HullColumn, whose="the hull of boat", column_ranges=HULL),
    "body": Array("WK", "vehicles with dynamics", BodyColumn, whose="the body of AUV"),
    "auv": Array("WK", "AUVs, and what the last step did and cost", AuvColumn, whose="AUV"),
    "node": Array("WM", "nodes or stations", NodeColumn, whose="node"),
    "boat": Array("WB", "boats", BoatColumn, whose="boat"),
    "tally": Array("W", "the channel, and counts of the last step", TallyColumn),
    "estimate": Array("WK", "the boats' estimate of each AUV", EstimateColumn, whose="the estimate of AUV"),
    "track": Array(
        "WK", "the boats' filters, `usvauv.kernels.positioning.tracker`", whose="the track of AUV", column_ranges=TRACK
    ),
    "own": Array(
        "WK",
        "the state of these filters that each AUV has and has moved on, with its covariance, and since when, s",
        whose="the reckoning of AUV",
        column_ranges=TRACK[: tracker.OWN_COLUMNS],
    ),
    "exchange": Array("WK", "exchanges over the channel", ExchangeColumn, whose="the exchange with AUV"),
    "foresight": Array("WK", "where the boats foresee each AUV", ForesightColumn),
    "belief": Array("WIM", "what is known of the nodes", BeliefColumn, whose="the belief, of all or of AUV"),
    # Their columns are those of the task, `state_arrays`.
    "task_auv": Array("WK", "what the task keeps of each AUV", NoColumns, whose="the task's memory of AUV"),
    "task_node": Array("WM", "what the task keeps of each node", NoColumns, whose="the task's memory of node"),
    "task_pair": Array("WKM", "what it keeps of each AUV and node", NoColumns, whose="the task's memory of AUV"),
    "task_boat": Array("WBM", "what it keeps of each boat and node", NoColumns, whose="the task's memory of boat"),
    "observation": Array("WKO", "what each AUV observes"),
}
REWARDS = {
    "reward": Array("WK", "sum of the reward terms"),
    "reward_terms": Array("WKR", "weighted reward terms"),
}
ARRAYS = {
    **TABLES,
    **STATE,
    **REWARDS,
    "clock": Array("W.", "episode, and mission steps done", dtype=ti.i32),
    "chosen": Array("W", "whether a world is to begin an episode, 0 or 1", dtype=ti.u8),
    "action": Array("WK.", "actions in [−1, 1]"),
    "horizon_ended": Array("WK", "whether a service ended the learner's value horizon, 0 or 1", dtype=ti.u8),
    "truncated": Array("WK", "whether the episode's time is over, 0 or 1", dtype=ti.u8),
    "workspace": Array("W.", "numbers that the target rule needs while it chooses, at least one"),
    "drawn": Array("W.", "random numbers drawn before a step, `usvauv.kernels.mission.draws`", dtype=random.lanes),
    "numbers": Array(".", "bits of all numbers of `STATE` and `REWARDS`, where they are looked at", dtype=lanes),
    "vortex_rows": Array(".", "all numbers of `vortex`, where many worlds' vortices move together", dtype=airy.lanes),
    "drift_rows": Array(".", "likewise of `drift`", dtype=airy.lanes),
    "pair_rows": Array(".", "all numbers of `task_pair`, side by side on a CPU", dtype=side_by_side),
    "room": Array("W.", "what the task needs while it updates a world", dtype=side_by_side),
    "due": Array(".", "set to 1 where vortices' motion is due to be renewed", dtype=ti.i32),
    "spans": Array("..", "of each array of these its first row, and numbers of a world", dtype=ti.i32),
    "which": Array(".", "of the bounds of all these numbers, `usvauv.kernels.functions.Limits`", dtype=ti.i32),
    "bounds": Array("..", "likewise", dtype=lanes),
    "fault": Array(".", "set to 1 where a stage finds a fault, of which the state has the place", dtype=ti.i32),
    "ways": Array("W.", "where AUVs are foreseen, for `WORLDS_PER_BLOCK` worlds", dtype=random.lanes),
    "profile": Array("WK.", "the current at the points of the AUVs' profilers, x and y, m/s"),
    "reception": Array("WK", "signals of a step and their fixes", ReceptionColumn),
}


class Rows(tuple[Any, ...]):
    """An array of all worlds in a kernel: `array[w, k, c]` as usual, and `array.x[w, k]` for the column named x.

    Its sizes except the first are read once per iteration. Taichi by default reads all sizes again at each access,
    since a preceding store might have changed them, which takes a tenth of a mission step.
    """

    @classmethod
    def of(cls, argument: Any, columns: type[Columns] | None = None, count: int = 0) -> "Rows":
        """An argument of the kernel, whose last axis has named columns, or a fixed number of them."""
        sizes = [impl.expr_init(size) for size in argument.shape[1:]]
        count = count or (len(columns.names) if columns else 0)
        if count:
            sizes[-1] = count
        return named_columns(columns)((argument, *sizes))

    @property
    def shape(self) -> tuple[Any, ...]:
        """Sizes of all axes."""
        argument, *sizes = self
        return argument.shape[0], *sizes

    def __getitem__(self, indices: Any) -> Any:
        """Taichi calls it for `array[w, k, c]`."""
        argument, *sizes = self
        indices = indices if isinstance(indices, tuple) else (indices,)
        if not impl.current_cfg().check_out_of_bound:
            place, *others = indices
            for size, index in zip(sizes, others, strict=True):
                place = place * size + index
            indices = *(0 for _ in others), place
        return impl.subscript(None, argument, *indices)


class Column(tuple[Any, ...]):
    """A column of `Rows`."""

    __slots__ = ()

    def __getitem__(self, indices: Any) -> Any:
        """Taichi calls it for `array.x[w, k]`."""
        rows, column = self
        return rows[(*indices, column) if isinstance(indices, tuple) else (indices, column)]


class Numbers(tuple[Any, ...]):
    """A row of named numbers in a kernel: `p.step`, or `p[Parameter.width + axis]`."""

    @classmethod
    def of(cls, argument: Any, columns: type[Columns]) -> "Numbers":
        """An argument of the kernel."""
        return named_numbers(columns)((argument,))

    def __getitem__(self, index: Any) -> Any:
        """Taichi calls it for `p[n]`."""
        (argument,) = self
        return impl.subscript(None, argument, index)


@functools.cache
def named_columns(columns: type[Columns] | None) -> type[Rows]:
    """`Rows` with an attribute for each column."""
    names = columns.names if columns else ()
    return type("Rows", (Rows,), {n: property(lambda rows, c=c: Column((rows, c))) for c, n in enumerate(names)})


@functools.cache
def named_numbers(columns: type[Columns]) -> type[Numbers]:
    """`Numbers` with an attribute for each."""
    return type("Numbers", (Numbers,), {n: property(lambda p, c=c: p[c]) for c, n in enumerate(columns.names)})


class Worlds(namedtuple("Worlds", ("program", "begins", "water", *ARRAYS))):
    """All worlds, as the functions of a mission take them: the arrays of `ARRAYS` by name, and besides

    Attributes:
        program: what is compiled, `Program`.
        begins: whether an episode begins, in the worlds that are `chosen`, rather than a step.
        water: `usvauv.kernels.flow.current.Water`.
    """

    __slots__ = ()


def worlds_per_block(program: Program) -> int:
    """Worlds of an iteration: several on a CPU, where there are many."""
    return WORLDS_PER_BLOCK if program.in_lanes else 1


@func
def find_faults(worlds: ti.template(), first, count):
    """Set `fault` if one of the numbers of some worlds is not finite or out of its range."""
    least = lanes(0)
    for a in range(worlds.spans.shape[0]):
        begin, each = worlds.spans[a, 0], ti.cast(worlds.spans[a, 1], ti.i64)
        end = begin + ti.cast(((first + count) * each + LANES - 1) // LANES, ti.i32)
        for row in range(begin + ti.cast(first * each // LANES, ti.i32), end):
            bounds = worlds.which[row]
            least |= beyond(worlds.numbers[row], worlds.bounds[bounds, 0], worlds.bounds[bounds, 1])
    if lanes_below_zero(least) > 0:
        worlds.fault[0] = 1
