"""Waves of a place and a time in NetCDF files, of WAVEWATCH III, ERA5, CMEMS and others: a spectrum, or partitions.

A spectrum of WAVEWATCH III is `efth` at stations, by the direction that waves travel to (`model/src/ww3_ounp.F90`).
One of ERA5 is `d2fd`: the decadic logarithm of the density, missing where that is small, over frequencies and
directions or over their numbers. The first frequency is 0.03453 Hz and each next one 1.1 times as high. The directions,
7.5°, 22.5° and so on, are those that waves travel to.

Partitions are wind sea and swells by heights, periods, directions and spreads. Directions are those that waves come
from, spreads √(2(1 − r₁)) of the first moment r₁ of the directions. Periods of WAVEWATCH III's partitions are those of
the peaks (`model/src/w3ounfmetamd.F90`), of ERA5's parts means T₋₁,₀ = m₋₁/m₀ (ECMWF, "IFS documentation, part VII:
ECMWF wave model"), of CMEMS's parts means T₀₁ = m₀/m₁. Sources: https://github.com/NOAA-EMC/WW3;
https://confluence.ecmwf.int/display/CKB/About+ERA+wave+spectra.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from usvauv.env.site.cf import METRES, METRES_PER_SECOND, factor_of, find, require_numbers
from usvauv.env.site.place import LocalFrame
from usvauv.env.site.wave_source import Sample, Source
from usvauv.env.storage import netcdf
from usvauv.env.storage.netcdf import OceanError, open_decoded

if TYPE_CHECKING:
    import xarray

STANDARD_NAME = "sea_surface_wave_directional_variance_spectral_density"
WELL_KNOWN = ("efth", "d2fd")
HERTZ: dict[str, float] = dict.fromkeys(("s-1", "hz", "1/s", "s^-1", "s**-1"), 1.0)
DENSITIES = {
    **dict.fromkeys(("m2 s rad-1", "m2 s radian-1", "m**2 s radian**-1", "m2 hz-1 rad-1", "m2/hz/rad"), 1.0),
    **dict.fromkeys(("m2 s degree-1", "m2 s deg-1", "m2 hz-1 deg-1", "m2 hz-1 degree-1", "m2/hz/deg"), 180 / math.pi),
}
ERA5_FREQUENCY, ERA5_RATIO, ERA5_FREQUENCIES, ERA5_DIRECTIONS = 0.03453, 1.1, 30, 24  # Hz of the first
DENSEST = 1e5  # m²/(Hz rad); larger values are fill values or in other units
STRONGEST = 60.0  # m/s, of the wind, as the field of a scenario has it
MOST_ZEROS = 0.1  # share of logarithms that are 0; more were missing and are filled
UNEVEN = 0.02  # share of the step by which directions may miss even steps
SECONDS: dict[str, float] = dict.fromkeys(("s", "sec", "second", "seconds"), 1.0)
ANGLES: dict[str, float] = dict.fromkeys(
    ("degree", "degrees", "deg", "degree true", "degrees true", "degree_true", "degrees_true"), math.pi / 180
)
WIDTHS = {**ANGLES, **dict.fromkeys(("radian", "radians", "rad", "dimensionless", "1", "~"), 1.0)}
WAY = re.compile(r"(from direction|(?:coming|come) from|from which)|to direction|going to|towards", re.IGNORECASE)
HIGHEST_WAVES, PERIODS, WIDEST = 30.0, (0.5, 30.0), math.sqrt(2)  # m, s, rad


@dataclass(frozen=True)
class WaveSpectrum:
    """Spectral density of the elevation, constant in direction within a step and linear in frequency between values.

    Its trapezoids are, for frequencies in a constant ratio, the widths of WAVEWATCH III's bins.

    Attributes:
        frequencies: (F,) rising, Hz.
        directions: (D,) rising, of travel, from east towards north, in even steps round the circle, rad.
        density: (F, D) m²/(Hz rad).
    """

    frequencies: np.ndarray
    directions: np.ndarray
    density: np.ndarray

    @property
    def step(self) -> float:
        """Between directions, rad."""
        return 2 * math.pi / len(self.directions)

    @property
    def by_frequency(self) -> np.ndarray:
        """Density in all directions together, (F,), m²/Hz."""
        return self.density.sum(axis=1) * self.step

    @property
    def significant_height(self) -> float:
        """Hs = 4 √m0, m."""
        return 4 * math.sqrt(float(np.trapezoid(self.by_frequency, self.frequencies)))

    @property
    def peak_period(self) -> float:
        """Period of the densest frequency of the file, s."""
        return 1 / float(self.frequencies[self.by_frequency.argmax()])

    @property
    def moment(self) -> complex:
        """First moment of the directions r₁ exp(iθ), weighted by energy; the spread is √(2(1 − r₁))."""
        first = self.density @ np.exp(1j * self.directions) * self.step
        whole = np.trapezoid(first, self.frequencies) / np.trapezoid(self.by_frequency, self.frequencies)
        return complex(whole) * float(np.sinc(self.step / (2 * math.pi)))

    @property
    def direction(self) -> float:
        """Mean direction of travel, from east towards north, rad."""
        return float(np.angle(self.moment))


class Partition(NamedTuple):
    """A wave system: Hs (m), period (s), direction of travel (rad from east towards north), spread √(2(1 − r₁)) (rad).

    The period is that of the peak where `moment` is 0; k: the mean (m0/m_k)^(1/k), such as T₋₁,₀ with k = −1. A spread
    that the file does not have is None.
    """

    height: float
    period: float
    direction: float
    spread: float | None
    moment: int
    wind_sea: bool


@dataclass(frozen=True)
class Waves:
    """A file's waves for a place and a time.

    Attributes:
        path: of the file.
        start: time at which the mission starts, ISO 8601, UTC; "" where the file has no time.
        spectrum: None in a file of partitions.
        partitions: none in a file of spectra.
        wind: 10 m above the sea, m/s; None where the file has none.
    """

    path: str
    start: str
    spectrum: WaveSpectrum | None
    partitions: tuple[Partition, ...]
    wind: float | None

    @property
    def wind_sea_height(self) -> float:
        """Hs of the wind sea, 0 without one, m; of all waves, where the file does not tell them apart."""
        if self.spectrum is not None:
            return self.spectrum.significant_height
        return math.hypot(*(part.height for part in self.partitions if part.wind_sea))


def read_waves(path: str | Path, frame: LocalFrame, width: float, length: float, start: str = "") -> Waves:
    """Waves in the middle of an area at the start of a mission.

    Spectra are linear in time and between the points of a grid; of stations the nearest is taken. Partitions are those
    of the nearest time and point that has them, since their numbers mean other systems elsewhere.

    Args:
        path: NetCDF file with a spectrum or partitions.
        frame: where the area is.
        width, length: its extent in x and y, m.
        start: time at which the mission starts, ISO 8601, UTC unless it says otherwise; "": the file's first.

    Raises:
        OceanError: the file does not serve; the message says why.
    """
    longitude, latitude = (float(part) for part in frame.to_geographic(np.array(width / 2), np.array(length / 2)))
    with open_decoded(path) as dataset:
        name = find(dataset, path, (STANDARD_NAME,)) or next((n for n in WELL_KNOWN if n in dataset.data_vars), None)
        if name is None:
            if not present(dataset):
                heights = dict.fromkeys(names.height for model in MODELS for names in model)
                raise OceanError(
                    f"{path}: no waves: neither a spectrum ({STANDARD_NAME}, {', '.join(WELL_KNOWN)}) nor a height of"
                    f" waves ({', '.join(heights)})"
                )
            return read_partitions(dataset, path, (longitude, latitude), start)
        source = Source.of(dataset, path, name, (longitude, latitude), start)
        spectrum = _read_spectrum(dataset, source)
        wind = find(dataset, path, ("wind_speed",))
        return Waves(str(path), source.start, spectrum, (), _read_wind(dataset, source, wind) if wind else None)


def _read_spectrum(dataset: xarray.Dataset, source: Source) -> WaveSpectrum:
    logarithm = source.array.name == "d2fd"
    for kind in ("frequency", "direction"):
        if kind not in source.spectral:
            raise OceanError(f"{source.where}: has no dimension of {kind}, known by its name or standard_name")
    factor = 1.0 if logarithm else factor_of(source.array, source.where, DENSITIES)
    frequency = _frequencies(dataset, source, logarithm)
    direction = _directions(dataset, source, logarithm)
    density, weight = np.zeros((len(frequency), len(direction))), 0.0
    for sample in source.samples:
        values = source.values(sample)
        missing = np.isnan(values)
        if missing.all():  # land
            continue
        if logarithm:
            values = _from_logarithm(source.where, values)
        elif missing.any():
            i, j = np.argwhere(missing)[0]
            raise OceanError(
                f"{source.where}: a value is missing at {frequency[i]:.3g} Hz, direction {j}; all must be given"
            )
        if not (values.min() >= 0 and values.max() * factor <= DENSEST):
            wrong = values.min() if not values.min() >= 0 else values.max()
            raise OceanError(f"{source.where}: {wrong:g}; allowed: 0 to {DENSEST / factor:g}: see its units and fill")
        density += sample.weight * factor * values
        weight += sample.weight
    if weight == 0:
        raise OceanError(f"{source.where}: has no values at the area: land, or the data have a gap")
    order = np.argsort(direction)
    spectrum = WaveSpectrum(frequency, direction[order], density[:, order] / weight)
    if not 0 < spectrum.significant_height <= HIGHEST_WAVES:
        raise OceanError(
            f"{source.where}: significant height {spectrum.significant_height:g} m; allowed: above 0, up to"
            f" {HIGHEST_WAVES:g} m: see its units and fill"
        )
    return spectrum


def _from_logarithm(where: str, values: np.ndarray) -> np.ndarray:
    """Densities from decadic logarithms, of which those of small ones are missing."""
    known = values[~np.isnan(values)]
    if known.max() > math.log10(DENSEST):
        raise OceanError(f"{where}: {known.max():g}; allowed: decadic logarithms up to {math.log10(DENSEST):g}")
    if known.min() >= 0:
        raise OceanError(
            f"{where}: at least {known.min():g} everywhere; allowed: decadic logarithms of the density, some below 0"
        )
    if (zeros := np.mean(known == 0)) > MOST_ZEROS:
        raise OceanError(
            f"{where}: 0 in {zeros:.0%} of its values, a density of 1; where there is none, one is missing"
        )
    return np.where(np.isnan(values), 0.0, 10.0 ** np.nan_to_num(values))


def _coordinate(dataset: xarray.Dataset, source: Source, kind: str) -> tuple[xarray.DataArray, np.ndarray, str]:
    """Coordinate of a spectral dimension, its values, and file and name."""
    name = source.spectral[kind]
    where = f"{source.where.partition(': ')[0]}: {name}"
    if name not in dataset.variables:
        raise OceanError(f"{where}: has no values; a coordinate must give them")
    require_numbers(dataset[name], where)
    return dataset[name], np.atleast_1d(netcdf.values(dataset[name], where).astype(np.float64)), where


def _some(values: np.ndarray) -> str:
    """The first and the last of some values."""
    return ", ".join(f"{value:.4g}" for value in values[:3]) + (f", ..., {values[-1]:.4g}" if len(values) > 3 else "")


def _known(variable: xarray.DataArray, values: np.ndarray, known: np.ndarray, where: str) -> np.ndarray | None:
    """ERA5's values, as they are or by their numbers from 1; None of others that have units."""
    count = len(values)
    if count <= len(known):
        if np.array_equal(values, np.arange(count) + 1):
            return known[:count]
        if np.allclose(values, known[:count], rtol=0.01):
            return values
    if "units" in variable.attrs:
        return None
    raise OceanError(f"{where}: {_some(values)}; allowed: ERA5's numbers 1, 2, ..., {len(known)}, or its values")


