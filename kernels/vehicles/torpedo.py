"""A torpedo-shaped AUV in six degrees of freedom.

The velocity ν = (v, ω) has v relative to the water at the vehicle's centre of buoyancy, and ω over ground. With R from
body axes to north, east, down, V the water's velocity, G = ∇V its gradient and DV/Dt = ∂V/∂t + G V, in body axes:

    M_RB (ν̇ + [G v; 0]) + C_RB(ν) ν + M_A ν̇ + C_A(ν) ν + [Gᵀ A v; 0] + g(η) = τ_damping + τ_fins + τ_propeller.

**Non-uniform flow.** Lagrange's function of a body in potential flow that changes little over its size is
½ m |v + V|² + ½ v·A v + ½ m_f |V|² + ½ ω·I ω, with A the added masses and m_f the displaced water's mass (Lamb,
"Hydrodynamics", §139; Galper and Miloh 1995, J. Fluid Mech. 295, 91–120). It gives

    m d(v + V)/dt + d(A v)/dt + Gᵀ A v = m_f DV/Dt + other forces,   d(v + V)/dt = dv/dt + DV/Dt + G v,

and Munk's moment −v × A v. So a stationary potential flow leaves ½ m |v + V|² + ½ (v + V)·A (v + V) − ½ V·A V −
½ m_f |V|² + ½ ω·I ω as it is. In a rotational flow Auton, Hunt and Prud'homme (1988), doi 10.1017/S0022112088003246,
have for a sphere the force A (DV/Dt − d(v + V)/dt) − A v × curl V to first order, which is −d(A v)/dt − Gᵀ A v again.
What m_f − m leaves of DV/Dt − g acts at the centre of buoyancy, the rest at the centre of mass: a uniform flow, steady
or accelerated, is a moving frame in which gravity is g − DV/Dt.

**Damping.** Along the hull the water's velocity is V + x G x̂, so that with r' = r − ŷ·G x̂ and q' = q + ẑ·G x̂ the
cross-flow at x is v + x r' and w − x q', and its drag −ρ/2 C_d D ∫ |v + x r'| (v + x r') dx is a piecewise cubic. Lift
of the hull and of the fins is that of a wing in the flow where it acts, square to that flow, with the drag that it
brings; beyond stall the hull's lift goes, since the cross-flow is all there is (Allen and Perkins 1951, NACA Report
1048), and a fin is a plate. Each of these forces takes energy or leaves it. Roll is damped relative to the water's
rotation.

**Propeller.** T = ρ n² D⁴ K_T(J) (1 − t) with J = (1 − w) u/(n D), u the speed through the water ahead, and K_T, K_Q
straight lines; astern and going backwards those of J = 0. It turns right, so that the hull heels to port.

Left out: the body's own straining by a flow, with its moment of the order of I G ω; waves that the hull makes near the
surface, where it also loses no buoyancy; the propeller's race on the fins.
"""

from collections.abc import Mapping

import numpy as np
import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.transcendental import TWO_PI, decaying
from usvauv.kernels.vehicles import autopilot, gains
from usvauv.kernels.vehicles.definition import Vehicle, vehicles
from usvauv.kernels.vehicles.kinematics import Triple, axes, dot, gradient, gradient_transposed, velocity_of_water
from usvauv.kernels.vehicles.numbers import GRAVITY, Constant, constants_of
from usvauv.kernels.vehicles.stability import ALL_NUMBERS, substep
from usvauv.kernels.vehicles.vehicle import (
    LANES,
    TINY,
    Actuators,
    Body,
    cross_flow,
    lanes,
    magnitude,
    positive,
)

STAGES = 2
TURNING = 10.0  # m
SINE, COSINE = (-1 / 6, 1 / 120), (-1 / 2, 1 / 24, -1 / 720)  # coefficients of Taylor's series for fins' angles
Wrench = ti.types.struct(x=lanes, y=lanes, z=lanes, roll=lanes, pitch=lanes, yaw=lanes)
Rates = ti.types.struct(
    north=lanes,
    east=lanes,
    depth=lanes,
    u=lanes,
    v=lanes,
    w=lanes,
    p=lanes,
    q=lanes,
    r=lanes,
    energy=lanes,
)


