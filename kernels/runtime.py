"""Start of Taichi, the device that kernels run on, and how kernels are compiled.

Taichi is started at first use, never at import. A second start would invalidate every compiled kernel, so a second call
with another architecture is an error.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import io
import os
import textwrap
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import taichi as ti
import torch
from taichi.lang import impl, kernel_impl
from taichi.lang.ast import ast_transformer_utils

from usvauv.kernels.errors import UserError

CACHED = 1 << 30  # bytes of compiled kernels kept on disk, of all scenarios and versions together
DEBUG = "USVAUV_DEBUG"  # environment variable: kernels check every index, see `start`
SOFTWARE_VULKAN = "USVAUV_TEST_SOFTWARE_VULKAN"  # environment variable: tests of the GPU path on a machine without one
VULKAN_CPU = 4  # VkPhysicalDeviceType
FEW_TASKS = 256  # most tasks of about a microsecond for which waking another thread takes longer than it saves
ITERATIONS = 16  # of a loop that a thread takes at a time
LEFT_BEHIND = 60.0  # seconds; Taichi holds the lock of its cache for a few
ARCHITECTURES = ("auto", "cpu", "cuda", "vulkan")


class RuntimeUnavailable(UserError, RuntimeError):
    """The requested architecture cannot be used on this machine, or another one is running already."""


class Unsupported(RuntimeUnavailable):
    """The architecture that is running cannot do what is asked for.

    Args:
        problem: what, and why not.
    """

    def __init__(self, problem: str) -> None:
        super().__init__(f"arch: {start().arch!r} does not serve here: {problem}; use cpu or cuda")


@dataclass(frozen=True)
class Runtime:
    """Taichi's architecture, torch's device and the number of CPU threads of Taichi's kernels."""

    arch: str
    device: torch.device
    threads: int

    @property
    def on_cpu(self) -> bool:
        """Whether kernels run on the CPU. Torch's device is the CPU on Vulkan too, where tensors lie in its memory."""
        return self.arch == "cpu"

    @property
    def torch_on_host(self) -> bool:
        """Whether torch's tensors lie in the CPU's memory, so that nobody waits who reads a number of theirs."""
        return self.device.type == "cpu"

    @property
    def shares_memory_with_torch(self) -> bool:
        """Whether kernels work on torch's tensors in place; otherwise Taichi copies them at each launch."""
        return self.arch in ("cpu", "cuda")


_running: Runtime | None = None


def available_cores() -> int:
    """CPU cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def start(arch: str = "auto", threads: int | None = None) -> Runtime:
    """Start Taichi if it is not running yet.

    Args:
        arch: one of `ARCHITECTURES`; "auto" takes CUDA where torch sees a device, else the CPU. Taichi's others, Metal
            among them, have never been tried and are refused.
        threads: CPU threads of Taichi's kernels; default all cores this process may use. Torch is set to one thread,
            because its small matrix products lose far more to a busy second core than they gain from it.

    With the environment variable USVAUV_DEBUG kernels check every index against the shape of its array, several times
    slower. Taichi 1.7.4 cannot report an index out of bounds of a tensor on a CPU: the process ends with a segmentation
    fault at once, instead of going on with what lies beside the array. Its messages of overflowing integers come from
    the random numbers, which are meant to overflow.

    From here on the calling thread takes numbers below 1.2e-38 as 0, also those of NumPy and torch in single precision:
    Taichi sets the processor so.

    Returns:
        what is running.

    Raises:
        RuntimeUnavailable: unknown or unusable architecture, or a different one is running already.
    """
    global _running
    if arch not in ARCHITECTURES:
        raise RuntimeUnavailable(f"arch: {arch!r} is not one of {', '.join(ARCHITECTURES)}")
    if _running is not None:
        if arch not in ("auto", _running.arch):
            raise RuntimeUnavailable(f"arch: {_running.arch!r} is running already, so {arch!r} cannot be started")
        return _running
    if arch == "auto":
        arch = "cuda" if torch.cuda.is_available() else "cpu"
    if arch == "cuda" and not torch.cuda.is_available():
        raise RuntimeUnavailable("arch: 'cuda' was asked for, but torch sees no CUDA device here")
    if arch == "vulkan" and not os.environ.get(SOFTWARE_VULKAN):
        with _silent_stderr():
            devices = _vulkan_devices()
        if devices and all(kind == VULKAN_CPU for _, kind in devices):
            raise RuntimeUnavailable(f"arch: 'vulkan': {devices[0][0]} computes in software: use cpu")
    threads = threads or available_cores()
    free_cache()
    try:
        # Taichi announces itself, and its Vulkan device complains if there is none.
        with contextlib.redirect_stdout(io.StringIO()), _silent_stderr():
            ti.init(
                arch=getattr(ti, arch),
                cpu_max_num_threads=threads,
                offline_cache=True,
                offline_cache_max_size_of_files=CACHED,
                fast_math=False,
                debug=bool(os.environ.get(DEBUG)),
                # By default a thread gets at least 512 iterations, so that a shorter loop runs on one thread.
                make_cpu_multithreading_loop=False,
                cpu_block_dim_adaptive=False,
                default_cpu_block_dim=ITERATIONS,
                log_level=ti.ERROR,
            )
    except Exception as error:
        raise RuntimeUnavailable(f"arch: {arch!r} could not be started: {error}") from error
    if arch != "cpu" and impl.current_cfg().arch != getattr(ti, arch):  # Taichi takes the CPU instead
        raise RuntimeUnavailable(f"arch: {arch!r} was asked for, but Taichi finds no such device here")
    _speed_up_reading_of_kernels()
    torch.set_num_threads(1)
    device = torch.device("cuda" if arch == "cuda" else "cpu")
    _running = Runtime(arch, device, threads)
    return _running


def _vulkan_devices() -> list[tuple[str, int]]:
    """Name and VkPhysicalDeviceType of each device that Vulkan's loader finds, which Taichi does not report."""
    from ctypes.util import find_library

    try:
        vulkan = ctypes.CDLL(find_library("vulkan") or find_library("vulkan-1"))
        info, instance, count = (ctypes.c_uint64 * 8)(1), ctypes.c_void_p(), ctypes.c_uint32()  # VkInstanceCreateInfo
        if vulkan.vkCreateInstance(info, None, ctypes.byref(instance)):
            return []
    except (OSError, AttributeError):
        return []
    vulkan.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), None)
    devices, found = (ctypes.c_void_p * count.value)(), []
    vulkan.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), devices)
    for device in devices:
        about = (ctypes.c_uint32 * 1024)()  # VkPhysicalDeviceProperties, which is shorter
        vulkan.vkGetPhysicalDeviceProperties(ctypes.c_void_p(device), about)
        found.append((bytes(about)[20:276].split(b"\0")[0].decode(errors="replace"), int(about[4])))
    vulkan.vkDestroyInstance(instance, None)
    return found


