"""Taichi as this project starts it."""

import math
import os
import subprocess
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest
import taichi as ti
import torch
from taichi.lang import impl, kernel_impl

from usvauv.kernels import runtime
from usvauv.kernels.planning import search, zermelo
from usvauv.kernels.positioning import acoustic_link, rays
from usvauv.kernels.shallow_water.nonlinear import NonlinearShallowWater

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


@ti.kernel
def reorder(x: ti.types.ndarray(dtype=ti.f32, ndim=2)):
    for i in range(x.shape[0]):
        x[i, 2] = (x[i, 0] + x[i, 1]) - x[i, 0]
        x[i, 3] = 0.0 * x[i, 0]


def test_arithmetic_is_that_of_the_standard(device):
    """No sum is put together in another order, and what is not finite leaves a mark: divergence is known by it."""
    if runtime.start().arch == "vulkan":
        pytest.skip("drivers may take (a + b) - a for b")
    x = torch.zeros((3, 4), device=device)
    x[:, 0] = torch.tensor([1e8, float("inf"), float("nan")])
    x[:, 1] = 1.0
    reorder(x)
    found = x.cpu().numpy()
    with np.errstate(invalid="ignore"):
        np.testing.assert_array_equal(found[:, 2], (found[:, 0] + found[:, 1]) - found[:, 0])
        np.testing.assert_array_equal(found[:, 3], np.float32(0) * found[:, 0])


class TestStart:
    def test_only_what_runs_can_be_started_again(self, device):
        running = runtime.start()
        assert runtime.start(running.arch) is running
        other = "vulkan" if running.arch != "vulkan" else "cpu"
        with pytest.raises(runtime.RuntimeUnavailable, match=f"'{running.arch}' is running already, so '{other}'"):
            runtime.start(other)
        assert torch.get_num_threads() == 1

    @pytest.mark.parametrize(("asked", "threads"), [(3, 3), (None, runtime.available_cores())])
    def test_threads(self, monkeypatch, asked, threads):
        started = {}
        monkeypatch.setattr(runtime, "_running", None)
        monkeypatch.setattr(runtime.ti, "init", lambda **options: started.update(options))
        assert runtime.start("cpu", asked) == runtime.Runtime("cpu", torch.device("cpu"), threads)
        assert (started["arch"], started["cpu_max_num_threads"]) == (ti.cpu, threads)
        assert started["offline_cache"]
        assert started["offline_cache_max_size_of_files"] > 1e8  # as many as Taichi keeps by itself

    @pytest.mark.parametrize("card", [False, True])
    def test_auto_takes_the_card_that_torch_sees(self, monkeypatch, card):
        started = {}
        monkeypatch.setattr(runtime, "_running", None)
        monkeypatch.setattr(runtime.torch.cuda, "is_available", lambda: card)
        monkeypatch.setattr(runtime.ti, "init", lambda **options: started.update(options))
        monkeypatch.setattr(impl, "current_cfg", lambda: SimpleNamespace(arch=ti.cuda))
        assert runtime.start().device.type == ("cuda" if card else "cpu")
        assert started["arch"] == (ti.cuda if card else ti.cpu)

    def test_a_failure_of_taichi_is_named(self, monkeypatch):
        def fail(**_):
            raise OSError("no memory")

        monkeypatch.setattr(runtime, "_running", None)
        monkeypatch.setattr(runtime.ti, "init", fail)
        with pytest.raises(runtime.RuntimeUnavailable, match="arch: 'cpu' could not be started: no memory"):
            runtime.start("cpu")
        assert runtime._running is None

    def test_cuda_without_a_card_is_refused(self, monkeypatch):
        monkeypatch.setattr(runtime, "_running", None)
        monkeypatch.setattr(runtime.torch.cuda, "is_available", lambda: False)
        with pytest.raises(runtime.RuntimeUnavailable, match="torch sees no CUDA device"):
            runtime.start("cuda")


@pytest.mark.skipif(not os.path.isdir("/proc/self/fd"), reason="no list of open files")
def test_messages_of_libraries_are_dropped_only_while_taichi_starts(capfd):
    opened = len(os.listdir("/proc/self/fd"))
    os.write(2, b"before")
    with runtime._silent_stderr():
        os.write(2, b"dropped")
    os.write(2, b" and after")
    assert capfd.readouterr().err == "before and after"
    assert len(os.listdir("/proc/self/fd")) == opened


def test_ways_of_compiling_hold_within_their_context(device):
    config = impl.current_cfg()
    for context, option, within in (
        (runtime.vectors_in_registers, "real_matrix_scalarize", config.arch not in (ti.x64, ti.arm64)),
        (runtime.compiled_quickly, "cfg_optimization", False),
    ):
        before = getattr(config, option)
        with context():
            assert getattr(config, option) == within
        assert before
        assert getattr(config, option) == before


