"""From a scenario to the plain numbers that the kernels read."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kernels.mission.columns import PROFILE_POINTS, Options, Parameter, Refraction, Strategy, Task
from kernels.planning import objectives, receding_horizon
from kernels.positioning import sonar_equation, tracker, usbl, waveform
from usvauv_env.scenario import Scenario, ScenarioError
from usvauv_env.site.bed_and_current import site
from usvauv_env.site.site import boat_separation
from usvauv_env.site.sound_speed import SoundSpeedProfile
from usvauv_env.world.current_statistics import current_model

OBSERVED_CURRENT = {"none": 0, "speed": 1, "vector": 2, "profile": 3}
CURRENT_COMPONENTS = {"none": 0, "speed": 1, "vector": 3, "profile": 3 + 2 * PROFILE_POINTS}  # numbers observed
KINDS = {"fim": "fim", "fim-greedy": "fim_greedy", "fim-horizon": "fim_horizon", "centroid": "centroid"}
LAYER_TOLERANCE = 0.5  # m/s, see `SoundSpeedProfile.thinned`


@dataclass(frozen=True)
class UsvStrategy:
    """How the boat chooses where to go.

    `fim`: head for the place with the best Fisher information of the fixes, by `planner.objective`; `fim-greedy`: for
    the best one within reach of one step; `fim-horizon`: for the one that is best for the tracks over the steps to
    come; `hold:X,Y`: stay at a point, m; `centroid`: the mean of the estimated AUV positions.
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
        if kind == "fim-horizon" and not scenario.tracker.enabled:
            raise ScenarioError("usv: 'fim-horizon' looks ahead along tracks and needs tracker.enabled = true")
        if kind == "fim-horizon" and scenario.planner.objective not in receding_horizon.CRITERIA:
            allowed = ", ".join(receding_horizon.CRITERIA)
            raise ScenarioError(
                f"usv: 'fim-horizon' needs planner.objective to be one of {allowed}, not {scenario.planner.objective}"
            )
        if kind in KINDS and not point:
            return cls(kind, getattr(Strategy, KINDS[kind]))
        if kind == "hold":
            try:
                x, y = (float(part) for part in point.split(","))
            except ValueError:
                raise ScenarioError(f"usv: {text!r}: expected hold:X,Y in metres, for example hold:100,100") from None
            if not (0 <= x <= scenario.area.width and 0 <= y <= scenario.area.length):
                limits = f"[0, {scenario.area.width:g}] × [0, {scenario.area.length:g}]"
                raise ScenarioError(f"usv: {text!r}: the point must lie in the area {limits}")
            return cls(f"hold:{x:g},{y:g}", Strategy.hold, x, y)
        raise ScenarioError(f"usv: {text!r}: allowed are {', '.join(KINDS)} and hold:X,Y")


def data_level(scenario: Scenario) -> float:
    """SNR of the data link at 1 m without loss, dB."""
    nodes, noise = scenario.nodes, scenario.acoustics
    level = sonar_equation.noise_level(nodes.frequency, nodes.bandwidth, noise.shipping, noise.wind)
    return sonar_equation.acoustic_source_level(nodes.source_power) - level


def sound_speed_profile(scenario: Scenario) -> SoundSpeedProfile | None:
    """As `Site.sound_speed`, for callers that do not hold the scenario's site yet."""
    return site(scenario).sound_speed


def sound_layers(scenario: Scenario) -> np.ndarray:
    """The speed of sound for `kernels.positioning.rays`, (N, rays.COLUMNS)."""
    profile = sound_speed_profile(scenario) or SoundSpeedProfile.constant(scenario.acoustics.sound_speed)
    return profile.thinned(LAYER_TOLERANCE).layers()


def sound_speed(scenario: Scenario) -> float:
    """The one speed of sound by which the array turns phases into cosines and delays into metres, m/s."""
    profile = sound_speed_profile(scenario)
    if profile is None:
        return scenario.acoustics.sound_speed
    if scenario.usbl.refraction == "array":
        return profile.at(0.0)
    return profile.harmonic_mean(0.0, boat_separation(scenario))


def options(scenario: Scenario, strategy: UsvStrategy) -> Options:
    """What the mission's kernels are compiled for.

    Raises:
        ScenarioError: a tone too short for the waveform receiver.
    """
    s = scenario
    if s.usbl.model == "waveform" and s.usbl.periods < waveform.FEWEST_PERIODS:
        raise ScenarioError(
            f"usbl.periods = {s.usbl.periods}: must be at least {waveform.FEWEST_PERIODS} with usbl.model = waveform"
        )
    refraction = Refraction.none
    if sound_speed_profile(s) is not None:
        refraction = Refraction.corrected if s.usbl.refraction == "corrected" else Refraction.ignored
    return Options(
        task=Task.station_keeping if s.task == "station-keeping" else Task.collection,
        waveform=s.usbl.model == "waveform",
        refraction=refraction,
        tracker=s.tracker.enabled,
        strategy=strategy.code,
        form=objectives.form(s.planner.measurement, s.planner.objective),
    )


def link_table(scenario: Scenario) -> np.ndarray:
    """Acoustic constants of each AUV's positioning link, see `kernels.positioning.usbl.link_table`."""
    s = scenario
    return usbl.link_table(
        [s.usbl.carrier(k, s.auv.count) for k in range(s.auv.count)],
        sound_speed=sound_speed(s),
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
        attitude_error=s.usbl.attitude_error,
    )


def pack_parameters(scenario: Scenario, strategy: UsvStrategy, first_world: int) -> np.ndarray:
    """All numbers of a scenario in the order of `kernels.mission.columns.Parameter`, float32."""
    s = scenario
    current_variance, correlation_time = 0.0, tracker.FOREVER
    if s.tracker.enabled:
        current_variance, correlation_time = current_model(s, link_table(s))
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
        "hold_x": strategy.x,
        "hold_y": strategy.y,
        "separation_boat": boat_separation(s),
        "sound_speed": sound_speed(s),
        "propagates": s.usbl.propagation,
        "latency": s.usbl.latency,
        "packet_loss": s.usbl.packet_loss,
        "current_variance": current_variance,
        "correlation_time": correlation_time,
        "current_reading": s.tracker.current_reading,
        "horizon": s.planner.horizon,
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
        "formation_radius": s.stations.radius,
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
