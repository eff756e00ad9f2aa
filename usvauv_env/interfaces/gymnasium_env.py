"""Gymnasium environments of the world: `DataCollectionVectorEnv` (many missions) and `DataCollectionEnv` (one).

Both control the team: K AUVs, O numbers in an AUV's observation, W worlds. NumPy in and out, new arrays in each call.

    observation  (K, O) float32   as `usvauv.env.world.world.World` tabulates it, clamped into `observation_space`
    action       (K, A) float32   in [−1, 1], as in `World`; values outside are clipped
    reward       sum of the AUVs' rewards
    terminated   always False: a mission never ends early
    truncated    the mission's time is over
    info         "auv_reward" (K,); "reward_terms" (K, R), columns `reward_names`; "measures" (K, 6), columns
                 `measure_names`; "horizon_ended" (K,) bool: a service ended this AUV's value horizon, which only
                 scenarios with reward.service_terminates do; the mission continues
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.envs.registration import EnvSpec
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from usvauv.env.record.recorder import SURFACE_PIXELS, Recorder, check_room
from usvauv.env.scenario.fields import ScenarioError
from usvauv.env.scenario.scenario import Scenario
from usvauv.env.world.agents import action_space, auv_observation_space
from usvauv.env.world.state import Numbers, numbers_of
from usvauv.env.world.world import NOT_BEGUN, World

MODES = ("rgb_array",)
SIZE = 1280, 720
FPS = 30


def _observe(world: World, space: gymnasium.Space[Any]) -> np.ndarray:
    """The team's observations (W, K, O) inside the box `space` (K, O), as a new array."""
    assert isinstance(space, Box)
    return np.clip(world.observation.numpy(force=True), space.low, space.high)


def _need_reset(world: World) -> None:
    if not world.begun:
        raise gymnasium.error.ResetNeeded(NOT_BEGUN)


def _team_reward(info: dict[str, np.ndarray]) -> np.ndarray:
    """Sum of the AUVs' rewards, (W,) float64."""
    return info["auv_reward"].sum(axis=-1, dtype=np.float64)


def _masked(info: dict[str, np.ndarray], mask: np.ndarray) -> dict[str, np.ndarray]:
    """Gymnasium's vector info for the worlds in `mask`: zeros elsewhere, and a mask for each key; no world, no key."""
    if not mask.any():
        return {}
    out = {}
    for name, value in info.items():
        out[name] = value.copy()
        out[name][~mask] = 0
        out[f"_{name}"] = mask.copy()
    return out


class Camera:
    """Pictures for `render`: records the states of each world's episode, and draws the last one."""

    def __init__(self, world: World) -> None:
        check_room(world.scenario, world.num_worlds, world.steps)
        self._recorder = Recorder(world)
        self._first = np.zeros(world.num_worlds, int)

    def begin(self, mask: np.ndarray) -> None:
        """The episodes of the worlds in `mask` (W,) have just begun."""
        if mask.all():
            self._recorder.clear()
        else:  # their new states stand beside the others' last ones
            self._recorder.drop_last()
        self._first[mask] = len(self._recorder)
        self._recorder.add()

    def add(self) -> None:
        """A step was made."""
        self._recorder.add()

    def picture(self, world: int) -> np.ndarray:
        """A world as it is now, (720, 1280, 3) uint8, RGB."""
        from usvauv.env.render.frames import frames_of  # imports matplotlib, which most runs do not need

        now = self._recorder.world.surface(SURFACE_PIXELS, world)
        first = int(self._first[world])
        states = len(self._recorder) - first
        surface = np.broadcast_to(now, (states, *now.shape))
        trace = self._recorder.trace("agent", surface, first=first, worlds=slice(world, world + 1))
        frames = frames_of([trace], SIZE, speed_up=FPS * trace.scenario.mission.step)
        return frames.frame(states - 1)[..., ::-1].copy()


