"""Ultra-short baseline positioning: the statistical model of a fix (Eq. 1) and its covariance.

Four hydrophones stand at ±d/2 on the boat's two axes. For an AUV at r = (x', y', z') in the array's frame and at the
slant range S = |r| they measure

    Δφ_x = 2πf d x'/(c S) + n_x,  Δφ_y = 2πf d y'/(c S) + n_y,  n ~ N(0, σ²),   Ŝ = S + n_S,
    x̂' = c Ŝ Δφ_x/(2πf d),  ŷ' likewise,  ẑ' = −√(Ŝ² − x̂'² − ŷ'²).

Noise. A tone of N = periods · f_s/f samples in noise of relative amplitude σ_n has the phase variance 2σ_n²/N on one
hydrophone (Cramér–Rao bound at known frequency: Kay, "Estimation Theory" (1993), §3.11), a difference of two has
σ² = 4σ_n²/N. σ_n is 10^(−SNR/20), or the demonstration's 10^(−SNR/10), at the SNR of the true slant range. The delay
is that of a correlator locked to the carrier: the mean phase of the four hydrophones, of variance σ²/8 and independent
of both differences, divided by 2πf. An echo's path is travelled twice, which halves the range error.

Validity. With a² = 2/σ², the tone's energy over the noise on one hydrophone, the four hydrophones together measure the
amplitude R = 2a + 7/(4a) + n (a noncentral χ of 8 degrees of freedom, to 1e-3), and their phases scatter with σ² 2a/R.
A fix is DETECTED where R² is at least 8 + 4 · PERIOD_ENERGY · periods: above it the correlator's choice among the
carrier's cycles is right in all but about one of a million fixes and phases are Gaussian, below it one or the other
fails and the fix should not be used. A fix has WRAPPED where a phase difference has left (−π, π], as it can with d near
half a wavelength or above, and has NO_DEPTH where x̂'² + ŷ'² > Ŝ², as it can near the horizon. It is good where its
flags are DETECTED and nothing else. `kernels.positioning.waveform` measures sampled tones instead;
`docs/positioning.md` compares both.

Residual. Of phases p on four hydrophones with the variance σ²/2 each, (p_3 + p_4)/2 − (p_1 + p_2)/2 is independent of
both differences and of the mean, and has the variance σ²/2. The receiver adds half a measured difference to p_1 and
p_3, so every turn that a difference lacks moves its pair's mean by π: modulo 2π the residual is normal about π (m + n),
m and n being the turns lacking on the axes. A fix where it exceeds π/2 is AMBIGUOUS: an odd number of turns is missing.

Attitude. The array is tilted by the surface slopes (pitch = atan ∂η/∂x, then roll about the pitched axis; heading is
known). The fix is rotated back with the attitude measured, which is wrong by a residual error in pitch and roll.
"""
# pyright: reportOptionalCall=false
# (what Taichi's operations return is an expression only while a kernel is compiled)

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import taichi as ti
import torch

from kernels.positioning import sonar_equation
from kernels.positioning.ambient_noise import NoiseLaw, coates
from kernels.types import array2, index1, mat3, vec2, vec3, vec4, vec5

# Columns of the link table, one row an AUV.
KAPPA = 0  # 2πf d/c, phase difference per direction cosine, rad
SNR_AT_1M = 1  # SL − NL (+ TS for an echo), dB
PATHS = 2  # times the transmission loss counts: 1 transponder, 2 echo
ABSORPTION = 3  # dB/km
NOISE_EXPONENT = 4  # σ_n² = 10^(−exponent · SNR/10): 1, or 2 for the demonstration's law
SAMPLES = 5  # N
RANGE_PER_PHASE = 6  # c/(2πf), halved for an echo, m/rad
PERIODS = 7  # length of the tone in periods of its carrier
LEVEL = 8  # the planner's information of one AUV at q = S², 1/m²: ln T = LEVEL − POWER ln(q/S_0²) − DECAY (√q − S_0)
POWER = 9
DECAY = 10
REFERENCE = 11  # S_0, m; near the ranges that occur, or single precision loses digits
ATTITUDE = 12  # ε², square of the attitude error in the planner's information, rad²
COLUMNS = 13

