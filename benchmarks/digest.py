"""Two digests, one of missions and one of seas, which a refactoring must not change.

    python -m benchmarks.digest

The missions are those of shipped scenarios and of some with rarer settings, three worlds each, with random actions
and one reset of a single world. All that a step returns, the current and the sea enter the digest bit for bit. A
digest depends on the versions of Taichi and torch and on the processor.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator

import numpy as np
import torch

from usvauv.env import Scenario, World

STEPS = 40
REFRACTION = ["acoustics.sound_speed_profile=[[0,1500],[50,1490],[200,1485]]", "usbl.packet_loss=0.1"]
WITHOUT_CHANNEL = ["channel.schedule=every-step", "navigation.sensor=none", "auv.count=3"]
PAPER_OBJECTIVE = ["planner.objective=paper", "auv.count=4", "planner.measurement=fix"]
CURRENT_VECTOR = ["observation.current=vector"]

MISSIONS = [  # scenario, overrides, the boat's strategy
    ("ideal", [], "fim"),
    ("extreme", [], "fim"),
    ("paper-ideal", CURRENT_VECTOR, "fim"),
    ("paper-extreme", [], "hold:100,100"),
    ("station-keeping", [], "centroid"),
    ("extreme", ["auv.count=8", "planner.objective=a"], "fim-greedy"),
    ("extreme", WITHOUT_CHANNEL, "centroid"),
    ("extreme", REFRACTION, "fim"),
    ("survey", [], "fim"),
    ("wide", [], "belief"),
    ("extreme-torpedo", [], "fim"),
    ("wide-torpedo", [], "belief"),
    ("ideal", PAPER_OBJECTIVE, "fim"),
    ("tracking", [], "belief"),
    ("tracking-plain", [], "hold:5000,5000"),
]
SEAS = [
    [],
    ["sea.forcing=incident", "sea.radiating_edges=['west','north']", "sea.cell_size=4"],
    ["sea.equations=nonlinear", "sea.radiating_edges=['west']"],
]


def mission_arrays(world: World) -> Iterator[np.ndarray]:
    """All that `STEPS` steps of a new world return, with random actions and one reset of a single world."""
    generator = torch.Generator().manual_seed(1)
    yield world.reset().cpu().numpy()
    chosen = torch.arange(world.num_worlds, device=world.device) == 1
    for step in range(STEPS):
        if step == STEPS // 2:
            world.reset(chosen)
        action = 2 * torch.rand((world.num_worlds, world.num_auvs, 2), generator=generator).to(world.device) - 1
        observation, reward, *_, info = world.step(action)
        for tensor in (observation, reward, info["reward_terms"], info["measures"], world.current()):
            yield tensor.cpu().contiguous().numpy()
    yield world.surface(64)


def sea_arrays(scenario: Scenario) -> Iterator[np.ndarray]:
    """The surface in 10 steps on fine cells."""
    world = World(scenario, num_worlds=1, seed=3, usv="hold:0,0", fine_sea=True)
    world.reset()
    for _ in range(10):
        world.step(torch.zeros((1, world.num_auvs, 2), device=world.device))
        yield world.surface(512)


def digest(arrays: Iterable[np.ndarray]) -> bytes:
    """SHA-256 of all bits."""
    found = hashlib.sha256()
    for array in arrays:
        found.update(array.tobytes())
    return found.digest()


def main() -> None:
    every = []
    for name, changes, usv in MISSIONS:
        every.append(digest(mission_arrays(World(Scenario.load(name, changes), num_worlds=3, seed=7, usv=usv))))
        print(f"  {every[-1].hex()[:16]} {name} {usv} {' '.join(changes)}", flush=True)
    print("missions", hashlib.sha256(b"".join(every)).hexdigest()[:16])
    every = [digest(sea_arrays(Scenario.load("extreme", changes))) for changes in SEAS]
    print("seas    ", hashlib.sha256(b"".join(every)).hexdigest()[:16])


if __name__ == "__main__":
    main()