def test_the_source_of_a_function_is_read_once():
    assert kernel_impl.getsourcelines(meet._primal.func) is kernel_impl.getsourcelines(meet._primal.func)


def in_a_child(arch, *, environment=None):
    """What starting an architecture in a process of its own prints on standard output, and on standard error."""
    program = "import sys; from kernels import runtime; print(runtime.start(sys.argv[1]).arch)"
    done = subprocess.run(
        [sys.executable, "-c", program, arch], capture_output=True, text=True, env={**os.environ, **(environment or {})}
    )
    return done.stdout.strip().splitlines()[-1:], done.stderr.strip().splitlines()


@pytest.mark.parametrize(("file", "lines"), [("/of/taichi/tools/image.py", 0), ("/of/another/tools/image.py", 1)])
def test_warnings_of_taichis_docstrings_are_not_shown(file, lines):
    """From Python 3.12 on, where an installer has not compiled its files."""
    program = "import sys, warnings, kernels; warnings.warn_explicit('escape', SyntaxWarning, sys.argv[1], 1)"
    done = subprocess.run([sys.executable, "-c", program, file], capture_output=True, text=True)
    assert len(done.stderr.splitlines()) == lines


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
    assert [runtime.constant_range(n) for n in (1, 128, 129)] == ([128, 128, 256] if arch == "vulkan" else [0] * 3)
    assert not runtime.better_alone(runtime.FEW_TASKS + 1)
    assert runtime.better_alone(runtime.FEW_TASKS) == (arch == "cpu")
    runtime.check_loops(runtime.LONGEST, "it")
    if arch == "vulkan":
        with pytest.raises(runtime.Unsupported, match=f"it takes {runtime.LONGEST + 1} iterations"):
            runtime.check_loops(runtime.LONGEST + 1, "it")
    else:
        runtime.check_loops(runtime.LONGEST + 1, "it")
    assert runtime.start().shares_memory_with_torch == (arch in ("cpu", "cuda"))


def test_what_vulkan_cannot_do_is_refused(monkeypatch):
    monkeypatch.setattr(runtime, "_running", runtime.Runtime("vulkan", torch.device("cpu"), 2))
    nothing = torch.zeros(1)
    with pytest.raises(runtime.Unsupported, match=r"^arch: 'vulkan' does not serve here: Zermelo"):
        zermelo.solve(*6 * [nothing], size=(1.0, 1.0), radius=1.0)
    with pytest.raises(runtime.Unsupported, match="nonlinear sea"):
        NonlinearShallowWater(size=(1.0, 1.0), cells=(4, 4), bed=-1.0, interval=1.0)


LAYERS, TWO = torch.zeros(7, 3), torch.ones(2)
LINK = torch.from_numpy(acoustic_link.link_table([15e3, 18e3], acoustic_link.Sonar()))
SEARCHES = {
    "plan": (search, "_batch", lambda: search.plan_batch(LINK, torch.zeros(2, 2, 3), code=0)),
    "eigenrays": (rays, "_eigenrays", lambda: rays.eigenrays(LAYERS, torch.ones(2, 3))),
    "arrivals": (rays, "_arrivals", lambda: rays.arrivals(LAYERS, TWO, torch.ones(2, 3), 1500.0)),
    "positions": (rays, "_positions", lambda: rays.positions(LAYERS, TWO, torch.ones(2, 5), 1500.0)),
}
SAID = r"(the best place for 2 AUVs takes|rays through 7 layers take) loops that this device"


@pytest.mark.parametrize("arch", ["cpu", "vulkan"])
@pytest.mark.parametrize("name", SEARCHES)
def test_what_a_device_has_cut_short_is_refused(monkeypatch, arch, name):
    """Of two results the second; a CPU cuts none, and what is not a number is then what it was asked for."""
    module, kernel, results = SEARCHES[name]
    cut = [0.0, math.nan]
    monkeypatch.setattr(runtime, "_running", runtime.Runtime(arch, torch.device("cpu"), 2))
    monkeypatch.setattr(module, kernel, lambda *given: given[-1].fill_(1.0)[:, -1].add_(torch.tensor(cut)))
    if arch == "vulkan":
        with pytest.raises(runtime.Unsupported, match=SAID):
            results()
        cut[1] = 0.0
    assert (results()[0] == 1).all()


def test_upload(device):
    numbers = np.arange(6, dtype=np.float32).reshape(2, 3)
    tensor = torch.zeros((2, 3), device=device)
    runtime.upload(numbers, tensor)
    runtime.synchronize()
    np.testing.assert_array_equal(tensor.cpu(), numbers)
