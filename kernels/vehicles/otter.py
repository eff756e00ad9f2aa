"""A catamaran of 2 m with two propellers, after the Otter of Maritime Robotics: surge, sway and yaw, and its autopilot.

Body axes are x forward, y to starboard, with the origin midships; headings are clockwise from north. Velocities
ν = (u, v, r) are relative to the water, and so is the wind: a uniform current is a moving frame. With M of body and
added mass,

    M ν̇ + C(ν) ν + D(ν) ν = τ,   M = [[m11, 0, 0], [0, m22, m23], [0, m23, m33]],   m23 = m x_g,
    C ν = (−(m22 v + m23 r) r, m11 u r, (m22 v + m23 r) u − m11 u v),   so νᵀ C ν = 0,
    D ν = (d_u u, d_v v + ½ρ C_d T F, d_r r + d_rr |r| r + ½ρ C_d T G),

with the draught T and the cross-flow along the hull F = ∫ |v + x r| (v + x r) dx, G = ∫ x |v + x r| (v + x r) dx from
−L/2 to L/2. A propeller at n rad/s has the thrust k n² ahead and −k' n² astern; n follows its order with
a lag, exactly. The propellers stand at ∓y from the centre line, so τ = (T_l + T_r, 0, y (T_l − T_r)) and the wind's

    X = ½ρ_a c_x A_F |V| V_x,   Y = ½ρ_a c_y A_L |V| V_y,   N = −ρ_a c_n A_L L V_x V_y,

V being the wind's velocity relative to the boat. Validity: slow waves, which it rides; no roll, pitch, wave drift, nor
loss of thrust with speed, which the linear damping of surge has in it: it is that of top speed at full thrust.

Autopilot. Yaw by a rate r_d = ω_h e clipped to a greatest one, e the error of heading, and a moment that gives it;
surge by proportional and integral terms. Both use the damping. `allocate` gives the yaw moment priority in the
propellers' thrust.

Sources: Fossen, "Handbook of Marine Craft Hydrodynamics and Motion Control" (2021), doi 10.1002/9781119575016, ch. 6
(M, C, damping), 8 (cross-flow), 10 (wind). Numbers: `usvauv.env.scenario.team.Otter`.
"""

import math

import taichi as ti

from usvauv.kernels.functions import func, kernel
from usvauv.kernels.types import Columns, array1, array2, vec2, vec6
from usvauv.kernels.vehicles.otter_numbers import MOST_PARTS, STABLE, STABLE_SPIN, Number, fastest_squared
from usvauv.kernels.vehicles.vehicle import cross_flow


class HullColumn(Columns):
    """A boat's motion, (…, 8): heading in rad, u and v in m/s, r in rad/s, propellers in rad/s, what autopilots sum."""

    heading: int
    u: int
    v: int
    r: int
    left: int
    right: int
    heading_sum: int  # rad s
    speed_sum: int  # m


boat8 = ti.types.vector(len(HullColumn.names), ti.f32)


@func
def wrap(angle: ti.f32) -> ti.f32:
    """An angle in [−π, π], rad."""
    return angle - 2.0 * math.pi * ti.round(angle * (0.5 / math.pi))


@func
def thrusts(table: ti.template(), n: vec2) -> vec2:
    """Thrusts of the propellers at n rad/s, left and right, N."""
    return n * n * ti.select(n > 0.0, table[Number.ahead], -table[Number.astern])


@func
def rates(table: ti.template(), s: vec6, T: vec2, air: vec2) -> vec6:
    """d/dt of s = (north, east, heading, u, v, r) relative to the water.

    Args:
        T: thrust, left and right, N. air: the wind's velocity relative to the water, north and east, m/s.
    """
    c, si = ti.cos(s[2]), ti.sin(s[2])
    u, v, r = s[3], s[4], s[5]
    wind_x = c * air[0] + si * air[1] - u
    wind_y = c * air[1] - si * air[0] - v
    wind = ti.sqrt(wind_x * wind_x + wind_y * wind_y)
    half = 0.5 * table[Number.length]
    cross, cross_moment = cross_flow(v, half * r)
    sideways = table[Number.m22] * v + table[Number.m23] * r
    X = T[0] + T[1] - table[Number.damping_surge] * u + table[Number.wind_surge] * wind * wind_x + sideways * r
    Y = (
        table[Number.wind_sway] * wind * wind_y
        - table[Number.damping_sway] * v
        - table[Number.cross_flow] * half * cross
        - table[Number.m11] * u * r
    )
    N = (
        table[Number.lever] * (T[0] - T[1])
        - table[Number.wind_yaw] * wind_x * wind_y
        - (table[Number.damping_yaw] + table[Number.damping_turn] * ti.abs(r)) * r
        - table[Number.cross_flow] * half * half * cross_moment
        - sideways * u
        + table[Number.m11] * u * v
    )
    return vec6(
        c * u - si * v,
        si * u + c * v,
        r,
        X / table[Number.m11],
        table[Number.inverse_22] * Y + table[Number.inverse_23] * N,
        table[Number.inverse_23] * Y + table[Number.inverse_33] * N,
    )


fastest_squared.__annotations__["table"] = ti.template()  # an array, passed on as it is
fastest_now = func(fastest_squared)


