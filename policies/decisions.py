"""The choice of an AUV's next node, learned by proximal policy optimisation: the target rule `learned`.

Schulman et al., 2017, arXiv 1707.06347, with generalised advantages (Schulman et al., 2016, arXiv 1506.02438). A
decision lasts until the next one in its world, so the process is semi-Markov (Bradtke and Duff, 1994, NeurIPS 7): data
Δt later are weighted by exp(−Δt/T). The data of the service that a decision leads to are its reward; if they counted
when delivered, they would follow unrelated decisions of other AUVs.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from usvauv.env import Scenario
from usvauv.env.storage.files import atomic_write
from usvauv.env.world.world import World
from usvauv.kernels.interruption import Stop, stoppable
from usvauv.kernels.mission.columns import AuvColumn
from usvauv.kernels.mission.target_rules import learned
from usvauv.kernels.mission.target_rules.learned import (
    FEATURES,
    GAIN,
    HEAD,
    HIDDEN,
    HORIZON,
    UNTRAINED,
    Decision,
    Feature,
)
from usvauv.policies import checkpoint
from usvauv.policies.algorithms.learner import Adam
from usvauv.policies.checkpoint import FORMAT, TRAINING
from usvauv.policies.loading import acting, check
from usvauv.policies.policy import PolicyError
from usvauv.policies.training.figures import EVALUATION_SEED_OFFSET, figures_of_merit

TYPICAL = 10.0  # Mbit, of a value
BLOCKED = -1e9  # score of a candidate that may not be chosen


class Scores(nn.Module):
    """Scores of candidates, as `usvauv.kernels.mission.target_rules.learned.score` computes them; initially from one
    feature alone."""

    def __init__(self) -> None:
        super().__init__()
        self.gain = nn.Parameter(torch.tensor(GAIN))
        self.hidden = nn.Linear(FEATURES, HIDDEN)
        self.out = nn.Linear(HIDDEN, 1, bias=False)
        nn.init.zeros_(self.out.weight)

    def forward(self, features: Tensor, free: Tensor) -> Tensor:
        """Scores (D, N) of the candidates of D decisions with features (D, N, F); those not free (D, N) are low."""
        scores = self.gain * features[..., Feature.future] + self.out(self.hidden(features).relu())[..., 0]
        return scores.masked_fill(~free, BLOCKED)

    def weights(self) -> list[float]:
        """The weights in the order of the kernel."""
        rows = torch.cat([self.hidden.weight, self.hidden.bias[:, None], self.out.weight.T], 1)
        return torch.cat([self.gain.reshape(1), rows.reshape(-1)]).detach().tolist()

    def load(self, weights: list[float]) -> None:
        """Set the weights from a list that `weights` returned."""
        numbers = self.gain.new_tensor(weights)
        rows = numbers[1:].reshape(HIDDEN, FEATURES + 2)
        with torch.no_grad():
            self.gain.copy_(numbers[0])
            self.hidden.weight.copy_(rows[:, :-2])
            self.hidden.bias.copy_(rows[:, -2])
            self.out.weight.copy_(rows[None, :, -1])


class Value(nn.Module):
    """A world's future data, discounted, from the features of all candidates of a decision (deep sets)."""

    def __init__(self) -> None:
        super().__init__()
        self.each = nn.Sequential(nn.Linear(FEATURES, HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, HIDDEN), nn.ReLU())
        self.all = nn.Sequential(nn.Linear(HIDDEN + FEATURES, 2 * HIDDEN), nn.ReLU(), nn.Linear(2 * HIDDEN, 1))

    def forward(self, features: Tensor) -> Tensor:
        """(D,) from (D, N, F)."""
        return TYPICAL * self.all(torch.cat([self.each(features).mean(-2), features.mean(-2)], -1))[:, 0]


