"""The torpedo-shaped AUV against closed forms, conservation laws and a vehicle in NumPy."""

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
import taichi as ti
import torch
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from tests.kernels.vehicles.reference import Reference, Water, lamb
from usvauv.kernels import runtime
from usvauv.kernels.functions import Launch, kernel
from usvauv.kernels.types import array1
from usvauv.kernels.vehicles import torpedo
from usvauv.kernels.vehicles.definition import vehicles
from usvauv.kernels.vehicles.fleet import Fleet
from usvauv.kernels.vehicles.numbers import lamb_factors
from usvauv.kernels.vehicles.vehicle import (
    LANES,
    Actuators,
    Body,
    Command,
    Surroundings,
    blocks,
    load,
    store,
)

TORPEDO = vehicles["torpedo"]
DEFAULTS = {name: number.default for name, number in TORPEDO.numbers.items()}
NO_DAMPING = {"axial_drag": 0.0, "cross_drag": 0.0, "hull_lift": 0.0, "sway_time": math.inf, "turn_time": math.inf}
BARE = DEFAULTS | NO_DAMPING | {"roll_damping": 0.0, "rudder_area": 1e-12, "stern_area": 1e-12}
NO_KEEL, NO_TORQUE = {"weight_below": 0.0}, {"torque_0": 0.0, "torque_1": 0.0}
DEPTH, SPEEDS, SPINS = 50.0, ("u", "v", "w"), ("p", "q", "r")
DOWN = np.array([0.0, 0.0, 1.0])
RHO, L, D, m = (DEFAULTS[name] for name in ("density", "length", "diameter", "mass"))


@kernel
def measure(state: blocks, water: blocks, table: array1, found: blocks):
    for b in range(1):
        body = load(state, b, Body, ti.static(range(len(Body.members))))
        around = load(water, b, Surroundings, ti.static(range(len(Surroundings.members))))
        store(found, b, torpedo.forces(table, body, body.p, body.q, body.r, around), ti.static(range(6)))
        store(found, b, torpedo.rates(table, body, around), ti.static(range(6, 16)))


def fleet(
    numbers: dict[str, float], told=(0.0, 0.0, 0.0), water: Water | None = None, model: str = "torpedo", **state
) -> Fleet:
    """LANES vehicles, level in water at rest where nothing else is said, their actuators where they are told to be."""
    made = Fleet(LANES, model, numbers)
    made.set(Actuators, rudder=told[0], stern=told[1], propeller=told[2])
    made.set(**({"depth": DEPTH, "rudder": told[0], "stern": told[1], "propeller": told[2]} | state))
    if water:
        axes = list(enumerate("ned"))
        made.set(Surroundings, depth=DEPTH, **dict(zip(("north", "east", "down"), water.velocity, strict=True)))
        made.set(Surroundings, **{f"rate_{a}": water.rate[i] for i, a in axes})
        made.set(Surroundings, **{a + b: water.gradient[i, j] for i, a in axes for j, b in axes})
    return made


