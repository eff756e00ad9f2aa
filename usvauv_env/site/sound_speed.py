"""Speed of sound against depth: a constant, a table, or temperature and salinity through TEOS-10, at few depths.

Between the depths of a profile the speed is linear, so rays are arcs of circles (`usvauv.kernels.positioning.rays`);
above the first and below the last depth it is constant. Temperature and salinity need the library gsw. Without it there
is an error instead of a simpler formula, so that a scenario has the same water on every machine.

A thinned profile has fewer depths, with which the travel time of sound between given depths is equal to within 1 cm, by
the rays of the kernels.
"""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from usvauv.kernels import runtime
from usvauv.kernels.errors import UserError
from usvauv.kernels.positioning import rays
from usvauv.kernels.positioning.layered_water import layer_table

SLOWEST, FASTEST = 1300.0, 1700.0  # m/s
DEEPEST = 11000.0  # m
COLDEST, WARMEST = -3.0, 45.0  # °C
SALTIEST = 50.0  # g/kg or practical
KILOGRAMS = (0.02, 0.05)  # salinity of the sea in kg/kg; values in g/kg that low are taken for this mistake
FIRST_DEPTH = 15.0  # m, the deepest that a profile may begin; above lies the mixed layer
DEGREES_PER_LAYER = 0.5  # °C between depths; the speed is then linear to 5 mm/s

# Of a thinned profile.
TOLERANCE = 0.008  # m, of travel times times the speed of sound and of horizontal places; 1 cm between the ranges
STEEPEST = math.sqrt(1 - 0.2**2)  # sine at the fastest depth of a ray, below which the place of a fix is held to it
RANGES = 100  # at which times are compared; the edge of a shadow may move from one to the next
FLAT = 0.005  # least cosine by which a speed's weight grows
FIRST_STEP = 4.0  # times the range of the speeds, where the search for the fewest depths begins
STEP, LEAST_STEP = 1.25, 1e-3  # between weighted tolerances that are tried, and the last of them, m/s
FIT_POINTS = 4  # per depth at which a thinned profile is fitted


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
        """A profile of one speed (m/s) at all depths.

        Raises:
            SoundSpeedError: not a speed of sound in water.
        """
        return cls.from_table([(0.0, speed)])

    @classmethod
    def from_table(cls, rows: Sequence[Sequence[float]]) -> SoundSpeedProfile:
        """A profile from rows of depth (m, positive downwards) and speed (m/s).

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
        """A profile from rows of depth (m), in-situ temperature (°C, ITS-90) and salinity, by TEOS-10's speed of sound.

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

        Up to the longest range, the travel time times the speed of sound differs by less than `TOLERANCE`,
        and so does the horizontal place of a fix where the sine of its ray is below `STEEPEST`; the
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
            depths, speeds = _thinned(depths, speeds, arrays, source, longest)
        return SoundSpeedProfile(depths, speeds)

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


