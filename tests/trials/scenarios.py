"""Random scenarios within all bounds, each run for some mission steps: state finite, power above 0, nobody outside.

A kind of `tests.trials.fuzz`. A scenario is a shipped one with some numbers drawn anew: at a bound, or log-uniform
between the bounds. What it does not refuse has to run.
"""

from __future__ import annotations

import math
import random
from typing import Any

import torch
from pydantic.fields import FieldInfo

from tests.links import EVERY_STEP
from usvauv.env import Scenario, World
from usvauv.env.scenario.fields import Section
from usvauv.kernels.mission.columns import AuvColumn, BoatColumn

STEPS = 12
LONGEST = 2e8  # cell steps of a mission step that the trial has time for
FIXED = ("water", "name", "description", "task", "task_parameters")
OPTIONS = (  # sets of choices; each compiles its own kernels
    ("extreme", ()),
    ("extreme", (*EVERY_STEP, "observation.current=vector")),
    ("paper-extreme", ()),
    ("station-keeping", ("sea.equations=nonlinear", "sea.cell_size=10", "sea.realisations=2")),
    ("ideal", ("acoustics.sound_speed_profile=[[0,1500],[50,1490],[11000,1550]]", "planner.objective=a")),
    ("extreme", (*EVERY_STEP, "acoustics.path=transponder", "planner.measurement=phase")),
)


def bounds(field: FieldInfo) -> tuple[float, float] | None:
    """Bounds of a number, both included; None for another kind of field."""
    if field.annotation not in (int, float):
        return None
    low = high = None
    for rule in field.metadata:
        low = getattr(rule, "ge", low)
        high = getattr(rule, "le", high)
        if (below := getattr(rule, "lt", None)) is not None:
            high = math.nextafter(below, -math.inf)
    if low is None or high is None:
        raise AssertionError(f"{field.description}: a number without bounds")
    return low, high


def numbers() -> dict[str, tuple[type, float, float, Any]]:
    """Every bounded number of a scenario: section.field → type, bounds, default."""
    found = {}
    for name, section in Scenario.model_fields.items():
        kind = section.annotation
        if name in FIXED or not (isinstance(kind, type) and issubclass(kind, Section)):
            continue
        for key, field in kind.model_fields.items():
            if (limits := bounds(field)) is not None:
                found[f"{name}.{key}"] = (field.annotation, *limits, field.default)
    return found


def draw(source: random.Random, kind: type, low: float, high: float, usual: float) -> float | int:
    """A number: at a bound in two cases of seven, near the usual one in one, else anywhere."""
    choice = source.randrange(7)
    if choice < 2:
        value = (low, high)[choice]
    elif choice == 2:
        value = min(max(usual * source.uniform(0.5, 2.0), low), high)
    elif low >= 0 and high > 100 * max(low, 1e-9):
        least = max(low, 1e-6 * high)
        value = math.exp(source.uniform(math.log(least), math.log(high)))
    else:
        value = source.uniform(low, high)
    value = min(max(value, low), high)
    return round(value) if kind is int else value


def random_overrides(source: random.Random, section: str = "") -> list[str]:
    """From one to eight numbers anew, of a section or of all."""
    table = {name: about for name, about in numbers().items() if name.startswith(section)}
    names = source.sample(sorted(table), source.choice((1, 2, 3, 5, 8)))
    values = [f"{name}={draw(source, *table[name])!r}" for name in names]
    if section:
        return values
    if source.random() < 0.2:
        centre = [source.choice((-1e5, 0.0, 1e5, source.uniform(0, 200))) for _ in range(2)]
        values.append(f"current.centres=[{centre}]")
    if source.random() < 0.2:
        values.append(f"nodes.arrival_rates=[{source.choice((0.0, 1e-6, 8.0, 8000.0))!r}]")
    if source.random() < 0.2:
        values.append(f"usbl.carriers=[{source.choice((100.0, 15000.0, 2e5))!r}]")
    return values


def effort(scenario: Scenario, worlds: int) -> float:
    """Cell steps of a mission step."""
    sea, area = scenario.sea, scenario.area
    cells = area.width * area.length / sea.cell_size**2
    celerity = math.sqrt(2 * sea.gravity * area.depth)
    substeps = max(1.0, sea.update_interval * celerity / (0.95 * sea.cell_size))
    updates = math.ceil(scenario.mission.step / sea.update_interval)
    return cells * substeps * updates * min(worlds, sea.realisations)


def fault_of(world: World, before: torch.Tensor | None) -> str | None:
    """What is wrong with a world's state, if anything."""
    for name, value in world.state().items():
        if not torch.isfinite(value.double()).all():
            return f"{name} is not finite"
    for name in ("reward", "reward_terms"):
        if not torch.isfinite(getattr(world, name)).all():
            return f"{name} is not finite"
    area = world.scenario.area
    limit = torch.tensor([area.width, area.length], device=world.device)
    for place in (world.auv[..., AuvColumn.x : AuvColumn.y + 1], world.boat[..., BoatColumn.x : BoatColumn.y + 1]):
        if not ((place >= 0) & (place <= limit)).all():
            return "somebody is outside"
    if before is not None and not (world.auv[..., AuvColumn.power] > 0).all():
        return "power is not positive"
    return None


def short(scenario: Scenario, worlds: int) -> bool:
    """Whether the trial has time for it."""
    return effort(scenario, worlds) <= LONGEST * (0.02 if scenario.sea.equations == "nonlinear" else 1)


def run(scenario: Scenario, seed: int, worlds: int) -> str | None:
    """Run a mission for some steps; returns its fault."""
    world = World(scenario, worlds, seed)
    world.reset()
    generator = torch.Generator().manual_seed(seed)
    action = None
    if fault := fault_of(world, action):
        return f"at reset: {fault}"
    for step in range(STEPS):
        action = 2 * torch.rand((worlds, world.num_auvs, 2), generator=generator) - 1
        world.step(action)
        if fault := fault_of(world, action):
            return f"step {step}: {fault}"
    return None
