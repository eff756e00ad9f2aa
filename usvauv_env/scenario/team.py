"""Sections of a scenario about the team and its task: boats and AUVs, their navigation and planning, and nodes,
observations, rewards.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import ConfigDict, Field, create_model, field_validator

from usvauv.env.scenario.fields import (
    LARGEST,
    Bandwidth,
    Carrier,
    Distance,
    Number,
    Price,
    Section,
    class_name,
    classes_of,
    one_of,
)
from usvauv.kernels.limits import FASTEST, MAX_AUVS, MAX_BOATS, MAX_NODES
from usvauv.kernels.mission.choices import rule_and_numbers
from usvauv.kernels.positioning.laws import rate_laws
from usvauv.kernels.vehicles import otter_numbers, stability
from usvauv.kernels.vehicles.definition import vehicles

CLEAREST = 0.05  # 1/m, beam attenuation of the clearest ocean water in blue light
MOST_PACKETS = 1e7  # single precision counts one by one up to 1.6e7


class Navigation(Section):
    """An AUV's dead reckoning between fixes, and how it receives fixes: its own filter."""

    sensor: Literal["none", "ground", "water"] = Field(
        "none",
        description="an AUV has its position from the boat; or by dead reckoning with its velocity over ground"
        " (Doppler log) or through the water, and receives its fixes by interrogations",
    )
    velocity_noise: float = Field(
        0.02, ge=0, le=10, description="standard deviation of that velocity's white error in one second, per axis, m/s"
    )
    velocity_bias: float = Field(
        0.03, ge=0, le=10, description="standard deviation of its bias, log and compass together, per axis, m/s"
    )
    bias_correlation_time: float = Field(300.0, ge=0.1, le=1e7, description="correlation time of the bias, s")
    homing_range: Distance = Field(
        0.0, description="horizontal distance within which an AUV detects its node and can head for it, m"
    )


class Boat(Section):
    count: int = Field(1, ge=1, le=MAX_BOATS, description="number of boats; each serves the AUVs nearest to it")
    noise_level: float = Field(
        0.0,
        ge=0,
        le=150,
        description="the boat's own noise at its array at top speed and 15 kHz, dB re 1 µPa²/Hz; 60 dB less a decade of"
        " speed, 20 dB a decade of frequency; 0: none",
    )
    model: Literal["point", "otter"] = Field(
        "point", description="a point that turns on the spot, or a catamaran with the parameters of [otter]"
    )
    vessel: Annotated[str, class_name("boat")] = Field(
        "none",
        description="class of boats whose numbers hold where a scenario gives none: "
        + ", ".join(["none", *classes_of("boat")]),
    )
    top_speed: float = Field(
        4.0, ge=1e-4, le=1e4, description="top speed through the water, m/s; an otter's is also limited by its thrust"
    )
    length: float = Field(
        0.0,
        ge=0,
        le=100,
        description="length of the hull, which follows waves shorter than a few of its lengths less and less, m; 0: it"
        " follows all from storm.shortest_wave on",
    )
    beam: float = Field(0.0, ge=0, le=30, description="its beam, of a catamaran over both hulls, m")
    draught: float = Field(0.0, ge=0, le=10, description="its draught, without a keel or gondola, m")
    thrust: float = Field(
        0.0,
        ge=0,
        le=1e6,
        description="thrust at top speed, with which it meets resistance that waves add, N; 0: waves do not slow it",
    )
    wave_limit: float = Field(
        0.0, ge=0, le=30, description="highest significant height in which it works, m; 0: not known"
    )
    wind_limit: float = Field(0.0, ge=0, le=100, description="strongest wind in which it works, m/s; 0: not known")
    drifts: bool = Field(True, description="the current carries the boat")
    response_time: float = Field(
        0.0,
        ge=0,
        le=600,
        description="time constant of a point's velocity through the water, s; 0: no lag",
    )
    windage: float = Field(
        0.0,
        ge=0,
        le=0.1,
        description="share of the wind's speed at which the wind drives a point; needs a response_time",
    )
    dead_band: Distance = Field(
        0.0,
        description="distance from its goal within which it only compensates drift, m; for a point needs a"
        " response_time",
    )
    propulsion_power: float = Field(
        0.0,
        ge=0,
        le=1e7,
        description="electrical power of its propulsion at top speed, W, less with the cube of the speed through the"
        " water; 0 and hotel = 0: the boat's energy is not counted",
    )
    hotel: float = Field(0.0, ge=0, le=1e6, description="electrical power of all else aboard, W")
    strategy: str = Field("fim", description="boat strategy, as in the option --usv")

    @property
    def metered(self) -> bool:
        """Whether its energy is counted."""
        return self.propulsion_power > 0 or self.hotel > 0

    def _problems(self) -> Iterator[str]:
        for name in ("windage", "dead_band"):
            if self.model == "point" and getattr(self, name) > 0 and self.response_time == 0:
                yield f"{name} = {getattr(self, name):g}: must be 0 where response_time is 0"
        for name in ("beam", "draught", "thrust"):
            if getattr(self, name) and not self.length:
                yield f"{name} = {getattr(self, name):g}: needs a length above 0"
        for name in ("beam", "draught"):
            if self.length and not getattr(self, name):
                yield f"length = {self.length:g}: needs a {name} above 0"