# Bits of a fix's flags.
DETECTED = 1  # the tone is above the detection threshold; known to the receiver
WRAPPED = 2  # a phase difference is wrong by whole turns; known to the simulation
NO_DEPTH = 4  # the direction measured has no real depth; known to the receiver
NO_RAY = 8  # no direct ray of sound leads from the AUV to the array: nothing is received
LOST = 16  # interrogation or reply was lost
AMBIGUOUS = 32  # turns are missing, or may be, and what the receiver expects does not tell which; known to the receiver
REJECTED = 64  # too far from where the AUV is expected; known to the receiver
FLAGS = 127  # all of them
UNUSABLE = NO_DEPTH | NO_RAY | LOST | AMBIGUOUS | REJECTED  # the receiver does not use such a fix

LARGEST_DEVIATION = 1e3  # rad; nothing is detected long before, and squares of lengths stay within single precision
PERIOD_ENERGY = 25.0  # least energy of one carrier period on one hydrophone over the noise variance, 14 dB


@dataclass(frozen=True)
class Sonar:
    """Acoustics of the array and the AUVs' transponders or echoes, and what the planner supposes of them.

    Attributes:
        sound_speed: c, m/s.
        source_level: dB re 1 µPa at 1 m.
        target_strength: of an AUV, dB; counts for an echo.
        path: "echo" or "transponder".
        ambient_noise: law of the noise density, see `kernels.positioning.ambient_noise`.
        shipping, wind: arguments of that law, 0 to 1 and m/s.
        bandwidth: of the receiver, Hz.
        noise_law: "amplitude", σ_n = 10^(−SNR/20), or "demonstration", σ_n = 10^(−SNR/10).
        spacing: d, m.
        periods: length of the tone in periods of its carrier.
        sampling_rate: f_s, Hz.
        planner_noise: "range", the planner's σ grows with range as the real one does, or "constant", it is that of the
            slant range `reference_range` everywhere. The fixes themselves always have the real one.
        reference_range: m, at least 1; a slant range typical for the task, for example the AUVs' depth.
        attitude_error: ε in the planner's information, rad.

    Raises:
        ValueError: unknown path, noise law or planner noise.
    """

    sound_speed: float = 1500.0
    source_level: float = 135.0
    target_strength: float = 3.0
    path: str = "echo"
    ambient_noise: NoiseLaw = coates
    shipping: float = 0.5
    wind: float = 0.0
    bandwidth: float = 1000.0
    noise_law: str = "amplitude"
    spacing: float = 0.033
    periods: float = 10.0
    sampling_rate: float = 2.016e6
    planner_noise: str = "range"
    reference_range: float = 100.0
    attitude_error: float = 0.0

    def __post_init__(self) -> None:
        for name, allowed in (
            ("path", ("echo", "transponder")),
            ("noise_law", ("amplitude", "demonstration")),
            ("planner_noise", ("range", "constant")),
        ):
            if getattr(self, name) not in allowed:
                raise ValueError(f"{name}: {getattr(self, name)!r} is not one of {', '.join(allowed)}")


def link_table(carriers: Sequence[float], sonar: Sonar) -> np.ndarray:
    """Constants of every AUV's acoustic link, (K, COLUMNS) float32, for the carrier frequencies f of K AUVs, Hz."""
    s = sonar
    paths = 2 if s.path == "echo" else 1
    exponent = 1 if s.noise_law == "amplitude" else 2
    table = np.zeros((len(carriers), COLUMNS))
    for row, f in zip(table, carriers, strict=True):
        alpha = sonar_equation.absorption(f)
        noise = sonar_equation.noise_level(s.ambient_noise(f, s.shipping, s.wind), s.bandwidth)
        row[KAPPA] = 2.0 * math.pi * f * s.spacing / s.sound_speed
        row[SNR_AT_1M] = s.source_level - noise
        row[SNR_AT_1M] += s.target_strength if s.path == "echo" else 0.0
        row[PATHS] = paths
        row[ABSORPTION] = alpha
        row[NOISE_EXPONENT] = exponent
        row[SAMPLES] = s.periods * s.sampling_rate / f
        row[RANGE_PER_PHASE] = s.sound_speed / (2.0 * math.pi * f) / paths
        row[PERIODS] = s.periods
        # T = κ²/(σ² q) with σ² = 4/N · 10^(−exponent · SNR/10) and SNR = SNR(1 m) − paths · (15 log10 S + α S/1000).
        snr = row[SNR_AT_1M] - paths * sonar_equation.transmission_loss(s.reference_range, f)
        row[LEVEL] = math.log(row[KAPPA] ** 2 * row[SAMPLES] / 4.0 / s.reference_range**2)
        row[LEVEL] += exponent * snr * sonar_equation.LN10 / 10.0
        row[POWER] = 1.0 + 0.75 * exponent * paths if s.planner_noise == "range" else 1.0
        row[DECAY] = exponent * paths * alpha * sonar_equation.LN10 / 1e4 if s.planner_noise == "range" else 0.0
        row[REFERENCE] = s.reference_range
        row[ATTITUDE] = s.attitude_error**2
    return table.astype(np.float32)


