"""Ultra-short baseline positioning: the statistical model of a fix (Eq. 1) and its covariance.

Four hydrophones stand at ±d/2 on the boat's two axes. For an AUV at r = (x', y', z') in the array's frame and at the
slant range S = |r| they measure

    Δφ_x = 2πf d x'/(c S) + n_x,  Δφ_y = 2πf d y'/(c S) + n_y,  n ~ N(0, σ²),   Ŝ = S + n_S,
    x̂' = c Ŝ Δφ_x/(2πf d),  ŷ' likewise,  ẑ' = −√(Ŝ² − x̂'² − ŷ'²).

`usvauv.kernels.positioning.acoustic_link` has σ and the deviation of the range, which is independent of both
differences.

Validity. With a² = 2/σ² the four hydrophones together measure the amplitude R = √(4a² + 7) + n over the noise (a
noncentral χ of 8 degrees of freedom, to 3e-3 where signals are detected), and their phases scatter with σ² 2a/R. A fix
is DETECTED where R is above the link's threshold. It has WRAPPED where a phase difference has left (−π, π], as it can
with d near half a wavelength or above, and has NO_DEPTH where x̂'² + ŷ'² > Ŝ², as it can near the horizon. It is good
where its flags are DETECTED and nothing else.

Residual. Of phases p on four hydrophones with the variance σ²/2 each, (p_3 + p_4)/2 − (p_1 + p_2)/2 is independent of
both differences and of the mean, and has the variance σ²/2. The receiver adds half a measured difference to p_1 and
p_3, so every turn that a difference lacks moves its pair's mean by π: modulo 2π the residual is normal about π (m + n),
m and n being the turns lacking on the axes. A fix where it exceeds π/2 is AMBIGUOUS: an odd number of turns is missing.

Attitude. The array is tilted by the surface slopes (pitch = atan ∂η/∂x, then roll about the pitched axis; heading is
known). The fix is rotated back with the attitude measured, which is wrong by a residual error in pitch and roll.

Gate. An innovation ν with the covariance P + R has νᵀ(P + R)⁻¹ν distributed as χ² of two degrees of freedom, beyond
GATE with the probability e^(−GATE/2) = 10⁻³. Without a tracker the AUV can have moved by `reach` from its last estimate
in any direction; only the part of ν beyond that counts.

Turns. A phase difference is measured modulo 2π and taken as it is, in [−π, π]. Noise can wrap it, and with κ > π, an
array wider than half a wavelength, so do directions far from the vertical. Where an odd number of turns is missing the
residual tells, and the fix is not used. Where one is missing on each axis nothing tells but the gate: for AUVs to all
sides d has to be at most half a wavelength.

Sources: Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to Tracking and Navigation" (2001), doi
10.1002/0471221279, §5.4 (normalised innovation squared); Bar-Shalom and Fortmann, "Tracking and Data Association"
(1988), §4 (validation gate).
"""
# pyright: reportOptionalCall=false
# (what Taichi's operations return is an expression only while a kernel is compiled)

import math
from typing import Any

import numpy as np
import taichi as ti
import torch

from usvauv.kernels.functions import func, kernel
from usvauv.kernels.positioning.acoustic_link import (
    ALIGNMENT,
    ATTITUDE,
    HEADING,
    KAPPA,
    POSITION,
    SOUND_SPEED,
    THRESHOLD,
    detection_threshold,
    phase_deviation,
    range_deviation,
)
from usvauv.kernels.positioning.sonar import magnitude
from usvauv.kernels.transcendental import circle
from usvauv.kernels.types import array2, index1, mat2, mat3, select, vec2, vec3, vec4, vec5

GATE = -2.0 * math.log(1e-3)

# Bits of a fix's flags.
DETECTED = 1  # the tone is above the detection threshold; known to the receiver
WRAPPED = 2  # a phase difference is wrong by whole turns; known to the simulation
NO_DEPTH = 4  # the direction measured has no real depth; known to the receiver
NO_RAY = 8  # no direct ray of sound leads from the AUV to the array: nothing is received
LOST = 16  # interrogation or reply was lost
AMBIGUOUS = 32  # an odd number of turns is missing, or the direction is none; known to the receiver
REJECTED = 64  # too far from where the AUV is expected; known to the receiver
SILENT = 128  # no reply was due
FLAGS = 255  # all of them
UNUSABLE = NO_DEPTH | NO_RAY | LOST | AMBIGUOUS | REJECTED  # the receiver does not use such a fix


