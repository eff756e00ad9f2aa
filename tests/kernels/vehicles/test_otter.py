"""The Otter against closed forms, its invariants, and an integration in NumPy from the equations of motion."""

import math

import numpy as np
import pytest
import taichi as ti
import torch
from scipy.integrate import quad, solve_ivp

from usvauv.env.scenario.team import Otter
from usvauv.kernels.functions import kernel
from usvauv.kernels.types import array1, array2, vec2
from usvauv.kernels.vehicles import otter, otter_numbers
from usvauv.kernels.vehicles.otter import HullColumn
from usvauv.kernels.vehicles.vehicle import cross_flow

NUMBERS = Otter.model_validate({}).model_dump()
UNDAMPED = dict.fromkeys(("damping_surge", "damping_sway", "damping_yaw", "damping_turn", "cross_flow"), 0.0)
CALM = {"frontal_area": 0.0, "lateral_area": 0.0}


def sailed(hulls, orders, air=(0.0, 0.0), dt=0.1, time=10.0, **changes):
    """Hulls (n, 8) and ways (n, 2) after some time under orders."""
    hull = torch.tensor(np.atleast_2d(hulls), dtype=torch.float32)
    n = len(hull)
    way = torch.zeros(n, 2)
    orders, air = (torch.tensor(np.broadcast_to(x, (n, 2)).copy(), dtype=torch.float32) for x in (orders, air))
    otter.integrate(
        torch.from_numpy(otter_numbers.table_of(NUMBERS | changes)), hull, orders, air, dt, round(time / dt), way
    )
    return hull.numpy().astype(float), way.numpy().astype(float)


@kernel
def integrals(flow: array2, length: ti.f32, out: array2):
    for i in range(flow.shape[0]):
        half = 0.5 * length
        force, moment = cross_flow(flow[i, 0], half * flow[i, 1])
        out[i, 0], out[i, 1] = half * force, half * half * moment


@kernel
def allocated(table: array1, wanted: array2, out: array2):
    for i in range(wanted.shape[0]):
        T = otter.allocate(table, wanted[i, 0], wanted[i, 1])
        n = otter.revolutions(table, T)
        thrust = otter.thrusts(table, vec2(n[0], n[1]))
        for c in ti.static(range(2)):
            out[i, c] = T[c]
            out[i, 2 + c] = thrust[c]


def along(v, r, power, half):
    """∫ x^power |v + x r| (v + x r) dx from −half to half, by quadrature."""
    kinks = [-v / r] if r and abs(v / r) < half else None

    def local(x):
        return x**power * abs(v + x * r) * (v + x * r)

    return quad(local, -half, half, points=kinks, epsabs=1e-9)[0]


def test_cross_flow_is_the_integral_along_the_hull():
    flow = [(0.7, 0.0), (0.0, -0.4), (0.3, 0.2), (-0.1, 0.3), (0.05, -0.5), (0.0, 0.0), (0.2, 0.2)]
    out = torch.zeros(len(flow), 2)
    integrals(torch.tensor(flow), 2.0, out)
    expected = [[along(v, r, power, 1.0) for power in (0, 1)] for v, r in flow]
    np.testing.assert_allclose(out.numpy(), expected, rtol=1e-5, atol=1e-7)
    assert out[0, 0].item() == pytest.approx(0.7**2 * 2)
    assert out[1, 1].item() == pytest.approx(-(0.4**2) * 2**4 / 32)


def energy(hull, numbers):
    m22, m23 = numbers["mass"] + numbers["added_sway"], numbers["mass"] * numbers["centre"]
    m33 = numbers["inertia"] + numbers["mass"] * numbers["centre"] ** 2 + numbers["added_yaw"]
    u, v, r = hull[:, HullColumn.u], hull[:, HullColumn.v], hull[:, HullColumn.r]
    return 0.5 * ((numbers["mass"] + numbers["added_surge"]) * u**2 + m22 * v**2 + m33 * r**2) + m23 * v * r


MOVING = [[0.3, 1.5, -0.6, 0.4, 0, 0, 0, 0], [0.0, -0.8, 0.9, -0.7, 0, 0, 0, 0], [2.0, 0.0, 0.4, 0.5, 0, 0, 0, 0]]


def test_coriolis_forces_do_no_work():
    hull, _ = sailed(MOVING, (0, 0), dt=0.02, time=5.0, **UNDAMPED, **CALM)
    np.testing.assert_allclose(energy(hull, NUMBERS), energy(np.array(MOVING), NUMBERS), rtol=1e-4)
    assert np.abs(hull[:, 1:4] - np.array(MOVING)[:, 1:4]).max() > 0.3  # they move it all the same


