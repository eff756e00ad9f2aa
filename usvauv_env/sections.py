"""The sections of a scenario: every number, with its range, unit and meaning.

All values are SI: metres, seconds, radians, watts, hertz.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from datetime import date, datetime
from typing import Annotated, Any, Literal, TypeVar, cast

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, ValidationError, field_validator, model_validator

from kernels.mission import target_rules
from kernels.mission.vehicle import FASTEST
from kernels.planning.team import MAX_AUVS
from kernels.positioning.absorption import absorption_laws
from kernels.positioning.ambient_noise import ambient_noise_laws
from kernels.positioning.reflections import SEDIMENTS
from kernels.shallow_water.boundaries import Side

MAX_NODES = 500
MAX_VORTICES = 64
TOGETHER = 16  # vortices; of more than these no more are taken to lie at one place
VORTEX_PEAK = 0.6382 / (2 * math.pi)  # largest speed of a Lamb–Oseen vortex over Γ/δ
MOST_PACKETS = 1e7  # single precision counts one by one up to 1.6e7

LARGEST = 1e6  # of a weight or a price; sums of a step's terms keep three digits beside it in single precision
FASTEST_WATER = 20.0  # m/s; the fastest tidal streams reach 11
LOWEST_TONE, HIGHEST_TONE = 100.0, 2e5  # Hz; below and above the laws of absorption and noise mean nothing
MOST_STEPS = 10_000_000  # of a mission, sixteen weeks at a second each

FARTHEST = 1e5  # m, of a place from the area's corner, east and north

Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Price = Annotated[float, Field(ge=0, le=LARGEST)]
Place = Annotated[float, Field(ge=-FARTHEST, le=FARTHEST)]
Distance = Annotated[float, Field(ge=0, le=20000)]  # the longest side of an area
Carrier = Annotated[float, Field(ge=LOWEST_TONE, le=HIGHEST_TONE)]
WaveHeight = Annotated[float, Field(ge=0.001, le=30)]
WavePeriod = Annotated[float, Field(ge=0.5, le=30)]
Enhancement = Annotated[float, Field(ge=1, le=20)]
Direction = Annotated[float, Field(ge=-7, le=7)]
Spreading = Annotated[float, Field(ge=0, le=1000)]
Centre = Annotated[
    Annotated[tuple[Place, Place], Tag("metres")] | Annotated[str, Tag("degrees")],
    Discriminator(lambda value: "degrees" if isinstance(value, str) else "metres"),
]
Bandwidth = Annotated[float, Field(ge=1, le=1e6)]


def known(name: str, names: Collection[str]) -> str:
    """The name itself, if it is one of some names.

    Raises:
        ValueError: it is not; the message lists them.
    """
    if name not in names:
        raise ValueError(f"{name!r}: allowed are {', '.join(names)}")
    return name


class Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=False)


def one_line(error: ValidationError, source: str, model: type[Section]) -> str:
    """The first problem of a validation as one line: file, field, what is wrong, the value given."""
    problem = error.errors()[0]
    field = ".".join(str(part) for part in problem["loc"])
    message = problem["msg"].removeprefix("Value error, ")
    if problem["type"] == "extra_forbidden":
        section: Any = model
        for part in problem["loc"][:-1]:
            section = section.model_fields[part].annotation
        return f"{source}: {field}: unknown field; allowed here: {', '.join(section.model_fields)}"
    if problem["type"] == "value_error":
        return f"{source}: {field}: {message}" if field else f"{source}: {message}"
    return f"{source}: {field} = {problem['input']!r}: {message[0].lower()}{message[1:]}"


S = TypeVar("S", bound=Section)


def section(kind: type[S], description: str) -> S:
    """A field that is a section, by default with the defaults of its fields."""
    return Field(default_factory=cast(Callable[[], S], kind), description=description)


class Area(Section):
    width: float = Field(200.0, ge=40, le=20000, description="extent in x (east), m")
    length: float = Field(200.0, ge=40, le=20000, description="extent in y (north), m")
    depth: float = Field(120.0, ge=5, le=11000, description="water depth h, m")

    @property
    def diagonal(self) -> float:
        """Length of the area's diagonal, m."""
        return math.hypot(self.width, self.length)


