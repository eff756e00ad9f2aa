"""Taichi functions and kernels of these packages: `func` and `kernel` in place of `ti.func` and `ti.kernel`.

They do what Taichi's do, with two differences. A kernel runs under the settings of `usvauv.kernels.runtime`, whatever
other code in the process has given to `ti.init`. And Taichi reads their sources in half the time, as each process has
to, also for kernels that were compiled before: nobody looks whether a function is in the body of a class, each source
is read once, and errors name file and line without an extract of the source. Taichi itself stays as it is, so that
functions and kernels of others, those of plugins among them, are read as ever.
"""

import ast
import functools
import textwrap
from collections.abc import Callable
from typing import Any

from taichi.lang import impl, kernel_impl
from taichi.lang.ast import ASTTransformerContext, transform_tree
from taichi.lang.ast.ast_transformer_utils import ReturnStatus
from taichi.lang.enums import AutodiffMode
from taichi.lang.exception import TaichiSyntaxError

from usvauv.kernels import runtime


class _Context(ASTTransformerContext):
    def get_pos_info(self, node: Any) -> str:
        function: Any = self.func
        return f'File "{self.file}", line {node.lineno + self.lineno_offset}, in {function.func.__name__}:\n'


class _Function(kernel_impl.Func):
    @functools.cached_property
    def _source(self) -> tuple[list[str], str, int]:
        """Lines, the whole text without its indent, and the number of the first line in the file."""
        lines, first = kernel_impl.getsourcelines(self.func)
        lines = [textwrap.fill(line, tabsize=4, width=9999) for line in lines]
        return lines, textwrap.dedent("\n".join(lines)), first

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        given = kernel_impl._process_args(self, args, kwargs)
        if not impl.inside_kernel():
            raise TaichiSyntaxError(f"{self.func.__name__}: a Taichi function can be called in a kernel alone")
        lines, text, first = self._source
        tree: Any = ast.parse(text)
        tree.body[0].decorator_list = []
        kernel: Any = impl.get_runtime().current_kernel
        context: Any = _Context(
            is_kernel=False,
            func=self,
            global_vars=kernel_impl._get_global_vars(self.func),
            argument_data=given,
            file=self.func.__code__.co_filename,
            src=lines,
            start_lineno=first,
            ast_builder=kernel.ast_builder(),
        )
        returned = transform_tree(tree, context)
        if self.return_type and context.returned != ReturnStatus.ReturnedValue:
            raise TaichiSyntaxError(f"{self.func.__name__}: has a return type, but does not return")
        return returned


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
    primal = kernel_impl.Kernel(function, AutodiffMode.NONE)

    @functools.wraps(function)
    def launched(*args: Any) -> Any:
        with runtime.settings():
            return primal(*args)

    launched.__dict__.update(_is_wrapped_kernel=True, _primal=primal)
    return launched
