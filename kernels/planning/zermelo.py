"""Zermelo's navigation problem: the cheapest way to a circle through a current that stands still.

J(x) is the least cost of reaching the circle of radius R about the goal from x inside the area, moving with the water's
velocity c(x) and a velocity of any direction and of speed s through the water, at a cost rate L(s). By dynamic
programming

    max over s of [ s ‖∇J‖ − L(s) ] − c·∇J = 0,    J = 0 on the circle,

and the course is −∇J/‖∇J‖. With the one speed V and the rate 1, J is the time to go T, and V ‖∇T‖ − c·∇T = 1 (Zermelo
1931, doi 10.1002/zamm.19310110205). Where the current is stronger than the vehicle there may be no way at all.

The scheme is semi-Lagrangian (Hopf–Lax): a node's cost is the least, over all points of the ring of its eight
neighbours, of the way there through the node's own current plus the cost interpolated there. It is consistent and
monotone whatever the current's strength (Bornemann, Rasch 2006, doi 10.1007/s00791-006-0016-y). Gauss–Seidel sweeps in
four orders, each with the quarter of the ring that lies upwind of its order, carry it through the grid (Zhao 2005, doi
10.1090/S0025-5718-04-01678-3) until four in a row change nothing. Errors are of first order in the spacing, and to the
late side. In a current stronger than the vehicle ways along the rim of what can be reached may be missed, because a
face of the ring with an end beyond it is closed.

Arrays, float32 unless said, of W worlds and K vehicles:

    flow     (W, rows, columns, 2)   velocity of the water on a grid over the area, row 0 in the south, m/s
    goal     (W, K, 2)               centre of the circle, m
    speeds   (S,)                    speeds through the water to choose from, m/s
    rates    (S,)                    L of each, cost units a second, above 0
    cost     (W, K, rows, columns)   J; `UNREACHABLE` where there is no way
"""

import taichi as ti
import torch

from kernels.types import array1, array3, array4, vec2

UNREACHABLE = 1e9
DIRECTIONS = 64  # in which a way is looked for before the best is refined
REFINEMENTS = 8  # halvings of the angle between two of them
TOLERANCE = 1e-5  # of a cost, below which a sweep has changed nothing
MAX_SWEEPS = 400
NEAR = 2.5  # spacings from the circle within which the way is taken to be straight
REACH = 1.5  # spacings that a course looks ahead
TWO_PI = 6.283185307179586

mask2 = ti.types.ndarray(dtype=ti.u8, ndim=2)


@ti.func
def travel_time(d: vec2, c: vec2, V: ti.f32, R: ti.f32) -> ti.f32:
    """Time to come within R of a place at d in a uniform current, s: the first t with |d − c t| = V t + R."""
    gap = d.norm_sqr() - R * R
    along = V * R + c.dot(d)
    root = along * along + (V * V - c.norm_sqr()) * gap
    t = UNREACHABLE
    if gap <= 0.0:
        t = 0.0
    elif root >= 0.0:
        rate = along + ti.sqrt(root)
        if rate * UNREACHABLE > gap:
            t = gap / rate
    return t


@ti.func
def straight_cost(d: vec2, c: vec2, R: ti.f32, speeds: ti.template(), rates: ti.template()) -> ti.f32:
    """Least cost over the speeds of coming within R of a place at d in a uniform current."""
    J = UNREACHABLE
    for s in range(speeds.shape[0]):
        t = travel_time(d, c, speeds[s], R)
        if t < UNREACHABLE:
            J = ti.min(J, rates[s] * t)
    return J


