"""Who is asked when over the acoustic channel, and what a lost question or reply leaves: beside NumPy."""

from types import SimpleNamespace

import numpy as np
import pytest
import taichi as ti
import torch

from tests.kernels.mission.stub import StubWorlds, unchanged
from usvauv.kernels.mission import channel, expected_reply, reception, serving
from usvauv.kernels.mission.columns import (
    AuvColumn,
    BoatColumn,
    EstimateColumn,
    ExchangeColumn,
    Parameter,
    Refraction,
    Reply,
    Schedule,
    Sensor,
    TallyColumn,
)
from usvauv.kernels.positioning import usbl
from usvauv.kernels.positioning.acoustic_link import Accuracy, Sonar, link_table
from usvauv.kernels.types import vec3

WORLDS, AUVS, BOATS = 300, 4, 3
NUMBERS = {
    "step": 1.0,
    "separation_boat": 100.0,
    "sound_speed": 1480.0,
    "turn_around": 0.3,
    "signal_length": 0.02,
    "ping_interval": 0.7,
    "packet_loss": 0.3,
}
SONAR = Sonar(
    source_level=121.0,
    path="transponder",
    spreading=20.0,
    absorption=lambda f: 4.0,
    signal="code",
    bandwidth=4000.0,
    spacing=0.03,
    own_noise=lambda f: 55.0,
    accuracy=Accuracy(attitude=2e-3),
)


@pytest.fixture
def made(device) -> StubWorlds:
    r = np.random.default_rng(3)
    shapes = {"auv": (AUVS, AuvColumn), "boat": (BOATS, BoatColumn)}
    shapes |= {"estimate": (AUVS, EstimateColumn), "exchange": (AUVS, ExchangeColumn)}
    arrays = {name: np.zeros((WORLDS, count, len(of.names))) for name, (count, of) in shapes.items()}
    extent = r.choice(
        [60.0, 900.0], (WORLDS, 1, 1)
    )  # in which even the farthest is asked twice a step, and in which not
    for name in ("auv", "boat", "estimate"):
        arrays[name][..., :2] = r.uniform(0, extent, (*arrays[name].shape[:2], 2))  # x and y stand first in all three
    arrays["auv"][..., [AuvColumn.moved_x, AuvColumn.moved_y]] = r.uniform(-2, 2, (WORLDS, AUVS, 2))
    arrays["boat"][..., BoatColumn.elevation] = r.uniform(-5, 5, (WORLDS, BOATS))
    arrays["boat"][..., BoatColumn.asked] = r.integers(-1, AUVS, (WORLDS, BOATS))
    arrays["estimate"][..., EstimateColumn.served_by] = r.choice([0, 0, 2], (WORLDS, AUVS))
    arrays["estimate"][..., EstimateColumn.covariance_xx] = r.uniform(1, 900, (WORLDS, AUVS))
    arrays["estimate"][..., EstimateColumn.covariance_yy] = r.uniform(1, 900, (WORLDS, AUVS))
    arrays["exchange"][..., ExchangeColumn.over] = r.random((WORLDS, AUVS)) < 0.5
    arrays["exchange"][..., ExchangeColumn.reply_at] = -r.uniform(0, 30, (WORLDS, AUVS))
    tally = np.zeros((WORLDS, len(TallyColumn.names)))
    tally[:, TallyColumn.channel_free] = r.uniform(-1.0, 0.2, WORLDS)
    tally[:, TallyColumn.next_ping] = r.uniform(-1.5, 0.1, WORLDS)
    tally[:, TallyColumn.asking] = r.integers(0, BOATS, WORLDS)
    link = link_table([25e3 + 2000 * k for k in range(AUVS)], SONAR)
    return StubWorlds(device, NUMBERS, worlds=WORLDS, auvs=AUVS, boats=BOATS, link=link, tally=tally, **arrays)


def durations(before: dict[str, np.ndarray]) -> np.ndarray:
    """Times from a question to the reply's departure and to its end at the boat, (WORLDS, BOATS, AUVS, 2), s."""
    away = before["auv"][:, None, :, :2] - before["boat"][:, :, None, :2]
    depth = 100.0 + before["boat"][..., BoatColumn.elevation]
    travel = np.sqrt((away**2).sum(-1) + depth[..., None] ** 2) / 1480.0
    return np.stack([travel + 0.3, 2 * travel + 0.32], -1)


