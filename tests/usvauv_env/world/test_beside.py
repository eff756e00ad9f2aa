"""Worlds beside other code of Taichi in one process, in forked processes, and as copies."""

import copy
import multiprocessing
import pickle
import subprocess
import sys

import pytest
import torch

from tests.links import EVERY_STEP
from usvauv.env import Scenario, World

# What is compiled soonest.
SIMPLE = ["task=station-keeping", "boat.strategy=hold:0,0", *EVERY_STEP]
STEPS = f"""
import hashlib
import taichi as ti
import torch
from usvauv.env import Scenario, World

def simple(*changes):
    return World(Scenario.load("ideal", [*{SIMPLE}, *changes]), seed=3)

def digest(world, steps=2):
    states = [world.reset().numpy().tobytes()]
    states += [world.step(torch.full((1, 2, 2), 0.1 * i)).observation.numpy().tobytes() for i in range(steps)]
    return hashlib.sha256(b"".join(states)).hexdigest()
"""
OTHERS = """
import usvauv.env
from usvauv.kernels.mission.observation import ObservationTerm, observation_terms

@ti.kernel
def third(table: ti.template()) -> float:
    total = 0.0
    for i in table:
        total += table[i] / 3
    return total

@ti.data_oriented
class Other:
    @ti.kernel
    def three(self) -> ti.i32:
        return 3

def begin(**options):
    ti.init(arch=ti.cpu, log_level=ti.ERROR, **options)
    table = ti.field(float, shape=4)
    table.fill(1.0)
    return table, third(table)

own, before = begin(default_fp=ti.f64, default_ip=ti.i64, fast_math=True, random_seed=3)
world = simple()
print(digest(world), third(own) == before, own.to_numpy().tolist() == [1.0] * 4, Other().three())
own, before = begin(fast_math=True)
world.rewind()
print(digest(world), third(own) == before, own.to_numpy().tolist() == [1.0] * 4, Other().three())
ti.reset()
world.rewind()
print(digest(world))

own, before = begin()

@ti.func
def looked_up(worlds: ti.template(), w, k, first):
    worlds.observation[w, k, first] = 0.25 * own[k]

observation_terms.register("looked_up", ObservationTerm(looked_up, lambda n: ["a table's value"], "1", 0.0, 1.0))
extended = simple('observation.extra=["looked_up"]')
print(extended.reset()[0, :, -1].tolist())
begin()
try:
    extended.step(torch.zeros(1, 2, 2))
except usvauv.UserError as error:
    print(error)
"""


