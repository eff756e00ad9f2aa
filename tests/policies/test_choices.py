"""Actors that choose among rudders by what they see of any number of targets."""

import math

import pytest
import torch

from usvauv import policies
from usvauv.env import Scenario, World
from usvauv.kernels.mission.tasks.tracking_plain import HelmColumn
from usvauv.policies import Trainer, TrainingConfig, TrainingRun
from usvauv.policies.frames import RudderFrame
from usvauv.policies.names import PolicyError
from usvauv.policies.networks import AttentiveMLP, ChoiceActor, Sizes

SIZES = Sizes(stack=2, observation=0, action=1, choices=3, own=4, each=5)
NOTHING = {"arps": 1.0, "margin": 0.0}


def seeded(seed=1):
    return torch.Generator().manual_seed(seed)


def seen(things, count=6):
    """Own numbers and those of some things, for two networks."""
    return torch.randn(2, count, SIZES.own + things * SIZES.each, generator=seeded(3))


class TestNetwork:
    def test_it_is_what_its_equation_says(self):
        network, x = AttentiveMLP(SIZES, (8, 6), 2, seeded()).double(), seen(3).double()
        for s in range(2):

            def layer(of, number, given, s=s):
                return given @ of.weights[number][s] + of.biases[number][s, 0]

            for row, found in zip(x[s], network(x)[s], strict=True):
                own, things = row[:4], row[4:].view(3, 5)
                codes = [layer(network.encoder, 1, layer(network.encoder, 0, e).relu()).relu() for e in things]
                query = layer(network.query, 0, own)
                score = torch.stack([query @ layer(network.key, 0, code) / math.sqrt(6) for code in codes])
                weight = score.exp() / score.exp().sum()
                pooled = sum(w * code for w, code in zip(weight, codes, strict=True))
                hidden = torch.cat((own, pooled, sum(codes) / 3))
                hidden = layer(network, 1, layer(network, 0, hidden).relu()).relu()
                torch.testing.assert_close(found, layer(network, 2, hidden))

    def test_the_order_of_things_makes_no_difference(self):
        network, x = AttentiveMLP(SIZES, (8,), 2, seeded()), seen(4)
        other = torch.cat((x[..., :4], x[..., 4:].unflatten(-1, (4, 5))[..., [2, 0, 3, 1], :].flatten(-2)), -1)
        torch.testing.assert_close(network(other), network(x))

    def test_gradients_are_those_of_differences(self):
        network, x = AttentiveMLP(SIZES, (4,), 1, seeded()).double(), seen(2, count=2).double().requires_grad_()
        assert torch.autograd.gradcheck(network, x)


class TestActor:
    def test_choices_come_as_often_as_is_said(self):
        actor, x = ChoiceActor(SIZES, (8,), 3, seeded()), seen(2, count=1).expand(-1, 20_000, -1)
        drawn = actor.draw(x, torch.randn(2, 20_000, 1, generator=seeded(4)))
        densities = torch.stack([actor.log_density(x, torch.full_like(drawn, c)) for c in range(3)], -1).exp()
        torch.testing.assert_close(densities.sum(-1), torch.ones(2, 20_000))
        for c in range(3):
            torch.testing.assert_close((drawn == c).float().mean((1, 2)), densities[:, 0, c], atol=0.015, rtol=0)
        assert torch.equal(actor(x)[:, :1, 0].long(), densities[:, :1].argmax(-1))


@pytest.fixture(scope="module")
def world():
    made = World(Scenario.load("tracking-plain", ["usbl.carriers=[18000]"]), 32, seed=3)
    observation, rule = made.reset(), policies.load("tree", made)
    for _ in range(20):
        observation = made.step(rule.act(observation)).observation
    return made


def test_a_choice_is_the_last_rudder_or_a_neighbour(world):
    frame, observation = RudderFrame(world.scenario), world.observation.clone()
    last = world.task_auv[..., HelmColumn.rudder].clone()
    choice = torch.randint(0, 3, (32, 3, 1), generator=seeded()).float()
    command = frame.decode(observation, choice)
    world.step(command)
    step = torch.tensor([0.0, -1.0, 1.0])[choice[..., 0].long()]  # the same, next to the left, to the right
    assert torch.equal(world.task_auv[..., HelmColumn.rudder], (last + step).clamp(-2, 2))
    free = (last + step).abs() <= 2
    assert torch.equal(frame.choice(observation, command)[free], choice[free])


def test_it_learns_what_its_teacher_does_and_serves_other_teams(tmp_path, world):
    """From 6 rollouts; most of what it does is easily told."""
    scenario = Scenario.load("tracking-plain", ["usbl.carriers=[18000]"])
    settings = {"num_worlds": 32, "seed": 5, "imitation": 6, "rollout": 16, "batch": 256}
    config = TrainingConfig.of(scenario, **settings)
    assert (config.frame, config.algorithm) == ("rudder", "ppo")
    run = TrainingRun(World(scenario, 32, 5), config, tmp_path / "run", lambda policy: NOTHING)
    Trainer(run, evaluations=1).train(32 * 16 * 7)
    observation, tree = world.observation, policies.load("tree", world)
    frame, learned = RudderFrame(scenario), policies.load(str(tmp_path / "run" / "last"), world)
    by = [frame.choice(observation, rule.act(observation)) for rule in (tree, learned)]
    assert (by[0] == by[1]).float().mean() > 0.6
    other = World(Scenario.load("tracking-plain", ["usbl.carriers=[18000]", "auv.count=2", "nodes.count=4"]), 4, seed=1)
    action = policies.load(str(tmp_path / "run" / "last"), other).act(other.reset())
    torch.testing.assert_close(action.norm(dim=-1), torch.ones(4, 2))


def test_only_who_can_learn_choices_gets_them():
    scenario = Scenario.load("tracking-plain")
    assert TrainingConfig.of(scenario, algorithm="sac").frame == "circling"
    config = TrainingConfig.of(scenario, num_worlds=4, algorithm="sac", frame="rudder")
    with pytest.raises(PolicyError, match="algorithm = 'sac': cannot learn choices"):
        TrainingRun(World(scenario, 4, 1), config)
