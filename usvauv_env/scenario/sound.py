"""Sections of a scenario about sound: what it meets, the array that hears it, the channel that all share."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from usvauv.env.scenario.fields import Bandwidth, Carrier, Number, Section, one_of
from usvauv.kernels.planning.information import MAX_AUVS
from usvauv.kernels.positioning.reflections import SEDIMENTS
from usvauv.kernels.positioning.sonar import absorption_laws, ambient_noise_laws


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
    bubbles: bool = Field(False, description="the wind's bubbles weaken what comes to the array")
    rain: float = Field(0.0, ge=0, le=200, description="rain in the noise, mm/h")
    multipath: bool = Field(
        False, description="the array also hears reflections of coded pulses from the surface and the bottom"
    )
    sediment: Annotated[str, one_of(SEDIMENTS)] = Field(
        "sand", description="of the bottom, for its reflections: clay, silt, sand, gravel, moraine"
    )
    bandwidth: Bandwidth = Field(4000.0, description="bandwidth of the positioning link, Hz")
    noise_law: Literal["density", "demonstration"] = Field(
        "density",
        description="noise of a fix: by energy over noise density, or by the demonstration's 10^(−SNR/10)",
    )


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
        "code", description="a tone, or a coded pulse of acoustics.bandwidth, which distinguishes AUVs"
    )
    periods: int = Field(10, ge=1, le=10000, description="length of a tone, carrier periods")
    pulse_length: float = Field(0.01, ge=1e-5, le=1, description="length of a coded pulse, s")
    sampling_rate: float = Field(2.016e6, ge=200, le=1e8, description="sampling rate, Hz")
    model: Literal["statistical", "waveform"] = Field(
        "statistical", description="fixes drawn from their distribution, or measured from sampled signals in noise"
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
