"""Taichi functions and kernels of these packages: `func` and `kernel` in place of `ti.func` and `ti.kernel`, and
kernels bound to their arguments.

`func` and `kernel` behave as Taichi's, with two differences. A kernel runs under the settings of
`usvauv.kernels.runtime`, whatever other code in the process has passed to `ti.init`. And Taichi reads its source, as
each process has to, also for cached kernels, in less than half the time: there is no check whether a function is in the
body of a class, each file is parsed once per kernel, and errors have file and line without an extract of the source.
This applies to the functions of these packages and of Taichi itself that such a kernel calls. Other kernels and their
functions, including those of plugins, are read as usual.

Taichi inspects each argument of each call in Python, some 5 µs per array; a mission step has sixty arrays, so a single
world would spend most of its time there. The arrays of a world stay in place, so their pointers are passed once
(`Launch`). This uses Taichi's launch context as `taichi.lang.kernel_impl.Kernel.launch_kernel` of the pinned version
does.

Torch has no Vulkan tensors, so a tensor that a kernel takes lies in the CPU's memory, and Taichi copies it to the
device and back at each launch. For arrays that only kernels use, launch after launch, this is most of the time
(`DeviceArrays`).
"""

import ast
import functools
import gc
import linecache
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import taichi as ti
import torch
from taichi.lang import impl, kernel_impl
from taichi.lang.argpack import ArgPackType
from taichi.lang.ast import ASTTransformerContext
from taichi.lang.enums import AutodiffMode
from taichi.types.ndarray_type import NdarrayType

from usvauv.kernels import runtime
from usvauv.kernels.types import array1, index1, index3

TAICHI_READER = kernel_impl._get_tree_and_ctx
LANE_BITS = 4
LANES = 1 << LANE_BITS  # numbers side by side in a vector
PARTS = 16  # of many numbers, among the threads of a CPU
LOOK = 1e-4  # µs, about, to look at a number among others
MANY = 1 << 18  # numbers, from which on several threads look at them
SHAPE = 0  # member of an array argument that holds its shape, as in Taichi's `SHAPE_POS_IN_NDARRAY`
STREAMS = 4  # places that a thread reads in turns, so that more comes from memory at a time
MAGNITUDE = 0x7FFFFFFF  # bits of a number but for its sign
NOT_FINITE = 0x7F800000  # least magnitude of what is not finite
lanes = ti.types.vector(LANES, ti.i32)
rows = ti.types.ndarray(dtype=lanes, ndim=1)
rows2 = ti.types.ndarray(dtype=lanes, ndim=2)
ALIGNMENT = 64  # bytes, of arrays of vectors: that of the widest registers, which torch's memory has, NumPy's need not
UNSIGNED = (ti.u8, ti.u16, ti.u32, ti.u64)


class _Context(ASTTransformerContext):
    def get_pos_info(self, node: Any) -> str:
        function: Any = self.func
        return f'File "{self.file}", line {node.lineno}, in {function.func.__name__}:\n'


def _definitions(body: Sequence[Any]) -> Iterator[tuple[int, ast.FunctionDef]]:
    """The functions of a file, at any depth, each with the number of its first line, that of a decorator."""
    for statement in body:
        if isinstance(statement, ast.FunctionDef):
            yield min([statement, *statement.decorator_list], key=lambda part: part.lineno).lineno, statement
        for part in ("body", "orelse"):
            yield from _definitions(getattr(statement, part, ()))