class Otter(Section):
    """Numbers of a boat with `boat.model = otter`, each with its source.

    MSS: Fossen and Perez, "Marine Systems Simulator", https://github.com/cybergalactic/MSS, its model of the Otter of
    Maritime Robotics, with the payload of its examples, 25 kg. Fossen (2021): doi 10.1002/9781119575016.
    """

    mass: float = Field(80.0, ge=20, le=500, description="mass, kg; MSS: hull 55, payload 25")
    length: float = Field(2.0, ge=0.5, le=10, description="length of a hull, m; MSS")
    draught: float = Field(0.195, ge=0.02, le=2, description="m; MSS, at that mass")
    centre: float = Field(
        0.153, ge=-1, le=1, description="centre of gravity ahead of midships, m; MSS: hull 0.2, payload 0.05"
    )
    inertia: float = Field(
        14.1, ge=1, le=5000, description="moment in yaw about the centre of gravity, kg m²; MSS: radius of gyration L/4"
    )
    added_surge: float = Field(5.3, ge=0, le=1000, description="added mass in surge, kg; MSS, after Söding")
    added_sway: float = Field(82.5, ge=0, le=5000, description="added mass in sway, kg; MSS: 1.5 of the hull's mass")
    added_yaw: float = Field(25.7, ge=0, le=5000, description="added moment in yaw, kg m²; MSS: 1.7 of the inertia")
    damping_surge: float = Field(
        77.6, ge=1, le=5000, description="linear damping in surge, N s/m; MSS: full thrust at 6 knots"
    )
    damping_sway: float = Field(
        162.5, ge=0, le=10000, description="linear damping in sway, N s/m; MSS: time constant 1 s"
    )
    damping_yaw: float = Field(41.7, ge=0, le=10000, description="linear in yaw, N m s; MSS: time constant 1 s")
    damping_turn: float = Field(417.0, ge=0, le=100000, description="quadratic in yaw, N m s²; MSS: 10 of the linear")
    cross_flow: float = Field(
        1.0, ge=0, le=3, description="drag coefficient of cross-flow, 1; MSS: Hoerner's curve at the pontoon's beam"
    )
    thrust_ahead: float = Field(
        0.01108,
        ge=1e-4,
        le=1,
        description="thrust of a propeller ahead over its revolutions squared, N s²; MSS, measured",
    )
    thrust_astern: float = Field(0.006445, ge=1e-4, le=1, description="the same astern, N s²; MSS, measured")
    most_ahead: float = Field(103.9, ge=1, le=1000, description="most revolutions ahead, rad/s; MSS: 12.2 kgf")
    most_astern: float = Field(101.7, ge=1, le=1000, description="most revolutions astern, rad/s; MSS: 6.8 kgf")
    lever: float = Field(0.395, ge=0.05, le=5, description="from the centre line to a propeller, m; MSS")
    propeller_lag: float = Field(0.1, ge=0.02, le=5, description="time constant of a propeller, s; MSS, its examples")
    frontal_area: float = Field(
        0.3, ge=0, le=20, description="area above the water seen from ahead, m²; estimated: a third of 1.08 × 0.87"
    )
    lateral_area: float = Field(0.6, ge=0, le=50, description="seen from abeam, m²; estimated: a third of 2 × 0.87")
    wind_surge: float = Field(0.7, ge=0, le=2, description="wind's coefficient c_x, 1; Fossen (2021): 0.5 to 0.9")
    wind_sway: float = Field(0.8, ge=0, le=2, description="c_y, 1; Fossen (2021): 0.7 to 0.95")
    wind_yaw: float = Field(0.1, ge=0, le=1, description="c_n, 1; Fossen (2021): 0.05 to 0.2")
    turn_rate: float = Field(
        0.26, ge=0.02, le=1, description="largest yaw rate commanded by its autopilot, rad/s; chosen"
    )
    heading_gain: float = Field(
        0.6, ge=0.05, le=3, description="commanded yaw rate over the heading error, 1/s; chosen"
    )
    rate_gain: float = Field(3.5, ge=0.1, le=5, description="gain of that rate's error over the inertia, 1/s; chosen")
    speed_gain: float = Field(1.0, ge=0.05, le=5, description="gain of the error of speed over the mass, 1/s; chosen")

    def check(self, wind: float) -> None:
        """Refuse a boat that moves too fast for any substep in winds up to some speed, m/s.

        Raises:
            ValueError: it does.
        """
        usual = {name: field.default for name, field in type(self).model_fields.items()}
        try:
            otter_numbers.check(self.model_dump(), usual, wind)
        except ValueError as error:
            raise ValueError(f"otter: {error}") from None


