"""Conversion of a scenario and its site into the numbers that the kernels read."""

from __future__ import annotations

import cmath
import math
from dataclasses import fields
from functools import partial
from typing import NamedTuple

import numpy as np
import torch

from usvauv.env.scenario.fields import ScenarioError
from usvauv.env.scenario.scenario import Scenario
from usvauv.env.scenario.team import CLEAREST, Nodes
from usvauv.env.sea.storm import total_height, wave_systems
from usvauv.env.sea.water import Seeds, current_bound
from usvauv.env.site.positions import far_position
from usvauv.env.site.site import Site
from usvauv.env.site.sound_speed import SoundSpeedProfile
from usvauv.env.world.boat_speed import control_time, response_time, top_speed
from usvauv.env.world.current_statistics import FOREVER, current_model
from usvauv.env.world.message_parameters import data_ratio, message_parameters
from usvauv.env.world.observation_layout import ObservationLayout
from usvauv.env.world.strategy_choice import StrategyChoice
from usvauv.kernels import random, runtime
from usvauv.kernels.flow.vortex_motion import steps_of_renewal
from usvauv.kernels.functions import LANES
from usvauv.kernels.mission import target_rules
from usvauv.kernels.mission.auvs.vehicles import Motion
from usvauv.kernels.mission.boats.boat_motion import DRIFT_TIME
from usvauv.kernels.mission.boats.boat_strategies import BoatStrategy
from usvauv.kernels.mission.choices import schedules
from usvauv.kernels.mission.columns import Action, Flag, Information, Parameter, Schedule, Sensor
from usvauv.kernels.mission.episode import draw_vortices
from usvauv.kernels.mission.observation import observation_terms
from usvauv.kernels.mission.tasks.data_collection import LEAST_RATE, arrival_table
from usvauv.kernels.mission.worlds import Program
from usvauv.kernels.planning import objectives
from usvauv.kernels.positioning import sonar, usbl
from usvauv.kernels.positioning.acoustic_link import Accuracy, Sonar, attenuation_per_km, optical_budget
from usvauv.kernels.positioning.acoustic_link import link_table as link_constants
from usvauv.kernels.positioning.laws import NoiseLaw, SeaWater, absorption_laws, ambient_noise_laws, rate_laws
from usvauv.kernels.positioning.sonar import (
    boat_noise,
    rain_noise,
    total_level,
    wind_of_developed_sea,
    wind_of_growing_sea,
)
from usvauv.kernels.vehicles import otter_numbers
from usvauv.kernels.vehicles.definition import vehicles

OWN_NOISE_FREQUENCY = 15000.0  # Hz, at which a scenario states own noise
DEPTH_TIME = 20.0  # s, correlation time of the error of an AUV's depth
SPEED_RESPONSE = Parameter.names[Parameter.span("speed_memory", "speed_noise_rest")]
SERVICE_FILL = 0.65  # share of a full buffer collected in a typical service, for the boat's prediction
STRONGEST = 50.0  # m/s, upper limit of Wu's law for the drag of the sea surface
SHORTEST = 1e-4  # s, of a vehicle's substep
LOUDEST = 200.0  # dB re 1 µPa²/Hz, of ambient noise


def noise_law(scenario: Scenario) -> NoiseLaw:
    """The law of the ambient noise, rain included, as a function that checks the result of a plugin's law.

    Raises:
        UserError: from that function, if the law fails or does not return a level in dB.
    """
    name = scenario.acoustics.ambient_noise

    def law(frequency: float, shipping: float, wind: float) -> float:
        with ambient_noise_laws.calling(name):
            level = ambient_noise_laws[name](frequency, shipping, wind)
        if not isinstance(level, float | int | np.number) or not abs(level) <= LOUDEST:
            raise ambient_noise_laws.refuse(name, level, f"a level from -{LOUDEST:g} to {LOUDEST:g} dB")
        return total_level(float(level), rain_noise(frequency, scenario.acoustics.rain))

    return law


def wind(site: Site) -> float:
    """Wind speed over the sea, m/s.

    "storm" is the wind under which the wind sea reaches its height and period, at most `STRONGEST`; with a wave file,
    the wind given there, or else that of a fully developed sea as high as its wind sea.
    """
    scenario = site.scenario
    if scenario.acoustics.wind != "storm":
        return scenario.acoustics.wind
    if (waves := site.waves) is not None:
        return waves.wind if waves.wind is not None else wind_of_developed_sea(waves.wind_sea_height)
    storm = scenario.storm
    if storm.spectrum == "none":
        return 0.0
    return min(wind_of_growing_sea(storm.significant_height, storm.peak_period), STRONGEST)


