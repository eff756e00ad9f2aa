"""Filters of Stone Soup on ranges of moving targets, for comparison; needs `pip install stonesoup`.

A target is taken to keep its velocity but for white noise of acceleration, of the density that makes its velocity vary
as turns do. `ParticleUpdater` with systematic resampling begins on the ring of the first range; `UnscentedKalman`
begins there too, with the ring's mean and covariance.
"""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import Any

import numpy as np
from stonesoup.base import Property
from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
from stonesoup.predictor.kalman import UnscentedKalmanPredictor
from stonesoup.predictor.particle import ParticlePredictor
from stonesoup.resampler.particle import SystematicResampler
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import GaussianState, ParticleState, StateVector, StateVectors
from stonesoup.updater.kalman import UnscentedKalmanUpdater
from stonesoup.updater.particle import ParticleUpdater

from tests.kernels.tracking.rules import NOISE, RUDDER_LEAST, RUDDER_MOST, STEP, WAY, YAW, Level

BEGIN = datetime(2026, 1, 1)


class Distance(NonLinearGaussianMeasurement):
    """The range from a place; states are x, v_x, y, v_y."""

    place: np.ndarray = Property(doc="m")

    @property
    def ndim_meas(self) -> int:
        return 1

    def function(self, state: Any, noise: Any = False, **unused: Any) -> Any:
        x, y = state.state_vector[0, :], state.state_vector[2, :]
        distance = np.hypot(np.asarray(x, float) - self.place[0], np.asarray(y, float) - self.place[1])
        values = StateVectors(distance[None]) if len(distance) > 1 else StateVector(distance)
        return values + (self.rvs(num_samples=len(distance)) if noise is True else 0 if noise is False else noise)


class StoneSoup:
    """F filters, particle filters or, with 0 particles, unscented Kalman filters, as `rules.simulate` takes them."""

    def __init__(self, count: int, level: Level, particles: int, seed: int) -> None:
        self.random, self.particles, self.time = np.random.default_rng(seed), particles, BEGIN
        np.random.seed(seed)
        self.fastest = WAY / STEP * level.fastest
        speed = WAY / STEP * 0.5 * (level.slowest + level.fastest)
        turns = -YAW * np.linspace(RUDDER_LEAST, RUDDER_MOST, 100)
        between = STEP * 0.5 * (level.least_interval + level.greatest_interval)
        density = speed**2 * float((1 - np.cos(turns)).mean()) / between  # half of E|Δv|² for each axis
        model = CombinedLinearGaussianTransitionModel([ConstantVelocity(density)] * 2)
        if particles:
            self.predictor: Any = ParticlePredictor(model)
            self.updater: Any = ParticleUpdater(None, resampler=SystematicResampler())
        else:
            self.predictor, self.updater = UnscentedKalmanPredictor(model), UnscentedKalmanUpdater(None)
        self.states: list[Any] = [None] * count
        self.known = np.zeros(count, bool)
        self.mean, self.covariance = np.zeros((count, 4)), np.tile(np.eye(2), (count, 1, 1))

    def predict(self) -> None:
        self.time += timedelta(seconds=STEP)
        self.states = [state and self.predictor.predict(state, timestamp=self.time) for state in self.states]

    def observe(self, place: np.ndarray, measured: np.ndarray, received: np.ndarray) -> None:
        for f in np.flatnonzero(received):
            if self.states[f] is None:
                self.states[f] = self.ring(place[f], measured[f])
                continue
            model = Distance(ndim_state=4, mapping=(0, 2), noise_covar=np.array([[NOISE**2]]), place=place[f])
            seen = Detection(StateVector([measured[f]]), timestamp=self.time, measurement_model=model)
            found = self.updater.update(SingleHypothesis(self.states[f], seen))
            found.hypothesis = None  # which holds all states before
            self.states[f] = found
        self.known |= received

    def ring(self, place: np.ndarray, distance: float) -> Any:
        """The state after the first range."""
        if not self.particles:
            moments = [distance**2 / 2 + NOISE**2, self.fastest**2 / 2] * 2
            return GaussianState([place[0], 0.0, place[1], 0.0], np.diag(moments), timestamp=self.time)
        number = self.particles
        angle, course = self.random.uniform(0, 2 * np.pi, (2, number))
        radius = distance + NOISE * self.random.standard_normal(number)
        speed = self.fastest * self.random.random(number)
        x, y = place[0] + radius * np.cos(angle), place[1] + radius * np.sin(angle)
        states = StateVectors(np.stack([x, speed * np.cos(course), y, speed * np.sin(course)]))
        return ParticleState(states, weight=np.full(number, 1 / number), timestamp=self.time)

    def finish(self) -> None:
        for f, state in enumerate(self.states):
            if state is not None:
                self.mean[f] = np.asarray(state.mean, float).ravel()[[0, 2, 1, 3]]
                self.covariance[f] = np.asarray(state.covar, float)[np.ix_([0, 2], [0, 2])] + 1e-3 * np.eye(2)
