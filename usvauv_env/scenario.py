"""A scenario: every number of a simulation, validated and frozen.

A scenario is read from TOML (a shipped name or a path); unknown fields are refused. All values are SI: metres, seconds,
radians, watts, hertz. `Scenario.to_toml` writes it back with each field's description as a comment.
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from kernels.errors import UserError

MAX_AUVS = 16
MAX_NODES = 500
MAX_VORTICES = 16

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class ScenarioError(UserError, ValueError):
    """A scenario cannot be used; the message is one line naming the file, the field, its value and what is allowed."""


class Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=False)


class Area(Section):
    width: float = Field(200.0, ge=40, le=20000, description="extent in x (east), m")
    length: float = Field(200.0, ge=40, le=20000, description="extent in y (north), m")
    depth: float = Field(120.0, ge=5, le=11000, description="water depth h, m")

    @property
    def diagonal(self) -> float:
        """Length of the area's diagonal, m."""
        return math.hypot(self.width, self.length)


class Mission(Section):
    step: float = Field(1.0, gt=0, le=10, description="mission step, s")
    duration: float = Field(1000.0, gt=0, le=1e6, description="length of an episode, s")

    @property
    def steps(self) -> int:
        """Mission steps in an episode."""
        return max(1, round(self.duration / self.step))


class Sea(Section):
    """Shallow-water surface (Eq. 6), its forcing at one edge and its start."""

    cell_size: float = Field(4.0, ge=0.05, le=1000, description="grid spacing while training and evaluating, m")
    fine_cells: int = Field(512, ge=16, le=8192, description="cells along the longer side when simulated live")
    gravity: Positive = Field(9.81, description="gravitational acceleration g, m/s²")
    drag: NonNegative = Field(0.0, description="linear bottom drag rate, 1/s; keeps a resonant basin finite")
    update_interval: Positive = Field(1.0, description="time between updates of the surface seen by the boat, s")
    realisations: int = Field(
        16, ge=1, le=4096, description="different seas in a batch; world w sails on sea w modulo this"
    )
    forced_edge: Literal["none", "west", "east", "south", "north"] = Field(
        "none", description="edge where the elevation is prescribed; all other edges are reflecting walls"
    )
    regular_amplitude: NonNegative = Field(
        0.0, description="amplitude of the regular wave or tide at the forced edge, m"
    )
    regular_period: Positive = Field(43200.0, description="its period, s (Table 1's tide: 43200)")
    irregular_rms: NonNegative = Field(
        0.0, description="rms elevation of the irregular long waves at the forced edge, m"
    )
    irregular_components: int = Field(16, ge=1, le=256, description="number of their components, equal energy each")
    irregular_period_min: Positive = Field(75.0, description="their shortest period, s")
    irregular_period_max: Positive = Field(300.0, description="their longest period, s")
    start_rms: NonNegative = Field(0.0, description="rms elevation of the seeded standing waves the sea starts with, m")
    start_modes: int = Field(4, ge=1, le=16, description="highest number of half wavelengths across the area in them")

    @model_validator(mode="after")
    def _check(self) -> Sea:
        if self.irregular_period_max < self.irregular_period_min:
            raise ValueError("irregular_period_max must not be below irregular_period_min")
        if self.forced_edge == "none" and (self.regular_amplitude > 0 or self.irregular_rms > 0):
            raise ValueError("forced_edge must name an edge when regular_amplitude or irregular_rms is above 0")
        return self


class Storm(Section):
    """Short waves: a directional Airy sea upon the long waves of `Sea`."""

    spectrum: Literal["none", "jonswap", "pm", "tma"] = Field(
        "none", description="JONSWAP, Pierson–Moskowitz, TMA (JONSWAP in water of finite depth), or no short waves"
    )
    significant_height: Positive = Field(6.5, description="significant height Hs = 4 √m0, m; WMO sea state 7: 6 to 9")
    peak_period: Positive = Field(11.0, description="peak period Tp, s")
    gamma: float = Field(2.2, ge=1, le=20, description="peak enhancement γ; Pierson–Moskowitz has 1")
    direction: Finite = Field(math.pi, description="mean direction of travel, from east towards north, rad")
    spreading: float = Field(10.0, ge=0, le=1000, description="s of the spreading cos^2s(½Δθ)")
    components: int = Field(64, ge=8, le=1024, description="number of component waves in a sea")
    shortest_wave: Positive = Field(20.0, description="shortest wave length that moves and tilts the boat, m")