class Mission(Section):
    step: float = Field(1.0, ge=0.01, le=10, description="mission step, s")
    duration: float = Field(
        1000.0, ge=0.01, le=1e7, description="length of an episode, s; the nearest whole number of steps, at least one"
    )

    @property
    def steps(self) -> int:
        """Mission steps in an episode."""
        return max(1, round(self.duration / self.step))

    @model_validator(mode="after")
    def _check(self) -> Mission:
        if self.steps > MOST_STEPS:
            raise ValueError(f"duration / step = {self.steps} steps: must be at most {MOST_STEPS}")
        return self


class Sea(Section):
    """Shallow-water surface (Eq. 6), its forcing at one edge and its start."""

    equations: Literal["linear", "nonlinear"] = Field(
        "linear", description="linear long waves, or nonlinear ones with bores and dry shores, which cost far more"
    )
    cell_size: float = Field(
        4.0, ge=0.05, le=1000, description="grid spacing while training and evaluating, m; about: cells fill the area"
    )
    fine_cells: int = Field(512, ge=16, le=8192, description="cells along the longer side when simulated live")
    gravity: float = Field(9.81, ge=1, le=30, description="gravitational acceleration g, m/s²")
    drag: float = Field(0.0, ge=0, le=1, description="linear bottom drag rate, 1/s; keeps a resonant basin finite")
    manning: float = Field(
        0.0, ge=0, le=0.2, description="Manning's n of the bed with nonlinear equations, s/m^(1/3); sand 0.02 to 0.03"
    )
    update_interval: float = Field(
        1.0,
        ge=0.01,
        le=86400,
        description="time between updates of the long waves, s, whatever the mission step: they stand for up to it",
    )
    realisations: int = Field(
        16, ge=1, le=4096, description="different seas in a batch; world w sails on sea w modulo this"
    )
    forced_edge: Literal["none", "west", "east", "south", "north"] = Field(
        "none", description="edge where the elevation is prescribed"
    )
    forcing: Literal["elevation", "incident"] = Field(
        "elevation",
        description="what is prescribed there: the elevation, or the wave that comes in, while others leave",
    )
    radiating_edges: tuple[Side, ...] = Field(
        (), description="edges that long waves leave through; edges not named anywhere are reflecting walls"
    )
    sponge_edges: tuple[Side, ...] = Field((), description="edges with a layer in front that absorbs waves")
    sponge_width: float = Field(40.0, ge=0.1, le=20000, description="width of that layer, m")
    regular_amplitude: float = Field(
        0.0, ge=0, le=30, description="amplitude of the regular wave or tide at the forced edge, m"
    )
    regular_period: float = Field(43200.0, ge=1, le=1e7, description="its period, s (Table 1's tide: 43200)")
    irregular_rms: float = Field(
        0.0, ge=0, le=10, description="rms elevation of the irregular long waves at the forced edge, m"
    )
    irregular_components: int = Field(16, ge=1, le=256, description="number of their components, equal energy each")
    irregular_period_min: float = Field(75.0, ge=1, le=1e6, description="their shortest period, s")
    irregular_period_max: float = Field(300.0, ge=1, le=1e6, description="their longest period, s")
    start_rms: float = Field(
        0.0, ge=0, le=10, description="rms elevation of the seeded standing waves the sea starts with, m"
    )
    start_modes: int = Field(4, ge=1, le=16, description="highest number of half wavelengths across the area in them")

    @model_validator(mode="after")
    def _check(self) -> Sea:
        if self.irregular_period_max < self.irregular_period_min:
            raise ValueError("irregular_period_max must not be below irregular_period_min")
        if self.forced_edge == "none" and (self.regular_amplitude > 0 or self.irregular_rms > 0):
            raise ValueError("forced_edge must name an edge when regular_amplitude or irregular_rms is above 0")
        named = (self.forced_edge, *self.radiating_edges, *self.sponge_edges)
        for side in named:
            if named.count(side) > 1:
                raise ValueError(f"forced_edge, radiating_edges and sponge_edges must not name an edge twice: {side}")
        if self.equations == "nonlinear" and self.sponge_edges:
            raise ValueError('equations = "nonlinear" must go without sponge_edges')
        if self.manning > 0 and self.equations == "linear":
            raise ValueError(f'manning = {self.manning:g}: needs equations = "nonlinear"; linear ones have drag')
        return self


