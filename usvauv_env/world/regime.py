"""Whether what a scenario simulates can occur: resonance, waves, currents against vehicles, links, the boat's response.

The solvers are also right where no sea is, and a mission there teaches nothing. Each check has a value, the limit that
it is held against, and a verdict. Where a scenario names a convention of the paper's demonstration, as `paper-*` do,
that is said and not judged.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np

from usvauv.env.scenario import Scenario
from usvauv.env.sea.build import forced_gain, long_wave_rms
from usvauv.env.sea.storm import uneven_bed_warning, wave_systems
from usvauv.env.site.site import Site
from usvauv.env.world import tables
from usvauv.env.world.current_statistics import drift_speed
from usvauv.kernels.mission.tasks.data_collection import LEAST_RATE
from usvauv.kernels.positioning import acoustic_link
from usvauv.kernels.types import Level

Verdict = Literal["fine", "warning", "error", "convention"]

LARGEST_GAIN = 2.0  # of long waves between a forced edge and a wall
LARGEST_KH = 0.3  # of long waves; above, shallow water is not shallow
LARGEST_AMPLITUDE = 0.1  # of long waves over the depth, with linear equations
LARGEST_LONG_STEEPNESS = 0.01  # 2a/λ of long waves; ocean swell of that steepness has periods of 20 s
LARGEST_STEEPNESS = 0.06  # Hs/(g Tp²/2π) of a storm; DNV-RP-C205 has 0.067 for its shortest periods
LARGEST_EFFICIENCY = 2.0  # bit/s/Hz of a modem under water
MEDIAN, TAIL = 0.83, 2.15  # of a Rayleigh distribution's root mean square: its median, and its 99 % quantile


class Finding(NamedTuple):
    """One check of a scenario.

    Attributes:
        check: what is looked at.
        value: of the scenario, with its unit.
        limit: against which it is held.
        verdict: fine; warning: such a thing does not occur, or hardly; error: nothing can come of it; convention: the
            demonstration's, by name.
        field: of the scenario that decides it.
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
        UserError: a file of the scenario does not serve.
    """
    site = Site(scenario)
    found = [*_long_waves(site), *_storm(site), *_currents(site), *_boat(site), *_replies(site)]
    if scenario.task_definition.targets == "nodes":
        found += _data_link(site)
    return found


def _judge(bad: bool, verdict: Verdict = "warning") -> Verdict:
    return verdict if bad else "fine"


def _long_waves(site: Site) -> list[Finding]:
    scenario, sea, depth = site.scenario, site.scenario.sea, site.mean_depth
    bands, most = [], 1.0
    if sea.regular_amplitude > 0:
        bands.append(("sea.regular_period", sea.regular_amplitude, sea.regular_period, sea.regular_period))
    if (rms := long_wave_rms(site)) > 0:
        shortest, longest = sea.irregular_period_min, sea.irregular_period_max
        bands.append(("sea.irregular_period_min", math.sqrt(2) * rms, shortest, longest))
    speed = math.sqrt(sea.gravity * depth)
    found = []
    for field, amplitude, shortest, longest in bands:
        length = speed * shortest
        kh, steepness = 2 * math.pi * depth / length, 2 * amplitude / length
        period, gain = forced_gain(scenario, shortest, longest, depth)
        most = max(most, gain)
        found += [
            Finding(
                "long waves grow towards the wall",
                f"{gain:.3g}-fold at a period of {period:.4g} s",
                f"at most {LARGEST_GAIN:g}, or sea.forcing = incident and an edge that radiates",
                _judge(gain > LARGEST_GAIN),
                field,
            ),
            Finding(
                "kh of the shortest long wave",
                f"{kh:.2g}",
                f"at most {LARGEST_KH:g} in shallow water",
                _judge(kh > LARGEST_KH),
                field,
            ),
            Finding(
                "steepness 2a/λ of the shortest long wave",
                f"{steepness:.2g}",
                f"at most {LARGEST_LONG_STEEPNESS:g}",
                _judge(steepness > LARGEST_LONG_STEEPNESS),
                field,
            ),
        ]
    if bands and sea.equations == "linear":
        share = most * scenario.highest_long_wave / depth
        found.append(
            Finding(
                "height of the long waves over the depth",
                f"{share:.2g}",
                f"at most {LARGEST_AMPLITUDE:g} with linear equations",
                _judge(share > LARGEST_AMPLITUDE),
                "sea.equations",
            )
        )
    return found


def _storm(site: Site) -> list[Finding]:
    uneven = uneven_bed_warning(site)
    found = [Finding("its waves are", uneven, "", "warning", "storm")] if uneven else []
    for system in wave_systems(site):
        steepness = 2 * math.pi * system.significant_height / (site.scenario.sea.gravity * system.peak_period**2)
        found.append(
            Finding(
                "steepness Hs/(g Tp²/2π)",
                f"{steepness:.2g}",
                f"at most {LARGEST_STEEPNESS:g}",
                _judge(steepness > LARGEST_STEEPNESS),
                "storm.peak_period",
            )
        )
    return found


def _currents(site: Site) -> list[Finding]:
    scenario, found = site.scenario, []
    for field, top, level, where in (
        ("auv.speed_max", scenario.auv.speed_max, Level.cruise, "at the AUVs' depth"),
        ("boat.top_speed", scenario.boat.top_speed, Level.surface, "at the surface"),
    ):
        rms = drift_speed(site, level)
        median, tail = MEDIAN * rms, TAIL * rms
        if rms > 0:
            found.append(
                Finding(
                    f"current {where}, median and 99 %:",
                    f"{median:.2g} and {tail:.2g} m/s",
                    f"below the top speed, {top:g} m/s",
                    "error" if median >= top else _judge(tail >= top),
                    field,
                )
            )
    return found


def _boat(site: Site) -> list[Finding]:
    boat = site.scenario.boat
    if not wave_systems(site):
        return []
    return [
        Finding(
            "the boat's speed follows its command in",
            f"{boat.response_time:g} s",
            "above 0 in a storm, or it holds its place against every wave",
            _judge(boat.response_time == 0),
            "boat.response_time",
        )
    ]


def _replies(site: Site) -> list[Finding]:
    scenario = site.scenario
    links = tables.link_table(site).astype(float)
    link = links[links[:, acoustic_link.RATIO_AT_1M].argmin()]
    distance = np.geomspace(1.0, 1e5, 2000)
    loss = link[acoustic_link.SPREADING] * np.log10(distance) + link[acoustic_link.ABSORPTION] * distance / 1e3
    ratio = link[acoustic_link.RATIO_AT_1M] - link[acoustic_link.PATHS] * (loss + link[acoustic_link.BUBBLES])
    least = 10 * math.log10(max(link[acoustic_link.THRESHOLD] / 8 - 1, 1e-9))
    heard = distance[ratio >= least]
    reach = float(heard[-1]) if len(heard) else 0.0
    if scenario.acoustics.noise_law == "demonstration":
        verdict: Verdict = "convention"
    else:
        verdict = _judge(reach < scenario.auv.depth, "error")
    return [
        Finding(
            "replies can be decoded up to",
            f"{reach:.3g} m",
            f"the AUVs' depth, {scenario.auv.depth:g} m, at least",
            verdict,
            "acoustics.source_level",
        )
    ]


def _data_link(site: Site) -> list[Finding]:
    nodes, rate = site.scenario.nodes, tables.reference_rate(site)
    efficiency = 1e6 * rate / nodes.bandwidth
    judged = nodes.rate_law not in ("demonstration", "optical")
    verdict: Verdict = "convention" if nodes.rate_law == "demonstration" else "fine"
    if rate <= LEAST_RATE:
        verdict = "error"
    elif judged:
        verdict = _judge(efficiency > LARGEST_EFFICIENCY)
    return [
        Finding(
            "the data link carries",
            f"{1e3 * rate:.3g} kbit/s, {efficiency:.2g} bit/s/Hz" if rate > LEAST_RATE else "nothing",
            f"at most {LARGEST_EFFICIENCY:g} bit/s/Hz with sound",
            verdict,
            "nodes.rate_law",
        )
    ]
