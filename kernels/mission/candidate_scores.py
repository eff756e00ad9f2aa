"""A small network that scores candidates, one at a time; while it learns, they are drawn by their scores.

    score_i = g f_i0 + w₂ · max(0, W₁ f_i + b₁)

f_i are features of candidate i, f_i0 the one by which a choice is made before training. What the network knows of the
other candidates are features too, sums over all of them, so it serves any number. Weights come from a file that a
command of `usvauv` writes (`policies/decisions`).

Numbers of a strategy or rule end with `EXPLORE`, whether candidates are drawn, and the weights g, W₁, b₁ and w₂. A
decision is left in an array of the world: `Decision`, and for each candidate its features and whether it was free.
"""

import json
from pathlib import Path
from typing import NamedTuple

import taichi as ti

from usvauv.kernels.mission.worlds import uniforms
from usvauv.kernels.types import Columns

UNTRAINED = "untrained"  # in place of a file
HIDDEN = 32
LARGEST_WEIGHT = 1e3
LARGEST_FILE = 1_000_000  # bytes


class Decision(Columns):
    """The head of a decision; the features of each candidate, and whether it was free, follow."""

    made: int  # 1; whoever reads it makes it 0
    chosen: int


HEAD = len(Decision.names)


class Network(NamedTuple):
    """Form of a network, and its start.

    Attributes:
        features: of a candidate.
        first: which of them f_i0 is.
        gain: g before training; with less, what is drawn while it learns is far worse than the best.
        what: it scores for, as in "a learned rule".
        command: that trains it.
    """

    features: int
    first: int
    gain: float
    what: str
    command: str

    @property
    def weights(self) -> int:
        """How many weights it has."""
        return HIDDEN * (self.features + 2) + 1

    def decision(self, candidates: int) -> int:
        """How many numbers a decision between some candidates leaves."""
        return HEAD + candidates * (self.features + 1)

    def read(self, text: str) -> tuple[float, ...]:
        """The weights of a JSON file, or those before training.

        Raises:
            ValueError: there is no such file, or it does not hold the numbers of this network.
        """
        if text == UNTRAINED:
            return (self.gain, *(self.weights - 1) * [0.0])
        weights: list[float] = []
        path = Path(text)
        try:
            if path.is_file() and path.stat().st_size <= LARGEST_FILE:  # a device may never end
                weights = [float(weight) for weight in json.loads(path.read_text())["weights"]]
        except (OSError, ValueError, TypeError, KeyError, ArithmeticError, RecursionError):
            weights = []
        if len(weights) != self.weights or not all(abs(weight) <= LARGEST_WEIGHT for weight in weights):
            raise ValueError(
                f"learned:{text}: no weights of a learned {self.what}; expected a file of `usvauv {self.command}`"
            )
        return tuple(weights)


@ti.func
def score(network: ti.template(), numbers: ti.template(), start: ti.template(), seen: ti.template(), w, place):
    """The network's score of a candidate.

    Args:
        numbers: array in which the weights begin at `start`.
        seen: array (W, ·) in which the candidate's features begin at `place`.
    """
    total = numbers[start] * seen[w, place + network.first]
    for h in range(HIDDEN):
        row = start + 1 + h * (network.features + 2)
        hidden = numbers[row + network.features]
        for f in ti.static(range(network.features)):
            hidden += numbers[row + f] * seen[w, place + f]
        total += numbers[row + network.features + 1] * ti.max(hidden, 0.0)
    return total


@ti.func
def gumbel(worlds: ti.template(), w, draw, index):
    """What is added to a score so that the largest sum is drawn by exp(score)."""
    u = uniforms(worlds, w, draw, index)
    return -ti.log(-ti.log(u[0]))
