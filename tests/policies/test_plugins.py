"""What comes from outside the package, plugins and MODULE:CLASS, and one line for what either does wrongly."""

import dataclasses
import math
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import taichi as ti
import torch

from tests.links import EVERY_STEP
from tests.policies.toy import LEARNING, ToyWorld, scenario
from usvauv import policies
from usvauv.env import Scenario, World, plugins
from usvauv.env.record.metrics import Metric, episode_metrics, task_metrics
from usvauv.env.record.recorder import record
from usvauv.kernels.errors import UserError
from usvauv.kernels.mission.boats.boat_strategies import BoatStrategy, Strategy, boat_strategies
from usvauv.kernels.mission.observation import ObservationTerm, observation_terms
from usvauv.kernels.mission.target_rules import TargetRule, target_rules
from usvauv.kernels.mission.tasks.task import RewardTerm, tasks
from usvauv.kernels.positioning.laws import ambient_noise_laws
from usvauv.kernels.types import vec2
from usvauv.kernels.vehicles.definition import vehicles
from usvauv.policies import PolicyError, Trainer, TrainingRun
from usvauv.policies.algorithms import algorithms
from usvauv.policies.algorithms.deterministic import DDPG
from usvauv.policies.frames import WorldFrame, frames
from usvauv.policies.heuristics import heuristics
from usvauv.policies.policy import Heuristic

pytestmark = pytest.mark.usefixtures("own_registries")
EXAMPLES = Path(__file__).parents[2] / "examples" / "plugins"
SEE = r"\(set USVAUV_TRACEBACK=1 to see where it comes from\)"


def load_example(name: str, folder: Path) -> None:
    plugins.load(shutil.copy(EXAMPLES / name, folder / f"my_{name}"))


def test_a_policy_leads_its_target_by_the_drift(tmp_path):
    world = ToyWorld(scenario(), 16, seed=2)
    observation = world.reset()
    with pytest.raises(PolicyError, match="allowed are ppo-wide-torpedo, sac-extreme"):
        policies.load("lead:20", world)
    load_example("policy.py", tmp_path)
    assert policies.available()[-1] == "lead"
    straight = policies.load("straight", world).act(observation)
    torch.testing.assert_close(policies.load("lead:0", world).act(observation), straight)
    world.target -= 20.0 * world.drift
    upstream = policies.load("straight", world).act(world._observe())
    torch.testing.assert_close(policies.load("lead:20", world).act(observation), upstream)
    with pytest.raises(PolicyError, match=r"^policy lead:soon: could not convert string to float: 'soon'$"):
        policies.check("lead:soon", scenario())


def test_an_algorithm_trains_and_its_policy_is_kept(tmp_path):
    with pytest.raises(PolicyError, match=r"algorithm = 'ensemble': allowed are sac, td3, ddpg, ppo$"):
        dataclasses.replace(LEARNING, algorithm="ensemble")
    load_example("algorithm.py", tmp_path)
    config = dataclasses.replace(LEARNING, algorithm="ensemble", warmup=320)
    run = TrainingRun(ToyWorld(scenario(), 32, seed=1), config, tmp_path / "run")
    untrained = run.learner.actor.weights[-1].detach().clone()
    Trainer(run).train(32 * 30)
    assert run.learner.updates == 20
    assert not torch.equal(run.learner.actor.weights[-1], untrained)
    observation = run.world.reset()
    kept = policies.load(tmp_path / "run", run.world)
    assert torch.equal(kept.act(observation), run.policy().act(observation))


TEXT = """
import math
import torch

class East:
    def __init__(self, world):
        self.world = world

    def act(self, observation):
        return torch.ones(self.world.num_worlds, self.world.num_auvs, 2)

def function(world):
    return East(world).act

def array(world):
    return lambda observation: East(world).act(observation).numpy().astype(float)

class Inert:
    def __init__(self, world):
        pass

def text(world):
    return lambda observation: "north"

def failing(world):
    return lambda observation: {}["north"]

number = 5
"""


