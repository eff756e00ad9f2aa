"""The boat's prediction of its AUVs: their places, and how uncertain they are of them.

Each reply contains the AUV's target node and its speed. From there on the boat predicts that the AUV travels from node
to node as expected from the target rule, with a typical service at each; an AUV so uncertain of its own position that
it misses its node waits there.
"""

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.mission.boats import boat_motion
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
    return tracker.drift_over(time, p.current_variance, p.correlation_time, p.velocity_walk)


@func
def own_uncertainty(worlds: ti.template(), w, k) -> vec3:
    """(a, b, c) of the errors of AUV k's own position and current at present, with the fixes that the boat has made."""
    track = ti.static(worlds.track)
    a = 0.5 * (track[w, k, tracker.XX] + track[w, k, tracker.YY])
    b = 0.5 * (track[w, k, tracker.XU] + track[w, k, tracker.YV])
    c = 0.5 * (track[w, k, tracker.UU] + track[w, k, tracker.VV])
    return vec3(tracker.drifted(a, b, c, drift_over(worlds, worlds.exchange.elapsed[w, k])))


@func
def works_within(worlds: ti.template()) -> ti.f32:
    """Largest error (m) of its own position with which an AUV still finds its node."""
    return ti.max(worlds.p.hover_radius, worlds.p.homing_range)


@func
def place_of_node(worlds: ti.template(), w, i) -> vec2:
    """Where boats take node i to be, m."""
    place = vec2(worlds.node.x[w, i], worlds.node.y[w, i])
    if ti.static(worlds.program.task.known_place):
        place = worlds.program.task.known_place(worlds, w, i)
    return place


@func
def approached(worlds: ti.template(), w, way: PredictedAuv, time) -> vec2:
    """Position of an AUV that has gone straight towards its node for some time (s), at most to it, m."""
    ahead = place_of_node(worlds, w, way.node) - way.place
    distance = ahead.norm()
    return way.place + ti.min(way.speed * time / ti.max(distance, 1e-6), 1.0) * ahead


@func
def advanced(worlds: ti.template(), w, way: PredictedAuv, time, lost: ti.i32) -> PredictedAuv:
    """An AUV's state after some time (s); one that is lost goes no farther than to its target."""
    p = ti.static(worlds.p)
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
            there = place_of_node(worlds, w, way.node)
            ahead = there - way.place
            distance = ahead.norm()
            to_go = distance
            if ti.static(worlds.program.passing):
                to_go = ti.max(distance - p.hover_radius, 0.0)
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
                    way.hovers = p.service_time
    return way


@func
def may_arrive(worlds: ti.template(), w, way: PredictedAuv, time):
    """Whether an AUV may come to a node within some time, s; at most by one in a hundred farther than it gets."""
    away = place_of_node(worlds, w, way.node) - way.place
    farthest = worlds.p.hover_radius + 1.01 * ti.max(way.speed, SLOWEST) * time
    return way.hovers <= time and away.norm_sqr() <= farthest * farthest


@func
def remembered(worlds: ti.template(), w, k) -> PredictedAuv:
    """The boat's present prediction of AUV k."""
    foresight = ti.static(worlds.foresight)
    return PredictedAuv(
        place=vec2(foresight.x[w, k], foresight.y[w, k]),
        node=ti.cast(foresight.heads_for[w, k], ti.i32),
        hovers=foresight.hovers[w, k],
        speed=foresight.speed[w, k],
    )


@func
def foresee(worlds: ti.template(), w, k):
    """Advance the prediction of AUV k to the present: from the previous one, or from a new reply."""
    foresight = ti.static(worlds.foresight)
    exchange = ti.static(worlds.exchange)
    way = remembered(worlds, w, k)
    elapsed = exchange.elapsed[w, k]
    time = elapsed - foresight.elapsed[w, k]
    news = time < 0.999 * worlds.p.step  # a reply was received in the step before
    if worlds.clock[w, 1] == 1:  # the first node is given at deployment
        exchange.heads_for[w, k] = worlds.auv.target[w, k]
        news = True
    if news:
        way.place = vec2(worlds.track[w, k, tracker.X], worlds.track[w, k, tracker.Y])
        way.node = ti.cast(exchange.heads_for[w, k], ti.i32)
        way.hovers = exchange.hovers[w, k]
        if way.hovers == 0.0:
            speed = vec2(exchange.velocity_x[w, k], exchange.velocity_y[w, k]).norm()
            if speed > 0.5 * worlds.p.speed_min:
                way.speed += LEARNED * (speed - way.speed)
        time = elapsed
    lost = 0
    if may_arrive(worlds, w, way, time):  # where it matters
        works = works_within(worlds)
        lost = ti.cast(own_uncertainty(worlds, w, k)[0] > works * works, ti.i32)
    way = advanced(worlds, w, way, time, lost)
    foresight.x[w, k] = way.place[0]
    foresight.y[w, k] = way.place[1]
    foresight.heads_for[w, k] = ti.cast(way.node, ti.f32)
    foresight.hovers[w, k] = way.hovers
    foresight.speed[w, k] = way.speed
    foresight.elapsed[w, k] = elapsed


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
    foresight.x[w, k] = worlds.auv.x[w, k]
    foresight.y[w, k] = worlds.auv.y[w, k]
    foresight.heads_for[w, k] = 0.0
    foresight.hovers[w, k] = 0.0
    foresight.speed[w, k] = worlds.p.reference_speed
    foresight.elapsed[w, k] = 0.0


@func
def foreseen_place(worlds: ti.template(), w, k) -> vec2:
    """Present predicted position of AUV k, m."""
    return vec2(worlds.foresight.x[w, k], worlds.foresight.y[w, k])
