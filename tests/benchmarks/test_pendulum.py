"""The algorithms on a task where others have numbers: Gymnasium's Pendulum-v1, which also evaluates."""

from __future__ import annotations

import math

import pytest

from benchmarks.studies.pendulum import EPISODES, PUBLISHED, PUBLISHED_EPISODES, SETTINGS, Pendulum, measure
from usvauv.policies import TrainingConfig


def test_an_untrained_policy_is_far_below():
    pendulum = Pendulum(TrainingConfig(algorithm="sac", **SETTINGS))
    returns = pendulum.evaluate()
    assert len(returns) == EPISODES
    assert returns == pendulum.evaluate()
    assert sum(returns) / EPISODES < -800


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", PUBLISHED)
def test_it_reaches_published_returns(algorithm):
    """Not below them by more than three standard errors of the difference of the two means."""
    mean, deviation = PUBLISHED[algorithm]
    margin = 3.0 * deviation * math.sqrt(1.0 / EPISODES + 1.0 / PUBLISHED_EPISODES)
    assert measure(algorithm)["return_mean"] > mean - margin
