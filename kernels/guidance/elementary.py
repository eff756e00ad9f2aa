"""Elementary operations on numbers of a kernel and on tensors of torch, so that an equation is written once for both.

A function made by `equation` computes, in a kernel, one number after another or `LANES` side by side, and with tensors
of torch as arguments as many as they hold, with gradients. A vector is a pair (x, y) of numbers.
"""

import functools
import math
from collections.abc import Callable
from typing import Any

import taichi as ti
import torch
from torch import Tensor

from usvauv.kernels.functions import func
from usvauv.kernels.transcendental import exponential as exponential_of_lanes
from usvauv.kernels.transcendental import half_cosine, half_sine, lanes


def are_tensors(numbers: Any) -> bool:
    """Whether one of some numbers, or of those in vectors among them, is a tensor of torch."""
    return any(isinstance(each, Tensor) or (isinstance(each, tuple) and are_tensors(each)) for each in numbers)


def equation(function: Callable) -> Callable:
    """Make a function one that kernels call, as `usvauv.kernels.functions.func` does, and that computes with tensors.

    Its operations are those of this module, additions, multiplications, divisions and comparisons; of whole vectors of
    lanes there is no negative, so −x is written 0 − x.
    """
    compiled: Any = func(function)

    @functools.wraps(function)
    def computed(*arguments: Any) -> Any:
        return (function if are_tensors(arguments) else compiled)(*arguments)

    computed.__dict__.update(compiled.__dict__)
    return computed


def _operation(of_kernels: Any, of_torch: Callable) -> Any:
    def computed(*numbers: Any) -> Any:
        return (of_torch if are_tensors(numbers) else of_kernels)(*numbers)

    computed.__dict__["_is_taichi_function"] = False  # known to Taichi, and not to be compiled
    return computed


@func
def _turn(half_turns):
    """Cosine and sine of at most half a turn."""
    half = 0.5 * half_turns
    cosine, sine = half_cosine(half), half_sine(half)
    return 1.0 - 2.0 * sine * sine, 2.0 * sine * cosine


def _cos_and_sin(half_turns: Tensor) -> tuple[Tensor, Tensor]:
    angle = math.pi * half_turns
    return torch.cos(angle), torch.sin(angle)


@func
def _select(condition, yes, no):
    return ti.select(condition, lanes(yes), lanes(no))


def _where(condition: Tensor, yes: Tensor | float, no: Tensor | float) -> Tensor:
    if isinstance(yes, float) and isinstance(no, float):  # whatever a program has made torch's defaults
        yes = torch.full((), yes, dtype=torch.float32, device=condition.device)
    return torch.where(condition, yes, no)


sqrt = _operation(ti.sqrt, torch.sqrt)
exponential = _operation(exponential_of_lanes, torch.exp)
maximum = _operation(ti.max, lambda x, least: torch.clamp(x, min=least))
minimum = _operation(ti.min, lambda x, most: torch.clamp(x, max=most))
cosine_and_sine = _operation(_turn, _cos_and_sin)  # of an angle in half turns, at most one
select = _operation(_select, _where)
