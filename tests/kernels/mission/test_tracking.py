"""The task of tracking: how targets move, what ranges are measured, who follows whom, what counts as tracked."""

import math

import numpy as np
import pytest
import torch

from usvauv.env import Scenario, World
from usvauv.env.exchange.trace_tables import tables
from usvauv.env.record.metrics import task_metrics
from usvauv.env.record.recorder import record
from usvauv.env.record.trace import Trace
from usvauv.env.record.tracking_metrics import number
from usvauv.env.world.observation_layout import ObservationLayout
from usvauv.kernels.mission.columns import AuvColumn, BoatColumn, ExchangeColumn, NodeColumn
from usvauv.kernels.mission.tasks.task import SHIPPED, Outline, tasks
from usvauv.kernels.mission.tasks.tracking_columns import PairColumn, TargetColumn
from usvauv.kernels.mission.tasks.tracking_outlook import EACH, OWN
from usvauv.kernels.mission.tasks.tracking_plain import HelmColumn
from usvauv.policies.loading import load

XY = NodeColumn.span("x", "y")
STILL = ["current.count=0", "task_parameters.course_walk=0", "task_parameters.turn_after_most=0"]


def made(*changes: str, worlds: int = 32) -> World:
    """Worlds of `tracking-plain` at the beginning of an episode."""
    alike = "usbl.carriers=[18000]"  # with which teams of one are compiled as others
    world = World(Scenario.load("tracking-plain", [alike, *changes]), worlds, seed=3)
    world.reset()
    return world


def stepped(world: World, steps: int = 1) -> None:
    """Steps of AUVs that want to go east."""
    for _ in range(steps):
        world.step(torch.ones(world.num_worlds, world.num_auvs, 2) * torch.tensor([1.0, 0.0]))


def test_a_target_goes_straight_at_its_speed():
    world = made(*STILL)
    start, speed = world.node[..., XY].clone(), world.task_node[..., TargetColumn.speed].clone()
    stepped(world, 20)
    way = world.node[..., XY] - start
    np.testing.assert_allclose(way.norm(dim=-1), 600 * speed, rtol=1e-4)
    assert speed.min() >= 0.493
    assert speed.max() <= 0.69
    assert speed.max() - speed.min() > 0.18


def test_a_target_drifts_with_the_water():
    drifting = [*STILL, "task_parameters.target_speed_most=0", "task_parameters.target_speed_least=0"]
    world = made(*drifting, "task_parameters.drifts=1", "current.speed=0.2", "current.direction=0.5")
    start = world.node[..., XY].clone()
    stepped(world, 10)
    way = (world.node[..., XY] - start).mean((0, 1))
    np.testing.assert_allclose(way, [60 * math.cos(0.5), 60 * math.sin(0.5)], atol=0.05)


def test_turns_come_as_often_and_are_as_large_as_they_should():
    world = made("task_parameters.course_walk=0", worlds=200)
    before, turns = world.task_node[..., TargetColumn.course].clone(), []
    for _ in range(100):
        stepped(world)
        course = world.task_node[..., TargetColumn.course].clone()
        change = (course - before + math.pi) % (2 * math.pi) - math.pi
        turns.append(change)
        before = course
    change = torch.stack(turns)
    turned = change[change.abs() > 1e-4]
    gaps = [np.diff(np.flatnonzero(own)) for own in (change.abs() > 1e-4).flatten(1).T.numpy()]
    gaps = np.concatenate([own[np.cumsum(own) <= 70] for own in gaps])  # so that long ones are not left out
    count = np.bincount(gaps, minlength=15)
    assert not count[:5].any()
    assert (count[5:] / len(gaps)).max() < 0.125  # 5 to 14 steps, each as likely
    assert (count[5:15] / len(gaps)).min() > 0.08
    assert turned.abs().min() >= 0.6 - 1e-4
    assert turned.abs().max() <= 1.5 + 1e-4
    assert turned.abs().mean() == pytest.approx(1.05, rel=0.02)
    assert turned.mean().abs() < 0.05


