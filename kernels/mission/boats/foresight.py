"""The boat's prediction of its AUVs: their places, and how uncertain they are of them.

Each reply contains the AUV's target node and its speed. From there on the boat predicts that the AUV travels from node
to node as expected from the target rule, with a typical service at each; an AUV so uncertain of its own position that
it misses its node waits there.
"""

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.mission.boats import boat_motion
from usvauv.kernels.mission.columns import AuvColumn, ExchangeColumn, ForesightColumn, NodeColumn, Parameter
from usvauv.kernels.positioning import tracker
from usvauv.kernels.types import vec2, vec3

LEARNED = 0.1  # share of the predicted speed that each reply renews
SLOWEST = 1e-3  # m/s, of a predicted AUV


@ti.dataclass
class PredictedAuv:
    """Predicted state of an AUV.

    Attributes:
        place: m.
        node: its target.
        hovers: remaining time of its service at this node, s; in passing it continues towards it.
        speed: m/s.
    """

    place: vec2
    node: ti.i32
    hovers: ti.f32
    speed: ti.f32


@func
def drift_over(worlds: ti.template(), time) -> tracker.Drift:
    """The drift of AUVs over a time, s."""
    p = ti.static(worlds.p)
    return tracker.drift_over(
        time, p[Parameter.current_variance], p[Parameter.correlation_time], p[Parameter.velocity_walk]
    )


@func
def own_uncertainty(worlds: ti.template(), w, k) -> vec3:
    """(a, b, c) of the errors of AUV k's own position and current at present, with the fixes that the boat has made."""
    track = ti.static(worlds.track)
    a = 0.5 * (track[w, k, tracker.XX] + track[w, k, tracker.YY])
    b = 0.5 * (track[w, k, tracker.XU] + track[w, k, tracker.YV])
    c = 0.5 * (track[w, k, tracker.UU] + track[w, k, tracker.VV])
    return vec3(tracker.drifted(a, b, c, drift_over(worlds, worlds.exchange[w, k, ExchangeColumn.elapsed])))


@func
def works_within(worlds: ti.template()) -> ti.f32:
    """Largest error (m) of its own position with which an AUV still finds its node."""
    return ti.max(worlds.p[Parameter.hover_radius], worlds.p[Parameter.homing_range])


@func
def approached(worlds: ti.template(), w, way: PredictedAuv, time) -> vec2:
    """Position of an AUV that has gone straight towards its node for some time (s), at most to it, m."""
    node = ti.static(worlds.node)
    ahead = vec2(node[w, way.node, NodeColumn.x], node[w, way.node, NodeColumn.y]) - way.place
    distance = ahead.norm()
    return way.place + ti.min(way.speed * time / ti.max(distance, 1e-6), 1.0) * ahead


@func
def advanced(worlds: ti.template(), w, way: PredictedAuv, time, lost: ti.i32) -> PredictedAuv:
    """An AUV's state after some time (s); one that is lost goes no farther than to its target."""
    p = ti.static(worlds.p)
    node = ti.static(worlds.node)
    left = time
    for _ in range(8):
        if left <= 0.0:
            break
        if way.hovers > 0.0:
            spent = ti.min(way.hovers, left)
            if ti.static(worlds.program.passing):
                way.place = approached(worlds, w, way, spent)
            way.hovers -= spent
            left -= spent
            if way.hovers <= 0.0:
                way.node = worlds.program.target_rule.foreseen(worlds, w, way.node)
        else:
            there = vec2(node[w, way.node, NodeColumn.x], node[w, way.node, NodeColumn.y])
            ahead = there - way.place
            distance = ahead.norm()
            to_go = distance
            if ti.static(worlds.program.passing):
                to_go = ti.max(distance - p[Parameter.hover_radius], 0.0)
            speed = ti.max(way.speed, SLOWEST)
            if to_go > speed * left:
                way.place += speed * left / distance * ahead
                left = 0.0
            else:
                if ti.static(worlds.program.passing):
                    way.place += to_go / ti.max(distance, 1e-6) * ahead
                else:
                    way.place = there
                left -= to_go / speed
                if lost:
                    left = 0.0
                else:
                    way.hovers = p[Parameter.service_time]
    return way


