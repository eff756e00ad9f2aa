"""TD3 in one file, in the style of CleanRL.

One actor and one pair of critics for all AUVs, trained on the observations and rewards of each. Install and run:

    pip install -c constraints.txt -e .
    python examples/cleanrl_td3.py --steps 6000
    tensorboard --logdir runs
"""

import argparse
import copy
import time
from collections.abc import Sequence

import gymnasium
import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from torch import Tensor, nn
from torch.nn import functional
from torch.utils.tensorboard import SummaryWriter

import usvauv.env  # noqa: F401 - registers the environment


def perceptron(inputs: int, outputs: int) -> nn.Sequential:
    """Two hidden layers of 64, each normalised."""
    hidden = nn.Linear(inputs, 64), nn.LayerNorm(64), nn.ReLU(), nn.Linear(64, 64), nn.LayerNorm(64), nn.ReLU()
    return nn.Sequential(*hidden, nn.Linear(64, outputs))


class Critics(nn.Module):
    """Two action values of (B, O) and (B, A), (2, B)."""

    def __init__(self, observation_size: int, action_size: int) -> None:
        super().__init__()
        self.twins = nn.ModuleList(perceptron(observation_size + action_size, 1) for _ in range(2))

    def forward(self, observation: Tensor, action: Tensor) -> Tensor:
        return torch.stack([twin(torch.cat((observation, action), -1)).squeeze(-1) for twin in self.twins])


class Replay:
    """The last `capacity` transitions, overwritten in turn."""

    def __init__(self, capacity: int, observation_size: int, action_size: int) -> None:
        shapes = ((observation_size,), (action_size,), (), (observation_size,))
        self.columns = [torch.zeros(capacity, *shape) for shape in shapes]
        self.capacity, self.added = capacity, 0

    def add(self, *transition: Tensor) -> None:
        rows = (self.added + torch.arange(len(transition[0]))) % self.capacity
        for column, new in zip(self.columns, transition, strict=True):
            column[rows] = new
        self.added += len(rows)

    def sample(self, batch: int) -> list[Tensor]:
        rows = torch.randint(min(self.added, self.capacity), (batch,))
        return [column[rows] for column in self.columns]


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=6000, help="mission steps of all worlds")
    parser.add_argument("--worlds", type=int, default=32)
    parser.add_argument("--scenario", default="extreme")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--gamma", type=float, default=0.95)
    parser.add_argument("--tau", type=float, default=0.01)
    parser.add_argument("--batch", type=int, default=512)
    parser.add_argument("--learning-rate", type=float, default=1e-3)
    parser.add_argument("--exploration", type=float, default=0.2, help="standard deviation of the noise on actions")
    parser.add_argument("--policy-noise", type=float, default=0.2, help="the same on the target's actions")
    parser.add_argument("--noise-clip", type=float, default=0.5)
    parser.add_argument("--delay", type=int, default=2, help="critic updates for each update of the actor")
    parser.add_argument("--reward-scale", type=float, default=0.1)
    parser.add_argument("--logs", default="runs/cleanrl_td3")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> list[float]:
    """Learn; prints and returns the mean team reward per step of each tenth of the steps."""
    asked = parse(arguments)
    torch.manual_seed(asked.seed)
    writer = SummaryWriter(asked.logs)
    writer.add_text("settings", ", ".join(f"{name} = {value}" for name, value in vars(asked).items()))
    options = {"scenario": asked.scenario, "autoreset_mode": AutoresetMode.DISABLED}
    envs = gymnasium.make_vec("usvauv/DataCollection-v0", num_envs=asked.worlds, **options)
    num_auvs, observation_size = envs.single_observation_space.shape
    action_size = envs.single_action_space.shape[-1]

    actor = nn.Sequential(perceptron(observation_size, action_size), nn.Tanh())
    critics = Critics(observation_size, action_size)
    target_actor, target_critics = copy.deepcopy(actor), copy.deepcopy(critics)
    actor_optimiser = torch.optim.Adam(actor.parameters(), lr=asked.learning_rate)
    critic_optimiser = torch.optim.Adam(critics.parameters(), lr=asked.learning_rate)
    replay = Replay(500_000, observation_size, action_size)

    def rows(team: np.ndarray) -> Tensor:
        """One row for each AUV of each world."""
        return torch.from_numpy(team).flatten(0, 1)

    warmup, every, begun = min(200, asked.steps // 4), max(1, asked.steps // 10), time.perf_counter()
    window, means = [], []
    observation = rows(envs.reset(seed=asked.seed)[0])
    for step in range(1, asked.steps + 1):
        if step <= warmup:
            action = 2 * torch.rand(len(observation), action_size) - 1
        else:
            with torch.no_grad():
                action = actor(observation)
            action = (action + asked.exploration * torch.randn_like(action)).clamp(-1, 1)
        following, team_reward, _, over, details = envs.step(action.unflatten(0, (asked.worlds, num_auvs)).numpy())
        # A mission ends by time alone, so every transition bootstraps.
        reward = asked.reward_scale * rows(details["auv_reward"])
        replay.add(observation, action, reward, rows(following))
        if over.any():
            following, _ = envs.reset(options={"reset_mask": over})
        observation = rows(following)

        if step > warmup:
            state, tried, earned, next_state = replay.sample(asked.batch)
            with torch.no_grad():
                noise = (asked.policy_noise * torch.randn_like(tried)).clamp(-asked.noise_clip, asked.noise_clip)
                next_action = (target_actor(next_state) + noise).clamp(-1, 1)
                target = earned + asked.gamma * target_critics(next_state, next_action).amin(0)
            critic_loss = functional.mse_loss(critics(state, tried), target.expand(2, -1))
            critic_optimiser.zero_grad()
            critic_loss.backward()
            critic_optimiser.step()
            if step % asked.delay == 0:
                actor_loss = -critics(state, actor(state))[0].mean()
                actor_optimiser.zero_grad()
                actor_loss.backward()
                actor_optimiser.step()
                for network, slow in ((actor, target_actor), (critics, target_critics)):
                    for weight, slow_weight in zip(network.parameters(), slow.parameters(), strict=True):
                        slow_weight.data.lerp_(weight.data, asked.tau)

        window.append(float(team_reward.mean()))
        if len(window) == every:
            means.append(float(np.mean(window)))
            rate = step * asked.worlds / (time.perf_counter() - begun)
            print(f"step {step}: mean team reward {means[-1]:.2f} per step, {rate:.0f} world-steps/s")
            writer.add_scalar("mean_team_reward", means[-1], step)
            window.clear()
    envs.close()
    writer.close()
    return means


if __name__ == "__main__":
    main()