@ti.dataclass
class Measurement:
    """What the receiver measures of a tone."""

    phase: vec2  # phase differences, unwrapped, rad
    residual: ti.f32  # mean phase by the y pair minus that by the x pair, modulo one turn, rad
    slant_range: ti.f32  # m
    amplitude: ti.f32  # of the tone over the noise, all hydrophones together
    sigma: ti.f32  # standard deviation of a phase difference, rad


@ti.dataclass
class Direction:
    """The direction that follows from measured phases."""

    vector: vec3  # in the world's frame
    flags: ti.i32  # of the fix


@ti.func
def phase_deviation(link: ti.template(), k: ti.i32, S: ti.f32) -> ti.f32:
    """Standard deviation σ (rad) of a phase difference of AUV k at the slant range S (m); bounded."""
    R = ti.max(S, 1.0)
    snr = link[k, SNR_AT_1M] - link[k, PATHS] * (15.0 * sonar_equation.log10(R) + link[k, ABSORPTION] * R / 1000.0)
    sigma = 2.0 * sonar_equation.power_of_10(-0.05 * link[k, NOISE_EXPONENT] * snr) / ti.sqrt(link[k, SAMPLES])
    return ti.min(sigma, LARGEST_DEVIATION)


@ti.func
def range_deviation(link: ti.template(), k: ti.i32, sigma: ti.f32) -> ti.f32:
    """Standard deviation (m) of the slant range Ŝ where phase differences have the standard deviation σ (rad)."""
    # A hydrophone's phase has half the variance of a difference, the mean of four a quarter of that.
    return link[k, RANGE_PER_PHASE] * sigma * 0.3535533905932738


@ti.func
def attitude(slope: vec2) -> vec2:
    """Pitch and roll (rad) of an array lying on a surface with the slopes (∂η/∂x, ∂η/∂y)."""
    pitch = ti.atan2(slope[0], 1.0)
    return vec2(pitch, ti.atan2(slope[1] * ti.cos(pitch), 1.0))


@ti.func
def array_axes(angles: vec2) -> mat3:
    """The array's axes in the world's frame, one a row: forward, left, up; `angles` are pitch and roll (rad)."""
    ct = ti.cos(angles[0])
    st = ti.sin(angles[0])
    cp = ti.cos(angles[1])
    sp = ti.sin(angles[1])
    return mat3([[ct, 0.0, st], [-sp * st, cp, sp * ct], [-cp * st, -sp, cp * ct]])


@ti.func
def wrap(phase: ti.f32) -> ti.f32:
    """A phase (rad) modulo one turn, in [−π, π]."""
    return phase - 6.283185307179586 * ti.round(phase * 0.15915494309189535)


@ti.func
def odd_turns(residual: ti.f32) -> ti.i32:
    """1 where the residual (rad) says that the phase differences lack an odd number of turns together, else 0."""
    return ti.cast(ti.abs(residual) > 0.5 * math.pi, ti.i32)


@ti.func
def usable(flags: ti.i32):
    """Whether the receiver uses a fix with such flags."""
    return (flags & (DETECTED | UNUSABLE)) == DETECTED


@ti.func
def detection_threshold(link: ti.template(), k: ti.i32) -> ti.f32:
    """Least amplitude R over the noise, all hydrophones together, at which a tone of AUV k counts as detected."""
    return ti.sqrt(8.0 + 4.0 * PERIOD_ENERGY * link[k, PERIODS])