def split(decisions: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Features (D, N, F), free (D, N) bool and chosen candidate (D,) of decisions (D, ·) as a world recorded them."""
    table = decisions[:, HEAD:].reshape(len(decisions), -1, FEATURES + 1)
    return table[..., :FEATURES], table[..., FEATURES] > 0, decisions[:, Decision.chosen].long()


@dataclass
class Decisions:
    """D decisions, in the order of their worlds and times.

    Attributes:
        seen: (D, ·) as the worlds recorded them, see `usvauv.kernels.mission.target_rules.learned`.
        world: (D,) index of each decision's world.
        time: (D,) s.
        earned: (D,) Mbit, discounted to the time of the decision.
        total: (W,) data delivered in the episode, Mbit.
    """

    seen: Tensor
    world: Tensor
    time: Tensor
    earned: Tensor
    total: Tensor


def collect(world: World, act: Callable[[Tensor], Tensor], horizon: float) -> Decisions:
    """The decisions of the next episode of all worlds; data earned t later are weighted by exp(−t/horizon)."""
    work = learned.decisions(world.rule_workspace, world.node.shape[1], world.num_auvs)
    work[..., Decision.made] = 0
    observation = world.reset()
    delivered = world.auv.new_zeros(world.num_worlds)
    parts: list[tuple[Tensor, ...]] = []

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
    order = order[time[order] < world.steps * world.scenario.mission.step]  # those after the last step have no effect
    return Decisions(seen[order], worlds[order], time[order], earned[order], delivered)


EVALUATE_EVERY = 10  # iterations
EVALUATION_EPISODES = 128  # with few of them the best of many evaluations is the luckiest


@dataclass(frozen=True)
class DecisionConfig:
    """Settings of the training.

    Attributes:
        iterations: of collecting one episode of all worlds and learning from it.
        worlds: stepped together.
        seed: of the worlds, the initial weights and the order of decisions.
        horizon: T, s.
        trace: λ of the advantages.
        learning_rate: of Adam at first; it falls linearly to a twentieth.
        epochs: passes over the decisions of an iteration.
        batch: decisions of an update.
        clip: largest change of a probability's ratio.
        entropy: weight of the entropy at first; it falls linearly to nothing.
    """

    iterations: int = 100
    worlds: int = 128
    seed: int = 0
    horizon: float = 600.0
    trace: float = 0.95
    learning_rate: float = 1.5e-3
    epochs: int = 4
    batch: int = 2048
    clip: float = 0.2
    entropy: float = 0.01


def advantages(decisions: Decisions, value: Tensor, config: DecisionConfig) -> Tensor:
    """Advantage of each decision over its value, Mbit."""
    world, time = decisions.world, decisions.time
    last = torch.ones_like(world, dtype=torch.bool)
    last[:-1] = world[1:] != world[:-1]
    discount = torch.where(last, 0.0, torch.exp(-(time.roll(-1) - time) / config.horizon))
    errors = decisions.earned + discount * value.roll(-1) - value
    keep = discount * config.trace
    sums, result = 0.0, []
    for error, kept in zip(errors.flip(0).tolist(), keep.flip(0).tolist(), strict=True):
        sums = error + kept * sums
        result.append(sums)
    return value.new_tensor(result).flip(0)


@dataclass(frozen=True)
class Progress:
    """Progress of a training.

    Attributes:
        iteration: iterations done.
        sampled: mean data of the training worlds in the last iteration, in which candidates are drawn, Mbit.
        evaluated: mean data of the evaluation worlds, in which the best candidate is chosen, Mbit.
    """

    iteration: int
    sampled: float
    evaluated: float


class DecisionTrainer:
    """Learns a target rule in a scenario.

    Attributes:
        scores: the network.
        iteration: iterations done.
        best: the largest `Progress.evaluated` so far, Mbit.
        interruption: the signal that asked the last `train` to stop.
    """

    def __init__(
        self,
        scenario: Scenario,
        steering: str,
        config: DecisionConfig,
        usv: str | None = "centroid",
        arch: str = "auto",
    ) -> None:
        """Begin with the scores before training.

        Args:
            scenario: any with the task data-collection.
            steering: policy of the AUVs, as for `policies.load`.
            config, usv, arch: settings, boat strategy and architecture.

        Raises:
            PolicyError: as `policies.load`, before a world is made.
        """

        def worlds(count: int, seed: int, name: str = f"learned:{UNTRAINED}") -> World:
            return World(scenario, count, seed, usv, name, arch=arch)

        check(steering, scenario)  # before kernels are compiled
        self.world = worlds(config.worlds, config.seed)
        self._evaluated_in = partial(worlds, EVALUATION_EPISODES, config.seed + EVALUATION_SEED_OFFSET)
        self._evaluation = self._evaluated_in()
        self.config, self._steering, self._act = config, steering, acting(steering, self.world)
        torch.manual_seed(config.seed)
        device = self.world.device
        with torch.device("cpu"):  # whose generator draws the weights
            self.scores, self._value = Scores().to(device), Value().to(device)
        self._adam = Adam([*self.scores.parameters(), *self._value.parameters()], config.learning_rate)
        self.iteration, self.best = 0, -math.inf
        self.interruption = Stop()

    def train(
        self,
        path: Path,
        about: Mapping[str, Any],
        last: Path | None = None,
        definition: Mapping[str, Any] | None = None,
    ) -> Iterator[Progress]:
        """Learn until all iterations are done, or until the iteration in which Ctrl-C is pressed.

        Args:
            path: of a JSON file with the weights that were best in the evaluation, and `about`.
            last: path for the state after the last iteration, for `resume`, with `about` and `definition`; None: none.
            definition: everything that decides the result.
        """
        with stoppable() as self.interruption:
            while self.iteration < self.config.iterations and not self.interruption.asked:
                sampled = self.iterate()
                progress = None
                if self.iteration % EVALUATE_EVERY == 0 or self.iteration == self.config.iterations:
                    progress = Progress(self.iteration, sampled, self.evaluate())
                    if progress.evaluated > self.best:
                        self.best = progress.evaluated
                        content = {**about, "settings": asdict(self.config), **asdict(progress)}
                        with atomic_write(path) as partial:
                            partial.write_text(json.dumps({**content, "weights": self.scores.weights()}) + "\n")
                if last is not None:
                    best = self.best if math.isfinite(self.best) else None
                    counters = {"format": FORMAT, "iteration": self.iteration, "best": best, "about": dict(about)}
                    checkpoint.write(last, {TRAINING: (counters | {"definition": definition}, self._tensors())})
                if progress is not None:
                    yield progress

    def resume(self, last: Path) -> None:
        """Continue from a state that `train` saved, on the CPU with the same result as without the interruption.

        Raises:
            PolicyError: the file is missing, damaged, or from other settings.
        """
        counters, tensors = checkpoint.read(last, TRAINING, self.world.device)
        groups: dict[str, dict[str, Tensor]] = {"scores": {}, "value": {}, "adam": {}, "world": {}}
        try:
            torch.set_rng_state(tensors.pop("generator").cpu())
            for name, value in tensors.items():
                group, _, rest = name.partition(".")
                groups[group][rest] = value
            self.scores.load_state_dict(groups["scores"])
            self._value.load_state_dict(groups["value"])
            self.world.load_state(groups["world"])
            for name, value in groups["adam"].items():
                index, moment = name.split(".")
                self._adam.moments[moment][int(index)].copy_(value)
            self.iteration = int(counters["iteration"])
            self.best = -math.inf if counters["best"] is None else float(counters["best"])
        except (LookupError, RuntimeError, TypeError, ValueError) as error:
            raise PolicyError(f"{last}: cannot be resumed: {str(error).strip().splitlines()[-1].strip()}") from None

    def _tensors(self) -> dict[str, Tensor]:
        """The state that decides how the training continues, by name."""
        found = {"generator": torch.get_rng_state()}
        groups = {
            "scores": self.scores.state_dict(),
            "value": self._value.state_dict(),
            "adam": {f"{i}.{name}": v for name, own in self._adam.moments.items() for i, v in enumerate(own)},
            "world": self.world.state(),
        }
        return found | {f"{group}.{name}": value for group, own in groups.items() for name, value in own.items()}

    def evaluate(self) -> float:
        """Mean data of the evaluation worlds, which are the same in every call, Mbit."""
        self._set_numbers(self._evaluation, explore=False)
        return figures_of_merit(self._evaluation, self._steering)["delivered_mbit"]

    def evaluate_other(self, name: str) -> float:
        """The same for another target rule, Mbit."""
        return figures_of_merit(self._evaluated_in(name), self._steering)["delivered_mbit"]

    def _set_numbers(self, world: World, explore: bool) -> None:
        numbers = world.rule_numbers
        numbers[:] = numbers.new_tensor([HORIZON, float(explore), *self.scores.weights()])

    def iterate(self) -> float:
        """Collect one episode of all worlds and learn from it; returns its mean data, Mbit."""
        config = self.config
        done = self.iteration / config.iterations
        self._adam.set_rate(config.learning_rate * max(1 - done, 0.05))
        self._set_numbers(self.world, explore=True)
        decisions = collect(self.world, self._act, config.horizon)
        self.learn(decisions, entropy=config.entropy * (1 - done))
        self.iteration += 1
        return decisions.total.mean().item()

    def learn(self, decisions: Decisions, entropy: float) -> None:
        """Improve the scores with decisions drawn by them; `entropy` is the weight of their entropy."""
        config = self.config
        features, free, chosen = split(decisions.seen)
        batches = torch.arange(len(chosen), device="cpu").split(config.batch)
        with torch.no_grad():
            value = torch.cat([self._value(features[part]) for part in batches])
            before = torch.cat([self._log_probability(features[part], free[part], chosen[part])[0] for part in batches])
        advantage = advantages(decisions, value, config)
        goal = value + advantage
        advantage = (advantage - advantage.mean()) / (advantage.std(correction=0) + 1e-6)
        for _ in range(config.epochs):
            for part in torch.randperm(len(chosen), device="cpu").split(config.batch):
                probability, spread = self._log_probability(features[part], free[part], chosen[part])
                ratio = (probability - before[part]).exp()
                clipped = ratio.clamp(1 - config.clip, 1 + config.clip)
                gain = torch.minimum(ratio * advantage[part], clipped * advantage[part]).mean()
                error = nn.functional.mse_loss(self._value(features[part]), goal[part])
                loss = error / TYPICAL**2 - gain - entropy * spread
                for network in (self.scores, self._value):
                    network.zero_grad()
                loss.backward()
                for network in (self.scores, self._value):
                    nn.utils.clip_grad_norm_(network.parameters(), 0.5)
                self._adam.step([weight.grad for weight in self._adam.parameters if weight.grad is not None])

    def _log_probability(self, features: Tensor, free: Tensor, chosen: Tensor) -> tuple[Tensor, Tensor]:
        """ln of the probabilities of the chosen candidates (D,), and the mean entropy of the choices."""
        logarithms = self.scores(features, free).log_softmax(-1)
        entropy = -(logarithms.exp() * logarithms.clamp(min=-50)).sum(-1).mean()
        return logarithms.gather(1, chosen[:, None])[:, 0], entropy
