"""Start of Taichi, the device that kernels run on, and how kernels are compiled.

Taichi is started at first use, never at import, and runs once per process: `ti.init` ends the running program with its
fields and its compiled kernels. If other code has called it, before or after, kernels of these packages continue in the
present program, compiled under their own settings (`settings`). A forked process has none of the threads of the
inherited program, and starts another one.
"""

from __future__ import annotations

import atexit
import contextlib
import copy
import ctypes
import functools
import io
import os
import shutil
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import taichi as ti
import torch

from usvauv.kernels import kernel_cache
from usvauv.kernels.errors import UserError, choices
from usvauv.kernels.limits import ARCHITECTURES, MAX_AUVS
from usvauv.kernels.taichi_internals import core, impl

UNROLLED = MAX_AUVS  # iterations of a loop that Taichi unrolls without a warning
CACHED = 1 << 30  # bytes of compiled kernels kept on disk, of all scenarios and versions together
DEBUG = "USVAUV_DEBUG"  # environment variable: kernels check every index, see `start`
SOFTWARE_VULKAN = "USVAUV_TEST_SOFTWARE_VULKAN"  # environment variable: tests of the GPU path on a machine without one
VULKAN_CPU = 4  # VkPhysicalDeviceType
FEW_TASKS = 256  # most tasks of about a microsecond for which waking another thread takes longer than it saves
# Parameters of glibc's mallopt, and bytes: of one piece, the most that it takes, and of what lies free in a row.
M_MMAP_THRESHOLD, M_TRIM_THRESHOLD, KEPT_EACH, KEPT = -3, -1, 32 << 20, 256 << 20
ITERATIONS = 16  # of a loop that a thread takes at a time
TASKS = Path("/proc/self/task")  # a folder for each thread, on Linux
Settings = Mapping[str, object]
NONE: Settings = {}
# Prefixes of names of settings of a whole program, of its device and of its printed messages.
PROGRAM_SETTING_PREFIXES = (
    "_",
    "arch",
    "device_",
    "kernel_profiler",
    "max_block_dim",
    "num_compile",
    "offline_",
    "print_",
    "random",
)
PROGRAM_SETTING_PREFIXES += ("saturating", "timeline", "use_llvm", "verbose", "vk_")


class RuntimeUnavailable(UserError, RuntimeError):
    """The requested architecture cannot be used on this machine, or another one is running already."""


class Unsupported(RuntimeUnavailable):
    """The running architecture cannot do what is requested.

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
_taichi: Any = None  # Taichi's state that `start` has looked at; another `ti.init` or `ti.reset` makes another one
_inherited: Any = None  # Taichi's state in the process that this one was forked from
_lock = threading.RLock()  # Taichi starts and compiles in one thread at a time
_changes: list[tuple[Any, str, Any, Any]] = []  # owner, name, value here and value elsewhere of settings of a program


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
    fault at once, instead of continuing with memory outside the array. Its messages of overflowing integers come from
    the random numbers, which are meant to overflow.

    From here on the calling thread takes numbers below 1.2e-38 as 0, also those of NumPy and torch in single precision:
    Taichi sets the processor so.

    Returns:
        what is running.

    Raises:
        RuntimeUnavailable: unknown or unusable architecture, or a different one is running already.
    """
    if _taichi is impl.pytaichi and _running is not None and arch in ("auto", _running.arch):
        return _running
    with _lock:
        return _start(arch, threads)


def _start(arch: str, threads: int | None) -> Runtime:
    global _running, _taichi
    if arch not in ARCHITECTURES:
        raise RuntimeUnavailable(f"arch: {arch!r}: {choices(arch, ARCHITECTURES)}")
    if _running is not None:
        if arch not in ("auto", _running.arch):
            raise RuntimeUnavailable(f"arch: {_running.arch!r} is running already, so {arch!r} cannot be started")
        if _taichi is impl.pytaichi:
            return _running
        arch, threads = _running.arch, _running.threads
    others = None if impl.pytaichi.prog is None or impl.pytaichi is _inherited else impl.current_cfg()
    if arch == "auto":
        arch = _name(others.arch) if others else "cuda" if torch.cuda.is_available() else "cpu"
    if arch == "cuda" and not torch.cuda.is_available():
        raise RuntimeUnavailable("arch: 'cuda' was asked for, but torch sees no CUDA device here")
    if others is None:
        _start_program(arch, threads or available_cores())
    elif _name(others.arch) != arch:
        raise RuntimeUnavailable(
            f"arch: other code in this process has started Taichi on {_name(others.arch)!r}, so {arch!r} cannot be "
            f"used: let its `ti.init` ask for {arch!r} too"
        )
    elif threading.current_thread() is not threading.main_thread() and not (
        impl.pytaichi.materialized and impl.root.empty
    ):
        raise RuntimeUnavailable(
            "arch: other code has called `ti.init`, and Taichi makes fields in that thread alone: call `ti.sync()` "
            "there before a world is made in another"
        )
    impl.get_runtime().materialize()  # not later, by another thread
    config = impl.current_cfg()
    threads = min(threads or available_cores(), config.cpu_max_num_threads)
    _find_changes(config, threads)
    torch.set_num_threads(1)
    _keep_memory()
    _running = Runtime(arch, torch.device("cuda" if arch == "cuda" else "cpu"), threads)
    _taichi = impl.pytaichi
    return _running


