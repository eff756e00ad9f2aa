"""Taichi as this project starts it."""

import pytest
import taichi as ti
import torch

from kernels import runtime

PATIENCE = 1 << 28  # looks at the other turn, a second or more


@ti.kernel
def meet(arrived: ti.types.ndarray(dtype=ti.i32, ndim=1), met: ti.types.ndarray(dtype=ti.i32, ndim=1)):
    """Each of two turns waits for the other."""
    ti.loop_config(block_dim=1)
    for i in range(arrived.shape[0]):
        ti.atomic_add(arrived[i], 1)
        looks = 0
        while looks < PATIENCE and met[i] == 0:
            looks += 1
            if ti.atomic_add(arrived[1 - i], 0) > 0:
                met[i] = 1


@pytest.mark.skipif(runtime.available_cores() < 2, reason="one core")
def test_two_turns_of_a_loop_run_at_the_same_time():
    """With Taichi's defaults a loop of fewer than a thousand turns runs on one thread, however long they take."""
    if not runtime.start().on_cpu:
        pytest.skip("threads of a CPU")
    arrived, met = torch.zeros((2, 2), dtype=torch.int32)
    meet(arrived, met)
    assert met.tolist() == [1, 1]