@ti.func
def measure(
    link: ti.template(), k: ti.i32, body: vec3, S: ti.f32, path: ti.f32, noise: vec4, residual_noise: ti.f32
) -> Measurement:
    """Measurement of a tone of AUV k by the statistical model.

    Args:
        link: link table, (K, COLUMNS).
        body: direction towards the AUV in the array's frame, a unit vector where rays are straight.
        S: slant range, m, for the SNR. path: slant range by the delay, m.
        noise: independent standard normal numbers for the two phases, the range and the amplitude.
        residual_noise: another one, for the residual.
    """
    sigma = phase_deviation(link, k, S)
    # The stronger a tone happens to be, the better its phases; bounded below, where no tone is detected.
    strength = 2.8284271247461903 / sigma
    scatter = sigma * ti.sqrt(strength / ti.max(strength + noise[3], 0.5 * strength))
    x = link[k, KAPPA] * body[0] + scatter * noise[0]
    y = link[k, KAPPA] * body[1] + scatter * noise[1]
    turns = ti.round(x * 0.15915494309189535) + ti.round(y * 0.15915494309189535)
    return Measurement(
        phase=vec2(x, y),
        residual=wrap(math.pi * turns + 0.7071067811865476 * scatter * residual_noise),
        slant_range=path + range_deviation(link, k, scatter) * noise[2],
        amplitude=strength + 3.5 / strength + noise[3],
        sigma=sigma,
    )


@ti.func
def located(
    link: ti.template(), k: ti.i32, true_phase: vec2, phase: vec2, amplitude: ti.f32, axes: mat3, length: ti.f32
) -> Direction:
    """The direction that follows from measured phases, and the flags of the fix.

    Args:
        link: link table, (K, COLUMNS).
        true_phase, phase: phase differences (rad) of the true direction, unwrapped, and as measured.
        amplitude: measured amplitude of the tone over the noise, all hydrophones together.
        axes: the array's axes as measured, see `array_axes`.
        length: of the direction; 1 where the speed of sound at the array is that of κ.
    """
    flags = 0
    if amplitude >= detection_threshold(link, k):
        flags = flags | DETECTED
    # Without a wrap the error stays within (−π, π).
    if ti.abs(phase - true_phase).max() > math.pi:
        flags = flags | WRAPPED
    x = phase[0] / link[k, KAPPA]
    y = phase[1] / link[k, KAPPA]
    zz = length * length - x * x - y * y
    if zz < 0.0:
        flags = flags | NO_DEPTH
    r = axes.transpose() @ vec3(x, y, -ti.sqrt(ti.max(zz, 0.0)))
    return Direction(vector=r, flags=flags)


@ti.func
def fix(
    link: ti.template(), k: ti.i32, offset: vec3, slope: vec2, attitude_error: ti.f32, noise: vec4, further_noise: vec3
) -> vec5:
    """One fix of AUV k where rays are straight: the estimated offset from boat to AUV (m), σ (rad), and the flags.

    Args:
        link: link table, (K, COLUMNS).
        offset: true position of the AUV minus that of the wave-borne boat, m; below the boat z is negative.
        slope: surface slopes (∂η/∂x, ∂η/∂y) under the boat; zero for an array that stays level.
        attitude_error: standard deviation of the error of measured pitch and roll, rad.
        noise: as in `measure`. further_noise: standard normal numbers for pitch, roll and the residual.
    """
    S = ti.max(offset.norm(), 1e-3)
    angles = attitude(slope)
    body = array_axes(angles) @ offset / S
    measured = measure(link, k, body, S, S, noise, further_noise[2])
    axes = array_axes(angles + attitude_error * vec2(further_noise[0], further_noise[1]))
    true_phase = link[k, KAPPA] * vec2(body[0], body[1])
    phase = vec2(wrap(measured.phase[0]), wrap(measured.phase[1]))
    found = located(link, k, true_phase, phase, measured.amplitude, axes, 1.0)
    flags = found.flags | AMBIGUOUS * odd_turns(measured.residual)
    r = measured.slant_range * found.vector
    return vec5(r[0], r[1], r[2], measured.sigma, ti.cast(flags, ti.f32))


