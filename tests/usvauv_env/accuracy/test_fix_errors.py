"""What is expected of fixes: error ellipses, who is located, and what costs most fixes."""

import math

import numpy as np
import pytest

from usvauv.env.accuracy.boat_place import deviations, reason
from usvauv.env.accuracy.fix_errors import LEAST_GOOD, FixError, ellipse


def error(**known) -> FixError:
    """The error of a fix that is sure, but for what is known."""
    sure = {"range": 100.0, "major": 2.0, "minor": 1.0, "angle": 0.0, "good": 1.0, "detected": 1.0}
    rest = {"good_if_detected": 1.0, "wrapped": 0.0, "direct_ray": True, "signal_excess": 20.0}
    return FixError(**(sure | rest | known))


class TestEllipse:
    @pytest.mark.parametrize("angle", [0.3, 2.0])
    def test_of_axes_and_their_angle(self, angle):
        along, across = np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])
        covariance = 25 * np.outer(along, along) + 4 * np.outer(across, across)
        parts = [matrix[[0, 0, 1], [0, 1, 1]] for matrix in (covariance, np.linalg.inv(covariance))]
        assert ellipse(*parts) == pytest.approx((5, 2, angle))


def test_who_is_located():
    assert error(good=LEAST_GOOD).located
    assert not error(good=LEAST_GOOD - 1e-6).located
    located = [error(major=3.0, minor=4.0), error(major=12.0, minor=0.5), error(good=0.5, major=90.0, minor=None)]
    assert deviations(located) == [3.0, 4.0, 12.0, 0.5]
    assert deviations([*located, error(major=None)]) is None
    assert deviations(located[2:]) is None


@pytest.mark.parametrize(
    ("detected", "good", "wrapped", "why"),
    [
        (0.6, 0.3, 0.3, "undetected"),  # 0.4 against 0.18 and 0.24
        (0.7, 0.5, 0.45, "wrapped"),  # 0.315 against 0.3 and 0.035
        (0.7, 0.5, 0.05, "no depth"),  # 0.315 against 0.3 and 0.035
    ],
)
def test_the_largest_loss_of_three(detected, good, wrapped, why):
    assert reason(error(detected=detected, good_if_detected=good, wrapped=wrapped)) == why