class Storm(Section):
    """Short waves: a directional Airy sea upon the long waves of `Sea`."""

    spectrum: Literal["none", "jonswap", "pm", "tma"] = Field(
        "none", description="JONSWAP, Pierson–Moskowitz, TMA (JONSWAP in water of finite depth), or no short waves"
    )
    significant_height: WaveHeight = Field(6.5, description="significant height Hs = 4 √m0, m; WMO sea state 7: 6 to 9")
    peak_period: WavePeriod = Field(11.0, description="peak period Tp, s")
    gamma: Enhancement = Field(2.2, description="peak enhancement γ; Pierson–Moskowitz has 1")
    direction: Direction = Field(math.pi, description="mean direction of travel, from east towards north, rad")
    spreading: Spreading = Field(10.0, description="s of the spreading cos^2s(½Δθ)")
    swells: tuple[tuple[WaveHeight, WavePeriod, Enhancement, Direction, Spreading], ...] = Field(
        (),
        max_length=8,
        description="further wave systems of that spectrum, [[Hs m, Tp s, γ, direction rad, spreading], ...], as above",
    )
    components: int = Field(64, ge=8, le=1024, description="number of component waves of each system in a sea")
    shortest_wave: float = Field(
        20.0, ge=0.1, le=1000, description="shortest wave length that moves and tilts the boat, m"
    )

    @property
    def systems(self) -> tuple[Storm, ...]:
        """The wind sea, then each swell, as storms without swells; none without a spectrum."""
        if self.spectrum == "none":
            return ()
        names = "significant_height", "peak_period", "gamma", "direction", "spreading"
        alone = self.model_copy(update={"swells": ()})
        swells = (alone.model_copy(update=dict(zip(names, swell, strict=True))) for swell in self.swells)
        return alone, *swells

    @property
    def total_height(self) -> float:
        """Significant height of all systems together, 4 √Σm0, m; 0 without a spectrum."""
        return math.hypot(*(system.significant_height for system in self.systems))


class Water(Section):
    """The real bed, currents and waves, read from NetCDF files (`usvauv_env.site`)."""

    bathymetry: str = Field("", description="file with the depth of the bed; empty: flat at area.depth")
    currents: str = Field("", description="file with currents, added to the vortices; empty: none")
    waves: str = Field(
        "", description="file with wave spectra or partitions, in place of the storm's systems; empty: none"
    )
    longitude: float = Field(
        0.0, ge=-180, le=360, description="longitude of the area's south-west corner, degrees east"
    )
    latitude: float = Field(0.0, ge=-85, le=85, description="latitude of the area's south-west corner, degrees north")
    start: str = Field("", description="ISO time at which the mission begins; empty: the first of the file")

    @field_validator("start", mode="before")
    @classmethod
    def _as_text(cls, value: Any) -> Any:
        """TOML has times of its own: an unquoted one is taken as what it says."""
        return value.isoformat() if isinstance(value, date | datetime) else value


class Current(Section):
    """Superposed Lamb–Oseen vortices (Eq. 8)."""

    centres: tuple[Centre, ...] = Field(
        (),
        max_length=MAX_VORTICES,
        description='fixed vortex centres [[x, y], ...], m, or ["22.51N,114.02E", ...]; empty: drawn anew each episode',
    )
    count: int = Field(0, ge=0, le=MAX_VORTICES, description="number of vortices drawn when no centres are given")
    circulation_min: float = Field(0.0, ge=0, le=1e5, description="smallest |Γ|, m²/s")
    circulation_max: float = Field(0.0, ge=0, le=1e5, description="largest |Γ|, m²/s")
    alternate: bool = Field(True, description="draw the sign of Γ at random; false: all turn anticlockwise")
    core_radius_min: float = Field(30.0, ge=1, le=20000, description="smallest core radius δ, m")
    core_radius_max: float = Field(30.0, ge=1, le=20000, description="largest core radius δ, m")
    viscosity: float = Field(
        0.0, ge=0, le=1000, description="eddy viscosity ν by which cores spread, dδ²/dt = 4ν, m²/s"
    )
    mutual: bool = Field(False, description="vortices carry one another")

    @model_validator(mode="after")
    def _check(self) -> Current:
        if self.circulation_max < self.circulation_min:
            raise ValueError("circulation_max must not be below circulation_min")
        if self.core_radius_max < self.core_radius_min:
            raise ValueError("core_radius_max must not be below core_radius_min")
        if self.fastest > FASTEST_WATER:
            raise ValueError(
                f"circulation_max = {self.circulation_max:g} at core_radius_min = {self.core_radius_min:g}:"
                f" the vortices together turn at up to {self.fastest:.3g} m/s; allowed are {FASTEST_WATER:g} m/s"
            )
        return self

    @property
    def fastest(self) -> float:
        """Sum of the peak speeds of all vortices, or of as many as lie `TOGETHER`, m/s."""
        return min(self.vortices, TOGETHER) * VORTEX_PEAK * self.circulation_max / self.core_radius_min

    @property
    def vortices(self) -> int:
        """Number of vortices in a world."""
        return len(self.centres) or self.count


