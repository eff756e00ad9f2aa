"""A vehicle: turns of a least radius, and speed and depth that follow with a lag.

usvauv eval extreme --plugin examples/plugins/vehicle.py --set auv.model=dubins --set nodes.service=passing
"""

import numpy as np
import taichi as ti

from usvauv.extend.vehicle import LANES, Actuators, Body, Quantity, Vehicle, positive, vehicles, velocity_of_water

NUMBERS = {
    "radius": Quantity(10.0, 1, 1000, "least radius of turns, m"),
    "slope": Quantity(0.3, 0.01, 1, "steepest way up and down, m of depth a metre"),
    "lag": Quantity(3.0, 0.1, 100, "time in which the speed follows, s"),
    "drag": Quantity(4.0, 0, 1000, "power over the speed cubed, W s³/m³"),
    "hotel": Quantity(15.0, 0, 1000, "power of all else, W"),
}
RADIUS, SLOPE, LAG, DRAG, HOTEL = range(len(NUMBERS))


def table_of(numbers):
    return np.array([numbers[name] for name in NUMBERS], np.float32)


@ti.func
def clamp(x):
    return ti.min(ti.max(x, -1.0), 1.0)


@ti.func
def advance(table: ti.template(), body, actuators, water, dt: ti.f32):
    body.rudder, body.stern, body.propeller = actuators.rudder, actuators.stern, actuators.propeller
    body.u += dt / table[LAG] * (body.propeller - body.u)
    body.r = body.u * body.rudder / table[RADIUS]
    q0 = body.q0 - 0.5 * dt * body.r * body.q3
    q3 = body.q3 + 0.5 * dt * body.r * body.q0
    length = ti.sqrt(q0 * q0 + q3 * q3)
    body.q0, body.q3 = q0 / length, q3 / length
    moved = velocity_of_water(body, water)
    body.north += dt * (body.u * (body.q0 * body.q0 - body.q3 * body.q3) + moved.x)
    body.east += dt * (body.u * 2.0 * body.q0 * body.q3 + moved.y)
    body.depth += dt * (body.u * body.stern * table[SLOPE] + moved.z)
    bed = water.bed + water.bed_n * body.north + water.bed_e * body.east
    body.grounded = ti.max(body.grounded, positive(body.depth - bed))
    body.surfaced = ti.max(body.surfaced, positive(0.0 - body.depth))
    body.depth = ti.max(ti.min(body.depth, bed), 0.0)
    body.energy += dt * (table[HOTEL] + table[DRAG] * water.drag * body.u * body.u * body.u)
    body.time += dt
    return body


@ti.func
def control(table: ti.template(), body, memory, command, water, depth_error, dt: ti.f32):
    north, east = body.q0 * body.q0 - body.q3 * body.q3, 2.0 * body.q0 * body.q3
    cos, sin = command.heading, command.heading
    for lane in ti.static(range(LANES)):
        cos[lane] = ti.cos(command.heading[lane])
        sin[lane] = ti.sin(command.heading[lane])
    ahead, aside = north * cos + east * sin, north * sin - east * cos  # cosine and sine of the angle that is left
    rudder = aside + (1.0 - positive(ahead)) * (2.0 * positive(aside) - 1.0 - aside)
    bed = water.bed + water.bed_n * body.north + water.bed_e * body.east
    wanted = ti.max(ti.min(command.depth, bed - command.altitude), 1.0)
    stern = clamp(0.1 * (wanted - body.depth - depth_error))
    return Actuators(rudder, stern, command.speed), memory


@ti.func
def trim(table: ti.template(), speed, depth, heading):
    q0, q3 = heading, heading
    for lane in ti.static(range(LANES)):
        q0[lane] = ti.cos(0.5 * heading[lane])
        q3[lane] = ti.sin(0.5 * heading[lane])
    return Body(depth=depth, q0=q0, q3=q3, u=speed, propeller=speed)


@ti.func
def drive(table: ti.template(), rudder, stern, propeller):
    return Actuators(rudder, stern, 2.5 * propeller)


def substep(numbers, variation):
    return min(0.2, 0.5 * numbers["lag"])


vehicles.register("dubins", Vehicle(NUMBERS, table_of, advance, control, trim, drive, substep, turning=10.0))
