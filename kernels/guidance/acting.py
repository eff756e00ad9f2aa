"""Actions of learned policies and of heuristics on a CPU, from observations to commands in one pass, sixteen AUVs side
by side.

Except for rounding equal to frames of `usvauv.policies.frames`, with an actor of `usvauv.policies.networks` between
features and action, and to the heuristics `loiter` and `pass`. In torch these are some hundred operations: for few AUVs
mostly overhead, for many a pass over memory each.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import taichi as ti
import torch

from usvauv.kernels import runtime
from usvauv.kernels.functions import LANES, Launch, compiled_together, kernel
from usvauv.kernels.guidance.lanes import (
    CHOSEN,
    FrameNumber,
    Start,
    Tables,
    Term,
    encode,
    load,
    offset,
    relative,
    see,
    side_by_side,
    steered,
    write,
)
from usvauv.kernels.guidance.network import (
    TILE,
    Layer,
    Packed,
    forward,
    groups_of,
    parts_of,
    rooms,
    rows_of,
    standardised,
    tiles,
)
from usvauv.kernels.transcendental import hyperbolic_tangent, lanes
from usvauv.kernels.types import array1, array2, index1, index2

ALIKE: Any = {"dtype": torch.float32, "device": "cpu"}  # whatever a program has made torch's defaults
KNOWN = 4  # numbers of what a heuristic reads of its world: current and velocity through the water


@kernel
def act(
    seen: array2,
    commands: array2,
    room: rooms,
    column: index1,
    number: array1,
    task: array1,
    speeds: array2,
    rule: index2,
    unit: array1,
    mean: array1,
    deviation: array1,
    packed: tiles,
    bias: array1,
    layers: index2,
    auvs: ti.i32,
    networks: ti.i32,
    start: ti.template(),
    serial: ti.template(),
):
    """The world's actions (W K, A) for observations (W K, O).

    Args:
        room: of each part of the AUVs, with place for what is seen and twice for a layer.
        column, number, task, speeds: see `Tables`.
        rule, unit: of features from `FIRST` on, which are divided by the unit.
        mean, deviation: of the features, (F,).
        packed, bias, layers: of the networks, see `forward`.
        networks: 1 that AUVs share, or one for each of a world.
        serial: the calling thread does it all.
    """
    ti.loop_config(serialize=serial, block_dim=1)
    for part in range(room.shape[0]):
        tables = ti.static(Tables(column, number, task, speeds))
        count = seen.shape[0] // networks
        first = seen.shape[1] + CHOSEN
        second = (first + room.shape[1]) // 2
        first_group, end_of_groups = groups_of(part, room.shape[0], count, networks)
        for group in range(first_group, end_of_groups):
            network, rows = rows_of(group, count, networks)
            heading, speed = see(seen, rows, room, part, auvs, tables, start)
            encode(room, part, auvs, tables, rule, unit, mean.shape[0], first)
            for f in range(mean.shape[0]):
                room[part, first + f] = standardised(room[part, first + f], mean[f], deviation[f])
            for f in range(mean.shape[0], TILE * layers[0, Layer.inputs]):
                room[part, first + f] = lanes(0.0)
            at = forward(packed, bias, layers, network, room, part, first, second)
            for component in range(2):
                room[part, at + component] = hyperbolic_tangent(room[part, at + component])
            if ti.static(start >= Start.LOITER):
                way, pace = offset(room, part, at, heading, speed, number)
                write(commands, rows, way, pace, number)
            else:
                way, pace = relative(room, part, at, auvs, tables, start)
                write(commands, rows, way, pace, number)


@kernel
def describe(
    seen: array2,
    features: array2,
    headings: array2,
    room: rooms,
    column: index1,
    number: array1,
    task: array1,
    speeds: array2,
    rule: index2,
    unit: array1,
    auvs: ti.i32,
    start: ti.template(),
    serial: ti.template(),
):
    """Features (W K, F) and, with a heuristic, its headings (x, y) and speeds (W K, 3); arguments as of `act`."""
    ti.loop_config(serialize=serial, block_dim=1)
    for part in range(room.shape[0]):
        tables = ti.static(Tables(column, number, task, speeds))
        first_group, end_of_groups = groups_of(part, room.shape[0], seen.shape[0], 1)
        first = seen.shape[1] + CHOSEN
        for group in range(first_group, end_of_groups):
            _, rows = rows_of(group, seen.shape[0], 1)
            heading, speed = see(seen, rows, room, part, auvs, tables, start)
            for n in ti.static(range(LANES)):
                headings[rows[n], 0] = heading[0][n]
                headings[rows[n], 1] = heading[1][n]
                headings[rows[n], 2] = speed[n]
            encode(room, part, auvs, tables, rule, unit, features.shape[1], first)
            for f in range(features.shape[1]):
                feature = room[part, first + f]
                for n in ti.static(range(LANES)):
                    features[rows[n], f] = feature[n]


@kernel
def command(
    seen: array2,
    actions: array2,
    headings: array2,
    commands: array2,
    room: rooms,
    column: index1,
    number: array1,
    task: array1,
    speeds: array2,
    auvs: ti.i32,
    start: ti.template(),
    serial: ti.template(),
):
    """The world's actions (W K, A) for those of a network (W K, 1 or 2), after `describe`; arguments as of `act`."""
    ti.loop_config(serialize=serial, block_dim=1)
    for part in range(room.shape[0]):
        tables = ti.static(Tables(column, number, task, speeds))
        first_group, end_of_groups = groups_of(part, room.shape[0], seen.shape[0], 1)
        at = seen.shape[1] + CHOSEN
        for group in range(first_group, end_of_groups):
            _, rows = rows_of(group, seen.shape[0], 1)
            for component in range(actions.shape[1]):
                room[part, at + component] = side_by_side(actions, rows, component)
            if ti.static(start >= Start.LOITER):
                heading = side_by_side(headings, rows, 0), side_by_side(headings, rows, 1)
                way, pace = offset(room, part, at, heading, side_by_side(headings, rows, 2), number)
                write(commands, rows, way, pace, number)
            else:
                load(seen, rows, room, part)
                way, pace = relative(room, part, at, auvs, tables, start)
                write(commands, rows, way, pace, number)


