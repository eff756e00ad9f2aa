"""Kernels and functions as `usvauv.kernels.functions` has them read."""

import numpy as np
import pytest
import taichi as ti

from usvauv.kernels.functions import kernel
from usvauv.kernels.types import array1


@kernel
def fail(out: array1):
    for _ in range(1):
        out[0] = unheard_of  # noqa: F821


def test_an_error_names_file_and_line(device):
    with pytest.raises(ti.TaichiNameError) as raised:
        fail(np.zeros(1, np.float32))
    line = fail._primal.func.__code__.co_firstlineno + 3
    assert f'File "{__file__}", line {line}, in fail' in str(raised.value)
    assert "unheard_of" in str(raised.value)
