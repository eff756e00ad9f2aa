"""Taichi as this project starts it."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
import taichi as ti
import torch

from usvauv.kernels import runtime
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


BOUND = """
import os
from pathlib import Path
import taichi as ti
from usvauv.kernels import runtime
from usvauv.kernels.functions import kernel
from usvauv.kernels.types import array1
import torch

@kernel
def work(out: array1):
    ti.loop_config(block_dim=1)
    for n in range(out.shape[0]):
        for _ in range(10000):
            out[n] = ti.sin(out[n] + 1.0)

def nanoseconds():
    tasks = Path("/proc/self/task").iterdir()
    return {int(task.name): int((task / "schedstat").read_text().split()[0]) for task in tasks}

cores = os.sched_getaffinity(0)
runtime.start("cpu")
out = torch.zeros(64 * len(cores))
work(out)
before = nanoseconds()
for _ in range(5):
    work(out)
spent = {task: now - before.get(task, 0) for task, now in nanoseconds().items() if task != os.getpid()}
busiest = sorted(spent, key=spent.get)[-len(cores):]
places = [os.sched_getaffinity(task) for task in busiest]
print(*sorted(core for place in places for core in place))
"""


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


@pytest.mark.cpu("threads")
@pytest.mark.skipif(sys.platform != "linux", reason="threads are bound on Linux")
def test_threads_of_kernels_stay_on_cores_of_their_own(tmp_path):
    """Those that work; the program begins with all cores, whatever the number of threads of this one."""
    program = tmp_path / "program.py"
    program.write_text(BOUND)
    done = subprocess.run([sys.executable, program], capture_output=True, text=True, timeout=300)
    assert done.stdout.split() == [str(core) for core in sorted(os.sched_getaffinity(0))], done.stderr


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


def test_only_what_runs_can_be_started_again(device):
    running = runtime.start()
    assert runtime.start(running.arch) is running
    other = "vulkan" if running.arch != "vulkan" else "cpu"
    with pytest.raises(runtime.RuntimeUnavailable, match=f"'{running.arch}' is running already, so '{other}'"):
        runtime.start(other)
    assert torch.get_num_threads() == 1


def in_a_child(program, *arguments, **environment):
    """What a program prints in a process of its own: lines of standard output and of standard error."""
    command = [sys.executable, "-c", program, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, **environment}, timeout=300)
    return done.stdout.splitlines(), done.stderr.splitlines()


START = """
import os, sys
from usvauv.kernels import runtime
for arch in sys.argv[1:]:
    try:
        print(runtime.start(arch))
    except runtime.RuntimeUnavailable as error:
        print(error, file=sys.stderr)
    os.environ[runtime.SOFTWARE_VULKAN] = "1"
"""


def test_a_missing_device_is_an_error():
    """Taichi by itself would take the CPU."""
    nowhere = {"VK_ICD_FILENAMES": "/nowhere.json", "VK_DRIVER_FILES": "/nowhere.json", "CUDA_VISIBLE_DEVICES": ""}
    out, err = in_a_child(START, "metal", "cuda", "vulkan", **nowhere)
    assert out == []
    assert err == [
        "arch: 'metal': allowed are auto, cpu, cuda, vulkan",
        "arch: 'cuda' was asked for, but torch sees no CUDA device here",
        "arch: 'vulkan' was asked for, but Taichi finds no such device here",
    ]


def test_vulkan_on_a_cpu_is_refused():
    """Unless it is for the tests that it is asked for, as it is at the second start."""
    out, err = in_a_child(START, "vulkan", "vulkan", **{runtime.SOFTWARE_VULKAN: ""})
    if not err or "finds no such device" in err[0]:
        pytest.skip("a graphics card, or no device for Vulkan at all")
    assert err[0].startswith("arch: 'vulkan'")
    assert err[0].endswith(" computes in software: use cpu")
    assert "vulkan" in out[-1]


@pytest.mark.usefixtures("device")
def test_what_vulkan_cannot_do_is_refused(monkeypatch):
    monkeypatch.setattr(runtime, "_running", runtime.Runtime("vulkan", torch.device("cpu"), 2))
    with pytest.raises(runtime.Unsupported, match=r"^arch: 'vulkan' does not serve here: .*nonlinear sea"):
        NonlinearShallowWater(size=(1.0, 1.0), cells=(4, 4), bed=-1.0, interval=1.0)


IMPORT = """
import os, warnings, usvauv.kernels
for package in ("taichi", "another"):
    warnings.warn_explicit("escape", SyntaxWarning, f"/of/{package}/tools/image.py", 1)
