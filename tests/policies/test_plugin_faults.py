"""What a plugin raises or returns wrongly: one line that names the part and its file."""

import dataclasses
import math

import numpy as np
import pytest
import taichi as ti
import torch

from tests.policies.toy import LEARNING, ToyWorld, scenario
from usvauv import policies
from usvauv.env import Scenario, World
from usvauv.env.record.metrics import Metric, episode_metrics, task_metrics
from usvauv.env.record.recorder import record
from usvauv.env.world.boat_strategies import BoatStrategy, boat_strategies
from usvauv.env.world.observation import ObservationTerm, observation_terms
from usvauv.kernels.errors import UserError
from usvauv.kernels.mission.target_rules import TargetRule, target_rules
from usvauv.kernels.mission.worlds import Strategy
from usvauv.kernels.positioning.ambient_noise import ambient_noise_laws
from usvauv.kernels.types import vec2
from usvauv.policies import PolicyError, Trainer
from usvauv.policies.algorithms import ALGORITHMS
from usvauv.policies.algorithms.ddpg import DDPG
from usvauv.policies.heuristics import HEURISTICS, Heuristic

pytestmark = pytest.mark.usefixtures("own_registries")


def fails():
    return {}["no\nsuch"]


@pytest.mark.parametrize(
    ("answer", "match"),
    [
        (lambda o: torch.full((16, 2, 2), math.nan), "returned nan: must be numbers in"),
        (lambda o: torch.zeros(3), r"float32 of shape \(3,\) on cpu.*real numbers of shape \(16, 2, 2\)"),
        (lambda o: torch.zeros(16, 2, 2, dtype=torch.int64), "int64 of shape .*real numbers"),
        (lambda o: np.zeros((16, 2, 2)), "returned array.*must be a tensor"),
        (lambda o: None, "returned None"),
        (lambda o: fails(), "raised KeyError"),
        (lambda o: exit(0), "raised SystemExit"),
    ],
)
def test_a_policy(answer, match):
    class Wrong(Heuristic):
        def act(self, observation):
            return answer(observation)

    HEURISTICS.register("wrong", Wrong)
    world = ToyWorld(scenario(), 16, seed=2)
    act = policies.acting("wrong", world)
    with pytest.raises(PolicyError, match=rf"^policy 'wrong' of .*test_plugin_faults\.py: .*{match}") as caught:
        act(world.reset())
    assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    ("registry", "item"), [(HEURISTICS, 5), (HEURISTICS, dict), (boat_strategies, None), (observation_terms, "x")]
)
def test_an_item_of_another_form_is_refused_at_once(registry, item):
    with pytest.raises(UserError, match=r"'wrong': is .*: must be a "):
        registry.register("wrong", item)


@pytest.mark.parametrize(
    ("law", "match"),
    [
        (lambda f, s, w: math.nan, "returned nan: must be a level"),
        (lambda f, s, w: "x", "returned 'x'"),
        (lambda f, s, w: fails(), "raised KeyError"),
        (lambda f: 0.0, "raised TypeError"),
    ],
)
def test_a_noise_law(law, match):
    ambient_noise_laws.register("wrong", law)
    with pytest.raises(UserError, match=f"^ambient noise law 'wrong' of .*: {match}"):
        World(Scenario.load("ideal", ["acoustics.ambient_noise=wrong"]), 1)


@ti.func
def node_far_beyond(worlds: ti.template(), w, k):
    return 100000000


@ti.func
def no_place(worlds: ti.template(), w, b):
    return vec2(ti.math.nan, 0.0)


@ti.func
def no_vector(worlds: ti.template(), w, b):
    return 3.0


@pytest.mark.parametrize(
    ("goal", "usv", "match"),
    [
        (
            no_place,
            "hold:0,0",
            "^world 0 at 0 s: target of AUV 0 is 1e.08: must be .* from 0 to 29 .*'far' of .*faults",
        ),
        (no_place, "wrong", r"^world 0 at 0 s: goal_x of boat 0 is nan.*\(uses usv 'wrong' of .*faults"),
        (no_vector, "wrong", "^usv 'wrong' of .*faults.py: TaichiSyntaxError: .*boat.py.*expected to be a Matrix"),
    ],
)
def test_what_runs_in_the_kernel(goal, usv, match):
    target_rules.register("far", TargetRule(node_far_beyond))
    boat_strategies.register("wrong", BoatStrategy(Strategy(start=goal, goal=goal)))
    rule = "nodes.target_rule=far" if usv != "wrong" else "nodes.target_rule=greedy"
    with pytest.raises(UserError, match=match) as caught:
        World(Scenario.load("ideal", [rule]), 1, usv=usv).reset()
    assert str(caught.value).isprintable()


def test_an_observation_term_without_numbers():
    observation_terms.register("wrong", ObservationTerm(no_place, lambda num_auvs: 5, "1", 0.0, 1.0))
    with pytest.raises(UserError, match=r"^observation term 'wrong' of .*: raised TypeError"):
        World(Scenario.load("ideal", ['observation.extra=["wrong"]']), 1)


def test_a_metric_of_another_shape():
    task_metrics.register("wrong", Metric("data-collection", lambda trace: np.zeros(7)))
    world = World(Scenario.load("ideal", ["mission.duration=2"]), 1)
    trace = record(world, policies.load("straight", world).act, "straight")
    with pytest.raises(UserError, match=r"^metric 'wrong' of .*: must be an array of 1 numbers"):
        episode_metrics(trace)


@pytest.mark.parametrize(
    ("method", "answer", "match"),
    [
        ("update", lambda self, batch: fails(), "raised KeyError"),
        ("update", lambda self, batch: {"loss": 0.0}, "returned .*one number for each name"),
        ("explore", lambda self, observation, noise: noise[..., :1], "returned .*must be of"),
    ],
)
def test_an_algorithm(method, answer, match):
    ALGORITHMS.register("wrong", type("Wrong", (DDPG,), {method: answer}))
    config = dataclasses.replace(LEARNING, algorithm="wrong", warmup=320)
    with pytest.raises(PolicyError, match=f"^algorithm 'wrong' of .*faults.py: {match}"):
        Trainer(ToyWorld(scenario(), 32, seed=1), config).train(32 * 20)
