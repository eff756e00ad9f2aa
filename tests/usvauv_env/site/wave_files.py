"""Small files of waves, written as WAVEWATCH III and ERA5 write theirs, and what is in them in closed form."""

import math

import numpy as np
import xarray

from usvauv.env import Scenario
from usvauv.env.site.place import LocalFrame
from usvauv.env.site.waves import WaveSpectrum, read_waves

FRAME = LocalFrame(5.0, 60.0)
SIZE = 2000.0
TIME = {"standard_name": "time", "units": "days since 1990-01-01 00:00:00", "axis": "T"}
HOURLY = {"standard_name": "time", "units": "hours since 1900-01-01 00:00:00"}
FREQUENCIES = 0.035 * 1.1 ** np.arange(31)
ERA5_FREQUENCIES = 0.03453 * 1.1 ** np.arange(30)


def density(f, towards, *systems):
    """E(f, θ), m²/(Hz rad), of systems of Hs (m), Tp (s), direction of travel clockwise from north (°), and s.

    Over frequencies f (F,) Hz and directions of travel (D,), degrees clockwise from north. Each is the spectrum of
    Pierson and Moskowitz, whose m0 is Hs²/16, times cos^2s(½Δθ) scaled to the integral 1.
    """
    total = 0.0
    for height, period, heading, s in systems:
        fp = 1 / period
        S = height**2 / 16 * 5 * fp**4 * f**-5.0 * np.exp(-1.25 * (fp / f) ** 4)
        scale = math.gamma(s + 1) / (2 * math.sqrt(math.pi) * math.gamma(s + 0.5))
        total = total + np.outer(S, scale * np.abs(np.cos(np.radians(towards - heading) / 2)) ** (2 * s))
    return total


def ww3(*systems, days=(9000.0, 9000.125), stations=((5.02, 60.01),), count=36, growth=0.0, comes_from=False):
    """Spectra at stations (longitude, latitude), as `ww3_ounp` writes them; energy grows by `growth` a time."""
    direction = (90.0 - np.arange(count) * 360 / count) % 360  # the model's order: anticlockwise from east
    E = density(FREQUENCIES, direction + 180 if comes_from else direction, *systems)
    by_time = np.stack([(1 + growth * i) * E for i in range(len(days))])
    efth = np.repeat(by_time[:, None], len(stations), axis=1).astype(np.float32)
    way = "from" if comes_from else "to"
    places = np.array(stations, np.float32).T
    return xarray.Dataset(
        {
            "efth": (
                ("time", "station", "frequency", "direction"),
                efth,
                {
                    "standard_name": "sea_surface_wave_directional_variance_spectral_density",
                    "units": "m2 s rad-1",
                },
            ),
            **{
                name: (
                    ("time", "station"),
                    np.repeat(part[None], len(days), axis=0),
                    {"standard_name": name, "units": units},
                )
                for name, part, units in zip(
                    ("longitude", "latitude"), places, ("degree_east", "degree_north"), strict=True
                )
            },
            "wnd": (
                ("time", "station"),
                np.full(efth.shape[:2], 12.0),
                {"standard_name": "wind_speed", "units": "m s-1"},
            ),
        },
        {
            "time": ("time", np.array(days), TIME),
            "station": ("station", np.arange(len(stations)) + 1, {"long_name": "station id", "axis": "X"}),
            "frequency": (
                "frequency",
                FREQUENCIES.astype(np.float32),
                {"standard_name": "sea_surface_wave_frequency", "units": "s-1", "axis": "Y"},
            ),
            "direction": (
                "direction",
                direction.astype(np.float32),
                {"standard_name": f"sea_surface_wave_{way}_direction", "units": "degree", "axis": "Z"},
            ),
        },
    )


def era5(*systems, lon=(4.5, 5.0, 5.5), lat=(60.5, 60.0, 59.5), hours=(1_100_000.0,), faintest=-5.0):
    """Spectra on a grid, as ERA5's `d2fd`: logarithms, those of small densities missing, over numbers."""
    towards = 7.5 + 15.0 * np.arange(24)
    logarithm = np.log10(density(ERA5_FREQUENCIES, towards, *systems) + 1e-30)
    logarithm[logarithm < faintest] = np.nan
    shape = (len(hours), *logarithm.shape, len(lat), len(lon))
    return xarray.Dataset(
        {
            "d2fd": (
                ("time", "frequency", "direction", "latitude", "longitude"),
                np.broadcast_to(logarithm[None, :, :, None, None], shape).astype(np.float32),
                {"long_name": "2D wave spectra (single)", "units": "m**2 s radian**-1"},
            )
        },
        {
            "time": ("time", np.array(hours), HOURLY),
            "frequency": ("frequency", np.arange(30) + 1, {"long_name": "frequency"}),
            "direction": ("direction", np.arange(24) + 1, {"long_name": "direction"}),
            "latitude": ("latitude", np.array(lat), {"units": "degrees_north"}),
            "longitude": ("longitude", np.array(lon), {"units": "degrees_east"}),
        },
    )


def fields(names, units, values, lon=(4.5, 5.0, 5.5), lat=(59.5, 60.0, 60.5), hours=(1_100_000.0,), **attributes):
    """Parameters of waves on a grid, alike everywhere."""
    shape = (len(hours), len(lat), len(lon))
    return xarray.Dataset(
        {
            name: (("time", "latitude", "longitude"), np.full(shape, value), {"units": unit, **attributes})
            for name, unit, value in zip(names, units, values, strict=True)
        },
        {
            "time": ("time", np.array(hours), HOURLY),
            "latitude": ("latitude", np.array(lat), {"units": "degrees_north", "standard_name": "latitude"}),
            "longitude": ("longitude", np.array(lon), {"units": "degrees_east", "standard_name": "longitude"}),
        },
    )


def partitions(*systems, **changes) -> xarray.Dataset:
    """WAVEWATCH III's partitions of Hs (m), Tp (s), direction that they come from (°) and spread (°)."""
    names = [f"{name}{n}" for n in range(len(systems)) for name in ("phs", "ptp", "pdir", "pspr")]
    return fields(names, ("m", "s", "degree", "degree") * len(systems), np.ravel(systems), **changes)


def waves_of(dataset, tmp_path, start="", frame=FRAME):
    path = tmp_path / "waves.nc"
    dataset.to_netcdf(path, engine="h5netcdf")
    return read_waves(path, frame, SIZE, SIZE, start)


def spectrum_of(dataset, tmp_path, start="", frame=FRAME) -> WaveSpectrum:
    spectrum = waves_of(dataset, tmp_path, start, frame).spectrum
    assert spectrum is not None
    return spectrum


def scenario_of(dataset, tmp_path, *changes) -> Scenario:
    path = tmp_path / "waves.nc"
    dataset.to_netcdf(path, engine="h5netcdf")
    place = (f"water.longitude={FRAME.longitude}", f"water.latitude={FRAME.latitude}")
    return Scenario.load("extreme", [f"water.waves={path}", *place, *changes])