@ti.func
def across_face(
    J_e: ti.f32,
    J_d: ti.f32,
    c_n: ti.f32,
    c_s: ti.f32,
    step_n: ti.f32,
    step_s: ti.f32,
    speeds: ti.template(),
    rates: ti.template(),
) -> ti.f32:
    """Least cost through the inside of the face between a neighbour e along n and its neighbour d along s.

    Crossing on the course φ from n towards s costs J_e + step_n (L + q w_s)/w_n, with the velocities over ground
    w_n = V cos φ + c_n and w_s = V sin φ + c_s and the slope q of the cost along the face. It is least where
    A sin φ + B cos φ = −q V with A = L + q c_s, B = q c_n.
    """
    J = UNREACHABLE
    q = (J_d - J_e) / step_s
    B = q * c_n
    for s in range(speeds.shape[0]):
        V = speeds[s]
        L = rates[s]
        A = L + q * c_s
        square = A * A + B * B
        root = square - q * q * V * V
        if root > 0.0:
            root = ti.sqrt(root)
            w_s = V * (-q * V * A - root * B) / square + c_s
            w_n = V * (root * A - q * V * B) / square + c_n
            if w_n > 0.0 and w_s >= 0.0 and w_s * step_n <= w_n * step_s:
                J = ti.min(J, J_e + step_n * (L + q * w_s) / w_n)
    return J


@ti.func
def current_at(flow: ti.template(), w, x: ti.f32, y: ti.f32, dx: ti.f32, dy: ti.f32) -> vec2:
    """Bilinear current at a point of the area, m/s."""
    p = x / dx
    q = y / dy
    j = ti.math.clamp(ti.cast(p, ti.i32), 0, flow.shape[2] - 2)
    i = ti.math.clamp(ti.cast(q, ti.i32), 0, flow.shape[1] - 2)
    c = vec2(0.0, 0.0)
    for axis in ti.static(range(2)):
        south = flow[w, i, j, axis] + (p - j) * (flow[w, i, j + 1, axis] - flow[w, i, j, axis])
        north = flow[w, i + 1, j, axis] + (p - j) * (flow[w, i + 1, j + 1, axis] - flow[w, i + 1, j, axis])
        c[axis] = south + (q - i) * (north - south)
    return c


@ti.func
def near_cost(flow: ti.template(), w, goal: vec2, x: vec2, R, dx, dy, speeds: ti.template(), rates: ti.template()):
    """Cost of the straight way in the current of its middle, beside the goal; `UNREACHABLE` away from it."""
    J = UNREACHABLE
    d = goal - x
    if d.norm() < R + NEAR * ti.max(dx, dy):
        middle = x + 0.5 * d
        J = straight_cost(d, current_at(flow, w, middle[0], middle[1], dx, dy), R, speeds, rates)
    return J


@ti.func
def cost_at(
    flow: ti.template(),
    cost: ti.template(),
    w,
    k,
    goal: vec2,
    x: vec2,
    R,
    dx,
    dy,
    speeds: ti.template(),
    rates: ti.template(),
) -> ti.f32:
    """Cost at a point of the area: bilinear, and beside the goal that of the straight way."""
    J = near_cost(flow, w, goal, x, R, dx, dy, speeds, rates)
    if J >= UNREACHABLE:
        p = x[0] / dx
        q = x[1] / dy
        j = ti.math.clamp(ti.cast(p, ti.i32), 0, cost.shape[3] - 2)
        i = ti.math.clamp(ti.cast(q, ti.i32), 0, cost.shape[2] - 2)
        south = cost[w, k, i, j] + (p - j) * (cost[w, k, i, j + 1] - cost[w, k, i, j])
        north = cost[w, k, i + 1, j] + (p - j) * (cost[w, k, i + 1, j + 1] - cost[w, k, i + 1, j])
        J = south + (q - i) * (north - south)
        for a, b in ti.static(ti.ndrange(2, 2)):
            if cost[w, k, i + a, j + b] >= UNREACHABLE:
                J = UNREACHABLE
    return J