class Acoustics(Section):
    """Sonar equation of the positioning link and of the noise."""

    sound_speed: float = Field(1500.0, ge=1300, le=1700, description="speed of sound c, m/s")
    sound_speed_error: float = Field(
        0.0,
        ge=0,
        le=50,
        description="standard deviation of the water's true speed of sound about that which fixes are computed with,"
        " all through a mission, m/s",
    )
    source_level: float = Field(
        187.0, ge=0, le=260, description="source level of the positioning signal, dB re 1 µPa at 1 m"
    )
    target_strength: float = Field(3.0, ge=-60, le=60, description="target strength of the echo, dB")
    sound_speed_profile: tuple[tuple[Number, Number], ...] = Field(
        (), description="speed of sound against depth, [[m, m/s], ...], in place of the constant; empty: constant"
    )
    temperature_salinity: tuple[tuple[Number, Number, Number], ...] = Field(
        (), description="or the water itself, [[depth m, in-situ °C, salinity], ...]; the speed follows by TEOS-10"
    )
    salinity: Literal["practical", "absolute"] = Field(
        "practical", description="kind of that salinity: practical (PSS-78, as a CTD gives it), or absolute, g/kg"
    )
    path: Literal["echo", "transponder"] = Field("transponder", description="two-way echo or one-way transponder")
    spreading: float = Field(
        20.0, ge=10, le=30, description="spreading loss a decade of range, dB: 20 spherical, 15 in the paper"
    )
    ambient_noise: str = Field("coates", description="law of the noise density: coates, or a plugin's law")
    absorption: str = Field(
        "francois-garrison", description="law of absorption: thorp, francois-garrison, ainslie-mccolm, or a plugin's"
    )
    water_temperature: float = Field(10.0, ge=-2, le=35, description="temperature of the water in that law, °C")
    water_salinity: float = Field(35.0, ge=5, le=50, description="its salinity")
    ph: float = Field(8.0, ge=7.7, le=8.3, description="its pH")
    shipping: float = Field(0.5, ge=0, le=1, description="shipping activity in the noise, 0 to 1")
    wind: Annotated[float, Field(ge=0, le=60)] | Literal["storm"] = Field(
        "storm", description="wind speed in noise and bubbles, m/s, or that of the storm; without one 0"
    )
    bubbles: bool = Field(False, description="the wind's bubbles weaken what comes to the array")
    rain: float = Field(0.0, ge=0, le=200, description="rain in the noise, mm/h")
    multipath: bool = Field(
        False, description="the array also hears reflections of coded pulses from the surface and the bottom"
    )
    sediment: str = Field("sand", description="of the bottom, for its reflections: clay, silt, sand, gravel, moraine")
    bandwidth: Bandwidth = Field(4000.0, description="bandwidth of the positioning link, Hz")
    noise_law: Literal["density", "demonstration"] = Field(
        "density",
        description="noise of a fix: by energy over noise density, or by the demonstration's 10^(−SNR/10)",
    )

    @field_validator("absorption")
    @classmethod
    def _known_absorption(cls, name: str) -> str:
        return known(name, absorption_laws)

    @field_validator("sediment")
    @classmethod
    def _known_sediment(cls, name: str) -> str:
        return known(name, SEDIMENTS)

    @field_validator("ambient_noise")
    @classmethod
    def _known_noise(cls, name: str) -> str:
        return known(name, ambient_noise_laws)


