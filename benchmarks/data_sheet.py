"""Speed, power, endurance, turning circle, modem rate and fix error of the classes beside published figures.

    python -m benchmarks.data_sheet

The maker's are those of the data sheet of Hydroid and Kongsberg: 22 h at 3 knots, 8 h at 5 knots from 1 kWh, at most 5
knots. Turning circles are published as coefficients: those of T. Prestero (2001), doi 10.1575/1912/3040, adjusted to
trials at sea, of which the radius is computed here, and those of Fossen's public simulator
(`benchmarks.vehicles.RUDDER`).

Sparus II: 8 to 10 h, Carreras et al. (2018), doi 10.1109/JOE.2018.2792278. Otter: 20 h at 2 knots, its maker, from four
batteries of 915 Wh. The modem is compared with WHOI's Micro-Modem, which has a band of 4 kHz too and sends 80 to 5,400
bit/s: Freitag et al. (2005), doi 10.1109/OCEANS.2005.1639901. Makers state the error of a USBL's bearing: 0.1°
(EvoLogics, S2C R USBL) to 1° (Blueprint Subsea, SeaTrac X150). Here it is that of heading, mounting, pitch and roll in
`coast`, without noise, which matters at long range only.
"""

import argparse
import json
import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import root

from benchmarks.machine import parse
from benchmarks.vehicles import RUDDER, settled
from usvauv.env import Scenario
from usvauv.kernels.vehicles.vehicle import LANES
from usvauv.policies.guidance import level_power

KNOT = 1852 / 3600  # m/s
ENDURANCE = {3: 22.0, 5: 8.0}  # knots → h, the maker
TOP_SPEED = 2.6  # m/s, the maker
CRUISE = 12.5  # revolutions a second: 1.5 m/s
OTTER_BATTERY = 4 * 915.0  # Wh, the maker
MASS = 299 / 9.81  # kg, of Prestero's vehicle
# Prestero's coefficients in the horizontal plane by their indices, SI units; of a rudder's angle, in rad, positive here
# to port. Those of v|v| in sway and r|r| in yaw are ten times what he computes for the hull.
Y = {"v|v|": -1310.0, "r|r|": 0.632, "uv": -28.6, "ur": 5.22, "uu": 9.64}
N = {"v|v|": -3.18, "r|r|": -94.0, "uv": -24.0, "ur": -2.0, "uu": -6.15}


class Row(NamedTuple):
    """A figure: what it is, published, of points and of torpedoes of the class; NaN where there is none."""

    what: str
    published: float
    point: float
    torpedo: float
    source: str


def prestero_radius(degrees: float) -> float:
    """Radius of the steady turn by Prestero's coefficients, m; in proportion to u the forces are those of u = 1."""

    def forces(state: np.ndarray) -> list[float]:
        v, r = state
        terms = {"v|v|": v * abs(v), "r|r|": r * abs(r), "uv": v, "ur": r, "uu": math.radians(degrees)}
        sway, yaw = (sum(part[name] * terms[name] for name in terms) for part in (Y, N))
        return [sway - MASS * r, yaw]

    v, r = root(forces, [0.05, -0.1]).x
    return math.hypot(1.0, v) / abs(r)


def scenario(model: str) -> Scenario:
    """AUVs of the class, as points or torpedoes."""
    return Scenario.from_dict({"auv": {"vehicle": "remus-100", "model": model}, "nodes": {"service": "passing"}})


def rows() -> list[Row]:
    """All figures."""
    team = {model: scenario(model) for model in ("point", "torpedo")}
    numbers, battery = dict(team["torpedo"].torpedo), team["torpedo"].auv.battery
    point, torpedo = (level_power(each, [knots * KNOT for knots in ENDURANCE]) for each in team.values())
    found = []
    for (knots, hours), one, other in zip(ENDURANCE.items(), point, torpedo, strict=True):
        found.append(Row(f"endurance at {knots} knots, h", hours, battery / one, battery / other, "maker"))
        found.append(Row(f"power at {knots} knots, W", battery / hours, one, other, "1 kWh over that"))
    fastest, _ = settled(numbers, numbers["propeller_limit"])
    found.append(Row("top speed, m/s", TOP_SPEED, team["point"].auv.speed_max, float(fastest[0]), "maker"))
    speed, turn = settled(numbers, CRUISE, np.resize(np.deg2rad([*RUDDER]), LANES))
    for i, (degrees, simulated) in enumerate(RUDDER.items()):
        radius, what = float(speed[i] / turn[i]), f"radius at {degrees}° of rudder, m"
        found.append(Row(what, prestero_radius(degrees), math.nan, radius, "Prestero, fitted to trials at sea"))
        found.append(Row(what, simulated, math.nan, radius, "Fossen's simulator"))
    return found


def others() -> list[tuple[str, str, str]]:
    """Figures of the other classes and of the link: what, published, here."""
    hovering = Scenario.from_dict({"auv": {"vehicle": "sparus-ii"}})
    (power,) = level_power(hovering, [3 * KNOT])
    boat = Scenario.from_dict({"boat": {"vessel": "otter"}}).boat
    loitering = boat.hotel + boat.propulsion_power * (2 * KNOT / boat.top_speed) ** 3
    coast = Scenario.load("coast")
    bearing = math.hypot(coast.usbl.heading_error, coast.usbl.attitude_error, coast.usbl.alignment_error)
    return [
        ("Sparus II, endurance at 3 knots, h", "8 to 10", f"{hovering.auv.battery / power:.1f}"),
        ("Otter, endurance at 2 knots, h", "20", f"{OTTER_BATTERY / loitering:.1f}"),
        ("acoustic modem, bit/s", "80 to 5400", f"{coast.channel.bit_rate:g}"),
        ("error of a USBL's bearing, degrees", "0.1 to 1", f"{math.degrees(bearing):.2f}"),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    if parse(parser).json:
        print(json.dumps([row._asdict() for row in rows()], indent=1))
        return
    print(f"{'REMUS 100':28} {'published':>9} {'point':>7} {'torpedo':>7}  source")
    for row in rows():
        point = "" if math.isnan(row.point) else f"{row.point:.3g}"
        print(f"{row.what:28} {row.published:9.3g} {point:>7} {row.torpedo:7.3g}  {row.source}")
    print(f"\n{'others':36} {'published':>10} {'here':>7}")
    for what, published, here in others():
        print(f"{what:36} {published:>10} {here:>7}")


if __name__ == "__main__":
    main()