class _Sound:
    """Tests of a thinned profile: first arrivals at arrays from a source below (m), up to a range (m)."""

    def __init__(
        self, depths: np.ndarray, speeds: np.ndarray, arrays: tuple[float, ...], source: float, longest: float
    ):
        self._arrays, self._device, self._mean = arrays, runtime.start().device, float(speeds.mean())
        self._R = np.linspace(longest / RANGES, longest, RANGES)
        self._found = [self._arrivals(depths, speeds, array, array - source) for array in arrays]
        self._source = source
        z = np.union1d(depths, [*arrays, source])
        c = np.interp(z, depths, speeds)
        fastest = np.array([c[(z >= array) & (z <= source)].max() for array in arrays])
        found = torch.stack(self._found).cpu().numpy()
        slowness = np.where(found[..., 4] > 0, found[..., 0] / self._mean, np.inf)
        self._sine = slowness * fastest[:, None]  # at the fastest depth of a direct ray
        self.flattest = float(slowness[0][self._sine[0] < 1].max(initial=0))

    def _tensor(self, values: np.ndarray) -> torch.Tensor:
        return torch.from_numpy(np.ascontiguousarray(values, np.float32)).to(self._device)

    def _arrivals(self, depths: np.ndarray, speeds: np.ndarray, array: float, below: float) -> torch.Tensor:
        """Arrivals (RANGES, 5), as of `rays.arrivals`."""
        offset = np.stack([self._R, 0 * self._R, np.full(RANGES, below)], axis=1)
        layers, at = self._tensor(layer_table(depths, speeds)), self._tensor(np.full(RANGES, array))
        return rays.arrivals(layers, at, self._tensor(offset), self._mean, array)

    def holds(self, depths: np.ndarray, speeds: np.ndarray) -> bool:
        """Whether times and places by another profile are within TOLERANCE, and shadows within one of the ranges."""
        layers = self._tensor(layer_table(depths, speeds))
        for array, found, sine in zip(self._arrays, self._found, self._sine, strict=True):
            other = self._arrivals(depths, speeds, array, array - self._source)
            heard, hears = found[:, 4] > 0, other[:, 4] > 0
            if (heard != hears).sum() > 1 or ((other - found)[heard & hears, 3].abs() > TOLERANCE).any():
                return False
            at = self._tensor(np.full(RANGES, array))
            back = rays.positions(layers, at, found, self._mean)[:, 0].cpu().numpy()
            if np.abs(back - self._R)[sine < STEEPEST].max(initial=0) > TOLERANCE:
                return False
        return True


def _simplified(
    depths: np.ndarray, speeds: np.ndarray, weights: np.ndarray, tolerance: float
) -> tuple[np.ndarray, np.ndarray]:
    """Depths between which the weighted speed is linear within a tolerance, m/s, and speeds there by least squares.

    Source: Douglas and Peucker, "Algorithms for the reduction of the number of points required to represent a digitized
    line", Cartographica 10 (1973), doi 10.3138/FM57-6770-U75U-7727.
    """
    kept = {0, len(depths) - 1}
    open_ends = [(0, len(depths) - 1)]
    while open_ends:
        first, last = open_ends.pop()
        between = slice(first + 1, last)
        linear = np.interp(depths[between], depths[[first, last]], speeds[[first, last]])
        misses = weights[between] * np.abs(speeds[between] - linear)
        if misses.size and misses.max() > tolerance:
            worst = first + 1 + int(misses.argmax())
            kept.add(worst)
            open_ends += [(first, worst), (worst, last)]
    index = sorted(kept)
    few, at = depths[index], speeds[index]
    z = np.linspace(few[0], few[-1], FIT_POINTS * len(depths))
    missed = np.interp(z, depths, speeds) - np.interp(z, few, at)
    hats = np.stack([np.interp(z, few, unit) for unit in np.eye(len(few))], axis=1)
    weight = np.interp(z, depths, weights)
    return few, at + np.linalg.lstsq(hats * weight[:, None], missed * weight, rcond=None)[0]


def _thinned(
    depths: np.ndarray, speeds: np.ndarray, arrays: tuple[float, ...], source: float, longest: float
) -> tuple[np.ndarray, np.ndarray]:
    """Fewest depths, and speeds there, that are found to serve; see `SoundSpeedProfile.thinned`.

    Each speed weighs as the time that the flattest direct ray within the longest range takes at it, by 1/cos θ.
    """
    asked = _Sound(depths, speeds, arrays, source, longest)
    weights = 1 / np.sqrt(np.maximum(np.abs(1 - (speeds * asked.flattest) ** 2), FLAT**2))
    best, tolerance = (depths, speeds), FIRST_STEP * float(np.ptp(speeds))
    few = _simplified(depths, speeds, weights, tolerance)
    while tolerance > LEAST_STEP and len(few[0]) < len(best[0]):
        if asked.holds(*few):
            best = few
        tolerance /= STEP
        few = _simplified(depths, speeds, weights, tolerance)
    return best
