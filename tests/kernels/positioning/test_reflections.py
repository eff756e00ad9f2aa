"""Sounds that surface and bottom reflect where the speed of sound changes with depth: Snell's law by quadrature."""

from itertools import pairwise

import numpy as np
import pytest
import taichi as ti
import torch
from scipy.integrate import quad
from scipy.optimize import brentq

from tests.kernels.positioning.test_rays import MELTWATER, tensor
from usvauv.env.site.sound_speed import SoundSpeedProfile
from usvauv.kernels.positioning import reflections
from usvauv.kernels.positioning.acoustic_link import ABSORPTION, COLUMNS, SPREADING, WAVELENGTH
from usvauv.kernels.types import array1, array2, array3, vec3

ARRAY, BOTTOM = 3.0, 200.0  # depths, m
DEPTHS = (40.0, 100.0)  # of the sources, m
RANGES = (40.0, 150.0, 350.0, 1000.0)  # m
PLACES = [(depth, R) for depth in DEPTHS for R in RANGES]
SPEED = 1500.0  # m/s, of reference
ROUGHNESS, WAVELENGTH_HERE, LOSS = 0.01, 0.06, (20.0, 40.0)  # m, m, dB a decade and dB/km


def coefficient(which: int, sine: float, k: float, roughness: float, bottom: tuple[float, ...]) -> float:
    """Eckart's of the surface (0), or the modulus of Rayleigh's of the bottom by the vertical wave numbers."""
    if which == 0:
        return -np.exp(-2 * (k * roughness * sine) ** 2)
    density, speed, loss_per_wavelength = bottom
    wave = k / speed * (1 + 1j * loss_per_wavelength / (40 * np.pi * np.log10(np.e)))
    above, below = k * sine, np.sqrt(wave**2 - k**2 * (1 - sine**2))
    return abs((density * above - below) / (density * above + below))


def reflected(
    device: torch.device, bottom: tuple[float, ...], profile: SoundSpeedProfile, direct: list[float] | None = None
) -> list[list[list[float]]]:
    """Excess path (m), sine of the angle from below and amplitude over the direct sound's, from surface and bottom and
    each of `PLACES`; `direct`: paths of the direct sounds where sound bends, m.
    """
    link = torch.zeros((1, COLUMNS), device=device)
    link[0, SPREADING], link[0, ABSORPTION], link[0, WAVELENGTH] = *LOSS, WAVELENGTH_HERE
    offsets = tensor([(R, 0.0, ARRAY - depth) for depth, R in PLACES], device)
    out = torch.empty((2, len(PLACES), 3), device=device)
    density, speed, absorption = bottom
    bending = direct is not None

    @ti.kernel
    def take(link: array2, offsets: array2, paths: array1, layers: array2, mirrored: array2, out: array3):
        for which, n in ti.ndrange(2, out.shape[1]):
            offset = vec3(offsets[n, 0], offsets[n, 1], offsets[n, 2])
            boundaries = reflections.Boundaries(ARRAY, BOTTOM, ROUGHNESS, density, speed, absorption)
            bent = ti.static(reflections.Profile(layers, mirrored, ARRAY, SPEED, paths[n]))
            around = ti.static(reflections.Waveguide(boundaries, bent if bending else None))
            r = reflections.reflection(which, offset, around, link, 0)
            out[which, n, 0] = r.excess
            out[which, n, 1] = r.source[2] / r.source.norm()
            out[which, n, 2] = r.amplitude

    layers = (tensor(each.layers(), device) for each in (profile, profile.mirrored(BOTTOM)))
    take(link, offsets, tensor(direct or [0.0] * len(PLACES), device), *layers, out)
    return out.tolist()


def exact(profile: SoundSpeedProfile, legs: list[tuple[float, float]], R: float) -> tuple[float, float]:
    """Slowness (s/m) and travel time (s) of the ray that crosses some ranges of depth and comes as far as R (m)."""

    def crossed(xi: float, power: int) -> float:
        def integrand(z: float) -> float:
            return profile.at(z) ** power / np.sqrt(1 - (xi * profile.at(z)) ** 2)

        parts = [[a, *(z for z in profile.depths if a < z < b), b] for a, b in legs]
        return sum(quad(integrand, *part, epsabs=1e-12)[0] for leg in parts for part in pairwise(leg))

    fastest = max(profile.at(z) for leg in legs for z in [*leg, *profile.depths] if leg[0] <= z <= leg[1])
    xi = brentq(lambda xi: xi * crossed(xi, 1) - R, 0, (1 - 1e-9) / fastest, xtol=1e-18)
    return xi, crossed(xi, -1)


def test_paths_and_angles_where_sound_bends(device):
    """MELTWATER has one speed down to the array's depth, so that the reflection from the surface is exact too."""
    bottom = reflections.SEDIMENTS["sand"]
    direct = [exact(MELTWATER, [(ARRAY, depth)], R)[1] if R < 1000.0 else 1.0 for depth, R in PLACES]
    found = reflected(device, bottom, MELTWATER, [SPEED * time for time in direct])
    for which, there in enumerate([(0.0, ARRAY), (ARRAY, BOTTOM)]):
        for (depth, R), straight, (excess, sine, amplitude) in zip(PLACES, direct, found[which], strict=True):
            if R == 1000.0:  # the direct ray turns
                continue
            xi, time = exact(MELTWATER, [there, [(0.0, depth), (depth, BOTTOM)][which]], R)
            assert excess == pytest.approx(SPEED * (time - straight), abs=1e-3)
            assert sine == pytest.approx((1 - 2 * which) * np.sqrt(1 - (xi * MELTWATER.at(ARRAY)) ** 2), abs=2e-6)
            # Beside what the boundary takes, the longer way of straight rays.
            at_plane = np.sqrt(1 - (xi * MELTWATER.at(BOTTOM if which else 0.0)) ** 2)
            ways = np.hypot(R, ARRAY - depth), np.hypot(R, [ARRAY + depth, 2 * BOTTOM - ARRAY - depth][which])
            loss = [LOSS[0] * np.log10(way) + LOSS[1] * way / 1000 for way in ways]
            reflected_share = coefficient(which, at_plane, 2 * np.pi / WAVELENGTH_HERE, ROUGHNESS, bottom)
            assert amplitude == pytest.approx(reflected_share * 10 ** ((loss[0] - loss[1]) / 20), rel=1e-4)
