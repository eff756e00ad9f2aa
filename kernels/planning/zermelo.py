"""Zermelo's navigation problem: the cheapest path to a circle through a steady current.

J(x) is the least cost of reaching the circle of radius R about the goal from x inside the area, moving with the water's
velocity c(x) and a velocity of any direction and of speed s through the water, at a cost rate L(s). By dynamic
programming

    max over s of [ s ‖∇J‖ − L(s) ] − c·∇J = 0,    J = 0 on the circle,

and the course is −∇J/‖∇J‖. With the one speed V and the rate 1, J is the time to go T, and V ‖∇T‖ − c·∇T = 1 (Zermelo
1931, doi 10.1002/zamm.19310110205). Where the current is faster than the vehicle there may be no path at all.

The scheme is semi-Lagrangian (Hopf–Lax): a node's cost is the least, over all points of the ring of its eight
neighbours, of the path there through the node's own current plus the cost interpolated there. It is consistent and
monotone for any current (Bornemann, Rasch 2006, doi 10.1007/s00791-006-0016-y). Gauss–Seidel sweeps in four orders,
each with the quarter of the ring that lies upwind of its order, are repeated until four in a row change nothing (Zhao
2005, doi 10.1090/S0025-5718-04-01678-3). Errors are of first order in the spacing and overestimate the cost. In a
current faster than the vehicle, paths near the edge of the reachable set may be missed, because a face of the ring with
an end beyond the edge is not used.

Arrays, float32 unless said, of W worlds and K vehicles:

    flow     (W, rows, columns, 2)   velocity of the water on a grid over the area, row 0 in the south, m/s
    goal     (W, K, 2)               centre of the circle, m
    speeds   (S,)                    speeds through the water to choose from, m/s
    rates    (S,)                    L of each, cost units a second, above 0
    cost     (W, K, rows, columns)   J; `UNREACHABLE` where there is no path
"""

from typing import NamedTuple

import taichi as ti
import torch

from usvauv.kernels import runtime
from usvauv.kernels.flow.current import grid_interpolate
from usvauv.kernels.functions import func, kernel
from usvauv.kernels.types import array1, array3, array4, mask2, vec2

UNREACHABLE = 1e9
DIRECTIONS = 64  # tried before the best is refined
REFINEMENTS = 8  # halvings of the angle between two of them
TOLERANCE = 1e-5  # smallest relative decrease of a cost that counts as a change
MAX_SWEEPS = 400
NEAR = 2.5  # spacings from the circle within which the path is taken to be straight
REACH = 1.5  # spacings that a course looks ahead
TWO_PI = 6.283185307179586


class Problem(NamedTuple):
    """The problem of one vehicle, arrays and numbers inside a kernel.

    Attributes:
        flow, cost, speeds, rates: as in the module. world, vehicle: first indices of `flow` and `cost`.
        goal: centre of the circle, m. radius: R, m.
        spacing: (dx, dy) of the grid, m.
    """

    flow: ti.types.ndarray
    cost: ti.types.ndarray
    speeds: ti.types.ndarray
    rates: ti.types.ndarray
    world: ti.i32
    vehicle: ti.i32
    goal: ti.Vector
    radius: ti.f32
    spacing: ti.Vector


@func
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


@func
def straight_cost(problem: ti.template(), d: vec2, c: vec2, R: ti.f32) -> ti.f32:
    """Least cost over the speeds of coming within R of a place at d in a uniform current."""
    J = UNREACHABLE
    for s in range(problem.speeds.shape[0]):
        t = travel_time(d, c, problem.speeds[s], R)
        if t < UNREACHABLE:
            J = ti.min(J, problem.rates[s] * t)
    return J


