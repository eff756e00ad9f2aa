"""All validation cases: errors within tolerance and orders within bounds. `python -m tests.cases` prints them."""

import pytest

from tests.cases import LINEAR, Case
from tests.cases.nonlinear import CASES


@pytest.mark.parametrize("case", [pytest.param(case, id=case.name) for case in (*LINEAR, *CASES)])
def test_case(case: Case):
    assert not case.failures()
