"""Stacks of independent networks, evaluated together.

S networks of the same shape hold their weights in one tensor with a leading axis, so that a layer of all of them is one
batched matrix product. Their gradients do not mix: each network's output depends on its own slice of the weights only.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar, Self

import torch
from torch import Tensor, nn
from torch.nn import functional

MIDDLE, HALF = -2.0, 3.0  # of the range of a Gaussian actor's log standard deviation, from −5 to 1
FUSED = 256  # inputs of a network from which on oneDNN's layer is faster than MKL's and a ReLU
LARGE = 1 << 15  # numbers of a factor from which on oneDNN takes down to half of MKL's time for a product
EPSILON = 1e-5  # added to the variance that normalises
MOST_ACTION = 0.99999  # largest action of a Gaussian actor, for the inverse of the tanh
ACTION_GAIN = 5.0  # factor on the actions that enter a critic


@dataclass(frozen=True)
class Sizes:
    """Shape of the learning problem.

    Attributes:
        stack: S independent learners (1 if the AUVs share one).
        observation: features F of one AUV.
        action: components A of one action.
        choices: number of those of which an action is one, by its number; 0: actions are numbers in [−1, 1].
        own: features of the AUV itself, after which come those of a set of things; 0: there is no set.
        each: features of each thing of the set.
    """

    stack: int
    observation: int
    action: int
    choices: int = 0
    own: int = 0
    each: int = 0


class StackedMLP(nn.Module):
    """S multilayer perceptrons with ReLU: x (S, B, inputs) → (S, B, outputs).

    Args:
        stack: number S of independent networks.
        sizes: inputs, width of each hidden layer, outputs.
        generator: source of the initial weights, uniform within ±1/√(inputs of the layer).
        layer_norm: normalise each hidden layer before its ReLU, without learned scale.
        output_gain: factor on the initial weights of the last layer.
    """

    def __init__(
        self,
        stack: int,
        sizes: Sequence[int],
        generator: torch.Generator,
        layer_norm: bool = False,
        output_gain: float = 1.0,
    ) -> None:
        super().__init__()
        self.layer_norm = layer_norm
        self.weights = nn.ParameterList()
        self.biases = nn.ParameterList()
        device = generator.device
        for inputs, outputs in pairwise(sizes):
            bound = 1.0 / math.sqrt(inputs)
            weight = torch.rand((stack, inputs, outputs), dtype=torch.float32, generator=generator, device=device)
            bias = torch.rand((stack, 1, outputs), dtype=torch.float32, generator=generator, device=device)
            self.weights.append(nn.Parameter((2.0 * weight - 1.0) * bound))
            self.biases.append(nn.Parameter((2.0 * bias - 1.0) * bound))
        with torch.no_grad():
            self.weights[-1].mul_(output_gain)
            self.biases[-1].mul_(output_gain)

    def layers(self) -> tuple[list[Any], list[Any]]:
        """Weights (S, inputs, outputs) and biases (S, 1, outputs); iterating over a `ParameterList` is slow."""
        return [*self.weights._parameters.values()], [*self.biases._parameters.values()]

    def forward(self, x: Tensor, /, frozen: bool = False) -> Tensor:
        """Outputs (S, B, outputs) for inputs (S, B, inputs); with `frozen` only the inputs get a gradient."""
        weights, biases = self.layers()
        if frozen:
            weights, biases = [each.detach() for each in weights], [each.detach() for each in biases]
        learning = torch.is_grad_enabled()
        if self.layer_norm or (learning and weights[0].requires_grad and _large(x)):
            return Layers.apply(self.layer_norm, x, *weights, *biases)
        layers = list(zip(weights, biases, strict=True))
        plain = not learning and x.device.type == "cpu"
        if plain and x.shape[1] >= FUSED and torch.backends.mkldnn.is_available():
            each = [_fused(own, [(w[index], b[index, 0]) for w, b in layers]) for index, own in enumerate(x)]
            return torch.stack(each) if len(each) > 1 else each[0].unsqueeze(0)
        *hidden, last = layers
        for w, b in hidden:
            x = torch.baddbmm(b, x, w).relu_()
        return _last(x, *last)


class AttentiveMLP(StackedMLP):
    """S networks that see any number M of things besides: x (S, B, own + M each) → (S, B, outputs).

    Each thing is encoded, e_i ∈ ℝʰ with h the last hidden width, and weighed by how much it answers the own numbers o:

        w = softmax((Q o)·(K e_i)/√h),   outputs = MLP(o, Σ w_i e_i, mean e_i).

    So the order of the things makes no difference. Source: Vaswani et al., "Attention is all you need", 2017,
    arXiv:1706.03762, Eq. 1; pooling as in Lee et al., "Set transformer", ICML 2019, arXiv:1810.00825.

    Args:
        outputs: of a network.
    """

    def __init__(
        self,
        sizes: Sizes,
        hidden: Sequence[int],
        outputs: int,
        generator: torch.Generator,
        output_gain: float = 1.0,
    ) -> None:
        width = hidden[-1]
        super().__init__(sizes.stack, (sizes.own + 2 * width, *hidden, outputs), generator, output_gain=output_gain)
        self.own, self.each = sizes.own, sizes.each
        self.encoder = StackedMLP(sizes.stack, (sizes.each, *hidden), generator)
        self.query = StackedMLP(sizes.stack, (sizes.own, width), generator)
        self.key = StackedMLP(sizes.stack, (width, width), generator)

    def forward(self, x: Tensor, /, frozen: bool = False) -> Tensor:
        own, things = x[..., : self.own], x[..., self.own :].unflatten(-1, (-1, self.each))
        code = self.encoder(things.flatten(1, 2), frozen).relu()
        key, code = self.key(code, frozen).unflatten(1, things.shape[1:3]), code.unflatten(1, things.shape[1:3])
        weight = (key * self.query(own, frozen).unsqueeze(2)).sum(-1) / math.sqrt(key.shape[-1])
        pooled = (weight.softmax(-1).unsqueeze(-1) * code).sum(2)
        return super().forward(torch.cat((own, pooled, code.mean(2)), -1), frozen)


def _fused(x: Tensor, layers: Sequence[tuple[Tensor, Tensor]]) -> Tensor:
    """Outputs of one network for x (B, inputs), each layer one operation of oneDNN, which has no gradient."""
    for index, (weight, bias) in enumerate(layers):
        after = "relu" if index < len(layers) - 1 else "none"
        x = torch.ops.mkldnn._linear_pointwise(x, weight.mT, bias, after, [], "")
    return x


def _last(x: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
    if weight.shape[-1] == 1:
        # On a CPU a matrix product with a single column takes four times as long, its gradient ten times.
        return (x * weight.mT).sum(-1, keepdim=True) + bias
    return torch.baddbmm(bias, x, weight)


def _large(x: Tensor) -> bool:
    """Whether oneDNN is there and faster for products of x (S, n, inputs)."""
    return x.shape[1] * x.shape[2] >= LARGE and x.device.type == "cpu" and torch.backends.mkldnn.is_available()


def _product(x: Tensor, weight: Tensor, bias: Tensor | None = None) -> Tensor:
    """x W + b of each network, for x (S, n, inputs); without a gradient."""
    if _large(x):
        offsets = [None] * len(x) if bias is None else bias[:, 0]
        linear = torch.ops.mkldnn._linear_pointwise
        each = [linear(own, w.mT, b, "none", [], "") for own, w, b in zip(x, weight, offsets, strict=True)]
        return torch.stack(each) if len(each) > 1 else each[0].unsqueeze(0)
    return torch.bmm(x, weight) if bias is None else torch.baddbmm(bias, x, weight)


class Layers(torch.autograd.Function):
    """A network as one operation to autograd, whose hidden layers can be normalised before their ReLU.

    With y = x W + b minus its mean over the layer's outputs, the normalised layer is max(0, z), z = y / √(mean y² + ε).
    The mean is subtracted from the weights, which are fewer.
    """

    @staticmethod
    def forward(ctx: Any, normalised: bool, x: Tensor, *parameters: Tensor) -> Tensor:
        half, kept = len(parameters) // 2, []
        for given, offset in zip(parameters[: half - 1], parameters[half:-1], strict=True):
            weight, scale = given, offset
            if normalised:
                weight = _centred(given)
                z = _product(x, weight, _centred(offset))
                square = torch.linalg.vector_norm(z, dim=-1, keepdim=True).square_()
                scale = square.div_(z.shape[-1]).add_(EPSILON).rsqrt_()
                z.mul_(scale)
            else:
                z = _product(x, weight, offset)
            kept += x, weight, z, scale
            x = z.relu() if normalised else z.relu_()
        ctx.normalised = normalised
        ctx.save_for_backward(*kept, x, parameters[half - 1])
        return _last(x, parameters[half - 1], parameters[-1])

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        *kept, x, weight = ctx.saved_tensors
        to_x, learning = ctx.needs_input_grad[1:3]
        of_weights: list[Tensor | None] = []
        of_biases: list[Tensor | None] = []
        if learning:
            narrow = gradient.shape[-1] == 1
            of_weights = [(x * gradient).sum(1).unsqueeze(-1) if narrow else torch.bmm(x.mT, gradient)]
            of_biases = [gradient.sum(1, keepdim=True)]
        while kept:
            gradient = gradient * weight.mT if weight.shape[-1] == 1 else _product(gradient, weight.mT)
            x, weight, z, scale = kept[-4:]
            del kept[-4:]
            gradient = torch.ops.aten.threshold_backward(gradient, z, 0.0)
            if ctx.normalised:
                gradient = torch.addcmul(gradient, z, (gradient * z).mean(-1, keepdim=True), value=-1.0).mul_(scale)
            if learning:
                products = _product(x.mT, gradient), gradient.sum(1, keepdim=True)
                of_weight, of_bias = map(_centred, products) if ctx.normalised else products
                of_weights.insert(0, of_weight)
                of_biases.insert(0, of_bias)
        parameters = (*of_weights, *of_biases) if learning else (None,) * (len(ctx.needs_input_grad) - 2)
        return None, _product(gradient, weight.mT) if to_x else None, *parameters


def _centred(value: Tensor) -> Tensor:
    """The value minus its mean along the last axis."""
    return value - value.mean(-1, keepdim=True)


class StackedActor(StackedMLP):
    """Networks of features (S, B, F) that give actions.

    Attributes:
        outputs: numbers that the network gives for each component of an action.
    """

    outputs: ClassVar[int]

    @classmethod
    def near_zero(cls, sizes: Sizes, hidden: Sequence[int], generator: torch.Generator) -> Self:
        """Untrained actors, whose first actions are near zero."""
        layers = (sizes.observation, *hidden, cls.outputs * sizes.action)
        return cls(sizes.stack, layers, generator, output_gain=0.01)


class DeterministicActor(StackedActor):
    """Actions (S, B, A) in [−1, 1] by a tanh at the output, as in DDPG and TD3."""

    outputs = 1

    def forward(self, observation: Tensor, /) -> Tensor:
        return torch.tanh(super().forward(observation))


class GaussianActor(StackedActor):
    """A normal distribution squashed by tanh, as in SAC; the network gives its mean and log deviation."""

    outputs = 2

    def _distribution(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        mean, log_std = super().forward(observation).chunk(2, dim=-1)
        # tanh, unlike a clamp, has a gradient at both ends of the range.
        return mean, MIDDLE + HALF * torch.tanh(log_std)

    @torch.no_grad()
    def set_deviation(self, deviation: float) -> None:
        """Set the initial deviation before the tanh, approximately."""
        self.biases[-1].chunk(2, dim=-1)[1].add_(math.atanh((math.log(deviation) - MIDDLE) / HALF))

    def forward(self, observation: Tensor, /) -> Tensor:
        """The mode's action, (S, B, A) in [−1, 1]."""
        return torch.tanh(super().forward(observation)).chunk(2, dim=-1)[0]

    def draw(self, observation: Tensor, noise: Tensor) -> Tensor:
        """The action of `sample` alone."""
        mean, log_std = self._distribution(observation)
        return torch.tanh(mean + log_std.exp() * noise)

    def sample(self, observation: Tensor, noise: Tensor) -> tuple[Tensor, Tensor]:
        """The action (S, B, A) made of standard normal noise (S, B, A), and its log-probability density (S, B)."""
        mean, log_std = self._distribution(observation)
        raw = mean + log_std.exp() * noise
        log_normal = -0.5 * noise.square() - log_std - 0.5 * math.log(2.0 * math.pi)
        # log(1 − tanh² x) = 2 (log 2 − x − softplus(−2x)), which stays finite where tanh x rounds to 1.
        log_slope = 2.0 * (math.log(2.0) - raw - functional.softplus(-2.0 * raw))
        return torch.tanh(raw), (log_normal - log_slope).sum(-1)

    def log_density(self, observation: Tensor, action: Tensor) -> Tensor:
        """Log-probability density (S, B) of actions (S, B, A), except a term independent of the network's weights."""
        mean, log_std = self._distribution(observation)
        raw = torch.atanh(action.clamp(-MOST_ACTION, MOST_ACTION))
        return (-0.5 * ((raw - mean) / log_std.exp()).square() - log_std).sum(-1)


