"""Reconstruction and flux of the nonlinear shallow-water equations at the faces of a grid, and ghosts.

The functions of faces take whole vectors of cells and have no branches. Each is its own mirror image to the last bit:
exchange left and right and change the sign of the normal velocities, and the results are exchanged and change sign
likewise. So a symmetric flow stays symmetric.

Cells, half slopes and states at a face are structs of the surface `eta` (m), depth `h` (m), velocity `u` normal to the
face and `v` along it (m/s); a cell also has the bed `b` (m) and the water over that of the still sea,
D = h − max(−b, 0) (m). A state at a face also has `most`, the mass flux with which the cell may lose its share of water
through this face in the step (m²/s).
"""

from collections import namedtuple

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.types import vec2

WALL, RADIATING, FORCED, INCIDENT = range(4)  # kinds of boundaries

# A ghost beyond a boundary: indices of the ghost and of the first and second cell inside (of the bed, less
# `bed_offset`); offsets of the velocities across and along the boundary; cells beyond the boundary (1 or 2), the sign
# of leaving water, and the length of the sweep over the size of a cell.
Ghost = namedtuple("Ghost", "at first second across along bed_offset layer outward r")

TINY = 1e-30  # makes 0/0 a 0
SMOOTH = 0.2  # second difference of the bed over depth up to which a bed is curved and does not jump


@func
def half_slope(below, above, theta):
    """Half the limited slope of a cell, from its differences to the neighbours below and above it.

    The generalised minmod limiter: with theta = 1 the monotonised-central one (van Leer 1977,
    doi 10.1016/0021-9991(77)90095-X), which takes a face at most to the value of the neighbour, with ½ plain minmod,
    which takes it at most half the way.
    """
    zero = 0.0 * below
    mean = 0.25 * (below + above)
    rising = ti.max(ti.min(theta * ti.min(below, above), mean), zero)
    falling = ti.min(ti.max(theta * ti.max(below, above), mean), zero)
    return rising + falling


@func
def half_slopes(below, here, above, dry: ti.f32, r: ti.f32, g: ti.f32):
    """Half slopes of surface, depth and velocities in the middle one of three cells.

    The slope of depth is that of the surface less that of the bed, limited so that depth stays positive at both faces:
    it may be linear down to the shore, and the surface of water at rest stays flat.

    Where one of the three surfaces is below one of the three beds (the cell is not *flooded*), surface and bed are
    taken with minmod and velocity as constant, so that water accelerates only towards a face through which it can
    leave. With steeper slopes a face may shut while gravity still accelerates the water, and puddles on rough ground
    gain speed without end.

    In flooded cells the limiter is as sharp as half a step with the Courant number ν of the cell allows: theta =
    1/max(ν, 1 − ν), the bound of a total variation that does not grow (Roe 1985, in Lectures in Applied Mathematics 22;
    there for the two neighbours apart). What the flow along the face carries is not moved by waves: theta = 1.

    Args:
        below, here, above: the cells.
        dry: depth below which water does not move, m.
        r: time step over the size of the cell, s/m.
        g: gravity, m/s².

    Returns:
        half slopes `eta`, `h`, `u` and `v`; whether the cell is `flooded`, 1 or 0; mean `passage` of the depths through
        which water passes its two faces, and half their difference, `widening`. These are h and its half slope where
        the bed is smooth; where it jumps the higher bed counts, as in `flux`.
    """
    zero = 0.0 * here.D
    one = 1.0 + zero
    lowest = ti.min(ti.min(below.eta, above.eta), here.eta)
    highest = ti.max(ti.max(below.b, above.b), here.b)
    flooded = ti.select(lowest > highest + dry, one, zero)
    courant = ti.min(r * (ti.max(here.u, zero - here.u) + ti.sqrt(g * here.h)), one)
    theta = ti.select(flooded > zero, 1.0 / ti.max(courant, one - courant), 0.5 + zero)
    moves = ti.select(here.h > dry + zero, one, zero)
    eta = moves * half_slope(here.eta - below.eta, above.eta - here.eta, theta)
    bed = half_slope(here.b - below.b, above.b - here.b, theta)
    depth = ti.max(ti.min(eta - bed, here.h), zero - here.h)
    bend = 0.5 * ti.max(ti.min(above.b + below.b - 2.0 * here.b, SMOOTH * here.h), zero)
    passage_above = ti.max((here.eta + eta) - ti.max(here.b + bed, above.b - bed - bend), zero)
    passage_below = ti.max((here.eta - eta) - ti.max(here.b - bed, below.b + bed - bend), zero)
    passage = ti.min(0.5 * (passage_above + passage_below), here.h)
    widening = ti.max(ti.min(0.5 * (passage_above - passage_below), here.h), zero - here.h)
    u = flooded * half_slope(here.u - below.u, above.u - here.u, theta)
    v = flooded * half_slope(here.v - below.v, above.v - here.v, one)
    return ti.Struct(eta=eta, h=depth, u=u, v=v, flooded=flooded, passage=passage, widening=widening)


