"""The task of collecting data: buffers of nodes fill, AUVs go there and collect the data, hovering or in passing.

Packets arrive at each node as a Poisson process with one of a few rates, drawn by inversion of the distribution from a
table. A row of the table holds one rate, a guide, and the cumulative distribution of the number of arrivals in a
mission step. The guide holds for each of GUIDE equal parts of (0, 1) the smallest count n that a number in it can give,
and P(N ≤ n), above which it gives n + 1. Where it can give more, the guide holds −1 − n, and the search begins at n.
Source: Chen and Asau (1974), "On generating random variates from an empirical distribution", AIIE Transactions 6(2),
doi 10.1080/05695557408974949.
"""

import math
from collections.abc import Sequence

import numpy as np
import taichi as ti

from usvauv.kernels.flow.current import grid_sample
from usvauv.kernels.functions import func
from usvauv.kernels.mission.auvs.motion import distance_to_target, hold, is_spent, offset_to_target, target_of, travel
from usvauv.kernels.mission.columns import Draw, Information
from usvauv.kernels.mission.draws import uniforms
from usvauv.kernels.mission.target_rules import knowledge, share_nodes
from usvauv.kernels.mission.tasks import rewards
from usvauv.kernels.mission.tasks.task import Task, tasks
from usvauv.kernels.positioning import sonar
from usvauv.kernels.types import vec2

GUIDE = 512
RATE = 0  # column of the rate; the guide and the cumulative distribution follow
CUMULATIVE = 1 + 2 * GUIDE
TAIL = 2.0**-26  # probability beyond the end of a table; 1 − 2⁻²⁶ rounds to 1 in single precision


def _cumulative(mean: float) -> np.ndarray:
    """P(N ≤ 0), P(N ≤ 1), … of a Poisson number until `TAIL` is left."""
    probability = below = math.exp(-mean)
    values = [below]
    while 1.0 - below > TAIL:
        probability *= mean / len(values)
        below += probability
        values.append(below)
    return np.array(values)


def arrival_table(rates: Sequence[float], step: float) -> np.ndarray:
    """The table of some rates (packets/s) and a mission step (s), (len(rates), CUMULATIVE + counts) float32."""
    rows = [_cumulative(rate * step) for rate in rates]
    filled = np.ones((len(rows), CUMULATIVE + max(map(len, rows))), np.float32)
    for row, rate, cumulative in zip(filled, rates, rows, strict=True):
        row[RATE] = rate
        row[CUMULATIVE : CUMULATIVE + len(cumulative) - 1] = cumulative[:-1]  # the last is 1
        counts = np.searchsorted(row[CUMULATIVE:], np.arange(GUIDE + 1) / GUIDE)
        first = counts[:-1]
        row[1:CUMULATIVE:2] = np.where(np.diff(counts) <= 1, first, -1 - first)
        row[2:CUMULATIVE:2] = row[CUMULATIVE + first]
    return filled


@func
def draw_arrivals(arrivals: ti.template(), row: ti.i32, u: ti.f32) -> ti.f32:
    """The Poisson number of a row at a uniform number u in (0, 1): the smallest count with P(N ≤ count) ≥ u."""
    part = 1 + 2 * ti.cast(u * GUIDE, ti.i32)
    count = arrivals[row, part]
    if count >= 0.0:
        count += ti.select(u > arrivals[row, part + 1], 1.0, 0.0)
    else:
        count = -1.0 - count
        while u > arrivals[row, CUMULATIVE + ti.cast(count, ti.i32)]:
            count += 1.0
    return count


LEAST_RATE = 1e-9  # Mbit/s; below it the link is dead, and the AUV hovers for the rest of the mission


@func
def place_nodes(worlds: ti.template(), w):
    """Scatter the nodes of a new episode over the bed, with a backlog in each."""
    p = ti.static(worlds.p)
    node = ti.static(worlds.node)
    num_kinds = worlds.arrivals.shape[0]
    for i in range(node.shape[1]):
        u = uniforms(worlds, w, Draw.node, i)
        margin = p.node_margin
        node.x[w, i] = margin + u[0] * (p.width - 2 * margin)
        node.y[w, i] = margin + u[1] * (p.length - 2 * margin)
        kind = ti.min(ti.cast(u[2] * num_kinds, ti.i32), num_kinds - 1)
        node.kind[w, i] = ti.cast(kind, ti.f32)
        node.rate[w, i] = worlds.arrivals[kind, RATE]
        backlog = ti.floor(u[3] * (p.start_backlog + 1.0))
        node.backlog[w, i] = ti.min(backlog, p.start_backlog)  # the product may be rounded up
        node.tour[w, i] = 0.0
        node.successor[w, i] = 0.0
        node.owner[w, i] = 0.0
    knowledge.begin(worlds, w)


