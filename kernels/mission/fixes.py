"""Times of fixes, in each step or by exchanges over the acoustic channel, and the boats' estimates of AUVs.

**The channel** has one exchange at a time, an interrogation and the reply or replies to it. It lasts for the sound's
two-way travel time, the transponder's turn-around time and the length of the signal. The boat interrogates all AUVs at
once, which reply with different codes (the exchange then lasts until the farthest reply), or one at a time of those
that it serves: in turn, or the one with the largest product of the value of its reply (`reception.reply_worth`) and
the time since its last interrogation. No AUV is located twice in a mission step. Several boats begin exchanges in turn;
a boat without an AUV to interrogate passes its turn on. The boat that interrogated receives the replies, and all boats
share their contents. There can be a least time between exchanges.

Where many worlds step together and it does not depend on fixes who is asked, all exchanges of a step are decided first
(`exchange`), `usvauv.kernels.mission.reception_in_lanes` makes their fixes, and `use_replies` the rest.

Times count from the end of the present mission step, s; earlier times are negative.
"""

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.mission import motion
from usvauv.kernels.mission.boats import boat_motion
from usvauv.kernels.mission.columns import (
    AuvColumn,
    Draw,
    EstimateColumn,
    ExchangeColumn,
    ReceptionColumn,
    Reply,
    Schedule,
    Sensor,
    TallyColumn,
)
from usvauv.kernels.mission.reception import (
    ArrayPose,
    Fix,
    array_pose,
    common_covariance,
    height,
    make_fix,
    reply_worth,
    true_height,
)
from usvauv.kernels.mission.reception_in_lanes import load_reply, pose_as_read, read_fix, store_reply
from usvauv.kernels.mission.worlds import normals, uniforms
from usvauv.kernels.positioning import tracker, usbl
from usvauv.kernels.positioning.usbl import Expectation
from usvauv.kernels.types import ivec2, vec2, vec3

DEPLOYMENT_VARIANCE = 1e-4  # of the place where an AUV is deployed, m²


@func
def away(worlds: ti.template(), w, b, k) -> vec3:
    """From boat b to where AUV k is estimated, m."""
    x = worlds.estimate.x[w, k] - worlds.boat.x[w, b]
    y = worlds.estimate.y[w, k] - worlds.boat.y[w, b]
    return vec3(x, y, height(worlds, w, b, k))


@func
def boat_before(worlds: ti.template(), w, b, age) -> vec2:
    """Where boat b was `age` seconds before the end of the step, m."""
    boat = ti.static(worlds.boat)
    share = age / worlds.p.step
    moved = vec2(boat.moved_x[w, b], boat.moved_y[w, b])
    return vec2(boat.x[w, b], boat.y[w, b]) - share * moved


@func
def no_fix(worlds: ti.template(), w, k):
    """No fix of AUV k is due in this step."""
    worlds.auv.fix_flags[w, k] = ti.cast(usbl.SILENT, ti.f32)


@func
def expect(worlds: ti.template(), w, k, here: vec2) -> Expectation:
    """Where a boat, `here` (m), expects AUV k by the last estimate of it."""
    estimate = ti.static(worlds.estimate)
    covariance = vec3(0.0)
    for j in ti.static(range(3)):
        covariance[j] = estimate[w, k, EstimateColumn.covariance_xx + j]
    return Expectation(
        place=vec2(estimate.x[w, k], estimate.y[w, k]) - here,
        covariance=covariance,
        reach=worlds.p.auv_speed * estimate.age[w, k],
    )


@func
def take_fix(worlds: ti.template(), pose: ArrayPose, w, k):
    """Fix AUV k from the boat on its wave, and update the estimate of its position.

    The fix that is there at the end of a step was received `latency` earlier, of a tone that had left the AUV S/c
    before. Without a tracker the estimate is the last fix that the receiver could use (`usbl.usable`); one farther away
    than the AUV can have gone since is not used, see `usvauv.kernels.positioning.usbl`.
    """
    p = ti.static(worlds.p)
    auv = ti.static(worlds.auv)
    here = boat_before(worlds, w, pose.boat, p.latency)
    there = vec2(auv.x[w, k], auv.y[w, k])
    z = height(worlds, w, pose.boat, k)
    range_now = ti.sqrt((there - boat_before(worlds, w, pose.boat, 0.0)).norm_sqr() + z * z)
    age = p.latency + p.propagates * range_now / p.sound_speed
    then = there - age / p.step * vec2(auv.moved_x[w, k], auv.moved_y[w, k])
    lost = 0
    if p.packet_loss > 0.0:
        u = uniforms(worlds, w, Draw.loss, k)
        lost = ti.cast(u[0] < p.packet_loss, ti.i32)
    fix = make_fix(worlds, pose, w, k, here, then, lost)
    if ti.static(worlds.program.tracker):
        track = ti.static(worlds.track)
        lag = age * track[w, k, tracker.ADRIFT]
        carried = lag * vec2(track[w, k, tracker.WATER_X], track[w, k, tracker.WATER_Y])
        update_track(worlds, w, k, fix, lag, carried)
        set_estimate_from_track(worlds, w, k)
    else:
        set_estimate_from_fix(worlds, w, k, fix, here)
    finish(worlds, pose, w, k)


