"""How AUVs move: with the water, at a velocity through it, and what power that takes."""

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.mission.columns import AuvColumn, BodyColumn, Draw, NodeColumn, Parameter
from usvauv.kernels.mission.worlds import normals
from usvauv.kernels.types import vec2

FASTEST = 2.5  # m/s, up to which the fitted efficiency is meant; near 3.25 m/s it falls through zero


@ti.pyfunc
def travelling_power(speed: ti.f32) -> ti.f32:
    """Electrical power while travelling at a speed through the water, W.

    F V/(−0.081 V³ + 0.215 V² − 0.01 V + 0.541) + 15 with the drag F = ½·0.7·60·V² (Zhang et al. 2024,
    doi 10.1109/JIOT.2024.3395568). The fit of the efficiency ends at `FASTEST`; beyond it has its value there, so that
    the power grows with V³ at any speed.
    """
    V = min(speed, FASTEST)
    drag = 0.5 * 0.7 * 60.0 * speed * speed
    return drag * speed / (-0.081 * V * V * V + 0.215 * V * V - 0.01 * V + 0.541) + 15.0


@ti.pyfunc
def hovering_power(speed: ti.f32) -> ti.f32:
    """Electrical power while hovering at a speed through the water, W: the travelling law, not below 90 + 15."""
    return max(travelling_power(speed), 105.0)


@func
def water_velocity(p: ti.template(), a0, a1):
    """Commanded velocity through the water of an action in [-1, 1]², m/s.

    Vector form: speed_max · a with its norm clamped into [speed_min, speed_max]; a zero action means east.
    Polar form: heading π a0, speed linear in a1.
    """
    velocity = vec2(p[Parameter.speed_min], 0.0)
    if p[Parameter.polar] > 0.5:
        share = ti.min(ti.max(0.5 * (a1 + 1.0), 0.0), 1.0)
        speed = p[Parameter.speed_min] + share * (p[Parameter.speed_max] - p[Parameter.speed_min])
        heading = 3.141592653589793 * a0
        velocity = speed * vec2(ti.cos(heading), ti.sin(heading))
    else:
        share = ti.max(1.0, ti.max(ti.abs(a0), ti.abs(a1)))  # of what is allowed; else large numbers overflow
        a = vec2(a0 / share, a1 / share)
        norm = ti.sqrt(a[0] * a[0] + a[1] * a[1])
        if norm > 1e-6:
            speed = ti.min(ti.max(norm * p[Parameter.speed_max], p[Parameter.speed_min]), p[Parameter.speed_max])
            velocity = speed / norm * a
    return velocity


@func
def target_of(worlds: ti.template(), w, k):
    """Index of the node that AUV k heads for; one that a plugin has set wrong counts as the nearest index."""
    target = ti.cast(worlds.auv[w, k, AuvColumn.target], ti.i32)
    return ti.min(ti.max(target, 0), worlds.node.shape[1] - 1)


@func
def offset_to_target(worlds: ti.template(), w, k) -> vec2:
    """True horizontal offset from AUV k to its target, m."""
    target = target_of(worlds, w, k)
    return vec2(
        worlds.node[w, target, NodeColumn.x] - worlds.auv[w, k, AuvColumn.x],
        worlds.node[w, target, NodeColumn.y] - worlds.auv[w, k, AuvColumn.y],
    )


@func
def distance_to_target(worlds: ti.template(), w, k):
    """True horizontal distance from AUV k to its target, m."""
    return offset_to_target(worlds, w, k).norm()


@func
def distance_between(worlds: ti.template(), w, j, k):
    """True distance between AUVs j and k, m: horizontal, or with vehicles that of three dimensions."""
    dx = worlds.auv[w, j, AuvColumn.x] - worlds.auv[w, k, AuvColumn.x]
    dy = worlds.auv[w, j, AuvColumn.y] - worlds.auv[w, k, AuvColumn.y]
    distance = vec2(dx, dy).norm()
    if ti.static(worlds.program.vehicle):
        dz = worlds.auv[w, j, AuvColumn.depth_error] - worlds.auv[w, k, AuvColumn.depth_error]
        distance = vec2(distance, dz).norm()
    return distance


