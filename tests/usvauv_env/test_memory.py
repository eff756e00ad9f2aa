"""Memory: refused before it is taken, by estimates that are near what is measured."""

import subprocess
import sys

import pytest
import torch

from policies.training.replay import Replay
from usvauv_env import Scenario, World, memory
from usvauv_env.memory import MemoryNeeded, available, require, words
from usvauv_env.sea_alone.simulation import SeaSimulation

GIB = 2**30
MEASURE = """
import re
from usvauv_env import Scenario, World
from usvauv_env.sea.build import build_sea, sea_bytes
from usvauv_env.site.site import Site

def peak():
    return 1024 * int(re.search(r"VmHWM:\\s*(\\d+)", open("/proc/self/status").read())[1])  # not the parent's

quick = Scenario.load("extreme", ["sea.update_interval=0.02"])
build_sea(Site(quick), 0, 1).advance()
before = peak()
sea = build_sea(Site(quick), 0, 1, (1600, 1600))
sea.advance()
print(sea_bytes(quick, (1600, 1600), 1) / (peak() - before))
"""


def test_the_estimate_of_a_sea_is_near_what_it_takes():
    """Within a factor of 1.5 of the growth of the resident memory's peak."""
    ratio = float(subprocess.run([sys.executable, "-c", MEASURE], capture_output=True, text=True, check=True).stdout)
    assert 1 / 1.5 < ratio < 1.5


def test_available_is_what_the_machine_says():
    assert 2**20 < available() < 2**50


def test_what_does_not_fit_is_refused_with_the_numbers(monkeypatch):
    monkeypatch.setattr(memory, "available", lambda device=None: 10 * GIB)
    require(8 * GIB, "just fits")
    with pytest.raises(MemoryNeeded, match=r"^a: takes about 9 GiB of memory; allowed are 8 GiB, 80% of the 10 GiB"):
        require(9 * GIB, "a")
    assert words(149 * GIB) == "149 GiB"
    assert words(3 * 2**20) == "3 MiB"


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: World(Scenario.load("extreme", ["sea.cell_size=0.1"]), 16, 0), r"^sea\.cell_size, .*16 seas of 2000"),
        (lambda: World(Scenario.load("extreme", ["sea.fine_cells=8192"]), 1, 0, fine_sea=True), "8192 × 8192 cells"),
        (lambda: World(Scenario.load("extreme"), 1 << 22, 0), r"^num_worlds = 4194304 of 2 AUVs"),
        (lambda: SeaSimulation(Scenario.load("extreme"), 0, (8192, 8192), 1.0), "8192 × 8192 cells"),
        (lambda: Replay(10**7, (8, 2, 60, 2), torch.device("cpu"), False), "^training: replay = 80000000"),
    ],
)
def test_who_asks_before_taking(monkeypatch, make, match):
    monkeypatch.setattr(memory, "available", lambda device=None: 2 * GIB)
    with pytest.raises(MemoryNeeded, match=match):
        make()