@kernel
def guide(
    seen: array2,
    commands: array2,
    room: rooms,
    column: index1,
    number: array1,
    task: array1,
    speeds: array2,
    auvs: ti.i32,
    start: ti.template(),
    serial: ti.template(),
):
    """The world's actions (W K, A) of `loiter` or `pass`, for observations with current and velocity after them."""
    ti.loop_config(serialize=serial, block_dim=1)
    for part in range(room.shape[0]):
        tables = ti.static(Tables(column, number, task, speeds))
        first_group, end_of_groups = groups_of(part, room.shape[0], seen.shape[0], 1)
        for group in range(first_group, end_of_groups):
            _, rows = rows_of(group, seen.shape[0], 1)
            load(seen, rows, room, part)
            heading, speed = steered(room, part, auvs, tables, start, True)
            write(commands, rows, heading, speed, number)


@dataclass(frozen=True)
class Steering:
    """How the AUVs of a scenario are steered, for the kernels of this file.

    Attributes:
        start: what actions are relative to.
        auvs: K. observed: O, numbers of an observation. commands: A, numbers of the world's action.
        columns: where terms begin, by name, see `Term`.
        numbers: by name, see `FrameNumber`.
        task: see `usvauv.kernels.guidance.passing.Task`; empty where there is no heuristic.
        speeds: among which an autopilot chooses, ascending, and their powers, m/s and W; None without one.
        rules: of features from `FIRST` on, `Rule` and unit; `observed` is the column of the heuristic's velocity.
    """

    start: Start
    auvs: int
    observed: int
    commands: int
    columns: Mapping[str, int]
    numbers: Mapping[str, float]
    task: Sequence[float]
    speeds: tuple[torch.Tensor, torch.Tensor] | None
    rules: Sequence[tuple[int, int, int, float]] = ()

    def tables(self) -> Tables:
        """Tensors in the CPU's memory."""
        return Tables(
            torch.tensor([self.columns.get(name, 0) for name in Term.names], dtype=torch.int32, device="cpu"),
            torch.tensor([self.numbers[name] for name in FrameNumber.names], **ALIKE),
            torch.tensor(self.task or [0.0], **ALIKE),
            torch.zeros(2, 1, **ALIKE) if self.speeds is None else torch.stack(self.speeds).to(**ALIKE),
        )

    def features(self) -> tuple[torch.Tensor, torch.Tensor]:
        """Rules and units, (F, 3) and (F,)."""
        rule = torch.tensor([each[:3] for each in self.rules], dtype=torch.int32, device="cpu")
        return rule, torch.tensor([each[3] for each in self.rules], **ALIKE)


def settings() -> runtime.Settings:
    """Settings of Taichi's compiler for the kernels of this file."""
    return {**runtime.vectors_in_registers(), **runtime.fast_compilation()}


