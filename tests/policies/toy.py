"""A small world with the interface of `usvauv.env.World`, in plain torch: points that visit targets in a square."""

from __future__ import annotations

import torch
from torch import Tensor

from usvauv import policies
from usvauv.env.scenario import Scenario
from usvauv.env.sea.water import Seeds
from usvauv.env.world.observation_layout import ObservationLayout
from usvauv.policies import TrainingConfig

# Small networks on one core: a second thread only waits for the first.
torch.set_num_threads(1)

LEARNING = TrainingConfig(
    num_worlds=32,
    frame="target",
    hidden=(64, 64),
    batch=256,
    warmup=1600,
    gamma=0.95,
    n_step=3,
    tau=0.05,
    reward_scale=0.2,
    replay=100_000,
)


def seeded(seed=0):
    return torch.Generator().manual_seed(seed)


def scenario(**changes) -> Scenario:
    """100 m square, 50 steps; `changes` are sections, such as auv={"count": 3}."""
    sections = {
        "name": "toy",
        "area": {"width": 100.0, "length": 100.0},
        "mission": {"duration": 50.0},
        "observation": {"current": "vector"},
    }
    for name, values in changes.items():
        sections[name] = sections.get(name, {}) | values
    return Scenario.from_dict(sections)


class ToyWorld:
    """W worlds of K AUVs in a uniform current. A target within 6 m is served and drawn anew.

    Reward: 0.1 for each metre closed on the target, 1 for a service, −0.02 times (speed / top speed)²: the best speed
    is the highest.
    """

    reward_names: tuple[str, ...] = ("progress", "service", "effort")
    measure_names: tuple[str, ...] = ("power", "hovering", "service_rate", "delivered", "border", "position_error")

    def __init__(self, toy: Scenario, num_worlds: int, seed: int = 0, terminates: bool = False):
        self.scenario, self.num_worlds, self.num_auvs = toy, num_worlds, toy.auv.count
        self.layout = ObservationLayout.of(toy)
        self.observation_size = self.layout.size
        self.action_size = toy.auv.action_size
        self.steps = toy.mission.steps
        self.device, self.seeds = torch.device("cpu"), Seeds.of(seed, num_worlds)
        self.terminates = terminates
        self.generator = torch.Generator().manual_seed(seed)
        self.drift = torch.tensor([0.3, -0.2])

    def _draw(self) -> Tensor:
        shape = (self.num_worlds, self.num_auvs, 2)
        return 10.0 + 80.0 * torch.rand(shape, generator=self.generator)

    def reset(self) -> Tensor:
        self.position, self.target = self._draw(), self._draw()
        self.clock = torch.zeros((), dtype=torch.int64)
        return self._observe()

    def current(self) -> Tensor:
        return self.drift.expand(self.num_worlds, self.num_auvs, 2)

    def water_velocity(self) -> Tensor:
        return torch.tensor([0.9, 0.4]).expand(self.num_worlds, self.num_auvs, 2)

    def _observe(self) -> Tensor:
        auvs, diagonal = range(self.num_auvs), self.scenario.area.diagonal
        others = [self.position[:, [j for j in auvs if j != k]] - self.position[:, k : k + 1] for k in auvs]
        flag = torch.zeros((self.num_worlds, self.num_auvs, 1))
        terms = {
            "others": torch.stack(others, 1).flatten(2) / diagonal,
            "target": (self.target - self.position) / diagonal,
            "position": self.position / diagonal,
            "border": flag,
            "overflow": flag,
            "current_speed": flag + self.drift.norm(),
            "current": flag + self.drift,
        }
        return torch.cat([terms[name] for name in self.layout.terms], -1)

    def velocity(self, action: Tensor) -> Tensor:
        """Velocity through the water, (W, K, 2), m/s."""
        auv = self.scenario.auv
        velocity = auv.speed_max * action
        speed = velocity.norm(dim=-1, keepdim=True).clamp_min(1e-6)
        return velocity * (speed.clamp(auv.speed_min, auv.speed_max) / speed)

    def step(self, action: Tensor):
        assert action.shape == (self.num_worlds, self.num_auvs, 2)
        if not action.isfinite().all():
            raise ValueError("action")
        assert action.abs().max() <= 1.0
        velocity = self.velocity(action)
        before = (self.target - self.position).norm(dim=-1)
        self.position = (self.position + velocity + self.drift).clamp(0.0, 100.0)
        after = (self.target - self.position).norm(dim=-1)
        served = after < 6.0
        effort = (velocity.norm(dim=-1) / self.scenario.auv.speed_max).square()
        terms = torch.stack((0.1 * (before - after), 1.0 * served, -0.02 * effort), -1)
        self.target = torch.where(served.unsqueeze(-1), self._draw(), self.target)
        self.clock = self.clock + 1
        zero = torch.zeros_like(after)
        measures = torch.stack((effort, zero, 1.0 * served, zero, zero, zero), -1)
        horizon_ended = served if self.terminates else torch.zeros_like(served)
        truncated = torch.full_like(served, bool(self.clock >= self.steps))
        return self._observe(), terms.sum(-1), horizon_ended, truncated, {"reward_terms": terms, "measures": measures}

    def state(self) -> dict[str, Tensor]:
        return {
            "position": self.position,
            "target": self.target,
            "clock": self.clock,
            "generator": self.generator.get_state(),
        }

    def load_state(self, state: dict[str, Tensor]) -> None:
        self.position, self.target, self.clock = state["position"], state["target"], state["clock"]
        self.generator.set_state(state["generator"])


def observe(toy: Scenario, worlds: int = 64, seed: int = 0) -> tuple[Tensor, ToyWorld]:
    """Observations of a world that has just begun, and the world."""
    world = ToyWorld(toy, worlds, seed)
    return world.reset(), world


def mean_reward(world: ToyWorld, policy: policies.LearnedPolicy | str) -> float:
    """Reward of an episode of a learned policy or one by name, mean over worlds and AUVs."""
    policy = policies.load(policy, world) if isinstance(policy, str) else policy
    observation, total = world.reset(), 0.0
    for _ in range(world.steps):
        observation, reward, *_ = world.step(policy.act(observation))
        total += float(reward.mean())
    return total
