"""Run a policy in a world and record what happens."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch

from kernels.mission.columns import AuvColumn, BoatColumn, EstimateColumn, NodeColumn
from kernels.positioning.usbl import DETECTED
from kernels.types import Level
from usvauv_env.record.trace import Trace
from usvauv_env.world.world import World

SURFACE_PIXELS = 128


class Recorder:
    """Copies the states of a world one by one and makes a trace of them."""

    def __init__(self, world: World) -> None:
        self.world = world
        self._rows: dict[str, list[np.ndarray]] = {}
        self.clear()

    def __len__(self) -> int:
        return len(self._rows["auv"])

    def clear(self) -> None:
        """Remove all states."""
        self._rows = {name: [] for name in ("auv", "boat", "backlog", "terms", "estimate", "vortex")}

    def drop_last(self) -> None:
        """Remove the last state."""
        for rows in self._rows.values():
            rows.pop()

    def add(self) -> None:
        """Append the present state of the world."""
        world, num_vortices = self.world, self.world.scenario.current.vortices
        for name, tensor in (
            ("auv", world.auv),
            ("boat", world.boat),
            ("backlog", world.node[..., NodeColumn.backlog]),
            ("terms", world.reward_terms),
            ("estimate", world.estimate),
            ("vortex", world.vortex[:, :num_vortices]),
        ):
            self._rows[name].append(tensor.cpu().numpy().copy())

    def trace(
        self,
        policy: str,
        surface: np.ndarray,
        *,
        first: int = 0,
        start: float = 0.0,
        worlds: slice = slice(None),
    ) -> Trace:
        """The trace from state number `first` on; nodes are where they are now.

        Args:
            policy: name of the policy.
            surface: as in `Trace`.
            first: number of the first state.
            start: time of that state, s.
            worlds: the worlds to take.
        """
        world = self.world
        vehicles, boats, backlog, terms, known, vortex = (
            np.stack([row[worlds] for row in rows[first:]]) for rows in self._rows.values()
        )
        nodes = world.node[worlds].cpu().numpy()

        def column(name: str) -> np.ndarray:
            return vehicles[..., getattr(AuvColumn, name)]

        flags = column("fix_flags").astype(np.uint8)
        heard = (flags & DETECTED)[..., None] > 0
        return Trace(
            scenario=world.scenario,
            policy=policy,
            usv=world.strategy.name,
            seed=world.seed,
            reward_names=world.reward_names,
            node_position=nodes[..., NodeColumn.span("x", "y")].copy(),
            node_rate=nodes[..., NodeColumn.rate].copy(),
            time=start + np.arange(len(vehicles)) * world.scenario.mission.step,
            auv_position=vehicles[..., AuvColumn.span("x", "y")],
            auv_velocity=vehicles[..., AuvColumn.span("water_x", "water_y")],
            fix=np.where(heard, vehicles[..., AuvColumn.span("fix_x", "fix_y")], np.float32(np.nan)),
            fix_covariance=vehicles[..., AuvColumn.span("covariance_xx", "covariance_yy")],
            fix_flags=flags,
            estimate=known[..., EstimateColumn.span("x", "y")],
            estimate_covariance=known[..., EstimateColumn.span("covariance_xx", "covariance_yy")],
            target=column("target").astype(np.int16),
            hovering=column("hovering").astype(np.int8),
            power=column("power"),
            service_rate=column("service_rate"),
            delivered=column("delivered"),
            border=column("border").astype(np.int8),
            reward_terms=terms,
            boat_position=boats[..., BoatColumn.span("x", "y")],
            boat_goal=boats[..., BoatColumn.span("goal_x", "goal_y")],
            boat_surface=boats[..., BoatColumn.span("elevation", "slope_y")],
            backlog=backlog,
            overflowing=boats[..., BoatColumn.overflowing].astype(np.int16),
            collisions=boats[..., BoatColumn.collisions].astype(np.int16),
            packets_created=boats[..., BoatColumn.packets_created].astype(np.int32),
            packets_lost=boats[..., BoatColumn.packets_lost].astype(np.int32),
            packets_delivered=column("packets_delivered").astype(np.int32),
            vortex=vortex,
            stream=world.stream(Level.cruise),
            surface=surface,
        )


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
        policy: name of the policy.
        surface: also record the elevation of world 0's sea, at most `SURFACE_PIXELS` on a side.
        on_step: called with the number of steps done; an exception it raises ends the run.
    """
    steps = steps or world.steps
    recorder, surfaces = Recorder(world), []
    observation = world.reset()
    for done in range(1, steps + 1):
        observation = world.step(act(observation))[0]
        recorder.add()
        if surface:
            surfaces.append(world.surface(SURFACE_PIXELS))
        on_step(done)
    elevation = np.stack(surfaces) if surface else np.zeros((0, 0, 0), np.float32)
    return recorder.trace(policy, elevation, start=world.scenario.mission.step)