class Current(Section):
    """Superposed Lamb–Oseen vortices (Eq. 8)."""

    centres: tuple[tuple[Finite, Finite], ...] = Field(
        (), max_length=MAX_VORTICES, description="fixed vortex centres [[x, y], ...], m; empty: drawn anew each episode"
    )
    count: int = Field(0, ge=0, le=MAX_VORTICES, description="number of vortices drawn when no centres are given")
    circulation_min: NonNegative = Field(0.0, description="smallest |Γ|, m²/s")
    circulation_max: NonNegative = Field(0.0, description="largest |Γ|, m²/s")
    alternate: bool = Field(True, description="draw the sign of Γ at random; false: all turn anticlockwise")
    core_radius_min: Positive = Field(30.0, description="smallest core radius δ, m")
    core_radius_max: Positive = Field(30.0, description="largest core radius δ, m")

    @model_validator(mode="after")
    def _check(self) -> Current:
        if self.circulation_max < self.circulation_min:
            raise ValueError("circulation_max must not be below circulation_min")
        if self.core_radius_max < self.core_radius_min:
            raise ValueError("core_radius_max must not be below core_radius_min")
        return self

    @property
    def vortices(self) -> int:
        """Number of vortices in a world."""
        return len(self.centres) or self.count


class Acoustics(Section):
    """Sonar equation of the positioning link and of the noise."""

    sound_speed: float = Field(1500.0, ge=1300, le=1700, description="speed of sound c, m/s")
    source_level: float = Field(
        135.0, ge=0, le=260, description="source level of the positioning tone, dB re 1 µPa at 1 m"
    )
    target_strength: float = Field(3.0, ge=-60, le=60, description="target strength of the echo, dB")
    path: Literal["echo", "transponder"] = Field("echo", description="two-way echo or one-way transponder")
    shipping: float = Field(0.5, ge=0, le=1, description="shipping activity in the noise, 0 to 1")
    wind: float = Field(0.0, ge=0, le=60, description="wind speed in the noise, m/s")
    bandwidth: Positive = Field(1000.0, description="receiver bandwidth of the positioning link, Hz")
    noise_law: Literal["amplitude", "demonstration"] = Field(
        "amplitude", description="noise relative to the tone: 10^(−SNR/20), or the demonstration's 10^(−SNR/10)"
    )


class Usbl(Section):
    """Ultra-short baseline array and its estimator (Eq. 1)."""

    spacing: float = Field(0.033, gt=0, le=10, description="array spacing d, m")
    carriers: tuple[Positive, ...] = Field(
        (15000.0, 18000.0), min_length=1, max_length=MAX_AUVS, description="carrier of each AUV, Hz"
    )
    carrier_min: Positive = Field(12000.0, description="carriers of further AUVs are spread from here ..., Hz")
    carrier_max: Positive = Field(18000.0, description="... to here, Hz")
    periods: int = Field(10, ge=1, le=10000, description="length of the tone, carrier periods")
    sampling_rate: Positive = Field(2.016e6, description="sampling rate, Hz")
    tilt: bool = Field(False, description="the array tilts with the surface under the boat")
    attitude_error: float = Field(
        0.0, ge=0, le=0.5, description="standard deviation of the residual attitude error per axis, rad"
    )

    def carrier(self, auv: int, count: int) -> float:
        """Carrier of AUV number `auv` in a team of `count`, Hz: the listed ones, then evenly between the limits."""
        listed = len(self.carriers)
        if auv < listed:
            return self.carriers[auv]
        share = (auv - listed + 1) / (count - listed + 1)
        return self.carrier_min + share * (self.carrier_max - self.carrier_min)


class Boat(Section):
    top_speed: float = Field(4.0, gt=0, le=1e4, description="top speed through the water, m/s")
    drifts: bool = Field(True, description="the current carries the boat")


