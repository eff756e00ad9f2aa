"""Attitude of LANES vehicles, and the water's velocity at their positions."""

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.vehicles.vehicle import lanes

Triple = ti.types.struct(x=lanes, y=lanes, z=lanes)
Attitude = ti.types.struct(x=Triple, y=Triple, z=Triple)


@func
def dot(a, b) -> lanes:
    return a.x * b.x + a.y * b.y + a.z * b.z


@func
def axes(body) -> Attitude:
    """The body's axes in north, east, down: columns of R."""
    q0, q1, q2, q3 = body.q0, body.q1, body.q2, body.q3
    return Attitude(
        x=Triple(1.0 - 2.0 * (q2 * q2 + q3 * q3), 2.0 * (q1 * q2 + q0 * q3), 2.0 * (q1 * q3 - q0 * q2)),
        y=Triple(2.0 * (q1 * q2 - q0 * q3), 1.0 - 2.0 * (q1 * q1 + q3 * q3), 2.0 * (q2 * q3 + q0 * q1)),
        z=Triple(2.0 * (q1 * q3 + q0 * q2), 2.0 * (q2 * q3 - q0 * q1), 1.0 - 2.0 * (q1 * q1 + q2 * q2)),
    )


@func
def gradient(water, a) -> Triple:
    """G a, with a in north, east, down."""
    return Triple(
        water.nn * a.x + water.ne * a.y + water.nd * a.z,
        water.en * a.x + water.ee * a.y + water.ed * a.z,
        water.dn * a.x + water.de * a.y + water.dd * a.z,
    )


@func
def gradient_transposed(water, a) -> Triple:
    """Gᵀ a."""
    return Triple(
        water.nn * a.x + water.en * a.y + water.dn * a.z,
        water.ne * a.x + water.ee * a.y + water.de * a.z,
        water.nd * a.x + water.ed * a.y + water.dd * a.z,
    )


@func
def velocity_of_water(body, water) -> Triple:
    """V at the vehicle, north, east, down, m/s."""
    moved = gradient(water, Triple(body.north, body.east, body.depth - water.depth))
    return Triple(
        water.north + moved.x + body.time * water.rate_n,
        water.east + moved.y + body.time * water.rate_e,
        water.down + moved.z + body.time * water.rate_d,
    )
