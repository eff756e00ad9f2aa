"""The network that scores candidates, and the one that predicts what a world will bring."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from usvauv.kernels.mission.target_rules.learned import FEATURES, GAIN, HEAD, HIDDEN, Decision, Feature

TYPICAL = 10.0  # Mbit, of a value
BLOCKED = -1e9  # score of a candidate that may not be chosen


class Scores(nn.Module):
    """Scores of candidates, as `usvauv.kernels.mission.target_rules.learned.score` has them; at first by one feature
    alone."""

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
        """Set the weights from a list that `weights` gave."""
        numbers = torch.tensor(weights)
        rows = numbers[1:].reshape(HIDDEN, FEATURES + 2)
        with torch.no_grad():
            self.gain.copy_(numbers[0])
            self.hidden.weight.copy_(rows[:, :-2])
            self.hidden.bias.copy_(rows[:, -2])
            self.out.weight.copy_(rows[None, :, -1])


class Value(nn.Module):
    """Data that a world will bring, discounted, from the features of all candidates of a decision (deep sets)."""

    def __init__(self) -> None:
        super().__init__()
        self.each = nn.Sequential(nn.Linear(FEATURES, HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, HIDDEN), nn.ReLU())
        self.all = nn.Sequential(nn.Linear(HIDDEN + FEATURES, 2 * HIDDEN), nn.ReLU(), nn.Linear(2 * HIDDEN, 1))

    def forward(self, features: Tensor) -> Tensor:
        """(D,) from (D, N, F)."""
        return TYPICAL * self.all(torch.cat([self.each(features).mean(-2), features.mean(-2)], -1))[:, 0]


def split(decisions: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Features (D, N, F), free (D, N) bool and chosen candidate (D,) of decisions (D, ·) as a world left them."""
    table = decisions[:, HEAD:].reshape(len(decisions), -1, FEATURES + 1)
    return table[..., :FEATURES], table[..., FEATURES] > 0, decisions[:, Decision.chosen].long()