@func
def half_step(cell, half, r: ti.f32, g: ti.f32):
    """Changes of depth (and surface) `h`, `u` and `v` of a cell in half a step, from its slopes alone (Hancock's).

    Mass and force of the gravity are those of the depths through which water passes the faces: else waves over a bed
    that jumps from cell to cell would gain energy in each step, as with Euler's method.

    Args:
        cell: the cell.
        half: its half slopes.
        r: time step over the size of the cell, s/m.
        g: gravity, m/s².
    """
    zero = 0.0 * cell.h
    return ti.Struct(
        h=zero - r * (cell.u * half.widening + half.passage * half.u),
        u=zero - r * (cell.u * half.u + g * half.eta * (half.passage / (cell.h + TINY))),
        v=zero - r * (cell.u * half.v),
    )


@func
def share(cell, u, r: ti.f32, g: ti.f32):
    """Greatest mass flux through the face of a cell towards which it has the velocity u, m²/s.

    In a step a cell loses at most half of its water through each of the two faces, where it flows faster than waves
    travel all through the one ahead and nothing through the other. So depth stays positive.
    """
    zero = 0.0 * cell.h
    fast = cell.u * cell.u > g * cell.h
    part = ti.select(fast, ti.select(u > zero, 1.0 + zero, zero), 0.5 + zero)
    return part * cell.h * (1.0 / r)


@func
def upper_face(cell, half, change, r: ti.f32, g: ti.f32):
    """State of a cell at its eastern or northern face after half a step."""
    return ti.Struct(
        eta=(cell.eta + change.h) + half.eta,
        h=(cell.h + change.h) + half.h,
        u=(cell.u + change.u) + half.u,
        v=(cell.v + change.v) + half.v,
        most=share(cell, cell.u, r, g),
    )


@func
def lower_face(cell, half, change, r: ti.f32, g: ti.f32):
    """State of a cell at its western or southern face after half a step."""
    return ti.Struct(
        eta=(cell.eta + change.h) - half.eta,
        h=(cell.h + change.h) - half.h,
        u=(cell.u + change.u) - half.u,
        v=(cell.v + change.v) - half.v,
        most=share(cell, 0.0 * cell.u - cell.u, r, g),
    )


@func
def flux(left, right, g: ti.f32):
    """Flux through a face between two states, over a bed that may jump there.

    Hydrostatic reconstruction (Audusse et al. 2004, doi 10.1137/S1064827503431090): the bed at the face is the higher
    of the two, and over it a state has the depth h* = max(0, η − b*). Between these the flux of HLL in mass and normal
    momentum (Harten, Lax and van Leer 1983, doi 10.1137/1025002), with the transverse velocity of the side the water
    comes from. Wave speeds are Einfeldt's (1988, doi 10.1137/0725021): those of the two states and of their Roe mean,
    so that a single bore stays as sharp as with Roe's flux; beside a dry state the exact ones (Toro 2001,
    "Shock-capturing methods for free-surface shallow flows", §10.3).

    The momentum flux is given less the hydrostatic force ½ g h*² of the left and of the right side, formed from the
    difference of the surfaces. So water at rest gives exact zeros, and a wave of a millimetre over a hundred metres of
    water is not lost in the rounding of ½ g h².

    Args:
        left, right: states on both sides of the face.
        g: gravity, m/s².

    Returns:
        flux of `mass` (m²/s), of normal momentum into the `left` and the `right` cell, of `transverse` momentum
        (m³/s²), the `speed` of the fastest wave (m/s), and the `step` of the bed over the sum of it and the depth.
    """
    zero = 0.0 * left.eta
    bed = ti.max(left.eta - left.h, right.eta - right.h)
    top_L = ti.max(left.eta, bed)
    top_R = ti.max(right.eta, bed)
    d_L = top_L - bed
    d_R = top_R - bed
    u_L = left.u
    u_R = right.u
    jump = top_R - top_L
    step = (left.eta - left.h) - (right.eta - right.h)
    step = ti.max(step, zero - step)
    c_L = ti.sqrt(g * d_L)
    c_R = ti.sqrt(g * d_R)
    u_mean = (c_L * u_L + c_R * u_R) / (c_L + c_R + TINY)
    c_mean = ti.sqrt(0.5 * g * (d_L + d_R))
    s_L = ti.select(d_L > zero, ti.min(u_L - c_L, u_mean - c_mean), u_R - 2.0 * c_R)
    s_R = ti.select(d_R > zero, ti.max(u_R + c_R, u_mean + c_mean), u_L + 2.0 * c_L)
    s_L = ti.min(ti.select(d_R > zero, s_L, u_L - c_L), zero)
    s_R = ti.max(ti.select(d_L > zero, s_R, u_R + c_R), zero)
    per_width = 1.0 / (s_R - s_L + TINY)
    weight_L = s_R * per_width
    weight_R = (zero - s_L) * per_width
    diffusion = (s_L * s_R) * per_width
    q_L = d_L * u_L
    q_R = d_R * u_R
    force = 0.5 * g * jump * (d_L + d_R)
    wanted = (weight_L * q_L + weight_R * q_R) + diffusion * jump
    momentum = (weight_L * (q_L * u_L) + weight_R * (q_R * u_R)) + diffusion * (q_R - q_L)
    mass = ti.max(ti.min(wanted, left.most), zero - right.most)
    momentum = ti.select(mass == wanted, momentum, mass * ti.select(mass > zero, u_L, u_R))
    transverse = mass * ti.select(mass > zero, left.v, right.v)
    return ti.Struct(
        mass=mass,
        left=momentum + weight_R * force,
        right=momentum - weight_L * force,
        transverse=transverse,
        speed=ti.max(s_R, zero - s_L),
        step=step / (step + ti.max(d_L, d_R) + TINY),
    )