def _frequencies(dataset: xarray.Dataset, source: Source, era5: bool) -> np.ndarray:
    variable, values, where = _coordinate(dataset, source, "frequency")
    known = ERA5_FREQUENCY * ERA5_RATIO ** np.arange(ERA5_FREQUENCIES, dtype=float)
    found = _known(variable, values, known, where) if era5 else None
    found = values * factor_of(variable, where, HERTZ) if found is None else found
    if len(found) < 3 or not (np.diff(found) > 0).all() or not 0 < found[0] < found[-1] <= 10:
        raise OceanError(f"{where}: {_some(values)}; allowed: three or more, rising, 0 to 10 Hz")
    return found


def _directions(dataset: xarray.Dataset, source: Source, era5: bool) -> np.ndarray:
    variable, values, where = _coordinate(dataset, source, "direction")
    known = (np.arange(ERA5_DIRECTIONS) + 0.5) * 360 / ERA5_DIRECTIONS
    found = _known(variable, values, known, where) if era5 else None
    angles = values * factor_of(variable, where, ANGLES) if found is None else np.radians(found)
    steps = np.diff(np.sort(angles % (2 * math.pi)), append=np.min(angles % (2 * math.pi)) + 2 * math.pi)
    even = 2 * math.pi / len(angles)
    if len(angles) < 4 or not abs(steps - even).max() <= UNEVEN * even:
        raise OceanError(f"{where}: {_some(values)}; allowed: four or more in even steps round the circle")
    comes_from = False if era5 else _comes_from(variable)
    if comes_from is None:
        raise OceanError(
            f"{where}: its standard_name must say which way, as sea_surface_wave_to_direction or"
            " sea_surface_wave_from_direction"
        )
    return travel(angles, comes_from)


