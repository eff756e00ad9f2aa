"""Headings, features and commands of `LANES` AUVs side by side, whose numbers are vectors in a room.

A room has what the AUVs see at its begin, a column after another, then the velocity through the water by a heuristic,
and from there on place for features and layers of a network.
"""

import math
from enum import IntEnum
from typing import Any, NamedTuple

import taichi as ti

from usvauv.kernels.functions import LANES, func
from usvauv.kernels.guidance.courses import (
    advance,
    clear_of_border,
    closeness,
    cost_of_way,
    crab,
    direction,
    repelled,
    turn,
    turned,
    unrotate,
)
from usvauv.kernels.guidance.network import bounded
from usvauv.kernels.guidance.passing import loiter, passing
from usvauv.kernels.transcendental import exponential, lanes
from usvauv.kernels.types import Columns, select

FIRST = 9  # features of the target and the other AUVs, which come before those by `Rule`
OFFSET = 0.5  # largest turn of a heuristic's heading by an action, half turns
CHOSEN = 2  # numbers of the velocity by a heuristic


class Start(IntEnum):
    """What an action is relative to."""

    TARGET = 0  # the target's bearing, as in `TargetFrame`
    CLEAR = 1  # that bearing clear of other AUVs, with an autopilot as in `GuidedFrame`
    LOITER = 2  # heading and speed of `loiter`
    PASS = 3  # heading and speed of `pass`, as in `PassingFrame`


class Term(Columns):
    """Where a term of what an AUV sees begins, 0 for one that it does not see."""

    target: int
    others: int
    position: int
    current: int  # m/s
    next: int
    service: int
    attitude: int
    motion: int  # velocity through the water: with an attitude forward and to starboard, else in world axes, m/s


class Rule(Columns):
    """Where a feature comes from, (F, 3)."""

    x: int  # column of what is seen
    y: int  # column of the vector's other component
    turned: int  # 0: x as it is; 1: the vector's component along the target's bearing; 2: to the left of it


class FrameNumber(Columns):
    """Numbers of a frame and its scenario."""

    reach: int  # of the closeness of others, over the area's diagonal
    diagonal: int  # of the area, m
    repelled: int  # distance below which the nearest other AUV repels, m
    margin: int  # of the border, m, and the positions where it begins on the other side
    east: int
    north: int
    slowest: int  # speed through the water, m/s
    fastest: int
    price: int  # of time at action 0, W, and the logarithm of what action 1 multiplies it by
    gain: int
    depth: int  # action that commands the cruise depth


class Tables(NamedTuple):
    """Arrays that the functions below read.

    Attributes:
        column: by `Term`. number: by `FrameNumber`. task: by `Task` of `usvauv.kernels.guidance.passing`.
        speeds: (2, ·) among which an autopilot chooses, ascending, m/s, and their powers, W.
    """

    column: Any
    number: Any
    task: Any
    speeds: Any


@func
def vector(room: ti.template(), part, column, scale):
    """A vector that is seen, times a scale."""
    return scale * room[part, column], scale * room[part, column + 1]


@func
def side_by_side(numbers: ti.template(), rows, column):
    """A column of some rows."""
    return ti.Vector([numbers[rows[n], column] for n in ti.static(range(LANES))])


@func
def load(seen: ti.template(), rows, room: ti.template(), part):
    """Rows of what is seen, side by side into a room."""
    for column in range(seen.shape[1]):
        room[part, column] = side_by_side(seen, rows, column)


@func
def clear_of_others(room: ti.template(), part, ahead, auvs, tables: ti.template()):
    """See `usvauv.policies.guidance.clear_of_others`."""
    x, y = ahead
    if auvs > 1:
        away_x, away_y, nearest = lanes(0.0), lanes(0.0), lanes(math.inf)
        for j in range(auvs - 1):
            column = tables.column[Term.others] + 2 * j
            to_other, distance = direction(vector(room, part, column, tables.number[FrameNumber.diagonal]))
            closer = distance < nearest
            away_x, away_y = select(closer, to_other[0], away_x), select(closer, to_other[1], away_y)
            nearest = ti.min(nearest, distance)
        x, y = repelled(ahead, (away_x, away_y), nearest, tables.number[FrameNumber.repelled])
    return x, y


@func
def speed_to_fly(speeds: ti.template(), price, along, across):
    """See `usvauv.policies.guidance.SpeedToFly`."""
    best, lowest = price - price, lanes(math.inf)  # 0, or no number if the price is none
    for g in range(speeds.shape[1]):
        speed = speeds[0, g]
        cost = cost_of_way(speeds[1, g], price, advance(speed, along, across))
        best = select(cost < lowest, lanes(speed), best)  # of equal costs the lowest speed
        lowest = ti.min(lowest, cost)
    return best


@func
def plan(room: ti.template(), part, current, velocity, tables: ti.template(), start: ti.template()):
    """Direction over ground and highest speed over ground of `loiter` or `pass`."""
    diagonal = tables.number[FrameNumber.diagonal]
    here = vector(room, part, tables.column[Term.position], diagonal)
    offset = vector(room, part, tables.column[Term.target], diagonal)
    course, _ = direction((velocity[0] + current[0], velocity[1] + current[1]))
    serving, left = vector(room, part, tables.column[Term.service], 1.0)
    if ti.static(start == Start.PASS):
        following = vector(room, part, tables.column[Term.next], diagonal)
        return passing(here, offset, following, course, current, serving, left, tables.task)
    else:  # noqa: RET505 - Taichi compiles one of the branches
        return loiter(here, offset, course, serving, tables.task)


