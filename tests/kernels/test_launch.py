"""A bound launch is the call it stands for."""

import numpy as np
import pytest
import taichi as ti
import torch

from kernels.device_arrays import DeviceArrays
from kernels.launch import Launch
from kernels.types import vec3


@ti.kernel
def mix(
    doubled: ti.template(),
    x: ti.types.ndarray(dtype=ti.f32, ndim=2),
    lanes: ti.types.ndarray(dtype=vec3, ndim=1),
    index: ti.types.ndarray(dtype=ti.i32, ndim=1),
    scale: ti.f32,
    shift: ti.i32,
    word: ti.u32,
    weights: vec3,
):
    for i in range(x.shape[0]):
        total = lanes[i].dot(weights) + ti.cast(ti.bit_shr(word, 16), ti.f32)
        for j in range(x.shape[1]):
            x[i, j] = scale * x[i, j] + ti.cast(index[i] + shift, ti.f32) + total
            if ti.static(doubled):
                x[i, j] = 2.0 * x[i, j]


def arguments(device):
    generator = torch.Generator().manual_seed(1)
    x = torch.rand((5, 4), generator=generator).to(device)
    lanes = torch.rand((5, 3), generator=generator).to(device)
    return x, lanes, torch.arange(5, dtype=torch.int32, device=device), 0.5, -3, 0xFFFF1234, vec3(1.0, 2.0, 3.0)


@pytest.mark.parametrize("doubled", [False, True])
def test_same_as_the_call(device, doubled):
    called, bound = arguments(device), arguments(device)
    launch = Launch(mix, doubled, *bound)
    for _ in range(3):
        mix(doubled, *called)
        launch()
    assert torch.equal(called[0], bound[0])
    expected = arguments(device)[0].double().cpu().numpy()
    total = bound[1].double().cpu().numpy() @ [1, 2, 3] + 0xFFFF + np.arange(5) - 3
    for _ in range(3):
        expected = (2 if doubled else 1) * (0.5 * expected + total[:, None])
    np.testing.assert_allclose(bound[0].cpu(), expected, rtol=1e-6)


def test_arrays_are_read_anew_at_each_call(device):
    bound = arguments(device)
    launch = Launch(mix, False, *bound)
    bound[0].zero_()
    bound[1].zero_()
    launch()
    assert bound[0][:, 0].tolist() == [0xFFFF - 3.0 + i for i in range(5)]


def test_a_strided_tensor_is_refused(device):
    x, *rest = arguments(device)
    with pytest.raises(ValueError, match="contiguous"):
        Launch(mix, False, x.T, *rest)


@ti.func
def wrong(x):
    return x + nowhere_to_be_found  # noqa: F821


@ti.kernel
def call_wrong(x: ti.types.ndarray(dtype=ti.f32, ndim=1)):
    for i in range(x.shape[0]):
        x[i] = wrong(x[i])


def test_an_error_names_file_and_line(device):
    """Although the runtime leaves out the extracts of the source that Taichi composes."""
    line = call_wrong._primal.func.__code__.co_firstlineno + 3
    with pytest.raises(ti.TaichiCompilationError) as caught:
        call_wrong(torch.zeros(3, device=device))
    message = str(caught.value)
    assert f'File "{__file__}", line {line}, in call_wrong' in message
    assert "in wrong" in message
    assert "nowhere_to_be_found" in message


@ti.kernel
def add_row(x: ti.types.ndarray(dtype=ti.f32, ndim=2), y: ti.types.ndarray(dtype=ti.f32, ndim=1)):
    for i, j in ti.ndrange(x.shape[0], x.shape[1]):
        x[i, j] = x[i, j] + y[j] + 100.0 * x.shape[1]


class TestDeviceArrays:
    """As tensors, whether the architecture copies them or not."""

    def test_launches_follow_one_another_and_what_the_host_writes(self, device):
        both = torch.zeros((2, 12), device=device)
        row = torch.arange(4.0, device=device)
        held = DeviceArrays(tuple(both))
        launch = Launch(add_row, held.arguments[1].view(3, 4), row)
        expected = row.expand(3, 4) + 400
        launch()
        launch()
        held.fetch()
        assert torch.equal(both[1].view(3, 4), 2 * expected)
        launch()
        both[1].fill_(7.0)  # what the kernel wrote before is then lost, with a copy or without
        held.fetch()
        assert both[1].tolist() == [7.0] * 12
        row.add_(1.0)
        launch()
        held.fetch()
        assert torch.equal(both[1].view(3, 4), 7 + expected + 1)
        assert not both[0].any()