def _comes_from(variable: xarray.DataArray) -> bool | None:
    """Whether a direction is that which waves come from, by its standard_name or long_name; None where none says so."""
    for attribute in ("standard_name", "long_name"):
        found = WAY.search(str(variable.attrs.get(attribute, "")).replace("_", " "))
        if found:
            return found[1] is not None
    return None


def _read_wind(dataset: xarray.Dataset, source: Source, name: str) -> float | None:
    """Wind speed beside a spectrum, m/s; None where the variable lies on other dimensions or has no values."""
    array, where = dataset[name], f"{source.where.partition(': ')[0]}: {name}"
    if not set(array.dims) <= {dimension for sample in source.samples for dimension in sample.index}:
        return None
    factor = factor_of(array, where, METRES_PER_SECOND)
    beside = Source(where, array, {}, source.samples, source.start)
    speeds = np.array([float(beside.values(sample)) * factor for sample in source.samples])
    weights = np.array([sample.weight for sample in source.samples])
    known = np.isfinite(speeds)
    if not known.any():
        return None
    speed = float(np.average(speeds[known], weights=weights[known]))
    if not 0 <= speed <= STRONGEST:
        raise OceanError(f"{where}: {speed:g} m/s; allowed: 0 to {STRONGEST:g} m/s: see its units and fill")
    return speed


