"""Policies by MODULE:CLASS."""

import sys

import pytest
import torch

from tests.policies.toy import ToyWorld, scenario
from usvauv import policies
from usvauv.policies import PolicyError

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

class Unmade:
    def __init__(self):
        pass

class Inert:
    def __init__(self, world):
        pass

def few(world):
    return lambda observation: observation[..., :1]

def endless(world):
    return lambda observation: observation[..., :2] * math.nan

def text(world):
    return lambda observation: "north"

def failing(world):
    return lambda observation: {}["north"]

number = 5
"""


@pytest.fixture(autouse=True)
def _module(tmp_path, monkeypatch):
    """The text above as modules of the working directory, which is forgotten after a test."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setattr(sys, "modules", {**sys.modules})
    (tmp_path / "own_east.py").write_text(TEXT)
    (tmp_path / "straight.py").write_text(TEXT)
    (tmp_path / "own_broken.py").write_text("import nowhere")


@pytest.mark.parametrize("name", ["own_east:East", "own_east:function"])
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
        ("own_gone:East", "module own_gone cannot be imported: ModuleNotFoundError: No module named 'own_gone'"),
        ("own_broken:East", "module own_broken cannot be imported: ModuleNotFoundError: No module named 'nowhere'"),
        ("own_east:West", "own_east.py has no class or function 'West'"),
        ("own_east:number", "own_east.py has no class or function 'number'"),
    ],
)
def test_what_cannot_be_found_is_refused_without_a_world(name, problem):
    with pytest.raises(PolicyError, match=rf"^policy '{name}': .*{problem}$"):
        policies.check(name, scenario())


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("Unmade", r"raised TypeError: .*__init__\(\) takes 1 positional argument but 2 were given"),
        ("Inert", "returned <own_east.Inert object at .*>: must be an object with `act`, or a function"),
        ("few", r"returned 'torch.float32 of shape \(3, 2, 1\) on cpu': must be real numbers of shape \(3, 2, 2\)"),
        ("endless", r"returned nan: must be numbers in \[-1, 1\]"),
        ("text", r"returned 'north': must be a tensor of shape \(3, 2, 2\)"),
        ("failing", "raised KeyError: 'north'"),
    ],
)
def test_what_fails_names_the_class_and_its_file(name, problem):
    world = ToyWorld(scenario(), 3, seed=2)
    with pytest.raises(PolicyError, match=rf"^policy 'own_east:{name}' of .*own_east\.py: {problem}"):
        policies.acting(f"own_east:{name}", world)(world.reset())


def test_heuristics_and_folders_come_first(tmp_path):
    with pytest.raises(PolicyError, match="'East' is not a speed"):
        policies.check("straight:East", scenario())
    (tmp_path / "own_east:East").mkdir()
    with pytest.raises(PolicyError, match=r"policy\.json is missing"):
        policies.check("own_east:East", scenario())


def test_what_is_no_name_of_a_class_is_unknown():
    for name in ("hold:100,100", "straigth:1.5", "own_east:", ":East", "own east:East"):
        with pytest.raises(PolicyError, match=r"neither a checkpoint directory nor one of .*, nor MODULE:CLASS$"):
            policies.check(name, scenario())