class ChoiceActor(AttentiveMLP):
    """One of several choices: features (S, B, F) → its number (S, B, 1); the network gives log-probabilities."""

    @classmethod
    def undecided(cls, sizes: Sizes, hidden: Sequence[int], generator: torch.Generator) -> Self:
        """Untrained actors, to whom all choices are nearly alike."""
        return cls(sizes, hidden, sizes.choices, generator, output_gain=0.01)

    def forward(self, observation: Tensor, /) -> Tensor:
        """The most probable choice."""
        return super().forward(observation).argmax(-1, keepdim=True).to(observation)

    def draw(self, observation: Tensor, noise: Tensor) -> Tensor:
        """A choice by its probability, made of standard normal noise (S, B, 1)."""
        reached = super().forward(observation).softmax(-1).cumsum(-1)[..., :-1]
        return (reached < torch.special.ndtr(noise)).sum(-1, keepdim=True).to(noise)

    def log_density(self, observation: Tensor, action: Tensor) -> Tensor:
        """Logarithm of the probability (S, B) of choices (S, B, 1)."""
        return super().forward(observation).log_softmax(-1).gather(-1, action.long()).squeeze(-1)


class Critic(nn.Module):
    """Action values Q of C critics for each of S agents: observation (S, B, F), action (S, B, A) → (C, S, B).

    Q depends far more on the state than on a single action. So it is the sum of a network of the state and one of state
    and action (after Wang et al., "Dueling network architectures", ICML 2016, arXiv:1511.06581, without centring). This
    keeps errors in the value of states apart from differences between actions. Actions are multiplied by `ACTION_GAIN`
    before they enter, because they vary by a few tenths where features vary by one.
    """

    def __init__(
        self,
        critics: int,
        sizes: Sizes,
        hidden: Sequence[int],
        generator: torch.Generator,
        layer_norm: bool,
    ) -> None:
        super().__init__()
        self.critics = critics
        stack, both = critics * sizes.stack, sizes.observation + sizes.action
        self.of_state = StackedMLP(stack, (sizes.observation, *hidden, 1), generator, layer_norm)
        self.of_action = StackedMLP(stack, (both, *hidden, 1), generator, layer_norm)

    def forward(self, observation: Tensor, action: Tensor, frozen: bool = False) -> Tensor:
        """Values (C, S, B); with `frozen` only the inputs get a gradient, which saves half of the work."""

        def each(x: Tensor) -> Tensor:
            return x.expand(self.critics, -1, -1, -1).flatten(0, 1)

        both = torch.cat((observation, ACTION_GAIN * action), -1)
        value = self.of_state(each(observation), frozen) + self.of_action(each(both), frozen)
        return value.view(self.critics, *action.shape[:2])


def stack(value: Tensor, shared: bool, seeds: int = 1) -> Tensor:
    """Rows (W, K, ...) in stacks (K, W, ...) for a network of each AUV, or (1, W K, ...) for a shared one.

    For N seeds, each with its own networks and the next W worlds: (N W, K, ...) → (N K, W, ...) or (N, W K, ...).
    """
    if shared:  # a matrix, which torch transposes faster than a tensor of more dimensions
        return value.flatten(0, 1).contiguous().unflatten(0, (seeds, -1))
    return value.unflatten(0, (seeds, -1)).transpose(1, 2).flatten(0, 1).contiguous()


def unstack(value: Tensor, auvs: int, seeds: int = 1) -> Tensor:
    """The inverse of `stack`: back to (N W, K, ...)."""
    if value.shape[0] == seeds:
        return value.reshape(-1, auvs, *value.shape[2:])
    return value.unflatten(0, (seeds, -1)).transpose(1, 2).flatten(0, 1)
