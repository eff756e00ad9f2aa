"""The acoustic channel: who is interrogated when, and which signals arrive in a mission step.

It has one exchange at a time, an interrogation and the reply or replies to it. It lasts for the sound's two-way travel
time, the transponder's turn-around time and the length of the messages (`usvauv.kernels.mission.link.messages`). The
boat interrogates all AUVs at once, or one of those that it serves, whose turn a function of `schedules` decides. All
reply with different codes at once, or one after another: the interrogation tells each how long to wait, so that its
reply reaches the boat after those of nearer AUVs, by the boat's estimates and with three standard deviations of these
as guard time. Nobody receives while it sends, as an exchange lasts until the last reply is over. No AUV is located
twice in a mission step. Several boats begin exchanges in turn; a boat without an AUV to interrogate passes its turn on.
The boat that interrogated receives the replies, and all boats share their contents. There can be a least time between
exchanges. Without a channel a signal of each AUV arrives in each step.

All exchanges of a step are decided before its fixes are made. `hear` writes what arrives to `worlds.reception`, from
which `usvauv.kernels.mission.link.fixes` makes fixes and `usvauv.kernels.mission.link.estimates` the estimates.

Times count from the end of the present mission step, s; earlier times are negative, ages are their opposite.
"""

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.mission.auvs.motion import is_spent
from usvauv.kernels.mission.boats import boat_motion
from usvauv.kernels.mission.choices import schedules
from usvauv.kernels.mission.columns import (
    AuvColumn,
    Draw,
    ExchangeColumn,
    ReceptionColumn,
    Reply,
    Schedule,
    TallyColumn,
)
from usvauv.kernels.mission.draws import uniforms
from usvauv.kernels.mission.link.messages import hears_request, noise_to_others, overlap, request_length
from usvauv.kernels.mission.link.replies import height, true_height
from usvauv.kernels.positioning import usbl
from usvauv.kernels.types import ivec2, vec2, vec3

GUARD = 3.0  # standard deviations of an estimate
BEYOND = 1e30  # m


@func
def boat_before(worlds: ti.template(), w, b, age) -> vec2:
    """Where boat b was `age` seconds before the end of the step, m."""
    boat = ti.static(worlds.boat)
    share = age / worlds.p.step
    moved = vec2(boat.moved_x[w, b], boat.moved_y[w, b])
    return vec2(boat.x[w, b], boat.y[w, b]) - share * moved


@func
def squared_distance(worlds: ti.template(), w, b, k) -> ti.f32:
    """Square of the true distance between boat b and AUV k, m²."""
    dx = worlds.auv.x[w, k] - worlds.boat.x[w, b]
    dy = worlds.auv.y[w, k] - worlds.boat.y[w, b]
    z = true_height(worlds, w, b, k)
    return dx * dx + dy * dy + z * z


@func
def duration(worlds: ti.template(), w, b, k) -> vec2:
    """Time (s) from boat b's interrogation of AUV k to the departure of the reply, and to its end at the boat."""
    p = ti.static(worlds.p)
    travel = ti.sqrt(squared_distance(worlds, w, b, k)) / p.sound_speed
    addressed = worlds.auv.shape[1]
    if ti.static(worlds.program.schedule == Schedule.one):
        addressed = 1
    reply = request_length(worlds, addressed) + travel + p.turn_around
    return vec2(reply, reply + travel + p.reply_length)


@func
def time_reply(worlds: ti.template(), w, b, k, start):
    """Write when AUV k replies if boat b interrogates it at `start`, delay included; returns when the reply is over."""
    lasts = duration(worlds, w, b, k)
    worlds.exchange.reply_at[w, k] = start + lasts[0]
    worlds.exchange.over_at[w, k] = start + lasts[1]
    return start + lasts[1]


@func
def may_ask(worlds: ti.template(), w, k):
    """Whether AUV k may be asked, by the time of its reply: no fix must fall into a step that has one already."""
    return worlds.exchange.over[w, k] == 0.0 or worlds.exchange.over_at[w, k] > 0.0


@func
def in_turn(worlds: ti.template(), w, b, k) -> ti.f32:
    """Asks AUVs one after another, by their numbers."""
    count = worlds.auv.shape[1]
    last = ti.cast(worlds.boat.asked[w, b], ti.i32)
    return -ti.cast((k - last - 1 + count) % count, ti.f32)


