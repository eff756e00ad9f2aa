"""TorchRL environment of the world: `DataCollectionTorchRLEnv`, a batch of missions, each AUV an agent.

W worlds, K AUVs, O numbers in an AUV's observation; entries of AUVs are in the group "agents", the end of an episode is
at the root. Tensors are new in each step and stay on the world's device.

    ("agents", "action")                 (W, K, A)  float32  in [−1, 1], as in `World`; values outside are clipped
    ("agents", "observation")            (W, K, O)  float32  as `World` tabulates it, clamped into the spec's bounds
    ("agents", "reward")                 (W, K, 1)  float32  the AUV's own
    ("agents", "info", "reward_terms")   (W, K, R)  float32  columns `reward_names`
    ("agents", "info", "measures")       (W, K, 6)  float32  columns `measure_names`
    ("agents", "info", "horizon_ended")  (W, K, 1)  bool     a service ended this AUV's value horizon, which only
                                                             scenarios with reward.service_terminates do
    "terminated"                         (W, 1)     bool     always False: a mission never ends early
    "truncated", "done"                  (W, 1)     bool     the mission's time is over

With the strategy "agent" the B boats are a separate group, "boats", see `usvauv.env.world.agents`:

    ("boats", "action")                  (W, B, 2)  float32  in [−1, 1]
    ("boats", "observation")             (W, B, .)  float32  clamped into the spec's bounds
    ("boats", "reward")                  (W, B, 1)  float32  mean of the AUVs'

The info of a reset is zero. This module needs the extra `torchrl`; nothing else in the package imports it.
"""

from __future__ import annotations

import secrets
from collections.abc import Sequence
from pathlib import Path

import torch

from usvauv.env.scenario.fields import ScenarioError
from usvauv.env.scenario.scenario import Scenario
from usvauv.env.world.agents import action_space, auv_observation_space, boat_observation_space, observe_boats
from usvauv.env.world.state import numbers_of
from usvauv.env.world.world import World
from usvauv.kernels.mission.boats.boat_strategies import AGENT

try:
    from tensordict import TensorDict, TensorDictBase
    from torchrl.data import Bounded, Categorical, Composite, Unbounded
    from torchrl.envs import EnvBase
except ModuleNotFoundError as missing:
    if (missing.name or "").partition(".")[0] not in ("tensordict", "torchrl"):
        raise
    raise ModuleNotFoundError(
        'the TorchRL face needs the extra torchrl: pip install "usvauv[torchrl]"', name="torchrl"
    ) from None


