"""Validation of the shallow-water solvers: one object a case. `python -m tests.cases` prints them as a table."""

from tests.cases import analytic, reflection, scheme
from tests.cases.case import Case

LINEAR = (*scheme.CASES, *analytic.CASES, *reflection.CASES)

__all__ = ["LINEAR", "Case"]
