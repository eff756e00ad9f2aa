"""Actions of learned policies on a CPU, from observations to commands in one pass, sixteen AUVs side by side.

Except for rounding equal to `TargetFrame` and `GuidedFrame` of `usvauv.policies.frames` with an actor of
`usvauv.policies.networks` between them, which have the equations in some hundred operations of torch: for few AUVs
mostly overhead, for many a pass over memory each.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import taichi as ti
import torch

from usvauv.kernels import runtime
from usvauv.kernels.functions import Launch, func, kernel
from usvauv.kernels.network import (
    LANES,
    TILE,
    Layer,
    Packed,
    bounded,
    exponential,
    forward,
    groups_of,
    hyperbolic_tangent,
    lanes,
    rooms,
    rows_of,
    standardised,
    tiles,
)
from usvauv.kernels.trigonometry import half_cosine, half_sine
from usvauv.kernels.types import Columns, array1, array2, index2, select

LEAST = 1e-18  # added to no effect, but that a zero vector has a direction; its square is above zero
TINY = 1e-9
NEAREST = 1e-3  # m, smaller distances between AUVs repel like it
LEAST_ADVANCE = 0.05  # m/s over ground, lower bound on headway
HOPELESS = 1e6  # J/m, above every cost with headway
FIRST = 9  # features of the target and the other AUVs, which come before those by `Rule`


class Rule(Columns):
    """Where a feature comes from, (F, 3)."""

    x: int  # column of the observation
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


@func
def direction(x, y):
    """Unit vectors in the direction of vectors, and their lengths; (1, 0) and `LEAST` of a zero vector."""
    along = x + LEAST
    length = ti.sqrt(along * along + y * y)
    return along / length, y / length, length


@func
def turn(x, y, cosine, sine):
    """Vectors turned to the left."""
    return cosine * x - sine * y, cosine * y + sine * x


@func
def along_and_left(x, y, ahead_x, ahead_y):
    return x * ahead_x + y * ahead_y, y * ahead_x - x * ahead_y


@func
def encode(
    room: ti.template(),
    part,
    target,
    others,
    rule: ti.template(),
    unit: ti.template(),
    number: ti.template(),
    mean: ti.template(),
    deviation: ti.template(),
    auvs,
    to,
    end,
):
    """Standardised features at `to` of a room, see `TargetFrame`, and zeros up to `end`; the observation is at 0."""
    rate = -1.0 / number[FrameNumber.reach]
    ahead_x, ahead_y, distance = direction(room[part, target], room[part, target + 1])
    nearest_x, nearest_y, pull_x, pull_y, closest = lanes(0.0), lanes(0.0), lanes(0.0), lanes(0.0), lanes(0.0)
    least = lanes(math.inf)
    for j in range(auvs - 1):
        x, y = along_and_left(room[part, others + 2 * j], room[part, others + 2 * j + 1], ahead_x, ahead_y)
        away = ti.sqrt(x * x + y * y)
        closeness = exponential(rate * away)
        pull = closeness / ti.max(away, TINY)
        pull_x += pull * x
        pull_y += pull * y
        closest = ti.max(closest, closeness)
        nearest_x, nearest_y = select(away < least, x, nearest_x), select(away < least, y, nearest_y)
        least = ti.min(least, away)
    first = [
        distance,
        exponential(rate * distance),
        ahead_x,
        ahead_y,
        nearest_x,
        nearest_y,
        pull_x,
        pull_y,
        closest,
    ]
    for f in ti.static(range(FIRST)):
        room[part, to + f] = standardised(first[f], mean[f], deviation[f])
    for f in range(FIRST, mean.shape[0]):
        at, scale = f - FIRST, 1.0 / unit[f - FIRST]
        value = scale * room[part, rule[at, Rule.x]]
        if rule[at, Rule.turned] != 0:
            along, left = along_and_left(value, scale * room[part, rule[at, Rule.y]], ahead_x, ahead_y)
            value = along if rule[at, Rule.turned] == 1 else left
        room[part, to + f] = standardised(value, mean[f], deviation[f])
    for f in range(mean.shape[0], end - to):
        room[part, to + f] = lanes(0.0)


@func
def clear_of_others(room: ti.template(), part, others, auvs, ahead_x, ahead_y, number: ti.template()):
    """See `usvauv.policies.guidance.clear_of_others`."""
    x, y = ahead_x, ahead_y
    if auvs > 1:
        diagonal = number[FrameNumber.diagonal]
        away_x, away_y, nearest = lanes(0.0), lanes(0.0), lanes(math.inf)
        for j in range(auvs - 1):
            other = others + 2 * j
            to_x, to_y, distance = direction(diagonal * room[part, other], diagonal * room[part, other + 1])
            closer = distance < nearest
            away_x, away_y = select(closer, to_x, away_x), select(closer, to_y, away_y)
            nearest = ti.min(nearest, distance)
        ratio = number[FrameNumber.repelled] / ti.max(nearest, NEAREST)
        push = ti.max(ratio - 1.0, 0.0) * (ratio * ratio)
        x, y, _ = direction(x - push * away_x, y - push * away_y)
    return x, y


@func
def inside(position, track, margin, end):
    """A component of a course, or 0 where it leads out of the area."""
    outwards = ((position < margin) & (track < 0.0)) | ((position > end) & (track > 0.0))
    return select(outwards, lanes(0.0), track)


@func
def clear_of_border(x, y, track_x, track_y, number: ti.template()):
    """A course that does not lead out of the area."""
    margin = number[FrameNumber.margin]
    course_x, course_y, length = direction(
        inside(x, track_x, margin, number[FrameNumber.east]), inside(y, track_y, margin, number[FrameNumber.north])
    )
    return select(length > TINY, course_x, track_x), select(length > TINY, course_y, track_y)


@func
def speed_to_fly(speeds: ti.template(), price, along, across):
    """See `usvauv.policies.guidance.SpeedToFly`; `speeds` (2, ·) are speeds, ascending, and powers."""
    best, lowest, square = price - price, lanes(math.inf), across * across  # 0, or no number if the price is none
    for g in range(speeds.shape[1]):
        speed = speeds[0, g]
        advance = ti.sqrt(ti.max(speed * speed - square, 0.0)) + along
        cost = (speeds[1, g] + price) / ti.max(advance, LEAST_ADVANCE)
        cost = select(advance > LEAST_ADVANCE, cost, HOPELESS - advance)
        best = select(cost < lowest, lanes(speed), best)  # of equal costs the lowest speed
        lowest = ti.min(lowest, cost)
    return best


@func
def steer(
    room: ti.template(),
    part,
    action,
    target,
    others,
    position,
    current,
    number: ti.template(),
    speeds: ti.template(),
    auvs,
    guided: ti.template(),
    observed: ti.template(),
):
    """Headings (x, y) and speeds for a network's actions from `action` on, see `TargetFrame` or `GuidedFrame`."""
    ahead_x, ahead_y, _ = direction(room[part, target], room[part, target + 1])
    if ti.static(guided):
        ahead_x, ahead_y = clear_of_others(room, part, others, auvs, ahead_x, ahead_y, number)
    half = 0.5 * room[part, action]  # turns
    pace = room[part, action + 1]
    cosine, sine = half_cosine(half), half_sine(half)
    x, y = turn(ahead_x, ahead_y, 1.0 - 2.0 * sine * sine, 2.0 * sine * cosine)
    slowest, span = number[FrameNumber.slowest], number[FrameNumber.fastest] - number[FrameNumber.slowest]
    speed = slowest + (0.5 * span) * (pace + 1.0)
    if ti.static(guided):
        diagonal = number[FrameNumber.diagonal]
        x, y = clear_of_border(diagonal * room[part, position], diagonal * room[part, position + 1], x, y, number)
        along, across = lanes(0.0), lanes(0.0)
        if ti.static(observed):
            along, across = along_and_left(room[part, current], room[part, current + 1], x, y)
        price = number[FrameNumber.price] * exponential(number[FrameNumber.gain] * pace)
        speed = speed_to_fly(speeds, price, along, across)
        sine = bounded((0.0 - across) / speed, -1.0, 1.0)
        x, y = turn(x, y, ti.sqrt(ti.max(1.0 - sine * sine, 0.0)), sine)
    return x, y, speed


