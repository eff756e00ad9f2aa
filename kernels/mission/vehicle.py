"""The AUV as a vehicle: what it pays for moving and holding, and what an action commands."""

import taichi as ti

from usvauv.kernels.mission.columns import Parameter
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
def hovering_power(current_speed: ti.f32) -> ti.f32:
    """Power while holding position against a current, W: the travelling law at that speed, not below 90 + 15.

    Against a current above `FASTEST` it is that at `FASTEST`: the thrusters give no more.
    """
    return max(travelling_power(min(current_speed, FASTEST)), 105.0)


@ti.func
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