class Planner(Section):
    """Objective of the boat's plans by Fisher information (Eq. 2–3)."""

    measurement: Literal["phase", "fix"] = Field(
        "phase", description="information of Eq. 1's phases at known depth, or of the whole fix (phases and delay)"
    )
    noise: Literal["range", "constant"] = Field(
        "range", description="phase noise that grows with range by the sonar equation, or one constant"
    )
    objective: Literal["d", "a", "sum", "paper"] = Field(
        "d",
        description="information on all positions with all errors, by its determinant (d) or its inverse's trace"
        " (a); with noise and attitude only, determinant of the paper's sum (sum), or Eq. 3 as"
        " printed (paper)",
    )


class Auv(Section):
    count: int = Field(2, ge=1, le=MAX_AUVS, description="number of AUVs")
    model: Annotated[str, one_of(("point",), vehicles)] = Field(
        "point", description="point: takes any velocity at once, or with a lag; or a vehicle with dynamics, as torpedo"
    )
    vehicle: Annotated[str, class_name("auv")] = Field(
        "none",
        description="class of AUVs whose numbers hold where a scenario gives none: "
        + ", ".join(["none", *classes_of("auv")]),
    )
    variation: float = Field(
        0.0,
        ge=0,
        le=0.5,
        description="share by which mass, drag and fins of each vehicle may differ from the model's, each episode anew",
    )
    depth: float = Field(100.0, ge=0.5, le=11000, description="cruise depth, m")
    depth_rating: Distance = Field(
        0.0, description="depth for which the AUV is built, m, which `scenarios --check` looks at; 0: not known"
    )
    altitude: float = Field(
        0.0, ge=0, le=1000, description="height above the bed at which a vehicle cruises, m; 0: at auv.depth"
    )
    depth_min: Distance = Field(10.0, description="depth that the action vector-depth commands with -1, m")
    depth_max: Distance = Field(100.0, description="depth that it commands with 1, m")
    separation: Literal["geometry", "demonstration"] = Field(
        "geometry",
        description="vertical distances by geometry, or the demonstration's: auv.depth to the node, and to the boat"
        " auv.depth and the sea's elevation under it",
    )
    speed_min: float = Field(1.2, ge=0.01, le=FASTEST, description="lowest speed through the water, m/s")
    speed_max: float = Field(
        2.2, ge=0.01, le=FASTEST, description="highest speed through the water, m/s; the power law holds up to 2.5"
    )
    speed_lag: float = Field(
        0.0, ge=0, le=100, description="time constant with which a point's velocity follows the commanded one, s"
    )
    speed_noise: float = Field(
        0.0,
        ge=0,
        le=10,
        description="standard deviation of that velocity's error, per axis, m/s; its correlation time is speed_lag",
    )
    drag: float = Field(
        0.0,
        ge=0,
        le=1e5,
        description="drag of a point over its speed squared, N s²/m²: its power is hotel + drag V³/efficiency, hovering"
        " too; 0: the paper's law (Zhang et al. 2024), with at least 105 W in hovering",
    )
    efficiency: float = Field(
        0.5, ge=0.01, le=1, description="drag times speed over the electrical power of propulsion, with a drag"
    )
    hotel: float = Field(0.0, ge=0, le=5000, description="electrical power of all else, W, with a drag")
    battery: float = Field(
        0.0,
        ge=0,
        le=1e6,
        description="energy of an AUV's battery at the start, Wh; when it is spent the AUV drifts or glides to rest,"
        " serves no node and does not reply; 0: never ends",
    )
    depth_noise: float = Field(
        0.0,
        ge=0,
        le=100,
        description="standard deviation of the error with which a point keeps its depth, or a vehicle reads it, m",
    )
    action: Literal["vector", "vector-depth", "fins"] = Field(
        "vector",
        description="action as a velocity vector; for a vehicle also as a vector and the depth, or as (rudder, stern"
        " plane, propeller)",
    )
    start_margin: Distance = Field(10.0, description="least distance from the border at the start, m")
    start_separation: Distance = Field(20.0, description="least distance between AUVs at the start, m")
    safe_distance: Distance = Field(12.0, description="distance below which the reward punishes proximity, m")
    collision_distance: Distance = Field(5.0, description="distance below which a step counts as a collision, m")
    hover_radius: float = Field(
        6.0, ge=0.01, le=20000, description="horizontal distance at which an AUV starts to serve its node, m"
    )

    @property
    def dynamic(self) -> bool:
        """Whether AUVs are vehicles with dynamics."""
        return self.model != "point"

    @property
    def action_size(self) -> int:
        """Length of an AUV's action."""
        return 3 if self.action in ("vector-depth", "fins") else 2

    @property
    def shallowest(self) -> float:
        """Least intended depth of the AUVs, m."""
        return {"vector-depth": self.depth_min, "fins": 0.0}.get(self.action, self.depth)

    def _problems(self) -> Iterator[str]:
        if not self.dynamic:
            for name in ("altitude", "variation"):
                if getattr(self, name) > 0:
                    yield f"{name} = {getattr(self, name):g}: needs a model with dynamics, not point"
            if self.action_size != 2:
                yield f"action = {self.action!r}: needs a model with dynamics, not point"
        elif self.separation != "geometry":
            yield f"separation = {self.separation!r}: must be geometry with model = {self.model!r}"
        if self.depth_max <= self.depth_min:
            yield f"depth_max = {self.depth_max:g}: must be above depth_min, {self.depth_min:g} m"
        if self.speed_max < self.speed_min:
            yield f"speed_max = {self.speed_max:g}: must not be below speed_min, {self.speed_min:g} m/s"
        if self.hotel and not self.drag:
            yield f"hotel = {self.hotel:g}: needs a drag above 0"
        if self.speed_noise and not self.speed_lag:
            yield f"speed_noise = {self.speed_noise:g}: needs a speed_lag above 0"


