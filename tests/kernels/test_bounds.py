"""The debug mode: kernels that check every index, run over missions and seas; an index out of bounds ends the process.

Taichi's check cannot raise an error here (`usvauv.kernels.runtime.start`), so each run is a process of its own.
"""

import os
import subprocess
import sys

import pytest

from tests.links import EVERY_STEP
from usvauv.kernels.runtime import DEBUG

MISSION = """
import sys, torch
from usvauv.env import Scenario, World

world = World(Scenario.load(sys.argv[1], sys.argv[3:]), 3, 0, sys.argv[2])
world.reset()
generator = torch.Generator().manual_seed(0)
for _ in range(15):
    world.step(2 * torch.rand((3, world.num_auvs, 2), generator=generator) - 1)
{last}
print("went on")
"""
OUT_OF_BOUNDS = "world.auv[0, 0, 6] = 40.0\nworld.step(torch.zeros(3, world.num_auvs, 2))"  # a node beside the last one


def run(last: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, DEBUG: "1"}
    command = [sys.executable, "-c", MISSION.format(last=last), *arguments]
    return subprocess.run(command, capture_output=True, text=True, env=environment, timeout=900)


@pytest.mark.slow
@pytest.mark.parametrize(
    "arguments",
    [
        ("extreme", "fim", *EVERY_STEP, "auv.count=4"),
        ("station-keeping", "fim-greedy", "sea.equations=nonlinear", "sea.cell_size=10", "sea.realisations=2"),
        ("paper-extreme", "centroid", "nodes.count=500"),
        (
            "ideal",
            "hold:0,0",
            "acoustics.sound_speed_profile=[[0,1500],[50,1490],[200,1485]]",
            "usbl.signal=tone",
        ),
    ],
)
def test_no_index_leaves_its_array(arguments):
    done = run("", *arguments)
    assert done.returncode == 0, done.stderr[-2000:]
    assert "went on" in done.stdout


@pytest.mark.slow
def test_the_mode_sees_an_index_beside_the_last_node():
    """Without the mode the node of another world is read, and nobody notices."""
    assert run(OUT_OF_BOUNDS, "extreme", "fim").returncode != 0
