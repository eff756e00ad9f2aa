"""Reflections from surface and bottom: image sources, and what they do to phases and delay.

Sound of an AUV at r also arrives from its images, r mirrored at the surface and at the bottom, both level. A refracted
ray continues through the mirrored water to the image; above the surface it has the sound speed at the mean surface. A
reflection's amplitude over the direct sound's is the reflection coefficient times the difference of the transmission
losses. The mean of many waves reflects coherently with

    −exp(−2 (k σ_η sin θ)²),

k the wave number, σ_η the standard deviation of the surface, θ the grazing angle (Eckart, "The scattering of sound
from the sea surface", J. Acoust. Soc. Am. 25 (1953) 566, doi 10.1121/1.1907123; Brekhovskikh and Lysanov,
"Fundamentals of Ocean Acoustics", §9.3). The bottom is a smooth fluid of m times the water's density and c_b times its
speed of sound, which absorbs α dB a wavelength. Its coefficient is the modulus of Rayleigh's

    (m sin θ − √(n² − cos² θ))/(m sin θ + √(n² − cos² θ)),   n = (1 + jα/54.6)/c_b

(Jensen, Kuperman, Porter and Schmidt, "Computational Ocean Acoustics" (2011), §1.6; `SEDIMENTS` is their Table 1.3);
its phase adds to one that waves and AUVs make random anyway. What is scattered incoherently is left out. Each
reflection is of one bounce.

Closed form. On hydrophone i a reflection of amplitude a adds ρ e^{−jψ_i} to the direct sound's 1, where ρ = a R(Δ) at
the excess delay Δ, R the pulse's autocorrelation. Resolved paths, Δ > 1/B, thus have the ρ of a sidelobe. For |ρ| < 1

    arg(1 + ρ e^{−jψ}) = Σ_n (−ρ)^n sin(nψ)/n,

so over a uniformly distributed mean phase ψ, which waves and heave make it, a phase difference between two hydrophones
has no bias and the extra variance Σ_n ρ^{2n} (1 − cos nδ)/n² ≈ 2ρ² sin² δ/2. Here δ is the difference of their ψ, κ
times that of the direction cosines of both sounds along the axis. Where δ is near zero, what remains is that both
outputs are read at one lag: ρ differs between them by ρ' = a R'(Δ) ν, ν the reflection's delay from one hydrophone to
the other, which adds ½ ρ'² cos² δ/2. The peak of the energy moves, to first order in a, by −a R'(Δ)/β² · mean_i cos ψ_i
with β² = −R''(0), of the variance ½ (a R'(Δ)/β²)² (½ cos δ_x/2 + ½ cos δ_y/2)².
"""
# pyright: reportOptionalCall=false
# (what Taichi's operations return is an expression only while a kernel is compiled)

from typing import Any, NamedTuple

import taichi as ti
import torch

from usvauv.kernels.functions import func, kernel
from usvauv.kernels.positioning import acoustic_link, rays, sonar
from usvauv.kernels.positioning.layered_water import sound_speed
from usvauv.kernels.positioning.pulse import FINE, Pulses, chip, envelope
from usvauv.kernels.positioning.usbl import TWO_PI, array_axes, attitude
from usvauv.kernels.types import array1, array2, array3, index1, mat3, vec2, vec3

SEDIMENTS = {  # density and speed of sound over the water's, absorption in dB a wavelength
    "clay": (1.5, 1.0, 0.2),
    "silt": (1.7, 1.05, 1.0),
    "sand": (1.9, 1.1, 0.8),
    "gravel": (2.0, 1.2, 0.6),
    "moraine": (2.1, 1.3, 0.4),
}
DECIBELS = 54.575054  # 40π/ln 10: absorption, dB a wavelength, over the imaginary part of n c_b
REFLECTIONS = 2  # surface, bottom
HARMONICS = 12  # terms of the series for a phase difference


@ti.dataclass
class Boundaries:
    """Surface and bottom of the water at the array."""

    array_depth: ti.f32  # of the array below the surface, m
    water_depth: ti.f32  # m
    roughness: ti.f32  # standard deviation σ_η of the surface, m; very large for no reflection
    density: ti.f32  # of the bottom over the water's
    speed: ti.f32  # of sound in the bottom over that in water
    absorption: ti.f32  # of sound in the bottom, dB a wavelength