class _PlainSpec:
    """An environment that keeps what `gymnasium.make` was called with as values that JSON has, for its `spec`."""

    _spec: EnvSpec | None = None

    @property
    def spec(self) -> EnvSpec | None:
        """How to make this environment again; None without `gymnasium.make`."""
        return self._spec

    @spec.setter
    def spec(self, made: EnvSpec | None) -> None:
        self._spec = made and replace(made, kwargs={name: _plain(value) for name, value in made.kwargs.items()})


def _plain(argument: Any) -> Any:
    if isinstance(argument, Scenario | Path):
        return Scenario.of(argument).to_dict()
    return argument.value if isinstance(argument, AutoresetMode) else argument


class DataCollectionEnv(_PlainSpec, gymnasium.Env[np.ndarray, np.ndarray]):
    """One mission, the team controlled as one agent: `gymnasium.make("usvauv/DataCollection-v0")`.

    Spaces and info are those in the module's table. `reset(seed=s)` begins the first episode of
    `World(scenario, 1, s)`, `reset()` the next one. With render_mode "rgb_array" `render()` returns a picture of
    the mission so far, (720, 1280, 3) uint8.

    Args:
        scenario: a `Scenario`, what its `to_dict` returned, a shipped name or a path.
        usv: the boat's strategy, see `World`.
        render_mode: None or "rgb_array".

    Raises:
        ScenarioError: the scenario or the strategy cannot be used.
        TypeError: another render mode.
    """

    metadata = {"render_modes": list(MODES), "render_fps": FPS}  # noqa: RUF012 - Gymnasium defines it as a class attribute
    measure_names = World.measure_names

    def __init__(
        self,
        scenario: Scenario | Mapping[str, Any] | str | Path = "extreme",
        usv: str | None = None,
        render_mode: str | None = None,
    ) -> None:
        self._missions = missions = DataCollectionVectorEnv(1, scenario, usv, AutoresetMode.DISABLED, render_mode)
        self.render_mode = render_mode
        self.observation_space, self.action_space = missions.single_observation_space, missions.single_action_space

    @property
    def world(self) -> World:
        """The world; each reset with a seed makes a new one."""
        return self._missions.world

    @property
    def reward_names(self) -> tuple[str, ...]:
        """Columns of "reward_terms"."""
        return self.world.reward_names

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin the next episode, or with `seed` the first of that seed; no `options` are known."""
        super().reset(seed=seed)
        observation, _ = self._missions.reset(seed=seed)
        return observation[0], {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Advance by one mission step.

        Raises:
            ResetNeeded: before the first reset.
            ValueError: `action` is not (K, A) or not finite.
        """
        return self.step_with_boats(action, None)

    def step_with_boats(
        self, action: Numbers, boat_action: Numbers | None
    ) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """A step with actions (B, 2) of the boats where they are agents, see `step`."""
        _need_reset(self.world)
        boats = None if boat_action is None else numbers_of("boat_action", boat_action, (self.world.boat.shape[1], 2))
        own_action = numbers_of("action", action, (self.world.num_auvs, self.world.action_size))
        truncated, info = self._missions.advance(own_action[None], None if boats is None else boats[None])
        observation = _observe(self.world, self.observation_space)[0]
        own = {name: value[0].copy() for name, value in info.items()}
        return observation, float(_team_reward(info)[0]), False, bool(truncated[0]), own

    def render(self) -> np.ndarray | None:
        """The mission as it is now, (720, 1280, 3) uint8, RGB; None without a render mode.

        Raises:
            ResetNeeded: before the first reset.
        """
        pictures = self._missions.render()
        return pictures[0] if pictures else None


