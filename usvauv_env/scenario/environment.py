"""Sections of a scenario about its place and time, water and sound: area, clock, waves, currents, sonar."""

from __future__ import annotations

import math
from collections.abc import Iterator
from datetime import date, datetime
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Discriminator, Field, Tag, field_validator

from usvauv.env.scenario.fields import Bandwidth, Carrier, FileName, Number, Place, Section, one_of
from usvauv.kernels.limits import LEAST_HEIGHT, MAX_AUVS, MAX_VORTICES, Side
from usvauv.kernels.mission.choices import schedules
from usvauv.kernels.positioning.laws import absorption_laws, ambient_noise_laws

MOST_STEPS = 10_000_000  # of a mission, sixteen weeks at one second each
SMALLEST_PERIOD = 7.5  # core radii δ; the images' cores, left out, are then e^{−(L/2)²/(2δ²)} < 1e-3 of a velocity
TOGETHER = 16  # vortices; at most so many are assumed to lie at one place
VORTEX_PEAK = 0.6382 / (2 * math.pi)  # largest speed of a Lamb–Oseen vortex over Γ/δ
INFRAGRAVITY = 1.2e-3  # 1/s, α1 of `usvauv.env.sea.long_waves.long_wave_rms`
FASTEST_WATER = 40.0  # m/s, with all vortices at one place, which is unlikely; the fastest tidal streams reach 11

WaveHeight = Annotated[float, Field(ge=0.001, le=30)]
WavePeriod = Annotated[float, Field(ge=0.5, le=30)]
Enhancement = Annotated[float, Field(ge=1, le=20)]
Direction = Annotated[float, Field(ge=-7, le=7)]
Spreading = Annotated[float, Field(ge=0, le=1000)]
Centre = Annotated[
    Annotated[tuple[Place, Place], Tag("metres")] | Annotated[str, Tag("degrees")],
    Discriminator(lambda value: "degrees" if isinstance(value, str) else "metres"),
]


def _below(name: str, least: float, most: float) -> str:
    return f"{name}_max = {most:g}: must not be below {name}_min, {least:g}"


class Area(Section):
    width: float = Field(200.0, ge=40, le=20000, description="extent in x (east), m")
    length: float = Field(200.0, ge=40, le=20000, description="extent in y (north), m")
    depth: float = Field(120.0, ge=5, le=11000, description="water depth h, m")
    bed_rms: float = Field(
        0.0, ge=0, le=1000, description="rms height of a random bed about that depth, m; 0: flat, or that of a file"
    )
    bed_length: float = Field(
        50.0, ge=10, le=20000, description="length l of the random bed, whose covariance is e^(-r²/(2 l²)), m"
    )
    bed_seed: int = Field(0, ge=0, le=1_000_000, description="which random bed")

    @property
    def diagonal(self) -> float:
        """Length of the area's diagonal, m."""
        return math.hypot(self.width, self.length)

    def cells(self, longer: int) -> tuple[int, int]:
        """Numbers (nx, ny) of roughly square cells, `longer` along the longer side, at least 3 along each."""
        size = max(self.width, self.length) / longer
        return max(3, round(self.width / size)), max(3, round(self.length / size))

    def middles(self, nx: int, ny: int) -> tuple[np.ndarray, np.ndarray]:
        """x (nx,) and y (ny,) of the centres of cells that fill the area, m."""
        return (np.arange(nx) + 0.5) * self.width / nx, (np.arange(ny) + 0.5) * self.length / ny


class Mission(Section):
    step: float = Field(1.0, ge=0.01, le=60, description="mission step, s")
    duration: float = Field(
        1000.0, ge=0.01, le=1e7, description="length of an episode, s; the nearest whole number of steps, at least one"
    )

    @property
    def steps(self) -> int:
        """Mission steps in an episode."""
        return max(1, round(self.duration / self.step))

    def _problems(self) -> Iterator[str]:
        if self.steps > MOST_STEPS:
            yield f"duration / step = {self.steps} steps: must be at most {MOST_STEPS}"


