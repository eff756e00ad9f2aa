"""Rates of training count the updates that were done."""

import pytest

from benchmarks import learning


@pytest.mark.slow
def test_a_rate_is_updates_over_their_time(monkeypatch):
    """By a clock that ticks fifty times slower than updates are done; reports come at unequal distances."""
    trainers, made = [], learning.Trainer

    def noted(*arguments):
        trainers.append(made(*arguments))
        return trainers[0]

    monkeypatch.setattr(learning, "Trainer", noted)
    monkeypatch.setattr(learning, "perf_counter", lambda: trainers[0].learner.updates / 50)
    assert learning.updates_per_second(4, 8, 130) == pytest.approx(50)
