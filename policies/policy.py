"""Base of all policies, and how they act in many worlds."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import torch
from torch import Tensor

from usvauv.env.scenario import Scenario
from usvauv.kernels import runtime
from usvauv.kernels.errors import UserError

PIECE = 2048  # AUVs for which it is worth waking a thread
LARGEST_PIECE = 8192  # AUVs of which a layer of 128 stays in the cache


class PolicyError(UserError, ValueError):
    """A policy cannot be used; the message is one line that names it and what is allowed."""


class Policy:
    """Actions for observations of all AUVs of all worlds at once, without exploration.

    Attributes:
        name: what it is called in tables.
        scenario: that of the world it acts in: sizes, speed limits, form of the action.
    """

    def __init__(self, name: str, scenario: Scenario) -> None:
        self.name = name
        self.scenario = scenario

    def act(self, observation: Tensor) -> Tensor:
        """Actions (W, K, A) in [−1, 1] for observations (W, K, O)."""
        raise NotImplementedError


def by_component(value: Tensor) -> Tensor:
    """The same numbers (..., n), each component's of all AUVs one after the other in memory; operations on a component
    take a fraction of the time."""
    return value.movedim(-1, 0).contiguous().movedim(0, -1)


@cache
def _threads(process: int) -> ThreadPoolExecutor:
    """One for each core, kept, because to start them takes longer than many a piece; a process that is forked has none
    of them."""
    return ThreadPoolExecutor(runtime.start().threads)


def in_pieces(function: Callable[..., Tensor], axis: int, auvs: int, *tensors: Tensor) -> Tensor:
    """A function of tensors, each part of which along an axis depends on the same part of theirs alone; evaluated
    without gradients.

    On a CPU many AUVs are divided among the cores, in pieces of `PIECE` to `LARGEST_PIECE` of them, each with one
    thread of torch. So a small batch wakes no thread, no core waits for another after each operation, what one
    operation hands to the next stays in the core's cache, and the result is the same for any number of cores.
    """

    def one(*piece: Tensor) -> Tensor:
        with torch.no_grad():  # which holds in one thread
            return function(*piece)

    count = max(min(auvs // PIECE, runtime.start().threads), math.ceil(auvs / LARGEST_PIECE))
    if count < 2 or tensors[0].device.type != "cpu":
        return one(*tensors)
    return torch.cat(list(_threads(os.getpid()).map(one, *(each.tensor_split(count, axis) for each in tensors))), axis)


def by_pieces(function: Callable[..., Tensor], *tensors: Tensor) -> Tensor:
    """A function of tensors (W, K, ...) of which each world's part depends on that world alone, see `in_pieces`."""

    def one(*piece: Tensor) -> Tensor:
        return function(*map(by_component, piece)).contiguous()

    return in_pieces(one, 0, tensors[0].shape[:2].numel(), *tensors)