@func
def steered(room: ti.template(), part, auvs, tables: ti.template(), start: ti.template(), true: ti.template()):
    """Heading and speed through the water of `loiter` or `pass`.

    Args:
        true: whether the AUV's velocity is in world axes.
    """
    column, number = ti.static(tables.column, tables.number)
    current = vector(room, part, column[Term.current], 1.0)
    ahead, right = vector(room, part, column[Term.motion], 1.0)
    x, y = ahead, right
    if ti.static(not true):
        x, y = turn(vector(room, part, column[Term.attitude], 1.0), ahead, 0.0 - right)
    wanted, most = plan(room, part, current, (x, y), tables, start)
    track = clear_of_others(room, part, wanted, auvs, tables)
    along, across = unrotate(current, track)
    fast = speed_to_fly(tables.speeds, lanes(number[FrameNumber.price]), along, across)
    slow = speed_to_fly(tables.speeds, lanes(0.0), along, across)
    speed = ti.max(ti.min(fast, most - along), slow)
    return crab(track, speed, across), speed


@func
def encode(
    room: ti.template(), part, auvs, tables: ti.template(), rule: ti.template(), unit: ti.template(), features, to
):
    """Features at `to` of a room, see `TargetFrame`; what is seen is at 0."""
    rate = -1.0 / tables.number[FrameNumber.reach]
    ahead, distance = direction(vector(room, part, tables.column[Term.target], 1.0))
    nearest_x, nearest_y, pull_x, pull_y, closest = lanes(0.0), lanes(0.0), lanes(0.0), lanes(0.0), lanes(0.0)
    least = lanes(math.inf)
    for j in range(auvs - 1):
        x, y = unrotate(vector(room, part, tables.column[Term.others] + 2 * j, 1.0), ahead)
        away, close, pull = closeness((x, y), rate)
        pull_x += pull[0]
        pull_y += pull[1]
        closest = ti.max(closest, close)
        nearest_x, nearest_y = select(away < least, x, nearest_x), select(away < least, y, nearest_y)
        least = ti.min(least, away)
    first = [
        distance,
        exponential(rate * distance),
        ahead[0],
        ahead[1],
        nearest_x,
        nearest_y,
        pull_x,
        pull_y,
        closest,
    ]
    for f in ti.static(range(FIRST)):
        room[part, to + f] = first[f]
    for f in range(features - FIRST):
        scale = 1.0 / unit[f]
        value = scale * room[part, rule[f, Rule.x]]
        if rule[f, Rule.turned] != 0:
            along, left = unrotate((value, scale * room[part, rule[f, Rule.y]]), ahead)
            value = along if rule[f, Rule.turned] == 1 else left
        room[part, to + FIRST + f] = value


@func
def relative(room: ti.template(), part, action, auvs, tables: ti.template(), start: ti.template()):
    """Heading and speed for a network's action that is relative to the target's bearing."""
    number = ti.static(tables.number)
    ahead, _ = direction(vector(room, part, tables.column[Term.target], 1.0))
    x, y = ahead
    if ti.static(start == Start.CLEAR):
        x, y = clear_of_others(room, part, ahead, auvs, tables)
    x, y = turned((x, y), room[part, action])
    pace, slowest = room[part, action + 1], number[FrameNumber.slowest]
    speed = slowest + 0.5 * (number[FrameNumber.fastest] - slowest) * (pace + 1.0)
    if ti.static(start == Start.CLEAR):
        position = vector(room, part, tables.column[Term.position], number[FrameNumber.diagonal])
        ends = number[FrameNumber.east], number[FrameNumber.north]
        x, y = clear_of_border(position, (x, y), number[FrameNumber.margin], ends)
        along, across = lanes(0.0), lanes(0.0)
        if tables.column[Term.current] != 0:
            along, across = unrotate(vector(room, part, tables.column[Term.current], 1.0), (x, y))
        price = number[FrameNumber.price] * exponential(number[FrameNumber.gain] * pace)
        speed = speed_to_fly(tables.speeds, price, along, across)
        x, y = crab((x, y), speed, across)
    return (x, y), speed


@func
def offset(room: ti.template(), part, action, heading, speed, number: ti.template()):
    """Heading and speed for a network's action that is relative to these."""
    slowest, fastest = number[FrameNumber.slowest], number[FrameNumber.fastest]
    turned_heading = turned(heading, OFFSET * room[part, action])
    return turned_heading, bounded(speed + (fastest - slowest) * room[part, action + 1], slowest, fastest)


@func
def write(commands: ti.template(), rows, heading, speed, number: ti.template()):
    """The world's actions for headings and speeds, see `usvauv.policies.guidance.command`."""
    x, y = heading
    share_of_top = speed * (1.0 / number[FrameNumber.fastest])
    x, y = bounded(x * share_of_top, -1.0, 1.0), bounded(y * share_of_top, -1.0, 1.0)
    for n in ti.static(range(LANES)):
        commands[rows[n], 0] = x[n]
        commands[rows[n], 1] = y[n]
        if commands.shape[1] > 2:
            commands[rows[n], 2] = number[FrameNumber.depth]


@func
def see(seen: ti.template(), rows, room: ti.template(), part, auvs, tables: ti.template(), start: ti.template()):
    """Load what rows of AUVs see into a room, and after it the velocity by the heuristic; its heading and speed."""
    load(seen, rows, room, part)
    x, y, speed = lanes(0.0), lanes(0.0), lanes(0.0)
    if ti.static(start >= Start.LOITER):
        heading, speed = steered(room, part, auvs, tables, start, False)
        x, y = heading
    room[part, seen.shape[1]], room[part, seen.shape[1] + 1] = x * speed, y * speed
    return (x, y), speed
