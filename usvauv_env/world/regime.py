"""Whether a scenario's conditions can occur: resonance, waves, currents against vehicles, links and the channel, the
boat's response, depth and endurance of AUVs, numbers that differ from those of a class.

The solvers also give correct results for conditions that no sea has, from which nothing can be learned. Each check has
a value, a limit and a verdict. Conventions of the paper's demonstration that a scenario names, as `paper-*` do, are
stated and not judged.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Literal, NamedTuple

import numpy as np

from usvauv.env.scenario.fields import CLASSES, as_toml, classes_of
from usvauv.env.scenario.scenario import Scenario
from usvauv.env.sea.long_waves import forced_gain, long_wave_rms
from usvauv.env.sea.storm import total_height, uneven_bed_warning, wave_systems
from usvauv.env.site.site import Site
from usvauv.env.world import boat_speed, mission_parameters
from usvauv.env.world.current_statistics import drift_speeds
from usvauv.env.world.message_parameters import least_energy, message_parameters
from usvauv.kernels.mission.auvs.motion import travelling_power
from usvauv.kernels.mission.choices import schedules
from usvauv.kernels.mission.tasks.data_collection import LEAST_RATE
from usvauv.kernels.positioning import acoustic_link
from usvauv.kernels.positioning.sonar import path_loss
from usvauv.kernels.types import Level

Verdict = Literal["fine", "warning", "error", "convention"]

LARGEST_GAIN = 2.0  # of long waves between a forced edge and a wall
LARGEST_KH = 0.3  # of long waves; above, shallow water is not shallow
LARGEST_AMPLITUDE = 0.1  # of long waves over the depth, with linear equations
LARGEST_LONG_STEEPNESS = 0.01  # 2a/λ of long waves; ocean swell of that steepness has periods of 20 s
LARGEST_STEEPNESS = 0.06  # Hs/(g Tp²/2π) of a storm; DNV-RP-C205 has 0.067 for its shortest periods
LARGEST_EFFICIENCY = 2.0  # bit/s/Hz of a modem under water
LONGEST_WAIT = 30.0  # s, for the next fix of an AUV
DEVIATIONS = 3.0  # of the error of depth, which hardly any is beyond


class Finding(NamedTuple):
    """One check of a scenario.

    Attributes:
        check: the quantity checked.
        value: its value in the scenario, with its unit.
        limit: the limit of the value.
        verdict: fine; warning: such conditions do not occur, or hardly; error: the mission cannot succeed; convention:
            a named one of the demonstration.
        field: the scenario's field that decides it.
    """

    check: str
    value: str
    limit: str
    verdict: Verdict
    field: str

    def __str__(self) -> str:
        return f"{self.field}: {self.check} {self.value}" + (f"; {self.limit}" if self.limit else "")


def check(scenario: Scenario) -> list[Finding]:
    """All checks of a scenario.

    Raises:
        UserError: a file of the scenario cannot be used.
    """
    site = Site(scenario)
    found = [*_long_waves(site), *_short_waves(site), *_boat(site), *_currents(site), _replies(site)]
    found += [*_channel(site), *_messages(scenario), *_depth(site), *_endurance(scenario), *_classes(scenario)]
    return [*found, _data_link(site)] if scenario.task_definition.targets == "nodes" else found


def _judge(bad: bool, verdict: Verdict = "warning") -> Verdict:
    return verdict if bad else "fine"


def _at_most(limit: float, check: str, value: float, field: str, where: str = "") -> Finding:
    return Finding(check, f"{value:.2g}", f"at most {limit:g}{where}", _judge(value > limit), field)


def _long_waves(site: Site) -> Iterator[Finding]:
    scenario, sea, depth = site.scenario, site.scenario.sea, site.mean_depth
    bands, most = [], 1.0
    if sea.regular_amplitude > 0:
        bands.append(("sea.regular_period", sea.regular_amplitude, sea.regular_period, sea.regular_period))
    if (rms := long_wave_rms(site)) > 0:
        shortest, longest = sea.irregular_period_min, sea.irregular_period_max
        bands.append(("sea.irregular_period_min", math.sqrt(2) * rms, shortest, longest))
    for field, amplitude, shortest, longest in bands:
        length = math.sqrt(sea.gravity * depth) * shortest
        period, gain = forced_gain(scenario, shortest, longest, depth)
        most = max(most, gain)
        value, remedy = (
            f"by a factor of {gain:.3g} at a period of {period:.4g} s",
            "sea.forcing = incident and an edge that radiates",
        )
        limit = f"at most {LARGEST_GAIN:g}, or {remedy}"
        yield Finding("long waves grow towards the wall", value, limit, _judge(gain > LARGEST_GAIN), field)
        kh = 2 * math.pi * depth / length
        yield _at_most(LARGEST_KH, "kh of the shortest long wave", kh, field, " in shallow water")
        yield _at_most(
            LARGEST_LONG_STEEPNESS, "steepness 2a/λ of the shortest long wave", 2 * amplitude / length, field
        )
    if bands and sea.equations == "linear":
        share, where = most * scenario.highest_long_wave / depth, " with linear equations"
        yield _at_most(LARGEST_AMPLITUDE, "height of the long waves over the depth", share, "sea.equations", where)


def _short_waves(site: Site) -> Iterator[Finding]:
    gravity, lag = site.scenario.sea.gravity, site.scenario.boat.response_time
    if uneven := uneven_bed_warning(site):
        yield Finding("its waves are", uneven, "", "warning", "storm")
    systems = wave_systems(site)
    for system in systems:
        steepness = 2 * math.pi * system.significant_height / (gravity * system.peak_period**2)
        yield _at_most(LARGEST_STEEPNESS, "steepness Hs/(g Tp²/2π)", steepness, "storm.peak_period")
    if systems:
        limit = "must be above 0 in a storm, or it keeps its position against every wave"
        check = "the boat's speed follows its command in"
        yield Finding(check, f"{lag:g} s", limit, _judge(lag == 0), "boat.response_time")
    if systems and site.scenario.boat.thrust:
        speeds = boat_speed.top_speed(site), boat_speed.calm_top_speed(site.scenario)
        check, value = "the boat's top speed against these waves is", "{:.3g} m/s, in calm water {:.3g}".format(*speeds)
        yield Finding(check, value, "", "fine", "boat.thrust")


def _boat(site: Site) -> Iterator[Finding]:
    boat, array = site.scenario.boat, site.scenario.usbl.array_depth
    height, wind = total_height(wave_systems(site)), mission_parameters.wind(site)
    if boat.wave_limit:
        limit = f"the boat works in at most {boat.wave_limit:g} m"
        yield Finding(
            "significant height", f"{height:.2g} m", limit, _judge(height > boat.wave_limit), "boat.wave_limit"
        )
    if boat.wind_limit:
        limit = f"the boat works in at most {boat.wind_limit:g} m/s"
        yield Finding("wind", f"{wind:.2g} m/s", limit, _judge(wind > boat.wind_limit), "boat.wind_limit")
    if boat.draught:
        limit = f"must be more than the boat's draught, {boat.draught:g} m"
        yield Finding("the array's depth is", f"{array:g} m", limit, _judge(array <= boat.draught), "usbl.array_depth")


def _currents(site: Site) -> Iterator[Finding]:
    scenario = site.scenario
    for field, top, level, where in (
        ("auv.speed_max", scenario.auv.speed_max, Level.cruise, "at the AUVs' depth"),
        ("boat.top_speed", boat_speed.top_speed(site), Level.surface, "at the surface"),
    ):
        median, tail = drift_speeds(site, level, (0.5, 0.99))
        verdict = "error" if median >= top else _judge(tail >= top)
        if tail > 0:
            check, value = f"current {where}, median and 99 %:", f"{median:.2g} and {tail:.2g} m/s"
            yield Finding(check, value, f"below the top speed, {top:.3g} m/s", verdict, field)


def _depth(site: Site) -> Iterator[Finding]:
    """The deepest that AUVs come, with their errors of depth, and with vehicles' motion in the highest waves."""
    scenario, auv = site.scenario, site.scenario.auv
    cruise = auv.depth_max if auv.action == "vector-depth" else auv.depth
    if auv.altitude > 0:
        cruise = float(site.bed.max()) - auv.altitude
    waves = 0.0
    for system in wave_systems(site) if auv.dynamic else ():
        wave_number = (2 * math.pi / system.peak_period) ** 2 / scenario.sea.gravity
        waves += system.significant_height * math.exp(-wave_number * cruise)  # of a wave twice as high
    deepest = cruise + DEVIATIONS * auv.depth_noise + waves
    if auv.depth_rating > 0:
        limit = f"must not exceed the rated depth, {auv.depth_rating:g} m"
        verdict = _judge(deepest > auv.depth_rating)
        yield Finding("AUVs come as deep as", f"{deepest:.4g} m", limit, verdict, "auv.depth_rating")