@func
def choose_target(worlds: ti.template(), w, k):
    """Send AUV k to the node that the target rule chooses."""
    worlds.auv.target[w, k] = ti.cast(worlds.program.target_rule.choose(worlds, w, k), ti.f32)


@func
def assign(worlds: ti.template(), w, k):
    """The first target of AUV k, with which AUV 0 is the first."""
    if k == 0:
        if ti.static(worlds.program.information == Information.own_visits):
            share_nodes(worlds, w)
        worlds.program.target_rule.prepare(worlds, w)
    choose_target(worlds, w, k)


@func
def unclaimed(worlds: ti.template(), w, i):
    """Packets of node i that no service under way will take; two AUVs may serve one node."""
    packets = worlds.node.backlog[w, i]
    for j in range(worlds.auv.shape[1]):
        if ti.cast(worlds.auv.target[w, j], ti.i32) == i:
            packets -= ti.ceil(worlds.auv.cargo[w, j])
    return packets


@func
def megabits(p: ti.template(), packets):
    """Data in some packets, Mbit."""
    return p.payload * packets / p.buffer


@func
def slant_range(worlds: ti.template(), w, k, distance):
    """From AUV k to its node on the bed, at a horizontal distance, m."""
    p = ti.static(worlds.p)
    target = target_of(worlds, w, k)
    x = worlds.node.x[w, target]
    y = worlds.node.y[w, target]
    separation = p.separation_node
    if separation == 0.0:
        depth = grid_sample(worlds.water.bed, 0, 0, x, y, p.width, p.length)
        separation = depth - p.cruise - worlds.auv.depth_error[w, k]
    return ti.sqrt(distance * distance + separation * separation)


@func
def link_rate(worlds: ti.template(), slant):
    """Rate of the data link at a slant range (m), Mbit/s; at least `LEAST_RATE`."""
    p = ti.static(worlds.p)
    loss = sonar.path_loss(slant, p.data_spreading, p.data_absorption)
    snr = p.data_level - loss
    bits = worlds.program.rate_law(p.data_bandwidth, p.rate_max, snr)
    return ti.max(1e-6 * bits, LEAST_RATE)


@func
def begin_service(worlds: ti.template(), w, k, slant):
    """Set the packets to take, the link's rate at a slant range (m), and how long AUV k hovers for it."""
    p = ti.static(worlds.p)
    auv = ti.static(worlds.auv)
    target = target_of(worlds, w, k)
    rate = link_rate(worlds, slant)
    cargo = unclaimed(worlds, w, target)
    knowledge.learn(worlds, w, k, target, cargo)
    auv.rate[w, k] = rate
    auv.cargo[w, k] = cargo
    auv.hover[w, k] = ti.max(megabits(p, cargo) / rate, 1e-3 * p.step)


@func
def write_progress(worlds: ti.template(), w, k, before, after):
    """The reward's quantity of distance, by the distances to the target before and after a step, m."""
    auv = ti.static(worlds.auv)
    if worlds.flag.progress != 0:
        auv.closed[w, k] = before - after
    else:
        auv.closed[w, k] = -after


@func
def move_and_hover(worlds: ti.template(), w, k, a0, a1):
    """One step of AUV k: hover and receive, or travel with the current.

    Data flow in a step that begins within the hover radius. An AUV that the current has carried out of it heads back;
    its service continues when it is there.
    """
    p = ti.static(worlds.p)
    auv = ti.static(worlds.auv)
    before = auv.distance[w, k]
    after = before
    if auv.hover[w, k] > 0.0:
        wanted = vec2(0.0)
        if before > p.hover_radius:
            wanted = offset_to_target(worlds, w, k) / p.step
        else:
            auv.hover[w, k] = ti.max(auv.hover[w, k] - p.step, 0.0)
        hold(worlds, w, k, wanted)
        after = distance_to_target(worlds, w, k)
        auv.hovering[w, k] = 1.0
        if auv.hover[w, k] == 0.0:
            auv.service_rate[w, k] = auv.rate[w, k]
            auv.packets_delivered[w, k] = auv.cargo[w, k]
            auv.delivered[w, k] = megabits(p, auv.cargo[w, k])
    else:
        travel(worlds, w, k, a0, a1)
        after = distance_to_target(worlds, w, k)
        if after <= p.hover_radius and not is_spent(worlds, w, k):
            begin_service(worlds, w, k, slant_range(worlds, w, k, after))
    write_progress(worlds, w, k, before, after)


@func
def is_within_range(worlds: ti.template(), slant) -> bool:
    """Whether a node at a slant range (m) is served in passing: within `nodes.service_range`, by a link that works."""
    return slant <= worlds.p.service_range and link_rate(worlds, slant) > LEAST_RATE


