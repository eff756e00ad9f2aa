"""Numbers of a torpedo-shaped AUV, each once: default, range, unit, source. The defaults are those of a REMUS 100.

Sources, by the names used below:

- Fossen: T. I. Fossen (2021), "Handbook of Marine Craft Hydrodynamics and Motion Control", 2nd ed., ch. 6–8, and the
  REMUS 100 of its public toolbox.
- Prestero: T. Prestero (2001), "Verification of a six-degree of freedom simulation model for the REMUS autonomous
  underwater vehicle", MIT and WHOI, doi 10.1575/1912/3040.
- Allen: B. Allen, W. S. Vorus, T. Prestero (2000), "Propulsion system performance enhancements on REMUS AUVs",
  doi 10.1109/OCEANS.2000.882209.
- Hoerner: S. F. Hoerner (1965), "Fluid-Dynamic Drag", as Prestero cites it.
"""

import math
from collections.abc import Mapping

import numpy as np

from usvauv.kernels.columns import columns
from usvauv.kernels.limits import Quantity

GRAVITY = 9.81  # m/s²

NUMBERS: dict[str, Quantity] = {
    "length": Quantity(1.6, 0.3, 20, "length of the hull, m (Fossen)"),
    "diameter": Quantity(0.19, 0.03, 3, "diameter of the hull, m (Fossen)"),
    "mass": Quantity(31.9, 0.5, 20000, "mass, kg (Fossen)"),
    "buoyancy": Quantity(0.0, -500, 500, "weight of the displaced water less its own, N; 0: trimmed"),
    "density": Quantity(1026.0, 900, 1100, "density of the water, kg/m³ (Fossen)"),
    "weight_below": Quantity(0.02, 0, 0.5, "depth of the centre of mass below the centre of buoyancy, m (Fossen)"),
    "roll_added": Quantity(0.3, 0, 2, "added moment of inertia in roll over the hull's own (Fossen)"),
    "axial_drag": Quantity(0.42, 0, 3, "drag coefficient ahead, fins included, over the frontal area (Allen)"),
    "cross_drag": Quantity(1.1, 0, 3, "drag coefficient of the cross-flow over length × diameter (Hoerner)"),
    "hull_lift": Quantity(1.2, 0, 10, "slope of the hull's lift over diameter², 1/rad (Hoerner)"),
    "hull_lift_place": Quantity(-0.321, -10, 10, "where the hull's lift acts ahead, from the middle, m (Prestero)"),
    "hull_stall": Quantity(0.35, 0.05, 1.5, "angle of attack at which half of the hull's lift is lost, rad (assumed)"),
    "sway_time": Quantity(20.0, 0.1, 1e6, "time constant of linear damping in sway and heave, s (Fossen)"),
    "turn_time": Quantity(5.0, 0.1, 1e6, "time constant of linear damping in pitch and yaw, s (Fossen, of yaw)"),
    "roll_damping": Quantity(0.3, 0, 5, "damping ratio in roll (Fossen)"),
    "rudder_area": Quantity(0.0133, 1e-5, 5, "area of the two rudder fins together, m² (Prestero)"),
    "stern_area": Quantity(0.0133, 1e-5, 5, "area of the two stern planes together, m² (Prestero)"),
    "rudder_lift": Quantity(3.12, 0.01, 6.3, "slope of the rudder's lift, 1/rad (Prestero)"),
    "stern_lift": Quantity(3.12, 0.01, 6.3, "slope of the stern planes' lift, 1/rad (Prestero)"),
    "fin_aspect": Quantity(2.21, 0.1, 20, "effective aspect ratio of the fins (Prestero)"),
    "fin_place": Quantity(-0.6827, -20, -0.01, "where the fins are ahead, from the middle, m (Prestero)"),
    "fin_stall": Quantity(0.4, 0.05, 1.5, "angle of attack at which half of a fin's lift is lost, rad (assumed)"),
    "fin_limit": Quantity(0.349, 0.01, 0.8, "largest angle of a fin, rad (Fossen: 20°)"),
    "fin_rate": Quantity(1.0, 0.01, 100, "fastest turn of a fin, rad/s (assumed)"),
    "fin_lag": Quantity(0.1, 0.001, 10, "time constant of the fins, s (Fossen)"),
    "propeller_diameter": Quantity(0.14, 0.01, 3, "diameter of the propeller, m (Allen: 5.5 inches)"),
    "thrust_0": Quantity(0.4566, 0.01, 2, "thrust coefficient at rest (Fossen, by the Wageningen B series)"),
    "thrust_1": Quantity(0.1798, -1, 2, "thrust coefficient at the advance ratio `advance` (Fossen, as above)"),
    "torque_0": Quantity(0.07, 0, 1, "torque coefficient at rest (Fossen, as above)"),
    "torque_1": Quantity(0.0312, -1, 1, "torque coefficient at the advance ratio `advance` (Fossen, as above)"),
    "advance": Quantity(0.6632, 0.05, 3, "advance ratio of thrust_1 and torque_1 (Fossen)"),
    "wake": Quantity(0.056, 0, 0.9, "wake fraction (Allen: the propeller meets 0.944 of the speed)"),
    "thrust_deduction": Quantity(0.1, 0, 0.9, "thrust deduction (Fossen)"),
    "propeller_limit": Quantity(25.4167, 0.1, 500, "most revolutions a second (Fossen: 1525 a minute)"),
    "propeller_lag": Quantity(0.1, 0.001, 30, "time constant of the propeller, s (Fossen)"),
    "efficiency": Quantity(0.75, 0.05, 1, "shaft power over electrical power of motor and drive (assumed)"),
    "hotel": Quantity(15.0, 0, 5000, "electrical power of all else, W (Zhang et al. 2024, 10.1109/JIOT.2024.3395568)"),
}