@kernel
def act(
    seen: array2,
    commands: array2,
    room: rooms,
    target: ti.i32,
    others: ti.i32,
    position: ti.i32,
    current: ti.i32,
    rule: index2,
    unit: array1,
    number: array1,
    mean: array1,
    deviation: array1,
    speeds: array2,
    packed: tiles,
    bias: array1,
    layers: index2,
    auvs: ti.i32,
    networks: ti.i32,
    guided: ti.template(),
    observed: ti.template(),
    polar: ti.template(),
    serial: ti.template(),
):
    """The world's actions (W K, A) for observations (W K, O).

    Args:
        room: of each part of the AUVs, with place for an observation and twice for a layer.
        target, others, position, current: first columns of the terms.
        rule, unit: of features from `FIRST` on, which are divided by the unit.
        mean, deviation: of the features, (F,).
        speeds: see `speed_to_fly`. packed, bias, layers: of the networks, see `forward`.
        networks: 1 that AUVs share, or one for each of a world.
        guided: as `GuidedFrame`, else `TargetFrame`. observed: whether the current is.
        polar: actions are heading and speed. serial: the calling thread does it all.
    """
    ti.loop_config(serialize=serial, block_dim=1)
    for part in range(room.shape[0]):
        count = seen.shape[0] // networks
        first = seen.shape[1]
        second = (first + room.shape[1]) // 2
        first_group, end_of_groups = groups_of(part, room.shape[0], count, networks)
        for group in range(first_group, end_of_groups):
            network, rows = rows_of(group, count, networks)
            for column in range(seen.shape[1]):
                room[part, column] = ti.Vector([seen[rows[n], column] for n in ti.static(range(LANES))])
            end = first + TILE * layers[0, Layer.inputs]
            encode(room, part, target, others, rule, unit, number, mean, deviation, auvs, first, end)
            at = forward(packed, bias, layers, network, room, part, first, second)
            for component in range(2):
                room[part, at + component] = hyperbolic_tangent(room[part, at + component])
            x, y, speed = steer(
                room, part, at, target, others, position, current, number, speeds, auvs, guided, observed
            )
            slowest, fastest = number[FrameNumber.slowest], number[FrameNumber.fastest]
            if ti.static(polar):
                throttle = lanes(0.0)
                if fastest > slowest:
                    throttle = bounded((2.0 / (fastest - slowest)) * (speed - slowest) - 1.0, -1.0, 1.0)
                for n in ti.static(range(LANES)):
                    commands[rows[n], 0] = ti.atan2(y[n], x[n]) / math.pi
                    commands[rows[n], 1] = throttle[n]
            else:
                share_of_top = speed * (1.0 / fastest)
                x, y = bounded(x * share_of_top, -1.0, 1.0), bounded(y * share_of_top, -1.0, 1.0)
                for n in ti.static(range(LANES)):
                    commands[rows[n], 0] = x[n]
                    commands[rows[n], 1] = y[n]
                    if commands.shape[1] > 2:
                        commands[rows[n], 2] = number[FrameNumber.depth]