class _Reader:
    """Reads the sources of a kernel and of the functions that it calls, in place of `kernel_impl._get_tree_and_ctx`."""

    def __init__(self) -> None:
        self._files: dict[str, dict[int, ast.FunctionDef]] = {}
        self._readings: dict[ast.FunctionDef, _Context] = {}
        self._attributes: dict[ast.FunctionDef, list[ast.Attribute]] = {}

    def __call__(self, called: Any, excluded_parameters: Any = (), is_kernel: bool = True, **given: Any) -> Any:
        """The tree of a function's source, and what Taichi notes while it goes through it."""
        function = called.func
        ours = is_kernel or isinstance(called, _Function) or function.__module__.startswith("taichi.")
        definition = self._definition(function.__code__) if ours else None
        if definition is None:
            return TAICHI_READER(called, excluded_parameters, is_kernel, **given)
        names = kernel_impl._get_global_vars(function)
        if is_kernel:
            names |= {called.arguments[i].name: given["args"][i] for i in called.template_slot_locations}
        context = _Context(
            excluded_parameters,
            is_kernel,
            called,
            given.get("arg_features"),
            names,
            given["args"],
            function.__code__.co_filename,
            src=[""],
            start_lineno=1,
            ast_builder=given.get("ast_builder"),
        )
        self._readings[definition] = context
        return ast.Module([definition], []), context

    def _definition(self, code: Any, again: bool = False) -> ast.FunctionDef | None:
        """The function whose code this is, without its decorators; None if the file is not there or another one."""
        file = code.co_filename
        if again or file not in self._files:
            linecache.checkcache(file)
            self._files[file] = dict(_definitions(ast.parse("".join(linecache.getlines(file))).body))
        found = self._files[file].get(code.co_firstlineno)
        if found is None or found.name != code.co_name:
            return None
        found.decorator_list = []
        if found in self._readings:  # Taichi keeps what it finds in the nodes
            if self._readings[found].local_scopes:  # not at its end: a function that calls itself
                return self._definition(code, again=True)
            if found not in self._attributes:
                self._attributes[found] = [node for node in ast.walk(found) if isinstance(node, ast.Attribute)]
            for node in self._attributes[found]:
                node.__dict__.pop("caller", None)
        return found


class _Function(kernel_impl.Func):
    """A function of these packages."""


class _Kernel(kernel_impl.Kernel):
    def materialize(self, *args: Any, **kwargs: Any) -> None:
        collects = gc.isenabled()
        gc.disable()  # or it would go through what grows here again and again
        try:
            kernel_impl._get_tree_and_ctx = _Reader()
            super().materialize(*args, **kwargs)
        finally:
            kernel_impl._get_tree_and_ctx = TAICHI_READER
            if collects:
                gc.enable()


def func(function: Callable) -> Callable:
    """Make a function one that kernels and other such functions call, as `ti.func` does."""
    made = _Function(function)

    @functools.wraps(function)
    def called(*args: Any, **kwargs: Any) -> Any:
        return made(*args, **kwargs)

    called.__dict__.update(_is_taichi_function=True, _is_real_function=False, func=made)
    return called


def kernel(function: Callable) -> Callable:
    """Make a function a kernel, as `ti.kernel` does, without gradients."""
    primal = _Kernel(function, AutodiffMode.NONE)

    @functools.wraps(function)
    def launched(*args: Any) -> Any:
        with runtime.settings():
            return primal(*args)

    launched.__dict__.update(_is_wrapped_kernel=True, _primal=primal)
    return launched


@dataclass(frozen=True)
class DeviceArray:
    """Argument of a `Launch` in place of a tensor.

    Attributes:
        tensor: that it stands for.
        memory: the device's copy, a flat `ti.ndarray`.
        owner: keeps both alike.
    """

    tensor: torch.Tensor
    memory: Any
    owner: "DeviceArrays"

    def view(self, *shape: int) -> "DeviceArray":
        """View of the same numbers in another shape."""
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


class _Calls:
    """Takes the calls of a launch context's methods, to make them later, again and again."""

    def __init__(self) -> None:
        self._calls: list[tuple[str, tuple[Any, ...]]] = []

    def __getattr__(self, name: str) -> Callable[..., None]:
        return lambda *arguments: self._calls.append((name, arguments))

    def on(self, context: Any) -> Any:
        """The context, after the calls."""
        for name, arguments in self._calls:
            getattr(context, name)(*arguments)
        return context


def _packed(annotation: Any, value: Any) -> Any:
    """An argument of a kernel as Taichi's compiler takes it."""
    if isinstance(annotation, ArgPackType):
        return annotation(**{name: _packed(kind, value[name]) for name, kind in annotation.members.items()})
    return value.tensor if isinstance(value, DeviceArray) else value


