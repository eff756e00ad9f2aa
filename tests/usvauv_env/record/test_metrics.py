"""Figures of merit: of random traces by plain loops, of worlds step by step, and the error that no boat can beat."""

import math
import statistics
from dataclasses import replace
from itertools import chain, product

import numpy as np
import pytest
import torch
from scipy.optimize import brentq

from tests.links import EVERY_STEP
from tests.usvauv_env.record.test_trace import AUVS, NODES, STEP, STEPS, WORLDS, random_trace
from usvauv.env import Scenario, Trace, World, run_episodes
from usvauv.env.accuracy import fix_errors
from usvauv.env.accuracy.fix_errors import SUM, error_budget
from usvauv.env.record import evaluation
from usvauv.env.record.metrics import COLUMNS, energy_consumption, episode_metrics, mean_figures, newest_birth, usable
from usvauv.env.record.recorder import record
from usvauv.env.record.trace import VARIABLES
from usvauv.env.site.site import Site
from usvauv.env.storage.result_tables import read_rows, write_rows
from usvauv.env.world.mission_parameters import link_table
from usvauv.kernels.mission.columns import AuvColumn
from usvauv.kernels.planning import objectives, search
from usvauv.kernels.positioning import usbl
from usvauv.policies import load


@pytest.fixture
def trace() -> Trace:
    return random_trace()


def spread(values: list[float]) -> dict[str, float]:
    """Mean, median, rms and 95th percentile, which lies at 0.95 (n − 1) among the sorted values from the first on."""
    ordered = sorted(values)
    place = 0.95 * (len(values) - 1)
    low = int(place)
    return {
        "mean": statistics.fmean(values),
        "median": statistics.median(values),
        "rms": math.sqrt(statistics.fmean(value * value for value in values)),
        "p95": ordered[low] + (place - low) * (ordered[low + 1] - ordered[low]),
    }


def by_loops(trace: Trace, w: int) -> dict[str, float]:
    """The figures of world w, by their definitions."""
    every = [(t, k) for t in range(STEPS) for k in range(AUVS)]
    flags = {at: int(trace.fix_flags[at[0], w, at[1]]) for at in every}
    heard = [at for at in every if flags[at] & usbl.DETECTED]
    used = [at for at in heard if not flags[at] & usbl.NO_DEPTH]

    def distance(one: str, other: str, t: int, k: int) -> float:
        return math.dist(getattr(trace, one)[t, w, k], getattr(trace, other)[t, w, k])

    ec, runs = [], [0]
    for k in range(AUVS):
        energy = sum(float(trace.power[t, w, k]) * STEP for t in range(STEPS))
        ec.append(energy / (STEP * STEPS - STEP * sum(int(trace.hovering[t, w, k]) for t in range(STEPS))))
        run = 0
        for t in range(STEPS):
            run = 0 if (t, k) in used else run + 1
            runs.append(run)
    born, ages, peaks, data = [0.0] * NODES, [], [], [0.0] * NODES
    for t in range(STEPS):
        before = [STEP * t - each if t else 0.0 for each in born]
        for k in range(AUVS):
            node = trace.target[max(t - 1, 0), w, k]
            data[node] += float(trace.delivered[t, w, k])
            if trace.service_rate[t, w, k] > 0:
                arrival = next((s for s in range(t, -1, -1) if not trace.hovering[s, w, k]), -1)
                peaks.append(before[node] + STEP)
                born[node] = max(born[node], STEP * arrival)
        ages += [STEP * (t + 1) - each for each in born]
    served = [(t, k) for t, k in every if trace.service_rate[t, w, k] > 0]
    energy = STEP * sum(float(trace.power[t, w, k]) for t, k in every)
    brought = sum(float(trace.delivered[t, w, k]) for t, k in every)
    errors = {
        "position_error": [distance("estimate", "auv_position", *at) for at in every],
        "own_error": [distance("own_position", "auv_position", *at) for at in every],
        "fix_error": [distance("fix", "heard_position", *at) for at in used],
    }
    return {
        "episode": 10 + w,
        "sdr": sum(float(trace.service_rate[t, w, k]) for t, k in served),
        "ec": statistics.fmean(ec),
        "arps": sum(float(trace.reward_terms[t, w, k, r]) for t, k in every for r in range(2)) / STEPS,
        "services": len(served),
        "delivered_mbit": brought,
        "energy_wh": energy / 3600,
        "boat_energy_wh": STEP * float(trace.boat_power[:, w].sum(dtype=float)) / 3600,
        "spent": sum(float(trace.auv_charge[-1, w, k]) == 0 for k in range(AUVS)),
        "spent_first": min(float(trace.time[t]) for t, k in every if trace.auv_charge[t, w, k] == 0),
        "target_distance": statistics.fmean(
            math.dist(trace.node_places[t, w, trace.target[t, w, k]], trace.auv_position[t, w, k]) for t, k in every
        ),
        **{name: sum(int(trace.__dict__[f][t, w]) for t in range(STEPS)) for name, f in
           (("overflow", "overflowing"), ("collisions", "collisions"))},
        "border": sum(int(trace.border[t, w, k]) for t, k in every),
        "surfaced": sum(int(trace.auv_touched[t, w, k]) in (1, 3) for t, k in every),
        "grounded": sum(int(trace.auv_touched[t, w, k]) in (2, 3) for t, k in every),
        **{f"{name}_{part}": value for name, values in errors.items() for part, value in spread(values).items()},
        "fix_availability": len(used) / len(every),
        "fix_wrapped": sum(bool(flags[at] & usbl.WRAPPED) for at in used) / len(used),
        "fix_dropped": 1 - len(used) / len(heard),
        "outage_longest": STEP * max(runs),
        "lost_mbit": sum(int(trace.packets_lost[t, w]) for t in range(STEPS)) * 3 / 4000,
        "aoi_mean": statistics.fmean(ages),
        "aoi_peak": statistics.fmean(peaks),
        "aoi_largest": max(ages),
        "jain": sum(data) ** 2 / NODES / sum(each**2 for each in data),
        "joule_per_mbit": energy / brought,
    }  # fmt: skip


