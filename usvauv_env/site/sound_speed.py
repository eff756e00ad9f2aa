"""Speed of sound against depth: a constant, a table, or temperature and salinity through TEOS-10.

Between the depths of a profile the speed is linear, so rays are arcs of circles (`usvauv.kernels.positioning.rays`);
above the first and below the last depth it is constant. Temperature and salinity need the library gsw. Without it there
is an error and no simpler formula, so that a scenario means the same water on every machine.
"""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from usvauv.env.site import thinning
from usvauv.kernels.errors import UserError
from usvauv.kernels.positioning.layered_water import layer_table

SLOWEST, FASTEST = 1300.0, 1700.0  # m/s
DEEPEST = 11000.0  # m
COLDEST, WARMEST = -3.0, 45.0  # °C
SALTIEST = 50.0  # g/kg or practical
KILOGRAMS = (0.02, 0.05)  # salinity of the sea in kg/kg; values in g/kg that low are taken for this mistake
FIRST_DEPTH = 15.0  # m, the deepest that a profile may begin; above lies the mixed layer
DEGREES_PER_LAYER = 0.5  # °C between depths; the speed is then linear to 5 mm/s


class SoundSpeedError(UserError, ValueError):
    """A sound speed profile cannot be used; one line names the value, its row or depth and what is allowed."""


@dataclass(frozen=True)
class SoundSpeedProfile:
    """Speed of sound, linear between depths.

    Attributes:
        depths: (N,) rising, m below the surface.
        speeds: (N,) m/s.
    """

    depths: np.ndarray
    speeds: np.ndarray

    @classmethod
    def constant(cls, speed: float) -> SoundSpeedProfile:
        """The same speed (m/s) at all depths.

        Raises:
            SoundSpeedError: not a speed of sound in water.
        """
        return cls.from_table([(0.0, speed)])

    @classmethod
    def from_table(cls, rows: Sequence[Sequence[float]]) -> SoundSpeedProfile:
        """From rows of depth (m, positive downwards) and speed (m/s).

        Raises:
            SoundSpeedError: no or ragged rows, depths that do not rise or begin too deep, a number out of range.
        """
        depths, speeds = _columns(rows, "depth, speed")
        hint = "; kilometres and feet per second are not understood"
        _check_range("speed", speeds, depths, SLOWEST, FASTEST, "m/s", hint)
        return cls(depths, speeds)

    @classmethod
    def from_water(
        cls,
        rows: Sequence[Sequence[float]],
        *,
        latitude: float,
        longitude: float = 0.0,
        salinity: str = "practical",
    ) -> SoundSpeedProfile:
        """From rows of depth (m), in-situ temperature (°C, ITS-90) and salinity, by TEOS-10's exact speed of sound.

        Between rows temperature and salinity are linear; rows are added where the speed would not be.

        Args:
            rows: as `from_table`, with three columns.
            latitude, longitude: degrees north and east; pressure depends on the first, and the anomaly between
                practical and absolute salinity on both.
            salinity: "practical", PSS-78 as a CTD gives it, or "absolute", g/kg.

        Raises:
            SoundSpeedError: as `from_table`, an unknown kind of salinity, a place without salinity anomaly (on land or
                ice), or gsw is not installed.

        Source: IOC, SCOR, IAPSO (2010), the international thermodynamic equation of seawater, §2.17,
        https://teos-10.org.
        """
        if salinity not in ("practical", "absolute"):
            raise SoundSpeedError(f"salinity: {salinity!r} is not one of practical, absolute")
        if not (abs(latitude) <= 90 and abs(longitude) <= 360):
            raise SoundSpeedError(f"latitude {latitude:g}, longitude {longitude:g}: allowed are −90 to 90, −360 to 360")
        if importlib.util.find_spec("gsw") is None:
            raise SoundSpeedError("temperature and salinity need the library gsw: pip install gsw")
        import gsw

        depths, temperature, salt = _columns(rows, "depth, temperature, salinity")
        _check_range("temperature", temperature, depths, COLDEST, WARMEST, "°C", "; kelvins are not understood")
        _check_range("salinity", salt, depths, 0.0, SALTIEST, "g/kg" if salinity == "absolute" else "(PSS-78)")
        if KILOGRAMS[0] < salt.min() and salt.max() < KILOGRAMS[1]:
            raise SoundSpeedError(f"salinity {salt[0]:g} at {depths[0]:g} m looks like kg/kg; expected g/kg or PSS-78")
        if len(depths) < 2:
            raise SoundSpeedError("temperature and salinity need at least two rows; the speed also grows with pressure")
        fine = _refined(depths, temperature)
        temperature, salt = np.interp(fine, depths, temperature), np.interp(fine, depths, salt)
        pressure = gsw.p_from_z(-fine, latitude)
        if salinity == "practical":
            salt = gsw.SA_from_SP(salt, pressure, longitude, latitude)
            if not np.isfinite(salt).all():
                place = f"latitude {latitude:g}, longitude {longitude:g}"
                raise SoundSpeedError(f"{place}: TEOS-10 knows no sea there; give absolute salinity")
        speeds = np.asarray(gsw.sound_speed_t_exact(salt, temperature, pressure), float)
        _check_range("speed", speeds, fine, SLOWEST, FASTEST, "m/s")
        return cls(fine, speeds)

    def check_reaches(self, depth: float) -> None:
        """Refuse a table that ends above a depth (m); a single row stands for all depths.

        Raises:
            SoundSpeedError: it does.
        """
        if len(self.depths) > 1 and self.depths[-1] < depth:
            raise SoundSpeedError(f"last depth {self.depths[-1]:g} m; the profile must reach {depth:g} m")

    def at(self, depth: float) -> float:
        """Speed at a depth (m), m/s."""
        return float(np.interp(depth, self.depths, self.speeds))

    def harmonic_mean(self, shallow: float, deep: float) -> float:
        """Vertical distance over vertical travel time between two depths (m, the deeper second), m/s."""
        inside = (self.depths > shallow) & (self.depths < deep)
        z = np.concatenate([[shallow], self.depths[inside], [deep]])
        c = np.interp(z, self.depths, self.speeds)
        rise = np.diff(c) / c[:-1]
        # ∫ dz/c = h ln(c₂/c₁)/(c₂ − c₁)
        slowing = np.where(np.abs(rise) > 1e-6, np.log1p(rise) / np.where(rise == 0, 1, rise), 1 - rise / 2)
        return float((deep - shallow) / np.sum(np.diff(z) / c[:-1] * slowing))

    def thinned(self, arrays: tuple[float, ...], source: float, longest: float, bed: float) -> SoundSpeedProfile:
        """A profile of fewer depths with nearly the same rays; the kernels' time grows with the number of depths.

        Up to the longest range, the travel time times the speed of sound differs by less than `thinning.TOLERANCE`,
        and so does the horizontal place of a fix where the cosine of its ray is nowhere below `thinning.STEEP`; the
        edge of a shadow moves by less than a hundredth of the longest range. All three are checked at a hundred
        ranges; where no thinner profile passes, all depths stay.

        Args:
            arrays: depths of arrays, m. source: depth of the source below them, m.
            longest: horizontal range, m.
            bed: depth below which no ray turns, m; there the speed is made constant.
        """
        reached = self.depths < bed
        depths, speeds = self.depths[reached], self.speeds[reached]
        if not reached.all():
            depths, speeds = np.append(depths, bed), np.append(speeds, self.at(bed))
        if len(depths) > 2:
            depths, speeds = thinning.thinned(depths, speeds, arrays, source, longest)
        return SoundSpeedProfile(depths, speeds)

    def mirrored(self, depth: float) -> SoundSpeedProfile:
        """The profile down to a depth (m) and its mirror image below: sound that is reflected there goes on in it."""
        depths = np.append(self.depths[self.depths < depth], depth)
        speeds = np.interp(depths, self.depths, self.speeds)
        return SoundSpeedProfile(np.append(depths, 2 * depth - depths[-2::-1]), np.append(speeds, speeds[-2::-1]))

    def layers(self) -> np.ndarray:
        """The profile for `usvauv.kernels.positioning.rays`, (N + 2, 3) float32."""
        return layer_table(self.depths, self.speeds)


