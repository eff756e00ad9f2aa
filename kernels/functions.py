"""Taichi functions and kernels of these packages: `func` and `kernel` in place of `ti.func` and `ti.kernel`.

They do what Taichi's do, with two differences. A kernel runs under the settings of `usvauv.kernels.runtime`, whatever
other code in the process has given to `ti.init`. And Taichi reads its source in less than half the time, as each
process has to, also for kernels that were compiled before: nobody looks whether a function is in the body of a class,
each file is parsed once a kernel, and errors name file and line without an extract of the source. So it is for the
functions of these packages and of Taichi itself that such a kernel calls. Kernels of others are read as ever, and so
are their functions, those of plugins among them.
"""

import ast
import functools
import gc
import linecache
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from taichi.lang import kernel_impl
from taichi.lang.ast import ASTTransformerContext
from taichi.lang.enums import AutodiffMode

from usvauv.kernels import runtime

AS_EVER = kernel_impl._get_tree_and_ctx


class _Context(ASTTransformerContext):
    def get_pos_info(self, node: Any) -> str:
        function: Any = self.func
        return f'File "{self.file}", line {node.lineno}, in {function.func.__name__}:\n'


def _definitions(body: Sequence[Any]) -> Iterator[tuple[int, ast.FunctionDef]]:
    """The functions of a file, at whatever depth, each with the number of its first line, that of a decorator."""
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
            return AS_EVER(called, excluded_parameters, is_kernel, **given)
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
            kernel_impl._get_tree_and_ctx = AS_EVER
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