schedules.register("turns", in_turn)


@func
def ask_one(worlds: ti.template(), w, b, start):
    """Boat b interrogates its most urgent AUV; returns when the reply is over, or `start` if there is none to ask."""
    end = start
    asked = -1
    most = -BEYOND
    for k in range(worlds.auv.shape[1]):
        if boat_motion.serves(worlds, w, b, k):
            over = time_reply(worlds, w, b, k, start)
            urgency = worlds.program.urgency(worlds, w, b, k)
            if may_ask(worlds, w, k) and urgency > most:
                asked = k
                most = urgency
                end = over
    if asked >= 0:
        worlds.exchange.reply[w, asked] = Reply.due
        worlds.boat.asked[w, b] = ti.cast(asked, ti.f32)
    return end


@func
def expected_range(worlds: ti.template(), w, b, k) -> ti.f32:
    """Slant range from boat b to where AUV k is estimated, m."""
    dx = worlds.estimate.x[w, k] - worlds.boat.x[w, b]
    dy = worlds.estimate.y[w, k] - worlds.boat.y[w, b]
    return vec3(dx, dy, height(worlds, w, b, k)).norm()


@func
def guard_time(worlds: ti.template(), w, k) -> ti.f32:
    """Time by which the reply of AUV k may be earlier or later than expected, s."""
    estimate = ti.static(worlds.estimate)
    deviation = ti.sqrt(0.5 * (estimate.covariance_xx[w, k] + estimate.covariance_yy[w, k]))
    return 2.0 * GUARD * ti.min(deviation, worlds.p.farthest) / worlds.p.sound_speed


@func
def nearest_idle(worlds: ti.template(), w, b):
    """The nearest AUV by the estimates of boat b of those that no exchange is under way with."""
    nearest = 0
    least = BEYOND
    for k in range(worlds.auv.shape[1]):
        away = expected_range(worlds, w, b, k)
        if worlds.exchange.reply[w, k] == Reply.none and away < least:
            least = away
            nearest = k
    return nearest


@func
def slot_after(worlds: ti.template(), free, travel, guard) -> vec2:
    """How long an AUV waits so that its reply begins when the boat is free again, and when that is after it, s.

    Times count from the end of the interrogation and the turn-around. `travel`: of sound there and back, expected
    within `guard`.
    """
    delay = ti.max(free + guard - travel, 0.0)
    return vec2(delay, travel + delay + guard + worlds.p.reply_length)


@func
def ask_all(worlds: ti.template(), w, b, start):
    """Boat b interrogates all AUVs; returns when the last reply is over, or `start` if one must not be asked yet."""
    exchange = ti.static(worlds.exchange)
    count = worlds.auv.shape[1]
    end = start
    free = 0.0
    last = -1
    may = True
    for n in range(count):
        k = n
        delay = 0.0
        if ti.static(worlds.program.schedule == Schedule.slots):
            k = nearest_idle(worlds, w, b)
            travel = 2.0 * expected_range(worlds, w, b, k) / worlds.p.sound_speed
            slot = slot_after(worlds, free, travel, guard_time(worlds, w, k))
            delay, free = slot[0], slot[1]
        exchange.reply[w, k] = Reply.due
        last = k
        end = ti.max(end, time_reply(worlds, w, b, k, start + delay))
        may = may and may_ask(worlds, w, k)
    if may:
        worlds.boat.asked[w, b] = ti.cast(last, ti.f32)
    else:
        end = start
        for k in range(count):
            exchange.reply[w, k] = Reply.none
    return end


@func
def is_lost(worlds: ti.template(), w, k) -> ivec2:
    """Whether an interrogation of AUV k and its reply are lost in this step; both are where its battery is spent."""
    lost = ivec2(0, 0)
    if worlds.p.packet_loss > 0.0:
        u = uniforms(worlds, w, Draw.loss, k)
        for way in ti.static(range(2)):
            lost[way] = ti.cast(u[way] < worlds.p.packet_loss, ti.i32)
    if is_spent(worlds, w, k):
        lost = ivec2(1, 1)
    return lost


