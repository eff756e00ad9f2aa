"""What boats imagine of AUVs and of their own ways: beside NumPy in double precision, for two boats of four AUVs.

The worlds are no mission's: arrays of random numbers with what the functions read. Probabilities and variances of
replies are `expected_reply.reply`'s, which `test_expected_reply` holds against the acoustics.
"""

from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
import taichi as ti
import torch

from usvauv.kernels.mission import belief_planner, expected_reply
from usvauv.kernels.mission.belief_planner import INTERVAL, LEARNED, MARGIN, NOBODY, STEPS, STRAYING, SURE
from usvauv.kernels.mission.columns import (
    AuvColumn,
    BoatColumn,
    EstimateColumn,
    ExchangeColumn,
    ForesightColumn,
    NodeColumn,
    Parameter,
)
from usvauv.kernels.mission.target_rules import target_rules
from usvauv.kernels.positioning import tracker
from usvauv.kernels.positioning.acoustic_link import Accuracy, Sonar, link_table
from usvauv.kernels.types import array1, array2, array3, index2, vec3

WORLDS, BOATS, AUVS, NODES = 12, 2, 4, 7
NUMBERS = {
    "step": 1.0,
    "width": 600.0,
    "length": 400.0,
    "duration": 1000.0,
    "top_speed": 3.0,
    "speed_min": 1.2,
    "current_variance": 9e-4,
    "correlation_time": 300.0,
    "velocity_walk": 4e-4,
    "velocity_memory": 80.0,
    "reference_speed": 1.3,
    "hover_radius": 6.0,
    "homing_range": 25.0,
    "separation_boat": 100.0,
    "packet_loss": 0.05,
    "service_time": 20.0,
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
PROGRAM = SimpleNamespace(fleet=True, target_rule=target_rules["tour"])


class Stub(NamedTuple):
    """What the functions read of the worlds."""

    program: Any
    p: Any
    link: Any
    clock: Any
    estimate: Any
    boat: Any
    exchange: Any
    foresight: Any
    track: Any
    node: Any
    auv: Any = None


@ti.kernel
def _go(p: array1, link: array2, clock: index2, estimate: array3, boat: array3, exchange: array3, foresight: array3,
        track: array3, node: array3, out: array3):  # fmt: skip
    worlds = ti.static(Stub(PROGRAM, p, link, clock, estimate, boat, exchange, foresight, track, node))
    for w in range(clock.shape[0]):
        for b in range(boat.shape[1]):
            out[w, b, 2] = ti.cast(belief_planner.is_due(worlds, w, b, belief_planner.PATIENCE), ti.f32)
            goal = belief_planner.go(worlds, w, b)
            out[w, b, 0] = goal[0]
            out[w, b, 1] = goal[1]


@ti.kernel
def _reply(p: array1, link: array2, offset: array2, effort: array1, spread: array1, out: array2):
    worlds = ti.static(Stub(PROGRAM, p, link, 0, 0, 0, 0, 0, 0, 0))
    for n in range(effort.shape[0]):
        away = vec3(offset[n, 0], offset[n, 1], offset[n, 2])
        found = expected_reply.reply(worlds, n % link.shape[0], away, effort[n], spread[n])
        out[n, 0] = found[0]
        out[n, 1] = found[1]


class Imagined:
    """Random worlds, and what NumPy makes of them."""

    def __init__(self, device: torch.device, seed: int) -> None:
        r = np.random.default_rng(seed)
        self.device = device
        self.p = torch.zeros(len(Parameter.names), device=device)
        for name, number in NUMBERS.items():
            self.p[getattr(Parameter, name)] = number
        self.link = torch.from_numpy(link_table([25e3 + 1500 * k for k in range(AUVS)], SONAR)).to(device)
        shapes = {
            "estimate": (AUVS, EstimateColumn),
            "boat": (BOATS, BoatColumn),
            "exchange": (AUVS, ExchangeColumn),
            "foresight": (AUVS, ForesightColumn),
            "node": (NODES, NodeColumn),
        }
        made = {name: np.zeros((WORLDS, count, len(of.names))) for name, (count, of) in shapes.items()}
        made["track"] = np.zeros((WORLDS, AUVS, tracker.COLUMNS))
        self.clock = np.stack([np.zeros(WORLDS), r.integers(200, 900, WORLDS)], 1).astype(np.int32)
        self.clock[:2, 1] = 1  # the first decision; the boat is on no way yet

        def draw(name: str, column: int, low: float, high: float) -> None:
            made[name][..., column] = r.uniform(low, high, made[name].shape[:2])

        for name in ("boat", "foresight", "node"):
            columns = {"boat": BoatColumn, "foresight": ForesightColumn, "node": NodeColumn}[name]
            draw(name, columns.x, 0, 600)
            draw(name, columns.y, 0, 400)
        for w in range(WORLDS):
            tour = r.permutation(NODES)
            made["node"][w, tour, NodeColumn.successor] = np.roll(tour, -1)
        draw("boat", BoatColumn.elevation, -3, 3)
        draw("boat", BoatColumn.effort, 0, 1)
        draw("boat", BoatColumn.goal_x, 0, 600)
        draw("boat", BoatColumn.goal_y, 0, 400)
        made["boat"][..., BoatColumn.visits] = r.integers(-1, AUVS, (WORLDS, BOATS))
        made["boat"][..., BoatColumn.planned] = self.clock[:, 1:] - r.choice([3, 20, 149, 151], (WORLDS, BOATS))
        made["estimate"][..., EstimateColumn.served_by] = [r.permutation([0, 0, 0, 1]) for _ in range(WORLDS)]
        made["estimate"][: WORLDS // 3, :, EstimateColumn.served_by] = [0, 1, 0, 1]
        made["exchange"][..., ExchangeColumn.elapsed] = r.choice([1.0, 15.0, 60.0, 150.0, 350.0], (WORLDS, AUVS))
        made["foresight"][..., ForesightColumn.heads_for] = r.integers(0, NODES, (WORLDS, AUVS))
        draw("foresight", ForesightColumn.hovers, -15, 25)
        made["foresight"][..., ForesightColumn.hovers].clip(0, out=made["foresight"][..., ForesightColumn.hovers])
        draw("foresight", ForesightColumn.speed, 0.8, 1.6)
        for column, low, high in (
            (tracker.XX, 0.5, 300),
            (tracker.YY, 0.5, 300),
            (tracker.XU, 0, 0.05),
            (tracker.YV, 0, 0.05),
            (tracker.UU, 1e-4, 1e-3),
            (tracker.VV, 1e-4, 1e-3),
        ):
            draw("track", column, low, high)
        self.arrays = {name: torch.tensor(made[name], dtype=torch.float32, device=device) for name in made}
        made = {name: array.double().cpu().numpy() for name, array in self.arrays.items()}
        self.estimate, self.boat, self.exchange = made["estimate"], made["boat"], made["exchange"]
        self.foresight, self.track, self.node = made["foresight"], made["track"], made["node"]
        self.served_by = self.estimate[..., EstimateColumn.served_by]
        self.place = self.foresight[..., [ForesightColumn.x, ForesightColumn.y]]
        self.elapsed = self.exchange[..., ExchangeColumn.elapsed]

    def arguments(self) -> list[torch.Tensor]:
        names = ("estimate", "boat", "exchange", "foresight", "track", "node")
        clock = torch.from_numpy(self.clock).to(self.device)
        return [self.p, self.link, clock, *(self.arrays[name] for name in names)]

    def reply(self, offset: np.ndarray, effort: np.ndarray, spread: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Probability and variance of replies, (..., AUVS), from offsets (..., AUVS, 3)."""
        shape = offset.shape[:-1]
        parts = (offset.reshape(-1, 3), np.broadcast_to(effort, shape).ravel(), np.broadcast_to(spread, shape).ravel())
        given = [torch.tensor(part, dtype=torch.float32, device=self.device).contiguous() for part in parts]
        out = torch.empty((len(parts[1]), 2), device=self.device)
        _reply(self.p, self.link, *given, out)
        found = out.double().cpu().numpy().reshape(*shape, 2)
        return found[..., 0], found[..., 1]

    def own(self, w: int, later: float | np.ndarray = 0.0) -> list[np.ndarray]:
        """(a, b, c) of all AUVs of a world, (AUVS,), at present or later."""
        row = self.track[w]
        pairs = ((tracker.XX, tracker.YY), (tracker.XU, tracker.YV), (tracker.UU, tracker.VV))
        a, b, c = (row[:, list(pair)].mean(1) for pair in pairs)
        return drifted(a, b, c, self.elapsed[w] + later)

    def loss(self, w: int, b: int, first: int, where: np.ndarray) -> float:
        """Mean squared variance of the own positions of the AUVs of boat b over the rollout."""
        mine = np.flatnonzero(self.served_by[w] == b)
        here, goal = self.boat[w, b, : BoatColumn.y + 1].copy(), np.array(where)
        z = -(100.0 + self.boat[w, b, BoatColumn.elevation])
        a, b_, c = self.own(w)
        elapsed, visited, total = self.elapsed[w].copy(), first, 0.0
        ways = [
            (self.place[w, k], int(row[ForesightColumn.heads_for]), row[ForesightColumn.hovers])
            for k, row in enumerate(self.foresight[w])
        ]
        for _ in range(STEPS):
            if visited != NOBODY:
                goal = ways[visited][0]
            distance = np.linalg.norm(goal - here)
            here = here + (goal - here) * min(1.0, 3.0 * INTERVAL / max(distance, 1e-9))
            reached = distance <= 3.0 * INTERVAL
            for k in mine:
                speed = self.foresight[w, k, ForesightColumn.speed]
                ways[k] = advanced(*ways[k], speed, INTERVAL, a[k] > 25.0**2, self.node[w])
            a, b_, c = drifted(a, b_, c, INTERVAL)
            elapsed += INTERVAL
            offset = np.column_stack([np.array([way[0] for way in ways]) - here, np.full(AUVS, z)])
            effort = min(distance / (3.0 * INTERVAL), 1.0)
            found, r = self.reply(offset, np.full(AUVS, effort), a + straying(elapsed))
            for k in mine[found[mine] >= SURE]:
                gain = 1 / (a[k] + r[k])
                a[k], b_[k], c[k] = a[k] * r[k] * gain, b_[k] * r[k] * gain, c[k] - gain * b_[k] ** 2
                elapsed[k] = 0.0
                reached = reached or k == visited
            total += (a[mine] ** 2).sum()
            if reached:
                visited = mine[a[mine].argmax()]
        return total / STEPS / len(mine)


def drifted(a, b, c, time):
    """(a, b, c) after a time adrift: a Gauss–Markov bias integrated, and white noise."""
    tau, variance = 300.0, 9e-4
    f = -np.expm1(-time / tau)
    spread = 2 * time / tau - 3 + 4 * np.exp(-time / tau) - np.exp(-2 * time / tau)
    return [
        a + 2 * tau * f * b + (tau * f) ** 2 * c + variance * tau**2 * spread + 4e-4 * time,
        (1 - f) * (b + tau * f * c) + variance * tau * f**2,
        (1 - f) ** 2 * c + variance * f * (2 - f),
    ]


def straying(time):
    """Variance of a place whose velocity strays as a Gauss–Markov process."""
    t = time / 80.0
    return (STRAYING * 1.3 * 80.0) ** 2 * (2 * t - 3 + 4 * np.exp(-t) - np.exp(-2 * t))


def advanced(place, node, hovers, speed, time, lost, nodes):
    """A way after some time: to the node, a service, and on to the next; a lost AUV waits where the node should be."""
    left = time
    while left > 1e-12:
        if hovers > 0:
            spent = min(hovers, left)
            hovers, left = hovers - spent, left - spent
            if hovers <= 0:
                node = int(nodes[node, NodeColumn.successor])
            continue
        way = nodes[node, : NodeColumn.y + 1] - place
        needed = np.linalg.norm(way) / speed
        if needed > left:
            return place + left / needed * way, node, 0.0
        place, left = nodes[node, : NodeColumn.y + 1], left - needed
        if lost:
            break
        hovers = 20.0
    return place, node, hovers


@pytest.fixture(scope="module")
def imagined(device):
    return Imagined(device, 3)


def candidates(made: Imagined, w: int, b: int) -> list[int]:
    return [*np.flatnonzero(made.served_by[w] == b), AUVS]


def goal_of(made: Imagined, w: int, b: int, i: int) -> np.ndarray:
    return made.place[w, i] if i < AUVS else made.place[w, made.served_by[w] == b].mean(0)


@pytest.fixture(scope="module")
def losses(imagined):
    """Of all candidates of all boats by NumPy, {(w, b): {i: loss}}."""
    return {
        (w, b): {
            i: imagined.loss(w, b, i if i < AUVS else NOBODY, goal_of(imagined, w, b, i))
            for i in candidates(imagined, w, b)
        }
        for w in range(WORLDS)
        for b in range(BOATS)
    }


def least_certain(made: Imagined, w: int, b: int) -> int:
    mine = np.flatnonzero(made.served_by[w] == b)
    return mine[made.own(w)[0][mine].argmax()]


def test_plans(imagined, losses):
    """When a plan is due, and what it chooses: an AUV, the mean, or the last goal; between plans the boat goes on."""
    given = imagined.arguments()
    boat = given[4].clone()
    given[4] = boat
    out = torch.zeros((WORLDS, BOATS, 3), device=imagined.device)
    _go(*given, out)
    out, after = out.double().cpu().numpy(), boat.double().cpu().numpy()
    right = planned = 0
    for (w, b), each in losses.items():
        row, now = imagined.boat[w, b], imagined.clock[w, 1]
        visited = int(row[BoatColumn.visits])
        last = row[[BoatColumn.goal_x, BoatColumn.goal_y]]
        aim = imagined.place[w, visited] if visited >= 0 else last
        over = now - row[BoatColumn.planned]
        due = over >= belief_planner.PATIENCE or np.linalg.norm(aim - row[: BoatColumn.y + 1]) < 3.0 * INTERVAL
        if visited >= 0:
            due = due or imagined.elapsed[w, visited] < 2 or imagined.served_by[w, visited] != b
        due = (due and over >= INTERVAL) or now == 1
        assert out[w, b, 2] == due
        if not due:
            assert out[w, b, :2] == pytest.approx(aim)
            assert (after[w, b] == row).all()
            continue
        usual = least_certain(imagined, w, b)
        mine = {i: loss * (1 - MARGIN if i == usual else 1) for i, loss in each.items()}
        mine[AUVS + 1] = imagined.loss(w, b, NOBODY, last)
        best = min(mine, key=mine.__getitem__)
        goal = last if best > AUVS else goal_of(imagined, w, b, best)
        right += out[w, b, :2] == pytest.approx(goal, abs=0.01)
        planned += 1
        assert after[w, b, BoatColumn.planned] == now
        if out[w, b, :2] == pytest.approx(goal, abs=0.01):
            assert after[w, b, BoatColumn.visits] == (best if best < AUVS else NOBODY)
    assert planned > 10
    assert planned < WORLDS * BOATS
    assert right > 0.85 * planned


def test_the_first_plan_is_at_once_and_no_auv_leaves_the_boat_where_it_is(device):
    made = Imagined(device, 4)
    made.clock[:] = [0, 1]
    made.arrays["boat"][..., BoatColumn.planned] = 0.0
    made.arrays["estimate"][: WORLDS // 2, :, EstimateColumn.served_by] = 0.0
    out = torch.zeros((WORLDS, BOATS, 3), device=device)
    before = made.arrays["boat"].clone()
    _go(*made.arguments(), out)
    assert (out[..., 2] == 1).all()
    assert (made.arrays["boat"][WORLDS // 2 :, :, BoatColumn.planned] == 1).all()
    assert torch.equal(out[: WORLDS // 2, 1, :2], before[: WORLDS // 2, 1, : BoatColumn.y + 1])
    assert torch.equal(made.arrays["boat"][: WORLDS // 2, 1], before[: WORLDS // 2, 1])


def test_ways_beyond_their_nodes(device):
    """`advanced` for times from a part of a way to several services, lost or not."""
    made = Imagined(device, 5)
    times = np.array([3.0, 40.0, 150.0, 400.0])
    out = torch.zeros((WORLDS, AUVS, 2 * len(times) * 4), device=device)
    _advance(*made.arguments(), torch.tensor(times, dtype=torch.float32, device=device), out)
    out = out.double().cpu().numpy().reshape(WORLDS, AUVS, 2, len(times), 4)
    ends = set()
    for w in range(WORLDS):
        for k, row in enumerate(made.foresight[w]):
            for lost in (0, 1):
                for t, time in enumerate(times):
                    start = made.place[w, k], int(row[ForesightColumn.heads_for]), row[ForesightColumn.hovers]
                    place, node, hovers = advanced(*start, row[ForesightColumn.speed], time, lost, made.node[w])
                    assert out[w, k, lost, t, :2] == pytest.approx(place, abs=0.02)
                    assert out[w, k, lost, t, 2] == node
                    assert out[w, k, lost, t, 3] == pytest.approx(hovers, abs=0.01)
                    ends.add((lost, node != start[1], hovers > 0))
    assert len(ends) >= 6


@ti.kernel
def _advance(p: array1, link: array2, clock: index2, estimate: array3, boat: array3, exchange: array3,
             foresight: array3, track: array3, node: array3, times: array1, out: array3):  # fmt: skip
    worlds = ti.static(Stub(PROGRAM, p, link, clock, estimate, boat, exchange, foresight, track, node))
    for w in range(clock.shape[0]):
        for k in range(foresight.shape[1]):
            for lost in range(2):
                for t in range(times.shape[0]):
                    way = belief_planner.advanced(worlds, w, belief_planner.remembered(worlds, w, k), times[t], lost)
                    first = 4 * (lost * times.shape[0] + t)
                    out[w, k, first] = way.place[0]
                    out[w, k, first + 1] = way.place[1]
                    out[w, k, first + 2] = ti.cast(way.node, ti.f32)
                    out[w, k, first + 3] = way.hovers


@ti.kernel
def _foresee(p: array1, link: array2, clock: index2, estimate: array3, boat: array3, exchange: array3,
             foresight: array3, track: array3, node: array3, auv: array3):  # fmt: skip
    worlds = ti.static(Stub(PROGRAM, p, link, clock, estimate, boat, exchange, foresight, track, node, auv))
    for w in range(clock.shape[0]):
        for k in range(foresight.shape[1]):
            belief_planner.foresee(worlds, w, k)


def test_news_and_silence(device):
    """Foresight goes on from where it was, or from what a reply has told, whose speed it takes a share of.

    The node of the first step is given at deployment. AUVs that have lost their way wait at their nodes.
    """
    r = np.random.default_rng(8)
    made = Imagined(device, 7)
    shape = WORLDS, AUVS
    made.clock[:3, 1] = 1
    auv = torch.zeros((*shape, len(AuvColumn.names)), device=device)
    auv[..., AuvColumn.target] = torch.from_numpy(r.integers(0, NODES, shape)).to(device)
    exchange, foresight, track = (made.arrays[name] for name in ("exchange", "foresight", "track"))
    silent = r.random(shape) < 0.5
    before = np.where(silent, made.elapsed - 1.0, made.elapsed + r.choice([0.5, 90.0], shape))
    drawn = {
        (foresight, ForesightColumn.elapsed): before,
        (track, tracker.X): r.uniform(0, 600, shape),
        (track, tracker.Y): r.uniform(0, 400, shape),
        (exchange, ExchangeColumn.heads_for): r.integers(0, NODES, shape),
        (exchange, ExchangeColumn.hovers): r.choice([0.0, 0.0, 12.0], shape),
        (exchange, ExchangeColumn.velocity_x): r.uniform(-1.5, 1.5, shape),
        (exchange, ExchangeColumn.velocity_y): r.uniform(-0.8, 0.8, shape),
    }
    for (array, column), numbers in drawn.items():
        array[..., column] = torch.from_numpy(numbers).to(array)
    told, old, last = (array.double().cpu().numpy() for array in (exchange, foresight, track))
    target = auv[..., AuvColumn.target].cpu().numpy()
    _foresee(*made.arguments(), auv)
    new = foresight.double().cpu().numpy()
    for w in range(WORLDS):
        variance = made.own(w)[0]
        for k in range(AUVS):
            elapsed, first = told[w, k, ExchangeColumn.elapsed], made.clock[w, 1] == 1
            node = int(target[w, k] if first else told[w, k, ExchangeColumn.heads_for])
            assert exchange[w, k, ExchangeColumn.heads_for] == node
            way = old[w, k, : ForesightColumn.y + 1], int(old[w, k, ForesightColumn.heads_for])
            hovers, speed, time = old[w, k, ForesightColumn.hovers], old[w, k, ForesightColumn.speed], 1.0
            if first or not silent[w, k]:
                way, hovers, time = (last[w, k, : tracker.Y + 1], node), told[w, k, ExchangeColumn.hovers], elapsed
                heard = np.hypot(*told[w, k, [ExchangeColumn.velocity_x, ExchangeColumn.velocity_y]])
                if hovers == 0 and heard > 0.6:
                    speed = (1 - LEARNED) * speed + LEARNED * heard
            place, node, hovers = advanced(*way, hovers, speed, time, variance[k] > 25.0**2, made.node[w])
            assert new[w, k, : ForesightColumn.y + 1] == pytest.approx(place, abs=0.02)
            assert new[w, k, ForesightColumn.heads_for] == node
            wanted = hovers, elapsed, speed
            columns = [ForesightColumn.hovers, ForesightColumn.elapsed, ForesightColumn.speed]
            assert new[w, k, columns] == pytest.approx(wanted, abs=0.01)


@ti.kernel
def _weigh(p: array1, link: array2, clock: index2, estimate: array3, boat: array3, exchange: array3, foresight: array3,
           track: array3, node: array3, out: array3):  # fmt: skip
    worlds = ti.static(Stub(PROGRAM, p, link, clock, estimate, boat, exchange, foresight, track, node))
    for w in range(clock.shape[0]):
        for b in range(boat.shape[1]):
            least = belief_planner.least_certain(worlds, w, b)
            out[w, b, 0] = ti.cast(least, ti.f32)
            if least != NOBODY:
                place = belief_planner.foreseen_place(worlds, w, least)
                out[w, b, 1] = belief_planner.expected_loss(worlds, w, b, least, place)


def test_the_least_certain_auv_and_what_going_to_it_costs(device):
    """Also of a boat without AUVs, and where all are certain to a few decimetres."""
    made = Imagined(device, 10)
    made.track[1::2] /= 1e4
    made.served_by[: WORLDS // 3] = 1.0
    made.elapsed[1::2] = made.exchange[1::2, :, ExchangeColumn.elapsed] = 0.0
    for name in ("track", "estimate", "exchange"):
        made.arrays[name][:] = torch.from_numpy(getattr(made, name)).to(made.arrays[name])
    out = torch.zeros((WORLDS, BOATS, 2), device=device)
    _weigh(*made.arguments(), out)
    out = out.double().cpu().numpy()
    right = count = 0
    for w in range(WORLDS):
        for b in range(BOATS):
            if not (made.served_by[w] == b).any():
                assert out[w, b, 0] == NOBODY
                continue
            least = least_certain(made, w, b)
            assert out[w, b, 0] == least
            right += out[w, b, 1] == pytest.approx(made.loss(w, b, least, made.place[w, least]), rel=5e-3)
            count += 1
    assert right > 0.85 * count
    assert count < WORLDS * BOATS


@ti.kernel
def _begin(p: array1, foresight: array3, auv: array3):
    worlds = ti.static(Stub(PROGRAM, p, 0, 0, 0, 0, 0, foresight, 0, 0, auv))
    for w in range(auv.shape[0]):
        for k in range(auv.shape[1]):
            belief_planner.begin(worlds, w, k)


def test_foresight_begins_where_auvs_are_deployed(device):
    made = Imagined(device, 9)
    auv = torch.rand((WORLDS, AUVS, len(AuvColumn.names)), device=device)
    foresight = made.arrays["foresight"]
    _begin(made.p, foresight, auv)
    wanted = torch.zeros_like(foresight)
    wanted[..., ForesightColumn.x], wanted[..., ForesightColumn.y] = auv[..., AuvColumn.x], auv[..., AuvColumn.y]
    wanted[..., ForesightColumn.speed] = 1.3
    torch.testing.assert_close(foresight, wanted)