@func
def take_fixes(worlds: ti.template(), w, b):
    """Fix the AUVs that boat b serves."""
    pose = array_pose(worlds, w, b)
    for k in range(worlds.auv.shape[1]):
        if boat_motion.serves(worlds, w, b, k):
            take_fix(worlds, pose, w, k)


@func
def take_reply(worlds: ti.template(), pose: ArrayPose, w, k, there: vec2, age, lost: ti.i32):
    """Fix AUV k by a reply that left `there` (m) and arrived `age` seconds before the end of the step, or did not."""
    here = boat_before(worlds, w, pose.boat, age)
    use_fix(worlds, w, k, make_fix(worlds, pose, w, k, here, there, lost), here)


@func
def use_fix(worlds: ti.template(), w, k, fix: Fix, here: vec2):
    """Update the track or the estimate of AUV k by a fix made from `here`, m."""
    if ti.static(worlds.program.reckoning):
        if fix.flags & usbl.DETECTED:  # the reply's contents are received even if its fix is not usable
            motion.read_reply(worlds, w, k)
            update_track(worlds, w, k, fix, 0.0, vec2(0.0, 0.0))
    else:
        set_estimate_from_fix(worlds, w, k, fix, here)


@func
def update_track(worlds: ti.template(), w, k, fix: Fix, lag, carried: vec2):
    """Update the track of AUV k by a fix that can be used; `lag` and `carried` as of `tracker.TrackFix`."""
    p = ti.static(worlds.p)
    track = ti.static(worlds.track)
    if usbl.usable(fix.flags):
        taken = tracker.TrackFix(place=fix.place, covariance=fix.covariance, lag=lag, carried=carried)
        tracker.update(track, w, k, taken, p.current_variance, p.auv_speed)
        if track[w, k, tracker.REJECTIONS] > 0.0:
            worlds.auv.fix_flags[w, k] = ti.cast(fix.flags | usbl.REJECTED, ti.f32)


@func
def set_estimate_from_fix(worlds: ti.template(), w, k, fix: Fix, here: vec2):
    """The estimate of AUV k is the fix of this step, made from `here` (m), where it can be used."""
    estimate = ti.static(worlds.estimate)
    auv = ti.static(worlds.auv)
    flags = fix.flags
    expected = expect(worlds, w, k, here)
    if usbl.usable(flags) and usbl.squared_innovation(expected, fix.place - here, fix.covariance) > usbl.GATE:
        flags |= usbl.REJECTED
    auv.fix_flags[w, k] = ti.cast(flags, ti.f32)
    if usbl.usable(flags):
        for c in ti.static(range(2)):
            estimate[w, k, EstimateColumn.x + c] = auv[w, k, AuvColumn.fix_x + c]
        for c in ti.static(range(3)):
            estimate[w, k, EstimateColumn.covariance_xx + c] = auv[w, k, AuvColumn.covariance_xx + c]
        estimate.age[w, k] = 0.0


@func
def set_estimate_from_track(worlds: ti.template(), w, k):
    """The estimate of AUV k is its track."""
    estimate = ti.static(worlds.estimate)
    track = ti.static(worlds.track)
    estimate.x[w, k] = track[w, k, tracker.X]
    estimate.y[w, k] = track[w, k, tracker.Y]
    estimate.covariance_xx[w, k] = track[w, k, tracker.XX]
    estimate.covariance_xy[w, k] = track[w, k, tracker.XY]
    estimate.covariance_yy[w, k] = track[w, k, tracker.YY]