def wind_direction(site: Site) -> float:
    """Direction that the wind blows to, rad anticlockwise from east.

    It is that of the storm, or of the first system in a wave file.
    """
    scenario = site.scenario
    systems = wave_systems(site) if site.waves is not None else ()
    return systems[0].direction if systems else scenario.storm.direction


def absorption(scenario: Scenario, frequency: float) -> float:
    """Absorption at a frequency (Hz) half way down to the AUVs, dB/km."""
    acoustics = scenario.acoustics
    water = SeaWater(acoustics.water_temperature, acoustics.water_salinity, acoustics.ph, scenario.auv.depth / 2)
    return absorption_laws[acoustics.absorption](frequency, water)


class DataLink(NamedTuple):
    """Constants that decide the data link's rate at a slant range.

    Attributes:
        level: SNR at 1 m without loss, dB; for light relative to the SNR that the receiver needs.
        spreading: dB per decade of range.
        absorption: dB/km.
    """

    level: float
    spreading: float
    absorption: float

    @classmethod
    def of(cls, site: Site) -> DataLink:
        """The link of a scenario in its water."""
        nodes, noise = site.scenario.nodes, site.scenario.acoustics
        if nodes.rate_law == "optical":
            budget = optical_budget(nodes.optical_range, CLEAREST)
            return cls(budget, 20.0, attenuation_per_km(nodes.attenuation))
        density = noise_law(site.scenario)(nodes.frequency, noise.shipping, wind(site))
        level = sonar.acoustic_source_level(nodes.source_power) - sonar.noise_level(density, nodes.bandwidth)
        return cls(level, noise.spreading, absorption(site.scenario, nodes.frequency))

    def rate(self, nodes: Nodes, slant: float) -> float:
        """Rate at a slant range (m), Mbit/s; at least `LEAST_RATE`."""
        snr = self.level - sonar.path_loss(slant, self.spreading, self.absorption)
        with rate_laws.calling(nodes.rate_law):
            return max(1e-6 * rate_laws[nodes.rate_law](nodes.bandwidth, nodes.rate_max, snr), LEAST_RATE)


def reference_rate(site: Site) -> float:
    """Rate of the data link in a typical service over the mean bed, Mbit/s: at the hover radius, or in passing at half
    the range of service.
    """
    share = 0.5 if site.scenario.nodes.service == "passing" else 1.0
    slant = math.hypot(site.scenario.height_over_nodes, share * site.scenario.service_radius)
    return DataLink.of(site).rate(site.scenario.nodes, slant)


def sound_profile(site: Site) -> SoundSpeedProfile:
    """The speed of sound at as few depths as the site's rays need."""
    s = site.scenario
    profile = site.sound_speed or SoundSpeedProfile.constant(s.acoustics.sound_speed)
    trough = min(total_height(wave_systems(site)) or s.storm.significant_height, 0.5 * s.auv.depth)
    return profile.thinned((0.0, 0.5 * trough, trough), s.auv.depth, s.area.diagonal, site.mean_depth)


def sound_speed(site: Site) -> float:
    """The speed of sound with which the array converts phases into cosines and delays into distances, m/s."""
    scenario, profile = site.scenario, site.sound_speed
    return profile.harmonic_mean(0.0, scenario.auv.depth) if profile else scenario.acoustics.sound_speed


def program(site: Site, strategy: BoatStrategy, link: np.ndarray) -> Program:
    """The options for which the mission's kernels are compiled; `link` is from `link_table`.

    Raises:
        ScenarioError: an unknown observation term.
    """
    s = site.scenario
    urgency = schedules.get(s.channel.schedule)
    return Program(
        task=s.task_definition,
        strategy=strategy.functions,
        target_rule=target_rules.parse(s.nodes.target_rule)[0],
        rate_law=rate_laws[s.nodes.rate_law],
        observation=tuple(observation_terms[name].write for name in ObservationLayout.of(s).terms),
        information=getattr(Information, s.nodes.information.replace("-", "_")),
        objective_code=objectives.objective_code(s.planner.measurement, s.planner.objective),
        refraction=site.sound_speed is not None,
        schedule=Schedule.one if urgency else getattr(Schedule, s.channel.schedule.replace("-", "_")),
        urgency=urgency,
        messages=s.channel.priced,
        sensor=getattr(Sensor, s.navigation.sensor),
        turns=usbl.turns_possible(link),
        fleet=s.boat.count > 1,
        vehicle=s.auv.dynamic,
        otter=s.boat.model == "otter",
        repeats=site.eddies.pattern.repeats,
        passing=s.nodes.service == "passing",
        battery=s.auv.battery > 0,
        abreast=random.LANES * math.ceil(s.auv.count / random.LANES) if strategy.functions.weigh else 0,
    )


