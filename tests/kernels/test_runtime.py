"""Taichi as this project starts it."""

import os
import subprocess
import sys
import time

import pytest
import taichi as ti
import torch

from kernels import runtime
from kernels.planning import zermelo
from kernels.shallow_water.nonlinear import NonlinearShallowWater

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


@pytest.mark.cpu("threads")
@pytest.mark.skipif(runtime.available_cores() < 2, reason="one core")
def test_two_turns_of_a_loop_run_at_the_same_time():
    """With Taichi's defaults a loop of fewer than a thousand turns runs on one thread, however long they take."""
    arrived, met = torch.zeros((2, 2), dtype=torch.int32)
    meet(arrived, met)
    assert met.tolist() == [1, 1]


def in_a_child(arch, *, environment=None):
    """What starting an architecture in a process of its own prints on standard output, and on standard error."""
    program = "import sys; from kernels import runtime; print(runtime.start(sys.argv[1]).arch)"
    done = subprocess.run(
        [sys.executable, "-c", program, arch], capture_output=True, text=True, env={**os.environ, **(environment or {})}
    )
    return done.stdout.strip().splitlines()[-1:], done.stderr.strip().splitlines()


def test_metal_is_refused():
    assert in_a_child("metal")[1][-1].endswith("arch: 'metal' is not one of auto, cpu, cuda, vulkan")


def test_a_missing_device_is_an_error():
    """Taichi by itself would take the CPU."""
    nowhere = {"VK_ICD_FILENAMES": "/nowhere.json", "VK_DRIVER_FILES": "/nowhere.json"}
    out, err = in_a_child("vulkan", environment=nowhere)
    assert out == []
    assert err[-1].endswith("arch: 'vulkan' was asked for, but Taichi finds no such device here")


@pytest.mark.parametrize(("age", "left"), [(2 * runtime.LEFT_BEHIND, False), (runtime.LEFT_BEHIND / 2, True)])
def test_a_lock_that_a_killed_process_left_is_removed(monkeypatch, tmp_path, age, left):
    """With it no process would ever read or write compiled kernels again."""
    monkeypatch.setenv("TI_OFFLINE_CACHE_FILE_PATH", str(tmp_path))
    monkeypatch.setattr(runtime, "_running", None)
    monkeypatch.setattr(runtime.ti, "init", lambda **_: None)
    lock = tmp_path / "ticache.lock"
    lock.touch()
    os.utime(lock, (time.time() - age,) * 2)
    runtime.start("cpu")
    assert lock.exists() == left


@pytest.mark.parametrize("arch", ["cpu", "cuda", "vulkan", "metal"])
def test_the_architecture_decides_and_not_the_device_of_torch(monkeypatch, arch):
    monkeypatch.setattr(runtime, "_running", runtime.Runtime(arch, torch.device("cpu"), 2))
    assert runtime.start().on_cpu == runtime.better_alone(1) == (arch == "cpu")
    assert runtime.one_task_a_thread() == (1 if arch == "cpu" else None)
    assert runtime.constant_range(129) == (256 if arch == "vulkan" else 0)
    assert runtime.start().shares_memory_with_torch == (arch in ("cpu", "cuda"))


def test_what_vulkan_cannot_do_is_refused(monkeypatch):
    monkeypatch.setattr(runtime, "_running", runtime.Runtime("vulkan", torch.device("cpu"), 2))
    nothing = torch.zeros(1)
    with pytest.raises(runtime.Unsupported, match=r"^arch: 'vulkan' does not serve here: Zermelo"):
        zermelo.solve(*6 * [nothing], size=(1.0, 1.0), radius=1.0)
    with pytest.raises(runtime.Unsupported, match="nonlinear sea"):
        NonlinearShallowWater(size=(1.0, 1.0), cells=(4, 4), bed=-1.0, interval=1.0)