def _keep_memory() -> None:
    """Have glibc keep what tensors of up to 32 MB leave free. Else it gives much of it back to the system after each
    operation, and the next one waits until its pages are zeroed: a third of an update of training."""
    if sys.platform == "linux" and hasattr(libc := ctypes.CDLL(None), "mallopt"):
        for parameter, most in (M_MMAP_THRESHOLD, KEPT_EACH), (M_TRIM_THRESHOLD, KEPT):
            libc.mallopt(parameter, most)


def _name(arch: Any) -> str:
    """Name of an architecture, as in `ARCHITECTURES` where it is one of them."""
    return "cpu" if arch in (ti.x64, ti.arm64) else core.arch_name(arch)


def _start_program(arch: str, threads: int) -> None:
    """Have Taichi start on an architecture.

    Raises:
        RuntimeUnavailable: it cannot be used.
    """
    if arch == "vulkan" and not os.environ.get(SOFTWARE_VULKAN):
        with _silent_stderr():
            devices = _vulkan_devices()
        if devices and all(kind == VULKAN_CPU for _, kind in devices):
            raise RuntimeUnavailable(f"arch: 'vulkan': {devices[0][0]} computes in software: use cpu")
    if impl.pytaichi is _inherited and (arch != "cpu" or state_with_fields()):
        what = "fields" if arch == "cpu" else f"what Taichi has on {arch}"
        raise RuntimeUnavailable(
            f"arch: this process was forked after Taichi had started, and {what} cannot be used in a fork: "
            "start processes by 'spawn' or 'forkserver'"
        )
    folder, before = cache_folder(), _threads()
    try:
        # Taichi announces itself, and its Vulkan device complains if there is none.
        with contextlib.redirect_stdout(io.StringIO()), _silent_stderr():
            ti.init(
                arch=getattr(ti, arch),
                cpu_max_num_threads=threads,
                offline_cache=True,
                offline_cache_file_path=folder,
                offline_cache_max_size_of_files=CACHED,
                log_level=ti.ERROR,
                unrolling_limit=UNROLLED,
                **_settings(),
            )
    except Exception as error:
        raise RuntimeUnavailable(f"arch: {arch!r} could not be started: {error}") from error
    if _name(impl.current_cfg().arch) != arch:  # Taichi takes the CPU instead
        raise RuntimeUnavailable(f"arch: {arch!r} was asked for, but Taichi finds no such device here")
    _bind(_threads() - before, threads)


def _threads() -> set[int]:
    """Numbers of this process's threads; none where the system does not tell them."""
    return {int(thread.name) for thread in TASKS.iterdir()} if TASKS.exists() else set()


def _bind(created: set[int], count: int) -> None:
    """Keep each of the `count` threads of kernels, the last of the `created`, on a core of its own if they have all.

    Else Linux often wakes two on the same core and leaves them there until a short loop has ended: a step of thousands
    of worlds takes a tenth longer. With fewer threads than cores other processes may have the same plan, and the same
    cores.
    """
    cores = sorted(os.sched_getaffinity(0)) if created else []
    if len(cores) == count:
        with contextlib.suppress(OSError):  # systems that forbid it
            for thread, core in zip(sorted(created)[-count:], cores, strict=True):
                os.sched_setaffinity(thread, {core})


def state_with_fields() -> object | None:
    """What stands for the program that runs, if fields have been made in it; Taichi itself makes an empty tree."""
    program = impl.pytaichi.prog
    if program is None:
        return None
    trees = (program.get_snode_root(tree) for tree in range(program.get_snode_tree_size()))
    return impl.pytaichi if not impl.root.empty or any(tree.get_num_ch() for tree in trees) else None


def is_present(state: object) -> bool:
    """Whether the program of `state_with_fields` still runs."""
    return state is impl.pytaichi


def _settings() -> dict[str, Any]:
    """Settings of Taichi's compiler that differ from its defaults."""
    return {
        "fast_math": False,
        "debug": bool(os.environ.get(DEBUG)),
        # By default a thread gets at least 512 iterations, so that a shorter loop runs on one thread.
        "make_cpu_multithreading_loop": False,
        "cpu_block_dim_adaptive": False,
        "default_cpu_block_dim": ITERATIONS,
    }


