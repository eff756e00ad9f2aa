"""The common base of the algorithms: their arguments, their optimisers, and the state of learners and optimisers."""

from __future__ import annotations

import copy
from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Any, ClassVar, Generic, Protocol, TypeVar

import torch
from torch import Tensor, nn

from usvauv.policies.cuda_graph import Recorded
from usvauv.policies.networks import Sizes, StackedMLP

AVERAGED = 200  # updates, time constant of the averaged actor
MOMENTS = "exp_avg", "exp_avg_sq", "step"  # m, v, t of `Adam`, as `torch.optim.Adam` calls them
# Each one fused operation for all parameters; torch has no public names for them.
add_ = torch._foreach_add_  # pyright: ignore[reportPrivateImportUsage]
adam_ = torch._fused_adam_  # pyright: ignore[reportPrivateImportUsage]
lerp_ = torch._foreach_lerp_  # pyright: ignore[reportPrivateImportUsage]

Actor = TypeVar("Actor", bound=StackedMLP)


@dataclass(frozen=True)
class Batch:
    """n-step transitions of S independent learners, B each.

    Attributes:
        observation: (S, B, F) features at step t.
        action: (S, B, A) action taken there.
        reward: (S, B) Σ γ^i r_{t+i} over the m ≤ n steps until the value's horizon or the episode ends.
        discount: (S, B) weight of the value of `next_observation`: γ^m, or 0 where the value's horizon ended.
        next_observation: (S, B, F) features at step t + m.
    """

    observation: Tensor
    action: Tensor
    reward: Tensor
    discount: Tensor
    next_observation: Tensor


@dataclass(frozen=True)
class Rollout(Batch):
    """T decisions in sequence of B copies of each learner's actor: a `Batch` of shape (S, T, B, ...).

    Each decision is held for n steps, fewer at an episode's end.

    Attributes:
        follows: (T,) 1 where the next decision begins at `next_observation`, 0 at the end of an episode or the rollout.
        parts: number of minibatches of an epoch.
        taught: whether the actions are a teacher's, which the actor is to take itself.
    """

    follows: Tensor
    parts: int
    taught: bool = False


class Adam:
    """Adam (Kingma, Ba, ICLR 2015, arXiv:1412.6980) in one fused operation.

    With the gradient g of step t, β₁ = 0.9, β₂ = 0.999, ε = 1e-8, and all operations element by element:

        m ← β₁ m + (1 − β₁) g,  v ← β₂ v + (1 − β₂) g²,  θ ← θ − η (m / (1 − β₁ᵗ)) / (√(v / (1 − β₂ᵗ)) + ε)

    `torch.optim.Adam` gives the same bits, but imports torch's compiler first, which takes longer than all of torch.

    Attributes:
        parameters: θ.
        moments: m, v and t of each parameter, by the names of `MOMENTS`.
    """

    def __init__(self, parameters: Iterable[nn.Parameter], rate: float) -> None:
        self.parameters: list[Tensor] = list(parameters)
        zeros = [torch.zeros_like(parameter) for parameter in self.parameters]
        steps = [torch.zeros((), dtype=torch.float32, device=zero.device) for zero in zeros]
        self.moments: dict[str, list[Tensor]] = dict(
            zip(MOMENTS, (zeros, [zero.clone() for zero in zeros], steps), strict=True)
        )
        on_gpu = zeros[0].device.type == "cuda"  # where a number would be recorded as a constant
        self._rate: Any = torch.full_like(steps[0], rate) if on_gpu else rate  # either is taken

    def set_rate(self, rate: float) -> None:
        """Set the learning rate η."""
        if isinstance(self._rate, Tensor):
            self._rate.fill_(rate)
        else:
            self._rate = rate

    @torch.no_grad()
    def step(self, gradients: Sequence[Tensor]) -> None:
        """One step along the gradients g, one of each parameter."""
        first, second, steps = (self.moments[name] for name in MOMENTS)
        add_(steps, 1.0)
        adam_(
            self.parameters, list(gradients), first, second, [], steps, lr=self._rate, beta1=0.9, beta2=0.999,
            weight_decay=0.0, eps=1e-8, amsgrad=False, maximize=False,
        )  # fmt: skip


def clipped(gradients: Sequence[Tensor], max_norm: float) -> list[Tensor]:
    """Gradients (S, ...) of the parameters of S networks, each network's clipped to a norm of at most `max_norm`."""
    norm = torch.stack([each.flatten(1).norm(dim=-1) for each in gradients]).norm(dim=0)
    share = max_norm / norm.clamp(min=max_norm)
    return [each * share.view(-1, *[1] * (each.dim() - 1)) for each in gradients]


class Settings(Protocol):
    """A run's settings read by algorithms, see `policies.TrainingConfig`."""

    @property
    def hidden(self) -> tuple[int, ...]: ...
    @property
    def layer_norm(self) -> bool: ...
    @property
    def learning_rate(self) -> float: ...
    @property
    def tau(self) -> float: ...
    @property
    def noise(self) -> float: ...
    @property
    def updates(self) -> int: ...


