"""Base classes of policies, and parallel evaluation in many worlds."""

from __future__ import annotations

import math
import os
from abc import abstractmethod
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any, ClassVar, Protocol

import torch
from torch import Tensor

from usvauv.env.scenario import Scenario
from usvauv.env.world.observation_layout import ObservationLayout
from usvauv.kernels import runtime

PIECE = 2048  # AUVs for which waking a thread saves time
LARGEST_PIECE = 8192  # AUVs for which a layer of 128 stays in the cache


class Policy:
    """Actions for observations of all AUVs of all worlds at once, without exploration.

    Attributes:
        name: its name in tables.
        scenario: of the world it acts in: sizes, speed limits, form of the action.
    """

    def __init__(self, name: str, scenario: Scenario) -> None:
        self.name = name
        self.scenario = scenario

    @abstractmethod
    def act(self, observation: Tensor) -> Tensor:
        """Actions (W, K, A) in [−1, 1] for observations (W, K, O)."""
        raise NotImplementedError


class HeuristicWorld(Protocol):
    """What heuristics read of the world they act in; a `World`, or a frame's observation, has it."""

    scenario: Scenario

    def current(self) -> Tensor:
        """Velocity of the water at each AUV, (W, K, 2), m/s."""
        ...

    def water_velocity(self) -> Tensor:
        """Velocity of each AUV through the water, (W, K, 2), m/s."""
        ...


class Heuristic(Policy):
    """A policy without learning.

    Args:
        name: its name in tables, such as "crab:1.4".
        world: the world it acts in, whose true state it may read.
        argument: value that `parse` gave for the text after the colon in `name`.

    Attributes:
        parameter: name of that argument and its unit, as lists show them; empty without one.
    """

    parameter: ClassVar[tuple[str, str]] = ("", "")

    def __init__(self, name: str, world: HeuristicWorld, argument: Any) -> None:
        super().__init__(name, world.scenario)
        self.world = world
        self.argument = argument
        self.layout = ObservationLayout.of(world.scenario)
        self._target, self._position = self.layout.slice("target"), self.layout.slice("position")

    def target(self, observation: Tensor) -> Tensor:
        """Offset of the target from the measured position, (W, K, 2), over the area's diagonal."""
        return observation[..., self._target]

    def position(self, observation: Tensor) -> Tensor:
        """Measured position, (W, K, 2), over the area's diagonal."""
        return observation[..., self._position]

    @classmethod
    def parse(cls, text: str | None, scenario: Scenario) -> Any:
        """The argument from the text after the colon in the name; `text` is None if the name has no colon.

        Raises:
            ValueError: not allowed in this scenario; the message has what is.
        """
        if text is not None:
            raise ValueError("takes no parameter")


def number(text: str, expected: str) -> float:
    """Read a number; `expected` describes it.

    Raises:
        ValueError: not a number.
    """
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{text!r} is not {expected}") from None


def by_component(value: Tensor) -> Tensor:
    """A copy of numbers (..., n) with each component of all AUVs contiguous in memory.

    Operations on a component take a fraction of the time.
    """
    return value.movedim(-1, 0).contiguous().movedim(0, -1)


@cache
def _threads(process: int) -> ThreadPoolExecutor:
    """One thread for each core, kept, because starting threads takes longer than many pieces; a forked process has
    none of them."""
    return ThreadPoolExecutor(runtime.start().threads)


def by_pieces(function: Callable[..., Sequence[Tensor]], *tensors: Tensor) -> list[Tensor]:
    """Evaluate, without gradients, a function of tensors (W, K, ...) whose results for a world depend only on it.

    On a CPU many AUVs are divided among the cores, in pieces of `PIECE` to `LARGEST_PIECE` AUVs, each with one thread
    of torch. So a small batch wakes no thread, cores do not wait for each other after each operation, intermediate
    results stay in the core's cache, and the result is the same for any number of cores.
    """

    def one(*piece: Tensor) -> list[Tensor]:
        with torch.no_grad():  # applies to one thread only
            return [result.contiguous() for result in function(*map(by_component, piece))]

    auvs = tensors[0].shape[:2].numel()
    count = max(min(auvs // PIECE, runtime.start().threads), math.ceil(auvs / LARGEST_PIECE))
    if count < 2 or tensors[0].device.type != "cpu":
        return one(*tensors)
    pieces = _threads(os.getpid()).map(one, *(each.tensor_split(count) for each in tensors))
    return [torch.cat(parts) for parts in zip(*pieces, strict=True)]
