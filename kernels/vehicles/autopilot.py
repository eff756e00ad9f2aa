"""The autopilot of a torpedo-shaped AUV: heading, depth or altitude, and speed, by its fins and its propeller.

Three loops, each behind a reference that the vehicle can follow: Fossen (2021), "Handbook of Marine Craft Hydrodynamics
and Motion Control", ch. 15; one loop round the other as Jalving (1994), "The NDRE-AUV flight control system", IEEE
J. Oceanic Eng. 19(4), 497–501, has them. V is the speed ahead through the water, L the hull's length, s = sin θ of the
pitch θ, up positive; a fin's moment is B V² δ.

**Heading.** The reference turns towards the command by ψ̇_r = V clamp((ψ_c − ψ_r)/Δ, ±1/R). The rudder gives the moment
I (ω² e + 2 ζ ω ė + κ ω³/V ∫e V dt) for e = ψ_r − ψ, and a share of the path's curvature ψ̇_r/V.

**Depth.** The reference z_r glides towards the depth z_c asked for at the slope s_r = clamp((z_r − z_c)/Δ), which
changes by V/R a second at most. The outer loop asks for the pitch s_c = s_r + (z − z_r)/Δ + ∫(z − z_r) V dt/(N Δ²). The
inner one gives it by the stern plane, with the moment I (ω² (s_c − s) − 2 ζ ω ṡ) + m g BG s_c.

**Frequencies.** ω goes with V/L. Since a fin's moment goes with V², the angle for an error is the same at each speed
and what happens takes so many lengths of the hull and not so many seconds.

**Bed and surface.** The depth asked for is above the bed by the least altitude, with the bed as it is a distance ahead
where it rises along the way over ground. Besides, the pitch keeps ḣ ≥ −V h/Δ for the height h above that altitude and
for the depth h below the shallowest, so that h stays positive (a barrier function: Ames et al. 2017,
doi 10.1109/TAC.2016.2638961). Where both cannot be, the surface is kept away from.

**Speed.** The revolutions are those whose thrust is drag(V_r) + m (V̇_r + ω e + κ ω² ∫e dt), e = V_r − V.

Integrals stand still while what they add to is at a limit and they would push on; that of the heading is bounded. The
fins' moments are reckoned with the model's numbers, whatever factors `Surroundings` puts on the vehicle.
"""

import math

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.transcendental import wrapped
from usvauv.kernels.vehicles.gains import Gain
from usvauv.kernels.vehicles.kinematics import axes, velocity_of_water
from usvauv.kernels.vehicles.numbers import Constant
from usvauv.kernels.vehicles.vehicle import Actuators, Memory, lanes, magnitude, positive

AUTHORITY = 0.7  # share of the fins' largest moment that a commanded pitch may need
LOST = 0.6  # rad, by which the heading's reference is ahead at most
TINY = 1e-6


@func
def gain(table: ti.template(), number: ti.template()) -> ti.f32:
    return table[ti.static(len(Constant.names) + number)]


@func
def clamp(value, limit) -> lanes:
    """The number nearest to a value between −limit and limit."""
    return ti.min(ti.max(value, 0.0 - limit), limit)


@func
def direction(x, y) -> lanes:
    """atan2(y, x), rad, by a polynomial with an error below 2e-6."""
    X, Y = magnitude(x), magnitude(y)
    a = ti.min(X, Y) / ti.max(ti.max(X, Y), TINY)
    a2 = a * a
    angle = a * (
        0.99997722 + a2 * (-0.33262282 + a2 * (0.19354029 + a2 * (-0.11642626 + a2 * (0.05264709 - a2 * 0.01171903))))
    )
    angle += positive(Y - X) * (0.5 * math.pi - 2.0 * angle)
    angle += positive(0.0 - x) * (math.pi - 2.0 * angle)
    return angle * (2.0 * positive(y) - 1.0)


@func
def unless(stuck, gained, pushed) -> lanes:
    """Increment of an integral in a substep: nothing where `stuck` is 1 and it has the sign of `pushed`."""
    return gained * (1.0 - stuck * positive(gained * pushed))


Steering = ti.types.struct(fin=lanes, reference=lanes, integral=lanes)
Diving = ti.types.struct(fin=lanes, depth=lanes, slope=lanes, integral=lanes)
Path = ti.types.struct(rising=lanes, lowest=lanes, highest=lanes)
Running = ti.types.struct(propeller=lanes, reference=lanes, integral=lanes)


@func
def steer(table: ti.template(), heading, rate, V, command, reference, integral, dt: ti.f32) -> Steering:
    """The rudder for a heading (rad) that changes at `rate` (rad/s)."""
    ahead = clamp(wrapped(reference - heading), LOST)
    off = wrapped(command - heading - ahead)
    bend = clamp(off * gain(table, Gain.heading_approach), gain(table, Gain.turn_curvature))
    ahead += dt * V * bend
    angle = (
        gain(table, Gain.heading_gain) * ahead
        + gain(table, Gain.heading_rate) * (bend - rate / V)
        + gain(table, Gain.turn_rudder) * bend
        + integral
    )
    integral += dt * V * gain(table, Gain.heading_integral) * ahead
    return Steering(angle, wrapped(heading + ahead), clamp(integral, 0.5 * table[Constant.fin_limit]))


