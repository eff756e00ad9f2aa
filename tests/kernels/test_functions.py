"""Kernels and functions as `usvauv.kernels.functions` has them read."""

import numpy as np
import pytest
import taichi as ti

from usvauv.kernels.functions import func, kernel
from usvauv.kernels.types import array1, vec2


@func
def doubled_sum(x, n: ti.template()):
    """x + 2x + 4x + …, n terms, by itself: what Taichi notes of the outer call has to outlive the inner one."""
    result = x
    if ti.static(n > 1):
        result = x + doubled_sum(2.0 * x, n - 1)
    return result


@func
def length(a):
    """Of a vector, whose method is no attribute of an expression, or of a struct, whose method is one."""
    return a.norm()


@ti.dataclass
class Arrow:
    x: ti.f32

    @ti.func
    def norm(self):
        return ti.abs(self.x)


@kernel
def fill(out: array1):
    for _ in range(1):
        out[0] = doubled_sum(2.0, 3)
        out[1] = length(vec2(3.0, 4.0))
        out[2] = length(Arrow(-2.0))
        out[3] = length(vec2(0.0, 7.0))


@kernel
def fail(out: array1):
    for _ in range(1):
        out[0] = unheard_of  # noqa: F821


def test_functions_called_again_and_within_themselves(device):
    """2 + 4 + 8, and lengths of two kinds of arguments in turns."""
    out = np.zeros(4, np.float32)
    fill(out)
    assert out.tolist() == [14.0, 5.0, 2.0, 7.0]


def test_an_error_names_file_and_line(device):
    with pytest.raises(ti.TaichiNameError) as raised:
        fail(np.zeros(1, np.float32))
    line = fail._primal.func.__code__.co_firstlineno + 3
    assert f'File "{__file__}", line {line}, in fail' in str(raised.value)
    assert "unheard_of" in str(raised.value)
