"""Training of decisions, on the learned target rule: advantages, network, and runs of the command."""

import json
import math
import re
import signal

import numpy as np
import pytest
import torch

from tests.links import EVERY_STEP
from usvauv import policies
from usvauv.env import Scenario, World
from usvauv.kernels.mission.target_rules import learned, parse
from usvauv.kernels.mission.target_rules.learned import FEATURES, HEAD, Decision, Feature
from usvauv.policies.decisions import (
    EVALUATION_EPISODES,
    DecisionConfig,
    Decisions,
    DecisionTrainer,
    Scores,
    advantages,
    collect,
    split,
)
from usvauv.policies.training.figures import EVALUATION_SEED_OFFSET

SMALL = (*EVERY_STEP, "auv.count=3", "nodes.count=12", "nodes.arrival_rates=[1,30]", "nodes.information=visits")


def worlds(count, *changes):
    world = World(Scenario.load("ideal", [*SMALL, *changes]), count, 3, "centroid", "learned:untrained")
    world.rule_numbers[learned.EXPLORE] = 1.0
    return world, policies.acting("straight", world)


def network(seed):
    generator = torch.Generator().manual_seed(seed)
    scores = Scores()
    scores.load((0.3 * torch.randn(learned.NUM_WEIGHTS, generator=generator)).tolist())
    return scores


class TestDraws:
    def test_they_follow_the_scores(self):
        """How often AUV 0's first node is the best one, and the lowest-numbered one, beside its probabilities."""
        world, _ = worlds(4000)
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

    def test_they_are_those_of_a_world_alone(self):
        """Each AUV and node has a draw of its own, however many worlds there are."""
        first = []
        for count in (3, 40):
            world, _ = worlds(count)
            world.reset()
            first.append(learned.decisions(world.rule_workspace, 12, 3)[:3, :, Decision.chosen].clone())
        assert torch.equal(*first)
        assert len(first[0].unique()) > 3


class TestCollect:
    def test_all_data_are_earned(self):
        """With no discount the decisions of a world earn what it delivers."""
        world, act = worlds(6, "mission.duration=300")
        decisions = collect(world, act, 1e12)
        earned = torch.zeros(6, device=world.device).index_add(0, decisions.world, decisions.earned)
        assert earned.tolist() == pytest.approx(decisions.total.tolist(), rel=1e-5)
        assert decisions.total.min() > 1

    def test_discount(self):
        """A service counts exp(−t/T) less, t from the decision to its end."""
        world, act = worlds(1, "mission.duration=200", "auv.count=1")
        plain, discounted = (collect(world, act, horizon) for horizon in (1e12, 50.0) if not world.rewind())
        lasts = plain.time.diff()
        assert plain.time.tolist() == discounted.time.tolist()
        assert len(lasts) > 3
        assert discounted.earned[:-1].tolist() == pytest.approx((plain.earned[:-1] * torch.exp(-lasts / 50)).tolist())


class TestAdvantages:
    def decisions(self):
        return Decisions(
            torch.zeros(5, 1),
            torch.tensor([0, 0, 0, 1, 1]),
            torch.tensor([0.0, 10.0, 10.0, 0.0, 30.0]),
            torch.tensor([1.0, 2.0, 4.0, 8.0, 16.0]),
            torch.zeros(2),
        )

    def test_whole_episodes(self):
        """With λ = 1 the values of later decisions cancel: what is left is what comes, less the value."""
        config = DecisionConfig(trace=1.0, horizon=20.0)
        value = torch.tensor([1.0, 3.0, 5.0, 7.0, 9.0])
        wanted = [1 + math.exp(-0.5) * 6, 6, 4, 8 + math.exp(-1.5) * 16, 16]
        assert (advantages(self.decisions(), value, config) + value).tolist() == pytest.approx(wanted)


class TestNetwork:
    def test_kernel_chooses_by_the_same_scores(self):
        world, act = worlds(16, "mission.duration=200")
        scores = network(seed=8).to(world.device)
        world.rule_numbers[learned.EXPLORE] = 0.0
        world.rule_numbers[learned.WEIGHTS :] = torch.tensor(scores.weights())
        features, free, chosen = split(collect(world, act, 100.0).seen)
        best = scores(features, free).topk(2).values
        clear = best[:, 0] - best[:, 1] > 1e-3
        assert clear.sum() > 100
        assert torch.equal(scores(features, free).argmax(-1)[clear], chosen[clear])


def trained(folder, seed, iterations=2):
    scenario = Scenario.load("ideal", [*SMALL, "mission.duration=150"])
    trainer = DecisionTrainer(scenario, "straight", DecisionConfig(iterations, 8, seed))
    rows = list(trainer.train(folder / f"{seed}.json", {"scenario": "ideal"}))
    return trainer, rows, json.loads((folder / f"{seed}.json").read_text())


def test_same_seed_same_weights(tmp_path):
    (tmp_path / "again").mkdir()
    one, again, other = trained(tmp_path, 1), trained(tmp_path / "again", 1), trained(tmp_path, 2)
    assert one[2] == again[2]
    assert one[2]["weights"] != other[2]["weights"]
    assert [row.iteration for row in one[1]] == [2]
    assert one[2]["evaluated"] == one[0].best
    assert parse(f"learned:{tmp_path / '1.json'}")[1][learned.WEIGHTS :] == tuple(one[2]["weights"])