# What the functions of the vehicle read, in this order.
Constant = columns(
    "weight_below",
    "half_length",
    "radius",
    "mass",  # kg
    "displaced",  # mass of the displaced water less the vehicle's, kg
    "added_surge",  # added masses, kg
    "added_sway",
    "roll_inertia",  # about the centre of buoyancy, body and water, kg m²
    "turn_inertia",
    "roll_body",  # of the body alone
    "turn_body",
    "uq_uu",  # inverse of the mass matrix of surge and pitch
    "uq_uq",
    "uq_qq",
    "vp_vv",  # of sway and roll
    "vp_vp",
    "vp_pp",
    "heave",  # 1/mass in heave
    "yaw",  # 1/inertia in yaw
    "axial_drag",  # ½ρ C A, kg/m
    "cross_drag",  # ρ C_d D L/2, kg/m
    "hull_lift",  # ½ρ D² C, kg/m
    "hull_induced",  # of the drag that lift brings, kg/m
    "hull_lift_place",
    "hull_stall",  # 1/sin² of the angle
    "linear_sway",  # kg/s
    "linear_turn",  # kg m²/s
    "linear_roll",
    "rudder_area",  # ½ρ A, kg/m
    "rudder_lift",
    "stern_area",
    "stern_lift",
    "fin_induced",  # 1/(π e AR)
    "fin_place",
    "fin_stall",  # 1/sin² of the angle
    "fin_limit",
    "fin_rate",
    "fin_lag",
    "thrust_0",  # ρ D⁴ K_T (1 − t), kg m
    "thrust_slope",  # kg
    "torque_0",  # ρ D⁵ K_Q, kg m²
    "torque_slope",  # kg m
    "propeller_limit",
    "propeller_lag",
    "efficiency",
    "hotel",
)

OSWALD = 0.7  # efficiency of an elliptic wing's lift; R. W. Beard, T. W. McLain (2012), "Small Unmanned Aircraft"


