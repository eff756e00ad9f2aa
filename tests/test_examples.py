"""The notebook, and for a few hundred steps of short missions the examples that learn with other people's libraries."""

import importlib
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.wrappers import FlattenObservation

from usvauv import Scenario, World, policies

EXAMPLES = Path(__file__).parent.parent / "examples"


@pytest.fixture(scope="module")
def short_missions(tmp_path_factory):
    """The scenario extreme with missions of 40 steps, so that a few hundred steps hold several."""
    path = tmp_path_factory.mktemp("scenario") / "short.toml"
    short = ["mission.duration=40", "auv.speed_lag=0", "auv.speed_noise=0"]
    path.write_text(Scenario.load("extreme", short).to_toml(), encoding="utf-8")
    return path


@pytest.fixture(autouse=True)
def _one_thread():
    """Small networks on busy cores: a second thread only waits for the first."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


# TorchRL 0.14's own classes inherit from one that it deprecates.
@pytest.mark.filterwarnings("ignore:Creating .* which inherits from WeightUpdaterBase is deprecated:DeprecationWarning")
@pytest.mark.filterwarnings("ignore:SyncDataCollector has been deprecated:DeprecationWarning")  # BenchMARL asks for it
@pytest.mark.parametrize(
    ("name", "library", "steps", "reports"),
    [
        ("stable_baselines3_sac", "stable_baselines3", 300, 10),
        ("cleanrl_td3", "torch", 400, 10),
        ("torchrl_ppo", "torchrl", 500, 10),
        ("benchmarl_mappo", "benchmarl", 400, 8),
    ],
)
def test_learns(name, library, steps, reports, short_missions, tmp_path, monkeypatch, capsys):
    """The reward rises from what random moves bring by a third of the way to zero, and mostly by far more."""
    pytest.importorskip(library)
    monkeypatch.chdir(tmp_path)  # what an example logs goes here
    monkeypatch.syspath_prepend(EXAMPLES)
    rewards = importlib.import_module(name).main(
        ["--steps", str(steps), "--scenario", str(short_missions), "--seed", "1"]
    )
    assert len(rewards) == reports
    assert np.isfinite(rewards).all()
    assert rewards[0] < -2.5
    assert rewards[-1] > rewards[0] * 2 / 3
    if name == "stable_baselines3_sac":  # whose result is a policy for this program
        world = World(Scenario.load(short_missions), 3, seed=5)
        act = policies.acting(f"{name}:Learned", world)
        assert (act(world.reset()).abs() <= 1).all()
    printed = [line for line in capsys.readouterr().out.splitlines() if line.startswith("step ")]
    assert len(printed) == reports
    assert printed[-1].startswith(f"step {steps}: mean team reward {rewards[-1]:.2f} per step")


def test_a_team_as_one_agent_of_stable_baselines3(short_missions):
    """The single-environment face passes the library's check and is learned from over several missions."""
    library = pytest.importorskip("stable_baselines3")
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    env = FlattenObservation(gymnasium.make("usvauv/DataCollection-v0", scenario=short_missions))
    checker.check_env(env)
    learner = library.SAC("MlpPolicy", env, learning_starts=50, batch_size=32, seed=1, device="cpu")
    actor = [weight.clone() for weight in learner.actor.parameters()]
    learner.learn(100)
    assert len(learner.ep_info_buffer) == 2
    assert any((new != old).any() for new, old in zip(learner.actor.parameters(), actor, strict=True))


@pytest.mark.slow
def test_the_notebook_shows_a_table_and_plays_a_trace_and_nothing_else_is_printed(tmp_path, monkeypatch):
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    for name in ("JUPYTER_RUNTIME_DIR", "JUPYTER_CONFIG_DIR", "IPYTHONDIR"):
        monkeypatch.setenv(name, str(tmp_path))
    monkeypatch.delenv("PYTEST_CURRENT_TEST")  # with it the kernel passes on only what Python prints
    notebook = nbformat.read(EXAMPLES / "first_mission.ipynb", as_version=4)
    for cell in notebook.cells:
        cell.source = cell.source.replace("duration=400", "duration=40").replace("episodes=8", "episodes=2")
    nbclient.NotebookClient(notebook, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    assert [output.output_type for output in outputs] == ["execute_result"] * 4, "Taichi prints nothing"
    scenario, table, world, trace = (output["data"] for output in outputs)
    assert scenario["text/plain"].startswith("Scenario 'wide': data-collection, 600 × 600 m")
    assert world["text/plain"].startswith("World of 1 mission, seed 0, on ")
    assert "difference_half" in table["text/html"]
    assert trace["text/plain"].startswith("Trace of 1 mission of 40 steps")
    assert trace["text/html"].startswith("<iframe ")
