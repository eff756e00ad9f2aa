"""Many vehicles alone in water that is given: for studies of control, and to see how fast they are.

A structure of LANES vehicles lies in memory as vectors: `load` and `store` fit all of `vehicle`.
"""

import math
from collections import namedtuple
from collections.abc import Mapping
from typing import Any

import numpy as np
import taichi as ti
import torch

from usvauv.kernels import runtime
from usvauv.kernels.functions import func, kernel
from usvauv.kernels.launch import Launch
from usvauv.kernels.types import array1
from usvauv.kernels.vehicles import torpedo  # noqa: F401 registers it
from usvauv.kernels.vehicles.vehicle import LANES, Actuators, Body, Command, Memory, Surroundings, lanes, vehicles

vectors = ti.types.ndarray(dtype=lanes, ndim=1)
# Functions of a vehicle, and whether its autopilot steers.
Flight = namedtuple("Flight", "advance control trim commanded")
KINDS: tuple[Any, ...] = (Body, Memory, Command, Actuators, Surroundings)
NAMES = {kind: tuple(kind.members) for kind in KINDS}
SIZES = tuple(len(NAMES[kind]) for kind in KINDS)


@func
def load(array: ti.template(), first, kind: ti.template()):
    """A structure of LANES vehicles from vectors that follow one another, its fields in their order."""
    return kind(*[array[first + i] for i in ti.static(range(len(kind.members)))])


@func
def store(array: ti.template(), first, structure):
    """What `load` reads."""
    for i, value in ti.static(enumerate(structure.entries.values())):
        array[first + i] = value


@kernel
def fly(
    state: vectors,
    memory: vectors,
    command: vectors,
    told: vectors,
    water: vectors,
    table: array1,
    blocks: ti.i32,
    steps: ti.i32,
    dt: ti.f32,
    flight: ti.template(),
):
    """Advance blocks of LANES vehicles by `steps` substeps of `dt` s."""
    ti.loop_config(block_dim=1)
    for b in range(blocks):
        body = load(state, b * SIZES[0], Body)
        kept = load(memory, b * SIZES[1], Memory)
        wanted = load(command, b * SIZES[2], Command)
        actuators = load(told, b * SIZES[3], Actuators)
        around = load(water, b * SIZES[4], Surroundings)
        for _ in range(steps):
            if ti.static(flight.commanded):
                actuators, kept = flight.control(table, body, kept, wanted, around, body.depth * 0.0, dt)
            body = flight.advance(table, body, actuators, around, dt)
        store(state, b * SIZES[0], body)
        store(memory, b * SIZES[1], kept)


@kernel
def place(state: vectors, memory: vectors, command: vectors, table: array1, blocks: ti.i32, flight: ti.template()):
    """Trim the vehicles at what they are commanded, with empty memories."""
    ti.loop_config(block_dim=1)
    for b in range(blocks):
        wanted = load(command, b * SIZES[2], Command)
        store(state, b * SIZES[0], flight.trim(table, wanted.speed, wanted.depth, wanted.heading))
        for i in ti.static(range(SIZES[1])):
            memory[b * SIZES[1] + i] = wanted.speed * 0.0


class Fleet:
    """Vehicles of one model, each with its own state, command and water, which stay in the device's memory.

    Args:
        count: number of vehicles.
        model: name of the model.
        numbers: of the model, instead of its defaults.

    Attributes:
        state, memory, command, actuators, water: packed, (blocks, fields, LANES) float32: `Body`, `Memory`, `Command`,
            `Actuators`, `Surroundings`. The water is at rest and 1000 m deep, its factors are 1. `field` shows one
            field of all vehicles.
    """

    def __init__(self, count: int, model: str = "torpedo", numbers: Mapping[str, float] | None = None) -> None:
        device = runtime.start().device
        vehicle = vehicles[model]
        self.count, self.substep = count, vehicle.substep
        self._vehicle, self._blocks = vehicle, math.ceil(count / LANES)
        defaults = {name: number.default for name, number in vehicle.numbers.items()}
        self._table = torch.from_numpy(vehicle.table_of(defaults | dict(numbers or {}))).to(device)
        packed = (torch.zeros(self._blocks, size, LANES, device=device) for size in SIZES)
        self.state, self.memory, self.command, self.actuators, self.water = packed
        self.field("q0")[:] = 1.0
        for name in ("mass", "drag", "fins"):
            self.field(name, Surroundings)[:] = 1.0
        self.field("bed", Surroundings)[:] = 1000.0

    def field(self, name: str, kind: Any = Body) -> torch.Tensor:
        """One field of all vehicles, (blocks, LANES); what is written there is theirs."""
        index = KINDS.index(kind)
        packed = (self.state, self.memory, self.command, self.actuators, self.water)[index]
        return packed[:, NAMES[kind].index(name)]

    def numpy(self, name: str, kind: Any = Body) -> np.ndarray:
        """One field of all vehicles, (count,), a copy in double precision."""
        return self.field(name, kind).reshape(-1)[: self.count].double().cpu().numpy()

    def set(self, kind: Any = Body, **fields: object) -> None:
        """Write fields of all vehicles: a number for all, or (count,) numbers."""
        for name, value in fields.items():
            numbers = np.broadcast_to(np.asarray(value, np.float32), (self.count,))
            filled = np.resize(numbers, self._blocks * LANES).reshape(self._blocks, LANES)
            self.field(name, kind)[:] = torch.from_numpy(filled)

    def trim(self) -> None:
        """Put the vehicles level and straight at the speed, depth and heading that they are commanded."""
        arrays = (tensor.view(-1, LANES) for tensor in (self.state, self.memory, self.command))
        Launch(
            place, *arrays, self._table, self._blocks, self._flight(False), settings=runtime.vectors_in_registers()
        )()

    def _flight(self, commanded: bool) -> Flight:
        return Flight(self._vehicle.advance, self._vehicle.control, self._vehicle.trim, commanded)

    def flight(self, steps: int, dt: float | None = None, commanded: bool = False) -> Launch:
        """What advances the vehicles by `steps` substeps of `dt` s (default: the model's longest) at each call.

        Args:
            commanded: the autopilot follows `command`; otherwise `actuators` stay as they are.
        """
        packed = (self.state, self.memory, self.command, self.actuators, self.water)
        return Launch(
            fly,
            *(tensor.view(-1, LANES) for tensor in packed),
            *(self._table, self._blocks, steps, self.substep if dt is None else dt),
            self._flight(commanded),
            settings=runtime.vectors_in_registers(),
        )