@func
def finish(worlds: ti.template(), pose: ArrayPose, w, k):
    """Complete the estimate of AUV k for this step: with the errors that all fixes by its boat have in common."""
    estimate = ti.static(worlds.estimate)
    estimate.age[w, k] = estimate.age[w, k] + worlds.p.step
    if ti.static(worlds.program.reckoning):
        motion.extrapolate(worlds, w, k)
    estimate.separation[w, k] = -height(worlds, w, pose.boat, k)
    place = vec2(estimate.x[w, k], estimate.y[w, k])
    if ti.static(worlds.program.sensor != Sensor.none):
        # Both are renewed in each step, without what fixes have in common.
        common = common_covariance(worlds, pose, k, away(worlds, w, pose.boat, k))
        for c in ti.static(range(3)):
            estimate[w, k, EstimateColumn.covariance_xx + c] = (
                estimate[w, k, EstimateColumn.covariance_xx + c] + common[c]
            )
    error = place - vec2(worlds.auv.x[w, k], worlds.auv.y[w, k])
    worlds.auv.position_error[w, k] = error.norm()


@func
def begin_estimate(worlds: ti.template(), pose: ArrayPose, w, k):
    """The covariance with which the place where AUV k is deployed is known.

    A track follows the positions that fixes without noise would show, so the errors that fixes have in common are part
    of it.
    """
    covariance = common_covariance(worlds, pose, k, away(worlds, w, pose.boat, k))
    covariance += vec3(DEPLOYMENT_VARIANCE, 0.0, DEPLOYMENT_VARIANCE)
    for c in ti.static(range(3)):
        worlds.estimate[w, k, EstimateColumn.covariance_xx + c] = covariance[c]


@func
def predict(worlds: ti.template(), w, k):
    """Carry the track of AUV k through the step it has just made, by its velocity through the water."""
    auv = ti.static(worlds.auv)
    water = vec2(auv.water_x[w, k], auv.water_y[w, k])
    tracker.carry(worlds.track, w, k, water, worlds.p.step, motion.drifted(worlds, w, k))
    tracker.spread(worlds.track, w, k, motion.gnss_change(worlds, worlds.p.step))
    worlds.estimate.x[w, k] = worlds.track[w, k, tracker.X]
    worlds.estimate.y[w, k] = worlds.track[w, k, tracker.Y]


@func
def prepare_next_step(worlds: ti.template(), w, k):
    """Make the track's current that of the coming step, and read the AUV's current meter if it has one."""
    p = ti.static(worlds.p)
    tracker.renew(
        worlds.track,
        w,
        k,
        p.step,
        p.current_variance,
        p.correlation_time,
    )
    deviation = p.current_reading
    if deviation > 0.0:
        noise = normals(worlds, w, Draw.reading, k)
        reading = vec2(worlds.auv.current_x[w, k], worlds.auv.current_y[w, k])
        reading += deviation * vec2(noise[0], noise[1])
        tracker.sense(worlds.track, w, k, reading, deviation * deviation)


@func
def squared_distance(worlds: ti.template(), w, b, k) -> ti.f32:
    """Square of the true distance between boat b and AUV k, m²."""
    dx = worlds.auv.x[w, k] - worlds.boat.x[w, b]
    dy = worlds.auv.y[w, k] - worlds.boat.y[w, b]
    z = worlds.p.separation_boat + worlds.boat.elevation[w, b]
    z += worlds.auv.depth_error[w, k]
    return dx * dx + dy * dy + z * z


@func
def duration(worlds: ti.template(), w, b, k) -> vec2:
    """Time (s) from boat b's interrogation of AUV k to the departure of the reply, and to its end at the boat."""
    p = ti.static(worlds.p)
    travel = ti.sqrt(squared_distance(worlds, w, b, k)) / p.sound_speed
    reply = travel + p.turn_around
    return vec2(reply, reply + travel + p.signal_length)


@func
def may_ask(worlds: ti.template(), w, b, k, start):
    """Whether boat b may ask AUV k at `start`: its next fix must not fall into a step that has one already."""
    return worlds.exchange.over[w, k] == 0.0 or start + duration(worlds, w, b, k)[1] > 0.0


