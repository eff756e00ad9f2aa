"""Run a policy in a world and record what happens."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch

from kernels.layout import AuvColumn, BoatColumn, EstimateColumn, Level, NodeColumn, RewardTerm
from kernels.usbl import DETECTED
from usvauv_env.trace import Trace
from usvauv_env.world import World

SURFACE_PIXELS = 128


def record(
    world: World,
    act: Callable[[torch.Tensor], torch.Tensor],
    policy: str,
    *,
    steps: int | None = None,
    surface: bool = False,
    on_step: Callable[[int], None] = lambda done: None,
) -> Trace:
    """Reset the world, run it for `steps` mission steps (default: an episode) and return the trace.

    Args:
        act: observation (W, K, O) → action (W, K, 2).
        policy: its name, for the record.
        surface: also record the elevation of world 0's sea, at most `SURFACE_PIXELS` on a side.
        on_step: called with the number of steps done; an exception it raises ends the run.
    """
    steps = steps or world.steps
    auv, boat, node, terms = [], [], [], []
    estimates, vortices, surfaces = [], [], []
    kept = world.scenario.current.vortices
    observation = world.reset()
    stream = world.stream(Level.cruise)
    node_table = world.node.cpu().numpy().copy()
    for done in range(1, steps + 1):
        observation = world.step(act(observation))[0]
        auv.append(world.auv.cpu().numpy().copy())
        boat.append(world.boat.cpu().numpy().copy())
        node.append(world.node[..., NodeColumn.backlog].cpu().numpy().copy())
        terms.append(world.reward_terms.cpu().numpy().copy())
        estimates.append(world.estimate.cpu().numpy().copy())
        vortices.append(world.vortex[:, :kept].cpu().numpy().copy())
        if surface:
            surfaces.append(world.surface(SURFACE_PIXELS))
        on_step(done)
    vehicles, boats, known = np.stack(auv), np.stack(boat), np.stack(estimates)
    del auv, estimates

    def column(name: str) -> np.ndarray:
        return vehicles[..., getattr(AuvColumn, name)]

    flags = column("fix_flags").astype(np.uint8)
    heard = (flags & DETECTED)[..., None] > 0
    return Trace(
        scenario=world.scenario,
        policy=policy,
        usv=world.strategy.name,
        seed=world.seed,
        reward_names=RewardTerm.names,
        node_position=node_table[..., NodeColumn.x : NodeColumn.y + 1],
        node_rate=node_table[..., NodeColumn.rate],
        time=np.arange(1, steps + 1) * world.scenario.mission.step,
        auv_position=vehicles[..., AuvColumn.x : AuvColumn.y + 1],
        auv_velocity=vehicles[..., AuvColumn.water_x : AuvColumn.water_y + 1],
        fix=np.where(heard, vehicles[..., AuvColumn.fix_x : AuvColumn.fix_y + 1], np.float32(np.nan)),
        fix_covariance=vehicles[..., AuvColumn.covariance_xx : AuvColumn.covariance_yy + 1],
        fix_flags=flags,
        estimate=known[..., EstimateColumn.x : EstimateColumn.y + 1],
        estimate_covariance=known[..., EstimateColumn.covariance_xx : EstimateColumn.covariance_yy + 1],
        target=column("target").astype(np.int16),
        hovering=column("hovering").astype(np.int8),
        power=column("power"),
        service_rate=column("service_rate"),
        delivered=column("delivered"),
        border=column("border").astype(np.int8),
        reward_terms=np.stack(terms),
        boat_position=boats[..., BoatColumn.x : BoatColumn.y + 1],
        boat_goal=boats[..., BoatColumn.goal_x : BoatColumn.goal_y + 1],
        boat_surface=boats[..., BoatColumn.elevation : BoatColumn.slope_y + 1],
        backlog=np.stack(node),
        overflowing=boats[..., BoatColumn.overflowing].astype(np.int16),
        collisions=boats[..., BoatColumn.collisions].astype(np.int16),
        vortex=np.stack(vortices),
        stream=stream,
        surface=np.stack(surfaces) if surface else np.zeros((0, 0, 0), np.float32),
    )
