"""Taichi functions and kernels of these packages: `func` and `kernel` in place of `ti.func` and `ti.kernel`, and
kernels bound to their arguments.

`func` and `kernel` behave as Taichi's, with two differences. A kernel runs under the settings of
`usvauv.kernels.runtime`, whatever other code in the process has passed to `ti.init`. And Taichi reads its source in
less than half the time (`usvauv.kernels.taichi_internals`).

The arrays of a world stay in place, so that a kernel gets their addresses once (`Launch`).

Torch has no Vulkan tensors, so a tensor that a kernel takes lies in the CPU's memory, and Taichi copies it to the
device and back at each launch. For arrays that only kernels use, launch after launch, this is most of the time
(`DeviceArrays`).
"""

import contextlib
import functools
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import taichi as ti
import torch

from usvauv.kernels import runtime
from usvauv.kernels.taichi_internals import BoundKernel, DeviceArray, TaichiFunction, TaichiKernel, parsed_once
from usvauv.kernels.taichi_internals import WholeVector as WholeVector
from usvauv.kernels.types import array1, index1, index3

LANE_BITS = 4
LANES = 1 << LANE_BITS  # numbers side by side in a vector
PARTS = 16  # of many numbers, among the threads of a CPU
LOOK = 1e-4  # µs, about, to look at a number among others
MANY = 1 << 18  # numbers, from which on several threads look at them
STREAMS = 4  # places that a thread reads in turns, so that more comes from memory at a time
MAGNITUDE = 0x7FFFFFFF  # bits of a number but for its sign
NOT_FINITE = 0x7F800000  # least magnitude of what is not finite
lanes = ti.types.vector(LANES, ti.i32)
rows = ti.types.ndarray(dtype=lanes, ndim=1)
rows2 = ti.types.ndarray(dtype=lanes, ndim=2)


def func(function: Callable) -> Callable:
    """Make a function one that kernels and other such functions call, as `ti.func` does."""
    made = TaichiFunction(function)

    @functools.wraps(function)
    def called(*args: Any, **kwargs: Any) -> Any:
        return made(*args, **kwargs)

    called.__dict__.update(_is_taichi_function=True, _is_real_function=False, func=made)
    return called


def kernel(function: Callable) -> Callable:
    """Make a function a kernel, as `ti.kernel` does, without gradients."""
    primal = TaichiKernel(function)

    @functools.wraps(function)
    def launched(*args: Any) -> Any:
        with runtime.settings():
            return primal(*args)

    launched.__dict__.update(_is_wrapped_kernel=True, _primal=primal)
    return launched


@contextlib.contextmanager
def compiled_together() -> Iterator[None]:
    """Kernels compiled meanwhile share much of their sources, which are parsed once."""
    with runtime.taichi_lock(), parsed_once():
        yield


class DeviceArrays:
    """Copies of contiguous float32 tensors, all of which the same kernels write, or none.

    A tensor that was written since is sent to the device as a whole before a launch; torch counts the writes of each
    tensor. What kernels wrote comes back by `fetch` alone. On the CPU and with CUDA the tensors themselves serve, and
    nothing is copied.

    Args:
        tensors: to copy; they keep their memory.

    Attributes:
        arguments: for a `Launch`, as `tensors`.
    """

    def __init__(self, tensors: Sequence[torch.Tensor]) -> None:
        self._tensors = tuple(tensors)
        self.arguments: tuple[Any, ...] = self._tensors
        self._copied = not runtime.start().shares_memory_with_torch
        self._ahead = False  # the device's copies
        if self._copied:
            copies = [ti.ndarray(ti.f32, tensor.numel()) for tensor in self._tensors]
            self._written = [-1] * len(copies)
            self.arguments = tuple(
                DeviceArray(tensor, memory, self) for tensor, memory in zip(self._tensors, copies, strict=True)
            )

    def send(self) -> None:
        """Copy tensors that were written since the last copy to the device."""
        for index, (tensor, argument) in enumerate(zip(self._tensors, self.arguments, strict=True)):
            if tensor._version != self._written[index]:
                argument.memory.from_numpy(tensor.view(-1).numpy())
                self._written[index] = tensor._version

    def mark_written(self) -> None:
        """A kernel has written the copies."""
        self._ahead = True

    def fetch(self) -> None:
        """Bring the tensors up to date with what kernels wrote, unless they were written since."""
        if self._ahead and self._written == [tensor._version for tensor in self._tensors]:
            for tensor, argument in zip(self._tensors, self.arguments, strict=True):
                tensor.view(-1).copy_(torch.from_numpy(argument.memory.to_numpy()))
            self._written = [tensor._version for tensor in self._tensors]  # views of one tensor count together
        self._ahead = False


