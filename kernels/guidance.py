"""Features of AUVs and their commands on a CPU, each in one pass over all AUVs.

Except for rounding equal to `TargetFrame` and `GuidedFrame` of `usvauv.policies.frames`, which have the equations in
some hundred operations of torch: for few AUVs mostly overhead, for many a pass over memory each.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import taichi as ti
import torch

from usvauv.kernels import runtime
from usvauv.kernels.functions import Launch, func, kernel
from usvauv.kernels.trigonometry import half_cosine, half_sine
from usvauv.kernels.types import Columns, array1, array2, index2, vec2, vec4

LEAST = 1e-18  # added to no effect, but that a zero vector has a direction; its square is above zero
TINY = 1e-9
NEAREST = 1e-3  # m, smaller distances between AUVs repel like it
LEAST_ADVANCE = 0.05  # m/s over ground, lower bound on headway
HOPELESS = 1e6  # J/m, above every cost with headway
CLIP = 8.0  # of standardised features
FIRST = 9  # features of the target and the other AUVs, which come before those by `Rule`
SIDE = 8  # speeds side by side
STEEP = 1e30  # makes any difference larger than all that it is compared with

side = ti.types.vector(SIDE, ti.f32)
sides = ti.types.ndarray(dtype=side, ndim=2)


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
def direction(v: vec2):
    """Unit vector and length of a vector; (1, 0) and `LEAST` of a zero vector."""
    x = v[0] + LEAST
    length = ti.sqrt(x * x + v[1] * v[1])
    return vec2(x / length, v[1] / length), length


@func
def turn(v: vec2, cosine, sine) -> vec2:
    """A vector turned to the left."""
    return vec2(cosine * v[0] - sine * v[1], cosine * v[1] + sine * v[0])


@func
def along_and_left(v: vec2, ahead: vec2) -> vec2:
    return vec2(v[0] * ahead[0] + v[1] * ahead[1], v[1] * ahead[0] - v[0] * ahead[1])


@func
def pair(seen: ti.template(), n, column) -> vec2:
    return vec2(seen[n, column], seen[n, column + 1])


@func
def row(n, auvs, count, shared: ti.template()):
    """Where the networks have AUV n of all worlds: world by world if all AUVs share one, else AUV by AUV."""
    place = n
    if ti.static(not shared):
        place = (n % auvs) * (count // auvs) + n // auvs
    return place


@func
def least(v: side) -> ti.f32:
    """Of the lanes."""
    four = vec4([ti.min(v[n], v[n + 4]) for n in ti.static(range(4))])
    return ti.min(ti.min(four[0], four[1]), ti.min(four[2], four[3]))


@kernel
def encode(
    seen: array2,
    target: ti.i32,
    others: ti.i32,
    rule: index2,
    unit: array1,
    number: array1,
    mean: array1,
    deviation: array1,
    features: array2,
    auvs: ti.i32,
    shared: ti.template(),
    serial: ti.template(),
):
    """Standardised features (W K, F), see `TargetFrame`, of observations (W K, O).

    Args:
        target, others: first columns of the terms.
        rule, unit: of features from `FIRST` on, which are divided by the unit.
        mean, deviation: (F,).
        shared: whether AUVs share a network, see `row`. serial: the calling thread does it all.
    """
    ti.loop_config(serialize=serial)
    for n in range(seen.shape[0]):
        place = row(n, auvs, seen.shape[0], shared)
        reach = number[FrameNumber.reach]
        bearing, distance = direction(pair(seen, n, target))
        nearest, pull = vec2(0.0), vec2(0.0)
        closest, least_distance = 0.0, math.inf
        for j in range(auvs - 1):
            other = along_and_left(pair(seen, n, others + 2 * j), bearing)
            away = ti.sqrt(other[0] * other[0] + other[1] * other[1])
            closeness = ti.exp(-away / reach)
            pull += closeness * other / ti.max(away, TINY)
            closest = ti.max(closest, closeness)
            if away < least_distance:
                least_distance, nearest = away, other
        first = ti.Vector(
            [
                distance,
                ti.exp(-distance / reach),
                bearing[0],
                bearing[1],
                nearest[0],
                nearest[1],
                pull[0],
                pull[1],
                closest,
            ]
        )
        for f in ti.static(range(FIRST)):
            features[place, f] = ti.min(ti.max((first[f] - mean[f]) / deviation[f], -CLIP), CLIP)
        for f in range(FIRST, features.shape[1]):
            x = seen[n, rule[f - FIRST, Rule.x]] / unit[f - FIRST]
            if rule[f - FIRST, Rule.turned] != 0:
                y = seen[n, rule[f - FIRST, Rule.y]] / unit[f - FIRST]
                turned = along_and_left(vec2(x, y), bearing)
                x = turned[0] if rule[f - FIRST, Rule.turned] == 1 else turned[1]
            features[place, f] = ti.min(ti.max((x - mean[f]) / deviation[f], -CLIP), CLIP)


@func
def clear_of_others(seen: ti.template(), n, others, auvs, ahead: vec2, number: ti.template()) -> vec2:
    """See `usvauv.policies.guidance.clear_of_others`."""
    track = ahead
    if auvs > 1:
        away, nearest = vec2(0.0), math.inf
        for j in range(auvs - 1):
            towards, distance = direction(number[FrameNumber.diagonal] * pair(seen, n, others + 2 * j))
            if distance < nearest:
                away, nearest = towards, distance
        ratio = (1.0 / ti.max(nearest, NEAREST)) * number[FrameNumber.repelled]
        track = direction(ahead - ti.max(ratio - 1.0, 0.0) * (ratio * ratio) * away)[0]
    return track


@func
def clear_of_border(position: vec2, track: vec2, number: ti.template()) -> vec2:
    """A course that does not lead out of the area."""
    inside = track
    for c in ti.static(range(2)):
        low = position[c] < number[FrameNumber.margin] and track[c] < 0.0
        if low or (position[c] > number[FrameNumber.east + c] and track[c] > 0.0):
            inside[c] = 0.0
    course, length = direction(inside)
    return course if length > TINY else track


@func
def speed_to_fly(speeds: ti.template(), price, along, across) -> ti.f32:
    """See `usvauv.policies.guidance.SpeedToFly`; `speeds` (2, ·) are speeds and powers, the last one more than once.

    Vectors in registers have no comparison; 1 stands for a yes.
    """
    best, lowest = side(0.0), side(math.inf)  # of each lane, and its cost, J/m
    for g in range(speeds.shape[1]):
        speed = speeds[0, g]
        advance = ti.sqrt(ti.max(speed * speed - across * across, 0.0)) + along
        backwards = ti.min(ti.max(STEEP * (LEAST_ADVANCE - advance), 0.0), 1.0)
        cost = ti.max((speeds[1, g] + price) / ti.max(advance, LEAST_ADVANCE), backwards * (HOPELESS - advance))
        better = ti.min(ti.max(STEEP * (lowest - cost), 0.0), 1.0)
        best = better * speed + (1.0 - better) * best
        lowest = ti.min(lowest, cost)
    return least(best + STEEP * (lowest - least(lowest)))  # of equal costs the lowest speed


@kernel
def steer(
    seen: array2,
    action: array2,
    target: ti.i32,
    others: ti.i32,
    position: ti.i32,
    current: ti.i32,
    number: array1,
    speeds: sides,
    commands: array2,
    auvs: ti.i32,
    guided: ti.template(),
    observed: ti.template(),
    polar: ti.template(),
    shared: ti.template(),
    serial: ti.template(),
):
    """The world's actions (W K, A) for the networks' (W K, 2), see `TargetFrame`, or if `guided`, `GuidedFrame`.

    Args:
        target, others, position, current: first columns of the terms of observations `seen` (W K, O).
        speeds: see `speed_to_fly`. observed: whether the current is. polar: actions are heading and speed.
        shared, serial: as of `encode`.
    """
    ti.loop_config(serialize=serial)
    for n in range(seen.shape[0]):
        place = row(n, auvs, seen.shape[0], shared)
        ahead = direction(pair(seen, n, target))[0]
        if ti.static(guided):
            ahead = clear_of_others(seen, n, others, auvs, ahead, number)
        half = 0.5 * action[place, 0]  # turns
        cosine, sine = half_cosine(half), half_sine(half)
        heading = turn(ahead, 1.0 - 2.0 * sine * sine, 2.0 * sine * cosine)
        slowest, span = number[FrameNumber.slowest], number[FrameNumber.fastest] - number[FrameNumber.slowest]
        speed = slowest + span * (action[place, 1] + 1.0) / 2.0
        if ti.static(guided):
            track = clear_of_border(number[FrameNumber.diagonal] * pair(seen, n, position), heading, number)
            flow = vec2(0.0)
            if ti.static(observed):
                flow = along_and_left(pair(seen, n, current), track)
            price = number[FrameNumber.price] * ti.exp(number[FrameNumber.gain] * action[place, 1])
            speed = speed_to_fly(speeds, price, flow[0], flow[1])
            sine = ti.min(ti.max(-flow[1] / speed, -1.0), 1.0)
            heading = turn(track, ti.sqrt(ti.max(1.0 - sine * sine, 0.0)), sine)
        if ti.static(polar):
            throttle = 2.0 * (speed - slowest) / span - 1.0 if span > 0.0 else 0.0
            commands[n, 0] = ti.atan2(heading[1], heading[0]) / math.pi
            commands[n, 1] = ti.min(ti.max(throttle, -1.0), 1.0)
        else:
            for c in ti.static(range(2)):
                commands[n, c] = ti.min(ti.max(heading[c] * (speed / number[FrameNumber.fastest]), -1.0), 1.0)
            if commands.shape[1] > 2:
                commands[n, 2] = number[FrameNumber.depth]


class Passes:
    """Both passes for the AUVs of one batch of worlds, with memory of their own.

    Args:
        size: of observations, (W, K, O). columns: first ones of the target, others, position, and the current.
        rules: of features from `FIRST` on, `Rule` and unit.
        numbers: by name, see `FrameNumber`.
        speeds: among which `speed_to_fly` chooses, and their powers, m/s and W; None: not `guided`.
        polar: actions are heading and speed. commands: A, numbers of the world's action.
        mean, deviation: of the features, (F,); may change in place.
        shared: whether AUVs share a network.
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
        shared: bool,
    ) -> None:
        worlds, auvs, _ = size
        count = worlds * auvs
        alike: Any = {"dtype": torch.float32, "device": "cpu"}  # whatever a program has made torch's defaults
        stacked = (1, count) if shared else (auvs, worlds)
        self.observation, self.command = torch.zeros(size, **alike), torch.zeros(worlds, auvs, commands, **alike)
        self.features, self.action = torch.zeros(*stacked, len(mean), **alike), torch.zeros(*stacked, 2, **alike)
        seen, features, action, command = (
            array.view(count, -1) for array in (self.observation, self.features, self.action, self.command)
        )
        number = torch.tensor([numbers[name] for name in FrameNumber.names], **alike)
        rule = torch.tensor([each[:3] for each in rules], dtype=torch.int32, device="cpu")
        unit = torch.tensor([each[3] for each in rules], **alike)
        table = torch.zeros(2, 1, SIDE, **alike) if speeds is None else torch.stack([_padded(each) for each in speeds])
        first = [column or 0 for column in columns]
        forms = speeds is not None, columns[3] is not None, polar
        team = shared, runtime.better_alone(count)
        self.encode = Launch(encode, seen, *first[:2], rule, unit, number, mean, deviation, features, auvs, *team)
        self.steer = Launch(
            *(steer, seen, action, *first, number, table, command, auvs, *forms, *team),
            settings=runtime.vectors_in_registers(),
        )


def _padded(table: torch.Tensor) -> torch.Tensor:
    """In rows of `SIDE` numbers, the last one more than once."""
    table = table.to("cpu", torch.float32)
    return torch.cat((table, table[-1:].expand(-len(table) % SIDE))).view(-1, SIDE)
