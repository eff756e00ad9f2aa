"""Training of the learned boat: what its decisions earn, its network, and the command."""

import json
import math
import re

import numpy as np
import pytest
import torch

from usvauv import policies
from usvauv.env import Scenario, World
from usvauv.kernels.mission import learned_visits
from usvauv.kernels.mission.columns import AuvColumn
from usvauv.kernels.mission.learned_visits import FEATURES
from usvauv.kernels.positioning import tracker
from usvauv.policies.decisions import VISITS
from usvauv.policies.decisions.network import Scores, split
from usvauv.policies.decisions.visits import earned_until_next

FOUR = ["auv.count=4", "nodes.count=12"]


def flown(*changes, weights=None):
    world = World(Scenario.load("wide", [*FOUR, *changes]), 8, 3, "learned:untrained")
    world.strategy_arguments[learned_visits.EXPLORE] = float(weights is None)
    if weights is not None:
        world.strategy_arguments[learned_visits.WEIGHTS :] = torch.tensor(weights)
    return world, policies.acting("pace", world)


class TestEarned:
    def test_closed_form(self):
        """Two worlds of four steps; what comes a step later counts half."""
        rewards = torch.tensor([[1.0, 2.0], [3.0, 5.0], [7.0, 11.0], [13.0, 17.0]])
        worlds, steps = torch.tensor([0, 0, 1, 1, 1]), torch.tensor([0, 2, 0, 1, 3])
        wanted = [1 + 3 / 2, 7 + 13 / 2, 2, 5 + 11 / 2, 17]
        assert earned_until_next(rewards, worlds, steps, 0.5).tolist() == pytest.approx(wanted)

    def test_all_data_are_earned(self):
        """With no discount all decisions earn what is delivered; each world by how surely its AUVs find their nodes."""
        world, act = flown("mission.duration=400")
        data, finds, steps = torch.zeros(8), torch.zeros(8), []

        def count():
            variance = world.own[..., [tracker.XX, tracker.YY]].mean(-1)
            finds.add_((1 - torch.exp(-0.5 * 25**2 / variance)).sum(-1))
            data.add_(world.auv[..., AuvColumn.delivered].sum(-1))

        def counted(observation):
            steps.append(len(steps))
            if steps[1:]:  # before the first step nothing has been delivered
                count()
            return act(observation)

        decisions = VISITS.collect(world, counted, 1e12)
        count()
        earned = torch.zeros(8).index_add(0, decisions.world, decisions.earned)
        assert decisions.total.tolist() == pytest.approx(data.tolist(), rel=1e-4)
        assert earned.tolist() == pytest.approx((data.sum() * finds / finds.sum()).tolist(), rel=1e-3)
        assert (finds / 1600).std() > 0.01
        assert all((decisions.time[decisions.world == w].diff() >= learned_visits.INTERVAL).all() for w in range(8))


@pytest.mark.slow
def test_each_of_several_boats_decides_about_its_own():
    """At the start each AUV is a candidate of one boat, and only candidates are ever chosen."""
    world, act = flown("mission.duration=200", "boat.count=2")
    decisions = VISITS.collect(world, act, 300.0)
    features, free, chosen = split(decisions.seen, FEATURES)
    assert free.gather(1, chosen[:, None]).all()
    assert (features[~free] == 0).all()
    first = free[decisions.time == 0].view(8, 2, 5)
    assert (first[..., :4].sum(1) == 1).all()
    assert first[..., 4].all()
    assert sorted(decisions.world.unique().tolist()) == list(range(16))
    assert decisions.earned.isfinite().all()


def test_kernel_chooses_by_the_same_scores():
    scores = Scores(learned_visits.NETWORK)
    generator = torch.Generator().manual_seed(8)
    scores.load((0.3 * torch.randn(learned_visits.NETWORK.weights, generator=generator)).tolist())
    world, act = flown("mission.duration=300", weights=scores.weights())
    features, free, chosen = split(VISITS.collect(world, act, 300.0).seen, FEATURES)
    best = scores(features, free).topk(2).values
    clear = best[:, 0] - best[:, 1] > 1e-3
    assert clear.sum() > 80
    assert len(chosen[clear].unique()) > 2
    assert torch.equal(scores(features, free).argmax(-1)[clear], chosen[clear])


class TestCommand:
    SHORT = ("wide", *(part for change in FOUR for part in ("--set", change)), "--set", "mission.duration=20",
             "--policy", "pace")  # fmt: skip

    def test_writes_a_boat(self, run_usvauv, tmp_path):
        train = ("train-boat", *self.SHORT, "--iterations", 1, "--worlds", 2, "--out", "boat.json")
        code, stdout, stderr = run_usvauv(*train)
        assert (code, stderr) == (0, "")
        others = r"visit [\d.]+, belief [\d.]+"
        assert re.match(rf"evaluation, Mbit: {others}\niteration 1 of 1: [\d.]+ Mbit drawn, evaluation [\d.]+,", stdout)
        content = json.loads((tmp_path / "boat.json").read_text())
        assert (content["scenario"], content["targets"], content["settings"]["worlds"]) == ("wide", "tour", 2)
        assert len(content["weights"]) == learned_visits.NETWORK.weights
        assert np.isfinite(content["weights"]).all()
        assert math.isclose(content["evaluated"], float(re.findall(r"best ([\d.]+) Mbit", stdout)[-1]), abs_tol=0.06)
        evaluate = ("eval", *self.SHORT, "--usv", "learned:boat.json", "--episodes", 1, "--out", "eval.csv")
        assert run_usvauv(*evaluate)[0] == 0
        assert "learned:boat.json" in (tmp_path / "eval.csv").read_text()

    @pytest.mark.parametrize(
        ("arguments", "parts"),
        [
            (["train-boat", "wide", "--iterations", "0"], ["--iterations 0", "at least 1"]),
            (["train-boat", "wide", "--out", "missing/boat.json"], ["missing", "does not exist"]),
            (["train-boat", "wide", "--targets", "nobody"], ["nobody"]),
            (["train-boat", "station-keeping"], ["station-keeping", "no data to learn from"]),
            (["train-boat", "ideal", "--set", "navigation.sensor=none"], ["needs navigation.sensor"]),
            (["eval", "wide", "--usv", "learned:boat.json"], ["learned:boat.json", "usvauv train-boat"]),
        ],
    )
    def test_bad_input(self, run_usvauv, tmp_path, arguments, parts):
        code, _, stderr = run_usvauv(*arguments)
        assert code == 2
        assert len(stderr.strip().splitlines()) == 1
        assert all(part in stderr for part in parts)
        assert not list(tmp_path.iterdir())
