"""Sections of a scenario about boats and AUVs: how they move, what they reckon with, what boats plan by."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field, create_model, model_validator

from usvauv.env.scenario.fields import Distance, Section, one_of
from usvauv.kernels.mission.motion import FASTEST
from usvauv.kernels.planning.information import MAX_AUVS
from usvauv.kernels.vehicles.torpedo import TORPEDO
from usvauv.kernels.vehicles.vehicle import vehicles


class Navigation(Section):
    """What an AUV reckons with between fixes, and what it learns of them: a filter of its own."""

    sensor: Literal["none", "ground", "water"] = Field(
        "none",
        description="an AUV has its position from the boat; or it reckons with its velocity over ground (Doppler log)"
        " or through the water, and receives its fixes by interrogations",
    )
    velocity_noise: float = Field(
        0.02, ge=0, le=10, description="standard deviation of that velocity's white error in one second, per axis, m/s"
    )
    velocity_bias: float = Field(
        0.03, ge=0, le=10, description="standard deviation of its bias, log and compass together, per axis, m/s"
    )
    bias_correlation_time: float = Field(300.0, ge=0.1, le=1e7, description="time in which the bias changes, s")
    homing_range: Distance = Field(
        0.0, description="horizontal distance within which an AUV hears its node and can head for it, m"
    )


class Boat(Section):
    count: int = Field(1, ge=1, le=4, description="number of boats; each serves the AUVs nearest to it")
    noise_level: float = Field(
        0.0,
        ge=0,
        le=150,
        description="the boat's own noise at its array at top speed and 15 kHz, dB re 1 µPa²/Hz; 60 dB less a decade of"
        " speed, 20 dB a decade of frequency; 0: none",
    )
    model: Literal["point", "otter"] = Field(
        "point", description="it turns on the spot, or is a catamaran with the numbers of [otter]"
    )
    top_speed: float = Field(
        4.0, ge=1e-4, le=1e4, description="top speed through the water, m/s; of an otter also what its thrust gives"
    )
    drifts: bool = Field(True, description="the current carries the boat")
    response_time: float = Field(
        0.0,
        ge=0,
        le=600,
        description="time in which a point's velocity through the water follows, s; 0: it is where it wants to at once",
    )
    windage: float = Field(
        0.0,
        ge=0,
        le=0.1,
        description="share of the wind's speed at which the wind drives a point; needs a response_time",
    )
    dead_band: Distance = Field(
        0.0,
        description="distance from its goal within which it only stems the drift, m; a point's needs a response_time",
    )
    strategy: str = Field("fim", description="where it goes, as the option --usv takes it")

    @model_validator(mode="after")
    def _check(self) -> Boat:
        for name in ("windage", "dead_band"):
            if self.model == "point" and getattr(self, name) > 0 and self.response_time == 0:
                raise ValueError(f"{name} = {getattr(self, name):g}: must be 0 where response_time is 0")
        return self


class Planner(Section):
    """What the boat maximises when it plans by Fisher information (Eq. 2–3)."""

    measurement: Literal["phase", "fix"] = Field(
        "phase", description="information of Eq. 1's phases at known depth, or of the whole fix (phases and delay)"
    )
    noise: Literal["range", "constant"] = Field(
        "range", description="phase noise that grows with range by the sonar equation, or one constant"
    )
    objective: Literal["d", "a", "sum", "paper"] = Field(
        "d",
        description="information on all positions, all errors counted, by its determinant (d) or its inverse's trace"
        " (a); by noise and attitude, determinant of the paper's sum (sum), or what Eq. 3 prints (paper)",
    )


class Tracker(Section):
    """Kalman filter of each AUV's position and current, from its commanded velocity and its fixes."""

    enabled: bool = Field(False, description="the AUVs' positions are those of a tracker, not of the last fix")
    current_reading: float = Field(
        0.0,
        ge=0,
        le=10,
        description="standard deviation of an AUV's current meter, which the tracker reads, m/s; 0: there is none",
    )


class Auv(Section):
    count: int = Field(2, ge=1, le=MAX_AUVS, description="number of AUVs")
    model: Annotated[str, one_of(("point",), vehicles)] = Field(
        "point", description="point: takes any velocity at once, or with a lag; or a vehicle with dynamics, as torpedo"
    )
    variation: float = Field(
        0.0,
        ge=0,
        le=0.5,
        description="share by which mass, drag and fins of each vehicle may differ from the model's, each episode anew",
    )
    depth: float = Field(100.0, ge=0.5, le=11000, description="cruise depth, m")
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
        description="standard deviation of that velocity's error, per axis, m/s; it changes in speed_lag",
    )
    depth_noise: float = Field(
        0.0,
        ge=0,
        le=100,
        description="standard deviation of the error with which a point keeps its depth, or a vehicle reads it, m",
    )
    action: Literal["vector", "polar", "vector-depth", "fins"] = Field(
        "vector",
        description="action as a velocity vector, or as (heading, speed); of a vehicle also as a vector and the depth,"
        " or as (rudder, stern plane, propeller)",
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
        """Numbers of an AUV's action."""
        return 3 if self.action in ("vector-depth", "fins") else 2

    @property
    def shallowest(self) -> float:
        """Depth above which AUVs are not meant to be, m."""
        return {"vector-depth": self.depth_min, "fins": 0.0}.get(self.action, self.depth)

    @model_validator(mode="after")
    def _check(self) -> Auv:
        if not self.dynamic:
            for name in ("altitude", "variation"):
                if getattr(self, name) > 0:
                    raise ValueError(f"{name} = {getattr(self, name):g}: needs a model with dynamics, not point")
            if self.action_size != 2:
                raise ValueError(f"action = {self.action!r}: needs a model with dynamics, not point")
        elif self.separation != "geometry":
            raise ValueError(f"separation = {self.separation!r}: must be geometry with model = {self.model!r}")
        if self.depth_max <= self.depth_min:
            raise ValueError(f"depth_max = {self.depth_max:g}: must be above depth_min, {self.depth_min:g} m")
        if self.speed_max < self.speed_min:
            raise ValueError("speed_max must not be below speed_min")
        if self.speed_noise and not self.speed_lag:
            raise ValueError(f"speed_noise = {self.speed_noise:g}: needs a speed_lag above 0")
        return self


class _Torpedo(Section):
    """Numbers of `auv.model = torpedo`."""

    @model_validator(mode="after")
    def _check(self) -> _Torpedo:
        TORPEDO.table_of(dict(self))
        return self


_fields: Any = {
    name: (float, Field(number.default, ge=number.low, le=number.high, description=number.meaning))
    for name, number in TORPEDO.numbers.items()
}
if TYPE_CHECKING:
    Torpedo = _Torpedo
else:
    Torpedo = create_model("Torpedo", __base__=_Torpedo, __doc__=_Torpedo.__doc__, **_fields)