def test_figures_by_loops(trace):
    rows = episode_metrics(trace, first_episode=10)
    assert [(row.scenario, row.policy, row.usv, row.seed, row.targets) for row in rows] == [
        ("ideal", "random", "fim", 3, "tour")
    ] * WORLDS
    assert [row.episode for row in episode_metrics(trace)] == [0, 1, 2]
    for w, row in enumerate(rows):
        expected = by_loops(trace, w)
        found = {name: value for name, value in row.columns().items() if not isinstance(value, str) and name != "seed"}
        assert found == pytest.approx(expected, rel=1e-5)


def test_an_episode_without_fixes_or_services_has_no_figures_of_them(trace):
    """NaN, and means are of the episodes that have a figure."""
    nothing = np.zeros_like(trace.delivered)
    empty = replace(
        trace,
        fix_flags=np.full_like(trace.fix_flags, usbl.LOST),
        fix=np.full_like(trace.fix, np.nan),
        service_rate=nothing,
        delivered=nothing,
    )
    row = episode_metrics(empty)[0]
    assert (row.fix_availability, row.outage_longest) == (0, STEP * STEPS)
    of_fixes = [row.fix_error_mean, row.fix_error_median, row.fix_error_rms, row.fix_error_p95, row.fix_wrapped]
    assert np.isnan([*of_fixes, *(row.of_task[name] for name in ("aoi_peak", "jain", "joule_per_mbit"))]).all()
    whole = episode_metrics(trace)[1]
    means = mean_figures([row, whole])
    assert means["joule_per_mbit"] == whole.of_task["joule_per_mbit"]
    assert means["services"] == whole.services / 2


def test_ec_leaves_out_the_exact_length_of_services(trace):
    """A service of 4 Mbit at 1.25 Mbit/s takes 3.2 s of two steps of 2 s: these are left out, not 4 s."""
    power, hovering, rate, data = (np.zeros((STEPS, WORLDS, AUVS)) for _ in range(4))
    power[:], hovering[2:4, 0, 0], rate[3, 0, 0], data[3, 0, 0] = 100.0, 1, 1.25, 1.5 + 1.25 * STEP
    exact = Scenario.from_dict(trace.scenario.to_dict() | {"nodes": {"count": NODES, "hovering_time": "exact"}})
    served = replace(trace, scenario=exact, power=power, hovering=hovering, service_rate=rate, delivered=data)
    T, length = STEP * STEPS, 1.2 + STEP
    assert energy_consumption(served)[-1, 0] == pytest.approx((100 * T / (T - length) + (AUVS - 1) * 100) / AUVS)
    assert episode_metrics(served)[0].ec == energy_consumption(served)[-1, 0]


