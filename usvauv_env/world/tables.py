"""From a scenario and its site to the plain numbers that the kernels read."""

from __future__ import annotations

import math

import numpy as np

from kernels.mission import target_rules
from kernels.mission.columns import Information, Parameter, Refraction
from kernels.mission.tasks.data_collection import LEAST_RATE
from kernels.mission.worlds import Program
from kernels.planning import objectives
from kernels.positioning import current_process, sonar_equation, usbl, validation, waveform
from kernels.positioning.ambient_noise import NoiseLaw, ambient_noise_laws
from usvauv_env.scenario import Scenario, ScenarioError
from usvauv_env.site.site import Site
from usvauv_env.site.sound_speed import SoundSpeedProfile
from usvauv_env.world.boat_strategies import BoatStrategy
from usvauv_env.world.current_statistics import current_bound, current_model
from usvauv_env.world.observation import ObservationLayout, observation_terms

LOUDEST = 200.0  # dB re 1 µPa²/Hz, of ambient noise
LAYER_TOLERANCE = 0.5  # m/s, see `SoundSpeedProfile.thinned`


def noise_law(scenario: Scenario) -> NoiseLaw:
    """The law of the ambient noise; the function it gives checks what a plugin's law returns.

    Raises:
        UserError: by that function: the law fails, or returns no level in dB.
    """
    name = scenario.acoustics.ambient_noise

    def law(frequency: float, shipping: float, wind: float) -> float:
        with ambient_noise_laws.calling(name):
            level = ambient_noise_laws[name](frequency, shipping, wind)
        if not isinstance(level, float | int | np.number) or not abs(level) <= LOUDEST:
            raise ambient_noise_laws.refuse(name, level, f"a level from -{LOUDEST:g} to {LOUDEST:g} dB")
        return float(level)

    return law


def data_level(scenario: Scenario) -> float:
    """SNR of the data link at 1 m without loss, dB."""
    nodes, noise = scenario.nodes, scenario.acoustics
    density = noise_law(scenario)(nodes.frequency, noise.shipping, noise.wind)
    level = sonar_equation.noise_level(density, nodes.bandwidth)
    return sonar_equation.acoustic_source_level(nodes.source_power) - level


def reference_rate(scenario: Scenario) -> float:
    """Rate of the data link at the hover radius over the mean bed, Mbit/s."""
    auv, nodes = scenario.auv, scenario.nodes
    separation = auv.depth if auv.separation == "demonstration" else scenario.area.depth - auv.depth
    loss = sonar_equation.transmission_loss(math.hypot(separation, auv.hover_radius), nodes.frequency)
    snr = data_level(scenario) - loss
    return max(1e-6 * sonar_equation.shannon_rate(nodes.bandwidth, snr, nodes.rate_law == "demonstration"), LEAST_RATE)


def sound_layers(site: Site) -> np.ndarray:
    """The speed of sound for `kernels.positioning.rays`, (N, rays.COLUMNS)."""
    profile = site.sound_speed or SoundSpeedProfile.constant(site.scenario.acoustics.sound_speed)
    return profile.thinned(LAYER_TOLERANCE).layers()


def sound_speed(site: Site) -> float:
    """The one speed of sound by which the array turns phases into cosines and delays into metres, m/s."""
    scenario, profile = site.scenario, site.sound_speed
    if profile is None:
        return scenario.acoustics.sound_speed
    if scenario.usbl.refraction == "array":
        return profile.at(0.0)
    return profile.harmonic_mean(0.0, scenario.auv.depth)


def program(site: Site, strategy: BoatStrategy) -> Program:
    """What the mission's kernels are compiled for.

    Raises:
        ScenarioError: a tone too short for the waveform receiver, or an unknown observation term.
    """
    s = site.scenario
    if s.usbl.model == "waveform" and s.usbl.periods < waveform.FEWEST_PERIODS:
        raise ScenarioError(
            f"usbl.periods = {s.usbl.periods}: must be at least {waveform.FEWEST_PERIODS} with usbl.model = waveform"
        )
    refraction = Refraction.none
    if site.sound_speed is not None:
        refraction = Refraction.corrected if s.usbl.refraction == "corrected" else Refraction.ignored
    return Program(
        task=s.task_definition,
        strategy=strategy.functions,
        target_rule=target_rules.parse(s.nodes.target_rule)[0],
        observation=tuple(observation_terms[name].write for name in ObservationLayout.of(s).terms),
        information=getattr(Information, s.nodes.information.replace("-", "_")),
        objective_code=objectives.objective_code(s.planner.measurement, s.planner.objective),
        waveform=s.usbl.model == "waveform",
        refraction=refraction,
        tracker=s.tracker.enabled,
        turns=validation.turns_possible(link_table(site)),
    )


