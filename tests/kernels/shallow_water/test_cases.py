"""All validation cases: errors within tolerance and orders within bounds. `python -m tests.cases` prints them."""

import math

import pytest

from tests.cases import LINEAR, Case
from tests.cases.nonlinear import CASES


@pytest.mark.parametrize(
    "case",
    [pytest.param(case, id=case.name, marks=[pytest.mark.slow] if case.slow else []) for case in (*LINEAR, *CASES)],
)
def test_case(case: Case):
    assert not case.failures()


def first_order(error: float = 1.0, **changed) -> Case:
    """A case with the error `error`/n at n cells."""
    about = {"resolutions": (10, 20), "tolerance": {"e": 0.05}, "order": {"e": (0.9, 1.1)}}
    return Case("first order", "e = error/n", "-", lambda n: {"e": error / n}, **about | changed)


def test_a_case_fails_where_its_error_or_order_does():
    assert not first_order().failures()
    assert first_order(error=1.1).failures() == ["e"]
    assert first_order(error=math.nan).failures() == ["e"]
    assert first_order(order={"e": (1.9, 2.1)}).failures() == ["e"]
    assert first_order(error=0.0).failures() == ["e"]  # an error of zero has no order
    assert not first_order(error=0.0, order={}).failures()


@pytest.mark.parametrize("wrong", [{"resolutions": (20, 10)}, {"resolutions": (10, 10)}, {"order": {"u": (1, 2)}}])
def test_a_case_that_could_not_be_judged_is_refused(wrong):
    with pytest.raises(ValueError, match="first order"):
        first_order(**wrong)
