"""Section of a scenario with the numbers of a boat of boat.model = "otter", each with its source.

MSS: Fossen and Perez, "Marine Systems Simulator", https://github.com/cybergalactic/MSS, its model of the Otter of
Maritime Robotics, with the payload of its examples, 25 kg. Fossen (2021): doi 10.1002/9781119575016.
"""

from __future__ import annotations

from pydantic import Field

from usvauv.env.scenario.fields import Section


class Otter(Section):
    mass: float = Field(80.0, ge=20, le=500, description="mass, kg; MSS: hull 55, payload 25")
    length: float = Field(2.0, ge=0.5, le=10, description="length of a hull, m; MSS")
    draught: float = Field(0.195, ge=0.02, le=2, description="m; MSS, at that mass")
    centre: float = Field(
        0.153, ge=-1, le=1, description="centre of gravity ahead of midships, m; MSS: hull 0.2, payload 0.05"
    )
    inertia: float = Field(
        14.1, ge=1, le=5000, description="moment in yaw about the centre of gravity, kg m²; MSS: radius of gyration L/4"
    )
    added_surge: float = Field(5.3, ge=0, le=1000, description="added mass in surge, kg; MSS, after Söding")
    added_sway: float = Field(82.5, ge=0, le=5000, description="added mass in sway, kg; MSS: 1.5 of the hull's mass")
    added_yaw: float = Field(25.7, ge=0, le=5000, description="added moment in yaw, kg m²; MSS: 1.7 of the inertia")
    damping_surge: float = Field(
        77.6, ge=1, le=5000, description="linear damping in surge, N s/m; MSS: full thrust at 6 knots"
    )
    damping_sway: float = Field(
        162.5, ge=0, le=10000, description="linear damping in sway, N s/m; MSS: time constant 1 s"
    )
    damping_yaw: float = Field(41.7, ge=0, le=10000, description="linear in yaw, N m s; MSS: time constant 1 s")
    damping_turn: float = Field(417.0, ge=0, le=100000, description="quadratic in yaw, N m s²; MSS: 10 of the linear")
    cross_flow: float = Field(
        1.0, ge=0, le=3, description="drag coefficient of cross-flow, 1; MSS: Hoerner's curve at the pontoon's beam"
    )
    thrust_ahead: float = Field(
        0.01108,
        ge=1e-4,
        le=1,
        description="thrust of a propeller ahead over its revolutions squared, N s²; MSS, measured",
    )
    thrust_astern: float = Field(0.006445, ge=1e-4, le=1, description="the same astern, N s²; MSS, measured")
    most_ahead: float = Field(103.9, ge=1, le=1000, description="most revolutions ahead, rad/s; MSS: 12.2 kgf")
    most_astern: float = Field(101.7, ge=1, le=1000, description="most revolutions astern, rad/s; MSS: 6.8 kgf")
    lever: float = Field(0.395, ge=0.05, le=5, description="from the centre line to a propeller, m; MSS")
    propeller_lag: float = Field(0.1, ge=0.02, le=5, description="time constant of a propeller, s; MSS, its examples")
    frontal_area: float = Field(
        0.3, ge=0, le=20, description="area above the water seen from ahead, m²; estimated: a third of 1.08 × 0.87"
    )
    lateral_area: float = Field(0.6, ge=0, le=50, description="seen from abeam, m²; estimated: a third of 2 × 0.87")
    wind_surge: float = Field(0.7, ge=0, le=2, description="wind's coefficient c_x, 1; Fossen (2021): 0.5 to 0.9")
    wind_sway: float = Field(0.8, ge=0, le=2, description="c_y, 1; Fossen (2021): 0.7 to 0.95")
    wind_yaw: float = Field(0.1, ge=0, le=1, description="c_n, 1; Fossen (2021): 0.05 to 0.2")
    turn_rate: float = Field(
        0.26, ge=0.02, le=1, description="greatest rate that its autopilot asks for, rad/s; chosen"
    )
    heading_gain: float = Field(
        0.6, ge=0.05, le=3, description="rate it asks for over the error of heading, 1/s; chosen"
    )
    rate_gain: float = Field(3.5, ge=0.1, le=5, description="gain of that rate's error over the inertia, 1/s; chosen")
    speed_gain: float = Field(1.0, ge=0.05, le=5, description="gain of the error of speed over the mass, 1/s; chosen")