class Sea(Section):
    """Shallow-water surface (Eq. 6) and its forcing at one edge."""

    equations: Literal["linear", "nonlinear"] = Field(
        "linear", description="linear long waves, or nonlinear ones with bores and dry shores, which are far slower"
    )
    cell_size: float = Field(
        4.0, ge=0.05, le=1000, description="approximate grid spacing in training and evaluation, m; cells fill the area"
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
        description="time between updates of the long waves, s, at any mission step; they are constant in between",
    )
    realisations: int = Field(
        16, ge=1, le=4096, description="number of different seas in a batch; world w has sea w modulo this"
    )
    forced_edge: Literal["none", "west", "east", "south", "north"] = Field(
        "none", description="edge where the elevation is prescribed"
    )
    forcing: Literal["elevation", "incident"] = Field(
        "elevation",
        description="quantity prescribed there: the elevation, or the incoming wave, while outgoing waves leave",
    )
    radiating_edges: tuple[Side, ...] = Field(
        (), description="edges that long waves leave through; edges not named anywhere are reflecting walls"
    )
    regular_amplitude: float = Field(
        0.0, ge=0, le=30, description="amplitude of the regular wave or tide at the forced edge, m"
    )
    regular_period: float = Field(43200.0, ge=1, le=1e7, description="its period, s (Table 1's tide: 43200)")
    irregular_rms: Annotated[float, Field(ge=0, le=10)] | Literal["storm"] = Field(
        0.0,
        description="rms elevation of the irregular long waves at the forced edge, m, or that of the storm's"
        " infragravity waves",
    )
    irregular_components: int = Field(16, ge=1, le=256, description="number of their components, equal energy each")
    irregular_period_min: float = Field(75.0, ge=1, le=1e6, description="their shortest period, s")
    irregular_period_max: float = Field(300.0, ge=1, le=1e6, description="their longest period, s")

    def _problems(self) -> Iterator[str]:
        if self.irregular_period_max < self.irregular_period_min:
            yield _below("irregular_period", self.irregular_period_min, self.irregular_period_max)
        if self.forced_edge == "none" and (self.regular_amplitude > 0 or self.irregular_rms != 0):
            yield "forced_edge must name an edge when regular_amplitude or irregular_rms is above 0"
        named = [self.forced_edge, *self.radiating_edges]
        for side in dict.fromkeys(named):
            if named.count(side) > 1:
                yield f"forced_edge and radiating_edges must not name an edge twice: {side}"
        if self.manning > 0 and self.equations == "linear":
            yield f'manning = {self.manning:g}: needs equations = "nonlinear"; linear ones have drag'