@func
def advance(table: ti.template(), hull: boat8, orders: vec2, air: vec2, dt: ti.f32):
    """The hull after dt s, and its way through the water (north, east) meanwhile, m; Runge–Kutta of fourth order,
    in as many parts as keep it stable as fast as the boat moves; not a number where that takes more than `MOST_PARTS`.

    Args:
        hull: `HullColumn`.
        orders: commanded revolutions of the propellers, left and right, rad/s.
        air: as of `rates`.
    """
    u, v, r = hull[HullColumn.u], hull[HullColumn.v], hull[HullColumn.r]
    moving = ti.sqrt(u * u + v * v)
    rate = ti.sqrt(fastest_now(table, ti.abs(u), ti.abs(v), ti.abs(r), air.norm() + moving))
    spin = table[Number.inverse_33] * (table[Number.damping_yaw] + 2.0 * table[Number.damping_turn] * ti.abs(r))
    parts = ti.max(ti.max(ti.ceil(dt * rate / STABLE), ti.ceil(dt * spin / STABLE_SPIN)), 1.0)
    s = vec6(0.0, 0.0, hull[HullColumn.heading], u, v, r)
    if not parts <= MOST_PARTS:  # which ends the run
        parts = 1.0
        s *= ti.math.nan
    part = dt / parts
    half = ti.exp(-0.5 * part / table[Number.lag])
    ended = vec2(hull[HullColumn.left], hull[HullColumn.right])
    for _ in range(int(parts)):
        begun = ended
        middle = orders + half * (begun - orders)
        ended = orders + half * (middle - orders)
        T = thrusts(table, middle)
        k1 = rates(table, s, thrusts(table, begun), air)
        k2 = rates(table, s + 0.5 * part * k1, T, air)
        k3 = rates(table, s + 0.5 * part * k2, T, air)
        k4 = rates(table, s + part * k3, thrusts(table, ended), air)
        s += part / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    after = boat8(s[2], s[3], s[4], s[5], ended[0], ended[1], hull[HullColumn.heading_sum], hull[HullColumn.speed_sum])
    return after, vec2(s[0], s[1])


@func
def allocate(table: ti.template(), X: ti.f32, N: ti.f32) -> vec2:
    """Thrust of the left and the right propeller for a force and a yaw moment, N and N m: the moment first."""
    ahead, astern = table[Number.most_ahead], table[Number.most_astern]
    D = ti.min(ti.max(N / table[Number.lever], -(ahead + astern)), ahead + astern)
    S = ti.min(ti.max(X, ti.abs(D) - 2.0 * astern), 2.0 * ahead - ti.abs(D))
    return vec2(0.5 * (S + D), 0.5 * (S - D))


@func
def revolutions(table: ti.template(), T: vec2) -> vec2:
    """At which the propellers have a thrust, rad/s."""
    k = ti.select(T > 0.0, table[Number.ahead], -table[Number.astern])
    return ti.select(T > 0.0, 1.0, -1.0) * ti.sqrt(T / k)


@func
def steer(table: ti.template(), hull: boat8, heading: ti.f32, speed: ti.f32, dt: ti.f32):
    """Orders for the propellers (rad/s), and the hull with what its autopilot has summed, for the next dt s.

    Args:
        heading, speed: wanted; the speed ahead through the water, negative astern.
    """
    ahead, astern = table[Number.most_ahead], table[Number.most_astern]
    error = wrap(heading - hull[HullColumn.heading])
    lacking = speed - hull[HullColumn.u]
    turn = table[Number.heading_gain] * error
    r = ti.min(ti.max(turn, -table[Number.turn_rate]), table[Number.turn_rate])
    N = (table[Number.damping_yaw] + table[Number.damping_turn] * ti.abs(r)) * r
    N += table[Number.m33] * (
        table[Number.rate_gain] * (r - hull[HullColumn.r]) + table[Number.heading_sum] * hull[HullColumn.heading_sum]
    )
    X = table[Number.damping_surge] * speed
    X += table[Number.m11] * (table[Number.speed_gain] * lacking + table[Number.speed_sum] * hull[HullColumn.speed_sum])
    T = allocate(table, X, N)
    after = hull
    # Nothing is summed that leads farther beyond a limit.
    if r == turn and (ti.abs(N) < table[Number.lever] * (ahead + astern) or error * N < 0.0):
        after[HullColumn.heading_sum] += dt * error
    beyond = X - T[0] - T[1]
    if ti.abs(beyond) < 1e-3 * ahead or lacking * beyond < 0.0:
        after[HullColumn.speed_sum] += dt * lacking
    return revolutions(table, T), after


@kernel
def integrate(table: array1, hull: array2, orders: array2, air: array2, dt: ti.f32, steps: ti.i32, way: array2):
    """Advance n boats, `hull` (n, 8) of `HullColumn`, by some substeps under constant orders; `way` (n, 2) adds up.

    Args:
        orders, air: (n, 2), as of `advance`. dt: s.
    """
    for i in range(hull.shape[0]):
        boat = boat8(0.0)
        for c in ti.static(range(8)):
            boat[c] = hull[i, c]
        for _ in range(steps):
            boat, moved = advance(table, boat, vec2(orders[i, 0], orders[i, 1]), vec2(air[i, 0], air[i, 1]), dt)
            for c in ti.static(range(2)):
                way[i, c] = way[i, c] + moved[c]
        for c in ti.static(range(8)):
            hull[i, c] = boat[c]