@func
def chosen(worlds: ti.template(), w, b, start):
    """The AUV that boat b asks at `start`, −1 for none; with all at once the one whose reply is there last."""
    count = worlds.auv.shape[1]
    best = -1
    largest = -1.0
    if ti.static(worlds.program.schedule == Schedule.all):
        for k in range(count):
            value = squared_distance(worlds, w, b, k)
            if value > largest:
                largest = value
                best = k
        if not may_ask(worlds, w, b, best, start):
            best = -1
    else:
        last = ti.cast(worlds.boat.asked[w, b], ti.i32)
        for n in range(count):
            k = (last + 1 + n) % count
            value = 0.0  # in turn: the first of them
            if ti.static(worlds.program.schedule == Schedule.by_need):
                waits = start - worlds.exchange.reply_at[w, k]  # else one that does not reply goes on
                value = waits * reply_worth(worlds, w, b, k)
            if value > largest and boat_motion.serves(worlds, w, b, k) and may_ask(worlds, w, b, k, start):
                largest = value
                best = k
    return best


@func
def ask(worlds: ti.template(), w, b, k, start):
    """Boat b interrogates AUV k at `start`; returns when its reply is over."""
    lasts = duration(worlds, w, b, k)
    worlds.exchange.reply_at[w, k] = start + lasts[0]
    worlds.exchange.reply[w, k] = Reply.due
    worlds.boat.asked[w, b] = ti.cast(k, ti.f32)
    return start + lasts[1]


@func
def is_lost(worlds: ti.template(), w, k) -> ivec2:
    """Whether an interrogation of AUV k and its reply are lost in this step."""
    lost = ivec2(0, 0)
    if worlds.p.packet_loss > 0.0:
        u = uniforms(worlds, w, Draw.loss, k)
        for way in ti.static(range(2)):
            lost[way] = ti.cast(u[way] < worlds.p.packet_loss, ti.i32)
    return lost


@func
def answer(worlds: ti.template(), w, k):
    """AUV k receives the interrogation, unless it is lost, and its reply leaves."""
    exchange = ti.static(worlds.exchange)
    age = -exchange.reply_at[w, k]
    share = age / worlds.p.step
    exchange.reply[w, k] = Reply.lost
    if not is_lost(worlds, w, k)[0]:
        exchange.reply[w, k] = Reply.sent
        for axis in ti.static(range(2)):
            moved = worlds.auv[w, k, AuvColumn.moved_x + axis]
            exchange[w, k, ExchangeColumn.sent_x + axis] = worlds.auv[w, k, AuvColumn.x + axis] - share * moved
        if ti.static(worlds.program.fixes_in_lanes):
            if load_reply(worlds, w, k, ReceptionColumn.arrived) < 0.0:
                store_reply(worlds, w, k, ReceptionColumn.left, age)
            else:
                store_reply(worlds, w, k, ReceptionColumn.left_next, age)
        else:
            fill_reply(worlds, w, k, age)


@func
def fill_reply(worlds: ti.template(), w, k, age):
    """Contents of the reply of AUV k that left `age` seconds before the end of the step."""
    if ti.static(worlds.program.reckoning):
        motion.receive_state(worlds, w, k)
        motion.write_reply(worlds, w, k, age)


@func
def receive(worlds: ti.template(), pose: ArrayPose, w, k, age):
    """The reply of AUV k arrives `age` seconds before the end of the step, if it does."""
    there = vec2(worlds.exchange.sent_x[w, k], worlds.exchange.sent_y[w, k])
    lost = is_lost(worlds, w, k)[1]
    if worlds.exchange.reply[w, k] == Reply.lost:
        lost = 1
    if ti.static(worlds.program.fixes_in_lanes):
        here = boat_before(worlds, w, pose.boat, age)
        for axis in ti.static(range(2)):
            store_reply(worlds, w, k, ReceptionColumn.offset_x + axis, there[axis] - here[axis])
            worlds.auv[w, k, AuvColumn.heard_x + axis] = there[axis]
        store_reply(worlds, w, k, ReceptionColumn.height, true_height(worlds, w, pose.boat, k))
        store_reply(worlds, w, k, ReceptionColumn.arrived, age)
        store_reply(worlds, w, k, ReceptionColumn.lost, ti.cast(lost, ti.f32))
        worlds.auv.fix_boat[w, k] = ti.cast(pose.boat, ti.f32)
    else:
        take_reply(worlds, pose, w, k, there, age, lost)
    worlds.exchange.reply[w, k] = Reply.none
    worlds.exchange.over[w, k] = 1.0