def child(tmp_path, program):
    """Lines that a program prints, in a process of its own."""
    (tmp_path / "program.py").write_text(STEPS + program)
    command = [sys.executable, "-W", "ignore", "program.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return [line for line in done.stdout.splitlines() if not line.startswith("[Taichi]")]


@pytest.mark.slow
@pytest.mark.cpu("worlds and another program on one device")
def test_worlds_and_other_code_of_taichi_leave_each_other_alone(tmp_path):
    """`ti.init` before and after, whatever it sets, and `ti.reset`; a plugin is refused when its field is gone."""
    exec(STEPS, here := {})
    expected = here["digest"](here["simple"]())
    out = child(tmp_path, OTHERS)
    assert out[:3] == [f"{expected} True True 3", f"{expected} True True 3", expected]
    assert out[3] == "[0.25, 0.25]"
    assert out[4].startswith("observation term 'looked_up' of ")
    assert out[4].endswith("call `ti.init` once, before all fields")


FORKS = """
import multiprocessing, os, sys
import numpy as np
from usvauv.kernels import runtime
from usvauv.kernels.functions import kernel
from usvauv.kernels.types import array1

@kernel
def double(x: array1):
    ti.loop_config(block_dim=1)
    for i in range(x.shape[0]):
        x[i] = 2 * x[i]

def doubled():
    numbers = np.ones(64, np.float32)
    double(numbers)
    return float(numbers.sum())

world = simple()
first = digest(world), doubled()

def again(results, deeper):
    world.rewind()
    results.put((digest(world), digest(simple()), doubled()))
    if deeper:
        run(results, False)

def run(results, deeper):
    process = multiprocessing.get_context("fork").Process(target=again, args=(results, deeper))
    process.start()
    process.join(120)

results = multiprocessing.get_context("fork").SimpleQueue()
run(results, True)
print([results.get() == (first[0], first[0], first[1]) for _ in range(2)])
own = ti.field(ti.f32, shape=3)
if os.fork() == 0:
    try:
        world.reset()
    except runtime.RuntimeUnavailable as error:
        print(error, flush=True)
    sys.exit(0)
os.wait()
world.reset()
"""


@pytest.mark.slow
@pytest.mark.cpu("forks")
def test_a_forked_process_starts_anew_or_is_refused(tmp_path):
    """Taichi's threads, which compile and run kernels, are not forked."""
    done, refused = child(tmp_path, FORKS)
    assert done == "[True, True]"
    assert refused.endswith("fields cannot be used in a fork: start processes by 'spawn' or 'forkserver'")


THREADS = """
import threading

def drive(found):
    try:
        found.append(digest(simple()))
    except RuntimeError as error:
        found.append(str(error))

for others in (False, True):
    if others:
        ti.init(arch=ti.cpu, log_level=ti.ERROR)
    found = []
    threads = [threading.Thread(target=drive, args=(found,)) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    print(len(found), *sorted(set(found)))
    ti.sync()
    drive(found)
    print(found[-1])
"""


@pytest.mark.slow
@pytest.mark.cpu("threads")
def test_worlds_in_threads_start_one_after_another(tmp_path):
    """Taichi starts and compiles in one thread at a time, and makes fields in the thread of `ti.init` alone."""
    found, expected, refused, again = child(tmp_path, THREADS)
    assert found == f"3 {expected}"
    assert refused.startswith("3 arch: other code has called `ti.init`, and Taichi makes fields in that thread alone: ")
    assert again == expected


@pytest.mark.parametrize(
    ("copied", "options"),
    [(lambda world: pickle.loads(pickle.dumps(world)), {"seed": [3, 4]}), (copy.deepcopy, {"first_world": 2})],
    ids=["pickle", "deepcopy"],
)
def test_a_copy_of_a_world_goes_on_as_it_does(copied, options):
    world = World(Scenario.load("extreme"), 2, **options)
    actions = 2 * torch.rand((4, 2, world.num_auvs, 2), generator=torch.Generator().manual_seed(1)).to(world.device) - 1
    for moment in range(3):
        other = copied(world)
        assert torch.equal(other.observation, world.observation)
        assert torch.equal(other.reward, world.reward)
        if moment == 0:
            assert torch.equal(other.reset(), world.reset())
        mine, others = world.step(actions[moment]), other.step(actions[moment])
        assert torch.equal(mine.observation, others.observation)
        assert torch.equal(mine.reward, others.reward)
        assert all(torch.equal(mine.info[part], others.info[part]) for part in mine.info)


def test_a_world_is_an_argument_of_a_process_that_is_spawned():
    """Torch sends tensors to it in a way of its own."""
    world = World(Scenario.load("ideal", SIMPLE))
    world.reset()
    process = multiprocessing.get_context("spawn").Process(target=World.reset, args=(world,))
    process.start()
    process.join(120)
    assert process.exitcode == 0


def test_a_world_goes_on_outside_of_torchs_inference_mode():
    """What is made within it cannot be written outside it: arrays of a new world, and seas of a new episode."""
    with torch.inference_mode():
        world = World(Scenario.load("extreme"), 2)
        world.reset()
        world.step(torch.zeros(2, world.num_auvs, 2))
        world.reset()
    world.step(torch.zeros(2, world.num_auvs, 2))
    world.reset()
    world.step(torch.zeros(2, world.num_auvs, 2))
