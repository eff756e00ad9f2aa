"""Multilayer perceptrons with ReLU on a CPU, for sixteen inputs side by side, and learned actors of them.

A vector holds one number of `LANES` rows, so that weights need no shuffling, a layer may have any width, and a row's
result does not depend on the others. Weights are packed by `TILE` inputs and outputs: a tile's sums stay in registers,
and one address serves its weights.
"""

import math
from collections.abc import Sequence
from typing import Any

import taichi as ti
import torch

from usvauv.kernels import runtime
from usvauv.kernels.functions import LANES, Launch, func, kernel
from usvauv.kernels.transcendental import hyperbolic_tangent, lanes
from usvauv.kernels.types import Columns, array1, array2, index2, select, vec4

TILE = 4
PARTS = 16  # of the rows for each thread
CLIP = 8.0  # of standardised features

rooms = ti.types.ndarray(dtype=lanes, ndim=2)
rows = ti.types.ndarray(dtype=vec4, ndim=1)
tiles = ti.types.ndarray(dtype=ti.types.vector(TILE * TILE, ti.f32), ndim=1)


class Layer(Columns):
    """Sizes of a layer in tiles, and where its numbers begin."""

    inputs: int
    outputs: int
    weights: int  # in tiles
    biases: int


@func
def bounded(x, low, high):
    """A vector within bounds; what is not a number stays so."""
    return select(x < low, lanes(low), select(x > high, lanes(high), x))


@func
def standardised(feature, mean, deviation):
    return bounded((feature - mean) * (1.0 / deviation), -CLIP, CLIP)


@func
def forward(
    packed: ti.template(), bias: ti.template(), layers: ti.template(), network, room: ti.template(), part, first, second
):
    """Where in a room the outputs of a network are, `first` or `second`; the inputs are at `first`."""
    source, target = first, second
    for layer in range(layers.shape[0]):
        inputs, outputs = layers[layer, Layer.inputs], layers[layer, Layer.outputs]
        lowest = 0.0 if layer < layers.shape[0] - 1 else -math.inf
        for group in range(network * outputs, (network + 1) * outputs):
            at, to = layers[layer, Layer.weights] + group * inputs, layers[layer, Layer.biases] + group * TILE
            sums = [lanes(bias[to + j]) for j in ti.static(range(TILE))]
            for n in range(inputs):
                for k in ti.static(range(TILE)):
                    x = room[part, source + TILE * n + k]
                    for j in ti.static(range(TILE)):
                        sums[j] += packed[at + n][TILE * k + j] * x
            for j in ti.static(range(TILE)):
                kept = select(sums[j] < lowest, lanes(lowest), sums[j])
                room[part, target + TILE * (group - network * outputs) + j] = kept
        swapped = source
        source, target = target, swapped
    return source


@func
def rows_of(group, count, networks):
    """The network of a group of `LANES` rows, and the rows, of which each of several networks has every n-th.

    A network's last group ends with copies of its last row.
    """
    groups = (count + LANES - 1) // LANES
    network, begin = group // groups, LANES * (group % groups)
    return network, [ti.min(begin + n, count - 1) * networks + network for n in ti.static(range(LANES))]


@func
def groups_of(part, parts, count, networks):
    """First group of a part of the rows, and the end of its groups; `count` rows of each network."""
    groups = (count + LANES - 1) // LANES * networks
    share = (groups + parts - 1) // parts
    return part * share, ti.min((part + 1) * share, groups)