class Axes(tuple[Any, ...]):
    """Rows of a rotation side by side, nine numbers or vectors, indexed as a matrix is."""

    __slots__ = ()

    def __getitem__(self, indices: Any) -> Any:
        """Taichi calls it for `axes[row, column]`."""
        row, column = indices
        return tuple.__getitem__(self, 3 * row + column)


@func
def attitude(slope):
    """Cosine and sine of pitch and of roll of an array lying on a surface with the slopes (∂η/∂x, ∂η/∂y)."""
    ct = 1.0 / ti.sqrt(1.0 + slope[0] * slope[0])
    tangent = slope[1] * ct
    cp = 1.0 / ti.sqrt(1.0 + tangent * tangent)
    return ct, slope[0] * ct, cp, tangent * cp


@func
def tilted(angles, error):
    """Cosine and sine of pitch and of roll that are measured with errors (rad)."""
    by_pitch, by_roll = circle(error[0]), circle(error[1])
    return (
        angles[0] * by_pitch[0] - angles[1] * by_pitch[1],
        angles[1] * by_pitch[0] + angles[0] * by_pitch[1],
        angles[2] * by_roll[0] - angles[3] * by_roll[1],
        angles[3] * by_roll[0] + angles[2] * by_roll[1],
    )


@func
def axis_numbers(angles):
    """Numbers of the array's axes in the world's frame, for `Axes`: forward, left, up; `angles` as of `attitude`."""
    ct, st, cp, sp = angles[0], angles[1], angles[2], angles[3]
    zero = 0.0 * ct
    return ct, zero, st, 0.0 - sp * st, cp, sp * ct, 0.0 - cp * st, 0.0 - sp, cp * ct


@func
def turned_numbers(axes: ti.template(), by):
    """Numbers of the array's axes after a turn by an angle, cosine and sine of which are given (anticlockwise)."""
    return (
        axes[0, 0] * by[0] - axes[0, 1] * by[1],
        axes[0, 0] * by[1] + axes[0, 1] * by[0],
        axes[0, 2],
        axes[1, 0] * by[0] - axes[1, 1] * by[1],
        axes[1, 0] * by[1] + axes[1, 1] * by[0],
        axes[1, 2],
        axes[2, 0] * by[0] - axes[2, 1] * by[1],
        axes[2, 0] * by[1] + axes[2, 1] * by[0],
        axes[2, 2],
    )


@func
def array_axes(angles) -> mat3:
    """The array's axes in the world's frame, one a row: forward, left, up; `angles` as of `attitude`."""
    numbers = axis_numbers(angles)
    return mat3([[numbers[3 * row + column] for column in ti.static(range(3))] for row in ti.static(range(3))])


@func
def wrap(phase):
    """A phase (rad) modulo one turn, in [−π, π]."""
    return phase - 6.283185307179586 * ti.floor(phase * 0.15915494309189535 + 0.5)


@func
def length(v):
    """Length of a vector of three numbers."""
    return ti.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@func
def odd_turns(residual: ti.f32) -> ti.i32:
    """1 where the residual (rad) says that the phase differences lack an odd number of turns together, else 0."""
    return ti.cast(ti.abs(residual) > 0.5 * math.pi, ti.i32)


@func
def usable(flags: ti.i32):
    """Whether the receiver uses a fix with such flags."""
    return (flags & (DETECTED | UNUSABLE)) == DETECTED