class Launch:
    """A kernel with fixed arguments; calling it runs it.

    Where other code has started Taichi anew since, by `ti.init` or `ti.reset`, the kernel is compiled again.

    Args:
        kernel: one without return value.
        arguments: all its arguments by position. Tensors must be contiguous, stay on the kernel's device and keep their
            memory: they are held, and read and written at each call. A `DeviceArray` is not copied.
        settings: of Taichi's compiler, see `usvauv.kernels.runtime.settings`.

    Raises:
        ValueError: a tensor is not contiguous, or vectors do not begin at a multiple of `ALIGNMENT` bytes.
    """

    def __init__(self, kernel: Callable, *arguments: Any, settings: runtime.Settings = runtime.NONE) -> None:
        self._primal: Any = kernel._primal
        self._held, self._settings = arguments, settings
        self._on_device: dict[DeviceArrays, None] = {a.owner: None for a in arguments if isinstance(a, DeviceArray)}
        self._launched_in: runtime.Runtime | None = None
        with runtime.settings(settings):
            self._compile()

    def _compile(self) -> None:
        self._compiled_in = runtime.start()
        self._bound = BoundKernel(self._primal, self._held)

    def take(self, index: int, tensor: torch.Tensor) -> None:
        """Argument `index` is from now on another array, of as many numbers of the same type; only on a CPU."""
        self._bound.take(index, tensor)

    def __call__(self) -> None:
        for arrays in self._on_device:
            arrays.send()
        if self._launched_in is runtime.start():
            self._bound.launch()
        else:
            self._launch_first()
        for arrays in self._on_device:
            arrays.mark_written()

    def _launch_first(self) -> None:
        """Also finish to compile, which Taichi does at the first launch."""
        with runtime.settings(self._settings):
            if self._compiled_in is not runtime.start():
                self._compile()
            self._bound.launch()
        self._launched_in = self._compiled_in


@kernel
def copy_finite(given: array1, copy: array1, flag: index1):
    """Copy numbers in the calling thread, and set the flag to 1 if one is not finite, else to 0."""
    flag[0] = 0
    ti.loop_config(serialize=True)
    for n in range(copy.shape[0]):
        number = given[n]
        copy[n] = number
        if ti.bit_cast(number, ti.i32) & MAGNITUDE >= NOT_FINITE:
            flag[0] = 1


@kernel
def mark_outside(numbers: array1, limit: ti.f32, flag: index1):
    """Set the flag if one of the numbers is not finite or beyond ±`limit`."""
    for n in range(numbers.shape[0]):
        if flag[0] == 0 and not ti.abs(numbers[n]) <= limit:  # arrays not read are not sent: `docs/architectures.md`
            flag[0] = 1


@func
def lanes_above(values: lanes, limit: ti.i32) -> ti.i32:
    """Number of lanes that are above a limit."""
    above = lanes(0)
    above += ti.select(values > limit, lanes(1), lanes(0))
    return above.sum()