@func
def cost_across_face(problem: ti.template(), J_e: ti.f32, J_d: ti.f32, c: vec2, step: vec2) -> ti.f32:
    """Least cost through the inside of the face between a neighbour e along n and its neighbour d along s.

    Crossing on the course φ from n towards s costs J_e + step_n (L + q w_s)/w_n, with the velocities over ground
    w_n = V cos φ + c_n and w_s = V sin φ + c_s and the slope q of the cost along the face. It is least where
    A sin φ + B cos φ = −q V with A = L + q c_s, B = q c_n. `c` and `step` have the components n and s.
    """
    J = UNREACHABLE
    q = (J_d - J_e) / step[1]
    B = q * c[0]
    for s in range(problem.speeds.shape[0]):
        V = problem.speeds[s]
        L = problem.rates[s]
        A = L + q * c[1]
        square = A * A + B * B
        root = square - q * q * V * V
        if root > 0.0:
            root = ti.sqrt(root)
            w_s = V * (-q * V * A - root * B) / square + c[1]
            w_n = V * (root * A - q * V * B) / square + c[0]
            if w_n > 0.0 and w_s >= 0.0 and w_s * step[0] <= w_n * step[1]:
                J = ti.min(J, J_e + step[0] * (L + q * w_s) / w_n)
    return J


@func
def cost_near_goal(problem: ti.template(), x: vec2) -> ti.f32:
    """Cost of the straight path from x in the current at its middle; `UNREACHABLE` away from the goal."""
    J = UNREACHABLE
    d = problem.goal - x
    if d.norm() < problem.radius + NEAR * problem.spacing.max():
        node = (x + 0.5 * d) / problem.spacing
        c = vec2(0.0, 0.0)
        for axis in ti.static(range(2)):
            c[axis] = grid_interpolate(problem.flow, problem.world, axis, node[0], node[1])
        J = straight_cost(problem, d, c, problem.radius)
    return J


@func
def cost_at(problem: ti.template(), x: vec2) -> ti.f32:
    """Cost at a point of the area: bilinear, and near the goal that of the straight path."""
    J = cost_near_goal(problem, x)
    if J >= UNREACHABLE:
        w = problem.world
        k = problem.vehicle
        cost = ti.static(problem.cost)
        p = x[0] / problem.spacing[0]
        q = x[1] / problem.spacing[1]
        j = ti.math.clamp(ti.cast(p, ti.i32), 0, cost.shape[3] - 2)
        i = ti.math.clamp(ti.cast(q, ti.i32), 0, cost.shape[2] - 2)
        south = cost[w, k, i, j] + (p - j) * (cost[w, k, i, j + 1] - cost[w, k, i, j])
        north = cost[w, k, i + 1, j] + (p - j) * (cost[w, k, i + 1, j + 1] - cost[w, k, i + 1, j])
        J = south + (q - i) * (north - south)
        for a, b in ti.static(ti.ndrange(2, 2)):
            if cost[w, k, i + a, j + b] >= UNREACHABLE:
                J = UNREACHABLE
    return J


@func
def improved_cost(problem: ti.template(), i, j, up, right) -> ti.f32:
    """Least cost of node (i, j) by its neighbours in row i − up and column j − right, where these exist."""
    w = problem.world
    k = problem.vehicle
    cost = ti.static(problem.cost)
    row = i - up
    column = j - right
    has_row = row >= 0 and row < cost.shape[2]
    has_column = column >= 0 and column < cost.shape[3]
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
    if ti.min(J_x, J_y, J_d) < J:  # a path costs more than its end
        # In axes that point to the neighbours.
        c = vec2(-right * problem.flow[w, i, j, 0], -up * problem.flow[w, i, j, 1])
        step = problem.spacing
        if J_x < J:
            J = ti.min(J, J_x + straight_cost(problem, vec2(step[0], 0.0), c, 0.0))
        if J_y < J:
            J = ti.min(J, J_y + straight_cost(problem, vec2(0.0, step[1]), c, 0.0))
        if J_d < UNREACHABLE:
            if J_d < J:
                J = ti.min(J, J_d + straight_cost(problem, step, c, 0.0))
            if J_x < UNREACHABLE and ti.min(J_x, J_d) < J:
                J = ti.min(J, cost_across_face(problem, J_x, J_d, c, step))
            if J_y < UNREACHABLE and ti.min(J_y, J_d) < J:
                J = ti.min(J, cost_across_face(problem, J_y, J_d, vec2(c[1], c[0]), vec2(step[1], step[0])))
    return J


