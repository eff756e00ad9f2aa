"""The acoustic channel: one exchange at a time, an interrogation and the reply or replies to it.

An exchange lasts for the way of the sound to the AUV and back, the transponder's turn-around time and the length of the
signal. The boat asks all AUVs at once, which answer by codes of their own (the exchange then lasts until the farthest
reply), or one at a time of those that it serves: in turn, or the one with the largest product of what its reply is
worth (`reception.reply_worth`) and the time since it was asked. No AUV is located twice in a mission step. Several
boats begin exchanges in turn; one without an AUV to ask passes the turn on. The boat that asked receives the replies,
and all boats share what they bring. From one exchange to the next there can be a least time.

Times count from the end of the present mission step, s; what lies before is negative.
"""

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.mission import boat_motion, fixes, navigation, reception
from usvauv.kernels.mission.columns import (
    AuvColumn,
    BoatColumn,
    Draw,
    ExchangeColumn,
    Parameter,
    Reply,
    Schedule,
    Sensor,
    TallyColumn,
)
from usvauv.kernels.mission.worlds import uniforms
from usvauv.kernels.types import ivec2, vec2


@func
def duration(worlds: ti.template(), w, b, k) -> vec2:
    """Time (s) from boat b's interrogation of AUV k to the departure of the reply, and to its end at the boat."""
    p = ti.static(worlds.p)
    dx = worlds.auv[w, k, AuvColumn.x] - worlds.boat[w, b, BoatColumn.x]
    dy = worlds.auv[w, k, AuvColumn.y] - worlds.boat[w, b, BoatColumn.y]
    z = p[Parameter.separation_boat] + worlds.boat[w, b, BoatColumn.elevation]
    z += worlds.auv[w, k, AuvColumn.depth_error]
    travel = ti.sqrt(dx * dx + dy * dy + z * z) / p[Parameter.sound_speed]
    reply = travel + p[Parameter.turn_around]
    return vec2(reply, reply + travel + p[Parameter.signal_length])


@func
def may_ask(worlds: ti.template(), w, b, k, start):
    """Whether boat b may ask AUV k at `start`: its next fix must not fall into a step that has one already."""
    return worlds.exchange[w, k, ExchangeColumn.over] == 0.0 or start + duration(worlds, w, b, k)[1] > 0.0


@func
def asks(worlds: ti.template(), w, b, k) -> bool:
    """Whether boat b ever asks AUV k, as long as it is where it is."""
    found = True
    if ti.static(worlds.program.schedule != Schedule.all):
        found = boat_motion.serves(worlds, w, b, k)
    return found


@func
def chosen(worlds: ti.template(), w, b, start):
    """The AUV that boat b asks at `start`, −1 for none; with all at once the one whose reply is there last."""
    count = worlds.auv.shape[1]
    best = -1
    largest = -1.0
    last = ti.cast(worlds.boat[w, b, BoatColumn.asked], ti.i32)
    for n in range(count):
        k = (last + 1 + n) % count
        value = 0.0  # in turn: the first of them
        if ti.static(worlds.program.schedule == Schedule.by_need):
            waits = start - worlds.exchange[w, k, ExchangeColumn.reply_at]  # else one that does not reply is asked on
            value = waits * reception.reply_worth(worlds, w, b, k)
        elif ti.static(worlds.program.schedule == Schedule.all):
            value = duration(worlds, w, b, k)[1]
        if value > largest and asks(worlds, w, b, k):
            if ti.static(worlds.program.schedule == Schedule.all) or may_ask(worlds, w, b, k, start):
                largest = value
                best = k
    if ti.static(worlds.program.schedule == Schedule.all):
        if not may_ask(worlds, w, b, best, start):
            best = -1
    return best


@func
def ask(worlds: ti.template(), w, b, k, start):
    """Boat b interrogates AUV k at `start`; returns when its reply is over."""
    lasts = duration(worlds, w, b, k)
    worlds.exchange[w, k, ExchangeColumn.reply_at] = start + lasts[0]
    worlds.exchange[w, k, ExchangeColumn.reply] = Reply.due
    worlds.boat[w, b, BoatColumn.asked] = ti.cast(k, ti.f32)
    return start + lasts[1]


@func
def is_lost(worlds: ti.template(), w, k) -> ivec2:
    """Whether an interrogation of AUV k and its reply are lost in this step."""
    lost = ivec2(0, 0)
    if worlds.p[Parameter.packet_loss] > 0.0:
        u = uniforms(worlds, w, Draw.loss, k)
        for way in ti.static(range(2)):
            lost[way] = ti.cast(u[way] < worlds.p[Parameter.packet_loss], ti.i32)
    return lost


@func
def answer(worlds: ti.template(), w, k):
    """AUV k hears the interrogation, unless it is lost, and its reply leaves."""
    exchange = ti.static(worlds.exchange)
    age = -exchange[w, k, ExchangeColumn.reply_at]
    share = age / worlds.p[Parameter.step]
    exchange[w, k, ExchangeColumn.reply] = Reply.lost
    if not is_lost(worlds, w, k)[0]:
        exchange[w, k, ExchangeColumn.reply] = Reply.sent
        for axis in ti.static(range(2)):
            moved = worlds.auv[w, k, AuvColumn.moved_x + axis]
            exchange[w, k, ExchangeColumn.sent_x + axis] = worlds.auv[w, k, AuvColumn.x + axis] - share * moved
        if ti.static(worlds.program.sensor != Sensor.none):
            navigation.receive_filter(worlds, w, k)
            navigation.write_reply(worlds, w, k, age)


