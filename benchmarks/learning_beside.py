"""Agent-steps a second including learning, beside Stable-Baselines3 and BenchMARL.

    python -m benchmarks.learning_beside

Stable-Baselines3 and BenchMARL learn in our environment through `usvauv.env.interfaces`, BenchMARL also in `navigation`
of VMAS with two agents, a far simpler world. All learn with the same settings: PPO from 128 worlds and rollouts of 100
steps, each seen in 3 epochs of minibatches of 4,096 transitions of an agent; SAC from 256 worlds, with one update of
256 transitions of an agent for each step of all worlds; networks of two layers of 64, shared by the agents, torch on
one thread. "usvauv, as shipped" has the settings of `usvauv train` instead, in which PPO holds each action for 4 steps
and SAC has a network for each AUV. "trained" counts the transitions of an agent in all gradient steps, which is what
learning costs. Rates are those from the second learning on, without evaluations; those per second of processor time,
of all threads, depend least on what else the machine does.

Install `pip install -c constraints.txt -e ".[bench,sb3,benchmarl]" vmas` in an environment without the extra torchrl.
What is missing is left out.
"""

from __future__ import annotations

import importlib
import math
import time
from collections.abc import Callable
from typing import Any

import torch

from benchmarks.machine import command_line, describe, parse, show
from usvauv.env import Scenario, World
from usvauv.policies import Trainer, TrainingConfig, TrainingRun

HIDDEN = (64, 64)
PPO = {"num_worlds": 128, "rollout": 100, "updates": 3, "batch": 4096}
SAC = {"num_worlds": 256, "updates": 1, "batch": 256}


class Clock:
    """Ends a learning after some time, and gives its rates.

    Args:
        seconds: from the first mark on.
    """

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self.marks: list[tuple[float, float, int, int]] = []

    def over(self, agent_steps: int, trained: int) -> bool:
        """Note how many agent-steps were made and how many transitions trained; whether the time is over."""
        self.marks.append((time.perf_counter(), time.process_time(), agent_steps, trained))
        return len(self.marks) > 2 and self.marks[-1][0] - self.marks[0][0] > self.seconds

    def rates(self) -> dict[str, float]:
        """Of agent-steps and of transitions trained, per second, and of agent-steps per second of processor time."""
        first, last = self.marks[0], self.marks[-1]
        seconds, processor, steps, trained = (after - before for before, after in zip(first, last, strict=True))
        return {
            "agent-steps/s": steps / seconds,
            "trained/s": trained / seconds,
            "agent-steps/processor s": steps / processor,
        }


def ours(scenario: str, algorithm: str, clock: Clock, **settings: Any) -> None:
    """Train with `Trainer`."""
    setting = Scenario.load(scenario)
    config = TrainingConfig.of(setting, algorithm=algorithm, **settings)
    run = TrainingRun(World(setting, config.num_worlds, config.seed), config)
    trainer, auvs = Trainer(run), setting.auv.count
    if config.on_policy:
        an_update = config.updates * config.num_worlds * config.rollout // config.n_step * auvs
    else:
        an_update = config.updates * config.batch * (1 if config.shared else auvs)

    def look(figures: list[dict[str, Any]]) -> None:
        if run.learner.updates and clock.over(run.steps * auvs, run.learner.updates * an_update):
            trainer.stop()

    trainer.train(10**9, look)


def stable_baselines3(scenario: str, algorithm: str, clock: Clock) -> None:
    """Train with Stable-Baselines3, for which each AUV is an environment."""
    import stable_baselines3
    from stable_baselines3.common.callbacks import BaseCallback

    from usvauv.env.interfaces.sb3_env import AuvVecEnv

    class Look(BaseCallback):
        """Ends the learning."""

        def _on_step(self) -> bool:
            done = self.model._n_updates
            if not done or done == self.before:
                return True
            self.before = done
            made = self.num_timesteps
            trained = done * env.num_envs * PPO["rollout"] if algorithm == "ppo" else done * SAC["batch"]
            return not clock.over(made, trained)

        before = 0

    worlds = (PPO if algorithm == "ppo" else SAC)["num_worlds"]
    env = AuvVecEnv(scenario, worlds, 0, reward_scale=0.1)
    net = {"net_arch": list(HIDDEN), "activation_fn": torch.nn.ReLU}
    if algorithm == "ppo":
        sizes = {"n_steps": PPO["rollout"], "batch_size": PPO["batch"], "n_epochs": PPO["updates"]}
        model = stable_baselines3.PPO("MlpPolicy", env, device="cpu", seed=0, policy_kwargs=net, **sizes)
    else:
        sizes = {"batch_size": SAC["batch"], "gradient_steps": SAC["updates"], "learning_starts": 20 * env.num_envs}
        model = stable_baselines3.SAC("MlpPolicy", env, device="cpu", seed=0, policy_kwargs=net, **sizes)
    model.learn(10**9, callback=Look())
    env.close()


def benchmarl(task: str, algorithm: str, clock: Clock) -> None:
    """Train with BenchMARL."""
    learner = importlib.import_module("benchmarks.benchmarl_learner")
    learner.learn(task, algorithm, clock, PPO, SAC, HIDDEN)


def learners(algorithm: str) -> dict[str, Callable[[Clock], None]]:
    """By name."""
    alike = {**(PPO if algorithm == "ppo" else SAC), "hidden": HIDDEN, "shared": True, "n_step": 1}
    return {
        "usvauv, `extreme`": lambda clock: ours("extreme", algorithm, clock, **alike),
        "usvauv, `extreme`, as shipped": lambda clock: ours("extreme", algorithm, clock),
        "usvauv, `wide-torpedo`, as shipped": lambda clock: ours("wide-torpedo", algorithm, clock),
        "Stable-Baselines3, `extreme`": lambda clock: stable_baselines3("extreme", algorithm, clock),
        "BenchMARL, `extreme`": lambda clock: benchmarl("extreme", algorithm, clock),
        "BenchMARL, VMAS `navigation`": lambda clock: benchmarl("NAVIGATION", algorithm, clock),
    }


def main() -> None:
    parser = command_line(__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="of learning, for each rate")
    arguments = parse(parser)
    torch.set_num_threads(1)
    rows = []
    for algorithm in ("ppo", "sac"):
        for name, learn in learners(algorithm).items():
            clock = Clock(arguments.seconds)
            try:
                learn(clock)
            except ImportError as missing:
                print(f"{name}: left out: {missing}")
                continue
            rates = {rate: math.floor(value) for rate, value in clock.rates().items()}
            rows.append({"algorithm": algorithm.upper(), "learner": name, **rates})
    show({"machine": describe(), "learning": rows}, arguments.json)


if __name__ == "__main__":
    main()
