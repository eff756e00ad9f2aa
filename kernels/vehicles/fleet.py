"""Many vehicles without interaction in given water: for studies of control, and to measure speed."""

import math
from collections import namedtuple
from collections.abc import Mapping
from typing import Any

import numpy as np
import taichi as ti
import torch

from usvauv.kernels import runtime
from usvauv.kernels.functions import Launch, kernel
from usvauv.kernels.types import array1
from usvauv.kernels.vehicles import torpedo  # noqa: F401 registers it
from usvauv.kernels.vehicles.definition import vehicles
from usvauv.kernels.vehicles.vehicle import (
    LANES,
    Actuators,
    Body,
    Command,
    Memory,
    Surroundings,
    blocks,
    load,
    store,
)

# Functions of a vehicle, and whether its autopilot steers.
Flight = namedtuple("Flight", "advance control trim commanded")
KINDS: tuple[Any, ...] = (Body, Memory, Command, Actuators, Surroundings)
NAMES = {kind: tuple(kind.members) for kind in KINDS}
SIZES = tuple(len(NAMES[kind]) for kind in KINDS)


@kernel
def fly(
    state: blocks,
    memory: blocks,
    command: blocks,
    told: blocks,
    water: blocks,
    table: array1,
    steps: ti.i32,
    dt: ti.f32,
    flight: ti.template(),
):
    """Advance blocks of LANES vehicles by `steps` substeps of `dt` s."""
    ti.loop_config(block_dim=1)
    for b in range(state.shape[0]):
        body = load(state, b, Body, ti.static(range(SIZES[0])))
        kept = load(memory, b, Memory, ti.static(range(SIZES[1])))
        wanted = load(command, b, Command, ti.static(range(SIZES[2])))
        actuators = load(told, b, Actuators, ti.static(range(SIZES[3])))
        around = load(water, b, Surroundings, ti.static(range(SIZES[4])))
        for _ in range(steps):
            if ti.static(flight.commanded):
                actuators, kept = flight.control(table, body, kept, wanted, around, body.depth * 0.0, dt)
            body = flight.advance(table, body, actuators, around, dt)
        store(state, b, body, ti.static(range(SIZES[0])))
        store(memory, b, kept, ti.static(range(SIZES[1])))


@kernel
def place(state: blocks, memory: blocks, command: blocks, table: array1, flight: ti.template()):
    """Trim the vehicles at what they are commanded, with empty memories."""
    ti.loop_config(block_dim=1)
    for b in range(state.shape[0]):
        wanted = load(command, b, Command, ti.static(range(SIZES[2])))
        trimmed = flight.trim(table, wanted.speed, wanted.depth, wanted.heading)
        store(state, b, trimmed, ti.static(range(SIZES[0])))
        store(memory, b, Memory(), ti.static(range(SIZES[1])))


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
        self._vehicle, self._blocks = vehicle, math.ceil(count / LANES)
        defaults = {name: number.default for name, number in vehicle.numbers.items()}
        given = defaults | dict(numbers or {})
        self.count, self.substep = count, vehicle.substep(given, 0.0)
        self._table = torch.from_numpy(vehicle.table_of(given)).to(device)
        packed = (torch.zeros(self._blocks, size, LANES, dtype=torch.float32, device=device) for size in SIZES)
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
        arrays = self.state, self.memory, self.command, self._table
        Launch(place, *arrays, self._flight(False), settings=runtime.vectors_in_registers())()

    def _flight(self, commanded: bool) -> Flight:
        return Flight(self._vehicle.advance, self._vehicle.control, self._vehicle.trim, commanded)

    def flight(self, steps: int, dt: float | None = None, commanded: bool = False) -> Launch:
        """A launch that advances the vehicles by `steps` substeps of `dt` s (default: the model's longest) per call.

        Args:
            commanded: the autopilot follows `command`; otherwise `actuators` stay as they are.
        """
        packed = (self.state, self.memory, self.command, self.actuators, self.water)
        return Launch(
            fly,
            *packed,
            *(self._table, steps, self.substep if dt is None else dt),
            self._flight(commanded),
            settings=runtime.vectors_in_registers(),
        )
