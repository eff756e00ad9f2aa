"""Equations of the heuristics `loiter` and `pass`, see `usvauv.policies.heuristics.passing`."""

import taichi as ti

from usvauv.kernels.guidance.courses import chosen, direction, dot, exit_distance, reachable, round_circle, unrotate
from usvauv.kernels.guidance.elementary import equation, maximum, minimum, select, sqrt
from usvauv.kernels.types import Columns

LOOKAHEAD = 0.5  # of a circle, over its radius
BORDER = 3.0  # m, distance of a circle from the border
FAR = 1e3  # m
LEAST_GROUND = 0.2  # m/s made good, lower bound when times are computed
LEAST_WAY = 1e-6  # m, lower bound of what is divided by
UNLIMITED = 1e30  # m/s


class Task(Columns):
    """Numbers of the AUVs and their task on the way past nodes."""

    width: int  # of the area, m
    length: int
    radius: int  # of the circle about a node, m
    inside: int  # distance from a node within which paths count as in range, m
    turning: int  # least radius on which the vehicle turns, m
    near: int  # distance from a point that is taken as passed, m
    slowest: int  # speed through the water, m/s
    step: int  # of the mission, s
    filled: int  # time to collect a full buffer, s


@equation
def circling(here, offset, course, task: ti.template()):
    """Direction over ground on a tangent to the circle about a node at an offset (m), or round it.

    The AUV at `here` (m) keeps the centre on its present side of its course.
    """
    least = task[Task.radius] + BORDER
    x = minimum(maximum(here[0] + offset[0], least), max(task[Task.width] - least, 0.0)) - here[0]
    y = minimum(maximum(here[1] + offset[1], least), max(task[Task.length] - least, 0.0)) - here[1]
    _, left = unrotate((x, y), course)
    side = select(left > 0.0, 1.0, -1.0)
    track, _ = round_circle((x, y), task[Task.radius], LOOKAHEAD * task[Task.radius], side)
    return track


@equation
def loiter(here, offset, course, serving, task: ti.template()):
    """Direction over ground and highest speed over ground of `loiter`, m/s.

    Args:
        here: the AUV's position, m. offset: of the node from it, m.
        course: present direction over ground. serving: whether data come in, 1 or 0.
    """
    within = (serving > 0.5) | (dot(offset, offset) < task[Task.inside] * task[Task.inside])
    return circling(here, offset, course, task), select(within, 0.0, UNLIMITED)


@equation
def passing(here, offset, following, course, current, serving, left, task: ti.template()):
    """Direction over ground and highest speed over ground of `pass`, m/s; arguments as of `loiter`.

    Args:
        following: offset of the next node from this one, m; 0 if unknown.
        current: at the AUV, m/s. left: share of the buffer that is still to be collected.
    """
    inside, slowest = task[Task.inside], task[Task.slowest]
    time = left * task[Task.filled] + task[Task.step] * (2.0 - serving)
    straight, distance = direction(offset)
    within = distance < inside
    # The line to the next node; if that is unknown, through this one.
    on = chosen(within, course, straight)
    to_next = chosen(dot(following, following) > 0.0, following, (FAR * on[0], FAR * on[1]))
    after = offset[0] + to_next[0], offset[1] + to_next[1]
    share = minimum(maximum(dot(offset, after) / maximum(dot(after, after), LEAST_WAY), 0.0), 1.0)
    # Its nearest point to the node, drawn in until the chord within range takes long enough.
    aside = share * after[0] - offset[0], share * after[1] - offset[1]
    shortest = 0.5 * slowest * time
    farthest = sqrt(maximum(inside * inside - shortest * shortest, 0.0))
    drawn = minimum(farthest / maximum(sqrt(dot(aside, aside)), LEAST_WAY), 1.0)
    via = offset[0] + drawn * aside[0], offset[1] + drawn * aside[1]
    passed = within & ((share <= 0.0) | (dot(via, via) < task[Task.near] * task[Task.near]))
    rest = chosen(passed, (0.0, 0.0), via)
    onwards, _ = direction((after[0] - rest[0], after[1] - rest[1]))
    chord = sqrt(dot(rest, rest)) + exit_distance(rest, onwards, offset, inside)
    ahead = reachable(chosen(passed, after, via), course, task[Task.turning])
    # The speed that leaves the range when the data are out, or a circle where the lowest one is too high.
    short = within & (chord < maximum(slowest + dot(current, ahead), LEAST_GROUND) * time)
    most = select(within, select(short, 0.0, chord / time), UNLIMITED)
    return chosen(short, circling(here, offset, course, task), ahead), most