class Planner(Section):
    """What the boat maximises when it plans by Fisher information (Eq. 2–3)."""

    measurement: Literal["phase", "fix"] = Field(
        "phase", description="information of Eq. 1's phases at known depth, or of the whole fix (phases and delay)"
    )
    noise: Literal["range", "constant"] = Field(
        "range", description="phase noise that grows with range by the sonar equation, or one constant"
    )
    objective: Literal["joint", "sum", "printed"] = Field(
        "joint",
        description="determinant of the information on all positions, of the paper's sum, or what Eq. 3 prints",
    )


class Auv(Section):
    count: int = Field(2, ge=1, le=MAX_AUVS, description="number of AUVs")
    depth: Positive = Field(100.0, description="cruise depth, m")
    separation: Literal["geometry", "demonstration"] = Field(
        "geometry",
        description="vertical distances by geometry, or the demonstration's: the water depth both to boat and to node",
    )
    speed_min: Positive = Field(1.2, description="lowest speed through the water, m/s")
    speed_max: Positive = Field(2.2, description="highest speed through the water, m/s")
    action: Literal["vector", "polar"] = Field(
        "vector", description="action as a velocity vector, or as (heading, speed)"
    )
    start_margin: NonNegative = Field(10.0, description="least distance from the border at the start, m")
    start_separation: NonNegative = Field(20.0, description="least distance between AUVs at the start, m")
    safe_distance: NonNegative = Field(12.0, description="distance below which the reward punishes proximity, m")
    collision_distance: NonNegative = Field(5.0, description="distance below which a step counts as a collision, m")
    hover_radius: Positive = Field(6.0, description="horizontal distance at which an AUV starts to serve its node, m")

    @model_validator(mode="after")
    def _check(self) -> Auv:
        if self.speed_max < self.speed_min:
            raise ValueError("speed_max must not be below speed_min")
        return self


class Nodes(Section):
    count: int = Field(30, ge=1, le=MAX_NODES, description="number of sensor nodes on the bed")
    margin: NonNegative = Field(10.0, description="least distance from the border, m")
    arrival_rates: tuple[NonNegative, ...] = Field(
        (3.0, 5.0, 8.0, 12.0), min_length=1, max_length=16, description="a node's λ is drawn from these, packets/s"
    )
    buffer: Positive = Field(5000.0, description="buffer capacity C, packets")
    start_backlog: NonNegative = Field(1000.0, description="backlog at the start is uniform from 0 to this, packets")
    payload: Positive = Field(2.0, description="data in a full buffer, Mbit")
    distance_weight: NonNegative = Field(0.015, description="α of the target rule λ b/C − α d, 1/(m s)")
    source_power: Positive = Field(0.03, description="acoustic source power, W")
    frequency: Positive = Field(20000.0, description="carrier of the data link, Hz")
    bandwidth: Positive = Field(10000.0, description="bandwidth of the data link, Hz")
    rate_law: Literal["shannon", "demonstration"] = Field(
        "shannon", description="B log2(1 + 10^(SNR/10)), or the demonstration's B log2(1 + 10^SNR) with SNR in dB"
    )

    @model_validator(mode="after")
    def _check(self) -> Nodes:
        if self.start_backlog > self.buffer:
            raise ValueError("start_backlog must not be above buffer")
        return self


class Observation(Section):
    current: Literal["none", "speed", "vector"] = Field(
        "speed", description="the perceived current: not at all, its speed (Eq. 4), or speed and both components"
    )


class Reward(Section):
    """Weights of the named reward terms, each multiplied with a quantity that is positive when present."""

    distance_form: Literal["progress", "distance"] = Field(
        "progress", description="metres closed on the same target, or minus the distance to it (the paper's form)"
    )
    distance: Finite = Field(0.6, description="weight of the distance term, 1/m")
    border: Finite = Field(-0.1, description="weight of a refused move across the border")
    overflow: Finite = Field(-0.05, description="weight of each overflowing node")
    proximity: Finite = Field(-6.0, description="weight of each metre below the safe distance, 1/m")
    service: Finite = Field(12.0, description="weight of a completed service")
    power: Finite = Field(-0.085, description="weight of the power, 1/W")
    collaboration: Finite = Field(0.1, description="weight of Eq. 5's l_max / l")
    service_terminates: bool = Field(False, description="a service ends the learner's value horizon (the paper's form)")