@func
def move_to(worlds: ti.template(), w, k, place: vec2, water: vec2):
    """Put AUV k at a place in the area (m), which its velocity `water` through the water (m/s) took it to."""
    auv = ti.static(worlds.auv)
    for axis in ti.static(range(2)):
        auv[w, k, AuvColumn.moved_x + axis] = place[axis] - auv[w, k, AuvColumn.x + axis]
        auv[w, k, AuvColumn.x + axis] = place[axis]
        auv[w, k, AuvColumn.water_x + axis] = water[axis]


@func
def hold(worlds: ti.template(), w, k, wanted: vec2):
    """Let AUV k hover for one step: move over ground at the velocity `wanted`, m/s, as far as its thrust goes.

    The thrust gives any velocity through the water up to `speed_max`. The current carries the AUV with what that leaves
    of it, along the border where it would carry it across.
    """
    p = ti.static(worlds.p)
    auv = ti.static(worlds.auv)
    here = vec2(auv[w, k, AuvColumn.x], auv[w, k, AuvColumn.y])
    current = vec2(auv[w, k, AuvColumn.current_x], auv[w, k, AuvColumn.current_y])
    velocity = wanted - current
    speed = velocity.norm()
    if speed > p[Parameter.speed_max]:
        velocity *= p[Parameter.speed_max] / speed
    auv[w, k, AuvColumn.power] = hovering_power(velocity.norm())
    auv[w, k, AuvColumn.velocity_x] = velocity[0]
    auv[w, k, AuvColumn.velocity_y] = velocity[1]
    place = here + p[Parameter.step] * (velocity + current)
    place = vec2(
        ti.min(ti.max(place[0], 0.0), p[Parameter.width]),
        ti.min(ti.max(place[1], 0.0), p[Parameter.length]),
    )
    moved = place - here
    water = vec2(0.0)
    if moved.norm_sqr() > 0.0:
        water = moved / p[Parameter.step] - current
    move_to(worlds, w, k, place, water)


@func
def drifted(worlds: ti.template(), w, k) -> ti.f32:
    """1 where AUV k has moved over ground in this step; 0 where it has held its place, which it senses."""
    moved = vec2(worlds.auv[w, k, AuvColumn.moved_x], worlds.auv[w, k, AuvColumn.moved_y])
    return ti.select(moved.norm_sqr() > 0.0, 1.0, 0.0)


@func
def respond(worlds: ti.template(), w, k, commanded: vec2) -> vec2:
    """Mean velocity of AUV k through the water in this step, m/s, under a velocity that it is commanded.

    Its velocity follows the command with the lag τ and has a Gauss–Markov error of that memory,

        v(t + Δt) = c + (v − c) e^{−Δt/τ} + noise,   mean over Δt: c + (v − c) (τ/Δt) (1 − e^{−Δt/τ}) + noise,

    the noise of both jointly normal, exact for any Δt (as in `navigation`). With τ = 0 it is the command.
    """
    p = ti.static(worlds.p)
    auv = ti.static(worlds.auv)
    apart = vec2(auv[w, k, AuvColumn.velocity_x], auv[w, k, AuvColumn.velocity_y]) - commanded
    end = commanded + p[Parameter.speed_memory] * apart
    mean = commanded + p[Parameter.speed_share] * apart
    if p[Parameter.speed_noise] > 0.0:
        noise = normals(worlds, w, Draw.speed, k)
        shared = vec2(noise[0], noise[1])
        end += p[Parameter.speed_noise] * shared
        mean += p[Parameter.speed_noise_mean] * shared + p[Parameter.speed_noise_rest] * vec2(noise[2], noise[3])
    auv[w, k, AuvColumn.velocity_x] = end[0]
    auv[w, k, AuvColumn.velocity_y] = end[1]
    return mean