class Storm(Section):
    """Short waves: a directional Airy sea on the long waves of `Sea`."""

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
        20.0, ge=0.1, le=1000, description="shortest wave length that moves and tilts a boat without boat.length, m"
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
    """The real bed, currents and waves, read from NetCDF files (`usvauv.env.site`)."""

    bathymetry: FileName = Field("", description="file with the depth of the bed; empty: flat at area.depth")
    currents: FileName = Field("", description="file with currents, added to the vortices; empty: none")
    waves: FileName = Field(
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
        """TOML has a type for times: an unquoted time becomes text."""
        return value.isoformat() if isinstance(value, date | datetime) else value


class Current(Section):
    """A uniform current, and superposed Lamb–Oseen vortices (Eq. 8)."""

    speed: float = Field(0.0, ge=0, le=20, description="speed of a uniform, steady current at the surface, m/s")
    direction: Direction = Field(0.0, description="direction that it flows to, from east towards north, rad")
    shear: float = Field(
        0.0,
        ge=0,
        le=1,
        description="its speed goes with the height over the mean bed to this power; 0: the same at all depths;"
        " tidal streams about 1/7",
    )
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
    mutual: bool = Field(False, description="vortices advect one another")
    period: float = Field(
        0.0,
        ge=0,
        le=1e5,
        description="period of the vortex pattern in x and y, m; 0: not periodic; below the area's longer side it"
        " repeats within the area",
    )
    decay_depth: float = Field(
        0.0, ge=0, le=1e5, description="depth at which vortices have 1/e of their speed at the surface, m; 0: the same"
    )

    def _problems(self) -> Iterator[str]:
        if self.circulation_max < self.circulation_min:
            yield _below("circulation", self.circulation_min, self.circulation_max)
        if self.core_radius_max < self.core_radius_min:
            yield _below("core_radius", self.core_radius_min, self.core_radius_max)
        if self.fastest + self.speed > FASTEST_WATER:
            yield (
                f"circulation_max = {self.circulation_max:g} at core_radius_min = {self.core_radius_min:g}: the"
                f" vortices together, with speed = {self.speed:g}, flow at up to {self.fastest + self.speed:.3g} m/s;"
                f" allowed are {FASTEST_WATER:g} m/s"
            )

    def uniform(self, depths: ArrayLike, bed: float) -> np.ndarray:
        """The uniform current at depths over a bed at a mean depth, m: (..., 2), m/s."""
        height = np.maximum(bed - np.asarray(depths, float), LEAST_HEIGHT)
        speed = self.speed * (height / bed) ** self.shear
        return speed[..., None] * [math.cos(self.direction), math.sin(self.direction)]

    @property
    def fastest(self) -> float:
        """Sum of the peak speeds of all vortices, at most `TOGETHER`, m/s."""
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
        description="standard deviation of the water's true speed of sound about the value used for fixes,"
        " constant in a mission, m/s",
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
    ambient_noise: Annotated[str, one_of(ambient_noise_laws)] = Field(
        "coates", description="law of the noise density: coates, or a plugin's law"
    )
    absorption: Annotated[str, one_of(absorption_laws)] = Field(
        "francois-garrison", description="law of absorption: thorp, francois-garrison, ainslie-mccolm, or a plugin's"
    )
    water_temperature: float = Field(10.0, ge=-2, le=35, description="temperature of the water in that law, °C")
    water_salinity: float = Field(35.0, ge=5, le=50, description="its salinity")
    ph: float = Field(8.0, ge=7.7, le=8.3, description="its pH")
    shipping: float = Field(0.5, ge=0, le=1, description="shipping activity in the noise, 0 to 1")
    wind: Annotated[float, Field(ge=0, le=60)] | Literal["storm"] = Field(
        "storm", description="wind speed in noise and bubbles, m/s, or that of the storm; without one 0"
    )
    bubbles: bool = Field(False, description="bubbles from the wind attenuate sound on its way to the array")
    rain: float = Field(0.0, ge=0, le=200, description="rain in the noise, mm/h")
    bandwidth: Bandwidth = Field(4000.0, description="bandwidth of the positioning link, Hz")
    noise_law: Literal["density", "demonstration"] = Field(
        "density",
        description="noise of a fix: by energy over noise density, or by the demonstration's 10^(−SNR/10)",
    )


class Usbl(Section):
    """Ultra-short baseline array and its estimator (Eq. 1)."""

    spacing: float = Field(0.033, ge=0.001, le=10, description="array spacing d, m")
    array_depth: float = Field(3.0, ge=0, le=50, description="depth of the array, for bubbles above it, m")
    carriers: tuple[Carrier, ...] = Field(
        (15000.0, 18000.0), min_length=1, max_length=MAX_AUVS, description="carrier of each AUV, Hz"
    )
    carrier_min: Carrier = Field(12000.0, description="carriers of further AUVs are spread from here ..., Hz")
    carrier_max: Carrier = Field(18000.0, description="... to here, Hz")
    signal: Literal["tone", "code"] = Field(
        "code", description="a tone, or a coded pulse of acoustics.bandwidth, which distinguishes AUVs"
    )
    periods: int = Field(10, ge=1, le=10000, description="length of a tone, carrier periods")
    pulse_length: float = Field(0.01, ge=1e-5, le=1, description="length of a coded pulse, s")
    sampling_rate: float = Field(2.016e6, ge=200, le=1e8, description="sampling rate, Hz")
    propagation: bool = Field(
        False, description="a fix gives the AUV's position when its sound left it, not its present one"
    )
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
    gnss_correlation_time: float = Field(60.0, ge=0.1, le=1e6, description="correlation time of that error, s")

    def _problems(self) -> Iterator[str]:
        if self.carrier_max < self.carrier_min:
            yield _below("carrier", self.carrier_min, self.carrier_max)
        highest = max(*self.carriers, self.carrier_max)
        if self.sampling_rate < 2 * highest:  # Nyquist
            least = 2 * highest
            yield f"sampling_rate = {self.sampling_rate:g}: must be at least two a period, {least:g} Hz"

    def carrier(self, auv: int, count: int) -> float:
        """Carrier of AUV number `auv` in a team of `count`, Hz: listed ones first, then evenly between the limits."""
        listed = len(self.carriers)
        if auv < listed:
            return self.carriers[auv]
        share = (auv - listed + 1) / (count - listed + 1)
        return self.carrier_min + share * (self.carrier_max - self.carrier_min)


class Channel(Section):
    """The single acoustic channel, in which boats interrogate AUVs in turn and AUVs reply."""

    schedule: Annotated[str, one_of(("every-step", "all", "slots"), schedules)] = Field(
        "every-step",
        description="every-step: fixes in each step at no cost; or exchanges that take time: with all AUVs, which reply"
        " at once (all) or in time slots by their estimated range (slots), with one AUV in turn (turns), or with the"
        " one that a plugin's schedule chooses",
    )
    turn_around: float = Field(
        0.1, ge=0, le=10, description="time from the interrogation to the transponder's reply, s"
    )
    interval: float = Field(
        0.0, ge=0, le=3600, description="least time from the beginning of an exchange to that of the next, s"
    )
    bit_rate: float = Field(
        0.0,
        ge=0,
        le=2e6,
        description="rate of data, bit/s, at least 1, or 0: they cost neither time nor energy, every interrogation is"
        " received and replies do not disturb one another; a bit needs the energy that it needs with nodes.rate_law ="
        " modem",
    )
    request_bits: int = Field(
        88, ge=0, le=10_000, description="data in an interrogation for each AUV that it addresses, bit"
    )
    reply_bits: int = Field(136, ge=0, le=10_000, description="data in a reply, bit")

    @property
    def priced(self) -> bool:
        """Whether data take time and energy."""
        return self.schedule != "every-step" and self.bit_rate > 0