def replies(made: StubWorlds, before: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Probability and variance, (WORLDS, BOATS, AUVS), of replies from where AUVs are estimated, at full speed."""

    @ti.func
    def ask_each(worlds: ti.template(), w):
        for k in range(worlds.auv.shape[1]):
            offset = vec3(worlds.own[w, k, 0], worlds.own[w, k, 1], worlds.own[w, k, 2])
            found = expected_reply.reply(worlds, k, offset, 1.0, worlds.own[w, k, 3])
            worlds.own[w, k, 4] = found[0]
            worlds.own[w, k, 5] = found[1]

    found = []
    for b in range(BOATS):
        own = made.arrays["own"]
        away = before["estimate"][..., :2] - before["boat"][:, [b], :2]
        numbers = (*np.moveaxis(away, -1, 0), -100.0 - before["boat"][:, [b], BoatColumn.elevation], spread(before))
        for column, values in enumerate(numbers):
            own[..., column] = own.new_tensor(np.broadcast_to(values, (WORLDS, AUVS)).copy())
        found.append(made.after(ask_each)["own"][..., 4:6])
        own[:] = 0.0
    return tuple(np.stack(found, 1)[..., column] for column in (0, 1))


def spread(before: dict[str, np.ndarray]) -> np.ndarray:
    """Mean variance per axis of where AUVs are estimated."""
    return before["estimate"][..., [EstimateColumn.covariance_xx, EstimateColumn.covariance_yy]].mean(-1)


def begun(row: dict[str, np.ndarray], schedule: int, lasts: np.ndarray, worth: np.ndarray | None = None) -> int:
    """Begin an exchange in a world's arrays by NumPy; how far the turn has passed on, 0 where none begins."""
    tally, exchange, boats = row["tally"], row["exchange"], row["boat"]
    start = max(tally[TallyColumn.channel_free], tally[TallyColumn.next_ping], -1.0)
    if start >= 0:
        return 0
    may = (exchange[:, ExchangeColumn.over] == 0) | (start + lasts[..., 1] > 0)
    count, last = len(boats), int(tally[TallyColumn.asking])
    mine = row["estimate"][:, EstimateColumn.served_by] == np.arange(count)[:, None]
    for turn in range(1, 2 if schedule == Schedule.all else count + 1):
        b = (last + turn) % count
        order = (int(boats[b, BoatColumn.asked]) + 1 + np.arange(AUVS)) % AUVS
        if schedule == Schedule.all:
            asked = list(range(AUVS)) if may[b, lasts[b, :, 1].argmax()] else []
        else:
            asked = [k for k in order if (mine & may)[b, k]]
            if schedule == Schedule.by_need:
                need = (start - exchange[:, ExchangeColumn.reply_at]) * worth[b]
                asked.sort(key=lambda k, need=need: -need[k])
            asked = asked[:1]
        if asked:
            exchange[asked, ExchangeColumn.reply_at] = start + lasts[b, asked, 0]
            exchange[asked, ExchangeColumn.reply] = Reply.due
            boats[b, BoatColumn.asked] = asked[-1]
            tally[TallyColumn.channel_free] = start + lasts[b, asked, 1].max()
            tally[TallyColumn.next_ping] = start + 0.7
            tally[TallyColumn.asking] = b
            return turn
    return 0


@pytest.mark.parametrize("schedule", [Schedule.all, Schedule.round_robin, Schedule.by_need])
def test_who_is_asked(made, schedule):
    """By the first boat after the last one that has somebody to ask, if the channel is free within the step."""

    @ti.func
    def begin(worlds: ti.template(), w):
        begun = channel.begin_exchange(worlds, w)
        worlds.tally[w, TallyColumn.collisions] = ti.cast(begun, ti.f32)

    before = made.numbers()
    P, variance = replies(made, before)
    a = spread(before)[:, None]
    worth = P * a * a / (a + variance)
    after = made.after(begin, SimpleNamespace(schedule=schedule, fleet=True))
    lasts = durations(before)
    wanted = {name: before[name].copy() for name in ("exchange", "boat", "tally", "estimate")}
    asked_by = set()
    for w in range(WORLDS):
        turn = begun({name: array[w] for name, array in wanted.items()}, schedule, lasts[w], worth[w])
        wanted["tally"][w, TallyColumn.collisions] = turn > 0
        asked_by.add(turn)
    for name, array in wanted.items():
        np.testing.assert_allclose(after[name], array, rtol=1e-5, atol=1e-5, err_msg=name)
    assert 0.3 < wanted["tally"][:, TallyColumn.collisions].mean() < 0.95
    assert asked_by == ({0, 1} if schedule == Schedule.all else {0, 1, 2, 3})
    unchanged(after, before, {name: list(range(array.shape[-1])) for name, array in wanted.items()})


@pytest.mark.parametrize("schedule", [Schedule.all, Schedule.round_robin])
@pytest.mark.parametrize("fleet", [True, False])
def test_all_exchanges_of_a_step(made, schedule, fleet):
    """One after the other, as long as they end within it; the last goes on into the next step."""
    made.arrays["p"][Parameter.packet_loss] = 0.0
    tally, exchange = made.arrays["tally"], made.arrays["exchange"]
    tally[:, TallyColumn.channel_free] += 1.0
    under_way = torch.arange(WORLDS, device=tally.device) % 2 == 0
    reply = torch.arange(WORLDS, device=tally.device) // 2 % 3 + Reply.due  # due, sent or lost
    exchange[..., ExchangeColumn.reply_at] += 40.0  # of those that are asked no more
    for k in (1, 2):
        exchange[:, k, ExchangeColumn.reply] = torch.where(under_way, reply, Reply.none).to(exchange)
        at = tally[:, TallyColumn.channel_free] - 0.2 * k
        exchange[:, k, ExchangeColumn.reply_at] = torch.where(under_way, at, exchange[:, k, ExchangeColumn.reply_at])
    if not fleet:
        tally[:, TallyColumn.asking] = made.arrays["estimate"][..., EstimateColumn.served_by] = 0.0
        made.arrays["boat"] = made.arrays["boat"][:, :1].contiguous()
    program = SimpleNamespace(schedule=schedule, fleet=fleet, sensor=Sensor.none, refraction=Refraction.none,
                              **dict.fromkeys(("waveform", "multipath", "turns", "tracker"), False))  # fmt: skip
    before, after = made.numbers(), made.after(channel.exchange, program)
    lasts = durations(before)
    wanted = {name: before[name].copy() for name in ("exchange", "boat", "tally", "estimate")}
    by, made_fixes = np.full((WORLDS, AUVS), -1), np.zeros(WORLDS)
    for w in range(WORLDS):
        row = {name: array[w] for name, array in wanted.items()}
        tally, exchange = row["tally"], row["exchange"]
        for column in (TallyColumn.channel_free, TallyColumn.next_ping):
            tally[column] = max(tally[column] - 1.0, -1.0)
        exchange[:, ExchangeColumn.reply_at] -= 1.0
        exchange[:, ExchangeColumn.over] = 0.0
        while (exchange[:, ExchangeColumn.reply] != Reply.none).any() or begun(row, schedule, lasts[w]):
            reply = exchange[:, ExchangeColumn.reply]
            leaves = (reply == Reply.due) & (exchange[:, ExchangeColumn.reply_at] <= 0)
            reply[leaves] = Reply.sent
            end = tally[TallyColumn.channel_free]
            if end > 0:
                break
            ended = (reply == Reply.sent) | (reply == Reply.lost)
            by[w, ended] = tally[TallyColumn.asking]
            made_fixes[w] += ended.sum()
            reply[ended], exchange[ended, ExchangeColumn.over] = Reply.none, 1.0
    columns = [ExchangeColumn.reply, ExchangeColumn.over, ExchangeColumn.reply_at]
    np.testing.assert_allclose(after["exchange"][..., columns], wanted["exchange"][..., columns], rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(after["tally"], wanted["tally"], rtol=1e-5, atol=1e-5)
    np.testing.assert_array_equal(after["boat"], wanted["boat"])
    heard = after["auv"][..., AuvColumn.fix_flags] != usbl.SILENT
    np.testing.assert_array_equal(heard, by >= 0)
    np.testing.assert_array_equal(after["auv"][..., AuvColumn.fix_boat][heard], by[heard])
    assert len(np.unique(made_fixes)) > 3
    assert (after["estimate"][..., EstimateColumn.age] == 1).all()  # of all, also those that nobody heard


def test_a_step_begins(made):
    """Times count from its end; what was free long ago is free since its beginning, and no exchange has ended in it."""
    before, after = made.numbers(), made.after(channel.begin_step)
    for column in (TallyColumn.channel_free, TallyColumn.next_ping):
        np.testing.assert_allclose(after["tally"][:, column], np.maximum(before["tally"][:, column] - 1, -1), rtol=1e-6)
    reply_at = ExchangeColumn.reply_at
    np.testing.assert_allclose(after["exchange"][..., reply_at], before["exchange"][..., reply_at] - 1, rtol=1e-6)
    assert (after["exchange"][..., ExchangeColumn.over] == 0).all()
    assert (after["auv"][..., AuvColumn.fix_flags] == usbl.SILENT).all()
    changed = {"tally": [TallyColumn.channel_free, TallyColumn.next_ping], "auv": [AuvColumn.fix_flags]}
    unchanged(after, before, {**changed, "exchange": [reply_at, ExchangeColumn.over]})


def test_an_episode_begins_with_the_first_boat(made):
    before, after = made.numbers(), made.after(channel.open_channel)
    columns = [TallyColumn.channel_free, TallyColumn.next_ping, TallyColumn.asking]
    assert (after["tally"][:, columns] == [0, 0, BOATS - 1]).all()
    assert (after["boat"][..., BoatColumn.asked] == -1).all()
    unchanged(after, before, {"tally": columns, "boat": [BoatColumn.asked]})


def test_nothing_is_in_the_water_when_an_episode_begins(made):
    """Also where the one before has left exchanges; the vertical distance to the boat is that on its wave."""

    @ti.func
    def begin(worlds: ti.template(), w):
        for k in range(worlds.auv.shape[1]):
            channel.begin(worlds, reception.array_pose(worlds, w, serving.server(worlds, w, k)), w, k)

    made.arrays["exchange"][..., ExchangeColumn.reply] = Reply.lost
    before = made.numbers()
    after = made.after(begin, SimpleNamespace(fleet=True, sensor=Sensor.none, tracker=False))
    assert (after["exchange"][..., [ExchangeColumn.reply, ExchangeColumn.reply_at]] == 0).all()
    assert (after["auv"][..., AuvColumn.fix_flags] == usbl.SILENT).all()
    by = before["estimate"][..., EstimateColumn.served_by].astype(int)
    depth = 100.0 + np.take_along_axis(before["boat"][..., BoatColumn.elevation], by, 1)
    np.testing.assert_allclose(after["estimate"][..., EstimateColumn.separation], depth, rtol=1e-6)
    columns = [ExchangeColumn.reply, ExchangeColumn.reply_at]
    others = {"estimate": [EstimateColumn.separation, EstimateColumn.age]}
    unchanged(after, before, {"exchange": columns, "auv": [AuvColumn.fix_flags, AuvColumn.position_error], **others})


def test_a_question_that_is_heard_is_answered_from_where_the_auv_was(made):
    """Three in ten are lost; the reply's departure lies before the end of the step, the AUV has moved since."""

    @ti.func
    def answer(worlds: ti.template(), w):
        for k in range(worlds.auv.shape[1]):
            channel.answer(worlds, w, k)

    made.arrays["exchange"][..., ExchangeColumn.reply_at] /= 30.0
    made.arrays["exchange"][..., [ExchangeColumn.sent_x, ExchangeColumn.sent_y]] = -5.0
    before, after = made.numbers(), made.after(answer, SimpleNamespace(sensor=Sensor.none))
    reply = after["exchange"][..., ExchangeColumn.reply]
    sent = reply == Reply.sent
    assert (sent | (reply == Reply.lost)).all()
    assert sent.mean() == pytest.approx(0.7, abs=0.06)
    share = -before["exchange"][..., ExchangeColumn.reply_at, None]
    place = before["auv"][..., :2] - share * before["auv"][..., [AuvColumn.moved_x, AuvColumn.moved_y]]
    found = after["exchange"][..., [ExchangeColumn.sent_x, ExchangeColumn.sent_y]]
    np.testing.assert_allclose(found, np.where(sent[..., None], place, -5.0), rtol=1e-5, atol=1e-4)
    unchanged(after, before, {"exchange": [ExchangeColumn.reply, ExchangeColumn.sent_x, ExchangeColumn.sent_y]})


def test_questions_and_replies_are_lost_independently(made):
    @ti.func
    def lose(worlds: ti.template(), w):
        for k in range(worlds.auv.shape[1]):
            lost = channel.is_lost(worlds, w, k)
            worlds.own[w, k, 0] = ti.cast(lost[0], ti.f32)
            worlds.own[w, k, 1] = ti.cast(lost[1], ti.f32)

    lost = made.after(lose)["own"][..., :2].reshape(-1, 2)
    assert set(np.unique(lost)) == {0.0, 1.0}
    np.testing.assert_allclose(lost.mean(0), 0.3, atol=0.06)
    assert abs(np.corrcoef(lost.T)[0, 1]) < 0.12
    made.arrays["p"][:] = 0.0
    assert (made.after(lose)["own"][..., :2] == 0).all()