def lamb_factors(length: float, diameter: float) -> tuple[float, float, float]:
    """Lamb's factors k1, k2, k' of a prolate spheroid: added mass ahead and sideways over that of the displaced water.

    With e² = 1 − (b/a)², α0 = 2 (1 − e²)/e³ (½ ln((1 + e)/(1 − e)) − e) and β0 = 1/e² − (1 − e²)/(2 e³)
    ln((1 + e)/(1 − e)): k1 = α0/(2 − α0), k2 = β0/(2 − β0), and k' of the moment of inertia across. A sphere has
    k1 = k2 = ½ and k' = 0. Source: Lamb, "Hydrodynamics" (6th ed.), §114–115; Fossen (2021), 8.4.2.

    Raises:
        ValueError: the length is not above the diameter.
    """
    if not length > diameter:
        raise ValueError(f"length = {length:g}: must be above the diameter, {diameter:g} m")
    e2 = 1.0 - (diameter / length) ** 2
    e = math.sqrt(e2)
    log = math.log((1.0 + e) / (1.0 - e))
    alpha = 2.0 * (1.0 - e2) / e**3 * (0.5 * log - e)
    beta = 1.0 / e2 - (1.0 - e2) / (2.0 * e**3) * log
    turn = e2**2 * (beta - alpha) / ((2.0 - e2) * (2.0 * e2 - (2.0 - e2) * (beta - alpha)))
    return alpha / (2.0 - alpha), beta / (2.0 - beta), turn


def constants_of(n: Mapping[str, float]) -> np.ndarray:
    """Constants of the equations in `torpedo`, (N,) float32, from all of `NUMBERS` by name.

    Raises:
        ValueError: the length is not above the diameter.
    """
    a, b, m, below, rho = n["length"] / 2, n["diameter"] / 2, n["mass"], n["weight_below"], n["density"]
    k1, k2, k_turn = lamb_factors(n["length"], n["diameter"])
    roll_hull, turn_hull = 0.4 * m * b**2, 0.2 * m * (a**2 + b**2)
    roll_body, turn_body = roll_hull + m * below**2, turn_hull + m * below**2
    roll, turn = roll_body + n["roll_added"] * roll_hull, turn_body + k_turn * turn_hull
    surge, sway, arm = m * (1 + k1), m * (1 + k2), m * below
    uq, vp = surge * turn - arm**2, sway * roll - arm**2
    half, d, advance = 0.5 * rho, n["propeller_diameter"], n["advance"]
    values = {
        **{name: n[name] for name in Constant.names if name in n},
        "half_length": a,
        "radius": b,
        "displaced": n["buoyancy"] / GRAVITY,
        "added_surge": k1 * m,
        "added_sway": k2 * m,
        "roll_inertia": roll,
        "turn_inertia": turn,
        "roll_body": roll_body,
        "turn_body": turn_body,
        "uq_uu": turn / uq,
        "uq_uq": -arm / uq,
        "uq_qq": surge / uq,
        "vp_vv": roll / vp,
        "vp_vp": arm / vp,
        "vp_pp": sway / vp,
        "heave": 1.0 / sway,
        "yaw": 1.0 / (turn - m * below**2),
        "axial_drag": half * n["axial_drag"] * math.pi * b**2,
        "cross_drag": half * n["cross_drag"] * n["diameter"] * n["length"],
        "hull_lift": half * n["hull_lift"] * n["diameter"] ** 2,
        "hull_induced": half * n["hull_lift"] ** 2 * n["diameter"] ** 2 / (math.pi * OSWALD),
        "hull_stall": math.sin(n["hull_stall"]) ** -2,
        "linear_sway": sway / n["sway_time"],
        "linear_turn": turn / n["turn_time"],
        "linear_roll": 2.0 * n["roll_damping"] * math.sqrt(m * GRAVITY * below * roll),
        "rudder_area": half * n["rudder_area"],
        "stern_area": half * n["stern_area"],
        "fin_induced": 1.0 / (math.pi * OSWALD * n["fin_aspect"]),
        "fin_stall": math.sin(n["fin_stall"]) ** -2,
        "thrust_0": rho * d**4 * (1 - n["thrust_deduction"]) * n["thrust_0"],
        "thrust_slope": rho
        * d**3
        * (1 - n["thrust_deduction"])
        * (n["thrust_1"] - n["thrust_0"])
        / advance
        * (1 - n["wake"]),
        "torque_0": rho * d**5 * n["torque_0"],
        "torque_slope": rho * d**4 * (n["torque_1"] - n["torque_0"]) / advance * (1 - n["wake"]),
    }
    return np.array([values[name] for name in Constant.names], np.float32)
