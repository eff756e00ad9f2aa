"""What gives arrays on the local plane a place and a time in a file: CF's grid mapping, coordinates and clock.

The plane of `local_frame` is the orthographic projection of the ellipsoid about the area's south-west corner, EPSG's
method 9840. Source: https://cfconventions.org, section 5.6 and appendix F; IOGP, "Geomatics guidance note 7-2".
"""

from __future__ import annotations

from usvauv.env.site.local_frame import EQUATOR, FLATTENING, LocalFrame

CRS = "crs"  # name of the variable with the grid mapping
LONGITUDE = {"standard_name": "longitude", "long_name": "longitude", "units": "degrees_east"}
LATITUDE = {"standard_name": "latitude", "long_name": "latitude", "units": "degrees_north"}
X, Y = (
    {
        "standard_name": f"projection_{name}_coordinate",
        "long_name": f"{way} distance from the south-west corner",
        "units": "m",
    }
    for name, way in (("x", "eastward"), ("y", "northward"))
)

DEGREE, METRE = 'ANGLEUNIT["degree",0.0174532925199433]', 'LENGTHUNIT["metre",1]'
WKT = (
    'PROJCRS["plane of the area",BASEGEOGCRS["WGS 84",DATUM["World Geodetic System 1984",'
    f'ELLIPSOID["WGS 84",{EQUATOR:.0f},{{flattening}},{METRE}]],PRIMEM["Greenwich",0,{DEGREE}]],'
    'CONVERSION["about the south-west corner",METHOD["Orthographic",ID["EPSG",9840]],'
    f'PARAMETER["Latitude of natural origin",{{latitude}},{DEGREE},ID["EPSG",8801]],'
    f'PARAMETER["Longitude of natural origin",{{longitude}},{DEGREE},ID["EPSG",8802]],'
    f'PARAMETER["False easting",0,{METRE},ID["EPSG",8806]],PARAMETER["False northing",0,{METRE},ID["EPSG",8807]]],'
    f'CS[Cartesian,2],AXIS["(E)",east,ORDER[1]],AXIS["(N)",north,ORDER[2]],{METRE}]'
)


def grid_mapping(frame: LocalFrame) -> dict[str, str | float]:
    """Attributes of the variable `CRS`, by CF and as WKT 2."""
    flattening = round(1 / FLATTENING, 9)
    return {
        "grid_mapping_name": "orthographic",
        "long_name": "tangent plane to WGS84 at the south-west corner of the area",
        "longitude_of_projection_origin": frame.longitude,
        "latitude_of_projection_origin": frame.latitude,
        "false_easting": 0.0,
        "false_northing": 0.0,
        "semi_major_axis": EQUATOR,
        "inverse_flattening": flattening,
        "longitude_of_prime_meridian": 0.0,
        "crs_wkt": WKT.format(flattening=flattening, latitude=frame.latitude, longitude=frame.longitude),
    }


def clock(start: str, beginning: str) -> dict[str, str]:
    """Attributes of a coordinate of seconds.

    Args:
        start: date and time of its second 0, ISO 8601, UTC; "" where nothing says it: then it is no CF time.
        beginning: what begins then.
    """
    about = {"long_name": f"time since {beginning}", "axis": "T"}
    if not start:
        return about | {"units": "s"}
    return about | {
        "standard_name": "time",
        "units": f"seconds since {start.replace('T', ' ')}",
        "calendar": "standard",
        "units_metadata": "leap_seconds: none",
    }


def start_of(units: str) -> str:
    """The start that `clock` was given, by the units that it gave."""
    return units.partition(" since ")[2].replace(" ", "T")
