"""Finds what would make a host wait for its GPU, on a machine that has none."""

from __future__ import annotations

from types import TracebackType

import torch
from torch.overrides import TorchFunctionMode
from torch.utils._python_dispatch import TorchDispatchMode


class _Operations(TorchDispatchMode):
    """Refuses numbers read off a tensor, shapes that depend on them, and new constants."""

    REFUSED = ("_local_scalar_dense", "item", "nonzero", "masked_select", "equal", "is_nonzero")

    def __torch_dispatch__(self, operation, types, args=(), kwargs=None):
        name = operation.overloadpacket.__name__
        constant = name == "lift_fresh" and args[0].ndim > 0  # a number is an argument of the kernel that fills with it
        masks = name in ("index", "index_put_") and any(
            isinstance(index, torch.Tensor) and index.dtype == torch.bool for index in args[1]
        )
        if name in self.REFUSED or constant or masks:
            raise AssertionError(f"{operation} waits for the device")
        return operation(*args, **(kwargs or {}))


class _Copies(TorchFunctionMode):
    """Refuses whole tensors brought to the host."""

    REFUSED = ("cpu", "numpy", "tolist", "__array__")

    def __torch_function__(self, function, types, args=(), kwargs=None):
        name = getattr(function, "__name__", "")
        if name in self.REFUSED:
            raise AssertionError(f"{name} waits for the device")
        return function(*args, **(kwargs or {}))


class NothingWaits:
    """Context in which an AssertionError names the first operation of torch that would wait for a device.

    Every tensor here lies on the CPU, where none of it would cost anything.
    """

    def __enter__(self) -> None:
        self._modes = _Copies(), _Operations()
        for mode in self._modes:
            mode.__enter__()

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        for mode in reversed(self._modes):
            mode.__exit__(kind, error, trace)