@ti.func
def improve(
    flow: ti.template(),
    cost: ti.template(),
    w,
    k,
    i,
    j,
    up,
    right,
    dx,
    dy,
    speeds: ti.template(),
    rates: ti.template(),
):
    """Least cost of node (i, j) by its neighbours in row i − up and column j − right, where there are such."""
    rows = cost.shape[2]
    columns = cost.shape[3]
    row = i - up
    column = j - right
    has_row = row >= 0 and row < rows
    has_column = column >= 0 and column < columns
    J_x = UNREACHABLE
    J_y = UNREACHABLE
    J_d = UNREACHABLE
    if has_column:
        J_x = cost[w, k, i, column]
    if has_row:
        J_y = cost[w, k, row, j]
    if has_row and has_column:
        J_d = cost[w, k, row, column]
    J = cost[w, k, i, j]
    if ti.min(J_x, J_y, J_d) < J:  # a way costs more than its end
        c_x = -right * flow[w, i, j, 0]  # in axes that point to the neighbours
        c_y = -up * flow[w, i, j, 1]
        c = vec2(c_x, c_y)
        if J_x < J:
            J = ti.min(J, J_x + straight_cost(vec2(dx, 0.0), c, 0.0, speeds, rates))
        if J_y < J:
            J = ti.min(J, J_y + straight_cost(vec2(0.0, dy), c, 0.0, speeds, rates))
        if J_d < UNREACHABLE:
            if J_d < J:
                J = ti.min(J, J_d + straight_cost(vec2(dx, dy), c, 0.0, speeds, rates))
            if J_x < UNREACHABLE and ti.min(J_x, J_d) < J:
                J = ti.min(J, across_face(J_x, J_d, c_x, c_y, dx, dy, speeds, rates))
            if J_y < UNREACHABLE and ti.min(J_y, J_d) < J:
                J = ti.min(J, across_face(J_y, J_d, c_y, c_x, dy, dx, speeds, rates))
    return J