@func
def hull(table: ti.template(), u, v, w) -> Triple:
    """Lift of the hull and the drag it brings, N, in a flow of velocity −(u, v, w)."""
    cross = v * v + w * w
    U = ti.sqrt(cross + u * u + TINY)
    share = 1.0 / U
    sin2, cos = cross * share * share, u * share
    stalled = sin2 * table[Constant.hull_stall]
    attached = 1.0 / (1.0 + stalled * stalled)
    lift = table[Constant.hull_lift] * attached * cos
    drag = table[Constant.hull_induced] * attached * attached * sin2 * cos * cos * U
    across = lift * u + drag
    return Triple(lift * cross - drag * u, across * -1.0 * v, across * -1.0 * w)


@func
def fin(table: ti.template(), area, slope, angle, u, v):
    """Force of a pair of fins across and ahead, N, turned by an angle in a flow of velocity −(u, v).

    With S = U sin α and K = U cos α, α = angle + arctan(v/u): C_L U² = slope S K and C_D U² = (slope S K)²/(π e AR U²);
    beyond stall those of a plate, 2 |S| S K/U and 2 |S|³/U.
    """
    a2 = angle * angle
    sin = angle * (1.0 + a2 * (SINE[0] + a2 * SINE[1]))
    cos = 1.0 + a2 * (COSINE[0] + a2 * (COSINE[1] + a2 * COSINE[2]))
    S, K = u * sin + v * cos, u * cos - v * sin
    share = 1.0 / ti.sqrt(u * u + v * v + TINY)
    share2 = share * share
    stalled = S * S * share2 * table[Constant.fin_stall]
    attached = 1.0 / (1.0 + stalled * stalled)
    plate = (1.0 - attached) * 2.0 * magnitude(S) * S * share
    wing = slope * S * K
    lift = (attached * wing + plate * K) * share
    drag = (attached * table[Constant.fin_induced] * wing * wing * share2 + plate * S) * share
    return area * -1.0 * (lift * u + drag * v), area * (lift * v - drag * u)


@func
def propeller(table: ti.template(), n, u):
    """Thrust, N, and the torque that its shaft takes, N m."""
    turning = magnitude(n) * n
    through = ti.max(n, 0.0) * ti.max(u, 0.0)
    return (
        table[Constant.thrust_0] * turning + table[Constant.thrust_slope] * through,
        table[Constant.torque_0] * turning + table[Constant.torque_slope] * through,
    )


@func
def forces(table: ti.template(), body, p, q, r, water) -> Wrench:
    """Damping, fins and propeller. `p`, `q`, `r`: angular velocity relative to the water, as `Damping` above has it."""
    u, v, w, drag = body.u, body.v, body.w, water.drag
    half = table[Constant.half_length]
    sway, sway_moment = cross_flow(v, half * r)
    heave, heave_moment = cross_flow(w, half * -1.0 * q)
    place = table[Constant.hull_lift_place]
    lift = hull(table, u, v + place * r, w - place * q)
    tail = table[Constant.fin_place]
    area, slope = table[Constant.rudder_area] * water.fins, table[Constant.rudder_lift]
    rudder, rudder_ahead = fin(table, area, slope, body.rudder, u, v + tail * r)
    area, slope = table[Constant.stern_area] * water.fins, table[Constant.stern_lift]
    stern, stern_ahead = fin(table, area, slope, body.stern, u, w - tail * q)
    thrust, torque = propeller(table, body.propeller, u)
    across, linear = table[Constant.cross_drag] * 0.5, table[Constant.linear_sway]
    turning = table[Constant.linear_turn]
    return Wrench(
        x=drag * (lift.x - table[Constant.axial_drag] * magnitude(u) * u) + rudder_ahead + stern_ahead + thrust,
        y=drag * (lift.y - across * sway - linear * v) + rudder,
        z=drag * (lift.z - across * heave - linear * w) + stern,
        roll=drag * -1.0 * table[Constant.linear_roll] * p - torque,
        pitch=drag * (half * across * heave_moment - place * lift.z - turning * q) - tail * stern,
        yaw=drag * (place * lift.y - half * across * sway_moment - turning * r) + tail * rudder,
    )