def test_an_evasive_target_opens_the_distance():
    fast = ["task_parameters.target_speed_least=0.98", "task_parameters.target_speed_most=0.98"]
    apart = {}
    for distance in (0, 300):
        world = made(*STILL, *fast, "auv.count=1", "nodes.count=1", f"task_parameters.evade_range={distance}")
        policy, observation = load("straight", world), world.observation
        for _ in range(40):
            observation = world.step(policy.act(observation)).observation
        apart[distance] = world.task_node[..., TargetColumn.distance].median()
    assert apart[300] > apart[0] + 50


def test_ranges_have_the_noise_the_losses_and_the_limit_that_are_set():
    world = made("task_parameters.range_most=150", worlds=500)
    errors, lost, out = [], [], []
    for _ in range(20):
        stepped(world)
        away = world.node[:, None, :, XY] - world.auv[:, :, None, AuvColumn.span("x", "y")]
        depth = world.task_node[:, None, :, TargetColumn.depth] - 1.0
        slant = (away.square().sum(-1) + depth**2).sqrt()
        measured = world.task_pair[..., PairColumn.measured]
        near = slant <= 149.9
        errors.append((measured - slant)[near & (measured > 0)])
        lost.append((measured == 0)[near].float())
        out.append(measured[slant > 150.1])
    error = torch.cat(errors)
    assert len(error) > 5000
    assert error.mean().abs() < 4 * 10 / math.sqrt(len(error))
    assert error.std() == pytest.approx(10, rel=0.03)
    assert torch.cat(lost).mean() == pytest.approx(0.1, abs=0.01)
    assert not torch.cat(out).any()


def test_bearings_have_the_noise_that_is_set_and_no_range():
    world = made("task_parameters.ranges=0", "task_parameters.bearing_noise=0.05", worlds=200)
    errors = []
    for _ in range(20):
        stepped(world)
        away = world.node[:, None, :, XY] - world.auv[:, :, None, AuvColumn.span("x", "y")]
        pair = world.task_pair
        heard, bearing = pair[..., PairColumn.heard] > 0, pair[..., PairColumn.bearing]
        assert not pair[..., PairColumn.measured].any()
        error = bearing - torch.atan2(away[..., 1], away[..., 0])
        errors.append(((error + math.pi) % (2 * math.pi) - math.pi)[heard])
    error = torch.cat(errors)
    assert len(error) > 20000
    assert error.mean().abs() < 4 * 0.05 / math.sqrt(len(error))
    assert error.std() == pytest.approx(0.05, rel=0.03)


def test_a_fading_signal_is_heard_as_often_as_the_sonar_equation_says():
    world = made("task_parameters.signal_excess=55", "task_parameters.absorption=30", worlds=500)
    heard, expected = [], []
    for _ in range(20):
        stepped(world)
        away = world.node[:, None, :, XY] - world.auv[:, :, None, AuvColumn.span("x", "y")]
        depth = world.task_node[:, None, :, TargetColumn.depth] - 1.0
        slant = (away.square().sum(-1) + depth**2).sqrt().double()
        excess = 55 - 20 * torch.log10(slant) - 0.03 * slant
        heard.append(world.task_pair[..., PairColumn.heard][slant < 449])
        expected.append((0.9 * torch.exp(-(10 ** (-excess / 10))))[slant < 449])
    happened, chance = torch.cat(heard).double(), torch.cat(expected)
    for least in (0.0, 0.4, 0.6, 0.8):
        some = (chance >= least) & (chance < least + 0.2)
        assert some.sum() > 500
        assert happened[some].mean() == pytest.approx(float(chance[some].mean()), abs=4 * 0.5 / math.sqrt(some.sum()))