@func
def dive(table: ti.template(), sine, rate, V, depth, wanted, path, last, slope, integral, dt: ti.f32) -> Diving:
    """The stern plane for a depth.

    Args:
        sine: of the pitch, which changes at `rate`.
        wanted: depth that is asked for.
        path: slopes: `rising`, at which the depth asked for rises, and between which the way may be, over V.
        last, slope, integral: the reference of the depth and its slope, and the integral.
    """
    limit = table[Constant.fin_limit]
    V2 = V * V
    righting = gain(table, Gain.righting) / V2
    authority = AUTHORITY * limit / gain(table, Gain.righting) * V2
    pitch = ti.min(authority, gain(table, Gain.pitch_limit))
    steepest = ti.min(0.8 * authority, gain(table, Gain.dive_slope))
    error = clamp(depth - last, 2.0 / gain(table, Gain.depth_ahead) * pitch)
    glide = clamp((depth - error - wanted) * gain(table, Gain.depth_approach) + path.rising, steepest)
    slope += clamp(glide - slope, dt * V * gain(table, Gain.dive_curvature))
    error += dt * V * slope
    asked = slope + gain(table, Gain.depth_ahead) * error + integral
    kept = clamp(ti.min(ti.max(asked, path.lowest), path.highest), pitch)
    angle = gain(table, Gain.pitch_gain) * (sine - kept) + gain(table, Gain.pitch_rate) * rate / V - righting * kept
    stuck = positive(magnitude(angle) - limit + 1e3 * magnitude(kept - asked))
    integral += unless(stuck, dt * V * gain(table, Gain.depth_integral) * error, asked)
    return Diving(angle, depth - error, slope, clamp(integral, 0.5 * pitch))


@func
def run(table: ti.template(), u, command, reference, integral, dt: ti.f32) -> Running:
    """The propeller's revolutions for a speed through the water ahead."""
    change = clamp(command - reference, dt * gain(table, Gain.acceleration))
    reference += change
    error = reference - u
    push = 1.0 / dt * change + gain(table, Gain.speed_frequency) * error + integral
    mass = table[Constant.mass] + table[Constant.added_surge]
    thrust = table[Constant.axial_drag] * reference * reference + mass * push
    loss = table[Constant.thrust_slope] * ti.max(u, 0.0)
    most, bollard = table[Constant.propeller_limit], table[Constant.thrust_0]
    turns = (ti.sqrt(loss * loss + 4.0 * bollard * ti.max(thrust, 0.0)) - loss) * (0.5 / bollard)
    stuck = positive(turns - most) + positive(0.0 - thrust)
    integral += unless(stuck, dt * gain(table, Gain.speed_integral) * error, thrust)
    return Running(turns, reference, integral)


@func
def control(table: ti.template(), body, memory, command, water, depth_error, dt: ti.f32):
    """Commands to the actuators in a substep, and the autopilot's memory: `Vehicle.control`."""
    axis = axes(body)
    heading = direction(axis.x.x, axis.x.y)
    level = ti.max(axis.x.x * axis.x.x + axis.x.y * axis.x.y, TINY)
    turning = (body.q * axis.y.z + body.r * axis.z.z) / level
    pitching = body.q * axis.z.z - body.r * axis.y.z  # the rate of sin θ
    V = ti.max(body.u, gain(table, Gain.slowest))
    depth = body.depth + depth_error
    fresh = 1.0 - memory.begun

    # The bed along the way over ground.
    moved = velocity_of_water(body, water)
    north = axis.x.x * body.u + axis.y.x * body.v + moved.x
    east = axis.x.y * body.u + axis.y.y * body.v + moved.y
    rising = 0.0 - (water.bed_n * north + water.bed_e * east) / V  # of the bed, over the way through the water
    bed = water.bed + water.bed_n * body.north + water.bed_e * body.east
    spare = bed - body.depth - ti.max(command.altitude, gain(table, Gain.least_altitude))
    deepest = depth + spare - ti.max(rising, 0.0) * gain(table, Gain.bed_ahead)
    shallowest = ti.min(0.5 * bed, gain(table, Gain.least_depth))
    path = Path(
        rising=rising * positive(command.depth - deepest),
        lowest=rising - spare * gain(table, Gain.clearance_ahead),
        highest=(depth - shallowest) * gain(table, Gain.clearance_ahead),
    )
    wanted = ti.max(ti.min(command.depth, deepest), shallowest)

    rudder = steer(
        table, heading, turning, V, command.heading, memory.heading + fresh * heading, memory.heading_integral, dt
    )
    stern = dive(
        table, 0.0 - axis.x.z, pitching, V, depth, wanted, path,
        memory.depth + fresh * depth, memory.pitch, memory.depth_integral, dt,
    )  # fmt: skip
    speed = run(table, body.u, command.speed, memory.speed + fresh * body.u, memory.speed_integral, dt)
    return (
        Actuators(rudder.fin, stern.fin, speed.propeller),
        Memory(
            rudder.reference, stern.depth, stern.slope, speed.reference,
            rudder.integral, stern.integral, speed.integral, fresh + memory.begun,
        ),
    )  # fmt: skip