@ti.func
def horizontal_covariance(
    link: ti.template(), k: ti.i32, offset: vec3, axes: mat3, attitude_error: ti.f32, sigma: ti.f32
) -> vec3:
    """Covariance (xx, xy, yy) in m² of the horizontal part of a fix, to first order in the noise.

    For a level array it is S²σ²/κ² I + σ_S² d dᵀ/S² + ε² z² I with the horizontal offset d, the standard deviations
    σ_S of the range and ε of the attitude. `axes` are the array's, other arguments as for `fix`; a level array must not
    have the AUV at its own height.
    """
    S = ti.max(offset.norm(), 1e-3)
    body = axes @ offset
    # Where the array is tilted, an error of x' moves z' = −√(S² − x'² − y'²), which leaks into the horizontal.
    depth = ti.min(body[2], -1e-3 * S)
    across = S * sigma / link[k, KAPPA]
    along = range_deviation(link, k, sigma) / S
    px = across * (axes[0, 0] - body[0] / depth * axes[2, 0])
    py = across * (axes[0, 1] - body[0] / depth * axes[2, 1])
    qx = across * (axes[1, 0] - body[1] / depth * axes[2, 0])
    qy = across * (axes[1, 1] - body[1] / depth * axes[2, 1])
    rx = along * offset[0]
    ry = along * offset[1]
    # An error of pitch turns the offset about the world's y axis, one of roll about the array's forward axis.
    pitch = attitude_error * offset[2]
    roll_x = attitude_error * axes[0, 2] * offset[1]
    roll_y = attitude_error * (axes[0, 0] * offset[2] - axes[0, 2] * offset[0])
    return vec3(
        px * px + qx * qx + rx * rx + pitch * pitch + roll_x * roll_x,
        px * py + qx * qy + rx * ry + roll_x * roll_y,
        py * py + qy * qy + ry * ry + roll_y * roll_y,
    )


@ti.kernel
def _fixes(
    link: array2,
    auv: index1,
    offset: array2,
    slope: array2,
    attitude_error: ti.f32,
    noise: array2,
    estimate: array2,
    covariance: array2,
    flags: index1,
):
    for i in range(offset.shape[0]):
        r = vec3(offset[i, 0], offset[i, 1], offset[i, 2])
        s = vec2(slope[i, 0], slope[i, 1])
        k = auv[i]
        signal = vec4(noise[i, 0], noise[i, 1], noise[i, 2], 0.0)
        further = vec3(noise[i, 3], noise[i, 4], 0.0)
        if noise.shape[1] > 5:
            signal[3] = noise[i, 5]
        if noise.shape[1] > 6:
            further[2] = noise[i, 6]
        f = fix(link, k, r, s, attitude_error, signal, further)
        C = horizontal_covariance(link, k, r, array_axes(attitude(s)), attitude_error, f[3])
        for j in ti.static(range(4)):
            estimate[i, j] = f[j]
        for j in ti.static(range(3)):
            covariance[i, j] = C[j]
        flags[i] = ti.cast(f[4], ti.i32)


def flagged_fixes(
    link: torch.Tensor,
    auv: torch.Tensor,
    offset: torch.Tensor,
    slope: torch.Tensor,
    attitude_error: float,
    noise: torch.Tensor,
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Many fixes, see `fix`.

    Args:
        link: (K, COLUMNS) float32, from `link_table`.
        auv: (n,) int32, row of the table for each fix.
        offset: (n, 3) float32, true offset from boat to AUV, m.
        slope: (n, 2) float32, surface slopes.
        attitude_error: rad.
        noise: (n, 7) float32 standard normal numbers: two phases, range, pitch, roll, amplitude, residual; numbers that
            are missing at the end count as 0, with (n, 5) every tone has its expected amplitude.

    Returns:
        (n, 4) estimated offset (m) and σ (rad); (n, 3) predicted horizontal covariance (xx, xy, yy), m²; (n,) int32
        flags, see DETECTED, WRAPPED, NO_DEPTH and AMBIGUOUS.
    """
    estimate = torch.empty((offset.shape[0], 4), dtype=torch.float32, device=offset.device)
    covariance = torch.empty((offset.shape[0], 3), dtype=torch.float32, device=offset.device)
    flags = torch.empty(offset.shape[0], dtype=torch.int32, device=offset.device)
    _fixes(link, auv, offset, slope, attitude_error, noise, estimate, covariance, flags)
    return estimate, covariance, flags


def fixes(
    link: torch.Tensor,
    auv: torch.Tensor,
    offset: torch.Tensor,
    slope: torch.Tensor,
    attitude_error: float,
    noise: torch.Tensor,
) -> tuple[torch.Tensor, torch.Tensor]:
    """`flagged_fixes` without the flags."""
    return flagged_fixes(link, auv, offset, slope, attitude_error, noise)[:2]