class _Names(NamedTuple):
    """Variables of one wave system, of each the first that a file has, separated by spaces; `spread` may be "".

    `periods` go by what they are: 0 peaks, or the peaks' frequencies, k means of the moments m0 and m_k.
    """

    height: str
    periods: dict[int, str]
    direction: str
    spread: str
    wind_sea: bool

    def found(self, dataset: xarray.Dataset) -> tuple[str, str, str, str, int]:
        """Height, period, direction and spread in a file, "" where it has none, and the period's moment."""

        def first(text: str) -> str:
            return next((name for name in text.split() if name in dataset.data_vars), "")

        periods = [(first(text), moment) for moment, text in self.periods.items()]
        period, moment = next((each for each in periods if each[0]), ("", 0))
        return first(self.height), period, first(self.direction), first(self.spread), moment


def _of_era5(height: str, period: str, direction: str, spread: str = "", wind_sea: bool = False) -> _Names:
    return _Names(height, {-1: period}, direction, spread, wind_sea)


ERA5_WIND_SEA = _of_era5("shww", "mpww", "mdww wvdir", "dwww", True)
MODELS = (  # of which the one with most systems in a file is taken, of several the first
    (  # all waves: ERA5 and NCEP, CMEMS, WAVEWATCH III and SWAN, NCEP's GRIB by wgrib2, ERDDAP, buoys of NDBC
        _Names("swh", {0: "pp1d perpw", -1: "mwp"}, "mwd dirpw", "wdw", True),
        _Names("VHM0", {0: "VTPK", -1: "VTM10", 2: "VTM02"}, "VMDR VPED", "", True),
        _Names(
            "hs",
            {0: "tp fp tps rtp", -1: "t0m1 tmm10", 1: "t01 tm01", 2: "t02 tm02"},
            "dir theta0 dp",
            "spr spread",
            True,
        ),
        _Names("HTSGW_surface", {0: "PERPW_surface"}, "DIRPW_surface", "", True),
        _Names("Thgt", {0: "Tper"}, "Tdir", "", True),
        _Names("wave_height", {0: "dominant_wpd", 2: "average_wpd"}, "mean_wave_dir", "", True),
    ),
    tuple(_Names(f"phs{n}", {0: f"ptp{n}"}, f"pdir{n}", f"pspr{n}", n == 0) for n in range(9)),
    (ERA5_WIND_SEA, *(_of_era5(f"swh{n}", f"mwp{n}", f"mwd{n}") for n in (1, 2, 3))),
    (ERA5_WIND_SEA, *(_of_era5(f"p{n}", f"p{n + 2}", f"p{n + 1}") for n in (140121, 140124, 140127))),
    (ERA5_WIND_SEA, _of_era5("shts", "mpts", "mdts swdir", "dwps")),
    tuple(_Names(f"VHM0_{n}", {1: f"VTM01_{n}"}, f"VMDR_{n}", "", n == "WW") for n in ("WW", "SW1", "SW2")),
)