def _endurance(scenario: Scenario) -> Iterator[Finding]:
    """How long a battery that ends lasts at the highest speed and the reference's, by the power of a point.

    A vehicle with dynamics without `auv.drag` has no such law.
    """
    auv, reference = scenario.auv, scenario.reference.straight_speed
    if auv.battery > 0 and (auv.drag > 0 or not auv.dynamic):
        fast, usual = (auv.battery / travelling_power(auv, speed) for speed in (auv.speed_max, reference))
        value = f"{fast:.3g} h at {auv.speed_max:g} m/s and {usual:.3g} h at {reference:g} m/s"
        hours = scenario.mission.duration / 3600
        limit = f"must last for the mission, {hours:.3g} h"
        yield Finding("a battery lasts for", value, limit, _judge(min(fast, usual) < hours), "auv.battery")


def _classes(scenario: Scenario) -> Iterator[Finding]:
    """Numbers that a scenario gives in place of those of the class of boats or AUVs that it names."""
    given = scenario.to_dict()
    for section, field in CLASSES.items():
        name = given[section][field]
        own = [
            f"{part}.{number} = {as_toml(given[part][number])}, not {as_toml(value)}"
            for part, values in classes_of(section).get(name, {}).items()
            for number, value in values.items()
            if given[part][number] != value
        ]
        if own:
            check = f"the scenario gives other numbers than {name}:"
            yield Finding(check, "; ".join(own), "", "warning", f"{section}.{field}")