@func
def begin_step(worlds: ti.template(), w):
    """Count times from the end of the new step; no exchange has ended in it yet."""
    step = worlds.p.step
    for column in ti.static((TallyColumn.channel_free, TallyColumn.next_ping)):
        worlds.tally[w, column] = ti.max(worlds.tally[w, column] - step, -step)
    for k in range(worlds.auv.shape[1]):
        worlds.exchange.reply_at[w, k] = worlds.exchange.reply_at[w, k] - step
        worlds.exchange.over[w, k] = 0.0
        no_fix(worlds, w, k)
        if ti.static(worlds.program.fixes_in_lanes):
            for c in ti.static((ReceptionColumn.left, ReceptionColumn.left_next, ReceptionColumn.arrived)):
                store_reply(worlds, w, k, c, -1.0)


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
def begin_exchanges(worlds: ti.template(), pose: ArrayPose, w, k):
    """Nothing is in the water when an episode begins, and AUV k is where it is deployed."""
    worlds.exchange.reply[w, k] = Reply.none
    worlds.exchange.reply_at[w, k] = 0.0
    no_fix(worlds, w, k)
    finish(worlds, pose, w, k)


@func
def begin_exchange(worlds: ti.template(), w):
    """The boat whose turn it is begins an exchange as soon as the channel is free; returns whether one begins."""
    boats = worlds.boat.shape[1]
    count = worlds.auv.shape[1]
    start = ti.max(worlds.tally.channel_free[w], worlds.tally.next_ping[w])
    start = ti.max(start, -worlds.p.step)
    last = ti.cast(worlds.tally.asking[w], ti.i32)
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
                worlds.tally.channel_free[w] = end
                worlds.tally.next_ping[w] = start + worlds.p.ping_interval
                worlds.tally.asking[w] = ti.cast(b, ti.f32)
                begins = True
    return begins


@func
def array_of(worlds: ti.template(), w, b) -> ArrayPose:
    """The array of boat b; where all replies are fixed side by side its index alone is needed."""
    pose = ArrayPose(boat=b)
    if ti.static(not worlds.program.fixes_in_lanes):
        pose = array_pose(worlds, w, b)
    return pose


@func
def exchange(worlds: ti.template(), w):
    """All exchanges of this step: those that end in it give fixes, the last may go on into the next."""
    begin_step(worlds, w)
    count = worlds.auv.shape[1]
    pose = array_of(worlds, w, 0)
    under_way = False
    for k in range(count):
        under_way = under_way or worlds.exchange.reply[w, k] != Reply.none
    going_on = True
    while going_on:
        going_on = False
        if not under_way:
            under_way = begin_exchange(worlds, w)
        if under_way:
            for k in range(count):
                due = worlds.exchange.reply[w, k] == Reply.due
                if due and worlds.exchange.reply_at[w, k] <= 0.0:
                    answer(worlds, w, k)
            end = worlds.tally.channel_free[w]
            if end <= 0.0:
                if ti.static(worlds.program.fleet):
                    pose = array_of(worlds, w, ti.cast(worlds.tally.asking[w], ti.i32))
                for k in range(count):
                    reply = worlds.exchange.reply[w, k]
                    if reply == Reply.sent or reply == Reply.lost:
                        receive(worlds, pose, w, k, -end)
                under_way = False
                going_on = True
    if ti.static(not worlds.program.fixes_in_lanes):
        for b in range(worlds.boat.shape[1]):
            if ti.static(worlds.program.fleet):
                pose = array_pose(worlds, w, b)
            for k in range(count):
                if boat_motion.serves(worlds, w, b, k):
                    finish(worlds, pose, w, k)


@func
def use_replies(worlds: ti.template(), w):
    """Contents and use of the replies of this step, which `exchange` has noted and `fix_side_by_side` has fixed."""
    for k in range(worlds.auv.shape[1]):
        left = load_reply(worlds, w, k, ReceptionColumn.left)
        if left >= 0.0:
            fill_reply(worlds, w, k, left)
        age = load_reply(worlds, w, k, ReceptionColumn.arrived)
        if age >= 0.0:
            boat = ti.cast(worlds.auv.fix_boat[w, k], ti.i32)
            here = boat_before(worlds, w, boat, age)
            use_fix(worlds, w, k, read_fix(worlds, w, k, boat, here), here)
        left = load_reply(worlds, w, k, ReceptionColumn.left_next)
        if left >= 0.0:
            fill_reply(worlds, w, k, left)
    for b in range(worlds.boat.shape[1]):
        pose = pose_as_read(worlds, w, b)
        for k in range(worlds.auv.shape[1]):
            if boat_motion.serves(worlds, w, b, k):
                finish(worlds, pose, w, k)
