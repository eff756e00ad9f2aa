"""Decisions of the target rule `learned` in an episode: each earns the data of the service that it leads to.

Counted when they are delivered, they would come after decisions of other AUVs that have no part in them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from usvauv.env.world.world import World
from usvauv.kernels.mission.columns import AuvColumn
from usvauv.kernels.mission.target_rules import learned
from usvauv.kernels.mission.target_rules.learned import Decision

Act = Callable[[Tensor], Tensor]


@dataclass
class Decisions:
    """D decisions, in the order of their worlds and times.

    Attributes:
        seen: (D, ·) as the worlds left them, see `usvauv.kernels.mission.target_rules.learned`.
        world: (D,) of each.
        time: (D,) s.
        earned: (D,) Mbit, as they count at the time of the decision.
        total: (W,) data delivered in the episode, Mbit.
    """

    seen: Tensor
    world: Tensor
    time: Tensor
    earned: Tensor
    total: Tensor


def collect(world: World, act: Act, horizon: float) -> Decisions:
    """The decisions of the next episode of all worlds; what is earned t later counts exp(−t/horizon)."""
    work = learned.decisions(world.rule_workspace, world.node.shape[1], world.num_auvs)
    work[..., Decision.made] = 0
    observation = world.reset()
    delivered = world.auv.new_zeros(world.num_worlds)
    parts: list[tuple[torch.Tensor, ...]] = []

    def gather(step: int) -> None:
        worlds, auvs = work[..., Decision.made].nonzero(as_tuple=True)
        if len(worlds):
            time = delivered.new_full((len(worlds),), step * world.scenario.mission.step)
            parts.append((work[worlds, auvs], worlds, auvs, time, world.auv[worlds, auvs, AuvColumn.delivered]))
            work[worlds, auvs, Decision.made] = 0

    gather(0)
    for step in range(1, world.steps + 1):
        observation = world.step(act(observation))[0]
        delivered += world.auv[..., AuvColumn.delivered].sum(-1)
        gather(step)
    seen, worlds, auvs, time, done = (torch.cat(part) for part in zip(*parts, strict=True))
    each = (worlds * world.num_auvs + auvs).argsort(stable=True)  # the decisions of an AUV one after the other
    same = (worlds[each[1:]] == worlds[each[:-1]]) & (auvs[each[1:]] == auvs[each[:-1]])
    earned = torch.zeros_like(done)
    earned[each[:-1]] = same * done[each[1:]] * torch.exp(-(time[each[1:]] - time[each[:-1]]) / horizon)
    order = worlds.argsort(stable=True)
    order = order[time[order] < world.steps * world.scenario.mission.step]  # those after the last step come to nothing
    return Decisions(seen[order], worlds[order], time[order], earned[order], delivered)
