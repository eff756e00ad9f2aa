"""Multi-agent proximal policy optimisation by BenchMARL: one actor for all AUVs, one critic that sees them all.

Install, in an environment without the extra torchrl, and run:

    pip install -c constraints.txt -e ".[benchmarl]"
    python examples/benchmarl_mappo.py --steps 6000
"""

import argparse
from collections.abc import Sequence

import torch
from benchmarl.algorithms import MappoConfig
from benchmarl.experiment import Callback, Experiment, ExperimentConfig
from benchmarl.models import MlpConfig
from tensordict import TensorDictBase

from usvauv.env.interfaces.benchmarl_task import DataCollectionTask


class Report(Callback):
    """Prints and keeps the mean team reward per step of each batch."""

    def __init__(self, horizon: int) -> None:
        super().__init__()
        self.horizon = horizon
        self.means: list[float] = []

    def on_batch_collected(self, batch: TensorDictBase) -> None:
        self.means.append(float(batch["next", "agents", "reward"].sum(-2).mean()))
        print(f"step {len(self.means) * self.horizon}: mean team reward {self.means[-1]:.2f} per step")


def main(arguments: Sequence[str] | None = None) -> list[float]:
    """Learn for `--steps` mission steps; prints and returns the mean team reward per step of each batch."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=6000)
    parser.add_argument("--worlds", type=int, default=64)
    parser.add_argument("--scenario", default="extreme")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--horizon", type=int, default=50, help="steps between two rounds of learning")
    parser.add_argument("--epochs", type=int, default=6)
    parser.add_argument("--minibatch", type=int, default=200, help="world-steps")
    asked = parser.parse_args(arguments)

    config = ExperimentConfig.get_from_yaml()
    config.loggers, config.create_json, config.evaluation = [], False, False
    config.max_n_frames = asked.steps * asked.worlds
    config.on_policy_n_envs_per_worker = asked.worlds
    config.on_policy_collected_frames_per_batch = asked.horizon * asked.worlds
    config.on_policy_n_minibatch_iters, config.on_policy_minibatch_size = asked.epochs, asked.minibatch
    config.gamma, config.lr = 0.95, 1e-3
    model = MlpConfig(num_cells=[64, 64], activation_class=torch.nn.Tanh, layer_class=torch.nn.Linear)
    report = Report(asked.horizon)
    Experiment(
        DataCollectionTask(asked.scenario), MappoConfig.get_from_yaml(), model,
        seed=asked.seed, config=config, critic_model_config=model, callbacks=[report],
    ).run()  # fmt: skip
    return report.means


if __name__ == "__main__":
    main()
