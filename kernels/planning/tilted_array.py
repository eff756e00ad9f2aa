"""Covariance and information of one AUV's horizontal position from a tilted array, to first order.

Pitch and roll follow from the surface's slope (`usbl.attitude`) and are measured with the error ε. Two measurements:

- FIX, phases and slant range: `usbl.horizontal_covariance` and `systematic_covariance`, and the inverse of their sum.
- PHASE, the two phase differences at a known vertical separation z. With r the offset, d its horizontal part, q = |r|²
  and b = A r in the array's frame, the phases are κ (b_x, b_y)/√q, so

      H_ij = ∂(b_i/√q)/∂d_j = (A_ij − b_i r_j/q)/√q,
      R = σ²/κ² I + (ε² + ε_a²)/q Σ (∂b/∂angle)(∂b/∂angle)ᵀ + (σ_c/c)² b bᵀ/q + H C_p Hᵀ,
      J = Hᵀ R⁻¹ H,   C = H⁻¹ R H⁻ᵀ,

  with ε_a of the alignment, C_p of `usbl.placement_covariance`, and |det H| = |z b_z|/q²: the solid angle that an area
  on the bed has, and that of the projected directions.

For a level array C is that of `usvauv.kernels.planning.fisher`, with the range error for FIX and systematic errors
added. The planner itself supposes a level array, since the tilt at a place the boat is yet to reach is unknown.
"""

import taichi as ti
import torch

from usvauv.kernels.planning.fisher import PHASE
from usvauv.kernels.positioning import acoustic_link, usbl
from usvauv.kernels.types import array2, index1, mat2, vec2, vec3


@ti.func
def packed(M: mat2) -> vec3:
    """(xx, xy, yy) of a symmetric matrix."""
    return vec3(M[0, 0], M[0, 1], M[1, 1])


@ti.func
def phase_jacobian(offset: vec3, slope: vec2) -> mat2:
    """H: derivatives of the two direction cosines in the array's frame by the AUV's x and y, 1/m."""
    axes = usbl.array_axes(usbl.attitude(slope))
    body = axes @ offset
    q = offset.norm_sqr()
    bx = body[0] / q
    by = body[1] / q
    rows = mat2(
        [
            [axes[0, 0] - bx * offset[0], axes[0, 1] - bx * offset[1]],
            [axes[1, 0] - by * offset[0], axes[1, 1] - by * offset[1]],
        ]
    )
    return rows / ti.sqrt(q)


@ti.func
def phase_noise(link: ti.template(), k, offset: vec3, slope: vec2) -> mat2:
    """R: covariance of the two direction cosines by phase noise, attitude error and systematic errors."""
    angles = usbl.attitude(slope)
    axes = usbl.array_axes(angles)
    body = axes @ offset
    q = offset.norm_sqr()
    loss = acoustic_link.further_loss(link, k, offset, 0.0)
    deviation = acoustic_link.phase_deviation(link, k, ti.sqrt(q), loss) / link[k, acoustic_link.KAPPA]
    by_pitch = vec2(axes[0, 0] * offset[2] - axes[0, 2] * offset[0], -ti.sin(angles[1]) * body[0])
    by_roll = vec2(0.0, body[2])
    cosines = vec2(body[0], body[1]) / ti.sqrt(q)
    H = phase_jacobian(offset, slope)
    common = usbl.placement_covariance(link, k, offset)
    turning = link[k, acoustic_link.ATTITUDE] + link[k, acoustic_link.ALIGNMENT]
    noise = deviation * deviation * mat2([[1.0, 0.0], [0.0, 1.0]])
    noise += turning / q * (by_pitch.outer_product(by_pitch) + by_roll.outer_product(by_roll))
    noise += link[k, acoustic_link.SOUND_SPEED] * cosines.outer_product(cosines)
    return noise + H @ mat2([[common[0], common[1]], [common[1], common[2]]]) @ H.transpose()