_numbers: Any = {
    name: (float, Field(number.default, ge=number.low, le=number.high, description=number.meaning))
    for name, number in stability.ALL_NUMBERS.items()
}
if TYPE_CHECKING:
    Torpedo = Section
else:
    Torpedo = create_model("Torpedo", __base__=Section, __doc__="Numbers of `auv.model = torpedo`.", **_numbers)


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
        description="data flow while an AUV hovers over its node, or always within service_range (passing)",
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
        " rollout:HORIZON, tour, sectors, demonstration:ALPHA, or a plugin's rule",
    )
    information: Literal["full", "rates", "visits", "own-visits"] = Field(
        "full",
        description="information of the rule: backlogs and rates, rates only, findings of all AUVs' visits, or"
        " only of its own visits (no communication)",
    )
    source_power: float = Field(0.03, ge=1e-6, le=1e5, description="acoustic source power, W")
    frequency: Carrier = Field(150000.0, description="carrier of the data link, Hz")
    bandwidth: Bandwidth = Field(60000.0, description="bandwidth of the data link, Hz")
    rate_law: Annotated[str, one_of(rate_laws)] = Field(
        "modem",
        description="rate of the data link by its SNR: shannon (B log2(1 + 10^(SNR/10)), a bound), modem (steps of"
        " modulations and codes, up to rate_max), optical (rate_max within the light's range), demonstration"
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
        rule_and_numbers(text)
        return text

    def _problems(self) -> Iterator[str]:
        if self.start_backlog > self.buffer:
            yield f"start_backlog = {self.start_backlog:g}: must not be above buffer, {self.buffer:g}"


class Stations(Section):
    """The formation of the task "station-keeping"."""

    radius: Distance = Field(40.0, description="radius of the circle on which the stations lie, one an AUV, m")


class PluginNumbers(Section):
    """Numbers of a plugin's task or vehicle by name; a number not given has its default."""

    model_config = ConfigDict(frozen=True, extra="allow")
    __pydantic_extra__: dict[str, Number] = Field(init=False)

    @property
    def numbers(self) -> dict[str, float]:
        """The numbers given."""
        return self.__pydantic_extra__


class Observation(Section):
    current: Literal["none", "speed", "vector", "profile"] = Field(
        "speed",
        description="the observed current: none, its speed (Eq. 4), speed and both components, or these and the"
        " readings of a current profiler 25 and 50 m away",
    )
    extra: tuple[str, ...] = Field((), description="further terms of the observation, a plugin's")


class Reward(Section):
    """Weights of the named reward terms, each multiplied by a quantity that is positive when present."""

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
    data: Number = Field(60.0, description="weight of the data that an AUV collects, 1/Mbit")
    lost: Number = Field(-60.0, description="weight of the data lost by full buffers, shared by the AUVs, 1/Mbit")
    service_terminates: bool = Field(False, description="a service ends the learner's value horizon (the paper's form)")


class Reference(Section):
    """Best speeds and prices of time for the heuristics, found once with `usvauv eval` and recorded here."""

    policy: str = Field("", description="default policy, if applicable; empty: the task's heuristic")
    straight_speed: float = Field(1.2, ge=0.01, le=10, description="best constant speed of `straight`, m/s")
    crab_speed: float = Field(1.2, ge=0.01, le=10, description="best constant speed of `crab`, m/s")
    pace_price: Price = Field(0.0, description="best price of time of `pace`, W")
    clear_price: Price = Field(0.0, description="best price of time of `clear`, W")
    loiter_price: Price = Field(0.0, description="best price of time of `loiter`, W")
    pass_price: Price = Field(0.0, description="best price of time of `pass`, W")
    circle_radius: Distance = Field(60.0, description="best radius of `circle` round a moving target, m")
