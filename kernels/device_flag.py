"""Whether numbers have left their bounds, looked at after each step without waiting for the device."""

from __future__ import annotations

import torch

from kernels import runtime


class DeviceFlag:
    """Looks at numbers that kernels write, step after step.

    On a CPU it sees them as they are. Elsewhere it sees what a copy brought that an earlier look began, so that nobody
    waits: what a step writes is seen one step later.
    """

    def __init__(self) -> None:
        running = runtime.start()
        self._at_once = running.torch_on_host
        if not self._at_once:
            self._outside = torch.zeros(1, dtype=torch.int32, device=running.device)
            self._copy = torch.zeros(1, dtype=torch.int32, pin_memory=torch.cuda.is_available())
            self._seen = self._copy.numpy()

    def outside(self, numbers: torch.Tensor, limit: float) -> bool:
        """Whether one of the numbers is not finite or beyond ±`limit`."""
        low, high = torch.aminmax(numbers)
        if self._at_once:
            return not (low.item() >= -limit and high.item() <= limit)
        seen = bool(self._seen[0])
        self._outside.copy_(~((low >= -limit) & (high <= limit)))
        self._copy.copy_(self._outside, non_blocking=True)
        return seen
