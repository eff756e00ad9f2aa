"""Parameters of tests of which some are slow."""

from collections.abc import Iterable

import pytest


def slowly(cases: Iterable, *slow: object) -> list:
    """The cases, of which those named are slow tests."""
    return [pytest.param(case, marks=pytest.mark.slow) if case in slow else case for case in cases]