def kernel_tables(site: Site, strategy: StrategyChoice) -> dict[str, np.ndarray]:
    """The arrays of `usvauv.kernels.mission.worlds.TABLES` that a scenario decides, and the bed."""
    s = site.scenario
    link = link_table(site)
    sound = sound_profile(site)
    task, given = s.task_definition, s.task_parameters.numbers
    weights = [
        getattr(s.reward, term.name) if term.weight is None else given.get(term.name, term.weight)
        for term in task.reward_terms
    ]
    numbers = {
        "p": pack_parameters(site, link),
        "link": link,
        "links": side_by_side(link),
        "layers": sound.layers(),
        "arrivals": arrival_table(s.nodes.arrival_rates, s.mission.step),
        "fixed_vortex": fixed_vortices(s),
        "strategy_arguments": strategy.numbers or [0.0],
        "rule_numbers": target_rules.parse(s.nodes.target_rule)[1] or [0.0],
        "task_parameters": [s.task_numbers[name] for name, _ in task.parameters] or [0.0],
        "otter": otter_table(site) if s.boat.model == "otter" else [0.0],
        "reward_weights": weights,
        "bed": site.bed,
    }
    return {
        **{name: np.ascontiguousarray(table, np.float32) for name, table in numbers.items()},
        "flag": flags(s),
        "observation_first": np.array([place.start for _, place in ObservationLayout.of(s)], np.int32),
    }


def otter_table(site: Site) -> np.ndarray:
    """Numbers of the boats of a site with dynamics, `usvauv.kernels.vehicles.otter_numbers.Number`.

    Raises:
        ScenarioError: in its wind they move too fast.
    """
    try:
        site.scenario.otter.check(wind(site))
    except ValueError as error:
        raise ScenarioError(str(error)) from None
    return otter_numbers.table_of(site.scenario.otter.model_dump(), wind(site))


def side_by_side(link: np.ndarray) -> np.ndarray:
    """The link table's columns of `LANES` AUVs after each other, (rows, COLUMNS, LANES), until they are
    the same again.
    """
    count = len(link)
    auv = np.arange(math.lcm(count, LANES)).reshape(-1, LANES) % count
    return link[auv].swapaxes(1, 2)


def rule_workspace(scenario: Scenario) -> int:
    """Length of the target rule's workspace in each world, ≥ 1."""
    rule, _ = target_rules.parse(scenario.nodes.target_rule)
    with target_rules.target_rules.calling(scenario.nodes.target_rule.partition(":")[0]):
        return max(1, rule.workspace(scenario.targets, scenario.auv.count))


def own_noise(scenario: Scenario, frequency: float) -> float:
    """The boat's own noise density at its array at top speed, dB re 1 µPa²/Hz; −∞ for none."""
    boat = scenario.boat
    if boat.noise_level == 0.0:
        return -math.inf
    return boat_noise(frequency, boat.top_speed, boat.noise_level, OWN_NOISE_FREQUENCY, boat.top_speed)


def link_table(site: Site) -> np.ndarray:
    """Acoustic constants of each AUV's positioning link, see `usvauv.kernels.positioning.acoustic_link`."""
    s = site.scenario
    names = {field.name for field in fields(Sonar)}
    given = {name: value for part in (s.acoustics, s.usbl) for name, value in part if name in names}
    computed = {
        "data_ratio": data_ratio(s, s.channel.reply_bits),
        "sound_speed": sound_speed(site),
        "ambient_noise": noise_law(s),
        "wind": wind(site),
        "absorption": partial(absorption, s),
        "planner_noise": s.planner.noise,
        "reference_range": s.auv.depth,
        "own_noise": partial(own_noise, s),
        "unlocated": s.area.diagonal / math.sqrt(24.0),  # uniform in the area, mean of both axes
        "accuracy": Accuracy(
            attitude=s.usbl.attitude_error,
            alignment=s.usbl.alignment_error,
            heading=s.usbl.heading_error,
            sound_speed=s.acoustics.sound_speed_error / s.acoustics.sound_speed,
            position=math.hypot(s.usbl.lever_arm_error, s.usbl.gnss_error),
        ),
    }
    return link_constants(carriers(s), Sonar(**given | computed))


