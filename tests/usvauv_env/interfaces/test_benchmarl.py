"""BenchMARL's task: its experiments learn on it, and it is the TorchRL face.

BenchMARL wants another TorchRL than the extra `torchrl`, so in an environment of its own

    pip install -c constraints.txt -e ".[benchmarl]" pytest pytest-timeout
    pytest tests/usvauv_env/interfaces/test_benchmarl.py tests/test_examples.py
"""

import pytest
import torch

from usvauv.env import Scenario, World

pytest.importorskip("benchmarl", reason="needs the extra benchmarl")

from benchmarl.algorithms import IddpgConfig, MappoConfig
from benchmarl.experiment import Experiment, ExperimentConfig
from benchmarl.models import MlpConfig

from usvauv.env.interfaces.benchmarl_task import DataCollectionTask

pytestmark = pytest.mark.filterwarnings("ignore:SyncDataCollector has been deprecated:DeprecationWarning")

STEPS = 6
OBSERVATION, ACTION, REWARD = ("agents", "observation"), ("agents", "action"), ("agents", "reward")


@pytest.fixture(scope="module")
def short():
    return Scenario.load("extreme", [f"mission.duration={STEPS}"])


def settings(folder):
    """Settings of an experiment with two iterations of two missions in each of three worlds."""
    config = ExperimentConfig.get_from_yaml()
    config.loggers, config.create_json, config.save_folder = [], False, str(folder)
    config.max_n_frames, config.max_n_iters = None, 2
    config.on_policy_n_envs_per_worker = config.off_policy_n_envs_per_worker = 3
    config.on_policy_collected_frames_per_batch = config.off_policy_collected_frames_per_batch = 2 * 3 * STEPS
    config.on_policy_n_minibatch_iters, config.on_policy_minibatch_size = 2, 12
    config.off_policy_n_optimizer_steps, config.off_policy_train_batch_size = 2, 12
    config.off_policy_memory_size = 100
    config.evaluation_interval, config.evaluation_episodes = 2 * 3 * STEPS, 2
    return config


def experiment(task, algorithm, folder):
    model = MlpConfig(num_cells=[8], activation_class=torch.nn.Tanh, layer_class=torch.nn.Linear)
    return Experiment(
        task, algorithm.get_from_yaml(), model, seed=3, config=settings(folder), critic_model_config=model
    )


def weights(running, group):
    """Weights of a group's actor."""
    return [*running.losses[group].actor_network_params.values(True, True)]


@pytest.mark.parametrize(("algorithm", "usv"), [(MappoConfig, None), (IddpgConfig, "agent")])
def test_experiments_learn(short, tmp_path, algorithm, usv):
    running = experiment(DataCollectionTask(short, usv), algorithm, tmp_path)
    groups = {"agents", "boats"} if usv else {"agents"}
    assert set(running.group_policies) == groups
    before = {group: [weight.clone() for weight in weights(running, group)] for group in groups}
    running.run()
    assert running.n_iters_performed == 2
    assert running.total_frames == 2 * 2 * 3 * STEPS
    for group in groups:
        after = weights(running, group)
        assert all(torch.isfinite(weight).all() for weight in after)
        assert not any(torch.equal(old, new) for old, new in zip(before[group], after, strict=True))


def test_rollouts_are_missions_of_the_world(short):
    task = DataCollectionTask(short)
    env = task.get_env_fun(num_envs=3, continuous_actions=True, seed=7, device="cpu")()
    data = env.rollout(task.max_steps(env))
    world = World(short, 3, 7)
    assert data.batch_size == (3, STEPS)
    assert torch.equal(data[OBSERVATION][:, 0], world.reset())
    for step in range(STEPS):
        observation, reward, *_ = world.step(data[ACTION][:, step])
        assert torch.equal(data["next", *OBSERVATION][:, step], observation)
        assert torch.equal(data["next", *REWARD][:, step, :, 0], reward)
    assert data["next", "done"][:, -1].all()