@pytest.mark.parametrize(
    "measured",
    [
        ("task_parameters.ranges=0", "task_parameters.bearing_noise=0.05"),
        ("task_parameters.ranges=1", "task_parameters.bearing_noise=0.05"),
        # Compiled as in `test_listening_boats.py`.
        ("task=tracking", "task_parameters.depth_most=80", "boat.count=2", "task_parameters.boat_listens=0"),
    ],
    ids=("bearings", "both", "ranges, depths not known"),
)
def test_what_is_measured_in_missions_locates_targets_consistently(measured):
    """Squared errors are as large as the covariances say, where AUVs know their place."""
    world = made(*measured)
    policy, observation, squared = load("circle", world), world.observation, []
    for step in range(80):
        observation = world.step(policy.act(observation)).observation
        target = world.task_node.double()
        error = target[..., TargetColumn.span("estimate_x", "estimate_y")] - world.node[..., XY]
        xx, xy, yy = target[..., TargetColumn.span("covariance_xx", "covariance_yy")].unbind(-1)
        x, y = error.unbind(-1)
        if step >= 30:
            squared.append(0.5 * (yy * x * x - 2 * xy * x * y + xx * y * y) / (xx * yy - xy * xy))
    found = torch.stack(squared)
    lost = found > 20  # unawares, which is rare
    assert lost.double().mean() < 0.02
    assert found[~lost].mean() == pytest.approx(1, abs=0.25)


def test_while_auvs_and_boat_send_messages_it_locates_nobody():
    """Four messages of 1.5 s every 10 s, and exchanges of less than 1 s."""
    world = World(Scenario.load("tracking", ["task_parameters.message_time=1.5"]), 8, 1)
    world.reset()
    located = []
    for _ in range(100):
        world.step(torch.zeros(8, 3, world.action_size))
        located.append(world.exchange[..., ExchangeColumn.over].mean())
    since = torch.stack(located).view(10, 10)[1:].mean(0)  # 1 to 10 s after a measurement
    assert (since[1:6] == 0.0).all()
    assert (since[7:] > 0.9).all()


def test_every_target_has_a_follower():
    world = made("auv.count=4", "nodes.count=3")
    stepped(world, 30)
    for targets in world.auv[..., AuvColumn.target].long():
        assert set(targets.tolist()) == {0, 1, 2}


def test_an_auv_goes_from_one_of_two_targets_to_the_other():
    world = made("auv.count=1", "nodes.count=2", "task_parameters.target_speed_most=0.5")
    policy, observation, followed = load("circle", world), world.observation, []
    for _ in range(100):
        observation = world.step(policy.act(observation)).observation
        followed.append(world.auv[:, 0, AuvColumn.target].clone())
    share = torch.stack(followed).mean(0)
    assert ((share > 0.2) & (share < 0.8)).double().mean() > 0.9


def test_an_auv_by_the_published_rules_turns_by_neighbouring_rudders_and_goes_straight():
    world = made()
    generator = torch.Generator().manual_seed(1)
    course, rudder = (world.task_auv[..., column].clone() for column in (HelmColumn.course, HelmColumn.rudder))
    errors = []
    for _ in range(40):
        before = world.auv[..., AuvColumn.span("x", "y")].clone()
        world.step(2 * torch.rand(32, 3, 2, generator=generator) - 1)
        way = world.auv[..., AuvColumn.span("x", "y")] - before
        np.testing.assert_allclose(way.norm(dim=-1), 29.58, rtol=1e-4)
        new, now = world.task_auv[..., HelmColumn.course], world.task_auv[..., HelmColumn.rudder]
        np.testing.assert_allclose(torch.atan2(way[..., 1], way[..., 0]), new, atol=1e-4)
        assert (now - rudder).abs().max() <= 1
        assert now.abs().max() <= 2
        errors.append((new - course + 6.052 * 0.12 * now + 0.0005 + math.pi) % (2 * math.pi) - math.pi)
        course, rudder = new.clone(), now.clone()
    error = torch.stack(errors)
    assert error.mean().abs() < 1e-3
    assert error.std() == pytest.approx(0.02, rel=0.05)