def test_without_thrust_the_kinetic_energy_falls():
    before = energy(np.array(MOVING), NUMBERS)
    for time in (0.2, 0.6, 1.2, 3.0):
        after = energy(sailed(MOVING, (0, 0), time=time)[0], NUMBERS)
        assert (after < before).all()
        before = after


@pytest.mark.parametrize("n", [-60.0, 40.0, 103.9])
def test_terminal_speed_is_where_thrust_is_drag(n):
    hull, _ = sailed(np.zeros(8), (n, n), time=30.0, **CALM)
    k = NUMBERS["thrust_ahead" if n > 0 else "thrust_astern"]
    assert hull[0, HullColumn.u] == pytest.approx(2 * k * n * abs(n) / NUMBERS["damping_surge"], rel=1e-5)
    assert otter_numbers.top_speed(NUMBERS) == pytest.approx(3.087, rel=2e-3)  # 6 knots


def test_port_is_the_mirror_of_starboard():
    hulls = np.array(MOVING)
    mirror = np.array([-1, 1, -1, -1])
    hull, way = sailed(hulls, (90, -40), (6.0, -4.0))
    hulls[:, :4] *= mirror
    other, across = sailed(hulls, (-40, 90), (6.0, 4.0))
    np.testing.assert_allclose(other[:, :4] * mirror, hull[:, :4], atol=1e-5)
    np.testing.assert_allclose(across * [1, -1], way, atol=1e-4)


def test_a_boat_that_slips_turns_broadside_on():
    """The sign of Munk's moment: (m11 − m22) u v turns the bow away from the side that the water comes from."""
    hull, _ = sailed([0, 1.0, 0.3, 0, 0, 0, 0, 0], (0, 0), dt=0.02, time=0.2, centre=0.0, **UNDAMPED, **CALM)
    assert hull[0, HullColumn.r] == pytest.approx(-0.2 * (82.5 - 5.3) * 0.3 / (14.1 + 25.7), rel=0.02)


def slope(t, s, orders, air, numbers):
    """d/dt of (north, east, heading, u, v, r, left, right): M ν̇ = τ − C ν − D ν with matrices and quadratures."""
    n = numbers
    heading, nu, revolutions = s[2], s[3:6], s[6:]
    u, v, r = nu
    mass = np.diag([n["mass"], n["mass"], n["inertia"] + n["mass"] * n["centre"] ** 2])
    mass[1, 2] = mass[2, 1] = n["mass"] * n["centre"]
    mass += np.diag([n["added_surge"], n["added_sway"], n["added_yaw"]])
    momentum = mass @ nu
    coriolis = np.array([-momentum[1] * r, momentum[0] * r, momentum[1] * u - momentum[0] * v])
    cross = [along(v, r, power, n["length"] / 2) for power in (0, 1)]
    drag = np.array([n["damping_surge"], n["damping_sway"], n["damping_yaw"] + n["damping_turn"] * abs(r)]) * nu
    drag[1:] += 0.5 * 1025 * n["cross_flow"] * n["draught"] * np.array(cross)
    k = np.where(revolutions > 0, n["thrust_ahead"], n["thrust_astern"])
    left, right = k * revolutions * abs(revolutions)
    turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
    relative = turn @ [u, v] - np.array(air)  # Fossen's relative velocity and angle of attack of the wind
    u_rw, v_rw = turn.T @ relative
    angle = -math.atan2(v_rw, u_rw)
    pressure = 0.5 * 1.225 * (u_rw**2 + v_rw**2)
    wind = pressure * np.array(
        [
            -n["wind_surge"] * math.cos(angle) * n["frontal_area"],
            n["wind_sway"] * math.sin(angle) * n["lateral_area"],
            n["wind_yaw"] * math.sin(2 * angle) * n["lateral_area"] * n["length"],
        ]
    )
    tau = np.array([left + right, 0.0, n["lever"] * (left - right)]) + wind
    lag = (np.array(orders) - revolutions) / n["propeller_lag"]
    return np.concatenate([turn @ [u, v], [r], np.linalg.solve(mass, tau - coriolis - drag), lag])


