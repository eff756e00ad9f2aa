"""The learned target rule: untrained, its draws, and the file of its weights."""

import json
import math

import pytest
import torch

from tests.kernels.mission.test_target_rules import CALM, choices
from tests.links import EVERY_STEP
from usvauv.env import Scenario, ScenarioError, World
from usvauv.kernels.mission.target_rules import learned
from usvauv.kernels.mission.target_rules.learned import FEATURES, HEAD, Decision, Feature

UNEQUAL = (*CALM, "nodes.arrival_rates=[1,4,30]", "nodes.information=visits")


def test_untrained_is_the_rule_rollout():
    scenario = Scenario.load("ideal", UNEQUAL)
    names = "learned:untrained", f"rollout:{learned.HORIZON:g}"
    mine, other = (World(scenario, 8, seed=2, targets=name) for name in names)
    for one, two in zip(choices(mine, 300), choices(other, 300), strict=True):
        assert one[:2] == two[:2]
        assert one[4] == two[4]
    assert torch.equal(mine.auv, other.auv)


def test_draws_follow_the_scores():
    """How often AUV 0's first node is the best one, and the lowest-numbered one, beside its probabilities."""
    world = World(Scenario.load("ideal", UNEQUAL), 4000, seed=4, targets="learned:untrained")
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
        world = World(Scenario.load("ideal", UNEQUAL), worlds, seed=4, targets="learned:untrained")
        world.rule_numbers[learned.EXPLORE] = 1.0
        world.reset()
        first.append(learned.decisions(world.rule_workspace, 12, 3)[:3, :, Decision.chosen].clone())
    assert torch.equal(*first)
    assert len(first[0].unique()) > 3


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
