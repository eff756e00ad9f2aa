"""Vehicle-steps a second of the torpedo's kernel beside NumPy's, and its figures beside those of others.

    python -m benchmarks.vehicles --json

A vehicle-step is 0.05 s of one vehicle in six degrees of freedom. NumPy's are those of the tests' reference on arrays
of many vehicles, by the midpoint rule as the kernel. Beside them stands the published rate of MarineGym, whose frames
come with Isaac Sim's contacts and a learner's observations: Chu et al. (2025), arXiv:2503.09203.

The figures: steady speed and turning circle of the REMUS 100 of `usvauv.kernels.vehicles.numbers`, beside those that
were computed with Fossen's public simulator (explicit Euler, 0.02 s, still water), and of a vehicle with the numbers of
an LRAUV beside what was measured at sea; speed and turning circle of the Otter of `usvauv.kernels.vehicles.otter`
beside Fossen's simulator.

The midpoint rule beside rules of other numbers of stages: how far vehicles are from the NumPy vehicle after a way of
turning and diving in a sheared, accelerating current, and what each costs.

Missions: what a step of 4,096 worlds costs with vehicles over one with points, which take turns, the median of the
ratios; and agent-steps a second where the action is the fins, at short mission steps.
"""

import argparse
import json
import math

import numpy as np
import taichi as ti
import torch

from benchmarks.machine import batch, best_time, describe, parse
from benchmarks.step_profile import seconds as seconds_of
from benchmarks.worlds import stepper
from tests.kernels.vehicles.reference import Reference, lamb
from tests.kernels.vehicles.test_torpedo import fields, fleet, flown
from usvauv.env import Scenario, World
from usvauv.env.scenario.team import Otter
from usvauv.kernels.functions import func
from usvauv.kernels.vehicles import otter, otter_numbers, torpedo
from usvauv.kernels.vehicles.definition import vehicles
from usvauv.kernels.vehicles.fleet import Fleet
from usvauv.kernels.vehicles.numbers import lamb_factors
from usvauv.kernels.vehicles.otter import HullColumn
from usvauv.kernels.vehicles.vehicle import LANES, Actuators, Command

STEPS, DT = 20, 0.05
MARINEGYM = 250_000  # frames a second on an RTX 3060, arXiv:2503.09203
NUMPY_VEHICLES, AHEAD = 4096, np.array([1.0, 0.0, 0.0])
DEFAULTS = {name: number.default for name, number in vehicles["torpedo"].numbers.items()}

REVOLUTIONS = {500: 0.83, 800: 1.34, 1000: 1.67, 1200: 2.01, 1525: 2.55}  # a minute → m/s, of Fossen's simulator
RUDDER = {5: 36.8, 10: 21.8, 15: 16.2}  # degrees at 1200/min → radius, m; its yaw moment of drag mended, C_d 0.8
OTTER = {40: 0.54, 60: 1.12, 80: 1.93, 100: 2.98}  # both propellers, rad/s → m/s, of Fossen's simulator
# A long-range AUV: numbers of B. Raanan's and of MBARI's public simulators, the coefficient of cross-flow from their
# N_r|r| = −632.7 kg m², the place of the hull's lift so that N_uv = −24 kg, as they fitted it to its motion at sea.
LRAUV = {
    "length": 2.3,
    "diameter": 0.305,
    "mass": 147.6,
    "weight_below": 0.014,
    "density": 1025.0,
    "axial_drag": 0.187,
    "cross_drag": 4.6,
    "hull_lift_place": -1.02,
    "rudder_area": 0.023,
    "stern_area": 0.023,
    "rudder_lift": 4.13,
    "stern_lift": 4.13,
    "fin_aspect": 6.5,
    "fin_place": -1.05,
    "fin_limit": 0.2618,
    "propeller_diameter": 0.2,
    "thrust_0": 0.1746,
    "thrust_1": 0.1746,
    "torque_0": 0.028,
    "torque_1": 0.028,
    "wake": 0.0,
    "thrust_deduction": 0.0,
    "propeller_limit": 8.0,
}

STAGES, STEP_LENGTHS = (1, 2, 3, 4), (0.1, 0.05, 0.025, 0.0125)  # s
WAY, TOLD = 8.0, (0.15, -0.1, 18.0)  # s; rudder and stern plane, rad, revolutions a second
WORLDS, ROUNDS, REPEATS = 4096, 7, 5
PASSING = "nodes.service=passing"
# Scenario, changes that both have, and the one of the vehicle.
MODELS = {"torpedo": ("extreme", [PASSING], "auv.model=torpedo"), "otter": ("wide", [], "boat.model=otter")}
FIN_STEPS = (0.05, 0.1, 0.2)  # s