@func
def fill_wall(basin: ti.template(), ghost: ti.template()):
    """A ghost beyond a wall: the mirror image."""
    cells = ti.static(basin.cells)
    mirror = ghost.first
    if ghost.layer == 2:
        mirror = ghost.second
    cells[ghost.at] = cells[mirror]
    cells[ghost.at + ghost.across] = -cells[mirror + ghost.across]
    cells[ghost.at + ghost.along] = cells[mirror + ghost.along]


@func
def fill_open(basin: ti.template(), ghost: ti.template(), kind: ti.i32, tide: vec2):
    """A ghost beyond an open boundary: a state by the Riemann invariants that leave and that enter.

    With c0 of the still sea, c1 under the prescribed elevation and outward velocity u: u + 2 (c − c0) = R leaves, of
    surface and velocity continued from the two cells inside where both are flooded: linearly, but less the more the bed
    rises or falls between them. u − 2 (c − c0) enters: 0 from a still sea; −4 (c1 − c0) of a simple wave in still
    water; R − 4 (c1 − c0) where the boundary has that elevation. What is in a ghost arrives at the boundary later, so
    it has the elevation, and the R, of then. Water passes a forced boundary at most with the speed of waves: faster
    water would need other conditions.
    """
    cells, bed, g = ti.static((basin.cells, basin.bed_cells, basin.g))
    b = bed[ghost.at - ghost.bed_offset]
    b_1 = bed[ghost.first - ghost.bed_offset]
    b_2 = bed[ghost.second - ghost.bed_offset]
    h0 = ti.max(-b, 0.0)
    land = ti.max(b, 0.0)
    c0 = ti.sqrt(g * h0)
    u_1 = ghost.outward * cells[ghost.first + ghost.across]
    u_2 = ghost.outward * cells[ghost.second + ghost.across]
    eta_1 = cells[ghost.first] + ti.max(b_1, 0.0)
    eta_2 = cells[ghost.second] + ti.max(b_2, 0.0)
    leaving = u_1 + 2.0 * celerity_difference(cells[ghost.first], 0.0, ti.max(-b_1, 0.0), g)
    returning = leaving
    if ti.min(eta_1, eta_2) > ti.max(b_1, b_2) + basin.dry:
        even = ti.max(1.0 - ti.abs(b_1 - b_2) / ti.max(h0, basin.dry), 0.0)
        beyond = even * ti.cast(ghost.layer, ti.f32)
        within = even * (ti.cast(ghost.layer, ti.f32) - 1.0)
        eta = ti.max(eta_1 + beyond * (eta_1 - eta_2) - land, -h0)
        leaving = u_1 + beyond * (u_1 - u_2) + 2.0 * celerity_difference(eta, 0.0, h0, g)
        eta = ti.max(eta_1 + within * (eta_2 - eta_1) - land, -h0)
        returning = u_1 + within * (u_2 - u_1) + 2.0 * celerity_difference(eta, 0.0, h0, g)
    if kind != FORCED:
        returning = 0.0

    D = 0.0
    rise = 0.0
    if kind != RADIATING:
        D = ti.max(tide[0] - land, -h0)
        rise = celerity_difference(D, 0.0, h0, g)
        inward_speed = c0 - 0.25 * leaving - 0.75 * (returning - 4.0 * rise)
        later = (ti.cast(ghost.layer, ti.f32) - 0.5) / ti.max(ghost.r * inward_speed, 0.25)
        D = ti.max(tide[0] + later * (tide[1] - tide[0]) - land, -h0)
        rise = celerity_difference(D, 0.0, h0, g)
    entering = returning - 4.0 * rise
    excess = ti.max(0.25 * (leaving - entering), -c0)
    u = 0.5 * (leaving + entering)
    if kind == FORCED:
        u = ti.max(ti.min(u, c0 + excess), -c0 - excess)
    # D + (c² − c1²)/g, which is D itself where nothing moves.
    cells[ghost.at] = ti.max(D + (excess - rise) * (2.0 * c0 + excess + rise) / g, -h0)
    cells[ghost.at + ghost.across] = ghost.outward * u
    cells[ghost.at + ghost.along] = cells[ghost.first + ghost.along]


@func
def celerity_difference(D: ti.f32, D_0: ti.f32, h0: ti.f32, g: ti.f32) -> ti.f32:
    """√(g (D + h0)) − √(g (D_0 + h0)), which rounds like D − D_0."""
    return g * (D - D_0) / (ti.sqrt(g * (D + h0)) + ti.sqrt(g * (D_0 + h0)) + TINY)