def carriers(scenario: Scenario) -> list[float]:
    """Carrier of each AUV, Hz."""
    return [scenario.usbl.carrier(k, scenario.auv.count) for k in range(scenario.auv.count)]


def speed_response(scenario: Scenario) -> dict[str, float]:
    """Parameters of `usvauv.kernels.mission.auvs.motion.respond` for time constant and error of an AUV's velocity.

    The errors of the velocity at a step's end and of its mean over the step have the covariance of a Gauss–Markov
    process and its integral (Gelb, "Applied Optimal Estimation" (1974), §3.6).
    """
    step, lag, deviation = scenario.mission.step, scenario.auv.speed_lag, scenario.auv.speed_noise
    if not lag:
        return dict.fromkeys(SPEED_RESPONSE, 0.0)
    a, ratio = math.exp(-step / lag), step / lag
    end = deviation * math.sqrt(-math.expm1(-2 * ratio))
    shared = deviation * math.expm1(-ratio) ** 2 / math.sqrt(-math.expm1(-2 * ratio)) / ratio
    rest = math.sqrt(max(deviation**2 * (2 * ratio - 3 + 4 * a - a * a) / ratio**2 - shared**2, 0.0))
    return dict(zip(SPEED_RESPONSE, (a, -math.expm1(-ratio) / ratio, end, shared, rest), strict=True))


def pack_parameters(site: Site, link: np.ndarray) -> np.ndarray:
    """All numbers of a scenario in the order of `usvauv.kernels.mission.columns.Parameter`, float32.

    A parameter named like a field has that field's value; the others are computed here.

    Args:
        link: from `link_table`.
    """
    s = site.scenario
    current_variance, correlation_time = 0.0, FOREVER
    if s.navigation.sensor == "water":
        current_variance, correlation_time = current_model(site, link)
    elif s.navigation.sensor == "ground":  # the log's bias takes the current's place
        current_variance, correlation_time = s.navigation.velocity_bias**2, s.navigation.bias_correlation_time
    blowing, carried = (cmath.rect(share * wind(site), wind_direction(site)) for share in (1.0, s.boat.windage))
    way = math.sqrt(s.area.width * s.area.length / s.targets)  # on which an AUV goes on as before: from node to node
    if s.task_definition.targets == "moving":
        way = s.reference.circle_radius
    data, rate = DataLink.of(site), reference_rate(site)
    sections = s.mission, s.area, s.current, s.usbl, s.channel, s.navigation, s.boat, s.auv, s.nodes
    named = {name: value for section in sections for name, value in section if name in Parameter.names}
    numbers = named | {
        "length": s.area.length,  # not the boats'
        "diagonal": s.area.diagonal,
        "eddy_scale": site.eddies.pattern.scale,
        "eddy_share": site.eddies.pattern.share,
        "eddies_at_cruise": site.eddies.cruise,
        "mean_depth": site.mean_depth,
        "renewal": steps_of_renewal(s.mission.step),
        "sound_speed_error": s.acoustics.sound_speed_error / s.acoustics.sound_speed,
        "gnss_memory": math.exp(-s.mission.step / s.usbl.gnss_correlation_time),
        "gnss_time": s.usbl.gnss_correlation_time,
        "ping_interval": s.channel.interval,
        **message_parameters(s),
        "velocity_walk": s.navigation.velocity_noise**2,
        "bias_memory": math.exp(-s.mission.step / s.navigation.bias_correlation_time),
        "velocity_variance": 0.5 * s.reference.straight_speed**2,
        "velocity_memory": way / s.reference.straight_speed,
        "top_speed": top_speed(site),
        "response_time": response_time(s),
        "response_memory": math.exp(-s.mission.step / s.boat.response_time) if s.boat.response_time else 0.0,
        "control_time": control_time(s),
        "drift_memory": math.exp(-s.mission.step / DRIFT_TIME),
        "leeway_x": carried.real,
        "leeway_y": carried.imag,
        "wind_x": blowing.real,
        "wind_y": blowing.imag,
        "separation_boat": s.auv.depth,
        "sound_speed": sound_speed(site),
        "propagates": s.usbl.propagation,
        "current_variance": current_variance,
        "correlation_time": correlation_time,
        "current_change": -math.expm1(-s.mission.step / correlation_time),
        "auv_speed": s.auv.speed_max + 6 * s.auv.speed_noise + current_bound(site),
        **speed_response(s),
        "depth_memory": math.exp(-s.mission.step / DEPTH_TIME),
        "cruise": s.auv.depth,
        "hotel": s.auv.hotel,  # not the boat's
        "hover_radius": s.service_radius,
        "separation_node": s.auv.depth if s.auv.separation == "demonstration" else 0.0,
        "node_margin": s.nodes.margin,
        "formation_radius": s.stations.radius,
        "data_level": data.level,
        "data_absorption": data.absorption,
        "data_spreading": data.spreading,
        "data_bandwidth": s.nodes.bandwidth,
        "steps": s.mission.steps,
        "farthest": math.hypot(s.area.diagonal, s.auv.depth),
        "rate_mean": np.mean(s.nodes.arrival_rates),
        "rate_variance": np.var(s.nodes.arrival_rates),
        "reference_speed": s.reference.straight_speed,
        "reference_rate": rate,
        "service_time": SERVICE_FILL * s.nodes.payload / rate,
    }
    return np.array([float(numbers[name]) for name in Parameter.names], np.float32)