class Launch:
    """A kernel with fixed arguments; calling it runs it.

    With CUDA each launch has a context of its own: Taichi puts the address of a copy on the device, freed after the
    launch, into the context that it launches. Where other code has started Taichi anew since, by `ti.init` or
    `ti.reset`, the kernel is compiled again.

    Args:
        kernel: one without return value.
        arguments: all its arguments by position, that of a pack as a mapping. Tensors must be contiguous, stay on the
            kernel's device and keep their memory: they are held, and read and written at each call. A `DeviceArray` is
            not copied.
        settings: of Taichi's compiler, see `usvauv.kernels.runtime.settings`.

    Raises:
        ValueError: a tensor is not contiguous, or vectors do not begin at a multiple of `ALIGNMENT` bytes.
    """

    def __init__(self, kernel: Callable, *arguments: Any, settings: runtime.Settings = runtime.NONE) -> None:
        self._primal: Any = kernel._primal
        self._held, self._settings = arguments, settings
        single = (value for a in arguments for value in (a.values() if isinstance(a, Mapping) else (a,)))
        self._on_device: dict[DeviceArrays, None] = {a.owner: None for a in single if isinstance(a, DeviceArray)}
        self._launched_in: runtime.Runtime | None = None
        with runtime.settings(settings):
            self._compile()

    def _compile(self) -> None:
        self._compiled_in = runtime.start()
        parameters = [(parameter.annotation, parameter.name) for parameter in self._primal.arguments]
        given = [_packed(annotation, value) for (annotation, _), value in zip(parameters, self._held, strict=True)]
        made = self._primal.compiled_kernels[self._primal.ensure_compiled(*given)]
        self._calls = _Calls()
        self._position: dict[int, int] = {}  # among the arguments that are not templates
        arrays: list[tuple[str, Any, Any]] = []  # of packs, which come last
        for index, ((annotation, name), value) in enumerate(zip(parameters, self._held, strict=True)):
            if isinstance(annotation, ti.template):
                continue
            self._position[index] = position = len(self._position)
            if isinstance(annotation, ArgPackType):
                self._calls.set_arg_argpack((position,), given[index]._ArgPack__argpack)
                members = annotation.members.items()
                arrays += [(name, kind, value[name]) for name, kind in members if isinstance(kind, NdarrayType)]
            else:
                self._set(position, name, annotation, value)
        for position, array in enumerate(arrays, len(self._position)):
            self._set(position, *array)
        self._packs = given
        self._new_context = made.make_launch_context
        self._kept: Any = None if self._compiled_in.arch == "cuda" else self._calls.on(self._new_context())
        program: Any = impl.get_runtime().prog
        self._compiled = program.compile_kernel(program.config(), program.get_device_caps(), made)
        self._launch = program.launch_kernel

    def _set(self, place: int, name: str, annotation: Any, value: Any) -> None:
        position = (place,)
        if isinstance(value, torch.Tensor | DeviceArray):
            tensor = value.tensor if isinstance(value, DeviceArray) else value
            if not tensor.is_contiguous():
                raise ValueError(f"{name}: the tensor must be contiguous")
            element = getattr(annotation.dtype, "ndim", 0) if annotation.dtype is not None else 0
            if element and tensor.is_cpu and tensor.data_ptr() % ALIGNMENT:
                raise ValueError(f"{name}: vectors must begin at a multiple of {ALIGNMENT} bytes")
            shape = tuple(tensor.shape[: tensor.ndim - element])
        if isinstance(value, DeviceArray):
            self._calls.set_arg_ndarray(position, value.memory.arr)
            for axis, length in enumerate(shape):  # the memory is flat
                self._calls.set_arg_int((*position, SHAPE, axis), length)
        elif isinstance(value, torch.Tensor):
            size = value.element_size() * value.nelement()
            self._calls.set_arg_external_array_with_shape(position, value.data_ptr(), size, shape, 0)
        elif hasattr(annotation, "set_kernel_struct_args"):
            annotation.set_kernel_struct_args(annotation(*value), self._calls, position)
        elif isinstance(value, float | np.floating):
            self._calls.set_arg_float(position, float(value))
        elif annotation in UNSIGNED:
            self._calls.set_arg_uint(position, int(value))
        else:
            self._calls.set_arg_int(position, int(value))

    def take(self, index: int, tensor: torch.Tensor) -> None:
        """Argument `index` is from now on another array, of as many numbers of the same type; only on a CPU."""
        held = self._held[index]
        size = held.element_size() * held.nelement()
        place = (self._position[index],), tensor.data_ptr(), size, tuple(held.shape), 0
        self._kept.set_arg_external_array_with_shape(*place)

    def __call__(self) -> None:
        for arrays in self._on_device:
            arrays.send()
        if self._launched_in is runtime.start():
            self._launch(self._compiled, self._kept or self._calls.on(self._new_context()))
        else:
            self._launch_first()
        for arrays in self._on_device:
            arrays.mark_written()

    def _launch_first(self) -> None:
        """Also finish to compile, which Taichi does at the first launch."""
        with runtime.settings(self._settings):
            if self._compiled_in is not runtime.start():
                self._compile()
            self._launch(self._compiled, self._kept or self._calls.on(self._new_context()))
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
