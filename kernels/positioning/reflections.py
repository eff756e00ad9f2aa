"""Reflections from surface and bottom: image sources, and what they do to phases and delay.

An AUV at r is also heard from its images, r mirrored at the surface and at the bottom, both level. A reflection's
amplitude over the direct sound's is the reflection coefficient times the difference of the sonar equation's
transmission losses. The bottom has a constant loss. The mean of many waves reflects coherently with

    −exp(−2 (k σ_η sin θ)²),

k the wave number, σ_η the standard deviation of the surface, θ the grazing angle (Eckart, "The scattering of sound
from the sea surface", J. Acoust. Soc. Am. 25 (1953) 566, doi 10.1121/1.1907123). What is scattered incoherently is left
out. Each reflection is of one bounce.

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

import taichi as ti

from kernels.positioning import sonar_equation
from kernels.positioning.tone import TWO_PI
from kernels.types import vec2, vec3

REFLECTIONS = 2  # surface, bottom
HARMONICS = 12  # terms of the series for a phase difference


@ti.dataclass
class Boundaries:
    """Surface and bottom of the water at the array."""

    array_depth: ti.f32  # of the array below the surface, m
    water_depth: ti.f32  # m
    roughness: ti.f32  # standard deviation σ_η of the surface, m; infinite or very large for no reflection
    bottom: ti.f32  # amplitude reflection coefficient of the bottom, 10^(−loss/20); 0 for no reflection


@ti.dataclass
class Reflection:
    """One reflected sound of an AUV."""

    source: vec3  # image of the AUV less the array's centre, m
    slant_range: ti.f32  # of the image, m
    excess: ti.f32  # slant range of the image less that of the AUV, m
    amplitude: ti.f32  # over that of the direct sound


@ti.func
def reflection(which: ti.i32, offset: vec3, boundaries: Boundaries, wavelength: ti.f32, f: ti.f32) -> Reflection:
    """Reflection from the surface (0) or the bottom (1) of an AUV at `offset` (m) from a level array; f in Hz."""
    level = boundaries.array_depth if which == 0 else boundaries.array_depth - boundaries.water_depth
    S = offset.norm()
    source = vec3(offset[0], offset[1], 2.0 * level - offset[2])
    length = source.norm()
    coefficient = boundaries.bottom
    if which == 0:
        rayleigh = TWO_PI / wavelength * boundaries.roughness * source[2] / length
        coefficient = -ti.exp(-2.0 * rayleigh * rayleigh)
    loss = sonar_equation.transmission_loss(length, f) - sonar_equation.transmission_loss(S, f)
    return Reflection(
        source=source,
        slant_range=length,
        excess=4.0 * level * (level - offset[2]) / (length + S),
        amplitude=coefficient * sonar_equation.power_of_10(-0.05 * loss),
    )


@ti.func
def difference_variance(rho: ti.f32, delta: ti.f32) -> ti.f32:
    """Extra variance (rad²) of a phase difference by a reflection of the relative strength `rho`, |rho| < 1."""
    variance = 0.0
    power = 1.0
    for n in range(1, HARMONICS + 1):
        power *= rho * rho
        variance += power * (1.0 - ti.cos(n * delta)) / (n * n)
    return variance


@ti.func
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
