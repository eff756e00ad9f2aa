"""BenchMARL in our environment or VMAS, for `benchmarks.learning_beside`, which describes the settings."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import torch
from benchmarl.algorithms import IppoConfig, IsacConfig
from benchmarl.environments import VmasTask
from benchmarl.experiment import Callback, Experiment, ExperimentConfig
from benchmarl.models.mlp import MlpConfig

from usvauv.env.interfaces.benchmarl_task import DataCollectionTask

AGENTS = 2
STEPS = 20  # of all worlds from one learning of SAC to the next, in which as many updates follow one another


class Clock(Protocol):
    """Tells whether the time is over after so many agent-steps, and transitions trained."""

    def over(self, agent_steps: int, trained: int) -> bool: ...


class Over(Exception):
    """The time is over."""


class Look(Callback):
    """Ends the learning."""

    def __init__(self, over: Callable[[int, int], bool]) -> None:
        super().__init__()
        self.over, self.trained = over, 0

    def __reduce__(self) -> Any:
        return Callback, ()  # the experiment pickles its callbacks

    def on_train_step(self, batch: Any, group: str) -> Any:
        self.trained += batch.numel() * AGENTS

    def on_train_end(self, training_td: Any, group: str) -> None:
        if self.over(self.experiment.total_frames * AGENTS, self.trained):
            raise Over


def task_of(name: str) -> Any:
    """A scenario of ours, or a task of VMAS by its name there, with `AGENTS` agents."""
    if name not in VmasTask.__members__:
        return DataCollectionTask(name)
    task = VmasTask[name].get_from_yaml()
    task.config |= {"n_agents": AGENTS}
    return task


def learn(
    task: str, algorithm: str, clock: Clock, ppo: Mapping[str, int], sac: Mapping[str, int], hidden: Sequence[int]
) -> None:
    """Train until the clock's time is over; each agent acts, and is valued, by its own observation."""
    config = ExperimentConfig.get_from_yaml()
    config.on_policy_n_envs_per_worker = ppo["num_worlds"]
    config.on_policy_collected_frames_per_batch = ppo["num_worlds"] * ppo["rollout"]
    config.on_policy_n_minibatch_iters = ppo["updates"]
    config.on_policy_minibatch_size = ppo["batch"] // AGENTS
    config.off_policy_n_envs_per_worker = sac["num_worlds"]
    config.off_policy_collected_frames_per_batch = STEPS * sac["num_worlds"]
    config.off_policy_n_optimizer_steps = STEPS * sac["updates"]
    config.off_policy_train_batch_size = sac["batch"] // AGENTS
    config.evaluation = config.render = config.create_json = False
    config.loggers = []
    config.max_n_frames = 10**9
    model = MlpConfig.get_from_yaml()
    model.num_cells, model.activation_class = list(hidden), torch.nn.ReLU
    kind = IppoConfig if algorithm == "ppo" else IsacConfig
    with tempfile.TemporaryDirectory() as folder:
        config.save_folder = folder
        experiment = Experiment(
            task=task_of(task),
            algorithm_config=kind.get_from_yaml(),
            model_config=model,
            critic_model_config=model,
            seed=0,
            config=config,
            callbacks=[Look(clock.over)],
        )
        try:
            experiment.run()
        except Over:
            experiment.close()
