"""Rays and reflections beside BELLHOP (M. B. Porter's Acoustics Toolbox), on the path or in the package `aubellhop`.

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
from tests.kernels.positioning.test_reflections import ARRAY, BOTTOM, DEPTHS, PLACES, RANGES, SPEED, reflected
from usvauv.env.site.sound_speed import SoundSpeedProfile
from usvauv.kernels.positioning import rays, reflections

BEAMS = 16_001
DIRECT, SURFACE, BED = (0, 0), (1, 0), (0, 1)  # bounces off surface and bottom


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
    """What arrives from each of `PLACES`, over a bottom as in `SEDIMENTS`."""
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
        heard = arrivals(tmp_path, profile, reflections.SEDIMENTS["sand"])
        for theirs, (_, upper, _, time, exists) in zip(heard, found, strict=True):
            direct = [each for each in theirs if each.bounces == DIRECT and each.angle > -2.0]
            assert bool(direct) == bool(exists)
            if exists:
                nearest = min(direct, key=lambda each: abs(each.time - time))
                assert nearest.time == pytest.approx(time, abs=5e-7)
                assert nearest.angle == pytest.approx(90 - math.degrees(math.acos(upper)), abs=2e-3)

    @pytest.mark.parametrize("bending", [False, True])
    @pytest.mark.parametrize("sediment", reflections.SEDIMENTS)
    def test_reflections(self, device, tmp_path, sediment, bending):
        bottom = reflections.SEDIMENTS[sediment]
        profile = SoundSpeedProfile.from_table([(0, SPEED), (BOTTOM, SPEED)])
        heard = arrivals(tmp_path, profile, bottom)
        direct = [math.hypot(R, ARRAY - depth) for depth, R in PLACES] if bending else None
        for bounces, found in zip((SURFACE, BED), reflected(device, bottom, profile, direct), strict=True):
            for theirs, (excess, sine, amplitude) in zip(heard, found, strict=True):
                direct, other = (max(each for each in theirs if each.bounces == wanted) for wanted in (DIRECT, bounces))
                assert SPEED * (other.time - direct.time) == pytest.approx(excess, abs=5e-4)
                assert -math.sin(math.radians(other.angle)) == pytest.approx(sine, abs=1e-6)
                assert other.amplitude / direct.amplitude == pytest.approx(abs(amplitude), rel=0.01)

    @pytest.mark.parametrize("name", PROFILES)
    def test_reflections_where_sound_bends(self, device, tmp_path, name):
        bottom = reflections.SEDIMENTS["moraine"]
        heard = arrivals(tmp_path, PROFILES[name], bottom)
        ends = tensor([(ARRAY, *place) for place in PLACES], device)
        times = rays.eigenrays(tensor(PROFILES[name].layers(), device), ends).double().cpu()[:, 3]
        found = reflected(device, bottom, PROFILES[name], (SPEED * times).tolist())
        for which, bounces in enumerate((SURFACE, BED)):
            for theirs, (excess, sine, amplitude) in zip(heard, found[which], strict=True):
                direct = [each for each in theirs if each.bounces == DIRECT]
                others = [each for each in theirs if each.bounces == bounces]
                assert bool(others) == (amplitude != 0.0)
                if direct and others:
                    nearest = min(others, key=lambda each: abs(SPEED * (each.time - direct[0].time) - excess))
                    assert SPEED * (nearest.time - direct[0].time) == pytest.approx(excess, abs=0.01)
                    # The water mirrored above the surface has one speed.
                    tolerance = 6e-3 if which == 0 else 1e-6
                    assert -math.sin(math.radians(nearest.angle)) == pytest.approx(sine, abs=tolerance)