print(os.path.isdir(os.environ["HOME"]))
"""


def test_an_import_makes_a_home_and_hides_warnings_of_taichis_docstrings(monkeypatch):
    """Without HOME Taichi aborts the process; the warnings are there from Python 3.12 on, where an installer has not
    compiled its files.
    """
    monkeypatch.delenv("HOME")
    out, (shown,) = in_a_child(IMPORT)
    assert out == ["True"]
    assert shown.startswith("/of/another/")


@pytest.mark.parametrize("place", [os.devnull, f"{os.devnull}/below", "/proc/self/missing"])
def test_where_kernels_cannot_be_kept_a_temporary_folder_is_taken(monkeypatch, place):
    monkeypatch.setenv("TI_OFFLINE_CACHE_FILE_PATH", place)
    assert (Path(runtime.cache_folder()) / "ticache").parent.parent == Path(tempfile.gettempdir())


def test_a_place_of_kernels_whose_name_is_no_text_is_refused(monkeypatch):
    monkeypatch.setenv("TI_OFFLINE_CACHE_FILE_PATH", "/tmp/\udcff")
    with pytest.raises(runtime.RuntimeUnavailable, match=r"TI_OFFLINE_CACHE_FILE_PATH: .* in UTF-8$"):
        runtime.cache_folder()


TRACED = """
import functools, sys
import taichi as ti
ti.init = functools.partial(lambda init, **options: init(**options | {"log_level": ti.TRACE}), ti.init)
from usvauv.cli import app
app.main()
"""


@pytest.mark.cpu("files of compiled kernels")
def test_a_command_compiles_nothing_that_it_compiled_before(tmp_path):
    """Nor when the whole process is left to the system at its end."""
    command = ("sea", "--duration", "1", "--resolution", "4", "--out", str(tmp_path / "sea.nc"))
    compiled = []
    for _ in range(2):
        out, err = in_a_child(TRACED, *command, TI_OFFLINE_CACHE_FILE_PATH=str(tmp_path / "cache"))
        compiled.append(sum("Cache kernel" in line for line in (*out, *err)))
    assert compiled[0] > 3
    assert compiled[1] == 0


KEPT = """
import sys
from usvauv import Scenario, World

world = World(Scenario.load("paper-ideal", ["boat.strategy=centroid", *sys.argv[1:]]))
world.reset()
"""


@pytest.mark.slow
@pytest.mark.cpu("files of compiled kernels")
def test_a_program_that_leaves_its_worlds_alone_keeps_what_it_compiled(tmp_path):
    """It serves other depths, areas and decays of vortices too."""
    folder, kept = {"TI_OFFLINE_CACHE_FILE_PATH": str(tmp_path / "cache")}, []
    for numbers in ([], ["current.decay_depth=100", "auv.depth=90", "area.width=210"]):
        command = [sys.executable, "-c", KEPT, *numbers]
        subprocess.run(command, env={**os.environ, **folder}, timeout=300, check=True)
        kept.append({path.name for path in (tmp_path / "cache").glob("*.tic")})
    assert len(kept[0]) > 1
    assert kept[1] == kept[0]


DAMAGE = """
import os, sys
from pathlib import Path
import numpy as np
from usvauv.kernels import runtime
from usvauv.kernels.functions import kernel
from usvauv.kernels.types import array1

@kernel
def double(x: array1):
    for i in range(x.shape[0]):
        x[i] = 2 * x[i]

def run():
    x = np.ones(3, np.float32)
    runtime.start("cpu")
    double(x)
    runtime.stop()
    return x.tolist()

def overwrite(place, new):
    return lambda data: data[:place] + new + data[place + len(new) :]

folder = Path(os.environ["TI_OFFLINE_CACHE_FILE_PATH"])
run()
for name in ("*.tic", "ticache.tcb"):
    for damaged in (bytes(), os.urandom(500), lambda data: data[:-3], overwrite(0, b"?"), overwrite(25, b"????")):
        (file,) = folder.glob(name)
        file.write_bytes(damaged(file.read_bytes()) if callable(damaged) else damaged)
        print(run(), len(list(folder.glob("*.tic"))), flush=True)
next(folder.glob("*.tic")).unlink()
print(run(), len(list(folder.glob("*.tic"))))
(folder / "ticache.lock").touch()  # as of a process that is writing
print(run(), 1)
os.utime(folder / "ticache.lock", (0, 0))  # and of one that was killed
print(run(), 1 - (folder / "ticache.lock").exists())
"""


@pytest.mark.cpu("files of compiled kernels")
def test_a_damaged_cache_of_kernels_is_made_anew(tmp_path):
    """Files of kernels and their index, cut off or of other content. Only a lock of a process that lives is kept."""
    (tmp_path / "damage.py").write_text(DAMAGE)
    folder = {"TI_OFFLINE_CACHE_FILE_PATH": str(tmp_path / "cache")}
    command = [sys.executable, str(tmp_path / "damage.py")]
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, **folder}, timeout=300)
    assert [line for line in done.stdout.splitlines() if line[:1] == "["][-13:] == 13 * ["[2.0, 2.0, 2.0] 1"]
    said = [line for line in done.stderr.splitlines() if line.startswith("usvauv: compiled kernels in ")]
    assert len(said) == 9, done.stderr


def test_it_can_be_imported_where_all_warnings_are_errors():
    assert in_a_child("import usvauv.kernels, taichi; print('imported')", PYTHONWARNINGS="error") == (["imported"], [])