class Profile(NamedTuple):
    """Water in which sound bends, at one array.

    Attributes:
        layers: speed of sound, `layered_water.layer_table`.
        mirrored: the same down to the bottom, and its mirror image below.
        depth: of the array below the mean surface, m.
        speed: of sound by which delays are turned into metres, m/s.
        direct: path of the direct sound by that speed, m.
    """

    layers: Any
    mirrored: Any
    depth: Any
    speed: Any
    direct: Any


class Waveguide(NamedTuple):
    """What reflects at an array: `Boundaries`, None for nothing, and `Profile`, None where sound goes straight."""

    boundaries: Any = None
    profile: Profile | None = None

    @property
    def reflect(self) -> bool:
        """Whether anything reflects."""
        return self.boundaries is not None

    @property
    def bend(self) -> bool:
        """Whether sound bends."""
        return self.profile is not None


@ti.dataclass
class Reflection:
    """One reflected sound of an AUV."""

    source: vec3  # where the sound comes from less the array's centre, m
    slant_range: ti.f32  # path of the sound, m
    excess: ti.f32  # that path less the direct sound's, m
    amplitude: ti.f32  # over that of the direct sound


@func
def bottom_coefficient(sine: ti.f32, boundaries: Boundaries) -> ti.f32:
    """Modulus of the bottom's reflection coefficient at a grazing angle θ, by sin θ."""
    index = vec2(1.0, boundaries.absorption / DECIBELS) / boundaries.speed
    # n² − 1 + sin² θ, and its root in the first quadrant.
    real = index[0] * index[0] - index[1] * index[1] - 1.0 + sine * sine
    imaginary = 2.0 * index[0] * index[1]
    modulus = ti.sqrt(real * real + imaginary * imaginary)
    root = vec2(ti.sqrt(ti.max(0.5 * (modulus + real), 0.0)), ti.sqrt(ti.max(0.5 * (modulus - real), 0.0)))
    vertical = boundaries.density * sine
    below = vec2(vertical - root[0], root[1])
    above = vec2(vertical + root[0], root[1])
    return below.norm() / ti.max(above.norm(), 1e-6)


@func
def bent(which: ti.i32, offset: vec3, level: ti.f32, profile: ti.template()):
    """Where a reflection comes from, as `rays.Arrival`, and the sine of its grazing angle; `level` of the plane, m."""
    plane = profile.depth - level
    arrival = rays.Arrival(direction=vec3(0.0), slant_range=0.0, exists=0)
    if which == 0:  # through the mirrored water the array is above the surface
        below = vec3(offset[0], offset[1], offset[2] - 2.0 * level)
        top = profile.depth - 2.0 * level
        arrival = rays.refracted(profile.layers, top, top, below, profile.speed)
        arrival.direction[2] *= -1.0
    else:
        image = vec3(offset[0], offset[1], 2.0 * level - offset[2])
        arrival = rays.refracted(profile.mirrored, profile.depth, profile.depth, image, profile.speed)
    across = vec2(arrival.direction[0], arrival.direction[1]) / profile.speed * sound_speed(profile.layers, plane)
    return arrival, ti.sqrt(ti.max(1.0 - across.norm_sqr(), 0.0))


@func
def reflection(which: ti.i32, offset: vec3, around: ti.template(), link: ti.template(), k: ti.i32) -> Reflection:
    """Reflection of AUV k at `offset` (m) from a level array, from the surface (0) or the bottom (1).

    `around` is `Waveguide`.
    """
    boundaries = around.boundaries
    level = boundaries.array_depth if which == 0 else boundaries.array_depth - boundaries.water_depth
    S = offset.norm()
    source = vec3(offset[0], offset[1], 2.0 * level - offset[2])
    length = source.norm()
    sine = ti.abs(source[2]) / length
    slant_range = length
    excess = 4.0 * level * (level - offset[2]) / (length + S)
    exists = 1
    if ti.static(around.bend):
        arrival, grazing = bent(which, offset, level, around.profile)
        exists = arrival.exists
        sine = grazing
        slant_range = arrival.slant_range
        source = slant_range * arrival.direction
        excess = slant_range - around.profile.direct
    coefficient = 0.0
    if which == 0:
        rayleigh = TWO_PI / link[k, acoustic_link.WAVELENGTH] * boundaries.roughness * sine
        coefficient = -ti.exp(-2.0 * rayleigh * rayleigh)
    else:
        coefficient = bottom_coefficient(sine, boundaries)
    spreading = link[k, acoustic_link.SPREADING]
    absorption = link[k, acoustic_link.ABSORPTION]
    loss = sonar.path_loss(length, spreading, absorption) - sonar.path_loss(S, spreading, absorption)
    return Reflection(
        source=source,
        slant_range=slant_range,
        excess=excess,
        amplitude=exists * coefficient * sonar.power_of_10(-0.05 * loss),
    )


