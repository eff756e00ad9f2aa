"""What a slider of the tab changes in the scenario of a world that runs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from usvauv.env.scenario import Scenario

Changes = dict[str, dict[str, float]]  # section → field → value


@dataclass(frozen=True)
class Slider:
    """A number that a slider sets.

    Attributes:
        label: with the unit.
        bounds: the scenario as it was loaded → least and greatest value; None where it would change nothing.
        step: between two values.
        value: that scenario → the value with which it begins.
        changes: (that scenario, value) → what becomes of it.
        hint: what it does.
    """

    label: str
    bounds: Callable[[Scenario], tuple[float, float] | None]
    step: float
    value: Callable[[Scenario], float]
    changes: Callable[[Scenario, float], Changes]
    hint: str


def _current_bounds(scenario: Scenario) -> tuple[float, float] | None:
    return (0.0, 3.0) if scenario.current.vortices and scenario.current.circulation_max else None


def _current_changes(scenario: Scenario, factor: float) -> Changes:
    current = scenario.current
    return {
        "current": {
            "circulation_min": factor * current.circulation_min,
            "circulation_max": factor * current.circulation_max,
        }
    }


def _storm_bounds(scenario: Scenario) -> tuple[float, float] | None:
    storm = scenario.storm
    if storm.spectrum == "none" or scenario.water.waves:
        return None
    breaking = 0.1 * scenario.sea.gravity * storm.peak_period**2 / (2 * math.pi)
    room = scenario.auv.depth - scenario.highest_long_wave
    return 0.1, math.floor(10 * min(breaking, 0.6 * scenario.area.depth, 0.9 * room, 30.0)) / 10


def _long_bounds(scenario: Scenario) -> tuple[float, float] | None:
    sea = scenario.sea
    if sea.forced_edge == "none":
        return None
    return 0.0, math.floor(10 * min(10.0, scenario.area.depth / 8, max(2 * sea.irregular_rms, 1.0))) / 10


def _ping_bounds(scenario: Scenario) -> tuple[float, float] | None:
    return None if scenario.channel.schedule == "every-step" else (0.0, max(60.0, scenario.channel.interval))


def _level_bounds(scenario: Scenario) -> tuple[float, float]:
    level = scenario.acoustics.source_level
    return max(100.0, level - 30.0), min(250.0, level + 15.0)


SLIDERS: dict[str, Slider] = {
    "current": Slider(
        "Current, ×",
        _current_bounds,
        0.05,
        lambda scenario: 1.0,
        _current_changes,
        "Circulation of all vortices, times the scenario's",
    ),
    "storm": Slider(
        "Storm Hs, m",
        _storm_bounds,
        0.1,
        lambda scenario: scenario.storm.significant_height,
        lambda scenario, height: {"storm": {"significant_height": height}},
        "Significant height of the short waves; wind noise and bubbles follow it where the scenario says so",
    ),
    "long_waves": Slider(
        "Long waves, m rms",
        _long_bounds,
        0.1,
        lambda scenario: scenario.sea.irregular_rms,
        lambda scenario, rms: {"sea": {"irregular_rms": rms}},
        "Irregular long waves at the forced edge; they run in from there",
    ),
    "source_level": Slider(
        "Source level, dB",
        _level_bounds,
        0.5,
        lambda scenario: scenario.acoustics.source_level,
        lambda scenario, level: {"acoustics": {"source_level": level}},
        "Level of the positioning signal, re 1 µPa at 1 m: how far AUVs are heard",
    ),
    "ping": Slider(
        "Ping interval, s",
        _ping_bounds,
        0.5,
        lambda scenario: scenario.channel.interval,
        lambda scenario, interval: {"channel": {"interval": interval}},
        "Least time from one exchange with the AUVs to the next",
    ),
}