@func
def measure(link: ti.template(), k, body, path, sigma, noise, residual_noise):
    """Phase differences, unwrapped, residual, slant range and amplitude over the noise of a signal of AUV k.

    The residual is the mean phase by the y pair minus that by the x pair, rad, modulo one turn; the amplitude is that
    of all hydrophones together. For numbers and for vectors of several AUVs.

    Args:
        link: link table, (K, COLUMNS).
        body: direction towards the AUV in the array's frame, a unit vector where rays are straight.
        path: slant range by the delay, m. sigma: expected standard deviation of a phase difference, rad.
        noise: independent standard normal numbers for the two phases, the range and the amplitude.
        residual_noise: another one, for the residual.
    """
    # The stronger a tone happens to be, the better its phases; bounded below, where no tone is detected.
    strength = 2.8284271247461903 / sigma
    happens = strength + noise[3]
    scatter = sigma * ti.sqrt(strength / select(happens > 0.5 * strength, happens, 0.5 * strength))
    x = link[k, KAPPA] * body[0] + scatter * noise[0]
    y = link[k, KAPPA] * body[1] + scatter * noise[1]
    turns = ti.floor(x * 0.15915494309189535 + 0.5) + ti.floor(y * 0.15915494309189535 + 0.5)
    residual = wrap(math.pi * turns + 0.7071067811865476 * scatter * residual_noise)
    slant_range = path + range_deviation(link, k, scatter) * noise[2]
    return x, y, residual, slant_range, ti.sqrt(strength * strength + 7.0) + noise[3]


@func
def located(link: ti.template(), k, true_phase, phase, amplitude, axes: ti.template(), scale):
    """The direction that follows from measured phases, three numbers, and the flags of the fix.

    For numbers and for vectors of several AUVs; flags are whole numbers in floating point.

    Args:
        link: link table, (K, COLUMNS).
        true_phase, phase: phase differences (rad) of the true direction, unwrapped, and as measured.
        amplitude: measured amplitude of the tone over the noise, all hydrophones together.
        axes: the array's axes as measured, see `array_axes`.
        scale: length of the direction; 1 where the speed of sound at the array is that of κ.
    """
    kappa = link[k, KAPPA]
    x = phase[0] / kappa
    y = phase[1] / kappa
    zz = scale * scale - x * x - y * y
    flags = select(amplitude >= detection_threshold(link, k), ti.static(float(DETECTED)), 0.0)
    # Without a wrap the error stays within (−π, π).
    error_x, error_y = magnitude(phase[0] - true_phase[0]), magnitude(phase[1] - true_phase[1])
    flags += select(select(error_x > error_y, error_x, error_y) > math.pi, ti.static(float(WRAPPED)), 0.0)
    flags += select(zz < 0.0, ti.static(float(NO_DEPTH)), 0.0)
    z = 0.0 - ti.sqrt(select(zz > 0.0, zz, 0.0))
    return (
        axes[0, 0] * x + axes[1, 0] * y + axes[2, 0] * z,
        axes[0, 1] * x + axes[1, 1] * y + axes[2, 1] * z,
        axes[0, 2] * x + axes[1, 2] * y + axes[2, 2] * z,
        flags,
    )


@func
def fix(link: ti.template(), k: ti.i32, offset: vec3, slope: vec2, noise: vec4, further_noise: vec3) -> vec5:
    """One fix of AUV k where rays are straight: the estimated offset from boat to AUV (m), σ (rad), and the flags.

    Args:
        link: link table, (K, COLUMNS).
        offset: true position of the AUV minus that of the wave-borne boat, m; below the boat z is negative.
        slope: surface slopes (∂η/∂x, ∂η/∂y) under the boat; zero for an array that stays level.
        noise: as in `measure`. further_noise: standard normal numbers for pitch, roll and the residual.
    """
    S = ti.max(offset.norm(), 1e-3)
    angles = attitude(slope)
    body = array_axes(angles) @ offset / S
    sigma = phase_deviation(link, k, S, offset[2], 1.0)
    x, y, residual, slant_range, amplitude = measure(link, k, body, S, sigma, noise, further_noise[2])
    axes = array_axes(tilted(angles, ti.sqrt(link[k, ATTITUDE]) * vec2(further_noise[0], further_noise[1])))
    true_phase = link[k, KAPPA] * vec2(body[0], body[1])
    found = located(link, k, true_phase, (wrap(x), wrap(y)), amplitude, axes, 1.0)
    flags = ti.cast(found[3], ti.i32) | AMBIGUOUS * odd_turns(residual)
    r = slant_range * vec3(found[0], found[1], found[2])
    return vec5(r[0], r[1], r[2], sigma, ti.cast(flags, ti.f32))


