"""Wind sea and swells in NetCDF files of WAVEWATCH III and ERA5, by their heights, periods, directions and spreads.

Directions are those that waves come from, spreads √(2(1 − r₁)) of the first moment r₁ of the directions. Periods of
WAVEWATCH III's partitions are those of the peaks (https://github.com/NOAA-EMC/WW3, `model/src/w3ounfmetamd.F90`), of
ERA5's parts means T₋₁,₀ = m₋₁/m₀ (ECMWF, "IFS documentation, part VII: ECMWF wave model").
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from usvauv.env.site.cf import METRES, OceanError, factor_of
from usvauv.env.site.wave_source import Sample, Source
from usvauv.env.site.waves import Partition, Waves

if TYPE_CHECKING:
    import xarray

SECONDS: dict[str, float] = dict.fromkeys(("s", "sec", "second", "seconds"), 1.0)
ANGLES: dict[str, float] = dict.fromkeys(
    ("degree", "degrees", "deg", "degree true", "degrees true", "degree_true", "degrees_true"), math.pi / 180
)
WIDTHS = {**ANGLES, **dict.fromkeys(("radian", "radians", "rad", "dimensionless", "1", "~"), 1.0)}
HIGHEST_WAVES, PERIODS, WIDEST = 30.0, (0.5, 30.0), math.sqrt(2)  # m, s, rad


class _Names(NamedTuple):
    """Variables of one wave system; `spread` is "" where a model has none."""

    height: str
    period: str
    direction: str
    spread: str
    mean_period: bool
    wind_sea: bool


ERA5_WIND_SEA = _Names("shww", "mpww", "mdww", "dwww", True, True)
MODELS = (  # of which the one with most variables in a file is taken
    tuple(_Names(f"phs{n}", f"ptp{n}", f"pdir{n}", f"pspr{n}", False, n == 0) for n in range(9)),
    (ERA5_WIND_SEA, *(_Names(f"swh{n}", f"mwp{n}", f"mwd{n}", "", True, False) for n in (1, 2, 3))),
    (ERA5_WIND_SEA, *(_Names(f"p{n}", f"p{n + 2}", f"p{n + 1}", "", True, False) for n in (140121, 140124, 140127))),
    (ERA5_WIND_SEA, _Names("shts", "mpts", "mdts", "dwps", True, False)),
    (_Names("swh", "pp1d", "mwd", "wdw", False, True),),
    (_Names("hs", "tp", "dir", "spr", False, True),),
)


def present(dataset: xarray.Dataset) -> list[_Names]:
    """The wave systems that a file has, by the model's names of which it has most."""
    return max(([names for names in model if names.height in dataset.data_vars] for model in MODELS), key=len)


def read_partitions(dataset: xarray.Dataset, path: str | Path, place: tuple[float, float], start: str) -> Waves:
    """Waves of a file of partitions at (longitude, latitude) and a start.

    Raises:
        OceanError: the file does not serve; the message says why.
    """
    systems = present(dataset)
    for names in systems:
        for needed in (names.period, names.direction):
            if needed not in dataset.data_vars:
                raise OceanError(f"{path}: has {names.height} but no {needed}")
    of = {
        name: Source.of(dataset, path, name, place, start)
        for names in systems
        for name in names[:4]
        if name in dataset.data_vars
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

    height = value(names.height, METRES, 0.0, HIGHEST_WAVES)
    if not height > 0:
        return None
    period = value(names.period, SECONDS, *PERIODS)
    angle = value(names.direction, ANGLES, -2 * math.pi, 4 * math.pi)
    spread = value(names.spread, WIDTHS, 0.0, WIDEST) if names.spread in of else math.nan
    for name, number in ((names.period, period), (names.direction, angle)):
        if math.isnan(number):
            raise OceanError(f"{of[name].where}: is missing where {names.height} is {height:g} m")
    words = str(dataset[names.direction].attrs.get("standard_name", "")).replace("_", " ")
    direction = float(travel(np.array(angle), comes_from="to direction" not in words))
    return Partition(
        height, period, direction, None if math.isnan(spread) else spread, names.mean_period, names.wind_sea
    )


def travel(angle: np.ndarray, comes_from: bool) -> np.ndarray:
    """Directions of travel from east towards north in −π to π from angles clockwise from north, rad."""
    east = math.pi / 2 - np.asarray(angle) + (math.pi if comes_from else 0.0)
    return np.angle(np.exp(1j * east))
