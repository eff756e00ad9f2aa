"""Training of the boat strategy `learned`: a decision earns what AUVs are expected to deliver until the next one.

That is the mean data of an AUV that finds its node, times the probability that each AUV does: that by its own filter it
is no farther off than it finds its node. The data that are delivered say the same in the end, but late, and with the
chance of the nodes' backlogs and of each AUV's error.
"""

from __future__ import annotations

import math

import torch

from usvauv.env.world.world import World
from usvauv.kernels.mission import learned_visits
from usvauv.kernels.mission.candidate_scores import Decision
from usvauv.kernels.mission.columns import AuvColumn
from usvauv.kernels.positioning import tracker
from usvauv.policies.decisions.trainer import Act, DecisionConfig, Decisions, Learner


def collect(world: World, act: Act, horizon: float) -> Decisions:
    """The decisions of the next episode of all worlds; what is earned t later counts exp(−t/horizon).

    Of several boats each earns what all AUVs deliver, as if it had a world of its own.
    """
    scenario = world.scenario
    finds = max(scenario.auv.hover_radius, scenario.navigation.homing_range)  # m
    left = learned_visits.decisions(world.boat_workspace, world.num_auvs)
    left[..., Decision.made] = 0
    observation = world.reset()
    parts: list[tuple[torch.Tensor, ...]] = []
    data, working = (world.auv.new_zeros(world.steps, world.num_worlds, dtype=torch.float64) for _ in range(2))
    for step in range(world.steps):
        observation = world.step(act(observation))[0]
        worlds, boats = left[..., Decision.made].nonzero(as_tuple=True)
        parts.append((left[worlds, boats], worlds * left.shape[1] + boats, torch.full_like(worlds, step)))
        left[..., Decision.made] = 0
        variance = 0.5 * (world.own[..., tracker.XX] + world.own[..., tracker.YY])
        data[step] = world.auv[..., AuvColumn.delivered].sum(-1)
        working[step] = (1 - torch.exp(-0.5 * finds**2 / variance.clamp(min=1e-6))).sum(-1)
    seen, boats, steps = (torch.cat(part) for part in zip(*parts, strict=True))
    order = boats.argsort(stable=True)  # the decisions of a boat one after the other
    seen, boats, steps = seen[order], boats[order], steps[order]
    rewards = working * (data.sum() / working.sum().clamp(min=1.0))
    rewards = rewards.repeat_interleave(left.shape[1], 1)
    earned = earned_until_next(rewards, boats, steps, math.exp(-scenario.mission.step / horizon))
    return Decisions(seen, boats, steps * scenario.mission.step, earned, data.sum(0))


def earned_until_next(rewards: torch.Tensor, worlds: torch.Tensor, steps: torch.Tensor, keep: float) -> torch.Tensor:
    """What each of D decisions (D,), sorted by worlds and steps, earns until the next one of its world.

    Args:
        rewards: (T, W) of each step.
        keep: the share that a reward counts one step later.
    """
    to_come = rewards.new_zeros(len(rewards) + 1, rewards.shape[1])  # discounted
    for step in range(len(rewards) - 1, -1, -1):
        to_come[step] = rewards[step] + keep * to_come[step + 1]
    until = torch.full_like(steps, len(rewards))
    until[:-1] = torch.where(worlds[1:] == worlds[:-1], steps[1:], len(rewards))
    return (to_come[steps, worlds] - keep ** (until - steps) * to_come[until, worlds]).float()


VISITS = Learner(
    form=learned_visits.NETWORK,
    argument="usv",
    numbers=lambda world: world.strategy_arguments,
    before=(),
    collect=collect,
    settings=DecisionConfig(horizon=300.0, trace=0.9, learning_rate=2e-3, epochs=6, batch=1024),
)