def flags(scenario: Scenario) -> np.ndarray:
    """The choices of a scenario in the order of `usvauv.kernels.mission.columns.Flag`, int32."""
    current, reward = scenario.current, scenario.reward
    chosen = {
        "alternate": current.alternate,
        "random_vortices": current.count > 0 and not current.centres,
        "progress": reward.distance_form == "progress",
        "service_hovering": reward.service_form == "hovering",
        "proximity_once": reward.proximity_form == "pair",
        "service_terminates": reward.service_terminates,
    }
    return np.array([chosen[name] for name in Flag.names], np.int32)


def vehicle_motion(scenario: Scenario) -> Motion:
    """The motion model of a scenario whose AUVs are vehicles with dynamics."""
    auv = scenario.auv
    return Motion.of(vehicles[auv.model], getattr(Action, auv.action.replace("-", "_")), auv.battery > 0)


def vehicle_substeps(scenario: Scenario) -> int:
    """Substeps of these vehicles in a mission step."""
    auv = scenario.auv
    with vehicles.calling(auv.model):
        longest = vehicles[auv.model].substep(vehicle_numbers(scenario), auv.variation)
    if not isinstance(longest, float | int | np.number) or not SHORTEST <= longest < math.inf:
        raise vehicles.refuse(auv.model, longest, f"a substep of at least {SHORTEST:g} s")
    return max(1, -int(-scenario.mission.step // longest))


def vehicle_numbers(scenario: Scenario) -> dict[str, float]:
    """The vehicle's numbers by name: the scenario's, or else the model's defaults."""
    given = dict(scenario.torpedo) if scenario.auv.model == "torpedo" else scenario.vehicle_parameters.numbers
    return {name: number.default for name, number in vehicles[scenario.auv.model].numbers.items()} | given


def vehicle_table(scenario: Scenario) -> np.ndarray:
    """The vehicle's numbers as its functions read them."""
    name = scenario.auv.model
    with vehicles.calling(name):
        return np.ascontiguousarray(vehicles[name].table_of(vehicle_numbers(scenario)), np.float32)


def fixed_vortices(scenario: Scenario) -> np.ndarray:
    """Vortices at given centres, (V, 4), of mean circulation and core radius; without any, one of zero circulation.

    Raises:
        UserError: a centre in degrees is invalid, or too far away.
    """
    current = scenario.current
    table = np.tile(np.array([0.0, 0.0, 0.0, 1.0], np.float32), (max(current.vortices, 1), 1))
    for row, centre in zip(table, current.centres, strict=False):
        circulation = 0.5 * (current.circulation_min + current.circulation_max)
        x, y = far_position("current.centres", centre, scenario) if isinstance(centre, str) else centre
        row[:] = (x, y, circulation, 0.5 * (current.core_radius_min + current.core_radius_max))
    return table


def first_vortices(scenario: Scenario, seed: int, arch: str = "auto") -> torch.Tensor:
    """The vortices of a seed's world 0 as its first episode begins, (1, V, 4) as in `usvauv.kernels.flow.vortex`.

    Raises:
        ScenarioError: the seed is out of range.
        RuntimeUnavailable: `arch` cannot be used here.
    """
    seeds = Seeds.of(seed, 1)
    device = runtime.start(arch).device
    site, drawn = Site(scenario), torch.zeros((1, scenario.current.vortices, 4), dtype=torch.float32, device=device)
    if drawn.numel():
        numbers = pack_parameters(site, link_table(site)), flags(scenario), fixed_vortices(scenario), seeds.keys()
        clock = torch.zeros((1, 2), dtype=torch.int32, device=device)
        draw_vortices(*(torch.from_numpy(table).to(device) for table in numbers), clock, drawn)
    return drawn
