"""Base of all policies, and how they act in many worlds."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import torch
from torch import Tensor

from usvauv.env.scenario import Scenario
from usvauv.kernels import runtime
from usvauv.kernels.errors import UserError

PIECE = 2048  # AUVs for which a thread is worth its start


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


def by_pieces(function: Callable[..., Tensor], *tensors: Tensor) -> Tensor:
    """A function of tensors (W, K, ...) of which each world's part depends on that world alone; evaluated without
    gradients.

    On a CPU many worlds are divided among the cores, in pieces of `PIECE` AUVs or more, each with one thread of torch.
    So a small batch wakes no thread, no core waits for another after each operation, and the result is the same for any
    number of cores.
    """

    def one(*piece: Tensor) -> Tensor:
        with torch.no_grad():  # which holds in one thread
            return function(*piece)

    first = tensors[0]
    count = min(first.shape[:2].numel() // PIECE, runtime.start().threads)
    if count < 2 or first.device.type != "cpu":
        return one(*tensors)
    with ThreadPoolExecutor(count) as pool:
        return torch.cat(list(pool.map(one, *(tensor.tensor_split(count) for tensor in tensors))))