@func
def is_asked(worlds: ti.template(), w, b, k):
    """Whether AUV k receives the interrogation of boat b."""
    asked = is_lost(worlds, w, k)[0] == 0
    if ti.static(worlds.program.messages):
        S = ti.sqrt(squared_distance(worlds, w, b, k))
        asked = asked and hears_request(worlds, w, k, S, true_height(worlds, w, b, k))
    return asked


@func
def answer(worlds: ti.template(), w, b, k):
    """The reply of AUV k leaves, if it has received the interrogation of boat b."""
    exchange = ti.static(worlds.exchange)
    age = -exchange.reply_at[w, k]
    share = age / worlds.p.step
    exchange.reply[w, k] = Reply.lost
    if is_asked(worlds, w, b, k):
        exchange.reply[w, k] = Reply.sent
        for axis in ti.static(range(2)):
            moved = worlds.auv[w, k, AuvColumn.moved_x + axis]
            exchange[w, k, ExchangeColumn.sent_x + axis] = worlds.auv[w, k, AuvColumn.x + axis] - share * moved
        if worlds.reception.arrived[w, k] < 0.0:
            worlds.reception.left[w, k] = age
        else:
            worlds.reception.left_next[w, k] = age


@func
def arrive(worlds: ti.template(), w, b, k, there: vec2, age, lost):
    """A signal that left AUV k `there` (m) is due at boat b, `age` seconds before the step ends; `lost`: 0 or 1."""
    auv = ti.static(worlds.auv)
    reception = ti.static(worlds.reception)
    here = boat_before(worlds, w, b, age)
    reception.arrived[w, k] = age
    reception.lost[w, k] = ti.cast(lost, ti.f32)
    reception.x[w, k] = there[0] - here[0]
    reception.y[w, k] = there[1] - here[1]
    reception.z[w, k] = true_height(worlds, w, b, k)
    auv.heard_x[w, k] = there[0]
    auv.heard_y[w, k] = there[1]
    auv.fix_boat[w, k] = ti.cast(b, ti.f32)


@func
def interference(worlds: ti.template(), w, b, k, here: vec2) -> ti.f32:
    """Noise by the replies that overlap that of AUV k at boat b, which is `here` (m), over the sea's."""
    exchange = ti.static(worlds.exchange)
    noise = 0.0
    for other in range(worlds.auv.shape[1]):
        state = exchange.reply[w, other]
        sounds = state == Reply.sent or state == Reply.over
        if other != k and sounds and overlap(worlds, exchange.over_at[w, k], exchange.over_at[w, other]):
            there = vec2(exchange.sent_x[w, other], exchange.sent_y[w, other])
            height = true_height(worlds, w, b, other)
            S = ti.sqrt((there - here).norm_sqr() + height * height)
            noise += noise_to_others(worlds, other, S, height)
    return noise


@func
def receive(worlds: ti.template(), w, b, k):
    """The reply of AUV k is over at boat b."""
    exchange = ti.static(worlds.exchange)
    age = -exchange.over_at[w, k]
    lost = is_lost(worlds, w, k)[1]
    after = Reply.over
    if exchange.reply[w, k] == Reply.lost:
        lost = 1
        after = Reply.none
    arrive(worlds, w, b, k, vec2(exchange.sent_x[w, k], exchange.sent_y[w, k]), age, lost)
    if ti.static(worlds.program.messages):
        worlds.reception.interference[w, k] = interference(worlds, w, b, k, boat_before(worlds, w, b, age))
    exchange.reply[w, k] = after
    exchange.over[w, k] = 1.0


@func
def receive_without_channel(worlds: ti.template(), w, k):
    """A signal of AUV k is received at the end of the step by the boat that serves it."""
    p = ti.static(worlds.p)
    auv = ti.static(worlds.auv)
    b = boat_motion.serving_boat(worlds, w, k)
    left = p.propagates * ti.sqrt(squared_distance(worlds, w, b, k)) / p.sound_speed
    moved = vec2(auv.moved_x[w, k], auv.moved_y[w, k])
    there = vec2(auv.x[w, k], auv.y[w, k]) - left / p.step * moved
    arrive(worlds, w, b, k, there, 0.0, is_lost(worlds, w, k)[0])
    worlds.reception.left[w, k] = left