def test_the_reward_counts_errors_as_published():
    world = made("auv.start_separation=30", "task_parameters.deviation=-2")
    stepped(world, 30)
    error, distance = (world.task_node[..., column].double() for column in (TargetColumn.error, TargetColumn.distance))
    t = ((error - 10) / 40).clamp(0, 1 - 1e-9)
    expected = torch.exp(-2 * t / (1 - t)).mean(-1)
    terms = dict(zip(world.reward_names, world.reward_terms.unbind(-1), strict=True))
    np.testing.assert_allclose(terms["tracked"], expected[:, None].expand(-1, 3), atol=1e-5)
    np.testing.assert_allclose(terms["covered"], (distance <= 150).double().mean(-1)[:, None].expand(-1, 3), atol=1e-6)
    assert 0 < expected.mean() < 1
    variance = world.task_node[..., TargetColumn.covariance_xx] + world.task_node[..., TargetColumn.covariance_yy]
    deviation = (variance.double().sqrt() / 50).clamp(max=3).mean(-1)
    np.testing.assert_allclose(terms["deviation"], -2 * deviation[:, None].expand(-1, 3), atol=1e-4)


def test_on_a_circle_an_auv_keeps_its_distance():
    still = ["task_parameters.target_speed_most=0", "task_parameters.target_speed_least=0", "auv.count=1"]
    world = made(*STILL, *still, "nodes.count=1", "task_parameters.range_noise=0.5")
    policy, observation, distances = load("circle:80", world), world.observation, []
    for step in range(100):
        observation = world.step(policy.act(observation)).observation
        if step >= 40:
            distances.append(world.task_node[..., TargetColumn.distance].clone())
    assert torch.stack(distances).mean() == pytest.approx(80, abs=8)


def test_who_looks_ahead_knows_targets_better():
    """Than on circles, by mean errors in the same worlds."""
    errors = []
    for rule in ("tree:3", "circle"):
        world = made("task_parameters.target_speed_least=0.15", "task_parameters.target_speed_most=0.49", worlds=96)
        policy, observation, found = load(rule, world), world.observation, []
        for step in range(100):
            observation = world.step(policy.act(observation)).observation
            if step >= 20:
                found.append(world.task_node[..., TargetColumn.error].clone())
        errors.append(torch.stack(found).mean((0, 2)).double())
    gain = errors[1] - errors[0]
    assert gain.mean() > 3 * gain.std() / math.sqrt(len(gain))