class DataCollectionVectorEnv(_PlainSpec, VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """Many missions side by side: `gymnasium.make_vec("usvauv/DataCollection-v0", num_envs=512)`.

    Sub-environment w is world w of one `World`; shapes in the module's table have a leading axis W. Info follows
    Gymnasium's vector form: each key has a mask (W,), and worlds that were reset have no info of a step, except
    "auv_reward", which is present in every step and sums to the reward.

    When an episode ends, by `autoreset_mode`:

        NEXT_STEP   the next step begins the new episode: its action is ignored, its reward is 0
        SAME_STEP   the same step returns the new episode's observation; the last one and its info are in
                    info["final_obs"] (W,) of arrays or None, info["final_info"]
        DISABLED    the caller resets, `reset(options={"reset_mask": mask})` only the worlds in the bool mask (W,)

    `reset(seed=s)` begins the first episodes of `World(scenario, W, s)`, `reset()` the next ones. Seas start anew when
    all worlds are reset together. With `reset(seed=[s_0, …])`, W seeds, sub-environment w has the episodes that
    `DataCollectionEnv` has after `reset(seed=s_w)`, bit for bit; a sea is solved for each different seed. With
    render_mode "rgb_array" `render()` returns a picture of every world.

    Args:
        num_envs: number of missions W.
        scenario: a `Scenario`, what its `to_dict` returned, a shipped name or a path.
        usv: the boat's strategy, see `World`.
        autoreset_mode: one of `gymnasium.vector.AutoresetMode` or its value.
        render_mode: None or "rgb_array".

    Raises:
        ScenarioError: the scenario, the strategy or `num_envs` cannot be used.
        ValueError: unknown autoreset mode.
        TypeError: another render mode.
    """

    metadata = {"render_modes": list(MODES), "render_fps": FPS, "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012
    measure_names = World.measure_names

    def __init__(
        self,
        num_envs: int = 1,
        scenario: Scenario | Mapping[str, Any] | str | Path = "extreme",
        usv: str | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
    ) -> None:
        if render_mode is not None and render_mode not in MODES:  # the error that Stable-Baselines3 expects
            raise TypeError(f"render_mode = {render_mode!r}: must be None or one of {', '.join(MODES)}")
        self.render_mode = render_mode
        self._usv = usv
        self.num_envs = num_envs
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode}
        self.world = World(Scenario.of(scenario), num_envs, int(self.np_random.integers(1 << 63)), usv)
        num_auvs = self.world.num_auvs
        self.single_observation_space = batch_space(auv_observation_space(self.world.site), num_auvs)
        self.single_action_space = batch_space(action_space(self.world.action_size), num_auvs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._over = np.zeros(num_envs, np.bool_)  # episodes that ended and have not been reset

    @property
    def reward_names(self) -> tuple[str, ...]:
        """Columns of "reward_terms"."""
        return self.world.reward_names

    def reset(
        self, *, seed: int | Sequence[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin the next episodes of all worlds, or with options["reset_mask"] (W,) bool of some.

        Args:
            seed: begin the first episodes of this seed, or of one for each world, instead; for all worlds only.
            options: "reset_mask" is read, anything else ignored.

        Returns:
            Observation (W, K, O), the present one for worlds that are not reset; an empty info.

        Raises:
            ScenarioError: a seed is not a whole number from 0 to 2⁶⁴ − 1 (None among several is refused too), or their
                number is neither 1 nor W.
            TypeError, ValueError: the mask is not a bool array (W,) with a world chosen, or is given with a seed.
            ResetNeeded: the first reset does not include all worlds.
        """
        mask = (options or {}).get("reset_mask")
        if mask is None:
            mask = np.ones(self.num_envs, np.bool_)
        else:
            self._check_mask(mask, seed)
        if seed is not None:
            self.world = World(self.world.scenario, self.num_envs, seed, self._usv)
            super().reset(seed=int(self.world.seeds.seed[0]))
        if self.render_mode and (seed is not None or not self.world.begun):
            self._camera = Camera(self.world)
        self._begin(mask)
        return self._observation(), {}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Advance all worlds by one mission step, (W, K, A) actions; `autoreset_mode` applies where an episode ends.

        Raises:
            ResetNeeded: before the first reset, or with DISABLED if an ended episode was not reset.
            ValueError: `actions` is not (W, K, A) or not finite.
        """
        _need_reset(self.world)
        over = self._over
        if self.autoreset_mode is AutoresetMode.DISABLED and over.any():
            raise gymnasium.error.ResetNeeded(
                f"episodes of worlds {np.flatnonzero(over).tolist()} are over: reset them"
            )
        if over.all():  # only with NEXT_STEP; stepping worlds that begin anew would be wasted
            self._begin(over)
            nothing = np.zeros((self.num_envs, self.world.num_auvs), np.float32)
            info = self._rewards(nothing)
            return self._observation(), np.zeros(self.num_envs), np.zeros_like(over), np.zeros_like(over), info

        truncated, details = self.advance(actions)
        stepped = ~over
        if over.any():
            self._begin(over)
        truncated &= stepped
        reward = np.where(stepped, _team_reward(details), 0.0)
        rewards = self._rewards(np.where(stepped[:, None], details["auv_reward"], np.float32(0)))
        observation = self._observation()
        if self.autoreset_mode is AutoresetMode.SAME_STEP and truncated.any():
            info = _masked(details, ~truncated) | self._final(observation, details, truncated)
            self._begin(truncated)
            observation = self._observation()
        else:
            info = _masked(details, stepped)
            self._over = truncated.copy()
        return observation, reward, np.zeros(self.num_envs, np.bool_), truncated, info | rewards

    def advance(self, action: Numbers, boat_action: Numbers | None = None) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Step all worlds, also ended ones, with (W, K, A) actions and, with the strategy "agent", (W, B, 2) of the
        boats; returns truncated (W,) and the info of every world.

        On the CPU the info is the world's own memory, which the next step overwrites: return copies to users.
        """
        world = self.world
        given = numbers_of("action", action, (world.num_worlds, world.num_auvs, world.action_size))
        if not given.isfinite().all():
            raise ScenarioError("action: all numbers must be finite")
        boats = None
        if boat_action is not None:
            boats = numbers_of("boat_action", boat_action, (world.num_worlds, world.boat.shape[1], 2)).clamp(-1.0, 1.0)
        _, reward, horizon_ended, truncated, info = world.step(given.clamp(-1.0, 1.0), boats)
        if self.render_mode:
            self._camera.add()
        tensors = {"auv_reward": reward, **info, "horizon_ended": horizon_ended}
        return truncated[:, 0].clone().numpy(force=True), {
            name: tensor.numpy(force=True) for name, tensor in tensors.items()
        }

    def render(self) -> tuple[np.ndarray, ...] | None:
        """Every mission as it is now, W pictures (720, 1280, 3) uint8, RGB; None without a render mode.

        Raises:
            ResetNeeded: before the first reset.
        """
        if not self.render_mode:
            return None
        _need_reset(self.world)
        return tuple(self._camera.picture(world) for world in range(self.num_envs))

    def _begin(self, mask: np.ndarray) -> None:
        self.world.reset(None if mask.all() else torch.from_numpy(mask))
        self._over = self._over & ~mask
        if self.render_mode:
            self._camera.begin(mask)

    def _observation(self) -> np.ndarray:
        return _observe(self.world, self.single_observation_space)

    def _rewards(self, auv_reward: np.ndarray) -> dict[str, np.ndarray]:
        """The info of all worlds that every step has."""
        return {"auv_reward": auv_reward, "_auv_reward": np.ones(self.num_envs, np.bool_)}

    def _final(self, observation: np.ndarray, details: dict[str, np.ndarray], over: np.ndarray) -> dict[str, Any]:
        """Gymnasium's info for episodes that were reset in the step that ended them."""
        final = np.full(self.num_envs, None, dtype=object)
        for world in np.flatnonzero(over):
            final[world] = observation[world].copy()
        return {
            "final_obs": final,
            "_final_obs": over.copy(),
            "final_info": _masked(details, over),
            "_final_info": over.copy(),
        }

    def _check_mask(self, mask: np.ndarray, seed: int | Sequence[int] | None) -> None:
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_:
            raise TypeError("options['reset_mask'] must be a numpy array of dtype bool")
        if mask.shape != (self.num_envs,):
            raise ValueError(f"options['reset_mask'] has shape {mask.shape}: must be ({self.num_envs},)")
        if not mask.any():
            raise ValueError("options['reset_mask'] must choose at least one world")
        if seed is not None:
            raise ValueError("a seed is for all worlds: give no options['reset_mask'] with it")
        if not self.world.begun:
            raise gymnasium.error.ResetNeeded("the first reset must be of all worlds")