def _replies(site: Site) -> Finding:
    distance, depth, reaches = np.geomspace(1.0, 1e5, 2000), site.scenario.auv.depth, []
    for link in mission_parameters.link_table(site).astype(float):
        loss = link[acoustic_link.SPREADING] * np.log10(distance) + link[acoustic_link.ABSORPTION] * distance / 1e3
        ratio = link[acoustic_link.RATIO_AT_1M] - link[acoustic_link.PATHS] * (loss + link[acoustic_link.BUBBLES])
        least = 10 * math.log10(max(link[acoustic_link.THRESHOLD] / 8 - 1, 1e-9))
        reaches.append(float(distance[ratio >= least].max(initial=0.0)))
    reach = min(reaches)
    agreed = site.scenario.acoustics.noise_law == "demonstration"
    verdict = "convention" if agreed else _judge(reach < depth, "error" if max(reaches) < depth else "warning")
    limit = f"must be at least the AUVs' depth, {depth:g} m"
    return Finding("replies can be decoded up to", f"{reach:.3g} m", limit, verdict, "acoustics.source_level")


def _channel(site: Site) -> Iterator[Finding]:
    """What a reply takes, how often an AUV is located, and whether replies at once can be told apart."""
    scenario, channel, count = site.scenario, site.scenario.channel, site.scenario.auv.count
    if channel.schedule == "every-step":
        return
    p, sound_speed = message_parameters(scenario), mission_parameters.sound_speed(site)
    nearest, farthest = scenario.auv.depth, math.hypot(scenario.area.diagonal, scenario.auv.depth)
    if channel.priced:
        check = f"a reply of {channel.reply_bits} bit lasts {1e3 * p['reply_length']:.3g} ms and needs an E/N0 of"
        ratio = 10 * math.log10(least_energy(scenario, channel.reply_bits))
        yield Finding(check, f"{ratio:.3g} dB", "", "fine", "channel.bit_rate")

    addressed, exchanges = (1, count) if channel.schedule in schedules else (count, 1)
    lasts = p["request_pulse"] + addressed * p["request_data"] + channel.turn_around + 2 * farthest / sound_speed
    lasts += p["reply_length"] * (count if channel.schedule == "slots" else 1)
    wait = max(exchanges * max(lasts, channel.interval), scenario.mission.step)
    field = "channel.interval" if channel.interval > lasts else "channel.schedule"
    check = f"an exchange lasts up to {lasts:.3g} s, and an AUV in range has a fix every"
    yield Finding(check, f"{wait:.3g} s", f"at most {LONGEST_WAIT:g} s", _judge(wait > LONGEST_WAIT), field)

    if channel.schedule == "all" and channel.priced and count > 1:
        overlapping = min(farthest, nearest + 0.5 * sound_speed * p["reply_length"])
        absorption = mission_parameters.absorption(scenario, max(mission_parameters.carriers(scenario)))
        near, far = (path_loss(S, scenario.acoustics.spreading, absorption) for S in (nearest, overlapping))
        weakest = near - far - 10 * math.log10(count - 1)
        needed = 10 * math.log10(least_energy(scenario, channel.reply_bits) * p["crosstalk"])
        check = f"replies overlap, and against {count - 1} from {nearest:g} m away one from {overlapping:.4g} m has"
        limit = f"must be at least {needed:.2g} dB; slots and turns keep replies apart"
        yield Finding(check, f"{weakest:.2g} dB", limit, _judge(weakest < needed), "channel.schedule")


def _messages(scenario: Scenario) -> Iterator[Finding]:
    """The share of the channel that messages of what AUVs and boats measured take."""
    numbers = scenario.task_numbers
    if numbers.get("message_time", 0.0) > 0.0 and scenario.channel.schedule != "every-step":
        senders = scenario.auv.count + (scenario.boat.count if numbers.get("boat_listens", 0.0) > 0.0 else 0)
        share = senders * numbers["message_time"] / numbers["interval"]
        check, limit = "messages of ranges take of the channel", "below 1, or the boat locates nobody"
        yield Finding(check, f"{share:.3g}", limit, _judge(share >= 1.0, "error"), "task_parameters.message_time")


def _data_link(site: Site) -> Finding:
    nodes, rate = site.scenario.nodes, mission_parameters.reference_rate(site)
    efficiency, value = 1e6 * rate / nodes.bandwidth, "nothing"
    verdict: Verdict = "error"
    if rate > LEAST_RATE:
        value = f"{1e3 * rate:.3g} kbit/s, {efficiency:.2g} bit/s/Hz"
        verdict = _judge(efficiency > LARGEST_EFFICIENCY and nodes.rate_law != "optical")
        verdict = "convention" if nodes.rate_law == "demonstration" else verdict
    limit = f"at most {LARGEST_EFFICIENCY:g} bit/s/Hz with sound"
    return Finding("the data link carries", value, limit, verdict, "nodes.rate_law")
