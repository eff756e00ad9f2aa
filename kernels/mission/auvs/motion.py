"""Motion of AUVs with the water and through it, and its power."""

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.limits import FASTEST
from usvauv.kernels.mission.columns import (
    AuvColumn,
    Draw,
)
from usvauv.kernels.mission.draws import normals
from usvauv.kernels.types import vec2


@ti.pyfunc
def travelling_power(auv: ti.template(), speed: ti.f32) -> ti.f32:
    """Electrical power of a point while travelling at a speed through the water, W.

    Its `hotel` + `drag` V³/`efficiency`. Without a `drag` the law of the paper, F V/(−0.081 V³ + 0.215 V² − 0.01 V +
    0.541) + 15 with the drag F = ½·0.7·60·V² (Zhang et al. 2024, doi 10.1109/JIOT.2024.3395568). The fit of the
    efficiency ends at `FASTEST`; beyond it has its value there, so that the power grows with V³ at any speed.

    Args:
        auv: has the numbers `drag`, `efficiency` and `hotel` of the scenario's section `auv`.
    """
    V = min(speed, FASTEST)
    drag = 0.5 * 0.7 * 60.0 * speed * speed
    power = drag * speed / (-0.081 * V * V * V + 0.215 * V * V - 0.01 * V + 0.541) + 15.0
    if auv.drag > 0.0:
        power = auv.hotel + auv.drag * speed * speed * speed / auv.efficiency
    return power


@ti.pyfunc
def hovering_power(auv: ti.template(), speed: ti.f32) -> ti.f32:
    """Electrical power while hovering at a speed through the water, W: that of travelling.

    An AUV with a `drag` so needs its `hotel` load in still water, and in a current what it takes to stem it; one with
    the law of the paper not less than 90 + 15.
    """
    power = travelling_power(auv, speed)
    if auv.drag == 0.0:
        power = max(power, 105.0)
    return power


@func
def water_velocity(p: ti.template(), a0, a1):
    """Commanded velocity through the water of an action in [-1, 1]², m/s: speed_max · a, its norm clamped into
    [speed_min, speed_max]; a zero action means east.
    """
    velocity = vec2(p.speed_min, 0.0)
    share = ti.max(1.0, ti.max(ti.abs(a0), ti.abs(a1)))  # of what is allowed; else large numbers overflow
    a = vec2(a0 / share, a1 / share)
    norm = ti.sqrt(a[0] * a[0] + a[1] * a[1])
    if norm > 1e-6:
        speed = ti.min(ti.max(norm * p.speed_max, p.speed_min), p.speed_max)
        velocity = speed / norm * a
    return velocity


@func
def target_of(worlds: ti.template(), w, k):
    """Index of the node that AUV k heads for; one that a plugin has set wrong counts as the nearest index."""
    target = ti.cast(worlds.auv.target[w, k], ti.i32)
    return ti.min(ti.max(target, 0), worlds.node.shape[1] - 1)


@func
def check_target(worlds: ti.template(), w, k):
    """Set `fault` where AUV k's target is no node's index."""
    if ti.cast(target_of(worlds, w, k), ti.f32) != worlds.auv.target[w, k]:
        worlds.fault[0] = ti.max(worlds.fault[0], 1)  # read, or a Vulkan device does not get what it has not written


@func
def offset_to_target(worlds: ti.template(), w, k) -> vec2:
    """True horizontal offset from AUV k to its target, m."""
    target = target_of(worlds, w, k)
    return vec2(
        worlds.node.x[w, target] - worlds.auv.x[w, k],
        worlds.node.y[w, target] - worlds.auv.y[w, k],
    )


@func
def distance_to_target(worlds: ti.template(), w, k):
    """True horizontal distance from AUV k to its target, m."""
    return offset_to_target(worlds, w, k).norm()


@func
def distance_between(worlds: ti.template(), w, j, k):
    """True distance between AUVs j and k, m: horizontal, or with vehicles that of three dimensions."""
    dx = worlds.auv.x[w, j] - worlds.auv.x[w, k]
    dy = worlds.auv.y[w, j] - worlds.auv.y[w, k]
    distance = vec2(dx, dy).norm()
    if ti.static(worlds.program.vehicle):
        dz = worlds.auv.depth_error[w, j] - worlds.auv.depth_error[w, k]
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
    here = vec2(auv.x[w, k], auv.y[w, k])
    current = vec2(auv.current_x[w, k], auv.current_y[w, k])
    velocity = wanted - current
    speed = velocity.norm()
    if speed > p.speed_max:
        velocity *= p.speed_max / speed
    auv.power[w, k] = hovering_power(p, velocity.norm())
    auv.velocity_x[w, k] = velocity[0]
    auv.velocity_y[w, k] = velocity[1]
    place = here + p.step * (velocity + current)
    place = vec2(
        ti.min(ti.max(place[0], 0.0), p.width),
        ti.min(ti.max(place[1], 0.0), p.length),
    )
    moved = place - here
    water = vec2(0.0)
    if moved.norm_sqr() > 0.0:
        water = moved / p.step - current
    move_to(worlds, w, k, place, water)


@func
def drifted(worlds: ti.template(), w, k) -> ti.f32:
    """1 where AUV k has moved over ground in this step; 0 where it has held its place, which it senses."""
    moved = vec2(worlds.auv.moved_x[w, k], worlds.auv.moved_y[w, k])
    return ti.select(moved.norm_sqr() > 0.0, 1.0, 0.0)


