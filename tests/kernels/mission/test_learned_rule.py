"""The learned target rule: what it sees and how it scores, against NumPy; its draws; the file of its weights."""

import json
import math

import numpy as np
import pytest
import torch

from tests.kernels.mission.test_target_rules import CALM, choices, rollout, run
from tests.links import EVERY_STEP
from tests.slowly import slowly
from usvauv.env import Scenario, ScenarioError, World
from usvauv.kernels.mission.columns import AuvColumn, BeliefColumn, NodeColumn
from usvauv.kernels.mission.target_rules import learned
from usvauv.kernels.mission.target_rules.learned import FEATURES, HEAD, HIDDEN, Decision, Feature

CAPACITY, HOVER = 5000.0, 6.0
UNEQUAL = (*CALM, "nodes.arrival_rates=[1,4,30]")


def weights(seed):
    return np.random.default_rng(seed).normal(size=learned.NUM_WEIGHTS) * 0.4


def rule(tmp_path, numbers):
    path = tmp_path / "rule.json"
    path.write_text(json.dumps({"weights": [float(number) for number in numbers]}))
    return f"learned:{path}"


def scores(features, numbers):
    """(M,) by the formula of the module's head."""
    rows = np.asarray(numbers[1:]).reshape(HIDDEN, FEATURES + 2)
    hidden = np.maximum(features @ rows[:, :FEATURES].T + rows[:, FEATURES], 0.0)
    return numbers[0] * features[:, Feature.future] + hidden @ rows[:, FEATURES + 1]


def seen(world, w, k, taken, state, now):
    """Features (M, F) of all nodes for AUV k of world w at time `now`, from the world's arrays in double precision."""
    scenario = world.scenario
    speed, known = scenario.reference.straight_speed, scenario.nodes.information
    rates = np.array(scenario.nodes.arrival_rates)
    b = k if known == "own-visits" else 0
    count, exposure, since, left = (world.belief[w, b, :, c].double().numpy() for c in range(4))
    unknown = known in ("visits", "own-visits")
    rate = count / exposure if unknown else state.rate[w]

    def travel(places, origin):
        return np.maximum(np.linalg.norm(places - origin, axis=1) - HOVER, 0.0) / speed

    place = state.place[w]
    there = travel(place, state.position[w, k])
    backlog = state.backlog[w] + rate * there if known == "full" else left + rate * (now - since + there)
    backlog = np.minimum(backlog, CAPACITY) / CAPACITY
    spread = np.sqrt(rates.mean() / rates.var() / exposure) if unknown else np.zeros(len(rate))
    other = np.full(len(rate), 300.0)
    if known != "own-visits":
        for j in set(range(world.num_auvs)) - {k}:
            hover, target = state.hover[w, j], state.target[w, j]
            start = place[target] if hover == 0 else state.position[w, j]
            ready = hover if hover > 0 else travel(place[[target]], state.position[w, j])[0]
            other = np.minimum(other, ready + travel(place, start))
    free = np.array([i not in taken for i in range(len(rate))])
    distances = np.linalg.norm(place[:, None] - place[None], axis=-1)
    near = (1 / (1 + (distances / 50) ** 2)) * (1 - np.eye(len(rate))) * free
    duration = scenario.mission.duration
    features = np.zeros((len(rate), FEATURES))
    for name, column in {
        "travel": np.minimum(there / 100, 3),
        "backlog": backlog,
        "rate": np.minimum(rate / rates.mean(), 3),
        "uncertainty": spread,
        "waited": np.minimum((now - since) / 100, 3) / 3,
        "other": np.minimum(other / 100, 3),
        "lead": np.clip((other - there) / 100, -3, 3),
        "near_backlog": near @ backlog / 2,
        "near_uncertainty": near @ spread / 4,
        "all_backlog": 3 * (backlog * free).mean(),
        "all_uncertainty": spread.mean(),
        "left": 1 - now / duration,
        "end": math.exp(-(duration - now) / 100),
    }.items():
        features[:, getattr(Feature, name)] = column
    return features, free


@pytest.mark.parametrize("information", slowly(["full", "rates", "visits", "own-visits"], "rates", "visits"))
def test_sees_and_scores(tmp_path, information):
    numbers = weights(3)
    scenario = Scenario.load("ideal", [*UNEQUAL, f"nodes.information={information}"])
    world = World(scenario, 8, seed=5, targets=rule(tmp_path, numbers))
    checked = clear = 0
    for number, before, after in run(world, 300):
        for w, k in np.argwhere(after.served & (after.served.sum(1, keepdims=True) == 1)):
            taken = {before.target[w, k]}
            if information != "own-visits":
                taken |= {*np.delete(after.target[w], k).tolist()}
            else:
                taken |= {*np.flatnonzero(world.node[w, :, NodeColumn.owner].numpy() != k)}
            features, free = seen(world, w, k, taken, after, float(number))
            work = learned.decisions(world.rule_workspace, 12, 3)[w, k, HEAD:]
            work = work.reshape(12, FEATURES + 1).numpy()
            if information == "full":
                packets = rollout(scenario, after, w, k, learned.HORIZON)
                features[:, Feature.future] = np.where(free, (packets - packets[free].max()) / CAPACITY, -1.0)
            else:  # what is expected where less is known has tests of its own
                features[:, Feature.future] = work[:, Feature.future]
            assert work[:, :FEATURES] == pytest.approx(features, abs=2e-3)
            assert (work[:, FEATURES] > 0).tolist() == free.tolist()
            score = np.where(free, scores(features, numbers), -np.inf)
            first, second = np.sort(score)[[-1, -2]]
            checked += free.sum() > 1
            if free.sum() > 1 and first - second > 0.01:
                clear += 1
                assert after.target[w, k] == score.argmax()
    assert clear > 0.8 * checked > 30


