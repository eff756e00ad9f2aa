"""The learned boat: what it sees, against NumPy; when and how it chooses; the file of its weights."""

import json
import math

import numpy as np
import pytest
import torch

from usvauv import policies
from usvauv.env import Scenario, ScenarioError, World
from usvauv.kernels.mission import learned_visits
from usvauv.kernels.mission.candidate_scores import HEAD, Decision
from usvauv.kernels.mission.columns import BoatColumn, ExchangeColumn, ForesightColumn
from usvauv.kernels.mission.learned_visits import FEATURES, Feature
from usvauv.kernels.positioning import tracker
from usvauv.policies.decisions.network import Scores, split

FOUR = ["auv.count=4", "nodes.count=12"]
WORKS, SPEED, STEP = 25.0, 2.0, 1.0  # homing range, m; the boat's top speed, m/s; mission step, s


def fly(world, steps):
    """The world after each step, with the boat's row before it, and which worlds have decided in it."""
    act = policies.load("pace", world).act
    observation = world.reset()
    for _ in range(steps):
        before = world.boat[:, 0].clone()
        world.boat_workspace[:, Decision.made] = 0
        observation, *_ = world.step(act(observation))
        yield before, world.boat_workspace[:, Decision.made] > 0


def table(world):
    """Features of the last decision of each world, (W, K + 1, F)."""
    return world.boat_workspace[:, HEAD:].view(world.num_worlds, -1, FEATURES + 1)[..., :FEATURES]


def own_variance(world, later=0.0):
    """a and c of all AUVs' own filters, each (W, K), some time from now (s) if they are not heard; double precision."""
    track = world.track.double().numpy()
    time = world.exchange[..., ExchangeColumn.elapsed].double().numpy() + later
    scenario = world.scenario.navigation
    variance, tau = scenario.velocity_bias**2, scenario.bias_correlation_time
    f = -np.expm1(-time / tau)
    spread = 2 * time / tau - 3 + 4 * np.exp(-time / tau) - np.exp(-2 * time / tau)
    a, b, c = (
        (track[..., one] + track[..., two]) / 2
        for one, two in ((tracker.XX, tracker.YY), (tracker.XU, tracker.YV), (tracker.UU, tracker.VV))
    )
    white = world.scenario.navigation.velocity_noise**2 * time
    position = a + 2 * tau * f * b + (tau * f) ** 2 * c + variance * tau**2 * spread + white
    return position, (1 - f) ** 2 * c + variance * f * (2 - f)


