"""The benchmark of several seeds times what it says."""

import pytest

from benchmarks import seeds
from usvauv.policies import TrainingConfig


@pytest.mark.slow
def test_a_piece_is_timed_between_its_reports(monkeypatch):
    clock = iter(range(1000))
    monkeypatch.setattr(seeds, "clocks", lambda: (float(tick := next(clock)), 0.5 * tick))
    config = TrainingConfig(num_worlds=4, hidden=(8, 8), batch=16, n_step=2, warmup=24, replay=400)
    # Each report reads the clock once: both have as many in a piece, so that the ratio of the times is 1.
    assert seeds.measure(config, seeds=2, pairs=2, updates=200) == [(1.0, 1.0)] * 2