@pytest.fixture
def _modules(tmp_path, monkeypatch):
    """The text above as modules of the working directory, which is forgotten after a test."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setattr(sys, "modules", {**sys.modules})
    (tmp_path / "own_east.py").write_text(TEXT)
    (tmp_path / "straight.py").write_text(TEXT)
    (tmp_path / "own_broken.py").write_text("import nowhere")
    (tmp_path / "own_ends.py").write_text("import sys\nsys.exit(3)")


@pytest.mark.usefixtures("_modules")
@pytest.mark.parametrize("name", ["own_east:East", "own_east:function", "own_east:array"])
def test_it_acts_under_its_name(name):
    world = ToyWorld(scenario(), 3, seed=2)
    policies.check(name, scenario())
    policy = policies.load(name, world)
    assert (policy.name, policy.scenario) == (name, world.scenario)
    for act in (policy.act, policies.acting(name, world), policies.named(name)[name](world)):
        assert act(world.reset()).tolist() == torch.ones(3, 2, 2).tolist()


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("own_gone:East", f"cannot be imported: ModuleNotFoundError: No module named 'own_gone' {SEE}"),
        ("own_broken:East", rf"Error: No module named 'nowhere', in .*own_broken\.py, line 1 {SEE}"),
        ("own_ends:East", rf"cannot be imported: SystemExit: 3, in .*own_ends\.py, line 2 {SEE}"),
        ("own_east:West", "own_east.py has no class or function 'West'"),
        ("own_east:number", "own_east.py has no class or function 'number'"),
    ],
)
@pytest.mark.usefixtures("_modules")
def test_what_cannot_be_found_is_refused_without_a_world(name, problem):
    with pytest.raises(PolicyError, match=rf"^policy '{name}': .*{problem}$"):
        policies.check(name, scenario())


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("Inert", "returned <own_east.Inert object at .*>: must be an object with `act`, or a function"),
        ("text", r"returned 'north': must be a tensor of shape \(3, 2, 2\)"),
        ("failing", rf"raised KeyError: 'north', in .*own_east\.py, line 26 {SEE}$"),
    ],
)
@pytest.mark.usefixtures("_modules")
def test_what_fails_names_the_class_and_its_file(name, problem):
    world = ToyWorld(scenario(), 3, seed=2)
    with pytest.raises(PolicyError, match=rf"^policy 'own_east:{name}' of .*own_east\.py: {problem}"):
        policies.acting(f"own_east:{name}", world)(world.reset())


def fails(error=None):
    raise error or KeyError("no\nsuch")


class Odd(BaseException):
    pass


@pytest.mark.parametrize(
    ("answer", "match"),
    [
        (lambda o: torch.full((16, 2, 2), math.nan), "returned nan: must be numbers in"),
        (lambda o: torch.zeros(3), r"float32 of shape \(3,\) on cpu.*real numbers of shape \(16, 2, 2\)"),
        (lambda o: torch.zeros(16, 2, 2, dtype=torch.int64), "int64 of shape .*real numbers"),
        (lambda o: None, "returned None"),
        (lambda o: fails(), rf"raised KeyError: .*, in .*test_plugins\.py, line \d+ {SEE}$"),
        (lambda o: torch.zeros(2) @ torch.zeros(3), r"raised RuntimeError: .*, in .*test_plugins\.py, line"),
        (lambda o: (lambda f: f(f))(lambda f: f(f)), "raised RecursionError: .*, in .*plugins"),
        *(
            (lambda o, error=error: fails(error), f"raised {type(error).__name__}, in .*plugins")
            for error in (SystemExit(), GeneratorExit(), Odd(), StopIteration(), MemoryError())
        ),
    ],
)
def test_a_policy(answer, match):
    class Wrong(Heuristic):
        def act(self, observation):
            return answer(observation)

    heuristics.register("wrong", Wrong)
    world = ToyWorld(scenario(), 16, seed=2)
    act = policies.acting("wrong", world)
    with pytest.raises(PolicyError, match=rf"^policy 'wrong' of .*test_plugins\.py: .*{match}") as caught:
        act(world.reset())
    assert str(caught.value).isprintable()
    assert (caught.value.__cause__ is not None) == ("raised" in match)


def test_ctrl_c_in_a_policy_is_ctrl_c():
    class Stopped(Heuristic):
        def act(self, observation):
            raise KeyboardInterrupt

    heuristics.register("stopped", Stopped)
    world = ToyWorld(scenario(), 16, seed=2)
    with pytest.raises(KeyboardInterrupt):
        policies.acting("stopped", world)(world.reset())


def test_a_frame_and_a_target_rule_are_named_too(tmp_path):
    class Wrong(WorldFrame):
        def __init__(self, scenario):
            fails(Odd())

    frames.register("wrong", Wrong)
    with pytest.raises(PolicyError, match=r"^frame 'wrong' of .*: raised Odd, in .*plugins\.py, line"):
        TrainingRun(ToyWorld(scenario(), 32, seed=1), dataclasses.replace(LEARNING, frame="wrong"))
    target_rules.register("wide", TargetRule(node_by_number, workspace=lambda *_: fails(Odd())))
    with pytest.raises(UserError, match=r"^target rule 'wide' of .*: raised Odd, in .*plugins\.py, line"):
        World(Scenario.load("ideal", ["nodes.target_rule=wide"]), 1)


@pytest.mark.parametrize(
    ("law", "match"),
    [
        (lambda f, s, w: math.nan, "returned nan: must be a level"),
        (lambda f, s, w: fails(), "raised KeyError"),
    ],
)
def test_a_noise_law(law, match):
    ambient_noise_laws.register("wrong", law)
    with pytest.raises(UserError, match=f"^ambient noise law 'wrong' of .*: {match}"):
        World(Scenario.load("ideal", ["acoustics.ambient_noise=wrong"]), 1)


@ti.func
def node_by_number(worlds: ti.template(), w, k):
    return ti.cast(worlds.rule_numbers[0], ti.i32)


@ti.func
def half_a_node(worlds: ti.template(), w, k):
    return 0.5


@ti.func
def place_by_number(worlds: ti.template(), w, b):
    """No place with a number below zero."""
    return vec2(ti.sqrt(worlds.strategy_arguments[0]), 0.0)


@ti.func
def east_of_the_first(worlds: ti.template(), w, b):
    return vec2(worlds.estimate.x[w, 0] + 5.0, worlds.estimate.y[w, 0])


@ti.func
def east_by_whole_vectors(worlds: ti.template(), w, b):
    """What Taichi cannot compile with vectors in registers: a negative, a cast, a vector of bools."""
    east = ti.cast(ti.Vector([5, 0]), ti.f32)
    east -= ti.select((east < 0.0).any(), 1.0, 0.0) * east
    return -(-vec2(worlds.estimate.x[w, 0], worlds.estimate.y[w, 0]) - east)


@ti.func
def no_numbers(worlds: ti.template(), w, k, first):
    """Writes nothing."""


@ti.func
def no_vector(worlds: ti.template(), w, b):
    return 3.0, 4.0


@ti.func
def text(worlds: ti.template(), w, b):
    return "a" + 3


def reset_twice(usv, rule):
    """On a graphics card what the first one wrote is looked at in the second."""
    world = World(Scenario.load("ideal", EVERY_STEP), 1, usv=usv, targets=rule)
    world.reset()
    world.reset()


def test_what_runs_in_the_kernel():
    target_rules.register("far", TargetRule(node_by_number, arguments=(("NODE", 0.0),)))
    target_rules.register("half", TargetRule(half_a_node))
    for name, goal, arguments in (("wrong", place_by_number, ("X",)), ("none", no_vector, ()), ("text", text, ())):
        boat_strategies.register(name, BoatStrategy(Strategy(start=goal, goal=goal), arguments))
    at_once = "world 0 at 0 s"
    for rule, usv, match in (
        ("far:1e6", "wrong:1", f"{at_once}: target of AUV 0 is 1e.06: must be .* from 0 to 29 .*'far' of .*plugins"),
        ("half", "wrong:1", f"{at_once}: target of AUV 0 is 0.5: must be a whole number from 0 to 29 .*'half' of"),
        ("far:0", "wrong:-1", rf"{at_once}: goal_x of boat 0 is nan.*\(uses .*usv 'wrong' of .*plugins"),
        ("greedy", "none", "usv 'none' of .*plugins.py: raised .*start and goal of a boat strategy return a vec2"),
        (
            "greedy",
            "text",
            r'usv \'text\' .*: raised TaichiTypeError: File ".*plugins.py", line \d+, in text: can only',
        ),
    ):
        with pytest.raises(UserError, match=f"^{match}") as caught:
            reset_twice(usv, rule)
        assert str(caught.value).isprintable()


def test_whole_vectors_of_a_plugin():
    """Where its functions do not compile in the kernel of all stages, the mission is the same."""
    after = []
    for goal in (east_of_the_first, east_by_whole_vectors):
        boat_strategies.register(goal.__name__, BoatStrategy(Strategy(start=goal, goal=goal)))
        world = World(Scenario.load("ideal"), 2, usv=goal.__name__)
        world.reset()
        for _ in range(5):
            world.step(torch.zeros(2, world.num_auvs, 2))
        after.append(world.state())
    assert all(torch.equal(value, after[1][name]) for name, value in after[0].items())


@pytest.mark.parametrize(("answer", "match"), [(5, "raised TypeError"), ("one text", "returned .*a list of texts")])
def test_an_observation_term_without_numbers(answer, match):
    observation_terms.register("wrong", ObservationTerm(no_numbers, lambda num_auvs: answer, "1", 0.0, 1.0))
    with pytest.raises(UserError, match=rf"^observation term 'wrong' of .*: {match}"):
        World(Scenario.load("ideal", ['observation.extra=["wrong"]']), 1)


@pytest.mark.parametrize(
    ("registry", "item", "problem", "arguments"),
    [
        (boat_strategies, {"functions": Strategy(no_vector, no_numbers)}, "functions.goal is a .*take", "w, b"),
        (tasks, {"finish": None}, "finish is None: must be a function", "worlds, w"),
        (tasks, {"reward_terms": (RewardTerm("late", node_by_number, 1.0),)}, "reward_terms.function", "k, weight"),
        (tasks, {"observation": "attitude"}, "observation is 'attitude': must be a tuple", "…,"),
        (tasks, {"parameters": ("radius", 5.0)}, "parameters is 'radius': must be a tuple", "…, …"),
        (observation_terms, {"write": node_by_number}, "write is a function .worlds, w, k.: must take", "k, first"),
        (ambient_noise_laws, lambda f: 0.0, r"is a function \(f\): must take", "frequency, shipping, wind"),
        (vehicles, {"trim": 3}, "trim is 3: must be a function", "table, speed, depth, heading"),
        (heuristics, type("Idle", (Heuristic,), {}), "has no method act", "observation"),
        (frames, type("Blind", (WorldFrame,), {"encode": lambda self: 0}), "its method is encode.*be encode", ""),
    ],
)
def test_an_item_with_other_functions_is_refused_when_it_is_registered(registry, item, problem, arguments):
    if isinstance(item, dict):  # what differs from a shipped one
        shipped = next(iter(registry.values()))
        item = shipped._replace(**item) if hasattr(shipped, "_replace") else dataclasses.replace(shipped, **item)
    with pytest.raises(UserError, match=rf"^{registry.kind} 'wrong': {problem}.*\(.*{arguments}\)$"):
        registry.register("wrong", item)
    assert "wrong" not in registry


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
    algorithms.register("wrong", type("Wrong", (DDPG,), {method: answer}))
    config = dataclasses.replace(LEARNING, algorithm="wrong", warmup=320)
    with pytest.raises(PolicyError, match=f"^algorithm 'wrong' of .*plugins.py: {match}"):
        Trainer(TrainingRun(ToyWorld(scenario(), 32, seed=1), config)).train(32 * 20)