def present(dataset: xarray.Dataset) -> list[_Names]:
    """The wave systems that a file has, by the model's names of which it has most."""
    whole, *parts = ([names for names in model if names.height in dataset.data_vars] for model in MODELS)
    return max((whole[:1], *parts), key=len)


def read_partitions(dataset: xarray.Dataset, path: str | Path, place: tuple[float, float], start: str) -> Waves:
    """Waves of a file of partitions at (longitude, latitude) and a start.

    Raises:
        OceanError: the file does not serve; the message says why.
    """
    systems = present(dataset)
    for names in systems:
        _, period, direction, *_ = names.found(dataset)
        for found, allowed in ((period, " ".join(names.periods.values())), (direction, names.direction)):
            if not found:
                raise OceanError(f"{path}: has {names.height} but no {allowed.replace(' ', ', ')}")
    of = {
        name: Source.of(dataset, path, name, place, start)
        for names in systems
        for name in names.found(dataset)[:4]
        if name
    }
    first = of[systems[0].height]
    for sample in first.samples:
        partitions = [part for names in systems if (part := _partition(dataset, of, names, sample))]
        if partitions:
            return Waves(str(path), first.start, None, tuple(partitions), None)
    raise OceanError(f"{first.where}: has no values at the area: land, calm, or the data have a gap")


def _partition(dataset: xarray.Dataset, of: dict[str, Source], names: _Names, sample: Sample) -> Partition | None:
    """A wave system at a time and point; None where it has none."""

    def value(name: str, units: dict[str, float], low: float, high: float) -> float:
        source = of[name]
        number = float(source.values(sample)) * factor_of(source.array, source.where, units)
        if not math.isnan(number) and not low <= number <= high:
            raise OceanError(f"{source.where}: {number:g}; allowed: {low:g} to {high:g}: see its units and fill")
        return number

    of_height, of_period, of_direction, of_spread, moment = names.found(dataset)
    height = value(of_height, METRES, 0.0, HIGHEST_WAVES)
    if not height > 0:
        return None
    if str(dataset[of_period].attrs.get("units")).lower() in HERTZ:
        period = 1 / value(of_period, HERTZ, *(1 / period for period in reversed(PERIODS)))
    else:
        period = value(of_period, SECONDS, *PERIODS)
    angle = value(of_direction, ANGLES, -2 * math.pi, 4 * math.pi)
    spread = value(of_spread, WIDTHS, 0.0, WIDEST) if of_spread else math.nan
    for name, number in ((of_period, period), (of_direction, angle)):
        if math.isnan(number):
            raise OceanError(f"{of[name].where}: is missing where {of_height} is {height:g} m")
    direction = float(travel(np.array(angle), comes_from=_comes_from(dataset[of_direction]) is not False))
    return Partition(height, period, direction, None if math.isnan(spread) else spread, moment, names.wind_sea)


def travel(angle: np.ndarray, comes_from: bool) -> np.ndarray:
    """Directions of travel from east towards north in −π to π from angles clockwise from north, rad."""
    east = math.pi / 2 - np.asarray(angle) + (math.pi if comes_from else 0.0)
    return np.angle(np.exp(1j * east))