@func
def in_frame(axes: ti.template(), v):
    """Components of a vector along the axes, three numbers."""
    return (
        axes[0, 0] * v[0] + axes[0, 1] * v[1] + axes[0, 2] * v[2],
        axes[1, 0] * v[0] + axes[1, 1] * v[1] + axes[1, 2] * v[2],
        axes[2, 0] * v[0] + axes[2, 1] * v[1] + axes[2, 2] * v[2],
    )


@func
def leaning(z, S):
    """−x'/z' per x': how far an error across the array's axis moves z' = −√(S² − x'² − y'²), bounded at the horizon."""
    bound = -1e-3 * S
    return 1.0 / select(z < bound, z, bound)


@func
def attitude_covariance(variance, offset, axes: ti.template()):
    """Covariance (xx, xy, yy), m², of the horizontal part of a fix by errors of pitch and roll of a variance (rad²)."""
    # An error of pitch turns the offset about the world's y axis, one of roll about the array's forward axis.
    pitch = offset[2]
    roll_x = axes[0, 2] * offset[1]
    roll_y = axes[0, 0] * offset[2] - axes[0, 2] * offset[0]
    return variance * (pitch * pitch + roll_x * roll_x), variance * roll_x * roll_y, variance * roll_y * roll_y


@func
def fix_covariance(link: ti.template(), k, offset, axes: ti.template(), sigma):
    """Covariance xx, xy, yy in m² of the horizontal part of a fix by the errors that are new in each, to first order.

    For a level array it is S²σ²/κ² I + σ_S² d dᵀ/S² + ε² z² I with the horizontal offset d, the standard deviations
    σ_S of the range and ε of the attitude. `axes` are the array's, other arguments as for `fix`; a level array must not
    have the AUV at its own height. For numbers and for vectors of several AUVs.
    """
    far = length(offset)
    S = select(far > 1e-3, far, 1e-3)
    body = in_frame(axes, offset)
    lean = leaning(body[2], S)
    across = S * sigma / link[k, KAPPA]
    along = range_deviation(link, k, sigma) / S
    px = across * (axes[0, 0] - body[0] * lean * axes[2, 0])
    py = across * (axes[0, 1] - body[0] * lean * axes[2, 1])
    qx = across * (axes[1, 0] - body[1] * lean * axes[2, 0])
    qy = across * (axes[1, 1] - body[1] * lean * axes[2, 1])
    rx = along * offset[0]
    ry = along * offset[1]
    by_attitude = attitude_covariance(link[k, ATTITUDE], offset, axes)
    return (
        px * px + qx * qx + rx * rx + by_attitude[0],
        px * py + qx * qy + rx * ry + by_attitude[1],
        py * py + qy * qy + ry * ry + by_attitude[2],
    )


@func
def horizontal_covariance(link: ti.template(), k: ti.i32, offset: vec3, axes: mat3, sigma: ti.f32) -> vec3:
    """`fix_covariance` as a vector."""
    C = fix_covariance(link, k, offset, axes, sigma)
    return vec3(C[0], C[1], C[2])


@func
def common_covariance(link: ti.template(), k, offset, axes: ti.template()):
    """Covariance xx, xy, yy in m² of the errors that a fix has in common with those before and after it.

    For a level array it is ε² z² I + ε_h² n nᵀ + (2 σ_c/c)² d dᵀ + σ_p² I with the horizontal offset d, n the vector d
    turned by a right angle, and the standard deviations of alignment, heading, speed of sound and position. For numbers
    and for vectors of several AUVs.
    """
    body = in_frame(axes, offset)
    far = length(offset)
    lean = leaning(body[2], select(far > 1e-3, far, 1e-3))
    # The speed of sound is a factor on the range and another on the direction cosines.
    rise = (body[0] * body[0] + body[1] * body[1]) * lean
    x = offset[0] + axes[0, 0] * body[0] + axes[1, 0] * body[1] - axes[2, 0] * rise
    y = offset[1] + axes[0, 1] * body[0] + axes[1, 1] * body[1] - axes[2, 1] * rise
    by_alignment = attitude_covariance(link[k, ALIGNMENT], offset, axes)
    placed = placement_covariance(link, k, offset)
    stretch = link[k, SOUND_SPEED]
    return (
        by_alignment[0] + placed[0] + stretch * x * x,
        by_alignment[1] + placed[1] + stretch * x * y,
        by_alignment[2] + placed[2] + stretch * y * y,
    )


