"""The tracker beside Stone Soup: the same model, fixes and gate give the same estimates to single precision.

Stone Soup (https://github.com/dstl/Stone-Soup, MIT licence) is in the extra `bench`.
"""

import math
from datetime import datetime, timedelta

import numpy as np
import pytest

from tests.kernels.positioning.test_tracker import EXTREME_CURRENT, begin, covariances, follow, second_of, simulate
from usvauv.kernels.positioning import tracker

pytest.importorskip("stonesoup")

START, SECOND = datetime(2026, 1, 1), timedelta(seconds=1)
ALLOWED = math.sqrt(-2 * math.log(1e-3))  # Mahalanobis distance


def by_stonesoup(start, velocity, adrift, fix, covariance, variance, correlation_time):
    """States (T, 4) and covariances (T, 4, 4) of one AUV after each step of 1 s, and which fixes were used (T,)."""
    from stonesoup.gater.distance import DistanceGater
    from stonesoup.hypothesiser.distance import DistanceHypothesiser
    from stonesoup.measures import Mahalanobis
    from stonesoup.models.control.linear import LinearControlModel
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel as Transition
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.types.detection import Detection
    from stonesoup.types.state import GaussianState, State
    from stonesoup.types.track import Track
    from stonesoup.updater.kalman import KalmanUpdater

    updater = KalmanUpdater(None)
    measure = Mahalanobis()
    state = GaussianState(start[:4, None].astype(float), covariances(start.astype(float)), timestamp=START)
    means, spreads, used = [], [], []
    for t in range(len(velocity)):
        F, Q = second_of(variance, correlation_time, adrift[t])
        motion = Transition(transition_matrix=F, covariance_matrix=Q)
        carry = KalmanPredictor(motion, LinearControlModel(control_matrix=adrift[t] * np.eye(4, 2)))
        xx, xy, yy = covariance[t]
        model = LinearGaussian(ndim_state=4, mapping=(0, 1), noise_covar=np.array([[xx, xy], [xy, yy]]))
        now = START + (t + 1) * SECOND
        detection = Detection(fix[t][:, None], timestamp=now, measurement_model=model)
        carried = carry.predict(state, timestamp=now, control_input=State(velocity[t][:, None]))
        stay = KalmanPredictor(Transition(transition_matrix=np.eye(4), covariance_matrix=np.zeros((4, 4))))
        gater = DistanceGater(DistanceHypothesiser(stay, updater, measure, missed_distance=np.inf), measure, ALLOWED)
        inside = [hypothesis for hypothesis in gater.hypothesise(Track([carried]), {detection}, now) if hypothesis]
        used.append(bool(inside))
        state = updater.update(inside[0]) if inside else carried
        means.append(np.asarray(state.state_vector, float)[:, 0])
        spreads.append(np.asarray(state.covar, float))
    return np.array(means), np.array(spreads), np.array(used)


@pytest.mark.parametrize("outliers", [0.0, 0.15])
def test_same_estimates_covariances_and_rejections(device, outliers):
    (start, covariance), (velocity, adrift, fix, R), _ = simulate(41, 150, 2, *EXTREME_CURRENT.values())
    random = np.random.default_rng(42)
    spoiled = random.random(fix.shape[:2]) < outliers
    fix[spoiled] += random.uniform(-150, 150, (spoiled.sum(), 2))
    start = begin(start, covariance, 0.22, device)
    track, _ = follow(device, start, velocity, adrift, fix, R, **EXTREME_CURRENT)
    for n in range(2):
        own = (array[:, n] for array in (velocity, adrift, fix, R))
        mean, spread, used = by_stonesoup(start[n].cpu().numpy(), *own, **EXTREME_CURRENT)
        assert np.array_equal(used, track[1:, n, tracker.REJECTIONS] == 0)
        assert (~used).sum() >= spoiled[:, n].sum() - 2
        assert np.abs(track[1:, n, :4] - mean).max() < 1e-3
        assert np.abs(covariances(track[1:, n]) - spread).max() < 3e-5
