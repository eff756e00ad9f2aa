"""Multilayer perceptrons with ReLU on a CPU, for sixteen inputs side by side.

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
from usvauv.kernels.functions import Launch, func, kernel
from usvauv.kernels.types import Columns, array1, select, vec4

LANES = 16
TILE = 4
SHIFT = 12583039.0  # 1.5 · 2²³ + 127: the last bits of a number n plus this one are those of the exponent of 2ⁿ

lanes = ti.types.vector(LANES, ti.f32)
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
def exponential(x):
    """eˣ of a vector in registers, within 2e-7 of itself; below −87 that of −87. The range as in Cephes' `expf`."""
    y = select(x < -87.0, lanes(-87.0), x)
    rounded = 1.44269504 * y + SHIFT
    n = rounded - SHIFT
    f = y - 0.693359375 * n + 2.12194440e-4 * n
    q = 1.6666665e-1 + f * (4.1665796e-2 + f * (8.3334519e-3 + f * (1.3981999e-3 + f * 1.9875691e-4)))
    bits = [ti.bit_cast(rounded[lane], ti.i32) for lane in ti.static(range(LANES))]
    power = [ti.bit_cast(bits[lane] << 23, ti.f32) for lane in ti.static(range(LANES))]
    return (1.0 + f + f * f * (0.5 + f * q)) * ti.Vector(power)


@func
def hyperbolic_tangent(x):
    """Of a vector in registers, within 2e-7."""
    return 1.0 - 2.0 / (1.0 + exponential(2.0 * select(x > 20.0, lanes(20.0), x)))


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


class Packed:
    """Weights and biases of S networks as `forward` takes them.

    Args:
        weights: of each layer, (S, inputs, outputs); may change in place. biases: (S, 1, outputs).

    Attributes:
        arguments: the first ones of `forward`.
        width: most numbers of a layer, whole tiles.
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
        self.width = TILE * int(tiled.max())
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