class Acting:
    """Acts for the AUVs of one batch of worlds, with memory of its own.

    Args:
        size: of observations, (W, K, O). columns: first ones of the target, others, position, and the current.
        rules: of features from `FIRST` on, `Rule` and unit.
        numbers: by name, see `FrameNumber`.
        speeds: among which `speed_to_fly` chooses, ascending, and their powers, m/s and W; None: not `guided`.
        polar: actions are heading and speed. commands: A, numbers of the world's action.
        mean, deviation: of the features, (F,); may change in place.
        weights, biases: of each layer of the actors, one for each AUV or a shared one, see `Packed`; of the outputs the
            first two count, after a tanh.
    """

    def __init__(
        self,
        size: tuple[int, int, int],
        columns: Sequence[int | None],
        rules: Sequence[tuple[int, int, int, float]],
        numbers: Mapping[str, float],
        speeds: tuple[torch.Tensor, torch.Tensor] | None,
        polar: bool,
        commands: int,
        mean: torch.Tensor,
        deviation: torch.Tensor,
        weights: Sequence[torch.Tensor],
        biases: Sequence[torch.Tensor],
    ) -> None:
        worlds, auvs, observed = size
        count = worlds * auvs
        alike: Any = {"dtype": torch.float32, "device": "cpu"}  # whatever a program has made torch's defaults
        self._seen, self._command = torch.zeros(size, **alike), torch.zeros(worlds, auvs, commands, **alike)
        self._packed = Packed(weights, biases)
        self._act = Launch(
            act,
            self._seen.view(count, -1),
            self._command.view(count, -1),
            self._packed.room(count, observed),
            *(column or 0 for column in columns),
            torch.tensor([each[:3] for each in rules], dtype=torch.int32, device="cpu"),
            torch.tensor([each[3] for each in rules], **alike),
            torch.tensor([numbers[name] for name in FrameNumber.names], **alike),
            mean,
            deviation,
            torch.zeros(2, 1, **alike) if speeds is None else torch.stack(speeds).to(**alike),
            *self._packed.arguments,
            auvs,
            self._packed.networks,
            *(speeds is not None, columns[3] is not None, polar, runtime.too_few_for_threads(count)),
            settings={**runtime.vectors_in_registers(), **runtime.fast_compilation()},
        )

    def __call__(self, observation: torch.Tensor) -> torch.Tensor:
        """Actions (W, K, A) for observations (W, K, O)."""
        self._seen.copy_(observation)
        self._packed.refresh()
        self._act()
        return self._command.clone()