class TestSees:
    def test_features(self):
        """All but those of imagined ways; what is known of an AUV until it is heard, which comes after a decision."""
        world = World(Scenario.load("wide", FOUR), 12, 3, "learned:untrained")
        checked = alone = 0
        before_it = torch.zeros(12, 4)
        for step, (before, decided) in enumerate(fly(world, 400), start=1):
            seen = table(world).double().numpy()
            place = world.foresight[..., :2].double().numpy()
            elapsed = world.exchange[..., ExchangeColumn.elapsed].numpy().copy()
            a, c = own_variance(world)
            after = own_variance(world, 100.0)[0]
            own = np.sqrt(a) / WORKS
            before = before.double().numpy()
            here, goal = before[:, [BoatColumn.x, BoatColumn.y]], before[:, [BoatColumn.goal_x, BoatColumn.goal_y]]
            for w in np.flatnonzero(decided.numpy()) if step > 100 else ():
                visited = int(before[w, BoatColumn.visits])
                of_auvs = {
                    "own": own[w],
                    "growth": np.sqrt(c[w]) * 100 / WORKS,
                    "lost": np.exp(-0.5 / own[w] ** 2),
                    "later": np.exp(-0.5 / (after[w] / WORKS**2)),
                    "silent": np.minimum(elapsed[w] / 300, 1),
                    "hovers": world.foresight[w, :, ForesightColumn.hovers].numpy() > 0,
                    "kept": (np.arange(4) == visited) & (before_it[w].numpy() >= 1),
                }
                ways = np.concatenate([place[w], place[w].mean(0, keepdims=True)]) - here[w]
                last = goal[w] - here[w]
                length, lengths = np.linalg.norm(last), np.linalg.norm(ways, axis=1)
                turn = ways @ last / np.maximum(lengths * length, 1e-9)
                of_all = {
                    "turn": np.where((lengths > 1) & (length > 1), turn, 0),
                    "mean": np.arange(5) == 4,
                    "left": 1 - step / 1000,
                    "end": math.exp((step - 1000) / 100),
                }
                silent = elapsed[w] > 1.5
                for name, wanted in of_auvs.items():
                    feature = seen[w, :, getattr(Feature, name)]
                    assert feature[:4][silent] == pytest.approx(wanted[silent].astype(float), abs=5e-3), name
                    assert feature[4] == 0, name
                if silent.all():
                    of_all |= {
                        "all_own": own[w].mean(),
                        "most_own": own[w].max(),
                        "all_lost": np.exp(-0.5 / own[w] ** 2).mean(),
                    }
                    alone += 1
                for name, wanted in of_all.items():
                    assert seen[w, :, getattr(Feature, name)] == pytest.approx(wanted + np.zeros(5), abs=5e-3), name
                checked += 1
            before_it = torch.from_numpy(elapsed)
        assert checked > 60
        assert alone > 1

    def test_imagined_ways(self):
        """What is heard from here is served by every way; who is far off takes the time to come within hearing."""
        world = World(Scenario.load("wide", FOUR), 12, 3, "learned:untrained")
        near = far = 0
        for before, decided in fly(world, 300):
            seen = table(world)[decided].double().numpy()
            place = world.foresight[decided][..., :2].double().numpy()
            here = before[decided][:, [BoatColumn.x, BoatColumn.y]].double().numpy()
            away = np.linalg.norm(place - here[:, None], axis=-1)
            for mine, distance in zip(seen, away, strict=True):
                worth = mine[:4, Feature.later]
                heard = mine[:4, Feature.here]
                assert (heard[distance < 80] > 0.9).all()
                assert (heard[distance > 280] < 0.2).all()
                for i in range(5):
                    others = np.arange(4) != i
                    assert mine[i, Feature.served] >= (heard * worth)[others].sum() - 1e-4
                    assert mine[i, Feature.served] <= worth[others].sum() + 1e-4
                    assert mine[i, Feature.served_lost] <= mine[:4, Feature.lost][others].sum() + 1e-4
                trip = mine[:4, Feature.trip] * 100
                assert (trip[heard > 0.99] < 0.02 * (distance[heard > 0.99] / SPEED + 10)).all()
                assert (mine[:4, Feature.arrival] >= mine[:4, Feature.own] - 1e-4).all()
                assert (trip[distance > 280] > 5).all()
                assert (trip[distance > 280] < np.minimum(distance[distance > 280] / SPEED, 300)).all()
                near, far = near + (heard > 0.99).sum(), far + (distance > 280).sum()
        assert min(near, far) > 50


