"""A number that kernels write and the program looks at after each step without waiting for the device."""

from __future__ import annotations

import torch


class DeviceFlag:
    """One int32 on a device, 0 at first.

    On a CPU `look` gives what has been written. Elsewhere it gives what a copy brought that an earlier `look` began, so
    that nobody waits: what a step writes is seen one step later.

    Attributes:
        value: (1,) int32 on the device.
    """

    def __init__(self, device: torch.device) -> None:
        self.value = torch.zeros(1, dtype=torch.int32, device=device)
        self._here = self.value if device.type == "cpu" else torch.zeros(1, dtype=torch.int32, pin_memory=True)
        self._seen = self._here.numpy()

    def look(self) -> int:
        """The number."""
        seen = int(self._seen[0])
        if self._here is not self.value:
            self._here.copy_(self.value, non_blocking=True)
        return seen

    def clear(self) -> None:
        """Set it to 0, also where a copy is on its way."""
        self.value.zero_()
        if self._here is not self.value:
            torch.cuda.synchronize()
            self._here.zero_()
