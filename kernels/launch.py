"""Kernels bound to their arguments: launched again and again without asking anew what every argument is.

Taichi inspects each argument of each call in Python, some 5 µs an array; a mission step has sixty arrays, and a world
that runs alone then spends its time there. All arrays of a world stay where they are, so their pointers are handed over
once. This uses Taichi's launch context as `taichi.lang.kernel_impl.Kernel.launch_kernel` of the pinned version does.
"""

from collections.abc import Callable

import numpy as np
import taichi as ti
import torch
from taichi.lang import impl
from taichi.lang.util import cook_dtype
from taichi.types.utils import is_signed


class Launch:
    """A kernel with fixed arguments; calling it runs it.

    Args:
        kernel: a `ti.kernel` without return value.
        arguments: all its arguments by position. Tensors must be contiguous, stay on the kernel's device and keep their
            memory: they are held, and read and written at each call.
    """

    def __init__(self, kernel: Callable, *arguments: object) -> None:
        primal = kernel._primal
        key = primal.ensure_compiled(*arguments)
        compiled = primal.compiled_kernels[key]
        self._held = arguments
        self._context = compiled.make_launch_context()
        self._place = {}
        for index, (parameter, value) in enumerate(zip(primal.arguments, arguments, strict=True)):
            if not isinstance(parameter.annotation, ti.template):
                self._place[index] = len(self._place)
                self._set(index, parameter.annotation, value)
        program = impl.get_runtime().prog
        self._compiled = program.compile_kernel(program.config(), program.get_device_caps(), compiled)
        self._launch = program.launch_kernel

    def _set(self, index: int, annotation: object, value: object) -> None:
        place = (self._place[index],)
        if isinstance(value, torch.Tensor):
            if not value.is_contiguous():
                raise ValueError(f"argument {index}: the tensor must be contiguous")
            element = getattr(annotation.dtype, "ndim", 0) if annotation.dtype is not None else 0
            shape = tuple(value.shape[: value.ndim - element])
            size = value.element_size() * value.nelement()
            self._context.set_arg_external_array_with_shape(place, value.data_ptr(), size, shape, 0)
        elif hasattr(annotation, "set_kernel_struct_args"):
            annotation.set_kernel_struct_args(annotation(*value), self._context, place)
        elif isinstance(value, float | np.floating):
            self._context.set_arg_float(place, float(value))
        elif is_signed(cook_dtype(annotation)):
            self._context.set_arg_int(place, int(value))
        else:
            self._context.set_arg_uint(place, int(value))

    def __call__(self) -> None:
        self._launch(self._compiled, self._context)