@func
def rates(table: ti.template(), body, water) -> Rates:
    """Time derivatives of place, velocities and energy."""
    u, v, w, p, q, r = body.u, body.v, body.w, body.p, body.q, body.r
    axis = axes(body)
    through = Triple(
        axis.x.x * u + axis.y.x * v + axis.z.x * w,
        axis.x.y * u + axis.y.y * v + axis.z.y * w,
        axis.x.z * u + axis.y.z * v + axis.z.z * w,
    )
    V = velocity_of_water(body, water)
    convected = gradient(water, V)
    sheared = gradient(water, through)
    along = gradient(water, axis.x)
    curl = Triple(water.de - water.ed, water.nd - water.dn, water.en - water.ne)
    forced = forces(table, body, p - 0.5 * dot(curl, axis.x), q + dot(along, axis.z), r - dot(along, axis.y), water)

    # The water's part of the acceleration, and gravity.
    m, X, Y = table[Constant.mass], table[Constant.added_surge], table[Constant.added_sway]
    slender = (Y - X) * u
    added = Triple(
        Y * through.x - slender * axis.x.x, Y * through.y - slender * axis.x.y, Y * through.z - slender * axis.x.z
    )
    impulse = gradient_transposed(water, added)
    down = water.rate_d + convected.z - GRAVITY
    falling = Triple(water.rate_n + convected.x, water.rate_e + convected.y, down)
    lighter = table[Constant.displaced]
    inertia = Triple(
        m * sheared.x + impulse.x - lighter * falling.x,
        m * sheared.y + impulse.y - lighter * falling.y,
        m * sheared.z + impulse.z - lighter * falling.z,
    )
    weighed = Triple(sheared.x + falling.x, sheared.y + falling.y, sheared.z + falling.z)

    # Everything but M ν̇, with C(ν) ν from M.
    share = 1.0 / water.mass
    arm = m * table[Constant.weight_below]
    Ix, Iy = table[Constant.roll_inertia], table[Constant.turn_inertia]
    Iz = Iy - arm * table[Constant.weight_below]
    ahead, aside = m + X, m + Y
    turned_x, turned_y = q * w - r * v, r * u - p * w
    x = forced.x * share - (aside * turned_x + arm * p * r + dot(inertia, axis.x))
    y = forced.y * share - (ahead * r * u - aside * p * w + arm * q * r + dot(inertia, axis.y))
    z = forced.z * share - (aside * p * v - ahead * q * u - arm * (p * p + q * q) + dot(inertia, axis.z))
    roll = forced.roll * share + arm * (turned_y + dot(weighed, axis.y)) - (Iz - Iy) * q * r
    pitch = forced.pitch * share - arm * (turned_x + dot(weighed, axis.x)) - (Ix - Iz) * p * r + slender * w
    yaw = forced.yaw * share - (Iy - Ix) * p * q - slender * v
    _, torque = propeller(table, body.propeller, u)
    return Rates(
        north=through.x + V.x,
        east=through.y + V.y,
        depth=through.z + V.z,
        u=table[Constant.uq_uu] * x + table[Constant.uq_uq] * pitch,
        v=table[Constant.vp_vv] * y + table[Constant.vp_vp] * roll,
        w=table[Constant.heave] * z,
        p=table[Constant.vp_vp] * y + table[Constant.vp_pp] * roll,
        q=table[Constant.uq_uq] * x + table[Constant.uq_qq] * pitch,
        r=table[Constant.yaw] * yaw,
        energy=ti.max(TWO_PI * body.propeller * torque, 0.0) / table[Constant.efficiency] + table[Constant.hotel],
    )


@func
def follow(angle, told, limit, most, share) -> lanes:
    """An actuator after a time: a first-order lag towards its command, with its limit and its largest change."""
    return angle + autopilot.clamp(share * (autopilot.clamp(told, limit) - angle), most)


@func
def after(table: ti.template(), begin, body, rate, actuators, h: ti.f32) -> Body:
    """The state `h` seconds after `begin`, at the rates found at `body`."""
    p, q, r = 0.5 * h * body.p, 0.5 * h * body.q, 0.5 * h * body.r
    q0 = begin.q0 - body.q1 * p - body.q2 * q - body.q3 * r
    q1 = begin.q1 + body.q0 * p + body.q2 * r - body.q3 * q
    q2 = begin.q2 + body.q0 * q + body.q3 * p - body.q1 * r
    q3 = begin.q3 + body.q0 * r + body.q1 * q - body.q2 * p
    scale = 1.0 / ti.sqrt(q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3)
    fins = 1.0 - decaying(h / table[Constant.fin_lag])
    turn = 1.0 - decaying(h / table[Constant.propeller_lag])
    limit, most = table[Constant.fin_limit], h * table[Constant.fin_rate]
    fastest = table[Constant.propeller_limit]
    return Body(
        north=begin.north + h * rate.north,
        east=begin.east + h * rate.east,
        depth=begin.depth + h * rate.depth,
        q0=q0 * scale,
        q1=q1 * scale,
        q2=q2 * scale,
        q3=q3 * scale,
        u=begin.u + h * rate.u,
        v=begin.v + h * rate.v,
        w=begin.w + h * rate.w,
        p=begin.p + h * rate.p,
        q=begin.q + h * rate.q,
        r=begin.r + h * rate.r,
        rudder=follow(begin.rudder, actuators.rudder, limit, most, fins),
        stern=follow(begin.stern, actuators.stern, limit, most, fins),
        propeller=follow(begin.propeller, actuators.propeller, fastest, 2.0 * fastest, turn),
        energy=begin.energy + h * rate.energy,
        time=begin.time + h,
        surfaced=begin.surfaced,
        grounded=begin.grounded,
    )