@ti.kernel
def _solve(
    flow: array4,
    goal: array3,
    due: mask2,
    speeds: array1,
    rates: array1,
    width: ti.f32,
    length: ti.f32,
    R: ti.f32,
    cost: array4,
):
    ti.loop_config(block_dim=1)
    for w, k in ti.ndrange(cost.shape[0], cost.shape[1]):
        if due[w, k] != 0:
            rows = cost.shape[2]
            columns = cost.shape[3]
            dx = width / (columns - 1)
            dy = length / (rows - 1)
            centre = vec2(goal[w, k, 0], goal[w, k, 1])
            for i, j in ti.ndrange(rows, columns):
                cost[w, k, i, j] = near_cost(flow, w, centre, vec2(j * dx, i * dy), R, dx, dy, speeds, rates)
            unchanged = 0
            sweep = 0
            while unchanged < 4 and sweep < MAX_SWEEPS:
                up = 1 - 2 * (sweep // 2 % 2)
                right = 1 - 2 * ((sweep + 1) // 2 % 2)
                unchanged += 1
                for m in range(rows):
                    i = m if up > 0 else rows - 1 - m
                    for n in range(columns):
                        j = n if right > 0 else columns - 1 - n
                        J = improve(flow, cost, w, k, i, j, up, right, dx, dy, speeds, rates)
                        if J < cost[w, k, i, j]:
                            if J < (1.0 - TOLERANCE) * cost[w, k, i, j]:
                                unchanged = 0
                            cost[w, k, i, j] = J
                sweep += 1


@ti.func
def cost_by(
    flow: ti.template(),
    cost: ti.template(),
    w,
    k,
    goal: vec2,
    x: vec2,
    c: vec2,
    d: vec2,
    R,
    dx,
    dy,
    width,
    length,
    speeds: ti.template(),
    rates: ti.template(),
) -> ti.f32:
    """Least cost of going from x to x + d straight over ground, then as is best; c is the current at x."""
    end = x + d
    J = UNREACHABLE
    if end[0] >= 0.0 and end[0] <= width and end[1] >= 0.0 and end[1] <= length:
        rest = cost_at(flow, cost, w, k, goal, end, R, dx, dy, speeds, rates)
        if rest < UNREACHABLE:
            J = ti.min(rest + straight_cost(d, c, 0.0, speeds, rates), UNREACHABLE)
    return J


@ti.func
def heading(angle: ti.f32) -> vec2:
    return vec2(ti.cos(angle), ti.sin(angle))


@ti.kernel
def _steer(
    flow: array4,
    goal: array3,
    position: array3,
    current: array3,
    speeds: array1,
    rates: array1,
    width: ti.f32,
    length: ti.f32,
    R: ti.f32,
    cost: array4,
    velocity: array3,
):
    for w, k in ti.ndrange(cost.shape[0], cost.shape[1]):
        dx = width / (cost.shape[3] - 1)
        dy = length / (cost.shape[2] - 1)
        centre = vec2(goal[w, k, 0], goal[w, k, 1])
        x = vec2(position[w, k, 0], position[w, k, 1])
        inside = vec2(ti.math.clamp(x[0], 0.0, width), ti.math.clamp(x[1], 0.0, length))
        c = vec2(current[w, k, 0], current[w, k, 1])
        reach = REACH * ti.max(dx, dy)
        d = centre - x
        radius = 0.0
        if d.norm() < R + reach:
            radius = R
        else:
            best = 0.0
            least = UNREACHABLE
            span = TWO_PI / DIRECTIONS
            for m in range(DIRECTIONS):
                d = inside - x + reach * heading(m * span)
                J = cost_by(flow, cost, w, k, centre, x, c, d, R, dx, dy, width, length, speeds, rates)
                if J < least:
                    least = J
                    best = m * span
            for _ in range(REFINEMENTS):
                span *= 0.5
                middle = best
                for side in ti.static((-1, 1)):
                    d = inside - x + reach * heading(middle + side * span)
                    J = cost_by(flow, cost, w, k, centre, x, c, d, R, dx, dy, width, length, speeds, rates)
                    if J < least:
                        least = J
                        best = middle + side * span
            d = vec2(0.0, 0.0)
            if least < UNREACHABLE:
                d = inside - x + reach * heading(best)
        least = UNREACHABLE
        velocity[w, k, 0] = 0.0
        velocity[w, k, 1] = 0.0
        for s in range(speeds.shape[0]):
            t = travel_time(d, c, speeds[s], radius)
            if t > 0.0 and t < UNREACHABLE and rates[s] * t < least:
                least = rates[s] * t
                course = (d - c * t).normalized()
                velocity[w, k, 0] = speeds[s] * course[0]
                velocity[w, k, 1] = speeds[s] * course[1]


def solve(
    flow: torch.Tensor,
    goal: torch.Tensor,
    due: torch.Tensor,
    speeds: torch.Tensor,
    rates: torch.Tensor,
    cost: torch.Tensor,
    *,
    size: tuple[float, float],
    radius: float,
) -> None:
    """Solve for the cost J of the vehicles that are due, in place; the others' stays. Shapes as in the module.

    Args:
        due: (W, K) uint8.
        size: (width, length) of the area, m. radius: R > 0, m.
    """
    _solve(flow, goal, due, speeds, rates, *size, radius, cost)


def steer(
    flow: torch.Tensor,
    goal: torch.Tensor,
    position: torch.Tensor,
    current: torch.Tensor,
    speeds: torch.Tensor,
    rates: torch.Tensor,
    cost: torch.Tensor,
    velocity: torch.Tensor,
    *,
    size: tuple[float, float],
    radius: float,
) -> None:
    """Velocity through the water (m/s) with which to go on, into `velocity` (W, K, 2).

    The course is the best of all directions over ground, a node or two ahead, not that of the nearest node. It is zero
    where no way leads to the goal, and inside the circle.

    Args:
        position: (W, K, 2), m. current: (W, K, 2), the water's velocity there, m/s.
        size: (width, length) of the area, m. radius: R > 0, m.
    """
    _steer(flow, goal, position, current, speeds, rates, *size, radius, cost, velocity)