def _find_changes(config: Any, threads: int) -> None:
    """What `settings` has to change in a program: settings of its compiler that are not those of this package."""
    global _changes
    default: Any = core.CompileConfig()
    wanted = {name: getattr(default, name) for name in dir(default) if not name.startswith(PROGRAM_SETTING_PREFIXES)}
    wanted |= _settings() | {"cpu_max_num_threads": threads, "check_out_of_bound": bool(os.environ.get(DEBUG))}
    python = {"default_fp": ti.f32, "default_ip": ti.i32, "default_up": ti.u32}
    python |= {"short_circuit_operators": True, "unrolling_limit": UNROLLED}
    both = ((config, wanted), (impl.pytaichi, python))
    _changes = [
        (owner, name, ours, copy.deepcopy(getattr(owner, name)))
        for owner, values in both
        for name, ours in values.items()
        if getattr(owner, name) != ours
    ]


def _note_fork() -> None:
    """In a forked process: what Taichi has lacks its threads, and ending it would wait for them for ever."""
    global _lock, _inherited, _taichi
    _lock = threading.RLock()  # that another thread may have held
    if impl.pytaichi.prog is not None:
        _inherited, _taichi = impl.pytaichi, None
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(_inherited.prog))


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_note_fork)


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
        if _taichi is impl.pytaichi:
            ti.reset()


atexit.register(stop)  # Taichi by itself writes no cache where objects that are left alone, such as worlds, hold it


def cache_folder() -> str:
    """The folder of compiled kernels, without damaged files.

    Where Taichi cannot make or write the folder it crashes at its end; then a temporary one is taken for this process.

    Raises:
        RuntimeUnavailable: there is no place for a temporary folder either, or a name is not in UTF-8.
    """
    folder = os.environ.get("TI_OFFLINE_CACHE_FILE_PATH", "")
    try:
        folder.encode()
        folder = folder or impl.default_cfg().offline_cache_file_path
    except UnicodeError:
        raise RuntimeUnavailable(
            "HOME, XDG_CACHE_HOME, TI_OFFLINE_CACHE_FILE_PATH: Taichi takes only names in UTF-8"
        ) from None
    try:
        os.makedirs(Path(folder, "ticache"), exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        try:
            temporary = tempfile.mkdtemp(prefix="usvauv-")
        except OSError:
            raise RuntimeUnavailable(f"{folder}: compiled kernels cannot be kept: {error.strerror}") from None
        atexit.register(shutil.rmtree, temporary, ignore_errors=True)
        return temporary
    kernel_cache.check(Path(folder), ti.__version__)
    return folder


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


@contextlib.contextmanager
def taichi_lock() -> Iterator[None]:
    """No other thread starts Taichi or compiles meanwhile.

    Taichi takes any of its functions that is called from Python while a kernel is compiled, in whatever thread, for a
    part of that kernel.
    """
    with _lock:
        yield


@contextlib.contextmanager
def settings(special: Settings = NONE) -> Iterator[None]:
    """Compile and launch kernels as `start` has Taichi do it, also in a program that other code has started.

    Args:
        special: over Taichi's configuration as it is here by default.
    """
    with _lock:
        start()
        config = impl.current_cfg()
        changes = [*_changes, *((config, name, value, getattr(config, name)) for name, value in special.items())]
        try:
            for owner, name, ours, _ in changes:
                setattr(owner, name, ours)
            yield
        finally:
            for owner, name, _, theirs in changes:
                setattr(owner, name, theirs)


def fast_compilation() -> Settings:
    """A large kernel is compiled in a third of the time on a CPU, and in half to two thirds of it elsewhere.

    Left out are Taichi's own passes over it, which search it again and again until nothing changes any more: all of
    them on a CPU, where LLVM's passes follow and the mission is as fast, bit for bit, and elsewhere that of the control
    flow. Not the default, because small kernels over large batches are up to half as slow again: `docs/performance.md`.
    """
    return {"advanced_optimization": False} if start().on_cpu else {"cfg_optimization": False}


def vectors_in_registers() -> Settings:
    """Whole vectors stay in registers; by default Taichi splits them.

    Twice as fast on a CPU. Not the default, because Taichi then expects that arrays are aligned to vectors, which holds
    for torch, but not always for NumPy, and because LLVM ends the process at what Taichi 1.7.4 cannot compile of whole
    vectors: negation, `-=`, `abs`, `sign`, casts, bit casts, exponential and trigonometric functions. Written as `-1.0
    * v`, `v = v - x` or element by element they can be compiled.
    """
    return {"real_matrix_scalarize": False} if start().on_cpu else NONE


def too_few_for_threads(tasks: int) -> bool:
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


def writer(tensor: torch.Tensor) -> Callable[[float], object]:
    """A function that writes a number into a tensor of one, on the host by NumPy: after a large kernel torch's code is
    no longer in the processor's caches, and its first operation takes a fiftieth of a step of thousands of worlds.
    """
    return functools.partial(tensor.numpy().__setitem__, 0) if tensor.is_cpu else tensor.fill_


def synchronize() -> None:
    """Wait until all launched kernels are done; on a CPU they already are."""
    ti.sync()
