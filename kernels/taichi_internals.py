"""All that these packages use of Taichi 1.7.4 beside its public interface, each with its reason.

- `core`, `impl`: whether and how Taichi runs (`usvauv.kernels.runtime`), since other code can start it anew, with
  settings of its own; `impl.expr_init` and `impl.subscript`, by which a kernel has the addresses of rows computed once
  for all their columns (`usvauv.kernels.mission.worlds.Rows`: a tenth of a mission step).
- `Expr`: the type of a result is checked while a kernel is compiled, for a message that names a plugin's mistake.
- `BoundKernel`: Taichi inspects each argument of each call, some 5 µs per array; a mission step has sixty arrays, so a
  single world would spend most of its time there.
- `TaichiFunction`, `TaichiKernel`: sources are read in less than half the time, as each process has to, also for cached
  kernels; there is no check whether a function is in the body of a class, each file is parsed once for the kernels that
  are compiled together (`parsed_once`), a position is noted for each statement, not for each part of it, Python's
  garbage collector is paused, and errors have file and line without an extract of the source. This applies to the
  functions of these packages and of Taichi itself; others, including those of plugins, are parsed as usual.
- `WholeVector`: what Taichi cannot compile of whole vectors is refused; else the process ends.

Modules of Taichi are changed only while one of these kernels is compiled.
"""

import ast
import contextlib
import gc
import linecache
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import taichi as ti
import torch
from taichi._lib import core as core
from taichi.lang import impl as impl
from taichi.lang import kernel_impl, matrix_ops, ops  # noqa: F401  # or the first kernel that is read imports `matrix_ops`
from taichi.lang.ast import ASTTransformerContext
from taichi.lang.ast.ast_transformer import ASTTransformer
from taichi.lang.ast.ast_transformer_utils import Builder
from taichi.lang.enums import AutodiffMode
from taichi.lang.expr import Expr as Expr

SHAPE = 0  # member of an array argument that holds its shape, as in Taichi's `SHAPE_POS_IN_NDARRAY`
ALIGNMENT = 64  # bytes, of arrays of vectors: that of the widest registers, which torch's memory has, NumPy's need not
# Operations of whole vectors of numbers that Taichi compiles with vectors in registers, as scalar by scalar.
OF_VECTORS = {
    f"expr_{name}"
    for name in "add sub mul truediv floordiv sqrt floor ceil round max min select atomic_add"
    " cmp_lt cmp_le cmp_gt cmp_ge cmp_eq cmp_ne bit_or bit_and bit_xor bit_shl bit_sar bit_shr".split()
}
UNSIGNED = (ti.u8, ti.u16, ti.u32, ti.u64)


TAICHI_READER = kernel_impl._get_tree_and_ctx
TAICHI_BUILDER: Any = Builder
TAICHI_VISIT = TAICHI_BUILDER.__call__
BUILDERS = {
    kind: builder
    for kind in vars(ast).values()
    if (builder := getattr(ASTTransformer, f"build_{getattr(kind, '__name__', '')}", None))
}


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
        ours = is_kernel or isinstance(called, TaichiFunction) or function.__module__.startswith("taichi.")
        # Taichi takes a kernel's arguments out of its definition.
        definition = self._definition(function.__code__, again=is_kernel) if ours else None
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


class _Failing:
    """In place of Taichi's transformer where a node has failed, for the message."""

    def __init__(self, error: Exception) -> None:
        self._error = error

    def __getattr__(self, name: str) -> Callable[..., None]:
        def fail(*_: Any) -> None:
            raise self._error

        return fail


def _visit(transformer: Any, context: Any, node: Any) -> Any:
    """Go through a node of a source, in place of `Builder.__call__`."""
    build = BUILDERS.get(type(node))
    if build is None:
        return TAICHI_VISIT(transformer, context, node)
    positions = impl.pytaichi.src_info_stack
    depth = len(positions)
    if isinstance(node, ast.stmt):
        positions.append(context.get_pos_info(node))
    try:
        return build(context, node)
    except Exception as error:
        return TAICHI_VISIT(_Failing(error), context, node)
    finally:
        del positions[depth:]


_together: _Reader | None = None  # reads the kernels that are compiled within `parsed_once`


@contextlib.contextmanager
def parsed_once() -> Iterator[None]:
    """Kernels compiled meanwhile parse each file once together; within `usvauv.kernels.runtime.taichi_lock`."""
    global _together
    _together = _Reader()
    try:
        yield
    finally:
        _together = None