@func
def expect_nothing(worlds: ti.template(), w, k):
    """No signal of AUV k has left or arrived in this step."""
    worlds.auv.fix_flags[w, k] = ti.cast(usbl.SILENT, ti.f32)
    for c in ti.static((ReceptionColumn.left, ReceptionColumn.left_next, ReceptionColumn.arrived)):
        worlds.reception[w, k, c] = -1.0


@func
def begin_step(worlds: ti.template(), w):
    """Count times from the end of the new step; no exchange has ended in it yet."""
    step = worlds.p.step
    for column in ti.static((TallyColumn.channel_free, TallyColumn.next_ping)):
        worlds.tally[w, column] = ti.max(worlds.tally[w, column] - step, -step)
    for k in range(worlds.auv.shape[1]):
        for column in ti.static((ExchangeColumn.reply_at, ExchangeColumn.over_at)):
            worlds.exchange[w, k, column] = worlds.exchange[w, k, column] - step
        worlds.exchange.over[w, k] = 0.0
        expect_nothing(worlds, w, k)


@func
def open_channel(worlds: ti.template(), w):
    """When an episode begins the channel is free, and the turn is the first boat's."""
    boats = worlds.boat.shape[1]
    worlds.tally.channel_free[w] = 0.0
    worlds.tally.next_ping[w] = 0.0
    worlds.tally.asking[w] = ti.cast(boats - 1, ti.f32)
    for b in range(boats):
        worlds.boat.asked[w, b] = -1.0


@func
def begin_exchanges(worlds: ti.template(), w, k):
    """Nothing is in the water when an episode begins."""
    worlds.exchange.reply[w, k] = Reply.none
    worlds.exchange.reply_at[w, k] = 0.0
    worlds.exchange.over_at[w, k] = 0.0
    expect_nothing(worlds, w, k)


@func
def begin_exchange(worlds: ti.template(), w):
    """The boat whose turn it is begins an exchange as soon as the channel is free; returns whether one begins."""
    boats = worlds.boat.shape[1]
    start = ti.max(worlds.tally.channel_free[w], worlds.tally.next_ping[w])
    start = ti.max(start, -worlds.p.step)
    last = ti.cast(worlds.tally.asking[w], ti.i32)
    turns = 1  # who asks all AUVs waits until it may
    if ti.static(worlds.program.schedule == Schedule.one):
        turns = boats
    begins = False
    for turn in range(turns):
        if not begins and start < 0.0:
            b = (last + 1 + turn) % boats
            end = start
            if ti.static(worlds.program.schedule == Schedule.one):
                end = ask_one(worlds, w, b, start)
            else:
                end = ask_all(worlds, w, b, start)
            if end > start:
                worlds.tally.channel_free[w] = end
                worlds.tally.next_ping[w] = start + worlds.p.ping_interval
                worlds.tally.asking[w] = ti.cast(b, ti.f32)
                begins = True
    return begins


@func
def exchange(worlds: ti.template(), w):
    """All exchanges of this step: the last one may go on into the next step."""
    begin_step(worlds, w)
    count = worlds.auv.shape[1]
    under_way = False
    for k in range(count):
        under_way = under_way or worlds.exchange.reply[w, k] != Reply.none
    going_on = True
    while going_on:
        going_on = False
        if not under_way:
            under_way = begin_exchange(worlds, w)
        if under_way:
            b = 0
            if ti.static(worlds.program.fleet):
                b = ti.cast(worlds.tally.asking[w], ti.i32)
            for k in range(count):
                due = worlds.exchange.reply[w, k] == Reply.due
                if due and worlds.exchange.reply_at[w, k] <= 0.0:
                    answer(worlds, w, b, k)
            for k in range(count):
                reply = worlds.exchange.reply[w, k]
                if (reply == Reply.sent or reply == Reply.lost) and worlds.exchange.over_at[w, k] <= 0.0:
                    receive(worlds, w, b, k)
            if worlds.tally.channel_free[w] <= 0.0:
                for k in range(count):
                    worlds.exchange.reply[w, k] = Reply.none
                under_way = False
                going_on = True


@func
def hear(worlds: ti.template(), w):
    """What the boats hear in this step."""
    if ti.static(worlds.program.schedule == Schedule.every_step):
        for k in range(worlds.auv.shape[1]):
            receive_without_channel(worlds, w, k)
    else:
        exchange(worlds, w)