@func
def collect_in_passing(worlds: ti.template(), w, k, distance):
    """What AUV k takes from its node in a step of travelling that has ended at this horizontal distance, m.

    A service begins with the step after the one in which the AUV comes within range, and ends with the step in which
    its last packet is across, or the AUV out of range: what has not been sent stays in the node. In between data flow
    in each step at the rate r of the slant range half way through it. `cargo` counts the packets that are left with the
    part of one that is on its way; packets come in whole: ⌈cargo⌉ before the step less ⌈cargo⌉ after it.
    """
    p = ti.static(worlds.p)
    auv = ti.static(worlds.auv)
    slant = slant_range(worlds, w, k, distance)
    within = is_within_range(worlds, slant) and not is_spent(worlds, w, k)
    if auv.hover[w, k] > 0.0:
        half = 0.5 * vec2(auv.moved_x[w, k], auv.moved_y[w, k])
        middle = (offset_to_target(worlds, w, k) + half).norm()
        rate = link_rate(worlds, slant_range(worlds, w, k, middle))
        before = auv.cargo[w, k]
        left = ti.max(before - rate * p.step * p.buffer / p.payload, 0.0)
        packets = ti.ceil(before) - ti.ceil(left)
        target = target_of(worlds, w, k)
        worlds.node.backlog[w, target] = worlds.node.backlog[w, target] - packets
        auv.hovering[w, k] = 1.0
        auv.rate[w, k] = rate
        auv.cargo[w, k] = left
        auv.packets_delivered[w, k] = packets
        auv.delivered[w, k] = megabits(p, packets)
        auv.hover[w, k] = ti.max(megabits(p, left) / rate, 1e-3 * p.step)
        if left == 0.0:
            auv.service_rate[w, k] = rate
            auv.hover[w, k] = 0.0
        elif not within:
            knowledge.leave(worlds, w, k, target, ti.ceil(left))
            auv.hover[w, k] = 0.0
    elif within:
        begin_service(worlds, w, k, slant)


@func
def move_in_passing(worlds: ti.template(), w, k, a0, a1):
    """One step of AUV k, which travels as commanded and collects data once it is within range of its node.

    Progress towards the node counts as far as its range: inside, the data do.
    """
    p = ti.static(worlds.p)
    edge = 0.0
    if worlds.flag.progress != 0:
        edge = p.hover_radius
    before = ti.max(worlds.auv.distance[w, k] - edge, 0.0)
    travel(worlds, w, k, a0, a1)
    distance = distance_to_target(worlds, w, k)
    collect_in_passing(worlds, w, k, distance)
    write_progress(worlds, w, k, before, ti.max(distance - edge, 0.0))


@func
def move(worlds: ti.template(), w, k, a0, a1):
    """One step of AUV k."""
    if ti.static(worlds.program.passing):
        move_in_passing(worlds, w, k, a0, a1)
    else:
        move_and_hover(worlds, w, k, a0, a1)


@func
def fill_nodes(worlds: ti.template(), w):
    """Poisson arrivals at every node; what a full buffer cannot hold is lost. Both are counted."""
    node = ti.static(worlds.node)
    buffer = worlds.p.buffer
    overflowing = 0.0
    created = 0.0
    lost = 0.0
    for group in range((node.shape[1] + 3) // 4):
        u = uniforms(worlds, w, Draw.arrival, group)
        for part in ti.static(range(4)):
            i = 4 * group + part
            if i < node.shape[1]:
                kind = ti.cast(node.kind[w, i], ti.i32)
                arrivals = draw_arrivals(worlds.arrivals, kind, u[part])
                backlog = node.backlog[w, i] + arrivals
                created += arrivals
                lost += ti.max(backlog - buffer, 0.0)
                overflowing += ti.select(backlog > buffer, 1.0, 0.0)
                node.backlog[w, i] = ti.min(backlog, buffer)
    worlds.tally.overflowing[w] = overflowing
    worlds.tally.packets_created[w] = created
    worlds.tally.packets_lost[w] = lost


@func
def complete_services(worlds: ti.template(), w):
    """Take the packets of the services completed in this step from their nodes, and send their AUVs on.

    What arrived during a service stays in the buffer. In passing packets have been taken as they came, and a service
    that breaks off sends its AUV on too.
    """
    for k in range(worlds.auv.shape[1]):
        ended = worlds.auv.service_rate[w, k] > 0.0
        if ti.static(worlds.program.passing):
            ended = worlds.auv.hovering[w, k] != 0.0 and worlds.auv.hover[w, k] == 0.0
        elif ended:
            target = target_of(worlds, w, k)
            worlds.node.backlog[w, target] = worlds.node.backlog[w, target] - worlds.auv.packets_delivered[w, k]
        if ended:
            worlds.auv.cargo[w, k] = 0.0
            choose_target(worlds, w, k)


tasks.register(
    "data-collection",
    Task(
        place=place_nodes,
        assign=assign,
        move=move,
        update=fill_nodes,
        finish=complete_services,
        reward_terms=rewards.STANDARD,
    ),
)