class WithoutMunk(Reference):
    """Fossen's choices: no Munk moment, fins that see their own angle alone, no lift of the hull across."""

    def __init__(self, told: tuple[float, float, float], fins: float) -> None:
        changes = {"hull_lift": 0.0, "cross_drag": 0.8, "fin_place": -0.8, "rudder_lift": 0.5, "stern_lift": 0.7}
        super().__init__(DEFAULTS | changes | {"turn_time": math.inf, "sway_time": math.inf}, told=told)
        self.n["rudder_area"] *= fins

    def fin(self, area, slope, angle, u, v):
        pressure = 0.5 * self.n["density"] * area * slope * u * u
        return -pressure * angle**2, -pressure * angle

    def forces(self, R, v, omega, actuators):
        found = super().forces(R, v, omega, actuators)
        return np.concatenate([found[..., :3], found[..., 3:] + np.cross(v, v @ self.added)], -1)


def cruising(count: int, model: str = "torpedo") -> Fleet:
    """Vehicles at different speeds and headings with the rudder a little turned."""
    fleet = Fleet(count, model)
    fleet.set(Command, speed=np.linspace(0.8, 2.2, count), depth=50.0, heading=np.linspace(-3.0, 3.0, count))
    fleet.trim()
    fleet.set(Actuators, propeller=fleet.numpy("propeller"), rudder=0.05)
    return fleet


def numpy_rate(seconds: float) -> float:
    """Vehicle-steps a second of the NumPy vehicle."""
    reference = Reference(DEFAULTS, told=(0.05, 0.0, 15.0))
    still = np.zeros((NUMPY_VEHICLES, 3))
    rotation = np.broadcast_to(np.eye(3), (NUMPY_VEHICLES, 3, 3))
    state = reference.start(still, rotation, still + 1.5 * AHEAD, still, (0.0, 0.0, 15.0)).ravel()

    def step() -> None:
        nonlocal state
        middle = state + 0.5 * DT * reference.slope(0.0, state)
        state = state + DT * reference.slope(0.0, middle)

    return NUMPY_VEHICLES / best_time(step, seconds)


def rates(count: int, seconds: float) -> dict[str, float]:
    """Vehicle-steps a second."""
    fleet = cruising(count)
    found = {
        "fins": count * STEPS / best_time(fleet.flight(STEPS, DT), seconds),
        "autopilot": count * STEPS / best_time(fleet.flight(STEPS, DT, commanded=True), seconds),
        "numpy": numpy_rate(seconds),
    }
    return found | {"over_numpy": found["fins"] / found["numpy"], "over_marinegym": found["fins"] / MARINEGYM}


def of_stages(stages: int) -> str:
    """Name of a torpedo whose substep has so many stages."""

    @func
    def advance(table: ti.template(), body, actuators, water, dt: ti.f32):
        now = body
        for stage in range(stages):
            h = dt / (stages - stage)
            now = torpedo.after(table, body, now, torpedo.rates(table, now, water), actuators, h)
        return torpedo.kept_in_water(table, now, water)

    name = f"torpedo of {stages} stages"
    vehicles.register(name, vehicles["torpedo"]._replace(advance=advance))
    return name


def stages_of(count: int, seconds: float) -> list[dict[str, object]]:
    """Largest error of place, m, after `WAY` s for each of `STEP_LENGTHS`, and vehicle-steps a second, by `STAGES`."""
    numbers, water, state, (place, *_) = flown(WAY, TOLD)
    rows: list[dict[str, object]] = []
    for stages in STAGES:
        model, errors = of_stages(stages), {}
        for dt in STEP_LENGTHS:
            auvs = fleet(numbers, TOLD, water, model, **state)
            auvs.flight(round(WAY / dt), dt)()
            errors[f"{dt} s"] = float(np.abs(fields(auvs, "north", "east", "depth") - place).max())
        rate = count * STEPS / best_time(cruising(count, model).flight(STEPS, DT), seconds)
        rows.append({"stages": stages, "errors": errors, "steps_per_second": rate})
    return rows