@func
def receive(worlds: ti.template(), pose: reception.ArrayPose, w, k, age):
    """The reply of AUV k arrives `age` seconds before the end of the step, if it does."""
    there = vec2(worlds.exchange[w, k, ExchangeColumn.sent_x], worlds.exchange[w, k, ExchangeColumn.sent_y])
    lost = is_lost(worlds, w, k)[1]
    if worlds.exchange[w, k, ExchangeColumn.reply] == Reply.lost:
        lost = 1
    fixes.take_reply(worlds, pose, w, k, there, age, lost)
    worlds.exchange[w, k, ExchangeColumn.reply] = Reply.none
    worlds.exchange[w, k, ExchangeColumn.over] = 1.0


@func
def begin_step(worlds: ti.template(), w):
    """Count times from the end of the new step; no exchange has ended in it yet."""
    step = worlds.p[Parameter.step]
    for column in ti.static((TallyColumn.channel_free, TallyColumn.next_ping)):
        worlds.tally[w, column] = ti.max(worlds.tally[w, column] - step, -step)
    for k in range(worlds.auv.shape[1]):
        worlds.exchange[w, k, ExchangeColumn.reply_at] = worlds.exchange[w, k, ExchangeColumn.reply_at] - step
        worlds.exchange[w, k, ExchangeColumn.over] = 0.0
        fixes.no_fix(worlds, w, k)


@func
def open_channel(worlds: ti.template(), w):
    """When an episode begins the channel is free, and the turn is the first boat's."""
    boats = worlds.boat.shape[1]
    worlds.tally[w, TallyColumn.channel_free] = 0.0
    worlds.tally[w, TallyColumn.next_ping] = 0.0
    worlds.tally[w, TallyColumn.asking] = ti.cast(boats - 1, ti.f32)
    for b in range(boats):
        worlds.boat[w, b, BoatColumn.asked] = -1.0


@func
def begin(worlds: ti.template(), pose: reception.ArrayPose, w, k):
    """Nothing is in the water when an episode begins, and AUV k is where it is deployed."""
    worlds.exchange[w, k, ExchangeColumn.reply] = Reply.none
    worlds.exchange[w, k, ExchangeColumn.reply_at] = 0.0
    fixes.no_fix(worlds, w, k)
    fixes.finish(worlds, pose, w, k)


@func
def begin_exchange(worlds: ti.template(), w):
    """The boat whose turn it is begins an exchange as soon as the channel is free; returns whether one begins."""
    boats = worlds.boat.shape[1]
    count = worlds.auv.shape[1]
    start = ti.max(worlds.tally[w, TallyColumn.channel_free], worlds.tally[w, TallyColumn.next_ping])
    start = ti.max(start, -worlds.p[Parameter.step])
    last = ti.cast(worlds.tally[w, TallyColumn.asking], ti.i32)
    turns = boats
    if ti.static(worlds.program.schedule == Schedule.all):
        turns = 1  # every boat has an AUV to ask, if not now then in the next step
    begins = False
    for turn in range(turns):
        if not begins and start < 0.0:
            b = (last + 1 + turn) % boats
            first = chosen(worlds, w, b, start)
            if first >= 0:
                end = start
                for k in range(count):
                    if ti.static(worlds.program.schedule == Schedule.all) or k == first:
                        end = ti.max(end, ask(worlds, w, b, k, start))
                worlds.tally[w, TallyColumn.channel_free] = end
                worlds.tally[w, TallyColumn.next_ping] = start + worlds.p[Parameter.ping_interval]
                worlds.tally[w, TallyColumn.asking] = ti.cast(b, ti.f32)
                begins = True
    return begins


@func
def exchange(worlds: ti.template(), w):
    """All exchanges of this step: those that end in it give fixes, the last may go on into the next."""
    begin_step(worlds, w)
    count = worlds.auv.shape[1]
    pose = reception.array_pose(worlds, w, 0)
    under_way = False
    for k in range(count):
        under_way = under_way or worlds.exchange[w, k, ExchangeColumn.reply] != Reply.none
    going_on = True
    while going_on:
        going_on = False
        if not under_way:
            under_way = begin_exchange(worlds, w)
        if under_way:
            for k in range(count):
                due = worlds.exchange[w, k, ExchangeColumn.reply] == Reply.due
                if due and worlds.exchange[w, k, ExchangeColumn.reply_at] <= 0.0:
                    answer(worlds, w, k)
            end = worlds.tally[w, TallyColumn.channel_free]
            if end <= 0.0:
                if ti.static(worlds.program.fleet):
                    pose = reception.array_pose(worlds, w, ti.cast(worlds.tally[w, TallyColumn.asking], ti.i32))
                for k in range(count):
                    reply = worlds.exchange[w, k, ExchangeColumn.reply]
                    if reply == Reply.sent or reply == Reply.lost:
                        receive(worlds, pose, w, k, -end)
                under_way = False
                going_on = True
    for b in range(worlds.boat.shape[1]):
        if ti.static(worlds.program.fleet):
            pose = reception.array_pose(worlds, w, b)
        for k in range(count):
            if boat_motion.serves(worlds, w, b, k):
                fixes.finish(worlds, pose, w, k)
