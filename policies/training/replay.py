"""Replay memory of W worlds stepped together, sampled as n-step transitions."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence

import torch
from torch import Tensor

from usvauv.env.storage.memory import require
from usvauv.policies.algorithms import Batch, Rollout
from usvauv.policies.networks import stack

# Name in a checkpoint → attribute.
STORED = {
    "observation": "observation",
    "action": "action",
    "reward": "reward",
    "terminated": "horizon_ended",
    "end": "end",
}


class Replay:
    """A ring of rows, one row for each step of all worlds; row t + 1 follows row t in time.

    The end of an episode takes a row of its own: it holds the last observation, from which a truncated transition
    bootstraps, and no transition starts at it. Where the value's horizon ends, the episode goes on, and no transition
    bootstraps.

    Args:
        rows: capacity in rows. Memory is rows · W · K · (F + A + 2) · 4 bytes.
        shape: W worlds, K AUVs, F features, A action components.
        device: where the memory lives, and where `generator` draws.
        shared: one learner gets the transitions of all AUVs.
        seeds: number of runs that share it; each has its own learners and an equal share of the worlds.

    Raises:
        MemoryNeeded: it does not fit into memory.
    """

    def __init__(
        self, rows: int, shape: tuple[int, int, int, int], device: torch.device, shared: bool, seeds: int = 1
    ) -> None:
        worlds, auvs, features, actions = shape
        numbers = rows * worlds * auvs * (features + actions + 2)
        require(4.0 * numbers, f"training: replay = {rows * worlds}", device)
        self.rows, self.worlds, self.shared, self.seeds, self.device = rows, worlds, shared, seeds, device
        self.observation = torch.zeros((rows, worlds, auvs, features), dtype=torch.float32, device=device)
        self.action = torch.zeros((rows, worlds, auvs, actions), dtype=torch.float32, device=device)
        self.reward = torch.zeros((rows, worlds, auvs), dtype=torch.float32, device=device)
        self.horizon_ended = torch.zeros((rows, worlds, auvs), dtype=torch.bool, device=device)
        self.end = torch.zeros(rows, dtype=torch.bool, device=device)
        self.head = 0
        self.size = 0

    def add(self, observation: Tensor, action: Tensor, reward: Tensor, horizon_ended: Tensor) -> None:
        """Store one step of all worlds: observation (W, K, F), action (W, K, A), reward and horizon_ended (W, K)."""
        self.action[self.head] = action
        self.reward[self.head] = reward
        self.horizon_ended[self.head] = horizon_ended
        self._push(observation, end=False)

    def finish(self, observation: Tensor) -> None:
        """Store the observation (W, K, F) with which all episodes ended."""
        self._push(observation, end=True)

    def _push(self, observation: Tensor, end: bool) -> None:
        self.observation[self.head] = observation
        self.end[self.head] = end
        self.head = (self.head + 1) % self.rows
        self.size = min(self.size + 1, self.rows)

    def share(self, seed: int) -> Replay:
        """The replay of one of the seeds, counted from 0, in the same memory."""
        share = copy.copy(self)
        share.worlds, share.seeds = self.worlds // self.seeds, 1
        for attribute in STORED.values():
            if attribute != "end":  # which all worlds have in common
                setattr(share, attribute, getattr(self, attribute).narrow(1, seed * share.worlds, share.worlds))
        return share

    def tensors(self) -> dict[str, Tensor]:
        """The rows in use, by name."""
        return {name: getattr(self, attribute)[: self.size] for name, attribute in STORED.items()}

    def restore(self, tensors: dict[str, Tensor], head: int, size: int) -> None:
        """The inverse of `tensors`, with `head` and `size` as they were."""
        for name, attribute in STORED.items():
            getattr(self, attribute)[:size] = tensors[name]
        self.head, self.size = head, size

    def sample(
        self, batch: int, n: int, gamma: float, generators: Sequence[torch.Generator], gain: float | Tensor = 0.0
    ) -> Batch:
        """Draw `batch` n-step transitions for each learner, uniformly.

        Args:
            batch: number of transitions; for a shared learner those of all AUVs together.
            n: steps of reward before the bootstrap; the ring must hold more than n + 1 rows.
            gamma: discount of one step.
            generators: sources of the draws, one for each seed.
            gain: average reward of a step, which is subtracted from every reward; a number, or (N,) of N seeds.
        """
        draws = batch // self.reward.shape[-1] if self.shared else batch
        worlds, oldest = self.worlds // self.seeds, self.head - self.size
        starts, places = [], []
        for seed, generator in enumerate(generators):
            age = torch.randint(1, self.size - n, (draws,), generator=generator, device=self.device)
            world = torch.randint(worlds, (draws,), generator=generator, device=self.device)
            starts.append((oldest + age) % self.rows)
            places.append(world + seed * worlds)
        if isinstance(gain, Tensor):
            gain = gain.float().view(-1, 1).expand(-1, draws).reshape(-1, 1)
        return self.transitions(torch.cat(starts), torch.cat(places), n, gamma, gain)

    def transitions(self, start: Tensor, world: Tensor, n: int, gamma: float, gain: float | Tensor) -> Batch:
        """The n-step transitions that start in these rows and worlds, those of one seed after those of another.

        Args:
            gain: average reward of a step; a number, or (draws, 1) of each draw.
        """
        auvs = self.reward.shape[-1]
        # Nothing starts at an end row; the step before it takes its place.
        start = (start - self.end[start].long()) % self.rows

        offsets = torch.arange(n, device=self.device).unsqueeze(-1)
        path = (start + offsets) % self.rows
        reward = self.reward[path, world] - gain
        ended = self.horizon_ended[path, world].float()
        # A step counts if neither the value's horizon nor the episode ended before it.
        survived = torch.cumprod(1.0 - ended, 0)
        counted = torch.cat((torch.ones_like(survived[:1]), survived[:-1]))
        counted = counted * torch.cumprod(1.0 - self.end[path].float(), 0).unsqueeze(-1)
        weight = gamma ** offsets.float().unsqueeze(-1) * counted
        steps = counted.sum(0).long()
        after = (start.unsqueeze(-1) + steps) % self.rows
        auv = torch.arange(auvs, device=self.device)
        bootstraps = 1.0 - (counted * ended).amax(0)
        return Batch(
            observation=self._stack(self.observation[start, world]),
            action=self._stack(self.action[start, world]),
            reward=self._stack((weight * reward).sum(0)),
            discount=self._stack(gamma ** steps.float() * bootstraps),
            next_observation=self._stack(self.observation[after, world.unsqueeze(-1), auv]),
        )

    @property
    def newest(self) -> Tensor:
        """The observation of the last row."""
        return self.observation[self.head - 1]

    def take(self, after: Tensor, n: int, gamma: float, gain: Tensor, batch: int, taught: bool = False) -> Rollout:
        """Take out all that is stored, whose first row begins a decision, as decisions held for n steps.

        Args:
            after: the observation (W, K, F) that followed.
            gain: as in `sample`; (N,) of N seeds.
            batch: decisions of each learner in a minibatch, at most.
            taught: see `Rollout`.
        """
        self.finish(after)
        starts, follows, held = [], [], 0
        for row, end in enumerate(self.end[: self.size].tolist()):
            if not end and held % n == 0:
                starts.append(row)
                follows.append(float(held > 0))
            held = 0 if end else held + 1
        worlds = torch.arange(self.worlds, device=self.device).view(self.seeds, 1, -1)
        rows, worlds = torch.broadcast_tensors(torch.tensor(starts, device=self.device).view(1, -1, 1), worlds)
        gain = gain.float().reshape(-1, 1, 1).expand(rows.shape).reshape(-1, 1)
        flat = self.transitions(rows.flatten(), worlds.flatten(), n, gamma, gain)
        self.head = self.size = 0
        tensors = {name: value.unflatten(1, (len(starts), -1)) for name, value in vars(flat).items()}
        parts = math.ceil(flat.reward.shape[1] / batch)
        later = torch.tensor([*follows[1:], 0.0], dtype=torch.float32, device=self.device)
        return Rollout(**tensors, follows=later, parts=parts, taught=taught)

    def _stack(self, value: Tensor) -> Tensor:
        """Values (S, B, ...) of the learners, from those (B, K, ...) of AUVs."""
        return stack(value, self.shared, self.seeds)
