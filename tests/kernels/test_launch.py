"""A bound launch is the call it stands for."""

import math

import numpy as np
import pytest
import taichi as ti
import torch

from usvauv.kernels import runtime
from usvauv.kernels.functions import DeviceArray, DeviceArrays, DeviceFlag, Launch, Limits
from usvauv.kernels.runtime import Runtime
from usvauv.kernels.types import vec3


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


def test_a_tensor_that_kernels_cannot_read_is_refused(device):
    """Strided, or with vectors that begin where the processor's wide loads would end the process."""
    x, lanes, *rest = arguments(device)
    with pytest.raises(ValueError, match="contiguous"):
        Launch(mix, False, x.T, lanes, *rest)
    if device.type == "cpu":
        with pytest.raises(ValueError, match="lanes: vectors must begin at a multiple of 64 bytes"):
            Launch(mix, False, x, torch.zeros(16)[1:].view(5, 3), *rest)


@ti.kernel
def add_row(x: ti.types.ndarray(dtype=ti.f32, ndim=2), y: ti.types.ndarray(dtype=ti.f32, ndim=1)):
    for i, j in ti.ndrange(x.shape[0], x.shape[1]):
        x[i, j] = x[i, j] + y[j] + 100.0 * x.shape[1]


ON_HOST = pytest.mark.cpu("copies of tensors that lie in the CPU's memory")


@pytest.fixture(params=["as the architecture does", pytest.param("copied", marks=ON_HOST)])
def memory(request, monkeypatch):
    """Also arrays that are copied to the device, which a CPU does when it is asked to, but in one launch only."""
    if request.param == "copied":
        monkeypatch.setattr(Runtime, "shares_memory_with_torch", False)


@pytest.mark.usefixtures("memory")
class TestCopies:
    def test_all_that_kernels_write_comes_back(self, device):
        """Each of the tensors, and nothing that is older than what the host wrote."""
        both = torch.ones((2, 6), device=device)
        row = torch.zeros(3, device=device)
        held = DeviceArrays([*both, row])

        def add(index: int, *shape: int) -> None:
            Launch(add_row, held.arguments[index].view(*shape), held.arguments[2])()

        copied = [isinstance(argument, DeviceArray) for argument in held.arguments]
        assert copied == 3 * [not runtime.start().shares_memory_with_torch]
        held.fetch()  # before any launch
        assert both.eq(1).all()
        add(0, 2, 3)
        add(1, 3, 2)
        add(1, 3, 2)
        held.fetch()
        assert both.tolist() == [[301.0] * 6, [401.0] * 6]
        add(0, 2, 3)
        both[0] = 7.0  # what the kernel wrote before is then lost
        held.fetch()
        assert both[0].tolist() == [7.0] * 6
        row += 1.0
        add(0, 2, 3)
        held.fetch()
        assert both.tolist() == [[308.0] * 6, [401.0] * 6]


@pytest.mark.parametrize("together", [True, False])
def test_a_flag_of_numbers_with_limits_of_their_own(device, together, monkeypatch):
    """Rows of 16, of which every third has the same limits; on a CPU side by side, elsewhere one by one."""
    low, high = -torch.arange(48.0).view(3, 16), torch.arange(48.0).flip(0).view(3, 16)
    greatest, least = (side.abs().view(torch.int32) for side in (high, low))
    which = (torch.arange(7) % 3).to(torch.int32)
    limits = Limits(which.to(device), torch.stack((greatest, greatest ^ least), 1).to(device))
    if not together:
        monkeypatch.setattr(Runtime, "on_cpu", False)
    numbers = torch.zeros(7, 16, device=device)
    flag = DeviceFlag(numbers.view(-1), limits)
    for row, lane in ((0, 0), (1, 5), (5, 15), (6, 3)):
        lowest, highest = low[row % 3, lane].item(), high[row % 3, lane].item()
        nearly = [(highest, False), (highest + 1e-3, True), (lowest, False), (lowest - 1e-3, True)]
        for value, outside in (*nearly, (math.nan, True), (-math.inf, True), (-0.0, False)):
            numbers[row, lane] = value
            if not runtime.start().torch_on_host:
                flag.raised()
                runtime.synchronize()
            assert flag.raised() == outside, (row, lane, value)
