"""A policy and an algorithm from files outside the package."""

from __future__ import annotations

import dataclasses
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from tests.policies.toy import LEARNING, ToyWorld, scenario
from usvauv import policies
from usvauv.env import plugins
from usvauv.policies import PolicyError, Trainer

pytestmark = pytest.mark.usefixtures("own_registries")
EXAMPLES = Path(__file__).parents[2] / "examples" / "plugins"


def load(name: str, folder: Path) -> None:
    plugins.load(shutil.copy(EXAMPLES / name, folder / f"my_{name}"))


def test_a_policy_leads_its_target_by_the_drift(tmp_path):
    world = ToyWorld(scenario(), 16, seed=2)
    observation = world.reset()
    with pytest.raises(PolicyError, match="neither a checkpoint directory nor one of"):
        policies.load("lead:20", world)
    load("policy.py", tmp_path)
    assert policies.available()[-1] == "lead"
    straight = policies.load("straight", world).act(observation)
    torch.testing.assert_close(policies.load("lead:0", world).act(observation), straight)
    world.target -= 20.0 * world.drift
    upstream = policies.load("straight", world).act(world._observe())
    torch.testing.assert_close(policies.load("lead:20", world).act(observation), upstream)
    with pytest.raises(PolicyError, match=r"^policy lead:soon: could not convert string to float: 'soon'$"):
        policies.check("lead:soon", scenario())


def test_an_algorithm_trains_and_its_policy_is_kept(tmp_path):
    with pytest.raises(PolicyError, match=r"algorithm = 'ensemble': must be one of sac, td3, ddpg$"):
        dataclasses.replace(LEARNING, algorithm="ensemble")
    load("algorithm.py", tmp_path)
    config = dataclasses.replace(LEARNING, algorithm="ensemble", warmup=320)
    trainer = Trainer(ToyWorld(scenario(), 32, seed=1), config, tmp_path / "run")
    untrained = trainer.learner.actor.weights[-1].detach().clone()
    assert trainer.train(32 * 30)["updates"] == 20
    assert not torch.equal(trainer.learner.actor.weights[-1], untrained)
    observation = trainer.world.reset()
    kept = policies.load(tmp_path / "run", trainer.world)
    assert torch.equal(kept.act(observation), trainer.policy().act(observation))


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("from kernels.errors import UserError", "imports kernels, whose name since 0.3 is usvauv.kernels"),
        ("import usvauv_env.scenario", "imports usvauv_env, whose name since 0.3 is usvauv.env"),
    ],
)
def test_a_plugin_of_version_02_is_told_the_new_name(tmp_path, line, said):
    (tmp_path / "old.py").write_text(line)
    done = subprocess.run(
        [sys.executable, "-m", "usvauv.cli", "scenarios", "--plugin", "old.py"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert said in " ".join(done.stderr.split())