@func
def kept_in_water(table: ti.template(), body, water) -> Body:
    """The vehicle with its hull's middle under the surface and over the bed; there it loses the velocity across.

    The bed is a plane. What touches is the middle of the hull, at a distance of its radius.
    """
    radius = table[Constant.radius]
    floor = ti.max(water.bed + water.bed_n * body.north + water.bed_e * body.east - radius, radius)
    high, low = positive(radius - body.depth), positive(body.depth - floor)
    V = velocity_of_water(body, water)
    axis = axes(body)
    sinking = axis.x.z * body.u + axis.y.z * body.v + axis.z.z * body.w + V.z
    slope = water.bed_n * (body.u * axis.x.x + V.x) + water.bed_e * (body.u * axis.x.y + V.y)
    change = high * ti.max(0.0 - sinking, 0.0) + low * ti.min(slope - sinking, 0.0)
    body.u += change * axis.x.z
    body.v += change * axis.y.z
    body.w += change * axis.z.z
    body.depth = ti.min(ti.max(body.depth, radius), floor)
    body.surfaced = ti.max(body.surfaced, high)
    body.grounded = ti.max(body.grounded, low)
    return body


@func
def advance(table: ti.template(), body, actuators, water, dt: ti.f32) -> Body:
    """One substep by the midpoint rule, the actuators' lags exactly; an error of order dt² in a given time."""
    now = body
    for stage in range(STAGES):
        h = dt / (STAGES - stage)
        now = after(table, body, now, rates(table, now, water), actuators, h)
    return kept_in_water(table, now, water)


@func
def trim(table: ti.template(), speed, depth, heading) -> Body:
    """Level and straight at a speed ahead through the water: thrust = drag, heeled by the propeller's torque.

    Args:
        speed: m/s; where the propeller does not reach it the vehicle begins with it and slows down.
        depth: m.
        heading: clockwise from north, rad.
    """
    bollard, slope = ti.max(table[Constant.thrust_0], TINY), table[Constant.thrust_slope] * speed
    root = ti.sqrt(slope * slope + 4.0 * bollard * table[Constant.axial_drag] * speed * speed)
    n = ti.min((root - slope) / (2.0 * bollard), table[Constant.propeller_limit])
    righting = GRAVITY * table[Constant.mass] * table[Constant.weight_below]
    _, torque = propeller(table, n, speed)
    heel = autopilot.clamp(0.0 - torque / ti.max(righting, TINY), 0.9)
    upright = ti.sqrt(0.5 + 0.5 * ti.sqrt(1.0 - heel * heel))
    heeled = 0.5 * heel / upright
    cos, sin = heading, heading
    for lane in ti.static(range(LANES)):
        cos[lane] = ti.cos(0.5 * heading[lane])
        sin[lane] = ti.sin(0.5 * heading[lane])
    return Body(depth=depth, q0=cos * upright, q1=cos * heeled, q2=sin * heeled, q3=sin * upright, u=speed, propeller=n)


@func
def drive(table: ti.template(), rudder, stern, propeller) -> Actuators:
    """Commands to the actuators for shares of their limits in [−1, 1]."""
    limit, fastest = table[Constant.fin_limit], table[Constant.propeller_limit]
    return Actuators(rudder=limit * rudder, stern=limit * stern, propeller=fastest * propeller)


def table_of(n: Mapping[str, float]) -> np.ndarray:
    """Numbers read by the functions, (N,) float32: constants of the equations, then those of the autopilot.

    Raises:
        ValueError: the length is not above the diameter.
    """
    constants = constants_of(n)
    return np.concatenate((constants, gains.constants_of(n, constants)))


TORPEDO = vehicles.register(
    "torpedo", Vehicle(ALL_NUMBERS, table_of, advance, autopilot.control, trim, drive, substep, TURNING)
)