def test_usable_fixes_are_those_that_the_boat_uses():
    """Without a tracker the estimate is the last usable fix: it changes when there is one, and to it."""
    noisy = [*EVERY_STEP, "auv.count=3", "acoustics.source_level=146", "usbl.packet_loss=0.2", "usbl.spacing=0.052"]
    noisy += ["observation.current=vector"]  # compiled as where an array is wide
    world = World(Scenario.load("extreme", ["mission.duration=60", *noisy]), num_worlds=4, seed=1, usv="hold:0,0")
    trace = record(world, lambda _: torch.zeros(4, 3, 2), "still")
    had = usable(trace)
    for flag in (usbl.DETECTED, usbl.NO_DEPTH, usbl.LOST, usbl.AMBIGUOUS):
        assert (trace.fix_flags & flag == flag).any()
    assert 0.1 < had.mean() < 0.9
    np.testing.assert_array_equal(trace.estimate[had], trace.fix[had])
    kept = ~had[1:]
    np.testing.assert_array_equal(trace.estimate[1:][kept], trace.estimate[:-1][kept])


def test_csv_has_the_promised_columns(tmp_path):
    promised = (
        "scenario policy usv seed episode sdr ec arps services delivered_mbit energy_wh boat_energy_wh spent "
        "spent_first target_distance overflow collisions border surfaced grounded "
        "position_error_mean position_error_median position_error_rms position_error_p95 "
        "own_error_mean own_error_median own_error_rms own_error_p95 "
        "fix_error_mean fix_error_median fix_error_rms fix_error_p95 fix_availability fix_wrapped fix_dropped "
        "outage_longest targets"
    )
    assert " ".join(COLUMNS) == promised
    rows = episode_metrics(random_trace())
    write_rows(tmp_path / "m.csv", list(rows[0].columns()), (row.columns() for row in rows))
    read = read_rows(tmp_path / "m.csv")[0]
    assert tuple(read) == (*COLUMNS, "lost_mbit", "aoi_mean", "aoi_peak", "aoi_largest", "jain", "joule_per_mbit")
    assert float(read["ec"]) == rows[0].ec
    assert [path.name for path in tmp_path.iterdir()] == ["m.csv"]


def test_trace_agrees_with_the_reward_the_learner_sees():
    world = World(Scenario.load("extreme", ["mission.duration=50"]), num_worlds=3, seed=1)
    rewards = []

    def act(observation: torch.Tensor) -> torch.Tensor:
        rewards.append(world.reward.sum(dim=1).clone())
        return torch.zeros(3, 2, 2)

    trace = record(world, act, "still")
    rewards = torch.stack([*rewards[1:], world.reward.sum(dim=1)]).double().mean(dim=0)
    arps = [row.arps for row in episode_metrics(trace)]
    np.testing.assert_allclose(arps, rewards.cpu().numpy(), rtol=1e-5)


def test_is_what_happens_in_worlds():
    """The newest births, followed in the state of three worlds, step by step."""
    world, twin = (World(Scenario.load("extreme", ["mission.duration=400"]), 3, seed=5) for _ in "ab")
    policy = load("pace", world)
    trace = record(twin, load("pace", twin).act, "pace")
    observation = world.reset()
    birth, begun, expected = torch.zeros(3, 30), torch.zeros(3, 2), []
    for step in range(400):
        hovering, target = world.auv[..., AuvColumn.hover] > 0, world.auv[..., AuvColumn.target].long()
        observation = world.step(policy.act(observation))[0]
        begun[~hovering & (world.auv[..., AuvColumn.hover] > 0)] = step  # s, the begin of this step
        for w, k in (world.auv[..., AuvColumn.service_rate] > 0).nonzero().tolist():
            birth[w, target[w, k]] = max(birth[w, target[w, k]], begun[w, k])
        expected.append(birth.clone().numpy())
    assert (trace.service_rate > 0).sum() > 10
    assert np.array_equal(newest_birth(trace), np.stack(expected))


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return Scenario.load("extreme", ["mission.duration=10"])