def rule_numbers(scenario: Scenario) -> np.ndarray:
    """The numbers of the target rule, (≥ 1,)."""
    return np.array(target_rules.parse(scenario.nodes.target_rule)[1] or [0.0])


def rule_workspace(scenario: Scenario) -> int:
    """How many numbers of its own the target rule needs in each world, ≥ 1."""
    rule, _ = target_rules.parse(scenario.nodes.target_rule)
    return max(1, rule.workspace(scenario.targets, scenario.auv.count))


def task_parameters(scenario: Scenario) -> np.ndarray:
    """The numbers that the task declares, as the scenario has them, (≥ 1,)."""
    given = scenario.task_parameters.numbers
    return np.array([given.get(name, default) for name, default in scenario.task_definition.parameters] or [0.0])


def reward_weights(scenario: Scenario) -> np.ndarray:
    """Weights of the task's reward terms, (R,)."""
    given = scenario.task_parameters.numbers
    return np.array(
        [
            getattr(scenario.reward, term.name) if term.weight is None else given.get(term.name, term.weight)
            for term in scenario.task_definition.reward_terms
        ]
    )


def link_table(site: Site) -> np.ndarray:
    """Acoustic constants of each AUV's positioning link, see `kernels.positioning.usbl.link_table`."""
    s = site.scenario
    sonar = usbl.Sonar(
        sound_speed=sound_speed(site),
        source_level=s.acoustics.source_level,
        target_strength=s.acoustics.target_strength,
        path=s.acoustics.path,
        ambient_noise=noise_law(s),
        shipping=s.acoustics.shipping,
        wind=s.acoustics.wind,
        bandwidth=s.acoustics.bandwidth,
        noise_law=s.acoustics.noise_law,
        spacing=s.usbl.spacing,
        periods=s.usbl.periods,
        sampling_rate=s.usbl.sampling_rate,
        planner_noise=s.planner.noise,
        reference_range=s.auv.depth,
        attitude_error=s.usbl.attitude_error,
    )
    return usbl.link_table([s.usbl.carrier(k, s.auv.count) for k in range(s.auv.count)], sonar)


def pack_parameters(site: Site, link: np.ndarray, first_world: int) -> np.ndarray:
    """All numbers of a scenario in the order of `kernels.mission.columns.Parameter`, float32.

    Args:
        link: of `link_table`.
        first_world: index of the first world.
    """
    s = site.scenario
    current_variance, correlation_time = 0.0, current_process.FOREVER
    if s.tracker.enabled:
        current_variance, correlation_time = current_model(site, link)
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
        "separation_boat": s.auv.depth,
        "sound_speed": sound_speed(site),
        "propagates": s.usbl.propagation,
        "latency": s.usbl.latency,
        "packet_loss": s.usbl.packet_loss,
        "current_variance": current_variance,
        "correlation_time": correlation_time,
        "current_reading": s.tracker.current_reading,
        "auv_speed": s.auv.speed_max + current_bound(site),
        "horizon": s.planner.horizon,
        "cruise": s.auv.depth,
        "separation_node": s.auv.depth if s.auv.separation == "demonstration" else 0.0,
        "refused_hovers": s.auv.refused_power == "hovering",
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
        "progress": s.reward.distance_form == "progress",
        "service_hovering": s.reward.service_form == "hovering",
        "proximity_once": s.reward.proximity_form == "pair",
        "farthest": math.hypot(s.area.diagonal, s.auv.depth),
        "rate_mean": np.mean(s.nodes.arrival_rates),
        "rate_variance": np.var(s.nodes.arrival_rates),
        "reference_speed": s.reference.straight_speed,
        "reference_rate": reference_rate(s),
        "duration": s.mission.duration,
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
