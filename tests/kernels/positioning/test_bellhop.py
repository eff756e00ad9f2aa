"""Rays beside BELLHOP (M. B. Porter's Acoustics Toolbox), on the path or in the package `aubellhop`.

BELLHOP sends out a fan of beams from the array, integrates each in steps and interpolates what passes a source. It has
angles from the horizontal, positive downwards, and prints single precision.
"""

import importlib.util
import math
import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.kernels.positioning.test_rays import PROFILES, tensor
from usvauv.env.site.sound_speed import SoundSpeedProfile
from usvauv.kernels.positioning import rays

ARRAY, BOTTOM = 3.0, 200.0  # depths, m
DEPTHS = (40.0, 100.0)  # of the sources, m
RANGES = (40.0, 150.0, 350.0, 1000.0)  # m
PLACES = [(depth, R) for depth in DEPTHS for R in RANGES]
SAND = (1.9, 1.1, 0.8)  # density and speed of sound over the water's, absorption in dB a wavelength
BEAMS = 16_001
DIRECT = (0, 0)  # bounces off surface and bottom


class Arrival(NamedTuple):
    """What the array hears; time in s, angle in degrees."""

    amplitude: float
    time: float
    angle: float
    bounces: tuple[int, int]


def executable() -> str | None:
    """BELLHOP's program."""
    package = importlib.util.find_spec("aubellhop")
    folders = Path(package.origin).parent.glob("bin/bellhop.exe") if package and package.origin else []
    return shutil.which("bellhop.exe") or next(map(str, folders), None)


def arrivals(folder: Path, profile: SoundSpeedProfile, bottom: tuple[float, ...]) -> list[list[Arrival]]:
    """What arrives from each of `PLACES`, over a bottom as `SAND`."""
    density, speed, absorption = bottom
    lines = [
        "'sound'", "25000.0", "1", "'CVW'", f"0 0.0 {BOTTOM}",  # sound speed linear between depths, free surface
        *(f"{z} {c} /" for z, c in zip(profile.depths, profile.speeds, strict=True)),
        "'A' 0.0", f"{BOTTOM} {speed * profile.speeds[-1]} 0.0 {density} {absorption} /",
        "1", f"{ARRAY} /", str(len(DEPTHS)), " ".join(map(str, DEPTHS)) + " /",
        str(len(RANGES)), " ".join(str(R / 1000) for R in RANGES) + " /",
        "'A'", str(BEAMS), "-89.0 89.0 /", f"1.0 {BOTTOM + 1} {1.1 * RANGES[-1] / 1000}",
    ]  # fmt: skip
    (folder / "sound.env").write_text("\n".join(lines) + "\n")
    subprocess.run([str(executable()), "sound"], cwd=folder, check=True, capture_output=True)
    rows = iter((folder / "sound.arr").read_text().splitlines()[6:])

    def arrival() -> Arrival:
        amplitude, _, time, _, angle, _, *bounces = map(float, next(rows).split())
        return Arrival(amplitude, time, angle, (int(bounces[0]), int(bounces[1])))

    return [[arrival() for _ in range(int(next(rows)))] for _ in PLACES]


@pytest.mark.skipif(executable() is None, reason="BELLHOP is not installed: bellhop.exe, or the package aubellhop")
class TestBellhop:
    @pytest.mark.parametrize("name", PROFILES)
    def test_times_angles_and_shadows(self, device, tmp_path, name):
        profile = PROFILES[name]
        ends = tensor([(ARRAY, *place) for place in PLACES], device)
        found = rays.eigenrays(tensor(profile.layers(), device), ends).double().cpu().tolist()
        heard = arrivals(tmp_path, profile, SAND)
        for theirs, (_, upper, _, time, exists) in zip(heard, found, strict=True):
            direct = [each for each in theirs if each.bounces == DIRECT and each.angle > -2.0]
            assert bool(direct) == bool(exists)
            if exists:
                nearest = min(direct, key=lambda each: abs(each.time - time))
                assert nearest.time == pytest.approx(time, abs=5e-7)
                assert nearest.angle == pytest.approx(90 - math.degrees(math.acos(upper)), abs=2e-3)