class Usbl(Section):
    """Ultra-short baseline array and its estimator (Eq. 1)."""

    spacing: float = Field(0.033, ge=0.001, le=10, description="array spacing d, m")
    array_depth: float = Field(
        3.0, ge=0, le=50, description="depth of the array, for bubbles above it and reflections, m"
    )
    carriers: tuple[Carrier, ...] = Field(
        (15000.0, 18000.0), min_length=1, max_length=MAX_AUVS, description="carrier of each AUV, Hz"
    )
    carrier_min: Carrier = Field(12000.0, description="carriers of further AUVs are spread from here ..., Hz")
    carrier_max: Carrier = Field(18000.0, description="... to here, Hz")
    signal: Literal["tone", "code"] = Field(
        "code", description="a tone, or a coded pulse of acoustics.bandwidth, which tells AUVs apart"
    )
    periods: int = Field(10, ge=1, le=10000, description="length of a tone, carrier periods")
    pulse_length: float = Field(0.01, ge=1e-5, le=1, description="length of a coded pulse, s")
    sampling_rate: float = Field(2.016e6, ge=200, le=1e8, description="sampling rate, Hz")
    model: Literal["statistical", "waveform"] = Field(
        "statistical", description="fixes drawn from their distribution, or measured from sampled signals in noise"
    )
    refraction: Literal["corrected", "mean", "array"] = Field(
        "corrected",
        description="with a profile: fixes follow the bent ray, or a straight one at the mean or the array's speed",
    )
    propagation: bool = Field(
        False, description="a fix is of where the AUV was when its sound left it, not of where it is"
    )
    latency: float = Field(0.0, ge=0, le=10, description="time that then passes until a fix can be used, s")
    packet_loss: float = Field(0.0, ge=0, lt=1, description="probability that a fix never arrives")
    tilt: bool = Field(False, description="the array tilts with the surface under the boat")
    attitude_error: float = Field(
        0.0, ge=0, le=0.5, description="standard deviation of the error of pitch and roll, each, new in each fix, rad"
    )
    alignment_error: float = Field(
        0.0, ge=0, le=0.5, description="standard deviation of the mounting's error in pitch and roll, all mission, rad"
    )
    heading_error: float = Field(
        0.0, ge=0, le=0.5, description="standard deviation of the error of the heading, all mission, rad"
    )
    lever_arm_error: float = Field(
        0.0,
        ge=0,
        le=10,
        description="standard deviation of the array's place from the antenna, per axis, all mission, m",
    )
    gnss_error: float = Field(
        0.0, ge=0, le=100, description="standard deviation of the boat's own position, per axis, m"
    )
    gnss_correlation_time: float = Field(60.0, ge=0.1, le=1e6, description="time in which that error changes, s")

    @model_validator(mode="after")
    def _check(self) -> Usbl:
        if self.carrier_max < self.carrier_min:
            raise ValueError("carrier_max must not be below carrier_min")
        highest = max(*self.carriers, self.carrier_max)
        if self.sampling_rate < 2 * highest:  # Nyquist
            least = 2 * highest
            raise ValueError(f"sampling_rate = {self.sampling_rate:g}: must be at least two a period, {least:g} Hz")
        return self

    def carrier(self, auv: int, count: int) -> float:
        """Carrier of AUV number `auv` in a team of `count`, Hz: the listed ones, then evenly between the limits."""
        listed = len(self.carriers)
        if auv < listed:
            return self.carriers[auv]
        share = (auv - listed + 1) / (count - listed + 1)
        return self.carrier_min + share * (self.carrier_max - self.carrier_min)


class Channel(Section):
    """The one acoustic channel, in which boats ask AUVs in turn and they reply."""

    schedule: Literal["every-step", "all", "round-robin", "by-need"] = Field(
        "every-step",
        description="fixes in each step for nothing; or by exchanges that take their time: with all AUVs at once, in"
        " turn, or by what a reply is expected to tell times how long ago an AUV was asked",
    )
    turn_around: float = Field(
        0.1, ge=0, le=10, description="time from the interrogation to the transponder's reply, s"
    )
    interval: float = Field(
        0.0, ge=0, le=3600, description="least time from the beginning of an exchange to that of the next, s"
    )
    data_ratio: float = Field(
        0.0,
        ge=0,
        le=60,
        description="least E/N0 of a coded pulse at which the data that a reply carries can be read, dB; below 9:"
        " wherever the pulse is detected",
    )


