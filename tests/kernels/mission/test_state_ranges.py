"""What columns of a state may hold: indices up to the last of their kind, places in the area, other numbers a bound."""

import numpy as np
import pytest
import torch

from usvauv.env import Scenario
from usvauv.env.world.state import ANYTHING, LARGEST, bounds_of, first_outside
from usvauv.kernels.mission.worlds import STATE

# Unequal numbers, so that no column can have another's bound.
SIDES = ["area.width=300", "area.length=200", "auv.count=3", "boat.count=2", "nodes.count=9"]
BOUNDS = bounds_of(Scenario.load("ideal", [*SIDES, "nodes.arrival_rates=[1,2,3,4,5]"]))
NAMED = [name for name, array in STATE.items() if array.ranges]
INDICES = {
    **dict.fromkeys(("target", "heads_for", "sent_heads_for", "tour", "successor"), (0, 8)),
    **dict.fromkeys(("served_by", "fix_boat", "asking"), (0, 1)),
    **dict.fromkeys(("asked", "visits"), (-1, 2)),
    **dict.fromkeys(("hovering", "border", "over"), (0, 1)),
    "owner": (0, 2),
    "kind": (0, 4),
    "overflowing": (0, 9),
}


def words(name: str, column: int, value: float) -> str | None:
    """What is said of an array that is in order but for one number, in world 1."""
    low, high = BOUNDS[name]
    values = torch.from_numpy(np.broadcast_to(np.clip(0.0, low, high), (2, 3, len(low))).copy())
    values[1, 2, column] = value
    found = first_outside(name, values, BOUNDS)
    assert found is None or found[0] == 1
    return found and found[1]


@pytest.mark.parametrize("name", NAMED)
def test_both_ends_are_allowed_and_nothing_beyond(name):
    for column, text in enumerate(STATE[name].names):
        low, high = BOUNDS[name][:, column]
        assert (low, high) == INDICES.get(text, (low, high))
        assert words(name, column, low) is words(name, column, high) is words(name, column, 0.0) is None
        for wrong in (np.nextafter(low, -np.inf), np.nextafter(high, np.inf), np.nan, np.inf):
            said = words(name, column, wrong)
            assert text in said
            assert f"from {low:g} to {high:g}" in said
        if text in INDICES and text != "overflowing":
            assert "must be a whole number from" in words(name, column, low + 0.5)


def test_numbers_without_a_range_are_bounded():
    values = torch.zeros(2, 3, 2)
    values[1, 2, 1] = ANYTHING
    assert first_outside("observation", values, BOUNDS) is None
    values[1, 2, 1] = -1.01 * ANYTHING
    assert first_outside("reward", values, BOUNDS, ("a", "b")) == (1, f"reward 'b' of AUV 2 is {-1.01 * ANYTHING:g}")
    assert max(BOUNDS[name][1].max() for name in NAMED) == LARGEST
