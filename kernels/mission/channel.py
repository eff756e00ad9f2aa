"""The acoustic channel: one exchange at a time, an interrogation and the reply or replies to it.

An exchange lasts for the way of the sound to the AUV and back, the transponder's turn-around time and the length of the
signal. The boat asks all AUVs at once, which answer by codes of their own (the exchange then lasts until the farthest
reply), or one at a time, in turn or the one it knows least of. No AUV is located twice in a mission step. Of several
boats that share the water each begins its exchanges in its own slots of time.

Times count from the end of the present mission step, s; what lies before is negative.
"""

import taichi as ti

from kernels.mission import fixes, navigation
from kernels.mission.columns import (
    AuvColumn,
    BoatColumn,
    Draw,
    ExchangeColumn,
    Parameter,
    Reply,
    Schedule,
    Sensor,
)
from kernels.mission.worlds import uniforms
from kernels.types import ivec2, vec2

SLOT_ROUNDING = 1e-4  # of a slot's length


@ti.func
def slot_start(worlds: ti.template(), w, time):
    """The first moment from `time` on at which this boat may begin an exchange."""
    p = ti.static(worlds.p)
    start = time
    if p[Parameter.slots] > 1.0:
        cycle = p[Parameter.slots] * p[Parameter.slot_length]
        into = worlds.boat[w, BoatColumn.cycle_time] + time - p[Parameter.slot] * p[Parameter.slot_length]
        into -= cycle * ti.floor(into / cycle)
        if into >= (1.0 - SLOT_ROUNDING) * p[Parameter.slot_length]:
            start = time + cycle - into
    return start


@ti.func
def duration(worlds: ti.template(), w, k) -> vec2:
    """Time (s) from an interrogation of AUV k to the departure of its reply, and to the reply's end at the boat."""
    p = ti.static(worlds.p)
    dx = worlds.auv[w, k, AuvColumn.x] - worlds.boat[w, BoatColumn.x]
    dy = worlds.auv[w, k, AuvColumn.y] - worlds.boat[w, BoatColumn.y]
    z = p[Parameter.separation_boat] + worlds.boat[w, BoatColumn.elevation]
    travel = ti.sqrt(dx * dx + dy * dy + z * z) / p[Parameter.sound_speed]
    reply = travel + p[Parameter.turn_around]
    return vec2(reply, reply + travel + p[Parameter.signal_length])


@ti.func
def may_ask(worlds: ti.template(), w, k, start):
    """Whether AUV k may be asked at `start`: its next fix must not fall into a step that has one already."""
    return worlds.exchange[w, k, ExchangeColumn.over] == 0.0 or start + duration(worlds, w, k)[1] > 0.0


@ti.func
def chosen(worlds: ti.template(), w, start):
    """The AUV to ask at `start`, −1 for none; with all at once the one whose reply is there last."""
    count = worlds.auv.shape[1]
    best = -1
    largest = -1.0
    last = ti.cast(worlds.boat[w, BoatColumn.asked], ti.i32)
    for n in range(count):
        k = (last + 1 + n) % count
        value = 0.0  # in turn: the first of them
        if ti.static(worlds.program.schedule == Schedule.by_need):
            value = navigation.uncertainty(worlds, w, k)
        elif ti.static(worlds.program.schedule == Schedule.all):
            value = duration(worlds, w, k)[1]
        if value > largest:
            if ti.static(worlds.program.schedule == Schedule.all) or may_ask(worlds, w, k, start):
                largest = value
                best = k
    if ti.static(worlds.program.schedule == Schedule.all):
        if not may_ask(worlds, w, best, start):
            best = -1
    return best


@ti.func
def ask(worlds: ti.template(), w, k, start):
    """Interrogate AUV k at `start`; returns when its reply is over."""
    lasts = duration(worlds, w, k)
    worlds.exchange[w, k, ExchangeColumn.reply_at] = start + lasts[0]
    worlds.exchange[w, k, ExchangeColumn.reply] = Reply.due
    worlds.boat[w, BoatColumn.asked] = ti.cast(k, ti.f32)
    return start + lasts[1]


