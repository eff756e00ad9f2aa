"""Replay memory of W worlds in step, sampled as n-step transitions."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

STORED = ("observation", "action", "reward", "terminated", "end")


@dataclass(frozen=True)
class Batch:
    """n-step transitions of S independent learners, B each.

    Attributes:
        observation: (S, B, F) features at step t.
        action: (S, B, A) action taken there.
        reward: (S, B) Σ γ^i r_{t+i} over the m ≤ n steps until the horizon, a termination or the end of the episode.
        discount: (S, B) γ^m, or 0 after a termination: the weight of the value of `next_observation`.
        next_observation: (S, B, F) features at step t + m.
    """

    observation: Tensor
    action: Tensor
    reward: Tensor
    discount: Tensor
    next_observation: Tensor


class Replay:
    """A ring of rows, one row for each step of all worlds; row t + 1 follows row t in time.

    The end of an episode takes a row of its own: it holds the last observation, from which a truncated transition
    bootstraps, and no transition starts at it. Terminations do not end an episode; they cut the value only.

    Args:
        rows: capacity in rows. Memory is rows · W · K · (F + A + 2) · 4 bytes.
        shape: W worlds, K AUVs, F features, A action components.
        device: where the memory lives, and where `generator` draws.
        shared: one learner gets the transitions of all AUVs.
    """

    def __init__(self, rows: int, shape: tuple[int, int, int, int], device: torch.device, shared: bool):
        worlds, auvs, features, actions = shape
        self.rows, self.worlds, self.shared, self.device = rows, worlds, shared, device
        self.observation = torch.zeros((rows, worlds, auvs, features), device=device)
        self.action = torch.zeros((rows, worlds, auvs, actions), device=device)
        self.reward = torch.zeros((rows, worlds, auvs), device=device)
        self.terminated = torch.zeros((rows, worlds, auvs), dtype=torch.bool, device=device)
        self.end = torch.zeros(rows, dtype=torch.bool, device=device)
        self.head = 0
        self.size = 0

    def add(self, observation: Tensor, action: Tensor, reward: Tensor, terminated: Tensor) -> None:
        """Store one step of all worlds: observation (W, K, F), action (W, K, A), reward and terminated (W, K)."""
        self.action[self.head] = action
        self.reward[self.head] = reward
        self.terminated[self.head] = terminated
        self._push(observation, end=False)

    def finish(self, observation: Tensor) -> None:
        """Store the observation (W, K, F) with which all episodes ended."""
        self._push(observation, end=True)

    def _push(self, observation: Tensor, end: bool) -> None:
        self.observation[self.head] = observation
        self.end[self.head] = end
        self.head = (self.head + 1) % self.rows
        self.size = min(self.size + 1, self.rows)

    def tensors(self) -> dict[str, Tensor]:
        """The rows in use, by name."""
        return {name: getattr(self, name)[: self.size] for name in STORED}

    def restore(self, tensors: dict[str, Tensor], head: int, size: int) -> None:
        """The inverse of `tensors`, with `head` and `size` as they were."""
        for name in STORED:
            getattr(self, name)[:size] = tensors[name]
        self.head, self.size = head, size

    def sample(self, batch: int, n: int, gamma: float, generator: torch.Generator, gain: float = 0.0) -> Batch:
        """Draw `batch` transitions for each learner, uniformly; needs more than n + 1 rows. `gain` is what every step
        costs on top of its reward.
        """
        auvs = self.reward.shape[-1]
        draws = batch // auvs if self.shared else batch
        oldest = self.head - self.size
        age = torch.randint(1, self.size - n, (draws,), generator=generator, device=self.device)
        world = torch.randint(self.worlds, (draws,), generator=generator, device=self.device)
        start = (oldest + age) % self.rows
        # Nothing starts at an end row; the step before it takes its place.
        start = (start - self.end[start].long()) % self.rows

        offsets = torch.arange(n, device=self.device).unsqueeze(-1)
        path = (start + offsets) % self.rows
        reward = self.reward[path, world] - gain
        terminated = self.terminated[path, world].float()
        # A step counts if no termination came before it and no end row was reached.
        survived = torch.cumprod(1.0 - terminated, 0)
        counted = torch.cat((torch.ones_like(survived[:1]), survived[:-1]))
        counted = counted * torch.cumprod(1.0 - self.end[path].float(), 0).unsqueeze(-1)
        weight = gamma ** offsets.float().unsqueeze(-1) * counted
        steps = counted.sum(0).long()
        follow = (start.unsqueeze(-1) + steps) % self.rows
        auv = torch.arange(auvs, device=self.device)
        alive = 1.0 - (counted * terminated).amax(0)
        return Batch(
            observation=self._stack(self.observation[start, world]),
            action=self._stack(self.action[start, world]),
            reward=self._stack((weight * reward).sum(0)),
            discount=self._stack(gamma ** steps.float() * alive),
            next_observation=self._stack(self.observation[follow, world.unsqueeze(-1), auv]),
        )

    def _stack(self, value: Tensor) -> Tensor:
        """(B, K, ...) → (S, B, ...)"""
        return stack(value, self.shared)


def stack(value: Tensor, shared: bool) -> Tensor:
    """(W, K, ...) → (K, W, ...), the order of stacked learners, or (1, W K, ...) when they share one network."""
    if shared:
        return value.reshape(1, -1, *value.shape[2:])
    return value.transpose(0, 1).contiguous()


def unstack(value: Tensor, auvs: int) -> Tensor:
    """The inverse of `stack`: back to (W, K, ...)."""
    if value.shape[0] == 1:
        return value.reshape(-1, auvs, *value.shape[2:])
    return value.transpose(0, 1)