class Reference(Section):
    """Best constant speeds of the heuristics, found once by `usvauv eval` over the speeds and recorded here."""

    straight_speed: Positive = Field(1.2, description="best constant speed of `straight`, m/s")
    crab_speed: Positive = Field(1.2, description="best constant speed of `crab`, m/s")


class Scenario(Section):
    """All numbers of a simulation.

    Load a shipped one by name or any by path: `Scenario.load("extreme", ["auv.count=3"])`.
    """

    name: str = Field("unnamed", min_length=1, description="name shown in tables and on videos")
    description: str = Field("", description="one sentence on what it stands for")
    area: Area = Field(default_factory=Area, description="the operating area")
    mission: Mission = Field(default_factory=Mission, description="clock of the mission")
    sea: Sea = Field(default_factory=Sea, description="sea surface: shallow-water equations (Eq. 6)")
    storm: Storm = Field(default_factory=Storm, description="short waves upon it: a directional Airy sea")
    current: Current = Field(default_factory=Current, description="current: Lamb–Oseen vortices (Eq. 8)")
    acoustics: Acoustics = Field(default_factory=Acoustics, description="sonar equation of the positioning link")
    usbl: Usbl = Field(default_factory=Usbl, description="ultra-short baseline positioning (Eq. 1)")
    boat: Boat = Field(default_factory=Boat, description="the USV")
    planner: Planner = Field(default_factory=Planner, description="Fisher-information path planning (Eq. 2–3)")
    auv: Auv = Field(default_factory=Auv, description="the AUVs")
    nodes: Nodes = Field(default_factory=Nodes, description="sensor nodes and their data link")
    observation: Observation = Field(default_factory=Observation, description="what an AUV observes")
    reward: Reward = Field(default_factory=Reward, description="weights of the reward's named terms")
    reference: Reference = Field(default_factory=Reference, description="recorded speeds of the heuristics")

    @model_validator(mode="after")
    def _check(self) -> Scenario:
        if self.auv.separation == "geometry" and self.auv.depth >= self.area.depth:
            raise ValueError("auv.depth must be below area.depth")
        smaller = min(self.area.width, self.area.length)
        for field, margin in (("auv.start_margin", self.auv.start_margin), ("nodes.margin", self.nodes.margin)):
            if 2 * margin >= smaller:
                raise ValueError(f"{field} must be below half the area's smaller side, {smaller / 2:g}")
        room = (self.area.width - 2 * self.auv.start_margin) * (self.area.length - 2 * self.auv.start_margin)
        if self.auv.count * self.auv.start_separation**2 > 0.5 * room:  # well below where random placing jams
            raise ValueError(f"auv.start_separation is too large for {self.auv.count} AUVs in this area")
        if not self.auv.speed_min <= self.reference.straight_speed <= self.auv.speed_max:
            raise ValueError("reference.straight_speed must lie between auv.speed_min and auv.speed_max")
        if not self.auv.speed_min <= self.reference.crab_speed <= self.auv.speed_max:
            raise ValueError("reference.crab_speed must lie between auv.speed_min and auv.speed_max")
        if self.mission.step * max(self.nodes.arrival_rates) > 80:  # the sampler's exp(−mean) must not underflow
            raise ValueError("nodes.arrival_rates times mission.step must not be above 80 packets")
        if self.sea.cell_size * 4 > smaller:
            raise ValueError("sea.cell_size must leave at least four cells across the area")
        if self.storm.spectrum != "none":
            self._check_storm()
        return self

    def _check_storm(self) -> None:
        g, depth, storm = self.sea.gravity, self.area.depth, self.storm
        shortest = 2 * math.pi / storm.shortest_wave
        if math.sqrt(g * shortest * math.tanh(shortest * depth)) < 4 * math.pi / storm.peak_period:
            raise ValueError("storm.shortest_wave must have at least twice the frequency of storm.peak_period")
        highest = min(0.1 * g * storm.peak_period**2 / (2 * math.pi), 0.6 * depth)  # beyond that waves break
        if storm.significant_height > highest:
            raise ValueError(f"storm.significant_height must not be above {highest:.3g} m, where such waves break")

    @staticmethod
    def shipped() -> list[str]:
        """Names of the scenarios inside the package."""
        folder = resources.files("usvauv_env") / "scenarios"
        return sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))

    @classmethod
    def load(cls, name_or_path: str | Path, overrides: Sequence[str] = ()) -> Scenario:
        """Read a scenario by shipped name or by path, apply `section.field=value` overrides, validate it.

        Raises:
            ScenarioError: unknown name, unreadable file, unknown field, wrong type or a value out of range.
        """
        text, source = _read(name_or_path)
        try:
            data = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise ScenarioError(f"{source}: not valid TOML: {error}") from None
        for override in overrides:
            _apply(data, override)
        return cls.from_dict(data, source)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], source: str = "scenario") -> Scenario:
        """Validate nested sections; `source` names them in an error message."""
        try:
            return cls.model_validate(data)
        except ValidationError as error:
            raise ScenarioError(_one_line(error, source)) from None

    def to_dict(self) -> dict[str, Any]:
        """Nested plain values, the inverse of `from_dict`."""
        return self.model_dump(mode="json")

    def to_toml(self) -> str:
        """The whole scenario as TOML, each field with its description as a comment."""
        lines = []
        for field, info in type(self).model_fields.items():
            value = getattr(self, field)
            if not isinstance(value, Section):
                lines.append(f"{field} = {_toml(value)}  # {info.description}")
        for field, info in type(self).model_fields.items():
            section = getattr(self, field)
            if isinstance(section, Section):
                lines += ["", f"[{field}]  # {info.description}"]
                lines += [
                    f"{key} = {_toml(getattr(section, key))}  # {about.description}"
                    for key, about in type(section).model_fields.items()
                ]
        return "\n".join(lines) + "\n"


