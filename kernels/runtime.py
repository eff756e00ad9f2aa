"""The one place where Taichi is started and where the rest of the program learns what it runs on.

Taichi is started at the first use, never at import. Starting it a second time would invalidate every compiled kernel,
so a second call with another architecture is an error.
"""

from __future__ import annotations

import contextlib
import functools
import io
import os
from collections.abc import Iterator
from dataclasses import dataclass

import taichi as ti
import torch
from taichi.lang import impl, kernel_impl
from taichi.lang.ast import ast_transformer_utils

from kernels.errors import UserError

FEW_TASKS = 256  # of about a microsecond: on two cores waking another thread only pays beyond
TURNS = 16  # of a loop that a thread takes at a time
ARCHITECTURES = ("auto", "cpu", "cuda", "vulkan", "metal")


class RuntimeUnavailable(UserError, RuntimeError):
    """The requested architecture cannot be used on this machine, or another one is already running."""


@dataclass(frozen=True)
class Runtime:
    """What is running: Taichi's architecture, torch's device and the number of CPU threads of both."""

    arch: str
    device: torch.device
    threads: int


_running: Runtime | None = None


def available_cores() -> int:
    """CPU cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def start(arch: str = "auto", threads: int | None = None) -> Runtime:
    """Start Taichi once, and tell what was started.

    Args:
        arch: one of `ARCHITECTURES`; "auto" takes CUDA where torch and Taichi both see a device, else the CPU.
        threads: CPU threads of Taichi's kernels; default all cores this process may use. Torch is set to one thread,
            because its small matrix products lose far more to a busy second core than they gain from it.

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
    threads = threads or available_cores()
    try:
        with contextlib.redirect_stdout(io.StringIO()):  # Taichi announces itself
            ti.init(
                arch=getattr(ti, arch),
                cpu_max_num_threads=threads,
                offline_cache=True,
                fast_math=False,
                # Taichi would give a thread at least 512 turns of a loop, whatever one takes: fewer ran on one thread.
                make_cpu_multithreading_loop=False,
                cpu_block_dim_adaptive=False,
                default_cpu_block_dim=TURNS,
                log_level=ti.ERROR,
            )
    except Exception as error:
        raise RuntimeUnavailable(f"arch: {arch!r} could not be started: {error}") from error
    _read_kernels_quickly()
    torch.set_num_threads(1)
    device = torch.device("cuda" if arch == "cuda" else "cpu")
    _running = Runtime(arch, device, threads)
    return _running


def _read_kernels_quickly() -> None:
    """Halve the time that Taichi takes to read a kernel, which it does in every process, compiled before or not.

    For each expression it composes an extract of the source with the expression underlined, in case of an error; and
    it reads a function's source again for each call of it. File and line are enough for an error, and once to read.
    """

    def place(context, node) -> str:
        line = node.lineno + context.lineno_offset
        return f'File "{context.file}", line {line}, in {context.func.func.__name__}:\n'

    ast_transformer_utils.ASTTransformerContext.get_pos_info = place
    for name in ("getsourcelines", "getsourcefile"):
        setattr(kernel_impl, name, functools.cache(getattr(kernel_impl, name)))


@contextlib.contextmanager
def vectors_in_registers() -> Iterator[None]:
    """Let a kernel that is compiled here keep whole vectors in registers, where Taichi would by default split them.

    Twice as fast on a CPU. Not the default, because Taichi then lacks several vector functions that other kernels use
    and takes it that arrays begin at whole vectors, which those of torch do, but not all of NumPy.
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
    """Let a kernel that is compiled here go without the pass that takes most of the time of compiling a long one.

    That takes a half to a third of the time; what comes out is a tenth to a fifth slower.
    """
    config = impl.current_cfg()
    default = config.cfg_optimization
    config.cfg_optimization = False
    try:
        yield
    finally:
        config.cfg_optimization = default


def better_alone(tasks: int) -> bool:
    """Whether so few short tasks on a CPU are done sooner by the calling thread than another one wakes up."""
    return start().device.type == "cpu" and tasks <= FEW_TASKS


def synchronize() -> None:
    """Wait until all launched kernels are done (a no-op on the CPU, needed before a clock is read on a GPU)."""
    ti.sync()
