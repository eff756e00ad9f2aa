"""What columns of a state may hold: indices up to the last of their kind, places in the area, both axes alike."""

import numpy as np
import pytest
import torch

from usvauv.env import Scenario
from usvauv.env.world.state_check import bounds_of, first_outside
from usvauv.kernels.mission.state_ranges import ANYTHING, LARGEST, STATE

# Unequal numbers, so that no column can have another's bound.
SIDES = ["area.width=300", "area.length=200", "auv.count=3", "boat.count=2", "nodes.count=9"]
BOUNDS = bounds_of(Scenario.load("ideal", [*SIDES, "nodes.arrival_rates=[1,2,3,4,5]"]))
PLACES = [(name, column) for name, table in STATE.items() for column in range(len(table))]
INDICES = {
    **dict.fromkeys(("target", "heads_for", "sent_heads_for", "tour", "successor"), (0, 8)),
    **dict.fromkeys(("served_by", "fix_boat", "asking"), (0, 1)),
    **dict.fromkeys(("asked", "visits"), (-1, 2)),
    **dict.fromkeys(("hovering", "border", "over"), (0, 1)),
    "owner": (0, 2),
    "kind": (0, 4),
}


def words(name: str, column: int, value: float) -> str | None:
    """What is said of an array that is in order but for one number, in world 1."""
    low, high = BOUNDS[name]
    values = torch.from_numpy(np.broadcast_to(np.clip(0.0, low, high), (2, 3, len(low))).copy())
    values[1, 2, column] = value
    found = first_outside(name, values, BOUNDS)
    assert found is None or found[0] == 1
    return found and found[1]


@pytest.mark.parametrize(("name", "column"), PLACES)
def test_both_ends_are_allowed_and_nothing_beyond(name, column):
    low, high = BOUNDS[name][:, column]
    assert low < high
    assert words(name, column, low) is words(name, column, high) is None
    for wrong in (np.nextafter(low, -np.inf), np.nextafter(high, np.inf), np.nan, np.inf):
        said = words(name, column, wrong)
        assert STATE[name][column][0] in said
        assert f"from {low:g} to {high:g}" in said


@pytest.mark.parametrize(("name", "column"), PLACES)
def test_indices_are_whole_and_other_numbers_need_not_be(name, column):
    text, allowed = STATE[name][column]
    low, high = BOUNDS[name][:, column]
    said = words(name, column, low + 0.5)
    assert (said is not None) == allowed.whole == (text in {*INDICES, "fix_flags", "reply"})
    if text in INDICES:
        assert "must be a whole number from" in said
        assert (low, high) == INDICES[text]


def test_places_lie_in_the_area_and_other_vectors_are_bounded_alike():
    for name, table in STATE.items():
        columns = [text for text, _ in table]
        for text in columns:
            if text.endswith("x") and f"{text[:-1]}y" in columns:
                x, y = (BOUNDS[name][:, columns.index(each)] for each in (text, f"{text[:-1]}y"))
                inside = (name in ("auv", "node", "boat", "foresight") and text == "x") or text == "goal_x"
                if inside:
                    assert (x.tolist(), y.tolist()) == ([0, 300], [0, 200])
                else:
                    assert x.tolist() == y.tolist() == [-x[1], x[1]] or text == "covariance_xx"


@pytest.mark.parametrize("name", STATE)
def test_zeros_are_a_state_and_bounds_are_numbers_that_one_can_remember(name):
    """One digit and a power of ten, where a bound is no count: it stands in what a user reads."""
    assert words(name, 0, 0.0) is None
    assert (BOUNDS[name][0] <= 0).all()
    for text, allowed in STATE[name]:
        for bound in (allowed.low, allowed.high):
            if not isinstance(bound, str) and text not in ("fix_flags", "effort"):
                assert bound == float(f"{bound:.0e}"), text


def test_more_cannot_overflow_than_there_are_nodes():
    columns = [text for text, _ in STATE["tally"]]
    assert BOUNDS["tally"][:, columns.index("overflowing")].tolist() == [0, 9]


def test_numbers_without_a_table_are_bounded():
    values = torch.zeros(2, 3, 2)
    values[1, 2, 1] = ANYTHING
    assert first_outside("observation", values, BOUNDS) is None
    values[1, 2, 1] = -1.01 * ANYTHING
    assert first_outside("reward", values, BOUNDS, ("a", "b")) == (1, f"reward 'b' of AUV 2 is {-1.01 * ANYTHING:g}")
    assert max(bound[1].max() for bound in BOUNDS.values()) == LARGEST