def _toml(value: Any) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(_toml(item) for item in value) + "]"
    return json.dumps(value, ensure_ascii=False)


def _read(name_or_path: str | Path) -> tuple[str, str]:
    """Text of a scenario and how to call it in messages."""
    name = str(name_or_path)
    if name in Scenario.shipped():
        return (resources.files("usvauv_env") / "scenarios" / f"{name}.toml").read_text(encoding="utf-8"), name
    path = Path(name_or_path)
    if not path.is_file():
        known = ", ".join(Scenario.shipped())
        raise ScenarioError(f"scenario: {name!r} is neither a file nor one of the shipped ones: {known}")
    try:
        return path.read_text(encoding="utf-8"), name
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(f"{name}: cannot be read: {error}") from None


def _apply(data: dict[str, Any], override: str) -> None:
    """Set one `section.field=value` in nested data; the value is TOML, or a bare word taken as text."""
    key, separator, text = override.partition("=")
    parts = key.strip().split(".")
    if not separator or not all(parts):
        raise ScenarioError(f"--set {override!r}: expected section.field=value, for example auv.count=3")
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = text.strip()
    place = data
    for part in parts[:-1]:
        place = place.setdefault(part, {})
        if not isinstance(place, dict):
            raise ScenarioError(f"--set {override!r}: {part} is not a section")
    place[parts[-1]] = value


def _one_line(error: ValidationError, source: str) -> str:
    """The first problem of a validation as one line: file, field, what is wrong, the value given."""
    problem = error.errors()[0]
    field = ".".join(str(part) for part in problem["loc"])
    message = problem["msg"].removeprefix("Value error, ")
    if problem["type"] == "extra_forbidden":
        section: Any = Scenario
        for part in problem["loc"][:-1]:
            section = section.model_fields[part].annotation
        return f"{source}: {field}: unknown field; allowed here: {', '.join(section.model_fields)}"
    if problem["type"] == "value_error":
        return f"{source}: {field}: {message}" if field else f"{source}: {message}"
    return f"{source}: {field} = {problem['input']!r}: {message[0].lower()}{message[1:]}"