@kernel
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
    ti.loop_config(block_dim=ti.static(runtime.one_task_a_thread()))
    for w, k in ti.ndrange(cost.shape[0], cost.shape[1]):
        if due[w, k] != 0:
            rows = cost.shape[2]
            columns = cost.shape[3]
            spacing = vec2(width / (columns - 1), length / (rows - 1))
            centre = vec2(goal[w, k, 0], goal[w, k, 1])
            problem = ti.static(Problem(flow, cost, speeds, rates, w, k, centre, R, spacing))
            for i, j in ti.ndrange(rows, columns):
                cost[w, k, i, j] = cost_near_goal(problem, vec2(j * spacing[0], i * spacing[1]))
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
                        J = improved_cost(problem, i, j, up, right)
                        if J < cost[w, k, i, j]:
                            if J < (1.0 - TOLERANCE) * cost[w, k, i, j]:
                                unchanged = 0
                            cost[w, k, i, j] = J
                sweep += 1


@func
def cost_by(problem: ti.template(), x: vec2, c: vec2, d: vec2, size: vec2) -> ti.f32:
    """Least cost of a path that begins straight over ground from x to x + d; c is the current at x, size the area's."""
    end = x + d
    J = UNREACHABLE
    if end[0] >= 0.0 and end[0] <= size[0] and end[1] >= 0.0 and end[1] <= size[1]:
        rest = cost_at(problem, end)
        if rest < UNREACHABLE:
            J = ti.min(rest + straight_cost(problem, d, c, 0.0), UNREACHABLE)
    return J


@func
def heading(angle: ti.f32) -> vec2:
    """Unit vector at an angle (rad) from the x axis."""
    return vec2(ti.cos(angle), ti.sin(angle))


@func
def best_leg(problem: ti.template(), x: vec2, c: vec2, size: vec2) -> vec2:
    """The cheapest way to begin a path at x, a vector over ground of about REACH spacings, m; zero if there is none."""
    inside = vec2(ti.math.clamp(x[0], 0.0, size[0]), ti.math.clamp(x[1], 0.0, size[1]))
    reach = REACH * problem.spacing.max()
    best = 0.0
    least = UNREACHABLE
    span = TWO_PI / DIRECTIONS
    for m in range(DIRECTIONS):
        J = cost_by(problem, x, c, inside - x + reach * heading(m * span), size)
        if J < least:
            least = J
            best = m * span
    for _ in range(REFINEMENTS):
        span *= 0.5
        middle = best
        for side in ti.static((-1, 1)):
            J = cost_by(problem, x, c, inside - x + reach * heading(middle + side * span), size)
            if J < least:
                least = J
                best = middle + side * span
    d = vec2(0.0, 0.0)
    if least < UNREACHABLE:
        d = inside - x + reach * heading(best)
    return d


@kernel
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
        size = vec2(width, length)
        spacing = vec2(width / (cost.shape[3] - 1), length / (cost.shape[2] - 1))
        centre = vec2(goal[w, k, 0], goal[w, k, 1])
        problem = ti.static(Problem(flow, cost, speeds, rates, w, k, centre, R, spacing))
        x = vec2(position[w, k, 0], position[w, k, 1])
        c = vec2(current[w, k, 0], current[w, k, 1])
        d = centre - x
        radius = R
        if d.norm() >= R + REACH * spacing.max():
            d = best_leg(problem, x, c, size)
            radius = 0.0
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
    """Solve for the cost J of the vehicles that are due, in place; that of the others stays. Shapes as in the module.

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
    """Write the best velocity through the water (m/s) into `velocity` (W, K, 2).

    The course is the best of all directions over ground, a node or two ahead, not that of the nearest node. The
    velocity is zero where no path leads to the goal, and inside the circle.

    Args:
        position: (W, K, 2), m. current: (W, K, 2), the water's velocity there, m/s.
        size: (width, length) of the area, m. radius: R > 0, m.
    """
    _steer(flow, goal, position, current, speeds, rates, *size, radius, cost, velocity)