class Learner(nn.Module, Generic[Actor]):
    """S independent learners of one algorithm. All tensors have the leading axis S; losses are summed over it.

    Because Adam works element by element and the networks share no weight, a stack learns exactly as its members would
    alone. What is evaluated and kept is `averaged`, the actor with its weights averaged over the last `AVERAGED` or so
    updates (Polyak, Juditsky 1992, doi 10.1137/0330046), because single updates are noisy.

    Args:
        sizes: shape of the networks.
        config: settings of the run.
        generator: source of every random number, on the device of the networks.

    Attributes:
        updates: number of calls of `update`, which counts them.
        period: number of updates after which the operations of an update are the same again.
        chooses: can learn actions that are choices, see `Sizes`.
        on_policy: learns once from each `Rollout`, which its present actor made, instead of from samples of the replay.
        defaults: of the fields of `TrainingConfig`, where they differ from those of that class.
        max_gradient_norm: norm to which a network's gradient is clipped, by names of optimisers.
    """

    actor: Actor
    averaged: Actor
    period: ClassVar[int] = 1
    chooses: ClassVar[bool] = False
    on_policy: ClassVar[bool] = False
    defaults: ClassVar[Mapping[str, Any]] = MappingProxyType({})
    max_gradient_norm: ClassVar[Mapping[str, float]] = MappingProxyType({})

    def __init__(self, sizes: Sizes, config: Settings, generator: torch.Generator) -> None:
        super().__init__()
        self.sizes = sizes
        self.config = config
        self.generator = generator
        self.generators = (generator,)
        self.updates = 0
        self.optimisers: dict[str, Adam] = {}
        self._learn = Recorded(self._update_and_average, generator)

    @staticmethod
    @abstractmethod
    def make_actor(sizes: Sizes, config: Settings, generator: torch.Generator) -> Actor:
        """Untrained actors of this algorithm; their first actions are near zero."""
        raise NotImplementedError

    def set_actor(self, actor: Actor) -> None:
        """Make an actor the one that is learned."""
        self.actor = actor
        self.averaged = copy.deepcopy(actor).requires_grad_(False)
        self.add_optimiser("actor", actor.parameters())

    def add_optimiser(self, name: str, parameters: Iterable[nn.Parameter]) -> None:
        """Give parameters an optimiser of that name."""
        self.optimisers[name] = Adam(parameters, self.config.learning_rate)

    def set_learning_rate(self, share: float) -> None:
        """Set the learning rate to a share of that in the settings."""
        for optimiser in self.optimisers.values():
            optimiser.set_rate(share * self.config.learning_rate)

    def gradient_step(self, names: str | Sequence[str], loss: Tensor) -> None:
        """One step of the named optimisers, along the gradient of `loss` with respect to their own parameters only."""
        optimisers = {name: self.optimisers[name] for name in ([names] if isinstance(names, str) else names)}
        gradients = torch.autograd.grad(loss, [own for each in optimisers.values() for own in each.parameters])
        for name, optimiser in optimisers.items():
            count = len(optimiser.parameters)
            own, gradients = gradients[:count], gradients[count:]
            norms = self.max_gradient_norm
            optimiser.step(clipped(own, norms[name]) if name in norms else own)

    @torch.no_grad()
    def soft_update(self, targets: nn.Module, networks: nn.Module) -> None:
        """Move target networks by τ towards the networks: θ' ← θ' + τ (θ − θ')."""
        lerp_(list(targets.parameters()), list(networks.parameters()), self.config.tau)

    @torch.no_grad()
    def average(self) -> None:
        """Move the averaged actor towards the actor."""
        lerp_(list(self.averaged.parameters()), list(self.actor.parameters()), 1.0 / AVERAGED)

    def draw_from(self, *generators: torch.Generator) -> None:
        """Let each generator draw the random numbers of its equal share of the stack."""
        self.generators = generators
        self._learn = Recorded(self._update_and_average, *generators)

    def normal(self, shape: torch.Size) -> Tensor:
        """Standard normal numbers; the first axis of `shape` is the stack."""
        share = (shape[0] // len(self.generators), *shape[1:])
        draws = (torch.randn(share, dtype=torch.float32, generator=g, device=g.device) for g in self.generators)
        return torch.cat([*draws])

    def permutation(self, count: int) -> Tensor:
        """An order of `count` items for each network of the stack, (S, count)."""
        orders = [torch.randperm(count, generator=own, device=own.device) for own in self.generators]
        return torch.stack(orders).repeat_interleave(self.sizes.stack // len(orders), 0)

    @abstractmethod
    def explore(self, observation: Tensor, noise: Tensor) -> Tensor:
        """Exploring actions (S, B, A) in [−1, 1] for observations (S, B, F) and standard normal noise (S, B, A)."""
        raise NotImplementedError

    @abstractmethod
    def update(self, batch: Batch) -> dict[str, Tensor]:
        """Learn from one batch; returns the figures to show, as tensors without gradient.

        On a CUDA device it is recorded: it must not read a number off a tensor, and its operations may depend on
        `updates` modulo `period` alone.
        """
        raise NotImplementedError

    def learn(self, batch: Batch) -> dict[str, Tensor]:
        """Call `update` and `average`, on a CUDA device as one graph."""
        updates = self.updates
        tensors = (getattr(batch, field.name) for field in fields(batch))
        figures = self._learn(*tensors, variant=updates % self.period)
        self.updates = updates + 1
        return figures

    def _update_and_average(self, *tensors: Tensor) -> dict[str, Tensor]:
        figures = self.update(Batch(*tensors))
        self.average()
        return figures

    def tensors(self) -> dict[str, Tensor]:
        """Everything that changes while learning, by name."""
        return dict(self.state_dict()) | self.moments()

    def moments(self) -> dict[str, Tensor]:
        """The optimisers' state, by name."""
        return {
            f"optimiser.{name}.{index}.{moment}": value
            for name, optimiser in self.optimisers.items()
            for moment, values in optimiser.moments.items()
            for index, value in enumerate(values)
        }

    @torch.no_grad()
    def restore(self, state: Mapping[str, Tensor]) -> None:
        """The inverse of `tensors`; of a run that was saved before its first update moments may be missing."""
        self.load_state_dict({key: value for key, value in state.items() if not key.startswith("optimiser.")})
        for name, value in self.moments().items():
            if name in state:
                value.copy_(state[name])
        self._learn.forget()