class Navigation(Section):
    """What an AUV reckons with between fixes, and what it learns of them: a filter of its own."""

    sensor: Literal["none", "ground", "water"] = Field(
        "none",
        description="an AUV has its position from the boat; or it reckons with its velocity over ground (Doppler log)"
        " or through the water, and is told of its fixes by interrogations",
    )
    velocity_noise: float = Field(
        0.02, ge=0, le=10, description="standard deviation of that velocity's white error in one second, per axis, m/s"
    )
    velocity_bias: float = Field(
        0.03, ge=0, le=10, description="standard deviation of its bias, log and compass together, per axis, m/s"
    )
    bias_correlation_time: float = Field(300.0, ge=0.1, le=1e7, description="time in which the bias changes, s")
    homing_range: Distance = Field(
        0.0, description="horizontal distance within which an AUV hears its node and knows the way to it, m"
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
    top_speed: float = Field(4.0, ge=1e-4, le=1e4, description="top speed through the water, m/s")
    drifts: bool = Field(True, description="the current carries the boat")
    strategy: str = Field("fim", description="where it goes, as the option --usv takes it")


class Planner(Section):
    """What the boat maximises when it plans by Fisher information (Eq. 2–3)."""

    measurement: Literal["phase", "fix"] = Field(
        "phase", description="information of Eq. 1's phases at known depth, or of the whole fix (phases and delay)"
    )
    noise: Literal["range", "constant"] = Field(
        "range", description="phase noise that grows with range by the sonar equation, or one constant"
    )
    objective: Literal["d", "a", "e", "sum", "paper"] = Field(
        "d",
        description="information on all positions by its determinant (d), its inverse's trace (a) or least eigenvalue"
        " (e), determinant of the paper's sum (sum), or what Eq. 3 prints (paper)",
    )
    horizon: int = Field(10, ge=1, le=1000, description="steps that `fim-horizon` looks ahead")


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
    depth: float = Field(100.0, ge=0.5, le=11000, description="cruise depth, m")
    separation: Literal["geometry", "demonstration"] = Field(
        "geometry",
        description="vertical distances by geometry, or the demonstration's: auv.depth both to boat and to node",
    )
    speed_min: float = Field(1.2, ge=0.01, le=FASTEST, description="lowest speed through the water, m/s")
    speed_max: float = Field(
        2.2, ge=0.01, le=FASTEST, description="highest speed through the water, m/s; the power law holds up to 2.5"
    )
    action: Literal["vector", "polar"] = Field(
        "vector", description="action as a velocity vector, or as (heading, speed)"
    )
    start_margin: Distance = Field(10.0, description="least distance from the border at the start, m")
    start_separation: Distance = Field(20.0, description="least distance between AUVs at the start, m")
    refused_power: Literal["travelling", "hovering"] = Field(
        "travelling",
        description="power of a move refused at the border: as of one made (travelling), or of hovering (the"
        " demonstration's)",
    )
    safe_distance: Distance = Field(12.0, description="distance below which the reward punishes proximity, m")
    collision_distance: Distance = Field(5.0, description="distance below which a step counts as a collision, m")
    hover_radius: float = Field(
        6.0, ge=0.01, le=20000, description="horizontal distance at which an AUV starts to serve its node, m"
    )

    @model_validator(mode="after")
    def _check(self) -> Auv:
        if self.speed_max < self.speed_min:
            raise ValueError("speed_max must not be below speed_min")
        return self


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
        description="what the rule knows: backlogs and rates, rates only, what all AUVs' visits have found, or only the"
        " own ones (no communication)",
    )
    source_power: float = Field(0.03, ge=1e-6, le=1e5, description="acoustic source power, W")
    frequency: Carrier = Field(20000.0, description="carrier of the data link, Hz")
    bandwidth: Bandwidth = Field(10000.0, description="bandwidth of the data link, Hz")
    rate_law: Literal["shannon", "demonstration"] = Field(
        "shannon", description="B log2(1 + 10^(SNR/10)), or the demonstration's B log2(1 + 10^SNR) with SNR in dB"
    )

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


class TaskParameters(Section):
    """Numbers of a plugin's task by name; what is not given has the task's default."""

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

    straight_speed: float = Field(1.2, ge=0.01, le=10, description="best constant speed of `straight`, m/s")
    crab_speed: float = Field(1.2, ge=0.01, le=10, description="best constant speed of `crab`, m/s")
    pace_price: Price = Field(0.0, description="best price of time of `pace`, W")
    clear_price: Price = Field(0.0, description="best price of time of `clear`, W")
    zermelo_speed: float = Field(1.2, ge=0.01, le=10, description="best constant speed of `zermelo`, m/s")