@func
def difference_variance(rho: ti.f32, delta: ti.f32) -> ti.f32:
    """Extra variance (rad²) of a phase difference by a reflection of the relative strength `rho`, |rho| < 1."""
    variance = 0.0
    power = 1.0
    for n in range(1, HARMONICS + 1):
        power *= rho * rho
        variance += power * (1.0 - ti.cos(n * delta)) / (n * n)
    return variance


@func
def extra_variance(kappa: ti.f32, body: vec3, image: vec3, rho: ti.f32, slope: ti.f32, width: vec2) -> vec3:
    """Extra variance of both phase differences (rad²) and of the delay (chips²) by one reflection.

    Args:
        kappa: phase difference per direction cosine, rad.
        body, image: unit vectors towards the AUV and its image in the array's frame.
        rho, slope: a R(Δ) and a R'(Δ), lags in chips.
        width: of the pulse, B/f and β² in 1/chips².
    """
    delta = kappa * (image - body)
    variance = vec3(0.0)
    together = 0.0
    for axis in ti.static(range(2)):
        cosine = ti.cos(0.5 * delta[axis])
        uneven = slope * width[0] * kappa * image[axis] / TWO_PI * cosine
        variance[axis] = difference_variance(rho, delta[axis]) + 0.5 * uneven * uneven
        together += 0.5 * cosine
    shift = slope / width[1] * together
    variance[2] = 0.5 * shift * shift
    return variance


@func
def multipath_variance(
    tables: ti.template(), link: ti.template(), k: ti.i32, offset: vec3, axes: mat3, around: ti.template()
) -> vec3:
    """Extra variance of both phase differences (rad²) and of the slant range (m²) by reflections of unknown phase.

    The sum over the reflections (`extra_variance`), to add to the variance by noise.
    """
    metres = chip(tables, link, k)
    h = 1.0 / FINE
    width = vec2(tables.rate[k], 2.0 * (1.0 - tables.envelope[k, 1]) / (h * h))
    variance = vec3(0.0)
    for which in range(REFLECTIONS):
        r = reflection(which, offset, around, link, k)
        excess = r.excess / link[k, acoustic_link.WAVELENGTH] * tables.rate[k]
        rho = r.amplitude * envelope(tables.envelope, k, excess)
        later, earlier = envelope(tables.envelope, k, excess + h), envelope(tables.envelope, k, excess - h)
        slope = r.amplitude * 0.5 * (later - earlier) / h
        towards, image = axes @ offset / offset.norm(), axes @ r.source / r.slant_range
        added = extra_variance(link[k, acoustic_link.KAPPA], towards, image, rho, slope, width)
        variance += vec3(added[0], added[1], added[2] * metres * metres)
    return variance


@func
def situation(offset: ti.template(), slope: ti.template(), water: ti.template(), n: ti.i32):
    """Row n of offsets (m), slopes and boundaries: offset, axes of the array, boundaries."""
    r = vec3(offset[n, 0], offset[n, 1], offset[n, 2])
    axes = array_axes(attitude(vec2(slope[n, 0], slope[n, 1])))
    boundaries = Boundaries(water[n, 0], water[n, 1], water[n, 2], water[n, 3], water[n, 4], water[n, 5])
    return r, axes, boundaries


@kernel
def _multipath_variances(
    envelopes: array2,
    noise: array3,
    rate: array1,
    tone: ti.template(),
    link: array2,
    auv: index1,
    offset: array2,
    slope: array2,
    water: array2,
    variance: array2,
):
    for n in range(offset.shape[0]):
        tables = ti.static(Pulses(envelopes, noise, rate, tone))
        r, axes, boundaries = situation(offset, slope, water, n)
        around = ti.static(Waveguide(boundaries))
        added = multipath_variance(tables, link, auv[n], r, axes, around)
        for j in ti.static(range(3)):
            variance[n, j] = added[j]


def multipath_variances(
    tables: Pulses,
    link: torch.Tensor,
    auv: torch.Tensor,
    offset: torch.Tensor,
    slope: torch.Tensor,
    water: torch.Tensor,
) -> torch.Tensor:
    """`multipath_variance` of many pulses, (n, 3), rad², rad² and m²; arguments as of `matched_filter.measurements`."""
    variance = torch.empty((offset.shape[0], 3), dtype=torch.float32, device=offset.device)
    _multipath_variances(*tables, link, auv, offset, slope, water, variance)
    return variance