class Acting:
    """Acts for the AUVs of one batch of worlds by a network, with memory of its own.

    Args:
        worlds: W.
        mean, deviation: of the features, (F,); may change in place.
        weights, biases: of each layer of the actors, one for each AUV or a shared one, see `Packed`; of the outputs the
            first two count, after a tanh.
    """

    def __init__(
        self,
        steering: Steering,
        worlds: int,
        mean: torch.Tensor,
        deviation: torch.Tensor,
        weights: Sequence[torch.Tensor],
        biases: Sequence[torch.Tensor],
    ) -> None:
        auvs, count = steering.auvs, worlds * steering.auvs
        self._seen = torch.zeros(worlds, auvs, steering.observed, **ALIKE)
        self._command = torch.zeros(worlds, auvs, steering.commands, **ALIKE)
        self._packed = Packed(weights, biases)
        self._act = Launch(
            act,
            self._seen.view(count, -1),
            self._command.view(count, -1),
            self._packed.room(count, steering.observed + CHOSEN),
            *(*steering.tables(), *steering.features(), mean, deviation, *self._packed.arguments),
            *(auvs, self._packed.networks, steering.start, runtime.too_few_for_threads(count)),
            settings=settings(),
        )

    def __call__(self, observation: torch.Tensor) -> torch.Tensor:
        """Actions (W, K, A) for observations (W, K, O)."""
        self._seen.copy_(observation)
        self._packed.refresh()
        self._act()
        return self._command.clone()


class Conversion:
    """Features and commands of the AUVs of one batch of worlds, with memory of its own.

    Args:
        worlds: W.
        features: F. actions: numbers of a network's action.
    """

    def __init__(self, steering: Steering, worlds: int, features: int, actions: int) -> None:
        auvs, count = steering.auvs, worlds * steering.auvs
        self._seen = torch.zeros(worlds, auvs, steering.observed, **ALIKE)
        self._features = torch.zeros(worlds, auvs, features, **ALIKE)
        self._actions = torch.zeros(worlds, auvs, actions, **ALIKE)
        self._command = torch.zeros(worlds, auvs, steering.commands, **ALIKE)
        seen, found, chosen, commands = (
            each.view(count, -1) for each in (self._seen, self._features, self._actions, self._command)
        )
        headings = torch.zeros(count, 3, **ALIKE)
        room = torch.zeros(parts_of(count), steering.observed + CHOSEN + max(features, 2), LANES, **ALIKE)
        rest, tables = (auvs, steering.start, runtime.too_few_for_threads(count)), steering.tables()
        describing = seen, found, headings, room, *tables, *steering.features(), *rest
        commanding = seen, chosen, headings, commands, room, *tables, *rest
        with compiled_together():
            self._describe = Launch(describe, *describing, settings=settings())
            self._decide = Launch(command, *commanding, settings=settings())

    def features(self, observation: torch.Tensor) -> torch.Tensor:
        """Features (W, K, F) of observations (W, K, O)."""
        self._seen.copy_(observation)
        self._describe()
        return self._features.clone()

    def commands(self, action: torch.Tensor) -> torch.Tensor:
        """The world's actions (W, K, A) for those of a network, at the observations of the last `features`."""
        self._actions.copy_(action)
        self._decide()
        return self._command.clone()


class Guiding:
    """Acts for the AUVs of one batch of worlds by a heuristic, with memory of its own.

    Args:
        worlds: W.
    """

    def __init__(self, steering: Steering, worlds: int) -> None:
        auvs, count = steering.auvs, worlds * steering.auvs
        known = steering.observed, steering.observed + 2  # columns of what its world says
        self._seen = torch.zeros(worlds, auvs, steering.observed + KNOWN, **ALIKE)
        self._parts = self._seen.split((steering.observed, 2, 2), -1)
        self._command = torch.zeros(worlds, auvs, steering.commands, **ALIKE)
        own = replace(steering, columns={**steering.columns, "current": known[0], "motion": known[1]})
        self._guide = Launch(
            guide,
            self._seen.view(count, -1),
            self._command.view(count, -1),
            torch.zeros(parts_of(count), steering.observed + KNOWN, LANES, **ALIKE),
            *own.tables(),
            *(auvs, steering.start, runtime.too_few_for_threads(count)),
            settings=settings(),
        )

    def __call__(self, observation: torch.Tensor, current: torch.Tensor, velocity: torch.Tensor) -> torch.Tensor:
        """Actions (W, K, A) for observations (W, K, O), currents and velocities through the water (W, K, 2), m/s."""
        for part, given in zip(self._parts, (observation, current, velocity), strict=True):
            part.copy_(given)
        self._guide()
        return self._command.clone()
