"""What a validation case is: a formula, a run at a resolution, and what is expected of its errors."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np


def order(errors: Sequence[float]) -> float:
    """Order of convergence of the last two errors, on grids that are refined by two."""
    return math.log2(errors[-2] / errors[-1])


def relative_L1(computed: np.ndarray, exact: np.ndarray) -> float:
    """Σ |computed − exact| / Σ |exact| over all cells."""
    return float(np.abs(computed - exact).sum() / np.abs(exact).sum())


@dataclass(frozen=True)
class Measurement:
    """Errors of a quantity at each of a case's resolutions."""

    resolutions: tuple[int, ...]
    errors: tuple[float, ...]

    @property
    def orders(self) -> tuple[float, ...]:
        """Order of convergence between neighbouring resolutions; not a number where an error is zero."""
        pairs = zip(pairwise(self.errors), pairwise(self.resolutions), strict=True)
        return tuple(
            math.log(a / b) / math.log(fine / coarse) if a > 0 and b > 0 else math.nan
            for (a, b), (coarse, fine) in pairs
        )


@dataclass(frozen=True)
class Case:
    """A case whose truth is known without the solver.

    Args:
        name: what is computed.
        formula: the truth, as in a paper.
        source: where the formula is from.
        run: the errors by quantity at a resolution.
        resolutions: those it is run at, the finest last.
        tolerance: greatest error allowed at the finest, by quantity.
        order: bounds of the order between the two finest, by quantity; quantities that are missing have none.
    """

    name: str
    formula: str
    source: str
    run: Callable[[int], Mapping[str, float]]
    resolutions: tuple[int, ...]
    tolerance: Mapping[str, float]
    order: Mapping[str, tuple[float, float]]

    def failures(self) -> list[str]:
        """Quantities whose error at the finest resolution is above its tolerance, or whose order is out of bounds."""
        return [
            name
            for name, measured in self.measure().items()
            if not measured.errors[-1] <= self.tolerance[name]
            or (name in self.order and not self.order[name][0] < measured.orders[-1] < self.order[name][1])
        ]

    def measure(self) -> dict[str, Measurement]:
        """Run it at all resolutions."""
        runs = [self.run(n) for n in self.resolutions]
        return {name: Measurement(self.resolutions, tuple(float(r[name]) for r in runs)) for name in self.tolerance}
