"""From a scenario to the plain numbers that the kernels read."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kernels import acoustics, fisher, usbl
from kernels.layout import Parameter, Strategy
from usvauv_env.scenario import Scenario, ScenarioError

OBSERVED_CURRENT = {"none": 0, "speed": 1, "vector": 2}


@dataclass(frozen=True)
class UsvStrategy:
    """How the boat chooses where to go.

    `fim`: maximise the determinant of the Fisher information of the fixes; `hold:X,Y`: stay at a point, m;
    `centroid`: the mean of the measured AUV positions.
    """

    name: str
    code: int
    x: float = 0.0
    y: float = 0.0

    @classmethod
    def parse(cls, text: str, scenario: Scenario) -> UsvStrategy:
        """Read a strategy by name.

        Raises:
            ScenarioError: unknown strategy, or a point outside the area.
        """
        kind, _, point = text.partition(":")
        if kind in ("fim", "centroid") and not point:
            return cls(kind, getattr(Strategy, kind))
        if kind == "hold":
            try:
                x, y = (float(part) for part in point.split(","))
            except ValueError:
                raise ScenarioError(f"usv: {text!r}: expected hold:X,Y in metres, for example hold:100,100") from None
            if not (0 <= x <= scenario.area.width and 0 <= y <= scenario.area.length):
                limits = f"[0, {scenario.area.width:g}] × [0, {scenario.area.length:g}]"
                raise ScenarioError(f"usv: {text!r}: the point must lie in the area {limits}")
            return cls(f"hold:{x:g},{y:g}", Strategy.hold, x, y)
        raise ScenarioError(f"usv: {text!r}: allowed are fim, hold:X,Y and centroid")


def boat_separation(scenario: Scenario) -> float:
    """Vertical distance from the mean surface to an AUV as positioning takes it, m."""
    return scenario.area.depth if scenario.auv.separation == "demonstration" else scenario.auv.depth


def data_level(scenario: Scenario) -> float:
    """SNR of the data link at 1 m without loss, dB."""
    nodes, noise = scenario.nodes, scenario.acoustics
    level = acoustics.noise_level(nodes.frequency, nodes.bandwidth, noise.shipping, noise.wind)
    return acoustics.acoustic_source_level(nodes.source_power) - level


def link_table(scenario: Scenario) -> np.ndarray:
    """Acoustic constants of each AUV's positioning link, see `kernels.usbl.link_table`."""
    s = scenario
    return usbl.link_table(
        [s.usbl.carrier(k, s.auv.count) for k in range(s.auv.count)],
        sound_speed=s.acoustics.sound_speed,
        source_level=s.acoustics.source_level,
        target_strength=s.acoustics.target_strength,
        path=s.acoustics.path,
        shipping=s.acoustics.shipping,
        wind=s.acoustics.wind,
        bandwidth=s.acoustics.bandwidth,
        noise_law=s.acoustics.noise_law,
        spacing=s.usbl.spacing,
        periods=s.usbl.periods,
        sampling_rate=s.usbl.sampling_rate,
        planner_noise=s.planner.noise,
        reference_range=boat_separation(s),
    )


def pack_parameters(scenario: Scenario, strategy: UsvStrategy, first_world: int) -> np.ndarray:
    """All numbers of a scenario in the order of `kernels.layout.Parameter`, float32."""
    s = scenario
    numbers = {
        "step": s.mission.step,
        "width": s.area.width,
        "length": s.area.length,
        "diagonal": s.area.diagonal,
        "first_world": first_world,
        "circulation_min": s.current.circulation_min,
        "circulation_max": s.current.circulation_max,
        "alternate": s.current.alternate,
        "core_radius_min": s.current.core_radius_min,
        "core_radius_max": s.current.core_radius_max,
        "random_vortices": s.current.count > 0 and not s.current.centres,
        "tilt": s.usbl.tilt,
        "attitude_error": s.usbl.attitude_error,
        "top_speed": s.boat.top_speed,
        "drifts": s.boat.drifts,
        "strategy": strategy.code,
        "hold_x": strategy.x,
        "hold_y": strategy.y,
        "information_form": fisher.form(s.planner.measurement, s.planner.objective),
        "separation_boat": boat_separation(s),
        "cruise": 0.0 if s.auv.separation == "demonstration" else s.auv.depth,
        "speed_min": s.auv.speed_min,
        "speed_max": s.auv.speed_max,
        "polar": s.auv.action == "polar",
        "start_margin": s.auv.start_margin,
        "start_separation": s.auv.start_separation,
        "safe_distance": s.auv.safe_distance,
        "collision_distance": s.auv.collision_distance,
        "hover_radius": s.auv.hover_radius,
        "node_margin": s.nodes.margin,
        "buffer": s.nodes.buffer,
        "start_backlog": s.nodes.start_backlog,
        "payload": s.nodes.payload,
        "data_level": data_level(s),
        "data_frequency": s.nodes.frequency,
        "data_bandwidth": s.nodes.bandwidth,
        "data_demonstration": s.nodes.rate_law == "demonstration",
        "distance_weight": s.nodes.distance_weight,
        "observed_current": OBSERVED_CURRENT[s.observation.current],
        "progress": s.reward.distance_form == "progress",
        "weight_distance": s.reward.distance,
        "weight_border": s.reward.border,
        "weight_overflow": s.reward.overflow,
        "weight_proximity": s.reward.proximity,
        "weight_service": s.reward.service,
        "weight_power": s.reward.power,
        "weight_collaboration": s.reward.collaboration,
        "farthest": math.hypot(s.area.diagonal, boat_separation(s)),
    }
    return np.array([float(numbers[name]) for name in Parameter.names], np.float32)


def fixed_vortices(scenario: Scenario) -> np.ndarray:
    """Vortices at given centres, (V, 4), of mean circulation and core radius; one of no circulation for none."""
    current = scenario.current
    table = np.tile(np.array([0.0, 0.0, 0.0, 1.0], np.float32), (max(current.vortices, 1), 1))
    for row, centre in zip(table, current.centres, strict=False):
        circulation = 0.5 * (current.circulation_min + current.circulation_max)
        row[:] = (*centre, circulation, 0.5 * (current.core_radius_min + current.core_radius_max))
    return table