@kernel
def infer(
    features: array2,
    actions: array2,
    room: rooms,
    mean: array1,
    deviation: array1,
    packed: tiles,
    bias: array1,
    layers: index2,
    networks: ti.i32,
    serial: ti.template(),
):
    """Actions (W K, A) in [−1, 1] of networks for features (W K, F).

    Arguments are those of `usvauv.kernels.guidance.acting.act`.
    """
    ti.loop_config(serialize=serial, block_dim=1)
    for part in range(room.shape[0]):
        count = features.shape[0] // networks
        begin, end = groups_of(part, room.shape[0], count, networks)
        for group in range(begin, end):
            network, rows = rows_of(group, count, networks)
            for f in range(features.shape[1]):
                feature = ti.Vector([features[rows[n], f] for n in ti.static(range(LANES))])
                room[part, f] = standardised(feature, mean[f], deviation[f])
            for f in range(features.shape[1], TILE * layers[0, Layer.inputs]):
                room[part, f] = lanes(0.0)
            at = forward(packed, bias, layers, network, room, part, 0, room.shape[1] // 2)
            for component in range(actions.shape[1]):
                action = hyperbolic_tangent(room[part, at + component])
                for n in ti.static(range(LANES)):
                    actions[rows[n], component] = action[n]


@kernel
def pack(
    weight: array1,
    bias: array1,
    packed: rows,
    biases: array1,
    networks: ti.i32,
    inputs: ti.i32,
    outputs: ti.i32,
):
    """Weights (S, inputs, outputs) and biases (S, outputs) of a layer in tiles; the numbers that fill these up stay."""
    ti.loop_config(serialize=True)
    groups = (outputs + TILE - 1) // TILE
    for group in range(networks * groups):
        network, first = group // groups, TILE * (group % groups)
        many = ti.min(outputs - first, TILE)
        for j in range(many):
            biases[TILE * group + j] = bias[network * outputs + first + j]
        to, at = group * ((inputs + TILE - 1) // TILE * TILE), network * inputs * outputs + first
        for k in range(inputs):
            if many == TILE:
                packed[to + k] = ti.Vector([weight[at + k * outputs + j] for j in ti.static(range(TILE))])
            else:
                for j in range(many):
                    packed[to + k][j] = weight[at + k * outputs + j]


def parts_of(rows: int) -> int:
    """Number of parts of so many rows, among the threads; few rows are one, for the calling thread."""
    return 1 if runtime.too_few_for_threads(rows) else min(-(-rows // LANES), PARTS * runtime.start().threads)


class Packed:
    """Weights and biases of S networks as `forward` takes them.

    Args:
        weights: of each layer, (S, inputs, outputs); may change in place. biases: (S, 1, outputs).

    Attributes:
        arguments: the first ones of `forward`.
        networks: S.
    """

    def __init__(self, weights: Sequence[torch.Tensor], biases: Sequence[torch.Tensor]) -> None:
        here: Any = {"device": "cpu"}  # whatever a program has made torch's defaults
        tiled = (torch.tensor([weight.shape[1:] for weight in weights], **here) + TILE - 1) // TILE
        counts = len(weights[0]) * torch.stack((tiled.prod(1), TILE * tiled[:, 1]), 1)
        layers = torch.cat((tiled, counts.cumsum(0) - counts), 1)
        tiles_in_all, biases_in_all = counts.sum(0).tolist()
        packed = torch.zeros(tiles_in_all, TILE * TILE, dtype=torch.float32, **here)
        bias = torch.zeros(biases_in_all, dtype=torch.float32, **here)
        self.arguments = packed, bias, layers.to(torch.int32)
        self.networks = len(weights[0])
        self._width = TILE * int(tiled.max())  # most numbers of a layer, whole tiles
        self._launches = [
            Launch(
                *(pack, weight.detach().view(-1), own.detach().view(-1)),
                *(packed[place[Layer.weights] :].view(-1, TILE), bias[place[Layer.biases] :]),
                *weight.shape,
                settings=runtime.vectors_in_registers(),
            )
            for weight, own, place in zip(weights, biases, layers.tolist(), strict=True)
        ]

    def refresh(self) -> None:
        """Take the present weights."""
        for launch in self._launches:
            launch()

    def room(self, rows: int, more: int = 0) -> torch.Tensor:
        """Memory of each part of the rows, with place for a layer twice, and `more` numbers of a row before these."""
        return torch.zeros(parts_of(rows), more + 2 * self._width, LANES, dtype=torch.float32, device="cpu")


class Actors:
    """Actions of networks for the features of one batch of worlds, with memory of its own.

    Args:
        size: of features, (W, K, F).
        actions: A, the first outputs, which a tanh follows.
        mean, deviation: standardise the features, (F,); may change in place.
        weights, biases: of each layer of the actors, one for each AUV or a shared one, see `Packed`.
    """

    def __init__(
        self,
        size: tuple[int, int, int],
        actions: int,
        mean: torch.Tensor,
        deviation: torch.Tensor,
        weights: Sequence[torch.Tensor],
        biases: Sequence[torch.Tensor],
    ) -> None:
        worlds, auvs, features = size
        count = worlds * auvs
        alike: Any = {"dtype": torch.float32, "device": "cpu"}  # whatever a program has made torch's defaults
        self._features, self._actions = torch.zeros(size, **alike), torch.zeros(worlds, auvs, actions, **alike)
        self._packed = Packed(weights, biases)
        self._infer = Launch(
            infer,
            self._features.view(count, features),
            self._actions.view(count, actions),
            self._packed.room(count),
            *(mean, deviation, *self._packed.arguments, self._packed.networks, runtime.too_few_for_threads(count)),
            settings=runtime.vectors_in_registers(),
        )

    def __call__(self, features: torch.Tensor) -> torch.Tensor:
        """Actions (W, K, A) for features (W, K, F)."""
        self._features.copy_(features)
        self._packed.refresh()
        self._infer()
        return self._actions.clone()
