"""All validation cases: errors within tolerance and orders within bounds. `python -m tests.cases` prints them."""

import pytest

from tests.cases import LINEAR, Case
from tests.cases.nonlinear import CASES


@pytest.mark.parametrize(
    "case",
    [pytest.param(case, id=case.name, marks=[pytest.mark.slow] if case.slow else []) for case in (*LINEAR, *CASES)],
)
def test_case(case: Case):
    for quantity, measured in case.measure().items():
        assert measured.errors[-1] <= case.tolerance[quantity], quantity
        if quantity in case.order:
            low, high = case.order[quantity]
            assert low < measured.orders[-1] < high, quantity


def test_every_order_belongs_to_a_tolerance():
    for case in (*LINEAR, *CASES):
        assert set(case.order) <= set(case.tolerance), case.name
        assert list(case.resolutions) == sorted(case.resolutions), case.name
