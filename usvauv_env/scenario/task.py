"""Sections of a scenario about the task: nodes, stations, what AUVs observe and are rewarded for, heuristics."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import ConfigDict, Field, field_validator, model_validator

from usvauv.env.scenario.fields import LARGEST, Bandwidth, Carrier, Distance, Number, Price, Section, one_of
from usvauv.kernels.mission import target_rules
from usvauv.kernels.positioning.data_rate import rate_laws

MAX_NODES = 500
CLEAREST = 0.05  # 1/m, beam attenuation of the clearest ocean water in blue light
MOST_PACKETS = 1e7  # single precision counts one by one up to 1.6e7


class Nodes(Section):
    count: int = Field(30, ge=1, le=MAX_NODES, description="number of sensor nodes on the bed")
    margin: Distance = Field(10.0, description="least distance from the border, m")
    arrival_rates: tuple[Annotated[float, Field(ge=0, le=8000)], ...] = Field(
        (3.0, 5.0, 8.0, 12.0), min_length=1, max_length=16, description="a node's λ is drawn from these, packets/s"
    )
    buffer: float = Field(5000.0, ge=1, le=MOST_PACKETS, multiple_of=1, description="buffer capacity C, whole packets")
    start_backlog: float = Field(
        1000.0,
        ge=0,
        le=MOST_PACKETS,
        multiple_of=1,
        description="backlog at the start is uniform from 0 to this, whole packets",
    )
    service: Literal["hover", "passing"] = Field(
        "hover",
        description="data flow while an AUV hovers over its node, or whatever it does within service_range (passing)",
    )
    service_range: float = Field(
        40.0, ge=1, le=20000, description="slant range up to which a node is served in passing, m"
    )
    hovering_time: Literal["steps", "exact"] = Field(
        "steps",
        description="hovering time that EC leaves out: in whole steps, or the exact length of the services (the"
        " demonstration's)",
    )
    payload: float = Field(2.0, ge=1e-6, le=LARGEST, description="data in a full buffer, Mbit")
    target_rule: str = Field(
        "tour",
        description="next node of an AUV: greedy:ALPHA (λ b/C − α d), nearest, rate:SECONDS (data per time),"
        " rollout:HORIZON, tour, sectors, demonstration:ALPHA, learned:FILE, or a plugin's rule",
    )
    information: Literal["full", "rates", "visits", "own-visits"] = Field(
        "full",
        description="what the rule has: backlogs and rates, rates only, what all AUVs' visits have found, or only the"
        " own ones (no communication)",
    )
    source_power: float = Field(0.03, ge=1e-6, le=1e5, description="acoustic source power, W")
    frequency: Carrier = Field(150000.0, description="carrier of the data link, Hz")
    bandwidth: Bandwidth = Field(60000.0, description="bandwidth of the data link, Hz")
    rate_law: Annotated[str, one_of(rate_laws)] = Field(
        "modem",
        description="rate of the data link by its SNR: shannon (B log2(1 + 10^(SNR/10)), a bound), modem (steps of"
        " modulations and codes, up to rate_max), optical (rate_max as far as light reaches), demonstration"
        " (B log2(1 + 10^SNR) with SNR in dB), or a plugin's law",
    )
    rate_max: float = Field(62500.0, ge=1, le=1e8, description="highest rate of the modem or of the light, bit/s")
    optical_range: float = Field(
        150.0, ge=1, le=1000, description=f"range of the light in the clearest water, of {CLEAREST:g}/m, m"
    )
    attenuation: float = Field(CLEAREST, ge=0.01, le=100, description="beam attenuation of the water for light, 1/m")

    @field_validator("target_rule")
    @classmethod
    def _known_rule(cls, text: str) -> str:
        target_rules.parse(text)
        return text

    @model_validator(mode="after")
    def _check(self) -> Nodes:
        if self.start_backlog > self.buffer:
            raise ValueError("start_backlog must not be above buffer")
        return self


class Stations(Section):
    """The formation of the task "station-keeping"."""

    radius: Distance = Field(40.0, description="radius of the circle on which the stations lie, one an AUV, m")


class PluginNumbers(Section):
    """Numbers of a plugin's task or vehicle by name; what is not given has its default."""

    model_config = ConfigDict(frozen=True, extra="allow")
    __pydantic_extra__: dict[str, Number] = Field(init=False)

    @property
    def numbers(self) -> dict[str, float]:
        """The numbers given."""
        return self.__pydantic_extra__


class Observation(Section):
    current: Literal["none", "speed", "vector", "profile"] = Field(
        "speed",
        description="the perceived current: not at all, its speed (Eq. 4), speed and both components, or these and "
        "what a current profiler measures 25 and 50 m away",
    )
    extra: tuple[str, ...] = Field((), description="further terms of the observation, a plugin's")


class Reward(Section):
    """Weights of the named reward terms, each multiplied with a quantity that is positive when present."""

    distance_form: Literal["progress", "distance"] = Field(
        "progress", description="metres closed on the same target, or minus the distance to it (the paper's form)"
    )
    service_form: Literal["completion", "hovering"] = Field(
        "completion",
        description="when the service term is paid: once at completion, or in every step from arrival to completion"
        " (hovering; the demonstration's)",
    )
    proximity_form: Literal["each", "pair"] = Field(
        "each",
        description="who pays the proximity term: each AUV of a pair, or the one of the lower index only (pair; the"
        " demonstration's)",
    )
    distance: Number = Field(0.6, description="weight of the distance term, 1/m")
    border: Number = Field(-0.1, description="weight of a refused move across the border")
    overflow: Number = Field(0.0, description="weight of each overflowing node")
    proximity: Number = Field(-6.0, description="weight of each metre below the safe distance, 1/m")
    service: Number = Field(0.0, description="weight of a service")
    power: Number = Field(-0.01, description="weight of the power, 1/W")
    collaboration: Number = Field(0.1, description="weight of Eq. 5's l_max / l")
    data: Number = Field(60.0, description="weight of the data that an AUV brings in, 1/Mbit")
    lost: Number = Field(-60.0, description="weight of the data that full buffers lose, shared by the AUVs, 1/Mbit")
    service_terminates: bool = Field(False, description="a service ends the learner's value horizon (the paper's form)")


class Reference(Section):
    """Best speeds and prices of time of the heuristics, found once by `usvauv eval` and recorded here."""

    policy: str = Field("", description="default policy where it fits; empty: the task's heuristic")
    straight_speed: float = Field(1.2, ge=0.01, le=10, description="best constant speed of `straight`, m/s")
    crab_speed: float = Field(1.2, ge=0.01, le=10, description="best constant speed of `crab`, m/s")
    pace_price: Price = Field(0.0, description="best price of time of `pace`, W")
    clear_price: Price = Field(0.0, description="best price of time of `clear`, W")
    loiter_price: Price = Field(0.0, description="best price of time of `loiter`, W")
    pass_price: Price = Field(0.0, description="best price of time of `pass`, W")
    zermelo_speed: float = Field(1.2, ge=0.01, le=10, description="best constant speed of `zermelo`, m/s")
