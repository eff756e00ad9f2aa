"""The TorchRL environment as a task of BenchMARL: `DataCollectionTask`, for its experiments, algorithms and models.

Groups, keys and seeds are those of `usvauv.env.interfaces.torchrl_env`. This module needs the extra `benchmarl`, which
needs TorchRL below 0.12; nothing else in the package imports it.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import cast

import torch

from usvauv.env.scenario.scenario import Scenario

try:
    from benchmarl.environments.common import TaskClass  # pyright: ignore[reportMissingImports]
except ModuleNotFoundError as missing:
    if (missing.name or "").partition(".")[0] != "benchmarl":
        raise
    raise ModuleNotFoundError(
        'the BenchMARL task needs the extra benchmarl: pip install "usvauv[benchmarl]"', name="benchmarl"
    ) from None

from torchrl.data import Composite
from torchrl.envs import EnvBase

from usvauv.env.interfaces.torchrl_env import DataCollectionTorchRLEnv


class DataCollectionTask(TaskClass):
    """A scenario as the `task` of a BenchMARL experiment, which sets the number of missions stepped together.

    Args:
        scenario: a `Scenario`, a shipped name or a path.
        usv: the boat's strategy, see `World`; with "agent" the boats are a separate group.

    Raises:
        ScenarioError: the scenario is invalid.
    """

    def __init__(self, scenario: Scenario | str | Path = "extreme", usv: str | None = None) -> None:
        self.scenario = Scenario.of(scenario)
        super().__init__("DATA_COLLECTION", {"scenario": self.scenario.to_toml(), "usv": usv})

    def get_env_fun(
        self, num_envs: int, continuous_actions: bool, seed: int | None, device: torch.device | str | int
    ) -> Callable[[], EnvBase]:
        """A function that makes the environment, on the sampling device."""
        arch, usv = torch.device(device).type, self.config["usv"]
        return lambda: DataCollectionTorchRLEnv(self.scenario, num_envs, seed, usv, arch)

    def supports_continuous_actions(self) -> bool:
        return True

    def supports_discrete_actions(self) -> bool:
        return False

    def has_render(self, env: EnvBase) -> bool:
        return False

    def max_steps(self, env: EnvBase) -> int:
        return self.scenario.mission.steps

    def group_map(self, env: EnvBase) -> dict[str, list[str]]:
        return cast("dict[str, list[str]]", env.group_map)

    def observation_spec(self, env: EnvBase) -> Composite:
        return self._observed(env, "observation")

    def info_spec(self, env: EnvBase) -> Composite:
        return self._observed(env, "info")

    def action_spec(self, env: EnvBase) -> Composite:
        return env.full_action_spec_unbatched

    def state_spec(self, env: EnvBase) -> None:
        return None

    def action_mask_spec(self, env: EnvBase) -> None:
        return None

    @staticmethod
    def env_name() -> str:
        return "usvauv"

    def _observed(self, env: EnvBase, kept: str) -> Composite:
        """The specs of one mission's observations, with only the entry `kept` of each group that has it."""
        spec = env.full_observation_spec_unbatched.clone()
        for group in self.group_map(env):
            for name in set(spec[group].keys()) - {kept}:
                del spec[group, name]
            if not len(list(spec[group].keys())):
                del spec[group]
        return spec