@func
def respond(worlds: ti.template(), w, k, commanded: vec2) -> vec2:
    """Mean velocity of AUV k through the water in this step, m/s, under a velocity that it is commanded.

    Its velocity follows the command with the lag τ and has a Gauss–Markov error of that memory,

        v(t + Δt) = c + (v − c) e^{−Δt/τ} + noise,   mean over Δt: c + (v − c) (τ/Δt) (1 − e^{−Δt/τ}) + noise,

    the noise of both jointly normal, exact for any Δt (Gelb). With τ = 0 it is the command.
    """
    p = ti.static(worlds.p)
    auv = ti.static(worlds.auv)
    apart = vec2(auv.velocity_x[w, k], auv.velocity_y[w, k]) - commanded
    end = commanded + p.speed_memory * apart
    mean = commanded + p.speed_share * apart
    if p.speed_noise > 0.0:
        noise = normals(worlds, w, Draw.speed, k)
        shared = vec2(noise[0], noise[1])
        end += p.speed_noise * shared
        mean += p.speed_noise_mean * shared + p.speed_noise_rest * vec2(noise[2], noise[3])
    auv.velocity_x[w, k] = end[0]
    auv.velocity_y[w, k] = end[1]
    return mean


@func
def is_spent(worlds: ti.template(), w, k) -> bool:
    """Whether the battery of AUV k is spent: it moves by itself no more, serves no node and does not reply."""
    spent = False
    if ti.static(worlds.program.battery):
        spent = worlds.auv.charge[w, k] == 0.0
    return spent


@func
def discharge(worlds: ti.template(), w, k):
    """Take the energy of this step from the battery of AUV k; when it is spent a service under way ends."""
    auv = ti.static(worlds.auv)
    auv.charge[w, k] = ti.max(auv.charge[w, k] - auv.power[w, k] * worlds.p.step / 3600.0, 0.0)
    if is_spent(worlds, w, k):
        auv.hover[w, k] = 0.0
        auv.cargo[w, k] = 0.0


@func
def renew_depth_error(worlds: ti.template(), w, k):
    """The error with which AUV k keeps its depth, or of a vehicle's depth sensor: a Gauss–Markov process, in its
    stationary state from the start.
    """
    p = ti.static(worlds.p)
    if p.depth_noise > 0.0:
        memory = p.depth_memory
        if worlds.clock[w, 1] == 0:
            memory = 0.0
        new = p.depth_noise * ti.sqrt(1.0 - memory * memory)
        noise = normals(worlds, w, Draw.depth, k)
        if ti.static(worlds.program.vehicle):
            error = memory * worlds.body.sensor_error[w, k] + new * noise[0]
            worlds.body.sensor_error[w, k] = error
        else:
            error = memory * worlds.auv.depth_error[w, k] + new * noise[0]
            worlds.auv.depth_error[w, k] = error


@func
def travel(worlds: ti.template(), w, k, a0, a1):
    """Move AUV k for one step as its action commands and with the water; where that crosses the border it hovers.

    A point whose battery is spent drifts with the water, along the border where that would carry it across. A vehicle
    with dynamics has moved already (`usvauv.kernels.mission.auvs.vehicles`), and is stopped at the border.
    """
    if ti.static(worlds.program.vehicle):
        arrive(worlds, w, k)
    elif is_spent(worlds, w, k):
        hold(worlds, w, k, vec2(worlds.auv.current_x[w, k], worlds.auv.current_y[w, k]))  # which takes no thrust
        worlds.auv.power[w, k] = 0.0
    else:
        go(worlds, w, k, a0, a1)


@func
def arrive(worlds: ti.template(), w, k):
    """Take over where the vehicle of AUV k is after this step; at the border it is stopped."""
    p = ti.static(worlds.p)
    auv = ti.static(worlds.auv)
    body = ti.static(worlds.body)
    here = vec2(auv.x[w, k], auv.y[w, k])
    way = vec2(body.way_x[w, k], body.way_y[w, k])
    water = vec2(body.water_x[w, k], body.water_y[w, k])
    place = here + way
    inside = vec2(
        ti.min(ti.max(place[0], 0.0), p.width),
        ti.min(ti.max(place[1], 0.0), p.length),
    )
    if inside[0] != place[0] or inside[1] != place[1]:
        auv.border[w, k] = 1.0
        water += (inside - place) / p.step
    auv.power[w, k] = body.power[w, k]
    auv.velocity_x[w, k] = water[0]
    auv.velocity_y[w, k] = water[1]
    auv.depth_error[w, k] = body.depth[w, k] - p.cruise
    move_to(worlds, w, k, inside, water)


@func
def go(worlds: ti.template(), w, k, a0, a1):
    """Move AUV k, a point, for one step as its action commands and with the water; at the border it hovers."""
    p = ti.static(worlds.p)
    auv = ti.static(worlds.auv)
    velocity = respond(worlds, w, k, water_velocity(p, a0, a1))
    current = vec2(auv.current_x[w, k], auv.current_y[w, k])
    place = vec2(auv.x[w, k], auv.y[w, k]) + p.step * (velocity + current)
    inside = place[0] >= 0.0 and place[0] <= p.width
    inside = inside and place[1] >= 0.0 and place[1] <= p.length
    if inside:
        auv.power[w, k] = travelling_power(p, velocity.norm())
        move_to(worlds, w, k, place, velocity)
    else:
        auv.border[w, k] = 1.0
        hold(worlds, w, k, vec2(0.0))


@func
def clear_last_step(worlds: ti.template(), w, k):
    """Clear what AUV k did in the step before."""
    auv = ti.static(worlds.auv)
    auv.moved_x[w, k] = 0.0
    auv.moved_y[w, k] = 0.0
    auv.border[w, k] = 0.0
    auv.service_rate[w, k] = 0.0
    auv.delivered[w, k] = 0.0
    auv.packets_delivered[w, k] = 0.0
    auv.hovering[w, k] = 0.0