@func
def may_arrive(worlds: ti.template(), w, way: PredictedAuv, time):
    """Whether an AUV may come to a node within some time, s; at most by one in a hundred farther than it gets."""
    node = ti.static(worlds.node)
    away = vec2(node[w, way.node, NodeColumn.x], node[w, way.node, NodeColumn.y]) - way.place
    farthest = worlds.p[Parameter.hover_radius] + 1.01 * ti.max(way.speed, SLOWEST) * time
    return way.hovers <= time and away.norm_sqr() <= farthest * farthest


@func
def remembered(worlds: ti.template(), w, k) -> PredictedAuv:
    """The boat's present prediction of AUV k."""
    foresight = ti.static(worlds.foresight)
    return PredictedAuv(
        place=vec2(foresight[w, k, ForesightColumn.x], foresight[w, k, ForesightColumn.y]),
        node=ti.cast(foresight[w, k, ForesightColumn.heads_for], ti.i32),
        hovers=foresight[w, k, ForesightColumn.hovers],
        speed=foresight[w, k, ForesightColumn.speed],
    )


@func
def foresee(worlds: ti.template(), w, k):
    """Advance the prediction of AUV k to the present: from the previous one, or from a new reply."""
    foresight = ti.static(worlds.foresight)
    exchange = ti.static(worlds.exchange)
    way = remembered(worlds, w, k)
    elapsed = exchange[w, k, ExchangeColumn.elapsed]
    time = elapsed - foresight[w, k, ForesightColumn.elapsed]
    news = time < 0.999 * worlds.p[Parameter.step]  # a reply was received in the step before
    if worlds.clock[w, 1] == 1:  # the first node is given at deployment
        exchange[w, k, ExchangeColumn.heads_for] = worlds.auv[w, k, AuvColumn.target]
        news = True
    if news:
        way.place = vec2(worlds.track[w, k, tracker.X], worlds.track[w, k, tracker.Y])
        way.node = ti.cast(exchange[w, k, ExchangeColumn.heads_for], ti.i32)
        way.hovers = exchange[w, k, ExchangeColumn.hovers]
        if way.hovers == 0.0:
            speed = vec2(exchange[w, k, ExchangeColumn.velocity_x], exchange[w, k, ExchangeColumn.velocity_y]).norm()
            if speed > 0.5 * worlds.p[Parameter.speed_min]:
                way.speed += LEARNED * (speed - way.speed)
        time = elapsed
    lost = 0
    if may_arrive(worlds, w, way, time):  # where it matters
        works = works_within(worlds)
        lost = ti.cast(own_uncertainty(worlds, w, k)[0] > works * works, ti.i32)
    way = advanced(worlds, w, way, time, lost)
    foresight[w, k, ForesightColumn.x] = way.place[0]
    foresight[w, k, ForesightColumn.y] = way.place[1]
    foresight[w, k, ForesightColumn.heads_for] = ti.cast(way.node, ti.f32)
    foresight[w, k, ForesightColumn.hovers] = way.hovers
    foresight[w, k, ForesightColumn.speed] = way.speed
    foresight[w, k, ForesightColumn.elapsed] = elapsed


@func
def foresee_served(worlds: ti.template(), w, b):
    """`foresee` for the AUVs that boat b serves."""
    for k in range(worlds.estimate.shape[1]):
        if boat_motion.serves(worlds, w, b, k):
            foresee(worlds, w, k)


@func
def begin(worlds: ti.template(), w, k):
    """AUV k is where it is deployed, on its way to a node that is not chosen yet."""
    foresight = ti.static(worlds.foresight)
    foresight[w, k, ForesightColumn.x] = worlds.auv[w, k, AuvColumn.x]
    foresight[w, k, ForesightColumn.y] = worlds.auv[w, k, AuvColumn.y]
    foresight[w, k, ForesightColumn.heads_for] = 0.0
    foresight[w, k, ForesightColumn.hovers] = 0.0
    foresight[w, k, ForesightColumn.speed] = worlds.p[Parameter.reference_speed]
    foresight[w, k, ForesightColumn.elapsed] = 0.0


@func
def foreseen_place(worlds: ti.template(), w, k) -> vec2:
    """Present predicted position of AUV k, m."""
    return vec2(worlds.foresight[w, k, ForesightColumn.x], worlds.foresight[w, k, ForesightColumn.y])