@kernel
def mark_rows_outside(bits: rows, limit: ti.i32, flag: index1):
    """`mark_outside` on a CPU by the bits of numbers and limit, LANES numbers side by side.

    Magnitudes are ordered as their bits are, and what is not finite comes last.
    """
    ti.loop_config(block_dim=1)
    for part in range(PARTS):
        count = (bits.shape[0] + STREAMS - 1) // STREAMS
        largest = lanes(0)
        for n in range(part * count // PARTS, (part + 1) * count // PARTS):
            for stream in ti.static(range(STREAMS)):
                row = n + stream * (bits.shape[0] - count) // (STREAMS - 1)
                largest = ti.max(largest, bits[row] & MAGNITUDE)
        if lanes_above(largest, limit) > 0:
            flag[0] = 1


class Limits(NamedTuple):
    """Bounds of numbers, rows of LANES side by side, which repeat from row to row.

    Attributes:
        which: row of `bits` for each row of the numbers, int32.
        bits: (rows, 2, LANES) int32: bits of the greatest number allowed, and those in which the magnitude of the least
            one, which is not above 0, differs from them.
    """

    which: torch.Tensor
    bits: torch.Tensor


@func
def beyond(numbers: lanes, greatest: lanes, difference: lanes) -> lanes:
    """Below 0 where the bits of a number are outside its `Limits`, or of one that is not finite."""
    return (greatest ^ (numbers >> 31 & difference)) - (numbers & MAGNITUDE)


@func
def lanes_below_zero(values: lanes) -> ti.i32:
    """Number of lanes that are below 0."""
    return -(values >> 31).sum()


@kernel
def mark_beyond(numbers: index1, which: index1, bits: index3, flag: index1):
    """Set the flag if one of some numbers is outside its limits; each number by itself."""
    for n in range(numbers.shape[0]):
        row, lane, number = which[n // LANES], n % LANES, numbers[n]
        limit = bits[row, 0, lane] ^ (number >> 31 & bits[row, 1, lane])
        if flag[0] == 0 and number & MAGNITUDE > limit:  # arrays not read are not sent: `docs/architectures.md`
            flag[0] = 1


@kernel
def mark_rows_beyond(serial: ti.template(), numbers: rows, which: index1, bits: rows2, flag: index1):
    """`mark_beyond` on a CPU, LANES numbers side by side."""
    ti.loop_config(serialize=serial, block_dim=1)
    for part in range(PARTS):
        least = lanes(0)
        for row in range(part * numbers.shape[0] // PARTS, (part + 1) * numbers.shape[0] // PARTS):
            least |= beyond(numbers[row], bits[which[row], 0], bits[which[row], 1])
        if lanes_below_zero(least) > 0:
            flag[0] = 1


class DeviceFlag:
    """Looks at numbers that kernels write, step after step.

    On a CPU it sees them as they are; at many of them, and on a device that torch cannot reach, a kernel looks. With
    CUDA it sees what a copy brought that an earlier look began, so that nobody waits: what a step writes is seen one
    step later.

    Args:
        numbers: to be looked at; they keep their memory.
        limit: largest magnitude; or `Limits`, for numbers in whole rows.
        flag: (1,) int32, 1 where a number is outside, which other kernels may set too; only with `Limits`.
    """

    def __init__(
        self, numbers: torch.Tensor | DeviceArray, limit: float | Limits, flag: torch.Tensor | None = None
    ) -> None:
        running = runtime.start()
        self._numbers: Any = numbers
        self._limit: Any = limit
        self._outside = torch.zeros(1, dtype=torch.int32, device=running.device) if flag is None else flag
        self._at_once = running.torch_on_host
        self._mark: Launch | None = None
        if isinstance(limit, Limits):
            bits = self._numbers.view(torch.int32)
            if running.on_cpu:
                serial = runtime.too_few_for_threads(round(LOOK * bits.numel()))
                arguments = serial, bits.view(-1, LANES), *limit, self._outside
                self._mark = Launch(mark_rows_beyond, *arguments, settings=runtime.vectors_in_registers())
            else:
                self._mark = Launch(mark_beyond, bits, *limit, self._outside)
        elif isinstance(numbers, DeviceArray):
            self._mark = Launch(mark_outside, numbers.view(-1), limit, self._outside)
        elif running.on_cpu and numbers.numel() >= MANY and numbers.numel() % LANES == 0:
            arguments = numbers.view(torch.int32).view(-1, LANES), np.float32(limit).view(np.int32), self._outside
            self._mark = Launch(mark_rows_outside, *arguments, settings=runtime.vectors_in_registers())
        if not self._at_once:
            self._copy = torch.zeros(1, dtype=torch.int32, device="cpu", pin_memory=torch.cuda.is_available())
            self._seen = self._copy.numpy()

    def forget(self) -> None:
        """Stop reporting faults seen so far."""
        self._outside.zero_()
        if not self._at_once:
            self._copy.copy_(self._outside)

    def raised(self) -> bool:
        """Whether one of the numbers is not finite or outside its limits."""
        if self._mark:
            self._mark()
            if self._at_once:
                runtime.synchronize()
                seen = bool(self._outside.item())
                self._outside.zero_()
                return seen
        else:
            low, high = torch.aminmax(self._numbers)
            if self._at_once:
                return not (low.item() >= -self._limit and high.item() <= self._limit)
            self._outside.copy_(~((low >= -self._limit) & (high <= self._limit)))
        seen = bool(self._seen[0])
        self._copy.copy_(self._outside, non_blocking=True)
        self._outside.zero_()
        return seen