def stop() -> None:
    """End Taichi where it runs, and write what it has compiled to its cache."""
    global _running
    if _running is not None:
        _running = None
        ti.reset()


def free_cache() -> None:
    """Remove the lock of the folder of compiled kernels that a killed process left there.

    Taichi waits a quarter of a second for it, then goes on without the folder, as each later process would.
    """
    folder = os.environ.get("TI_OFFLINE_CACHE_FILE_PATH") or impl.default_cfg().offline_cache_file_path
    lock = Path(folder, "ticache.lock")
    with contextlib.suppress(OSError):  # most often there is none
        if time.time() - lock.stat().st_mtime > LEFT_BEHIND:
            lock.unlink()


@contextlib.contextmanager
def _silent_stderr() -> Iterator[None]:
    """Without the messages that libraries in C write to the process's standard error."""
    kept = os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


def _speed_up_reading_of_kernels() -> None:
    """Halve the time in which Taichi reads the source of a kernel, as each process does, also of one compiled before.

    For its error messages Taichi composes an extract of the source for each expression, and at each call of a function
    it reads and wraps its source again. Here messages about kernels of this package have file and line only, and a
    source is read once.
    """
    transformer: Any = ast_transformer_utils.ASTTransformerContext
    whole, ours = transformer.get_pos_info, str(Path(__file__).parent)

    def position(context, node) -> str:
        if not context.file.startswith(ours):
            return whole(context, node)
        line = node.lineno + context.lineno_offset
        return f'File "{context.file}", line {line}, in {context.func.func.__name__}:\n'

    transformer.get_pos_info = position
    for name in ("getsourcelines", "getsourcefile"):
        setattr(kernel_impl, name, functools.cache(getattr(kernel_impl, name)))
    lines: Any = SimpleNamespace(fill=functools.cache(textwrap.fill), dedent=functools.cache(textwrap.dedent))
    kernel_impl.textwrap = lines


@contextlib.contextmanager
def vectors_in_registers() -> Iterator[None]:
    """Compile kernels within this context so that whole vectors stay in registers; by default Taichi splits them.

    Twice as fast on a CPU. Not the default, because Taichi then lacks several vector functions that other kernels use,
    and expects that arrays are aligned to vectors, which holds for torch, but not always for NumPy.
    """
    config = impl.current_cfg()
    default = config.real_matrix_scalarize
    config.real_matrix_scalarize = default and config.arch not in (ti.x64, ti.arm64)
    try:
        yield
    finally:
        config.real_matrix_scalarize = default


@contextlib.contextmanager
def compiled_quickly() -> Iterator[None]:
    """Compile kernels within this context without the pass that takes most of the time of compiling a long one.

    Compiling takes a third to a half of the time; the kernel is a tenth to a fifth slower.
    """
    config = impl.current_cfg()
    default = config.cfg_optimization
    config.cfg_optimization = False
    try:
        yield
    finally:
        config.cfg_optimization = default


def better_alone(tasks: int) -> bool:
    """Whether the calling thread finishes so few short tasks on a CPU before another thread wakes up."""
    return start().on_cpu and tasks <= FEW_TASKS


def one_task_a_thread() -> int | None:
    """`block_dim` of a loop of few long tasks: 1 on a CPU, where threads take as many tasks at a time.

    On Vulkan the default, because a loop has up to 131,072 threads, and devices need not have more than 65,535 blocks.
    """
    return 1 if start().on_cpu else None


def upload(numbers: np.ndarray, tensor: torch.Tensor) -> None:
    """Write numbers of the host into a tensor without waiting for the device.

    From ordinary memory CUDA copies only when all that was launched before is done.
    """
    source = torch.from_numpy(numbers)
    tensor.copy_(source.pin_memory() if tensor.is_cuda else source, non_blocking=True)


def synchronize() -> None:
    """Wait until all launched kernels are done; on a CPU they already are."""
    ti.sync()