class WholeVector(ti.TaichiCompilationError):
    """Taichi cannot compile an operation of whole vectors with vectors in registers."""


class _Operations:
    """`core` for `taichi.lang.ops` while a kernel is compiled with vectors in registers.

    What the compiler has not been seen to do right in functions of others, which are written without this in mind,
    raises `WholeVector`: it ends the process at the negative of a vector, at its absolute value, a cast, an exponential
    or trigonometric function, and gives wrong results for vectors of bools.
    """

    def __getattr__(self, name: str) -> Any:
        made = getattr(core, name)
        if not name.startswith(("expr_", "value_cast", "bits_cast")):
            return made

        def checked(*operands: Any) -> Any:
            for position, operand in enumerate(operands):
                if isinstance(operand, core.Expr) and operand.is_tensor():
                    is_bool = operand.get_rvalue_type().element_type() == ti.u1
                    meant = is_bool == (name == "expr_select" and position == 0)
                    if not (meant and name in OF_VECTORS) and not _in_ours():
                        raise WholeVector(f"{name} of a whole vector")
            return made(*operands)

        return checked


def _in_ours() -> bool:
    """Whether it is a function of these packages that Taichi goes through."""
    frame = sys._getframe()
    while frame and not isinstance(frame.f_locals.get("ctx"), ASTTransformerContext):
        frame = frame.f_back
    return frame is not None and isinstance(frame.f_locals["ctx"].func, TaichiFunction | TaichiKernel)


class TaichiFunction(kernel_impl.Func):
    """A function of these packages."""


class TaichiKernel(kernel_impl.Kernel):
    """A kernel of these packages, without gradients."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function, AutodiffMode.NONE)

    def materialize(self, *args: Any, **kwargs: Any) -> None:
        collects = gc.isenabled()
        gc.disable()  # or it would go through what grows here again and again
        try:
            kernel_impl._get_tree_and_ctx, TAICHI_BUILDER.__call__ = _together or _Reader(), _visit
            if not impl.current_cfg().real_matrix_scalarize:
                ops._ti_core = _Operations()
            super().materialize(*args, **kwargs)
        finally:
            kernel_impl._get_tree_and_ctx, TAICHI_BUILDER.__call__ = TAICHI_READER, TAICHI_VISIT
            ops._ti_core = core
            if collects:
                gc.enable()


@dataclass(frozen=True)
class DeviceArray:
    """Argument of a `Launch` in place of a tensor.

    Attributes:
        tensor: that it stands for.
        memory: the device's copy, a flat `ti.ndarray`.
        owner: the `usvauv.kernels.functions.DeviceArrays` that keeps both alike.
    """

    tensor: torch.Tensor
    memory: Any
    owner: Any

    def view(self, *shape: int) -> "DeviceArray":
        """View of the same numbers in another shape."""
        return replace(self, tensor=self.tensor.view(*shape))


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


class BoundKernel:
    """A kernel compiled for fixed arguments, launched as `taichi.lang.kernel_impl.Kernel.launch_kernel` does.

    With CUDA each launch has a context of its own: Taichi puts the address of a copy on the device, freed after the
    launch, into the context that it launches.

    Args:
        primal: of a kernel. arguments: as of `usvauv.kernels.functions.Launch`.

    Raises:
        ValueError: a tensor is not contiguous, or vectors do not begin at a multiple of `ALIGNMENT` bytes.
    """

    def __init__(self, primal: Any, arguments: Sequence[Any]) -> None:
        self._given = [value.tensor if isinstance(value, DeviceArray) else value for value in arguments]
        made = primal.compiled_kernels[primal.ensure_compiled(*self._given)]
        self._calls = _Calls()
        self._position: dict[int, int] = {}  # among the arguments that are not templates
        for index, (parameter, value) in enumerate(zip(primal.arguments, arguments, strict=True)):
            if not isinstance(parameter.annotation, ti.template):
                self._position[index] = len(self._position)
                self._set(self._position[index], parameter.name, parameter.annotation, value)
        self._new_context = made.make_launch_context
        self._kept: Any = None if impl.current_cfg().arch == ti.cuda else self._calls.on(self._new_context())
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
        held = self._given[index]
        size = held.element_size() * held.nelement()
        place = (self._position[index],), tensor.data_ptr(), size, tuple(held.shape), 0
        self._kept.set_arg_external_array_with_shape(*place)

    def launch(self) -> None:
        """Run it."""
        self._launch(self._compiled, self._kept or self._calls.on(self._new_context()))