@ti.func
def covariance(link: ti.template(), k, measurement, offset: vec3, slope: vec2) -> vec3:
    """Covariance (xx, xy, yy) of the position of AUV k, m².

    Args:
        link: (K, COLUMNS) of `acoustic_link.link_table`; the attitude error is that of the planner.
        measurement: `fisher.PHASE` or `fisher.FIX`.
        offset: AUV minus boat, m; below the boat z is negative.
        slope: surface slopes (∂η/∂x, ∂η/∂y) under the boat. The AUV must not lie in the array's plane, and for PHASE
            not at its height either.
    """
    C = vec3(0.0, 0.0, 0.0)
    if measurement == PHASE:
        H = phase_jacobian(offset, slope)
        adjugate = mat2([[H[1, 1], -H[0, 1]], [-H[1, 0], H[0, 0]]])
        q = offset.norm_sqr()
        # From the geometry: the determinant of H cancels far from the nadir.
        determinant = offset[2] * (usbl.array_axes(usbl.attitude(slope)) @ offset)[2] / (q * q)
        root = adjugate / determinant
        C = packed(root @ phase_noise(link, k, offset, slope) @ root.transpose())
    else:
        loss = acoustic_link.further_loss(link, k, offset, 0.0)
        sigma = acoustic_link.phase_deviation(link, k, offset.norm(), loss)
        axes = usbl.array_axes(usbl.attitude(slope))
        C = usbl.horizontal_covariance(link, k, offset, axes, sigma)
        C += usbl.systematic_covariance(link, k, offset, axes)
    return C


@ti.func
def information(link: ti.template(), k, measurement, offset: vec3, slope: vec2) -> vec3:
    """J = (J11, J12, J22) of AUV k, 1/m²; arguments as `covariance`."""
    J = vec3(0.0, 0.0, 0.0)
    if measurement == PHASE:
        H = phase_jacobian(offset, slope)
        J = packed(H.transpose() @ phase_noise(link, k, offset, slope).inverse() @ H)
    else:
        C = covariance(link, k, measurement, offset, slope)
        J = vec3(C[2], -C[1], C[0]) / (C[0] * C[2] - C[1] * C[1])
    return J


@ti.kernel
def _batch(
    link: array2,
    auv: index1,
    measurement: ti.i32,
    offset: array2,
    slope: array2,
    variance: array2,
    J: array2,
    cosines: array2,
):
    for i in range(offset.shape[0]):
        r = vec3(offset[i, 0], offset[i, 1], offset[i, 2])
        s = vec2(slope[i, 0], slope[i, 1])
        C = covariance(link, auv[i], measurement, r, s)
        j = information(link, auv[i], measurement, r, s)
        for m in ti.static(range(3)):
            variance[i, m] = C[m]
            J[i, m] = j[m]
        body = usbl.array_axes(usbl.attitude(s)) @ r / r.norm()
        for m in ti.static(range(2)):
            cosines[i, m] = body[m]


def predict_batch(
    link: torch.Tensor, auv: torch.Tensor, offset: torch.Tensor, slope: torch.Tensor, *, measurement: int
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """`covariance` and `information` for many positions, and their directions from the array.

    Args:
        link: (K, COLUMNS) float32.
        auv: (n,) int32, row of the table for each.
        offset, slope: (n, 3) m and (n, 2), float32.
        measurement: `fisher.PHASE` or `fisher.FIX`.

    Returns:
        (n, 3) covariance, m², (n, 3) information, 1/m², and (n, 2) direction cosines in the array's frame. Covariance
        and information are each accurate in their larger eigenvalue; where these are far apart, as for PHASE far from
        the nadir, take the smaller one from the other matrix.
    """
    variance, J, cosines = (offset.new_empty((offset.shape[0], columns)) for columns in (3, 3, 2))
    _batch(link, auv, measurement, offset, slope, variance, J, cosines)
    return variance, J, cosines