class DataCollectionTorchRLEnv(EnvBase):
    """Many missions as a TorchRL environment of batch size (W,), the AUVs grouped as multi-agent modules expect.

    The keys are those in the module's table. `set_seed(s)` makes the next reset begin the first episodes of
    `World(scenario, W, s)`; further resets begin the next ones, with "_reset" (W, 1) only of the worlds set there. Seas
    start anew when all worlds are reset together. A world whose time is over stays done until it is reset.

    Args:
        scenario: a `Scenario`, a shipped name or a path.
        num_worlds: number of missions W.
        seed: as for `World`; by default random.
        usv: the boat's strategy, see `World`.
        arch: where to run, see `usvauv.kernels.runtime.start`.

    Raises:
        ScenarioError: an argument out of range, or an unknown strategy.
        RuntimeUnavailable: `arch` cannot be used here.
    """

    measure_names = World.measure_names

    def __init__(
        self,
        scenario: Scenario | str | Path = "extreme",
        num_worlds: int = 1,
        seed: int | Sequence[int] | None = None,
        usv: str | None = None,
        arch: str = "auto",
    ) -> None:
        first = secrets.randbits(63) if seed is None else seed
        self.world = World(Scenario.of(scenario), num_worlds, first, usv, arch=arch)
        super().__init__(device=self.world.device, batch_size=(num_worlds,))
        self._usv, self._arch = usv, arch
        self.group_map = {"agents": [f"auv_{k}" for k in range(self.world.num_auvs)]}
        self._boats = self.world.strategy.name == AGENT
        if self._boats:
            self.group_map["boats"] = [f"usv_{b}" for b in range(self.world.scenario.boat.count)]
        self._over = torch.zeros(num_worlds, 1, dtype=torch.bool, device=self.device)
        self._make_specs()

    @property
    def reward_names(self) -> tuple[str, ...]:
        """Columns of "reward_terms"."""
        return self.world.reward_names

    def _make_specs(self) -> None:
        world, root = self.world, {"shape": self.batch_size, "device": self.device}
        groups = {"agents": (world.num_auvs, auv_observation_space(world.site), action_space(world.action_size))}
        if self._boats:
            groups["boats"] = world.scenario.boat.count, boat_observation_space(world.site), action_space()
        specs = [Composite(**root) for _ in range(3)]
        self._bounds: dict[str, tuple[torch.Tensor, torch.Tensor]] = {}  # of the groups' observations
        for group, (count, seen, moves) in groups.items():
            team = torch.Size((*self.batch_size, count))
            low, high, least, most = (
                torch.from_numpy(bound).to(self.device).expand(*team, -1)
                for bound in (seen.low, seen.high, moves.low, moves.high)
            )
            self._bounds[group] = low, high
            entries = {
                "observation": Bounded(low, high, device=self.device),
                "action": Bounded(least, most, device=self.device),
                "reward": Unbounded(torch.Size((*team, 1)), device=self.device),
            }
            for spec, (name, entry) in zip(specs, entries.items(), strict=True):
                spec[group] = Composite({name: entry}, shape=team, device=self.device)

        def flag(*shape: int) -> Categorical:
            return Categorical(2, shape=torch.Size((*shape, 1)), dtype=torch.bool, device=self.device)

        team = (world.num_worlds, world.num_auvs)
        counts = {"reward_terms": len(world.reward_names), "measures": len(self.measure_names)}
        entries = {name: Unbounded(torch.Size((*team, count)), device=self.device) for name, count in counts.items()}
        info = Composite({**entries, "horizon_ended": flag(*team)}, shape=team, device=self.device)
        specs[0]["agents", "info"] = info
        self._no_info = info.zero()
        self.full_observation_spec, self.full_action_spec, self.full_reward_spec = specs
        ends = {name: flag(world.num_worlds) for name in ("done", "terminated", "truncated")}
        self.full_done_spec = Composite(ends, **root)

    def _reset(self, tensordict: TensorDictBase | None = None) -> TensorDictBase:
        mask = None if tensordict is None else tensordict.get("_reset", None)
        if mask is None or mask.all():
            self.world.reset()
            self._over = torch.zeros_like(self._over)
        elif not self.world.begun:
            raise RuntimeError("the first reset must be of all worlds")
        else:
            self.world.reset(mask.squeeze(-1))
            self._over = self._over & ~mask
        return self._tensordict(self._no_info.clone())

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        if not self.world.begun:
            raise RuntimeError("call reset before the first step")
        stepped = tensordict.get("_step", None)  # TorchRL's mask of the worlds that should move
        if stepped is not None and not (stepped | self._over).all():
            raise NotImplementedError("worlds step together: '_step' can leave out only those whose time is over")
        moves = {}
        for group in self.group_map:
            shape = self.full_action_spec[group, "action"].shape
            action = numbers_of(f"action of {group}", tensordict.get((group, "action")), shape)
            if not torch.isfinite(action).all():
                raise ScenarioError(f"action of {group}: all numbers must be finite")
            moves[group] = action.clamp(-1.0, 1.0)
        _, reward, horizon_ended, truncated, details = self.world.step(moves["agents"], moves.get("boats"))
        self._over = truncated[:, :1].clone()
        info = self._no_info.empty()
        for name, tensor in details.items():
            info.set(name, tensor.clone())
        info.set("horizon_ended", horizon_ended.unsqueeze(-1).clone())
        following = self._tensordict(info)
        following.set(("agents", "reward"), reward.unsqueeze(-1).clone())
        if self._boats:
            following.set(("boats", "reward"), reward.mean(1)[:, None, None].repeat(1, self.world.boat.shape[1], 1))
        return following

    def _tensordict(self, info: TensorDictBase) -> TensorDict:
        """The AUVs' present observations and ended worlds, in new tensors, since the world reuses its own."""
        world = self.world
        observation = torch.clamp(world.observation, *self._bounds["agents"])
        team = {"observation": observation, "info": info}
        agents = TensorDict(team, batch_size=(world.num_worlds, world.num_auvs), device=self.device)
        ends = {"done": self._over.clone(), "truncated": self._over.clone(), "terminated": torch.zeros_like(self._over)}
        groups = {"agents": agents}
        if self._boats:
            observed = torch.clamp(observe_boats(world), *self._bounds["boats"])
            groups["boats"] = TensorDict({"observation": observed}, observed.shape[:2], device=self.device)
        return TensorDict({**groups, **ends}, batch_size=self.batch_size, device=self.device)

    def _set_seed(self, seed: int | None) -> None:
        world = self.world
        first = secrets.randbits(63) if seed is None else seed
        self.world = World(world.scenario, world.num_worlds, first, self._usv, arch=self._arch)