@ti.func
def is_lost(worlds: ti.template(), w, k) -> ivec2:
    """Whether an interrogation of AUV k and its reply are lost in this step."""
    lost = ivec2(0, 0)
    if worlds.p[Parameter.packet_loss] > 0.0:
        u = uniforms(worlds, w, Draw.loss, k)
        for way in ti.static(range(2)):
            lost[way] = ti.cast(u[way] < worlds.p[Parameter.packet_loss], ti.i32)
    return lost


@ti.func
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
            navigation.tell(worlds, w, k)
            navigation.send(worlds, w, k, age)


@ti.func
def receive(worlds: ti.template(), pose: fixes.ArrayPose, w, k, age):
    """The reply of AUV k arrives `age` seconds before the end of the step, if it does."""
    there = vec2(worlds.exchange[w, k, ExchangeColumn.sent_x], worlds.exchange[w, k, ExchangeColumn.sent_y])
    lost = is_lost(worlds, w, k)[1]
    if worlds.exchange[w, k, ExchangeColumn.reply] == Reply.lost:
        lost = 1
    fixes.take_reply(worlds, pose, w, k, there, age, lost)
    worlds.exchange[w, k, ExchangeColumn.reply] = Reply.none
    worlds.exchange[w, k, ExchangeColumn.over] = 1.0


@ti.func
def begin_step(worlds: ti.template(), w):
    """Count times from the end of the new step; no exchange has ended in it yet."""
    step = worlds.p[Parameter.step]
    worlds.boat[w, BoatColumn.channel_free] = ti.max(worlds.boat[w, BoatColumn.channel_free] - step, -step)
    cycle = worlds.p[Parameter.slots] * worlds.p[Parameter.slot_length]
    time = worlds.boat[w, BoatColumn.cycle_time] + step
    worlds.boat[w, BoatColumn.cycle_time] = time - cycle * ti.floor(time / cycle)
    for k in range(worlds.auv.shape[1]):
        worlds.exchange[w, k, ExchangeColumn.reply_at] = worlds.exchange[w, k, ExchangeColumn.reply_at] - step
        worlds.exchange[w, k, ExchangeColumn.over] = 0.0
        fixes.no_fix(worlds, w, k)


@ti.func
def begin(worlds: ti.template(), pose: fixes.ArrayPose, w):
    """Nothing is in the water when an episode begins, and positions are those of the deployment."""
    worlds.boat[w, BoatColumn.channel_free] = 0.0
    worlds.boat[w, BoatColumn.cycle_time] = 0.0
    worlds.boat[w, BoatColumn.asked] = -1.0
    for k in range(worlds.auv.shape[1]):
        worlds.exchange[w, k, ExchangeColumn.reply] = Reply.none
        worlds.exchange[w, k, ExchangeColumn.reply_at] = 0.0
        fixes.no_fix(worlds, w, k)
        fixes.finish(worlds, pose, w, k)


@ti.func
def exchange(worlds: ti.template(), pose: fixes.ArrayPose, w):
    """All exchanges of this step: those that end in it give fixes, the last may go on into the next."""
    begin_step(worlds, w)
    count = worlds.auv.shape[1]
    step = worlds.p[Parameter.step]
    under_way = False
    for k in range(count):
        under_way = under_way or worlds.exchange[w, k, ExchangeColumn.reply] != Reply.none
    going_on = True
    while going_on:
        going_on = False
        if not under_way:
            start = slot_start(worlds, w, ti.max(worlds.boat[w, BoatColumn.channel_free], -step))
            first = chosen(worlds, w, start)
            if first >= 0 and start < 0.0:
                end = start
                for k in range(count):
                    if ti.static(worlds.program.schedule == Schedule.all) or k == first:
                        end = ti.max(end, ask(worlds, w, k, start))
                worlds.boat[w, BoatColumn.channel_free] = end
                under_way = True
        if under_way:
            for k in range(count):
                due = worlds.exchange[w, k, ExchangeColumn.reply] == Reply.due
                if due and worlds.exchange[w, k, ExchangeColumn.reply_at] <= 0.0:
                    answer(worlds, w, k)
            end = worlds.boat[w, BoatColumn.channel_free]
            if end <= 0.0:
                for k in range(count):
                    reply = worlds.exchange[w, k, ExchangeColumn.reply]
                    if reply == Reply.sent or reply == Reply.lost:
                        receive(worlds, pose, w, k, -end)
                under_way = False
                going_on = True
    for k in range(count):
        fixes.finish(worlds, pose, w, k)
