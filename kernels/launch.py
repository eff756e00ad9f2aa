"""Kernels bound to their arguments, which are inspected once and not at each call.

Taichi inspects each argument of each call in Python, some 5 µs an array; a mission step has sixty arrays, so a single
world would spend most of its time there. The arrays of a world stay in place, so their pointers are passed once. This
uses Taichi's launch context as `taichi.lang.kernel_impl.Kernel.launch_kernel` of the pinned version does.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import taichi as ti
import torch
from taichi.lang import impl
from taichi.lang.util import cook_dtype
from taichi.types.utils import is_signed

from usvauv.kernels.device_arrays import DeviceArray, DeviceArrays

SHAPE = 0  # member of an array argument that holds its shape, as in Taichi's `SHAPE_POS_IN_NDARRAY`


class Launch:
    """A kernel with fixed arguments; calling it runs it.

    Args:
        kernel: a `ti.kernel` without return value.
        arguments: all its arguments by position. Tensors must be contiguous, stay on the kernel's device and keep their
            memory: they are held, and read and written at each call. Those of `usvauv.kernels.device_arrays` are not
            copied.

    Raises:
        ValueError: a tensor is not contiguous.
    """

    def __init__(self, kernel: Callable, *arguments: Any) -> None:
        primal: Any = kernel._primal
        key = primal.ensure_compiled(*(a.tensor if isinstance(a, DeviceArray) else a for a in arguments))
        compiled = primal.compiled_kernels[key]
        self._held = arguments
        self._context = compiled.make_launch_context()
        self._on_device: dict[DeviceArrays, None] = {a.owner: None for a in arguments if isinstance(a, DeviceArray)}
        self._position: dict[int, int] = {}  # among the arguments that are not templates
        for index, (parameter, value) in enumerate(zip(primal.arguments, arguments, strict=True)):
            if not isinstance(parameter.annotation, ti.template):
                self._position[index] = len(self._position)
                self._set(index, parameter.annotation, value)
        program: Any = impl.get_runtime().prog
        self._compiled = program.compile_kernel(program.config(), program.get_device_caps(), compiled)
        self._launch = program.launch_kernel

    def _set(self, index: int, annotation: Any, value: Any) -> None:
        position = (self._position[index],)
        if isinstance(value, torch.Tensor | DeviceArray):
            tensor = value.tensor if isinstance(value, DeviceArray) else value
            if not tensor.is_contiguous():
                raise ValueError(f"argument {index}: the tensor must be contiguous")
            element = getattr(annotation.dtype, "ndim", 0) if annotation.dtype is not None else 0
            shape = tuple(tensor.shape[: tensor.ndim - element])
        if isinstance(value, DeviceArray):
            self._context.set_arg_ndarray(position, value.memory.arr)
            for axis, length in enumerate(shape):  # the memory is flat
                self._context.set_arg_int((*position, SHAPE, axis), length)
        elif isinstance(value, torch.Tensor):
            size = value.element_size() * value.nelement()
            self._context.set_arg_external_array_with_shape(position, value.data_ptr(), size, shape, 0)
        elif hasattr(annotation, "set_kernel_struct_args"):
            annotation.set_kernel_struct_args(annotation(*value), self._context, position)
        elif isinstance(value, float | np.floating):
            self._context.set_arg_float(position, float(value))
        elif is_signed(cook_dtype(annotation)):
            self._context.set_arg_int(position, int(value))
        else:
            self._context.set_arg_uint(position, int(value))

    def __call__(self) -> None:
        for arrays in self._on_device:
            arrays.send()
        self._launch(self._compiled, self._context)
        for arrays in self._on_device:
            arrays.mark_written()
