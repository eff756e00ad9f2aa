"""What is expected of fixes: error ellipses, who is located, what costs most fixes, and errors by cause."""

import math

import numpy as np
import pytest
import torch

from usvauv.env import Scenario
from usvauv.env.planning.fix_errors import (
    LEAST_GOOD,
    FixError,
    ellipse,
    error_budget,
    predict,
)
from usvauv.env.planning.plan import deviations, reason
from usvauv.env.site.site import Site
from usvauv.env.world.tables import link_table


def error(**known) -> FixError:
    """Of a fix that is sure, but for what is known."""
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


CAUSES = {
    "pitch and roll": "usbl.attitude_error=0.01",
    "alignment": "usbl.alignment_error=0.02",
    "heading": "usbl.heading_error=0.03",
    "speed of sound": "acoustics.sound_speed_error=8",
    "lever arm": "usbl.lever_arm_error=0.5",
    "boat's position": "usbl.gnss_error=0.7",
}


def test_the_budget_tells_causes_apart(device):
    """A cause twice as large is twice as far off, all others as before; squares add up to that of all."""
    auvs = [(60.0, 80.0, 100.0), (150.0, 20.0, 60.0)]

    def budget(changes):
        scenario = Scenario.load("ideal", ["auv.count=2", *changes])
        link = torch.from_numpy(link_table(Site(scenario))).to(device)
        found = error_budget(scenario, link, auvs, (30.0, 40.0), "fix", (0.0, 0.0))
        expected = predict(link, None, auvs, (30.0, 40.0), "fix", (0.0, 0.0))
        assert [each.range for each in expected] == pytest.approx([math.dist(auv, (30, 40, 0)) for auv in auvs])
        assert found["all"] == pytest.approx([math.hypot(each.major, each.minor) for each in expected], rel=1e-3)
        return found

    plain = budget(CAUSES.values())
    assert set(plain) == {"noise", "all", *CAUSES}
    for k in range(2):
        parts = [values[k] for name, values in plain.items() if name != "all"]
        assert plain["all"][k] == pytest.approx(math.hypot(*parts), rel=0.02)
        assert min(parts) > 0
    for cause_name, change in CAUSES.items():
        field, _, value = change.partition("=")
        doubled = budget([*CAUSES.values(), f"{field}={2 * float(value)}"])
        for name in ("noise", *CAUSES):
            expected = [(2 if name == cause_name else 1) * value for value in plain[name]]
            assert doubled[name] == pytest.approx(expected, rel=0.02), (cause_name, name)