def information(place: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Of a range of `tracking-plain`, with the probability that it is measured, (2, 2)."""
    off = target - place
    slant = math.hypot(*off, 11.5)
    return 0.9 / (1 + math.exp((slant - 450) / 25)) * np.outer(off, off) / slant**2 / 100


def directions(course: float, turns: list[float]) -> np.ndarray:
    """Unit vectors of a course after each of these turns by 0.726 rad, one after another, (N, 2)."""
    angles = course + 0.726 * np.cumsum(turns)
    return np.stack([np.cos(angles), np.sin(angles)], -1)


def test_the_outlook_is_what_rudders_leave_of_each_target():
    """Deviations with the last rudder less those with its neighbours, by a Kalman filter's covariances, m."""
    world = made(worlds=8)
    policy, place = load("tree", world), ObservationLayout.of(world.scenario).slice("outlook")
    for _ in range(12):
        world.step(policy.act(world.observation))
    pairs, auv, helm = (each[:, 0].double().numpy() for each in (world.task_pair, world.auv, world.task_auv))
    auvs, helms = world.auv.double().numpy(), world.task_auv.double().numpy()
    numbers = world.observation[:, 0, place].double().numpy()[:, len(OWN) + len(EACH) :].reshape(8, 3, len(EACH))
    for w in range(8):
        others = [
            auvs[w, k, :2] + 30 * 0.986 * directions(helms[w, k, HelmColumn.course], 3 * [-rudder]).cumsum(0)
            for k, rudder in enumerate(helms[w, :, HelmColumn.rudder])
        ][1:]
        for i in range(3):
            deviations = []
            for side in (0, -1, 1):
                rudder = np.clip(helm[w, HelmColumn.rudder] + side, -2, 2)
                own = auv[w, :2] + 30 * 0.986 * directions(helm[w, HelmColumn.course], 3 * [-rudder]).cumsum(0)
                P = pairs[w, i, [PairColumn.xx, PairColumn.xy, PairColumn.xy, PairColumn.yy]].reshape(2, 2)
                deviations.append([])
                for n in range(3):
                    target = pairs[w, i, PairColumn.span("x", "y")].copy()
                    target += 30 * (n + 1) * pairs[w, i, PairColumn.span("vx", "vy")]
                    J = sum(information(way[n], target) for way in (own, *others))
                    P = np.linalg.inv(np.linalg.inv(P + (0.3 * 0.69 * 30) ** 2 * np.eye(2)) + J)
                    deviations[-1].append(math.sqrt(np.trace(P)))
            last, *sides = np.array(deviations)
            expected = [*((last - each)[0] for each in sides), *((last - each).mean() for each in sides)]
            np.testing.assert_allclose(numbers[w, i, -4:], np.clip(expected, -5, 5), atol=2e-3)


@pytest.mark.parametrize("team", [1, 2])
def test_tree_chooses_the_way_that_leaves_least_variance(team):
    """The first AUV, against all ways that its rudder allows, each with a Kalman filter's covariance of each target.

    An AUV alone keeps its rudder, and near the course of `circle`.
    """
    world = made(f"auv.count={team}", f"nodes.count={team}", worlds=16)
    policy, circle = load("tree:2", world), load("circle", world)
    for _ in range(12):
        world.step(policy.act(world.observation))
    pairs, auv, helm = (each.double().numpy() for each in (world.task_pair[:, 0], world.auv, world.task_auv))
    action, circling = (rule.act(world.observation)[:, 0].double().numpy() for rule in (policy, circle))
    for w in range(16):
        if not pairs[w, :, PairColumn.known].all():
            continue
        course, rudder = helm[w, :, HelmColumn.course], helm[w, :, HelmColumn.rudder]
        place, own = auv[w, :, AuvColumn.span("x", "y")], int(auv[w, 0, AuvColumn.target])
        far = math.hypot(*(pairs[w, own, PairColumn.span("x", "y")] - place[0]))
        losses = []
        for way in [(a, b) for a in range(-2, 3) for b in range(-2, 3) if abs(a + rudder[0]) <= 1 and abs(a - b) <= 1]:
            headings = [directions(course[0], way), *(directions(course[k], 2 * [-rudder[k]]) for k in range(1, team))]
            ways = [place[k] + 30 * 0.986 * headings[k].cumsum(0) for k in range(team)]
            variances, off = np.zeros((team, 2)), 0.0
            for i in range(team):
                P = pairs[w, i, [PairColumn.xx, PairColumn.xy, PairColumn.xy, PairColumn.yy]].reshape(2, 2)
                for n in range(2):
                    target = pairs[w, i, PairColumn.span("x", "y")].copy()
                    target += 30 * (n + 1) * pairs[w, i, PairColumn.span("vx", "vy")]
                    J = sum(information(each[n], target) for each in ways)
                    P = np.linalg.inv(np.linalg.inv(P + (0.3 * 0.69 * 30) ** 2 * np.eye(2)) + J)
                    variances[i, n] = np.trace(P)
                    if i == own:
                        leash = 13 * 30 * (0.986 - 0.69)
                        off += 10 * max(math.hypot(*(target - ways[0][n])) - leash, 0)
            loss = variances.sum() + off
            if team == 1:
                loss = np.sqrt(variances).mean() + 30 * min(far / 120, 1) * (1 - headings[0][0] @ circling[w])
            if team > 1 or way[0] == way[1]:
                losses.append((loss, headings[0][0]))
        best = min(losses, key=lambda each: each[0])[1]
        assert action[w] @ best == pytest.approx(np.linalg.norm(action[w]), rel=1e-4)


def test_figures_of_merit_are_those_of_the_trace(tmp_path):
    scenario = Scenario.load("tracking-plain", ["mission.duration=1200"])
    world = World(scenario, 4, seed=5)
    trace = record(world, load("circle", world).act, "circle")
    trace.save(tmp_path / "t.nc")
    again = Trace.load(tmp_path / "t.nc")
    error = np.hypot(*np.moveaxis(again.node_estimate - again.node_way, -1, 0))[19:].reshape(21, 4, 3)
    values = {name: metric.values(again) for name, metric in task_metrics.items() if metric.belongs_to("tracking")}
    np.testing.assert_allclose(values["track_error_mean"], error.mean((0, 2)), rtol=1e-5)
    np.testing.assert_allclose(values["track_close"], (error <= 20).mean((0, 2)), rtol=1e-5)
    own = world.task_node[..., TargetColumn.error].numpy()
    np.testing.assert_allclose(error[-1], own, atol=2e-3)
    apart = again.node_way[-1, :, None] - again.auv_position[-1, :, :, None]
    height = world.task_node[..., TargetColumn.depth].numpy()[:, None] - again.depth[-1][..., None]
    heard, slant = again.node_range[-1] > 0, np.sqrt(np.square(apart).sum(-1) + height**2)
    assert heard.mean() > 0.25
    noise = (again.node_range[-1] - slant)[heard]
    assert 0.01 < np.abs(noise).max() < 6 * number(again, "range_noise")
    rows = tables(again)["ranges"]
    assert len(rows["node"]) == np.count_nonzero(again.node_range)
    assert {*rows["auv"].tolist()} == {*range(1, scenario.auv.count + 1)}


def test_a_stored_world_goes_on_with_the_same_filters():
    world = made()
    stepped(world, 5)
    state = world.state()
    stepped(world, 5)
    expected = world.task_pair.clone()
    world.load_state(state)
    stepped(world, 5)
    assert torch.equal(world.task_pair, expected)


@pytest.mark.parametrize("task", SHIPPED)
def test_a_task_is_what_is_known_of_it_without_taichi(task):
    assert {name: getattr(tasks[task], name) for name in Outline._fields} == SHIPPED[task]._asdict()


@pytest.mark.parametrize("listens", [1, 0])
def test_who_looks_ahead_leaves_to_a_listening_boat_what_it_measures(listens):
    """South-west of its target an AUV goes to the south of it with the boat in the east, not with one in the north."""
    numbers = ["message_time=1.5", f"boat_listens={listens}", "places_known=1", "target_speed_most=0.3"]
    world = World(Scenario.load("tracking", [f"task_parameters.{number}" for number in numbers]), 1, 1)
    observation, pair, rule = world.reset(), world.task_pair, load("tree:3", world)
    target = torch.tensor([1200.0, 1200.0])
    world.auv[:, 0, AuvColumn.span("x", "y")] = target - 100.0
    world.auv[:, 1:, AuvColumn.span("x", "y")] = target - 900.0
    pair[..., PairColumn.known] = 1.0
    pair[..., PairColumn.span("x", "y")] = target
    pair[..., PairColumn.span("xx", "yy")] = torch.tensor([400.0, 0.0, 400.0])
    eastward = []
    for boat in ([150.0, 0.0], [0.0, 150.0]):
        world.boat[:, 0, BoatColumn.span("x", "y")] = target + torch.tensor(boat)
        x, y, *_ = rule.act(observation)[0, 0].tolist()
        eastward.append(x - y)
    assert eastward[0] - eastward[1] > 0.5 if listens else eastward[0] == eastward[1]