def step_times(scenarios: list[Scenario]) -> np.ndarray:
    """Seconds of a step of `WORLDS` worlds, (rounds, scenarios), which take turns; the first round is not counted."""
    steps = [stepper(World(scenario, WORLDS), None) for scenario in scenarios]
    return np.array([[seconds_of(step, REPEATS) for step in steps] for _ in range(ROUNDS + 1)])[1:]


def missions() -> dict[str, float]:
    """Cost of a mission step over that with points, by model; agent-steps a second by fins, by the mission step."""
    found = {}
    for model, (name, both, own) in MODELS.items():
        point, vehicle = step_times([Scenario.load(name, [*both, *more]) for more in ([], [own])]).T
        found[f"{model} over point in {name}"] = float(np.median(vehicle / point))
    fins = [PASSING, "auv.model=torpedo", "auv.action=fins"]
    scenarios = [Scenario.load("extreme", [*fins, f"mission.step={step}"]) for step in FIN_STEPS]
    for step, scenario, best in zip(FIN_STEPS, scenarios, step_times(scenarios).min(0), strict=True):
        found[f"fins, steps of {step} s"] = scenario.auv.count * WORLDS / best
    return found


def settled(numbers: dict[str, float], revolutions: object, rudder: object = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Speed (m/s) and rate of turn (rad/s) after five minutes at revolutions a second and an angle of the rudder."""
    fleet = Fleet(LANES, numbers=numbers)
    fleet.set(depth=100.0, u=1.0)
    fleet.set(Actuators, propeller=revolutions, rudder=rudder)
    fleet.flight(6000, DT)()
    return np.hypot(fleet.numpy("u"), fleet.numpy("v")), fleet.numpy("r")


def yo_yo() -> tuple[float, float, float]:
    """Pitch half way (degrees), least and greatest depth (m) of the LRAUV, which turns at 2 and at 20 m, at 1 m/s."""
    fleet, wanted, rows = Fleet(LANES, numbers=LRAUV | {"pitch_limit": math.radians(20.0)}), 200.0, []
    fleet.set(Command, speed=1.0, depth=2.0)
    fleet.trim()
    second = fleet.flight(20, DT, commanded=True)
    for _ in range(600):
        q0, q1, q2, q3, depth = (fleet.numpy(name)[0] for name in ("q0", "q1", "q2", "q3", "depth"))
        wanted = 0.0 if depth >= 20.0 else 200.0 if depth <= 2.0 else wanted
        fleet.set(Command, depth=wanted)
        second()
        rows.append((depth, math.degrees(math.asin(2.0 * (q0 * q2 - q3 * q1)))))
    depth, pitch = np.array(rows[100:]).T
    return float(np.abs(pitch[np.abs(depth - 11.0) < 3.0]).mean()), depth.min(), depth.max()


def radius_without_munk(degrees: float, fins: float = 1.0) -> float:
    """Turning circle of `WithoutMunk` at 1200 revolutions a minute, m, with a share of the rudder's area."""
    reference = WithoutMunk((math.radians(degrees), 0.0, 20.0), fins)
    zero = np.zeros((1, 3))
    begin = reference.start(zero, np.eye(3)[None], zero + 2.0 * AHEAD, zero, (0.0, 0.0, 20.0))
    _, _, v, omega, _, _ = reference.motion(reference.fly(begin, 60.0, 1e-7), 60.0)
    return float(np.linalg.norm(v) / np.linalg.norm(omega))


def otter_figures() -> list[dict[str, object]]:
    """Rows of `figures` of the boat.

    Fossen's simulator has the payload's weight (25 kg) act along the axes of the trimmed boat, where no buoyancy
    bears it: at its pitch of −1.5° to −2.3° it pushes with 6.6 to 9.7 N.
    """
    orders = torch.tensor([*([float(n), float(n)] for n in OTTER), [100.0, 60.0]])
    hull, calm = torch.zeros(len(orders), len(HullColumn.names)), torch.zeros(len(orders), 2)
    table = torch.from_numpy(otter_numbers.table_of(Otter.model_validate({}).model_dump()))
    otter.integrate(table, hull, orders, calm, 0.1, 600, calm.clone())
    u, v, r = hull[:, HullColumn.u : HullColumn.r + 1].double().numpy().T
    why = "there the payload's weight pushes the trimmed boat"
    rows: list[dict[str, object]] = [
        {"what": f"Otter, {n} rad/s: speed, m/s", "theirs": theirs, "ours": u[i], "why": why}
        for i, (n, theirs) in enumerate(OTTER.items())
    ]
    radius = math.hypot(u[-1], v[-1]) / r[-1]
    why = "there 2 % more damping in yaw, of an inertia counted twice in part; 21 strips for 20"
    return [*rows, {"what": "Otter, 100 and 60 rad/s: radius, m", "theirs": 7.1, "ours": radius, "why": why}]


def figures() -> list[dict[str, object]]:
    """What, theirs, ours, and why they differ."""
    minutes, degrees = np.array([*REVOLUTIONS]), np.array([*RUDDER])
    speed, _ = settled({}, np.resize(minutes / 60, LANES))
    hull = DEFAULTS["length"], DEFAULTS["diameter"]
    rows = [
        {"what": f"Lamb's factor {name}", "theirs": theirs, "ours": ours, "why": "theirs: his integrals by quadrature"}
        for name, theirs, ours in zip(("k1", "k2", "k'"), lamb(*hull), lamb_factors(*hull), strict=True)
    ]
    rows += [
        {"what": f"REMUS 100, {n}/min: speed, m/s", "theirs": theirs, "ours": speed[i], "why": ""}
        for i, (n, theirs) in enumerate(REVOLUTIONS.items())
    ]
    fast, turn = settled({}, 20.0, np.resize(np.deg2rad(degrees), LANES))
    for i, (angle, theirs) in enumerate(RUDDER.items()):
        both, one = radius_without_munk(angle), radius_without_munk(angle, 0.5)
        why = f"Munk's moment, fins at their own flow; without: {both:.1f}, with the area of one fin {one:.1f}"
        rows.append({"what": f"rudder {angle}°: radius, m", "theirs": theirs, "ours": fast[i] / turn[i], "why": why})
    speed, turn = settled(LRAUV, 5.0, np.resize(np.deg2rad([0.0, 9.0]), LANES))
    rows.append({"what": "LRAUV, 300/min: speed, m/s", "theirs": 1.0, "ours": speed[0], "why": ""})
    why = "the fins' lift is that in free flow, not in the hull's wake"
    round_again = "how far it goes on while it turns"
    pitch, least, greatest = yo_yo()
    return [
        *rows,
        {"what": "LRAUV, rudder 9°: turn, rad/s", "theirs": 0.037, "ours": turn[1], "why": why},
        {"what": "LRAUV, yo-yo: pitch, °", "theirs": 20.0, "ours": pitch, "why": ""},
        {"what": "LRAUV, yo-yo: least depth, m", "theirs": 2.0, "ours": least, "why": round_again},
        {"what": "LRAUV, yo-yo: greatest depth, m", "theirs": 20.0, "ours": greatest, "why": round_again},
        *otter_figures(),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicles", type=int, help="number of vehicles (default: as many as fill the machine)")
    parser.add_argument("--seconds", type=float, default=2.0, help="time spent on each rate, s")
    arguments = parse(parser)
    count = arguments.vehicles or batch(16384, 1 << 20)
    result = {"machine": describe(), "vehicles": count, "steps_per_second": rates(count, arguments.seconds)}
    result |= {"stages": stages_of(count, arguments.seconds), "missions": missions(), "figures": figures()}
    if arguments.json:
        print(json.dumps(result, indent=1, default=float))
        return
    print(result["machine"])
    found = result["steps_per_second"]
    print(f"{count} vehicles, {STEPS} steps of {DT} s a launch: vehicle-steps a second")
    for name in ("fins", "autopilot", "numpy"):
        print(f"  {name:10} {found[name]:14,.0f}")
    print(
        f"  over NumPy {found['over_numpy']:,.0f}, over MarineGym's {MARINEGYM:,} frames {found['over_marinegym']:,.0f}"
    )
    print(f"Largest error of place after {WAY:g} s, m, by the substep; million vehicle-steps a second")
    for row in result["stages"]:
        errors = "  ".join(f"{dt} {error:.2g}" for dt, error in row["errors"].items())
        print(f"  {row['stages']} stages  {errors}  {row['steps_per_second'] / 1e6:.0f}")
    print(f"{WORLDS} worlds: cost of a mission step, or agent-steps a second")
    for name, value in result["missions"].items():
        print(f"  {name:30} {value:14,.2f}" if "over" in name else f"  {name:30} {value:14,.0f}")
    for row in result["figures"]:
        print(f"{row['what']:34} theirs {row['theirs']:6.3g}  ours {row['ours']:6.3g}  {row['why']}")


if __name__ == "__main__":
    main()
