"""Wave spectra in NetCDF files of WAVEWATCH III and ERA5, at a place and a time.

A spectrum of WAVEWATCH III is `efth` at stations, by the direction that waves travel to (`model/src/ww3_ounp.F90`).
One of ERA5 is `d2fd`: the decadic logarithm of the density, missing where that is small, over numbers of frequencies
and directions in place of their values. The first frequency is 0.03453 Hz and each next one 1.1 times as high. The
directions, 7.5°, 22.5° and so on, are those that waves travel to. Sources: https://github.com/NOAA-EMC/WW3;
https://confluence.ecmwf.int/display/CKB/About+ERA+wave+spectra.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from usvauv.env.site.cf import METRES_PER_SECOND, OceanError, factor_of, find, open_file, require_numbers
from usvauv.env.site.local_frame import LocalFrame
from usvauv.env.site.wave_partitions import ANGLES, HIGHEST_WAVES, MODELS, present, read_partitions, travel
from usvauv.env.site.wave_source import Source
from usvauv.env.site.waves import Waves, WaveSpectrum

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
UNEVEN = 0.02  # share of the step by which directions may miss even steps


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
    with open_file(path) as dataset:
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
    frequency, direction = (
        (_numbered(dataset, source, ERA5_FREQUENCIES, "frequency"), _numbered(dataset, source, 0, "direction"))
        if logarithm
        else (_frequencies(dataset, source), _directions(dataset, source))
    )
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
    return np.where(np.isnan(values), 0.0, 10.0 ** np.nan_to_num(values))


def _coordinate(dataset: xarray.Dataset, source: Source, kind: str) -> tuple[xarray.DataArray, np.ndarray, str]:
    """Coordinate of a spectral dimension, its values, and file and name."""
    from usvauv.env.netcdf import reader

    name = source.spectral[kind]
    where = f"{source.where.partition(': ')[0]}: {name}"
    if name not in dataset.variables:
        raise OceanError(f"{where}: has no values; a coordinate must give them")
    require_numbers(dataset[name], where)
    return dataset[name], np.atleast_1d(reader.load(dataset[name], where).astype(np.float64)), where


def _some(values: np.ndarray) -> str:
    """The first and the last of some values."""
    return ", ".join(f"{value:.4g}" for value in values[:3]) + (f", ..., {values[-1]:.4g}" if len(values) > 3 else "")


def _frequencies(dataset: xarray.Dataset, source: Source) -> np.ndarray:
    variable, values, where = _coordinate(dataset, source, "frequency")
    values = values * factor_of(variable, where, HERTZ)
    if len(values) < 3 or not (np.diff(values) > 0).all() or not 0 < values[0] < values[-1] <= 10:
        raise OceanError(f"{where}: {_some(values)}; allowed: three or more, rising, 0 to 10 Hz")
    return values


def _directions(dataset: xarray.Dataset, source: Source) -> np.ndarray:
    variable, values, where = _coordinate(dataset, source, "direction")
    angles = values * factor_of(variable, where, ANGLES)
    steps = np.diff(np.sort(angles % (2 * math.pi)), append=np.min(angles % (2 * math.pi)) + 2 * math.pi)
    even = 2 * math.pi / len(angles)
    if len(angles) < 4 or not abs(steps - even).max() <= UNEVEN * even:
        raise OceanError(f"{where}: {_some(values)}; allowed: four or more in even steps round the circle")
    return travel(angles, _comes_from(variable, where))


def _comes_from(variable: xarray.DataArray, where: str) -> bool:
    """Whether a direction is that which waves come from, by the standard_name or the long_name of a variable."""
    for attribute in ("standard_name", "long_name"):
        words = str(variable.attrs.get(attribute, "")).replace("_", " ")
        if "from direction" in words or "to direction" in words:
            return "from direction" in words
    raise OceanError(
        f"{where}: its standard_name must say which way, as sea_surface_wave_to_direction or"
        " sea_surface_wave_from_direction"
    )


def _numbered(dataset: xarray.Dataset, source: Source, most: int, kind: str) -> np.ndarray:
    """ERA5's frequencies (Hz) or directions of travel (rad) by their numbers from 1."""
    _, values, where = _coordinate(dataset, source, kind)
    count = len(values)
    right = 3 <= count <= most if kind == "frequency" else count == ERA5_DIRECTIONS
    if not right or not np.array_equal(values, np.arange(count) + 1):
        allowed = f"up to {most}" if kind == "frequency" else f"{ERA5_DIRECTIONS}"
        raise OceanError(f"{where}: {_some(values)}; allowed: ERA5's numbers 1, 2, ..., {allowed}")
    if kind == "frequency":
        return ERA5_FREQUENCY * ERA5_RATIO ** (values - 1)
    return travel((values - 0.5) * 2 * math.pi / ERA5_DIRECTIONS, comes_from=False)


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