def measured(auvs: Fleet, numbers: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Forces and moments, and time derivatives of ν: each (LANES, 6)."""
    found, table = torch.zeros(1, 16, LANES), torch.from_numpy(TORPEDO.table_of(numbers))
    arrays = (tensor.cpu() for tensor in (auvs.state, auvs.water))
    Launch(measure, *arrays, table, found, settings=runtime.vectors_in_registers())()
    return found[0, :6].double().numpy().T, found[0, 9:15].double().numpy().T


def fields(auvs: Fleet, *names: str) -> np.ndarray:
    return np.stack([auvs.numpy(name) for name in names], -1)


def anyhow(seed: int, speed: float = 1.0) -> dict[str, Any]:
    """Random attitudes and velocities."""
    rng = np.random.default_rng(seed)
    q = Rotation.random(LANES, rng).as_quat()
    state = {name: q[:, i] for name, i in zip(("q1", "q2", "q3", "q0"), range(4), strict=True)}
    state |= {name: speed * rng.normal(size=LANES) for name in SPEEDS}
    return state | {name: 0.5 * speed * rng.normal(size=LANES) for name in SPINS}


def attitude(auvs: Fleet) -> np.ndarray:
    return Rotation.from_quat(fields(auvs, "q1", "q2", "q3", "q0")).as_matrix()


def mass_matrix(numbers: dict[str, float]) -> np.ndarray:
    return Reference(numbers).mass_matrix


def test_added_masses_are_lambs():
    """His integrals; nearly a sphere has half the mass of its water, a needle none ahead and all of it across."""
    for ratio in (1.5, 2.0, 5.0, 8.4):
        assert lamb_factors(ratio, 1.0) == pytest.approx(lamb(ratio, 1.0), rel=1e-6)
    assert lamb_factors(1.02, 1.0) == pytest.approx((0.5, 0.5, 0.0), abs=0.02)
    assert lamb_factors(300.0, 1.0) == pytest.approx((0.0, 1.0, 1.0), abs=0.01)
    with pytest.raises(ValueError, match="length = 1: must be above the diameter, 2"):
        lamb_factors(1.0, 2.0)


def test_drag_of_the_cross_flow():
    """Pure sway −½ρ D C_d |v| v L, pure yaw −½ρ D C_d |r| r L⁴/32; between them and in heave, the integral."""
    numbers = BARE | {"cross_drag": 0.9}
    rng, half = np.random.default_rng(1), -0.5 * RHO * D * 0.9
    v, r = rng.normal(size=LANES), 2.0 * rng.normal(size=LANES)
    force = measured(fleet(numbers, v=v), numbers)[0]
    assert force[:, 1] == pytest.approx(half * np.abs(v) * v * L, rel=1e-5)
    assert force[:, [0, 2, 3, 4, 5]] == pytest.approx(0, abs=1e-6)
    force = measured(fleet(numbers, r=r), numbers)[0]
    assert force[:, 5] == pytest.approx(half * np.abs(r) * r * L**4 / 32, rel=1e-5)
    force = measured(fleet(numbers, v=v, r=r, w=v, q=-r), numbers)[0]
    x = np.linspace(-L / 2, L / 2, 200001)
    along = v[:, None] + r[:, None] * x
    drag = half * np.abs(along) * along
    expected = np.trapezoid(drag, x), np.trapezoid(x * drag, x)
    assert force[:, [1, 5]] == pytest.approx(np.stack(expected, -1), rel=2e-5, abs=1e-5)
    assert force[:, [2, 4]] == pytest.approx(np.stack((expected[0], -expected[1]), -1), rel=2e-5, abs=1e-5)


def test_munks_moment_turns_the_hull_across_the_flow():
    """−(Y − X) u v in yaw and (Y − X) u w in pitch."""
    numbers = BARE | NO_KEEL
    k1, k2, _ = lamb(L, D)
    M = np.diag(mass_matrix(numbers))
    rates = measured(fleet(numbers, u=1.5, v=0.2, w=0.3), numbers)[1]
    assert rates[:, 5] == pytest.approx(-(k2 - k1) * m * 1.5 * 0.2 / M[5], rel=1e-5)
    assert rates[:, 4] == pytest.approx((k2 - k1) * m * 1.5 * 0.3 / M[4], rel=1e-5)


def test_coriolis_forces_do_no_work():
    """νᵀ M ν̇ is the work of the weight alone, from M and from Newton's law."""
    auvs = fleet(BARE, **anyhow(2))
    nu, rates = fields(auvs, *SPEEDS, *SPINS), measured(auvs, BARE)[1]
    down = attitude(auvs)[:, 2]
    weight = m * 9.81 * DEFAULTS["weight_below"] * np.cross(DOWN, down)
    work = np.einsum("ij,ij->i", nu[:, 3:], weight)
    assert np.einsum("ij,jk,ik->i", nu, mass_matrix(BARE), rates) == pytest.approx(work, abs=2e-4)
    assert np.abs(work).max() > 1


@pytest.mark.parametrize("told", [(0.0, 0.0, 0.0), (0.6, -0.6, 0.0), (-0.1, 0.3, 0.0)])
def test_damping_and_fins_take_energy(told):
    """In any flow, at any angle of the fins; more the faster, at least with the square of the speed."""
    for seed in range(4):
        for speed in (0.1, 1.0, 5.0):
            auvs = fleet(DEFAULTS, told, **anyhow(seed, speed))
            nu = fields(auvs, *SPEEDS, *SPINS)
            power = np.einsum("ij,ij->i", nu, measured(auvs, DEFAULTS)[0])
            assert (power < -1e-3 * np.linalg.norm(nu, axis=1) ** 2).all()


def test_fins_stall():
    """A small angle has the lift of its slope, that of stall half a wing's, half a plate's, large ones a plate's."""
    numbers, stall = BARE | {"rudder_area": DEFAULTS["rudder_area"]}, DEFAULTS["fin_stall"]
    force = measured(fleet(numbers, u=1.5, rudder=np.resize([0.01, stall, 1.2], LANES)), numbers)[0][:3]
    pressure, slope = 0.5 * RHO * DEFAULTS["rudder_area"] * 1.5**2, DEFAULTS["rudder_lift"]
    half = 0.5 * (slope + 2 * math.sin(stall)) * math.sin(stall) * math.cos(stall)
    assert -force[:2, 1] == pytest.approx(pressure * np.array([slope * 0.01, half]), rel=2e-3)
    assert force[:, 5] == pytest.approx(DEFAULTS["fin_place"] * force[:, 1], rel=1e-5)
    assert np.hypot(*force[2, :2]) == pytest.approx(pressure * 2 * math.sin(1.2) ** 2, rel=0.05)
    assert math.atan2(-force[2, 0], -force[2, 1]) == pytest.approx(1.2, abs=0.05)  # square to it


def test_energy_falls_without_thrust():
    """Kinetic energy of body and water, and the weight's potential energy, from one second to the next."""
    auvs = fleet(DEFAULTS, **anyhow(3))
    go, M, energies = auvs.flight(20, 0.05), mass_matrix(DEFAULTS), []
    for _ in range(30):
        nu = fields(auvs, *SPEEDS, *SPINS)
        height = -m * 9.81 * DEFAULTS["weight_below"] * attitude(auvs)[:, 2, 2]
        energies.append(0.5 * np.einsum("ij,jk,ik->i", nu, M, nu) + height)
        go()
    assert (np.diff(energies, axis=0) < 0).all()
    assert (energies[-1] < -0.9 * m * 9.81 * DEFAULTS["weight_below"]).all()


def test_a_uniform_current_is_a_moving_frame():
    """Steady or accelerated: the same motion through the water; the ground passes by. Without a keel no frame shows."""
    numbers = DEFAULTS | NO_KEEL | NO_TORQUE
    state, told = anyhow(4, 0.7), (0.1, -0.1, 15.0)
    still = fleet(numbers, told, **state)
    water = Water(np.array([0.8, -0.5, 0.1]), rate=np.array([0.05, 0.1, -0.02]))
    carried = fleet(numbers, told, water, **state)
    for auvs in (still, carried):
        auvs.flight(200, 0.05)()
    names = (*SPEEDS, *SPINS, "q0", "q1", "q2", "q3")
    assert fields(carried, *names) == pytest.approx(fields(still, *names), abs=2e-4)
    moved = fields(carried, "north", "east", "depth") - fields(still, "north", "east", "depth")
    t = auvs.numpy("time")[:, None]
    assert moved == pytest.approx(water.velocity * t + 0.5 * water.rate * t**2, abs=5e-3)


def test_an_accelerated_current_tilts_gravity():
    """With its keel a vehicle at rest in water that accelerates hangs along g − DV/Dt."""
    water = Water(rate=np.array([0.0, 1.2, 0.0]))
    numbers = DEFAULTS | {"roll_damping": 2.0}
    auvs = fleet(numbers, water=water)
    auvs.flight(1200, 0.05)()
    assert attitude(auvs)[:, :, 2] == pytest.approx(
        np.tile(np.array([0.0, -1.2, 9.81]) / math.hypot(1.2, 9.81), (LANES, 1)), abs=1e-4
    )
    assert fields(auvs, *SPEEDS) == pytest.approx(0, abs=1e-3)


def test_at_rest_in_turning_water_it_goes_round_with_it():
    """In a solid rotation a trimmed body moves as the water does: no forces, no slip."""
    numbers, spin, radius = DEFAULTS | NO_KEEL, 0.3, np.linspace(0.0, 15.0, LANES)
    water = Water(gradient=spin * np.array([[0, -1, 0], [1, 0, 0], [0, 0, 0.0]]))
    auvs = fleet(numbers, water=water, r=spin)
    auvs.set(Surroundings, east=spin * radius)  # the axis is `radius` south
    auvs.flight(400, 0.05)()
    angle = spin * auvs.numpy("time")
    assert fields(auvs, *SPEEDS) == pytest.approx(0, abs=2e-3)
    assert auvs.numpy("north") == pytest.approx(radius * (np.cos(angle) - 1), abs=1e-2)
    assert auvs.numpy("east") == pytest.approx(radius * np.sin(angle), abs=1e-2)


def test_a_stationary_potential_flow_keeps_the_first_integral():
    """½ m |ẋ|² + ½ ẋ·A ẋ − ½ V·A V − ½ m_f |V|² + ½ ω·I ω stays, with A turned into the frame (`torpedo`)."""
    numbers = BARE | NO_KEEL
    strain = np.array([[0.06, 0.03, -0.04], [0.03, -0.08, 0.02], [-0.04, 0.02, 0.02]])
    water = Water(np.array([0.3, 0.2, -0.1]), strain)
    auvs = fleet(numbers, water=water, **anyhow(5, 0.4))
    M, integrals = mass_matrix(numbers), []
    A = M[:3, :3] - m * np.eye(3)
    for _ in range(3):
        R, nu = attitude(auvs), fields(auvs, *SPEEDS, *SPINS)
        place = fields(auvs, "north", "east", "depth") - DOWN * DEPTH
        V = np.einsum("nji,nj->ni", R, water.at(place, 0.0))
        x = nu[:, :3] + V
        kinetic = 0.5 * np.einsum("ni,ij,nj->n", np.hstack([x, nu[:, 3:]]), M, np.hstack([x, nu[:, 3:]]))
        integrals.append(kinetic - 0.5 * np.einsum("ni,ij,nj->n", V, A + m * np.eye(3), V))
        auvs.flight(800, 0.005)()
    assert np.array(integrals) == pytest.approx(np.tile(integrals[0], (3, 1)), abs=3e-3)


def test_port_and_starboard_mirror():
    """With a propeller that takes no torque."""
    numbers = DEFAULTS | NO_TORQUE
    state, told = anyhow(6), (0.2, 0.1, 15.0)
    other = {name: -value if name in ("v", "p", "r", "q1", "q3") else value for name, value in state.items()}
    mine, yours = fleet(numbers, told, **state), fleet(numbers, (-0.2, 0.1, 15.0), **other)
    for auvs in (mine, yours):
        auvs.flight(200, 0.05)()
    for name in (*SPEEDS, *SPINS, "q0", "q1", "q2", "q3", "north", "east", "depth"):
        sign = -1 if name in ("v", "p", "r", "q1", "q3", "east") else 1
        assert mine.numpy(name) == pytest.approx(sign * yours.numpy(name), abs=2e-5), name


def test_trim_stays_level_and_straight_at_its_power():
    """Speed, depth, course and heel for five minutes; energy = (2π n Q/efficiency + hotel) t."""
    auvs = Fleet(LANES)
    speed, heading = np.linspace(0.5, 2.4, LANES), np.linspace(-3.0, 3.0, LANES)
    auvs.set(Command, speed=speed, depth=DEPTH, heading=heading)
    auvs.trim()
    n, heel = auvs.numpy("propeller"), auvs.numpy("q1")
    auvs.set(Actuators, propeller=n)
    auvs.flight(6000, 0.05)()
    t = auvs.numpy("time")
    assert auvs.numpy("u") == pytest.approx(speed, rel=1e-4)
    assert auvs.numpy("depth") == pytest.approx(DEPTH, abs=0.05)
    assert np.unwrap(np.arctan2(auvs.numpy("east"), auvs.numpy("north"))) == pytest.approx(heading, abs=1e-3)
    assert auvs.numpy("energy") == pytest.approx(Reference(DEFAULTS).power(n, speed) * t, rel=1e-3)
    assert (heel[np.abs(heading) < 1.5] < 0).all()  # to port


def test_terminal_speed_is_where_thrust_is_drag():
    n = np.linspace(5.0, 25.0, LANES)
    auvs = fleet(DEFAULTS, (0.0, 0.0, n))
    auvs.flight(2400, 0.05)()
    drag = 0.5 * RHO * DEFAULTS["axial_drag"] * math.pi / 4 * D**2
    propeller = Reference(DEFAULTS).propeller
    known = [brentq(lambda u, n=n: propeller(np.array(n), np.array(u))[0] - drag * u * u, 0.01, 9.0) for n in n]
    assert auvs.numpy("u") == pytest.approx(np.array(known), rel=2e-4)


def test_actuators_lag_and_have_limits():
    """A rudder told 0.1 is at 0.1 (1 − e^(−t/T)); one told 1 turns at its rate and stops at its limit."""
    told = np.where(np.arange(LANES) < 8, 0.1, 1.0)
    auvs = fleet(DEFAULTS, rudder=0.0, propeller=0.0)
    auvs.set(Actuators, rudder=told, propeller=100.0)
    auvs.flight(3, 0.05)()
    expected = np.where(told == 0.1, 0.1 * (1 - math.exp(-1.5)), 0.15)
    assert auvs.numpy("rudder") == pytest.approx(expected, rel=1e-4)
    auvs.flight(100, 0.05)()
    assert auvs.numpy("rudder") == pytest.approx(np.where(told == 0.1, 0.1, DEFAULTS["fin_limit"]), rel=1e-4)
    assert auvs.numpy("propeller") == pytest.approx(DEFAULTS["propeller_limit"], rel=1e-4)


def test_surface_and_bed_stop_it_and_are_reported():
    """Half rise to the surface, half sink on a slope; neither comes through, nor gains speed."""
    up = np.arange(LANES) < 8
    auvs = fleet(DEFAULTS, (0.0, 0.0, 15.0), depth=3.0, u=1.5, q0=math.cos(0.3), q2=np.where(up, 1, -1) * math.sin(0.3))
    auvs.set(Surroundings, bed=6.0, bed_n=-0.02)
    auvs.flight(300, 0.05)()
    depth, radius = auvs.numpy("depth"), D / 2
    assert (depth >= radius - 1e-6).all()
    assert (depth <= 6.0 - 0.02 * auvs.numpy("north") - radius + 1e-5).all()
    assert (auvs.numpy("surfaced") == up).all()
    assert (auvs.numpy("grounded") == ~up).all()
    assert np.linalg.norm(fields(auvs, *SPEEDS), axis=1).max() < 2.0


def test_factors_on_mass_drag_and_fins():
    """Half the forces, or twice the mass and keel: the same acceleration; each factor acts on its own."""
    state = anyhow(7)

    def rates(**factors):
        auvs = fleet(DEFAULTS, (0.1, 0.2, 0.0), **state)
        auvs.set(Surroundings, **factors)
        return measured(auvs, DEFAULTS)

    forces, plain = rates()
    inertial = rates(drag=0.0, fins=0.0)[1]
    heavy = rates(mass=2.0)[1]
    assert heavy - 0.5 * plain == pytest.approx(0.5 * inertial, abs=2e-3)
    assert rates(drag=0.5, fins=0.5)[1] != pytest.approx(plain, abs=0.05)
    no_fins = rates(fins=0.0)[0]
    assert rates(drag=1.5)[0] - forces == pytest.approx(0.5 * (no_fins - rates(drag=0.0, fins=0.0)[0]), abs=0.3)


def test_no_state_and_no_command_break_it():
    """Thrown across violent shear, at full fins, ahead and astern: speeds end as a vehicle's, attitudes as units."""
    rng = np.random.default_rng(9)
    water = Water(gradient=0.3 * rng.normal(size=(3, 3)))
    auvs = fleet(DEFAULTS, (0.5, -0.5, 25.0), water, **(anyhow(9, 1.5) | {"u": 3.0, "v": -3.0, "r": 2.5}))
    auvs.set(Surroundings, mass=0.8, drag=1.2, fins=1.2)
    for revolutions in (25.0, -25.0, 25.0):
        auvs.set(Actuators, propeller=revolutions)
        auvs.set(north=0.0, east=0.0, depth=DEPTH)
        auvs.flight(200, 0.05)()
    assert np.linalg.norm(fields(auvs, *SPEEDS), axis=1).max() < 6
    assert np.linalg.norm(fields(auvs, "q0", "q1", "q2", "q3"), axis=1) == pytest.approx(1, abs=1e-5)


@cache
def flown(seconds: float, told: tuple[float, float, float]):
    """The NumPy vehicle in a sheared and accelerating current, from random states; where it began, and where it is."""
    rng = np.random.default_rng(8)
    water = Water(0.5 * rng.normal(size=3), 0.03 * rng.normal(size=(3, 3)), 0.05 * rng.normal(size=3))
    numbers = DEFAULTS | {"buoyancy": 4.0, "fin_rate": 100.0}
    rotation = Rotation.from_euler("ZYX", rng.normal(size=(LANES, 3)) * [2.0, 0.3, 0.3])
    v, omega = 0.3 * rng.normal(size=(LANES, 3)) + [1.2, 0, 0], 0.2 * rng.normal(size=(LANES, 3))
    reference = Reference(numbers, water, told)
    begin = reference.start(np.zeros((LANES, 3)), rotation.as_matrix(), v, omega, (0.0, 0.0, 10.0))
    x, R, v_end, omega_end, *_ = reference.motion(reference.fly(begin, seconds), seconds)
    q = rotation.as_quat()
    state = dict(zip((*SPEEDS, *SPINS), [*v.T, *omega.T], strict=True))
    state |= {"q0": q[:, 3], "q1": q[:, 0], "q2": q[:, 1], "q3": q[:, 2]}
    state |= {"rudder": 0.0, "stern": 0.0, "propeller": 10.0}
    return numbers, water, state, (x + DOWN * DEPTH, R, v_end, omega_end)


def test_no_number_at_an_end_of_its_range_breaks_it():
    """Few are refused, by name."""
    refused = []
    for name, number in TORPEDO.numbers.items():
        for value in (number.low, number.high):
            try:
                auvs = Fleet(LANES, numbers=DEFAULTS | {"length": 3.2, name: value})
            except ValueError as error:
                refused.append(str(error).partition(" ")[0])
                assert refused[-1] == name
                continue
            auvs.set(Command, speed=1.5, depth=DEPTH)
            auvs.trim()
            auvs.set(Command, depth=DEPTH + 10.0, heading=2.0)
            auvs.flight(40, commanded=True)()
            assert auvs.state.isfinite().all(), (name, value)
    assert refused == ["mass", "propeller_diameter"]


def test_trajectories_are_those_of_the_numpy_vehicle():
    """To integration error, of second order: halving the substep leaves a quarter, until rounding shows."""
    seconds, told = 6.0, (0.15, -0.1, 18.0)
    numbers, water, state, known = flown(seconds, told)
    errors = []
    for dt in (0.1, 0.05, 0.025):
        auvs = fleet(numbers, told, water, **state)
        auvs.flight(round(seconds / dt), dt)()
        found = fields(auvs, "north", "east", "depth"), attitude(auvs), fields(auvs, *SPEEDS)
        found = *found, fields(auvs, *SPINS)
        errors.append([np.abs(mine - theirs).max() for mine, theirs in zip(found, known, strict=True)])
    errors = np.array(errors)
    assert (errors[1] < [2e-2, 3e-3, 5e-4, 5e-4]).all()
    assert np.log2(errors[:-1] / errors[1:]).mean(0) == pytest.approx(2.0, abs=0.35)
