"""Small files of currents and bathymetry, written as CMEMS, HYCOM and GEBCO write theirs, and their analytic fields."""

import numpy as np
import xarray

from usvauv.env.site.ocean import read_bathymetry, read_flow
from usvauv.env.site.place import LocalFrame

FRAME = LocalFrame(5.02, 60.03)
WIDTH, LENGTH = 8000.0, 6000.0
LEVELS = (0.494, 100.0)
LONGITUDES = np.arange(4.75, 5.51, 1 / 12)
LATITUDES = np.arange(59.75, 60.51, 1 / 12)
DEPTHS = np.array([0.494, 1.541, 92.326, 109.729, 130.666])
HOURS = np.arange(4) * 6.0


def eastward(lon, lat, depth, t):
    """Linear in each of degrees, m and s; m/s."""
    return 0.3 + 0.2 * (lon - 5) - 0.4 * (lat - 60) - 1e-3 * depth + 1e-5 * t


def northward(lon, lat, depth, t):
    return -0.1 - 0.3 * (lon - 5) + 0.1 * (lat - 60) + 2e-3 * depth - 2e-5 * t


def cmems(lon=LONGITUDES, lat=LATITUDES, depth=DEPTHS, hours=HOURS, fields=(eastward, northward)) -> xarray.Dataset:
    """A cut of the global CMEMS forecast, with undecoded time."""
    t, z, y, x = np.meshgrid(hours * 3600, depth, lat, lon, indexing="ij")
    dimensions = ("time", "depth", "latitude", "longitude")
    variables = {
        name: (dimensions, speed(x, y, z, t), {"standard_name": f"{side}_sea_water_velocity", "units": "m s-1"})
        for name, side, speed in zip(("uo", "vo"), ("eastward", "northward"), fields, strict=True)
    }
    coordinates = {
        "longitude": ("longitude", lon, {"standard_name": "longitude", "units": "degrees_east", "axis": "X"}),
        "latitude": ("latitude", lat, {"standard_name": "latitude", "units": "degrees_north", "axis": "Y"}),
        "depth": ("depth", depth, {"standard_name": "depth", "units": "m", "positive": "down", "axis": "Z"}),
        "time": ("time", hours, {"standard_name": "time", "units": "hours since 1950-01-01", "axis": "T"}),
    }
    return xarray.Dataset(variables, coordinates)


def gebco(lon, lat, elevation, standard_name="height_above_mean_sea_level", name="elevation") -> xarray.Dataset:
    """A cut of the GEBCO grid; `elevation` is (lat, lon), m."""
    attributes = {"standard_name": standard_name, "units": "m", "long_name": "Elevation relative to sea level"}
    coordinates = {
        "lon": ("lon", lon, {"standard_name": "longitude", "units": "degrees_east"}),
        "lat": ("lat", lat, {"standard_name": "latitude", "units": "degrees_north"}),
    }
    return xarray.Dataset({name: (("lat", "lon"), elevation, attributes)}, coordinates)


def write(dataset: xarray.Dataset, path, **encoding):
    dataset.to_netcdf(path, engine="h5netcdf", encoding=encoding)
    return path


def nodes(flow, frame=FRAME):
    """Longitude and latitude, (ny, nx), of a flow's nodes."""
    ny, nx = flow.velocity.shape[2:4]
    return frame.to_geographic(*np.meshgrid(np.linspace(0, flow.width, nx), np.linspace(0, flow.length, ny)))


def flow_of(dataset, tmp_path, **asked):
    asked = {"levels": LEVELS, "duration": 7200.0} | asked
    return read_flow(write(dataset, tmp_path / "currents.nc"), FRAME, WIDTH, LENGTH, **asked)


def centres(frame, width, length, cells):
    """Longitude and latitude, (ny, nx), of the cells' centres."""
    x, y = ((np.arange(n) + 0.5) * extent / n for n, extent in zip(cells, (width, length), strict=True))
    return frame.to_geographic(*np.meshgrid(x, y))


BED_FRAME = LocalFrame(5.0, 60.0)
BED_LONGITUDES, BED_LATITUDES = np.arange(4.9, 5.4, 1 / 240), np.arange(59.9, 60.3, 1 / 240)


def bed_depth(lon, lat):
    """Linear: deep in the south-west, dry in the north-east; m."""
    return 100 - 700 * (lon - 5) - 900 * (lat - 60)


def sloping(**changes) -> xarray.Dataset:
    """A cut of the GEBCO grid with the bed `bed_depth`."""
    lon, lat = np.meshgrid(BED_LONGITUDES, BED_LATITUDES)
    return gebco(BED_LONGITUDES, BED_LATITUDES, -bed_depth(lon, lat), **changes)


def bed_of(dataset, tmp_path, width=15000.0, length=12000.0, cells=(100, 80)):
    return read_bathymetry(write(dataset, tmp_path / "bed.nc"), BED_FRAME, width, length, cells)