@func
def renew_depth_error(worlds: ti.template(), w, k):
    """The error with which AUV k keeps its depth, or of a vehicle's depth sensor: a Gauss–Markov process, in its
    stationary state from the start.
    """
    p = ti.static(worlds.p)
    if p[Parameter.depth_noise] > 0.0:
        memory = p[Parameter.depth_memory]
        if worlds.clock[w, 1] == 0:
            memory = 0.0
        new = p[Parameter.depth_noise] * ti.sqrt(1.0 - memory * memory)
        noise = normals(worlds, w, Draw.depth, k)
        if ti.static(worlds.program.vehicle):
            error = memory * worlds.body[w, k, BodyColumn.sensor_error] + new * noise[0]
            worlds.body[w, k, BodyColumn.sensor_error] = error
        else:
            error = memory * worlds.auv[w, k, AuvColumn.depth_error] + new * noise[0]
            worlds.auv[w, k, AuvColumn.depth_error] = error


@func
def travel(worlds: ti.template(), w, k, a0, a1):
    """Move AUV k for one step as its action commands and with the water; where that crosses the border it hovers.

    A vehicle with dynamics has moved already (`usvauv.kernels.mission.vehicles`), and is stopped at the border.
    """
    if ti.static(worlds.program.vehicle):
        arrive(worlds, w, k)
    else:
        go(worlds, w, k, a0, a1)


@func
def arrive(worlds: ti.template(), w, k):
    """Take over where the vehicle of AUV k is after this step; at the border it is stopped."""
    p = ti.static(worlds.p)
    auv = ti.static(worlds.auv)
    body = ti.static(worlds.body)
    here = vec2(auv[w, k, AuvColumn.x], auv[w, k, AuvColumn.y])
    way = vec2(body[w, k, BodyColumn.way_x], body[w, k, BodyColumn.way_y])
    water = vec2(body[w, k, BodyColumn.water_x], body[w, k, BodyColumn.water_y])
    place = here + way
    inside = vec2(
        ti.min(ti.max(place[0], 0.0), p[Parameter.width]),
        ti.min(ti.max(place[1], 0.0), p[Parameter.length]),
    )
    if inside[0] != place[0] or inside[1] != place[1]:
        auv[w, k, AuvColumn.border] = 1.0
        water += (inside - place) / p[Parameter.step]
    auv[w, k, AuvColumn.power] = body[w, k, BodyColumn.power]
    auv[w, k, AuvColumn.velocity_x] = water[0]
    auv[w, k, AuvColumn.velocity_y] = water[1]
    auv[w, k, AuvColumn.depth_error] = body[w, k, BodyColumn.depth] - p[Parameter.cruise]
    move_to(worlds, w, k, inside, water)


@func
def go(worlds: ti.template(), w, k, a0, a1):
    """Move AUV k, a point, for one step as its action commands and with the water; at the border it hovers."""
    p = ti.static(worlds.p)
    auv = ti.static(worlds.auv)
    velocity = respond(worlds, w, k, water_velocity(p, a0, a1))
    current = vec2(auv[w, k, AuvColumn.current_x], auv[w, k, AuvColumn.current_y])
    place = vec2(auv[w, k, AuvColumn.x], auv[w, k, AuvColumn.y]) + p[Parameter.step] * (velocity + current)
    inside = place[0] >= 0.0 and place[0] <= p[Parameter.width]
    inside = inside and place[1] >= 0.0 and place[1] <= p[Parameter.length]
    if inside:
        auv[w, k, AuvColumn.power] = travelling_power(velocity.norm())
        move_to(worlds, w, k, place, velocity)
    else:
        auv[w, k, AuvColumn.border] = 1.0
        hold(worlds, w, k, vec2(0.0))


@func
def clear_last_step(worlds: ti.template(), w, k):
    """Clear what AUV k did in the step before."""
    auv = ti.static(worlds.auv)
    auv[w, k, AuvColumn.moved_x] = 0.0
    auv[w, k, AuvColumn.moved_y] = 0.0
    auv[w, k, AuvColumn.border] = 0.0
    auv[w, k, AuvColumn.service_rate] = 0.0
    auv[w, k, AuvColumn.delivered] = 0.0
    auv[w, k, AuvColumn.packets_delivered] = 0.0
    auv[w, k, AuvColumn.hovering] = 0.0
