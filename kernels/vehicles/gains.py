"""Numbers of a torpedo's autopilot, each once: default, range, unit, reason. Lengths are in hull lengths.

The defaults were tuned on the REMUS 100 of `numbers`, for 0.8 to 2.5 m/s and ±20 % of its mass, drag and fins.
"""

import math
from collections.abc import Mapping

import numpy as np

from usvauv.kernels.columns import columns
from usvauv.kernels.limits import Quantity
from usvauv.kernels.vehicles.numbers import GRAVITY, Constant

NUMBERS: dict[str, Quantity] = {
    "heading_frequency": Quantity(2.0, 0.1, 5, "natural frequency of the heading's loop, radians a hull length"),
    "heading_damping": Quantity(0.9, 0.3, 3, "its damping ratio"),
    "heading_integral": Quantity(0.2, 0, 1, "frequency of its integral over its own"),
    "heading_approach": Quantity(2.0, 0.5, 50, "distance in which the commanded heading is approached, hull lengths"),
    "turn_radius": Quantity(5.0, 1, 200, "least radius of commanded turns, hull lengths"),
    "turn_rudder": Quantity(1.0, 0, 20, "rudder per curvature of the path, rad hull lengths"),
    "pitch_frequency": Quantity(2.0, 0.1, 5, "natural frequency of the pitch's loop, radians a hull length"),
    "pitch_damping": Quantity(0.9, 0.3, 3, "its damping ratio"),
    "pitch_limit": Quantity(0.436, 0.05, 1.2, "largest pitch asked for, rad (25°)"),
    "dive_slope": Quantity(0.349, 0.02, 1.0, "steepest commanded path, rad (20°); the rest of the pitch corrects"),
    "dive_radius": Quantity(10.0, 1, 500, "least radius of the commanded path up and down, hull lengths"),
    "depth_approach": Quantity(5.0, 1, 100, "distance in which the commanded depth is approached, hull lengths"),
    "depth_ahead": Quantity(3.0, 1, 100, "distance in which an error of depth is made good, hull lengths"),
    "depth_integral": Quantity(6.0, 1, 1e6, "distance in which its integral acts, over depth_ahead"),
    "bed_ahead": Quantity(5.0, 0, 200, "how far ahead a rising bed is looked at, hull lengths"),
    "clearance_ahead": Quantity(
        5.0, 1, 200, "distance in which a height above what must not be met may go, hull lengths"
    ),
    "least_altitude": Quantity(1.0, 0.1, 100, "altitude kept whatever the command, m"),
    "least_depth": Quantity(1.0, 0.1, 100, "depth kept whatever the command, m"),
    "acceleration": Quantity(0.15, 0.005, 5, "change of the commanded speed, m/s²"),
    "speed_frequency": Quantity(1.0, 0.01, 5, "frequency of the speed's loop, rad/s"),
    "speed_integral": Quantity(0.5, 0, 1, "frequency of its integral over its own"),
    "slowest": Quantity(0.4, 0.05, 5, "speed below which gains rise no more, m/s"),
}

# What `control` reads, behind the constants of the vehicle.
Gain = columns(
    "heading_gain",  # rudder for an error of heading
    "heading_rate",  # for one of its rate times 1/V, m
    "heading_integral",  # 1/m
    "heading_approach",  # 1/m
    "turn_curvature",  # 1/m
    "turn_rudder",  # m
    "pitch_gain",
    "pitch_rate",  # m
    "righting",  # stern plane that holds a pitch, over 1/V², m²/s²
    "pitch_limit",  # sines
    "dive_slope",
    "dive_curvature",  # 1/m
    "depth_approach",  # 1/m
    "depth_ahead",  # 1/m
    "depth_integral",  # 1/m²
    "bed_ahead",  # m
    "clearance_ahead",  # 1/m
    "least_altitude",
    "least_depth",
    "acceleration",
    "speed_frequency",
    "speed_integral",
    "slowest",
)


def constants_of(n: Mapping[str, float], constants: np.ndarray) -> np.ndarray:
    """What `control` reads, (N,) float32, from all of `NUMBERS` by name and from the vehicle's constants."""
    c = {name: float(constants[number]) for number, name in enumerate(Constant.names)}
    L = 2.0 * c["half_length"]
    arm = -c["fin_place"]
    rudder, stern = (c[f"{fin}_area"] * c[f"{fin}_lift"] * arm for fin in ("rudder", "stern"))
    heading, pitch = n["heading_frequency"] / L, n["pitch_frequency"] / L
    turn = c["turn_inertia"] / rudder
    ahead = 1.0 / (n["depth_ahead"] * L)
    values = {
        **{name: n[name] for name in Gain.names if name in n},
        "heading_gain": turn * heading**2,
        "heading_rate": turn * 2.0 * n["heading_damping"] * heading,
        "heading_integral": turn * n["heading_integral"] * heading**3,
        "heading_approach": 1.0 / (n["heading_approach"] * L),
        "turn_curvature": 1.0 / (n["turn_radius"] * L),
        "turn_rudder": n["turn_rudder"] * L,
        "pitch_gain": c["turn_inertia"] / stern * pitch**2,
        "pitch_rate": c["turn_inertia"] / stern * 2.0 * n["pitch_damping"] * pitch,
        "righting": c["mass"] * GRAVITY * c["weight_below"] / stern,
        "pitch_limit": math.sin(n["pitch_limit"]),
        "dive_slope": math.sin(min(n["dive_slope"], n["pitch_limit"])),
        "dive_curvature": 1.0 / (n["dive_radius"] * L),
        "depth_approach": 1.0 / (n["depth_approach"] * L),
        "depth_ahead": ahead,
        "depth_integral": ahead**2 / n["depth_integral"],
        "bed_ahead": n["bed_ahead"] * L,
        "clearance_ahead": 1.0 / (n["clearance_ahead"] * L),
        "speed_integral": n["speed_integral"] * n["speed_frequency"] ** 2,
    }
    return np.array([values[name] for name in Gain.names], np.float32)