def _columns(rows: Sequence[Sequence[float]], names: str) -> np.ndarray:
    """Columns of a table of finite numbers whose first is depth."""
    wanted = len(names.split(", "))
    for number, row in enumerate(rows, 1):
        if len(row) != wanted:
            raise SoundSpeedError(f"row {number} has {len(row)} numbers; expected {wanted}: {names}")
        if not all(math.isfinite(value) for value in row):
            raise SoundSpeedError(f"row {number}: {', '.join(f'{value:g}' for value in row)}: not a finite number")
    if not len(rows):
        raise SoundSpeedError(f"a profile needs at least one row of {names}")
    table = np.asarray(rows, float)
    depths = table[:, 0]
    if depths.min() < 0 or depths.max() > DEEPEST:
        wrong = depths[(depths < 0) | (depths > DEEPEST)][0]
        raise SoundSpeedError(f"depth {wrong:g} m; allowed: 0 to {DEEPEST:g} m, positive downwards")
    falls = np.flatnonzero(np.diff(depths) <= 0)
    if falls.size:
        raise SoundSpeedError(f"depths must rise: {depths[falls[0] + 1]:g} m follows {depths[falls[0]]:g} m")
    if depths[0] > FIRST_DEPTH:
        raise SoundSpeedError(f"first depth {depths[0]:g} m; a profile must begin above {FIRST_DEPTH:g} m")
    return table.T.copy()


def _check_range(
    name: str, values: np.ndarray, depths: np.ndarray, low: float, high: float, unit: str, hint: str = ""
) -> None:
    wrong = np.flatnonzero(~((values >= low) & (values <= high)))
    if wrong.size:
        value, depth = values[wrong[0]], depths[wrong[0]]
        raise SoundSpeedError(f"{name} {value:g} {unit} at {depth:g} m; allowed: {low:g} to {high:g} {unit}{hint}")


def _refined(depths: np.ndarray, temperature: np.ndarray) -> np.ndarray:
    """Depths with as many more between them that temperature changes little from each to the next."""
    parts = np.maximum(1, np.ceil(np.abs(np.diff(temperature)) / DEGREES_PER_LAYER)).astype(int)
    pieces = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(depths[:-1], depths[1:], parts, strict=True)]
    return np.concatenate([*pieces, depths[-1:]])