def test_evaluation_is_that_of_the_rule(tmp_path):
    """What the training says of its weights is what anybody finds who uses the file."""
    trainer, _, content = trained(tmp_path, 3)
    rule = f"learned:{tmp_path / '3.json'}"
    world = World(trainer.world.scenario, EVALUATION_EPISODES, 3 + EVALUATION_SEED_OFFSET, "centroid", rule)
    assert policies.figures_of_merit(world, "straight")["delivered_mbit"] == content["evaluated"]


@pytest.mark.cpu("numbers drawn by the CPU")
def test_learns_what_pays():
    """Of six nodes with features drawn at random, one decision a world; it earns the travel time of its node."""
    trainer = DecisionTrainer(
        Scenario.load("ideal", [*SMALL]), "straight", DecisionConfig(worlds=2, learning_rate=1e-2)
    )
    generator = torch.Generator().manual_seed(2)

    def draw(count):
        table = torch.rand(count, 6, FEATURES + 1, generator=generator)
        scores = trainer.scores(table[..., :FEATURES], table[..., FEATURES] > 0)
        chosen = torch.multinomial(scores.softmax(-1), 1, generator=generator)
        seen = torch.cat([torch.ones(count, 1), chosen, table.reshape(count, -1)], 1)
        travel = table[..., Feature.travel]
        earned = travel.gather(1, chosen)[:, 0]
        return Decisions(seen.detach(), torch.arange(count), torch.zeros(count), earned, earned), travel

    def share():
        decisions, travel = draw(4000)
        return ((decisions.earned - travel.mean(1)) / (travel.max(1).values - travel.mean(1))).mean().item()

    assert abs(share()) < 0.1
    for _ in range(20):
        trainer.learn(draw(4000)[0], entropy=0.0)
    assert share() > 0.8


class TestCommand:
    CHANGES = (*SMALL, "mission.duration=5")  # what the tests above have compiled
    SHORT = (
        "ideal",
        "--iterations",
        "1",
        "--worlds",
        "2",
        *(word for change in CHANGES for word in ("--set", change)),
        "--policy",
        "straight",
    )

    @pytest.mark.slow
    def test_writes_a_rule(self, run_usvauv, tmp_path):
        code, stdout, stderr = run_usvauv("train-targets", *self.SHORT, "--out", "rule.json")
        assert (code, stderr) == (0, "")
        others = r"tour [\d.]+, rollout:40 [\d.]+, rollout:90 [\d.]+"
        assert re.match(
            rf"in evaluation, Mbit: {others}\niteration 1 of 1: [\d.]+ Mbit while exploring, [\d.]+ in evaluation,",
            stdout,
        )
        content = json.loads((tmp_path / "rule.json").read_text())
        assert content["scenario"] == "ideal"
        assert content["settings"]["worlds"] == 2
        assert np.isfinite(content["weights"]).all()
        assert (
            run_usvauv(
                "eval",
                "ideal",
                "--targets",
                "learned:rule.json",
                "--episodes",
                1,
                "--policy",
                "straight",
                "--set",
                "mission.duration=5",
                "--out",
                "eval.csv",
            )[0]
            == 0
        )

    @pytest.mark.parametrize(
        ("arguments", "parts"),
        [
            (["--iterations", "0"], ["--iterations 0", "at least 1"]),
            (["--policy", "nobody"], ["nobody"]),
            (["station-keeping"], ["no target rule"]),
        ],
    )
    def test_bad_input(self, run_usvauv, tmp_path, arguments, parts):
        code, _, stderr = run_usvauv("train-targets", *arguments)
        assert code == 2
        assert len(stderr.strip().splitlines()) == 1
        assert all(part in stderr for part in parts)
        assert not list(tmp_path.iterdir())

    def test_ctrl_c_keeps_the_run_and_it_goes_on_to_the_same_result(self, run_usvauv, tmp_path, monkeypatch):
        command = ("train-targets", *self.SHORT, "--iterations", "3", "--out")
        monkeypatch.setattr(DecisionTrainer, "evaluate_other", lambda trainer, name: 0.0)  # takes most of the time
        assert run_usvauv(*command, "whole.json")[0] == 0
        iterate = DecisionTrainer.iterate

        def iterate_and_stop(trainer):
            signal.raise_signal(signal.SIGINT)
            return iterate(trainer)

        monkeypatch.setattr(DecisionTrainer, "iterate", iterate_and_stop)
        code, stdout, stderr = run_usvauv(*command, "rule.json")
        assert (code, stderr) == (130, "stopped\n")
        assert "stopped after 1 of 3 iterations; the same command with --resume goes on\n" in stdout
        monkeypatch.setattr(DecisionTrainer, "iterate", iterate)
        for arguments, said in (
            (["rule.json"], "rule.json.partial: is of an earlier run; --resume goes on with it, --force begins anew"),
            (
                ["rule.json", "--resume", "--seed", "1"],
                "rule.json.partial: is of another command: seed = 0, here 1; --force without --resume begins anew",
            ),
            (["none.json", "--resume"], "none.json.partial: is not there; without it there is nothing to resume"),
        ):
            assert run_usvauv(*command, *arguments)[::2] == (2, f"error: {said}\n")
        assert run_usvauv(*command, "rule.json", "--resume")[0] == 0
        assert sorted(path.name for path in tmp_path.iterdir()) == ["rule.json", "whole.json"]
        whole, parts = (json.loads((tmp_path / name).read_text()) for name in ("whole.json", "rule.json"))
        assert parts["resumed"][0]["steps"] == 1
        assert parts["weights"] == whole["weights"]
        assert parts["evaluated"] == whole["evaluated"]