def test_untrained_is_the_rule_rollout():
    scenario = Scenario.load("ideal", [*UNEQUAL, "nodes.information=visits"])
    names = "learned:untrained", f"rollout:{learned.HORIZON:g}"
    mine, other = (World(scenario, 8, seed=2, targets=name) for name in names)
    for one, two in zip(choices(mine, 300), choices(other, 300), strict=True):
        assert one[:2] == two[:2]
        assert one[4] == two[4]
    assert torch.equal(mine.auv, other.auv)


def test_draws_follow_the_scores():
    """How often AUV 0's first node is the best one, and the lowest-numbered one, beside its probabilities."""
    world = World(Scenario.load("ideal", [*UNEQUAL]), 4000, seed=4, targets="learned:untrained")
    world.rule_numbers[learned.EXPLORE] = 1.0
    world.rule_numbers[learned.WEIGHTS] = 0.7
    world.reset()
    work = learned.decisions(world.rule_workspace, 12, 3)[:, 0]
    table = work[:, HEAD:].reshape(4000, 12, FEATURES + 1).double()
    scores = (0.7 * table[..., Feature.future]).masked_fill(table[..., FEATURES] == 0, -math.inf)
    probability = scores.softmax(-1)
    chosen = work[:, Decision.chosen].long()
    for wanted in (probability.argmax(-1), torch.zeros_like(chosen)):
        p = probability.gather(1, wanted[:, None])[:, 0]
        deviation = (p * (1 - p)).sum().sqrt()
        assert abs((chosen == wanted).sum() - p.sum()) < 4 * deviation
        assert deviation > 10


def test_draws_are_those_of_a_world_alone():
    """Each AUV and node has a draw of its own, however many worlds there are."""
    first = []
    for worlds in (3, 40):
        world = World(Scenario.load("ideal", [*UNEQUAL]), worlds, seed=4, targets="learned:untrained")
        world.rule_numbers[learned.EXPLORE] = 1.0
        world.reset()
        first.append(learned.decisions(world.rule_workspace, 12, 3)[:3, :, Decision.chosen].clone())
    assert torch.equal(*first)
    assert len(first[0].unique()) > 3


@pytest.mark.parametrize("nodes", [1, 3])
def test_fewer_nodes_than_auvs(nodes):
    world = World(
        Scenario.load("ideal", [*EVERY_STEP, "auv.count=4", f"nodes.count={nodes}"]), 2, targets="learned:untrained"
    )
    for _ in choices(world, 60):
        pass
    assert world.belief[..., BeliefColumn.count].isfinite().all()
    assert 0 <= world.auv[..., AuvColumn.target].min() <= world.auv[..., AuvColumn.target].max() < nodes


@pytest.mark.parametrize(
    "content",
    [
        "",
        "[]",
        "{}",
        '{"weights": []}',
        json.dumps({"weights": [0.0] * (learned.NUM_WEIGHTS - 1)}),
        json.dumps({"weights": [0.0] * (learned.NUM_WEIGHTS - 1) + ["x"]}),
        json.dumps({"weights": [0.0] * (learned.NUM_WEIGHTS - 1) + [math.nan]}),
        json.dumps({"weights": [0.0] * (learned.NUM_WEIGHTS - 1) + [1e9]}),
        json.dumps({"weights": [0.0] * (learned.NUM_WEIGHTS - 1) + [10**400]}),
        "[" * 100_000,
    ],
)
def test_wrong_files_are_refused(tmp_path, content):
    path = tmp_path / "rule.json"
    path.write_text(content)
    with pytest.raises(ScenarioError, match=r"nodes\.target_rule.*no weights of a learned rule"):
        World(Scenario.load("ideal", EVERY_STEP), targets=f"learned:{path}")


@pytest.mark.parametrize(
    "text", ["learned", "learned:", "learned:/", "learned:/dev/zero", "learned:no-such-file", "learned:a\0b"]
)
def test_wrong_names_are_refused(text):
    with pytest.raises(ScenarioError, match=r"nodes\.target_rule.*no weights of a learned rule"):
        World(Scenario.load("ideal", EVERY_STEP), targets=text)
