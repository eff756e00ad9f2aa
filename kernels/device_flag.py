"""Whether numbers have left their bounds, looked at after each step without waiting for the device."""

import taichi as ti
import torch

from usvauv.kernels import runtime
from usvauv.kernels.device_arrays import DeviceArray
from usvauv.kernels.launch import Launch
from usvauv.kernels.types import array1, index1


@ti.kernel
def mark_outside(numbers: array1, limit: ti.f32, flag: index1):
    """Set the flag if one of the numbers is not finite or beyond ±`limit`."""
    for n in range(numbers.shape[0]):
        if flag[0] == 0 and not ti.abs(numbers[n]) <= limit:  # what is not read is not sent: `docs/architectures.md`
            flag[0] = 1


class DeviceFlag:
    """Looks at numbers that kernels write, step after step.

    On a CPU it sees them as they are, and on a device that torch cannot reach a kernel looks at them. With CUDA it sees
    what a copy brought that an earlier look began, so that nobody waits: what a step writes is seen one step later.

    Args:
        numbers: to be looked at; they keep their memory.
        limit: largest magnitude.
    """

    def __init__(self, numbers: torch.Tensor | DeviceArray, limit: float) -> None:
        running = runtime.start()
        self._numbers, self._limit = numbers, limit
        self._outside = torch.zeros(1, dtype=torch.int32, device=running.device)
        self._at_once = running.torch_on_host
        if isinstance(numbers, DeviceArray):
            self._mark = Launch(mark_outside, numbers.view(-1), limit, self._outside)
        elif not self._at_once:
            self._copy = torch.zeros(1, dtype=torch.int32, pin_memory=torch.cuda.is_available())
            self._seen = self._copy.numpy()

    def raised(self) -> bool:
        """Whether one of the numbers is not finite or beyond the limit."""
        if isinstance(self._numbers, DeviceArray):
            self._outside.zero_()
            self._mark()
            runtime.synchronize()
            return bool(self._outside.item())
        low, high = torch.aminmax(self._numbers)
        if self._at_once:
            return not (low.item() >= -self._limit and high.item() <= self._limit)
        seen = bool(self._seen[0])
        self._outside.copy_(~((low >= -self._limit) & (high <= self._limit)))
        self._copy.copy_(self._outside, non_blocking=True)
        return seen