class TestChooses:
    def test_untrained_is_belief(self):
        """In the first step `belief` has the same candidates."""
        worlds = [World(Scenario.load("wide", FOUR), 64, 5, name) for name in ("learned:untrained", "belief")]
        for world in worlds:
            for _ in fly(world, 1):
                pass
        visits, others = (world.boat[:, 0, BoatColumn.visits] for world in worlds)
        assert (visits == others).sum() > 60  # but for rounding
        assert len(visits.unique()) > 2

    def test_by_own_uncertainty_alone_it_is_visit(self):
        """Weights that like uncertainty alone choose, at their times, whom `visit` goes to."""
        world = World(Scenario.load("wide", FOUR), 8, 5, "learned:untrained")
        world.strategy_arguments[learned_visits.WEIGHTS] = 0.0
        rows = world.strategy_arguments[learned_visits.WEIGHTS + 1 :].view(-1, FEATURES + 2)
        rows[0, Feature.own] = rows[0, FEATURES + 1] = 1.0
        count = 0
        for _, decided in fly(world, 200):
            own = table(world)[decided][:, :4, Feature.own]
            chosen = world.boat_workspace[decided, Decision.chosen].long()
            assert torch.equal(own.argmax(-1), chosen)
            assert torch.equal(world.boat[decided, 0, BoatColumn.visits].long(), chosen)
            goal = world.boat[decided][:, 0, [BoatColumn.goal_x, BoatColumn.goal_y]]
            assert torch.allclose(goal, world.foresight[decided, chosen, :2].clamp(0, 600))
            count += len(chosen)
        assert count > 8 * 200 / learned_visits.PATIENCE

    def test_when_it_decides(self):
        """First at once; then when it has heard whom it went to, has arrived, or its patience is over."""
        world = World(Scenario.load("wide", FOUR), 8, 5, "learned:untrained")
        since = torch.zeros(8)
        reasons = {"heard": 0, "arrived": 0, "patience": 0}
        elapsed = torch.zeros(8, 4)
        for step, (before, decided) in enumerate(fly(world, 300), start=1):
            visited = before[:, BoatColumn.visits].long()
            auv = visited >= 0
            heard = auv & (elapsed.gather(1, visited.clamp(min=0)[:, None])[:, 0] < 1.0)
            place = before[:, [BoatColumn.goal_x, BoatColumn.goal_y]]
            place[auv] = world.foresight[auv, visited[auv], :2]
            arrived = (place - before[:, [BoatColumn.x, BoatColumn.y]]).norm(dim=-1) < SPEED * learned_visits.INTERVAL
            over = step - since
            wanted = (heard | arrived | (over >= learned_visits.PATIENCE)) & (over >= learned_visits.INTERVAL)
            assert torch.equal(decided, wanted | (step == 1))
            reasons["heard"] += int((wanted & heard).sum())
            reasons["arrived"] += int((wanted & arrived).sum())
            reasons["patience"] += int((wanted & ~heard & ~arrived).sum())
            since[decided] = step
            elapsed = world.exchange[..., ExchangeColumn.elapsed].clone()
        assert reasons["heard"] > 20
        assert reasons["patience"] > 10

    def test_draws_follow_the_scores(self):
        """How often the first goal is the best candidate, and the mean, beside the probabilities of the network."""
        scores = Scores(learned_visits.NETWORK)
        generator = torch.Generator().manual_seed(4)
        scores.load((0.3 * torch.randn(learned_visits.NETWORK.weights, generator=generator)).tolist())
        world = World(Scenario.load("wide", FOUR), 2000, 4, "learned:untrained")
        world.strategy_arguments[:] = torch.tensor([1.0, *scores.weights()])
        for _, decided in fly(world, 1):
            assert decided.all()
        features, free, chosen = split(world.boat_workspace, FEATURES)
        assert free.all()
        probability = scores(features, free).double().softmax(-1).detach()
        for wanted in (probability.argmax(-1), torch.full_like(chosen, 4)):
            p = probability.gather(1, wanted[:, None])[:, 0]
            deviation = (p * (1 - p)).sum().sqrt()
            assert abs((chosen == wanted).sum() - p.sum()) < 4 * deviation
            assert deviation > 5

    def test_the_mean_is_no_auv(self):
        """Weights that like the mean alone bring the boat to the mean of where AUVs are foreseen."""
        world = World(Scenario.load("wide", FOUR), 4, 4, "learned:untrained")
        rows = world.strategy_arguments[learned_visits.WEIGHTS + 1 :].view(-1, FEATURES + 2)
        rows[0, Feature.mean] = rows[0, FEATURES + 1] = 100.0
        for _, decided in fly(world, 100):
            assert (world.boat[:, 0, BoatColumn.visits] == -1).all()
            goal = world.boat[decided][:, 0, [BoatColumn.goal_x, BoatColumn.goal_y]]
            assert torch.allclose(goal, world.foresight[decided][..., :2].mean(1), atol=1e-3)


class TestFile:
    @pytest.mark.parametrize(
        "content", ["", "{}", json.dumps({"weights": [0.0] * 513}), json.dumps({"weights": [1e9]})]
    )
    def test_wrong_files_are_refused(self, tmp_path, content):
        path = tmp_path / "boat.json"
        path.write_text(content)
        with pytest.raises(ScenarioError, match=r"usv: learned:.*no weights of a learned boat; .*`usvauv train-boat`"):
            World(Scenario.load("extreme"), usv=f"learned:{path}")

    @pytest.mark.parametrize("text", ["learned", "learned:", "learned:/dev/zero", "learned:no-such-file"])
    def test_wrong_names_are_refused(self, text):
        with pytest.raises(ScenarioError, match=r"usv: learned:.*no weights of a learned boat"):
            World(Scenario.load("extreme"), usv=text)

    def test_auvs_that_do_not_reckon_are_not_foreseen(self):
        with pytest.raises(ScenarioError, match=r"'learned:untrained' foresees AUVs .* needs navigation\.sensor"):
            World(Scenario.load("extreme", ["navigation.sensor=none"]), 1, usv="learned:untrained")