@pytest.mark.parametrize(("orders", "air"), [((100, 60), (0, 0)), ((-50, 90), (-8, 9)), ((30, 20), (12, 3))])
def test_its_way_is_that_of_an_independent_integration(orders, air):
    begin = np.array([0.4, 0.8, -0.2, 0.1, 20.0, -30.0, 0.0, 0.0])
    start = np.concatenate([[0, 0], begin[:6]])
    exact = solve_ivp(slope, (0, 12), start, "DOP853", args=(orders, air, NUMBERS), rtol=1e-9, atol=1e-9).y[:, -1]

    def error(dt):
        hull, way = sailed(begin, orders, air, dt, 12.0)
        return np.abs(np.concatenate([way[0], hull[0, :4]]) - exact[:6]).max()

    assert error(0.05) < 3e-4
    assert error(0.2) < 0.03


def test_runge_kutta_is_of_fourth_order():
    """Against short steps, in calm air, where the forces are smooth: |r| r is not, where r changes sign."""
    begin, changes = [0.0, 2.0, 0.8, 0.3, 90.0, 60.0, 0.0, 0.0], {"propeller_lag": 0.5, "damping_turn": 0.0, **CALM}
    fine = sailed(begin, (90, 60), dt=0.0125, time=0.8, **changes)[0]
    errors = [np.abs(sailed(begin, (90, 60), dt=dt, time=0.8, **changes)[0] - fine)[0, :4].max() for dt in (0.2, 0.1)]
    assert errors[0] / errors[1] > 11


@pytest.mark.parametrize("rate", [1.2, 3.0])
def test_a_boat_that_spins_comes_to_rest(rate):
    """Quadratic damping is then too stiff for one step of Runge–Kutta of `LONGEST`."""
    spinning = np.zeros((1, 8))
    spinning[0, HullColumn.r] = rate
    coarse, fine = (sailed(spinning, (0.0, 0.0), dt=dt, time=2.0, **CALM)[0][0] for dt in (otter_numbers.LONGEST, 0.01))
    np.testing.assert_allclose(coarse[:4], fine[:4], atol=0.02)


@pytest.mark.parametrize(
    "changes",
    [{"lateral_area": 50.0}, {"added_sway": 5000.0}, {"damping_turn": 1e5}, {"added_yaw": 0.0, "wind_yaw": 1.0}],
)
def test_its_substep_is_as_good_as_a_short_one(changes):
    """In a gale abeam, under thrust that turns it."""
    dt = float(otter_numbers.table_of(NUMBERS | changes, 30.0)[otter_numbers.Number.substep])
    steps = 8 * round(0.25 / dt + 0.5)
    ends = [sailed(np.zeros(8), (100, -60), (5.0, 29.0), 2.0 / n, 2.0, **changes)[0][0] for n in (steps, 20 * steps)]
    np.testing.assert_allclose(ends[0][:4], ends[1][:4], atol=0.05)


def test_what_is_allocated_keeps_the_moment_first():
    table = torch.from_numpy(otter_numbers.table_of(NUMBERS))
    ahead, astern, lever = 0.01108 * 103.9**2, 0.006445 * 101.7**2, NUMBERS["lever"]
    wanted = torch.tensor([[50.0, 10.0], [500.0, 30.0], [500.0, -30.0], [-500.0, 20.0], [500.0, 500.0]])
    out = torch.zeros(5, 4)
    allocated(table, wanted, out)
    T = out[:, :2].double().numpy()
    np.testing.assert_allclose(lever * (T[:, 0] - T[:, 1]), [10, 30, -30, 20, lever * (ahead + astern)], rtol=1e-4)
    assert T[0].sum() == pytest.approx(50, rel=1e-5)
    assert T[1].max() == T[2].max() == pytest.approx(ahead, rel=1e-5)
    assert T[3].min() == pytest.approx(-astern, rel=1e-5)
    assert T.max() < ahead * 1.00001
    assert T.min() > -astern * 1.00001
    np.testing.assert_allclose(out[:, 2:].numpy(), T, rtol=1e-4, atol=1e-3)


def test_beside_the_public_simulator():
    """Its speeds and its turning circle (6 degrees of freedom, still water).

    It has the payload's weight act along the axes of the trimmed boat, without the buoyancy that bears it: some 7 to
    10 N ahead, more than which nothing separates the speeds.
    """
    theirs = np.array([0.54, 1.12, 1.93, 2.98])
    orders = [[n, n] for n in (40, 60, 80, 100)] + [[100, 60]]
    hull, _ = sailed(np.zeros((5, 8)), orders, time=40.0)
    ours = hull[:4, HullColumn.u]
    assert (ours < theirs).all()
    assert (theirs - ours < 10 / NUMBERS["damping_surge"] + 0.02).all()
    u, v, r = hull[4, 1:4]
    assert math.hypot(u, v) / r == pytest.approx(7.1, rel=0.06)