def texts(rows):
    """Rows as text, in which a NaN equals itself."""
    return [str(row) for row in rows]


class East:
    """A constant action, as an object."""

    def __init__(self, world):
        self.action = torch.zeros(world.num_worlds, world.num_auvs, 2)
        self.action[..., 0] = 0.8

    def act(self, observation):
        return self.action


def east(world):
    """The constant action of `East`, as a function."""
    return East(world).act


def test_each_policy_has_the_episodes_of_the_seed(scenario):
    rows = run_episodes(scenario, {"object": East, "function": east}, episodes=3, seed=5)
    assert [(row.policy, row.episode) for row in rows] == [*product(("object", "function"), range(3))]
    world = World(scenario, 3, 5)
    expected = episode_metrics(record(world, east(world), "expected"))
    for of_one in (rows[:3], rows[3:]):
        assert texts(replace(row, policy="expected") for row in of_one) == texts(expected)


def test_batches_change_nothing_and_are_told_of(scenario, monkeypatch):
    whole = run_episodes(scenario, {"east": East}, episodes=5)
    monkeypatch.setattr(evaluation, "WORLDS_PER_BATCH", 2)
    batches, steps, traces = [], [], []
    told = {"on_step": steps.append, "on_batch": batches.append, "on_trace": lambda *given: traces.append(given)}
    rows = run_episodes(scenario, {"east": East}, episodes=5, **told)
    assert texts(rows) == texts(whole) == texts(chain(*batches))
    assert [len(batch) for batch in batches] == [2, 2, 1]
    assert texts(rows) == texts(chain(*(episode_metrics(trace, first) for trace, first in traces)))
    assert steps == [2] * 20 + [1] * 10


def test_complete_batches_are_kept_when_a_policy_fails(scenario, monkeypatch):
    monkeypatch.setattr(evaluation, "WORLDS_PER_BATCH", 2)
    kept = []

    def fails_later(world):
        return east(world) if not kept else lambda observation: 1 / 0

    with pytest.raises(ZeroDivisionError):
        run_episodes(scenario, {"late": fails_later}, episodes=4, on_batch=kept.extend)
    assert [row.episode for row in kept] == [0, 1]


def test_the_variance_is_that_of_a_fix_from_the_best_place(device):
    """With the depth below the water under the boat that serves the AUV."""
    whole = random_trace()
    first = {name: getattr(whole, name)[:2] for name, about in VARIABLES.items() if about.dimensions[0] == "time"}
    trace = replace(whole, **first)
    found = fix_errors.best_variance(trace)
    assert found.shape == trace.power.shape
    scenario = trace.scenario
    link, code = torch.from_numpy(link_table(Site(scenario))).to(device), objectives.objective_code("fix", "d")
    for t, w in ((0, 0), (1, 2)):
        water = [trace.boat_surface[t, w, boat, 0] for boat in trace.served_by[t, w]]
        auvs = [(*map(float, xy), 100.0 + float(z)) for xy, z in zip(trace.auv_position[t, w], water, strict=True)]
        points = torch.tensor([auvs], device=device)
        best = search.plan_batch(link, points, code=code, width=300.0, length=240.0)[0, :2].tolist()
        budget = error_budget(scenario, link, auvs, tuple(best), "fix", (0.0, 0.0))[SUM]
        np.testing.assert_allclose(found[t, w], np.square(budget) / 2, rtol=0.01)


@pytest.mark.parametrize("variances", [[4.0], [1.0, 1.0, 100.0], [0.01, 9.0, 9.0, 16.0]])
def test_the_median_of_plane_normals(variances):
    v = np.array(variances)
    expected = brentq(lambda m: np.mean(1 - np.exp(-m * m / (2 * v))) - 0.5, 0, 1e3, xtol=1e-13)
    assert fix_errors.median_of_normals(v) == pytest.approx(expected, rel=1e-9)
    assert len(v) > 1 or expected == pytest.approx(2 * math.sqrt(2 * math.log(2)))
