"""The least error beside the errors of tracked targets: a regression over what the observers of a trace measure."""

from dataclasses import replace

import numpy as np
import pytest

from tests.usvauv_env.record.made_traces import following, synthetic_trace
from usvauv.env import Scenario
from usvauv.env.record.metrics import task_metrics
from usvauv.env.record.tracking_metrics import least_error

DEPTH = 14.0  # m, of targets
GIVEN = "course_walk=0", "interval=7", "range_loss=0.3", "range_most=150", "drifts=0"
MEASURED = {
    "ranges, boat listens": ("boat_listens=1", "depths_known=1"),
    "ranges that fade, depth not known": ("boat_listens=0", "signal_excess=50"),
    "bearings": ("boat_listens=0", "depths_known=1", "ranges=0", "bearing_noise=0.1"),
    "both, boat listens": ("boat_listens=1", "bearing_noise=0.05"),
}


def straight(*changes):
    """A trace whose targets go straight on, with these task parameters."""
    trace = following(synthetic_trace(auvs=3, nodes=4, worlds=3))
    numbers = [f"task_parameters.{each}" for each in (*GIVEN, *changes)]
    velocity = np.random.default_rng(2).normal(0, 0.4, (3, 4, 2))
    way = trace.node_position + trace.time[:, None, None, None] * velocity
    return replace(trace, scenario=Scenario.load("tracking", numbers), node_way=way, node_estimate=way)


def expected(trace, w, i):
    """Root of the horizontal variance of target i at the last step by the normal equations of all measurements."""
    given = trace.scenario.task_numbers
    observers = [np.append(np.moveaxis(trace.auv_position[:, w], 1, 0), trace.depth[:, w].T[..., None], -1)]
    if given["boat_listens"]:
        observers.append(np.pad(np.moveaxis(trace.boat_position[:, w], 1, 0), ((0, 0), (0, 0), (0, 1))))
    end = np.array([*trace.node_way[-1, w, i], *(trace.node_way[-1, w, i] - trace.node_way[-2, w, i]), DEPTH])

    def measured(state, place, before):
        x, y = state[:2] - before * state[2:4] - place[:2]
        return np.array([np.sqrt(x * x + y * y + (state[4] - place[2]) ** 2), np.arctan2(y, x)])

    start = np.eye(5) - np.diag([60.0, 60.0, 0.0], 2)  # from the state at the end
    prior = np.diag([12 / 400**2, 12 / 400**2, *2 * [6 / (0.3**2 + 0.3 * 0.6 + 0.6**2)], 12 / 15**2])
    J = start.T @ prior @ start
    for places in np.concatenate(observers):
        for second in range(7, 61, 7):
            args = places[second - 1], 60 - second
            slant = measured(end, *args)[0]
            excess = given["signal_excess"] - 20 * np.log10(slant) - given["absorption"] * slant / 1000
            heard = 0.7 * (slant <= 150) * (np.exp(-(10 ** (-excess / 10))) if given["signal_excess"] else 1)
            small = 1e-4 * np.eye(5)
            gradient = [(measured(end + step, *args) - measured(end - step, *args)) / 2e-4 for step in small]
            of_range, of_bearing = np.transpose(gradient)
            if given["ranges"]:
                J += heard * np.outer(of_range, of_range) / given["range_noise"] ** 2
            if given["bearing_noise"]:
                J += heard * np.outer(of_bearing, of_bearing) / given["bearing_noise"] ** 2
    known = slice(0, 4 if given["depths_known"] else 5)
    return np.sqrt(np.trace(np.linalg.inv(J[known, known])[:2, :2]))


@pytest.mark.parametrize("changes", MEASURED.values(), ids=MEASURED)
def test_the_bound_is_that_of_a_regression(changes):
    trace = straight(*changes)
    found = least_error(trace, np.full((3, 4), DEPTH))[-1]
    np.testing.assert_allclose(found, [[expected(trace, w, i) for i in range(4)] for w in range(3)], rtol=1e-4)


def test_rms_error_and_bound_are_figures_of_merit():
    trace = straight("depth_least=9", "depth_most=19", "settling=30")
    off = np.random.default_rng(1).normal(0, 3, trace.node_way.shape)
    trace = replace(trace, node_estimate=trace.node_way + off)
    rms, bound = (task_metrics[name].values(trace) for name in ("track_error_rms", "track_bound"))
    np.testing.assert_allclose(rms, np.sqrt(np.square(off[29:]).sum(-1).mean((0, 2))), rtol=1e-6)
    np.testing.assert_allclose(
        bound, np.sqrt(np.square(least_error(trace, np.full((3, 4), DEPTH))[29:]).mean((0, 2))), rtol=1e-6
    )