@func
def systematic_covariance(link: ti.template(), k: ti.i32, offset: vec3, axes: mat3) -> vec3:
    """`common_covariance` as a vector."""
    C = common_covariance(link, k, offset, axes)
    return vec3(C[0], C[1], C[2])


@func
def placement_covariance(link: ti.template(), k, offset):
    """Part of `common_covariance` by errors of heading and position, which is the same for any measurement."""
    heading = link[k, HEADING]
    return (
        heading * offset[1] * offset[1] + link[k, POSITION],
        0.0 - heading * offset[0] * offset[1],
        heading * offset[0] * offset[0] + link[k, POSITION],
    )


@ti.dataclass
class Expectation:
    """Where the receiver expects an AUV.

    Attributes:
        place: horizontal offset from the array, m.
        covariance: of that, (xx, xy, yy), m².
        reach: how far from there it can have gone, m.
    """

    place: vec2
    covariance: vec3
    reach: ti.f32


@func
def squared_innovation(expected: Expectation, fix: vec2, covariance: vec3) -> ti.f32:
    """Normalised innovation squared of a fix (m) with its covariance (xx, xy, yy) in m², beyond the reach."""
    innovation = fix - expected.place
    innovation *= ti.max(1.0 - expected.reach / ti.max(innovation.norm(), 1e-6), 0.0)
    C = expected.covariance + covariance
    return innovation.dot(mat2([[C[0], C[1]], [C[1], C[2]]]).inverse() @ innovation)


def turns_possible(link: np.ndarray) -> bool:
    """Whether noise, or an array wider than half a wavelength, can wrap a detected fix into another real direction.

    With κ < π that takes noise of 2 (π − κ). Six standard deviations at the threshold of detection count as possible.
    """
    sigma = np.sqrt(8.0 / link[:, THRESHOLD])
    return bool((link[:, KAPPA] > math.pi - 3.0 * sigma).any())


@kernel
def _fixes(
    link: array2,
    auv: index1,
    offset: array2,
    slope: array2,
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
        f = fix(link, k, r, s, signal, further)
        C = horizontal_covariance(link, k, r, array_axes(attitude(s)), f[3])
        for j in ti.static(range(4)):
            estimate[i, j] = f[j]
        for j in ti.static(range(3)):
            covariance[i, j] = C[j]
        flags[i] = ti.cast(f[4], ti.i32)


def fixes(
    link: torch.Tensor,
    auv: torch.Tensor,
    offset: torch.Tensor,
    slope: torch.Tensor,
    noise: torch.Tensor,
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Many fixes, see `fix`.

    Args:
        link: (K, COLUMNS) float32, of `acoustic_link.link_table`.
        auv: (n,) int32, row of the table for each fix.
        offset: (n, 3) float32, true offset from boat to AUV, m.
        slope: (n, 2) float32, surface slopes.
        noise: (n, 7) float32 standard normal numbers: two phases, range, pitch, roll, amplitude, residual; numbers that
            are missing at the end count as 0, with (n, 5) every tone has its expected amplitude.

    Returns:
        (n, 4) estimated offset (m) and σ (rad); (n, 3) predicted horizontal covariance (xx, xy, yy), m²; (n,) int32
        flags, see DETECTED, WRAPPED, NO_DEPTH and AMBIGUOUS.
    """
    estimate = torch.empty((offset.shape[0], 4), dtype=torch.float32, device=offset.device)
    covariance = torch.empty((offset.shape[0], 3), dtype=torch.float32, device=offset.device)
    flags = torch.empty(offset.shape[0], dtype=torch.int32, device=offset.device)
    _fixes(link, auv, offset, slope, noise, estimate, covariance, flags)
    return estimate, covariance, flags
