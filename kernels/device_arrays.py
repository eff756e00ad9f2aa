"""Arrays that stay in the memory of a device that torch cannot reach.

Torch has no Vulkan tensors, so a tensor that a kernel takes lies in the CPU's memory, and Taichi copies it to the
device and back at each launch. For arrays that kernels alone work on, launch after launch, that is most of the time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import taichi as ti
import torch

from usvauv.kernels import runtime


@dataclass(frozen=True)
class DeviceArray:
    """Argument of a `usvauv.kernels.launch.Launch` in place of a tensor.

    Attributes:
        tensor: that it stands for.
        memory: the device's copy, a flat `ti.ndarray`.
        owner: keeps both alike.
    """

    tensor: torch.Tensor
    memory: Any
    owner: DeviceArrays

    def view(self, *shape: int) -> DeviceArray:
        """The same numbers in another shape."""
        return replace(self, tensor=self.tensor.view(*shape))


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
