"""Dead reckoning, what is told of it and what is expected by it: beside NumPy's filter of four states per AUV.

The worlds are no mission's: arrays of random numbers with what the functions read. Of the sensor's noise the
distribution is checked, all else to rounding.
"""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import taichi as ti
import torch

from tests.kernels.mission.stub import StubWorlds, unchanged
from usvauv.kernels.mission import navigation
from usvauv.kernels.mission.columns import AuvColumn, EstimateColumn, ExchangeColumn, Sensor
from usvauv.kernels.positioning import tracker

WORLDS, AUVS = 300, 2
NUMBERS = {
    "step": 0.5,
    "current_variance": 9e-3,
    "correlation_time": 40.0,
    "velocity_walk": 4e-3,
    "velocity_bias": 0.2,
    "bias_memory": 0.8,
    "velocity_variance": 0.7,
    "velocity_memory": 25.0,
    "gnss_error": 0.4,
    "gnss_time": 60.0,
}
COVARIANCE = [  # of x, y, u, v in the columns of a track
    [tracker.XX, tracker.XY, tracker.XU, tracker.XV],
    [tracker.XY, tracker.YY, tracker.YU, tracker.YV],
    [tracker.XU, tracker.YU, tracker.UU, tracker.UV],
    [tracker.XV, tracker.YV, tracker.UV, tracker.VV],
]
STATE = [tracker.X, tracker.Y, tracker.CURRENT_X, tracker.CURRENT_Y]
WATER, GROUND = (SimpleNamespace(sensor=sensor) for sensor in (Sensor.water, Sensor.ground))


@ti.func
def _send(worlds: ti.template(), w, k):
    navigation.send(worlds, w, k, 0.125)


class Fleet:
    """Random worlds before a function has been called."""

    def __init__(self, device: torch.device) -> None:
        r = np.random.default_rng(6)
        shape = WORLDS, AUVS
        track, own = (np.zeros((*shape, tracker.COLUMNS)) for _ in range(2))
        for each in (track, own):
            root = r.normal(size=(*shape, 4, 4)) * [[2.0], [3.0], [0.2], [0.1]]
            P = root @ np.swapaxes(root, -1, -2)
            for i in range(4):
                for j in range(4):
                    each[..., COVARIANCE[i][j]] = P[..., i, j]
            each[..., STATE] = r.uniform(-1, 1, (*shape, 4)) * [200, 300, 0.3, 0.2]
            each[..., tracker.REJECTED_AGE] = r.uniform(0, 9, shape)
        exchange = r.uniform(0.5, 2.0, (*shape, len(ExchangeColumn.names)))
        exchange[..., ExchangeColumn.elapsed] += r.uniform(0, 60, shape)
        auv = r.uniform(-1, 1, (*shape, len(AuvColumn.names)))
        auv[..., [AuvColumn.hovering, AuvColumn.border]] = np.eye(3)[r.integers(0, 3, shape)][..., :2]
        estimate = r.uniform(1, 5, (*shape, len(EstimateColumn.names)))
        arrays = {"auv": auv, "estimate": estimate, "exchange": exchange, "track": track, "own": own}
        self.worlds = StubWorlds(device, NUMBERS, worlds=WORLDS, auvs=AUVS, **arrays)
        self.before = self.worlds.numbers()

    def after(self, function: Any, program: Any = WATER) -> dict[str, np.ndarray]:
        """All arrays after a function (worlds, w, k) has been called for each AUV."""

        @ti.func
        def of_all(worlds: ti.template(), w):
            for k in range(worlds.auv.shape[1]):
                function(worlds, w, k)

        return self.worlds.after(of_all, program)


@pytest.fixture
def fleet(device):
    return Fleet(device)


def moments(track: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """State (..., 4) and covariance (..., 4, 4)."""
    return track[..., STATE], np.stack([np.stack([track[..., c] for c in row], -1) for row in COVARIANCE], -2)


def moved(track: np.ndarray, carried: np.ndarray, adrift: np.ndarray, time: np.ndarray):
    """State and covariance after a displacement (..., 2), of which a part (..., s) is adrift in the time (..., s).

    The current is a Gauss–Markov process; while the AUV is adrift it moves it.
    """
    x, P = moments(track)
    variance, tau = NUMBERS["current_variance"], NUMBERS["correlation_time"]
    eye = np.eye(2)
    for span, moves in ((adrift, 1.0), (time - adrift, 0.0)):
        t = np.asarray(span)[..., None, None] / tau
        kept = np.exp(-t)
        f = 1 - kept
        zero = np.zeros_like(kept * eye)
        F = np.concatenate(
            [np.concatenate([eye + zero, moves * tau * f * eye], -1), np.concatenate([zero, kept * eye], -1)], -2
        )
        spreading = 2 * t - 3 + 4 * np.exp(-t) - np.exp(-2 * t)
        place, cross = (moves * variance * part * eye for part in (tau**2 * spreading, tau * f**2))
        current = variance * (1 - kept**2) * eye
        Q = np.concatenate([np.concatenate([place, cross], -1), np.concatenate([cross, current], -1)], -2)
        x = (F @ x[..., None])[..., 0]
        P = F @ P @ np.swapaxes(F, -1, -2) + Q
    x[..., :2] += carried
    gnss = 2 * NUMBERS["gnss_error"] ** 2 * (1 - np.exp(-np.asarray(time) / NUMBERS["gnss_time"]))
    white = NUMBERS["velocity_walk"] * np.asarray(adrift) + gnss
    P[..., [0, 1], [0, 1]] += white[..., None]
    return x, P


def check(track: np.ndarray, expected: tuple[np.ndarray, np.ndarray]) -> None:
    for found, wanted in zip(moments(track), expected, strict=True):
        np.testing.assert_allclose(found, wanted, rtol=2e-4, atol=2e-4 if wanted.ndim == 3 else 1e-4)


EVERY = list(range(tracker.COLUMNS))
STEP = [ExchangeColumn.step_x, ExchangeColumn.step_y]
WAY = [ExchangeColumn.way_x, ExchangeColumn.way_y]
BIAS = [ExchangeColumn.bias_x, ExchangeColumn.bias_y]


@pytest.mark.parametrize("program", [WATER, GROUND], ids=["water", "ground"])
def test_reckoning(fleet, program):
    """The own filter moves by what is measured; that has a Gauss–Markov bias and a white error of the right sizes."""
    before, after = fleet.before, fleet.after(navigation.reckon, program)
    auv, old, new = before["auv"], before["exchange"], after["exchange"]
    holds = (auv[..., AuvColumn.hovering] + auv[..., AuvColumn.border] > 0) & (program is WATER)
    adrift = np.where(holds, 0.0, 0.5)
    columns = [AuvColumn.water_x, AuvColumn.water_y] if program is WATER else [AuvColumn.moved_x, AuvColumn.moved_y]
    true = auv[..., columns] * (adrift[..., None] if program is WATER else 1.0)
    fresh = new[..., BIAS] - 0.8 * old[..., BIAS]
    white = new[..., STEP] - true - adrift[..., None] * new[..., BIAS]
    walks = ~holds
    assert (np.abs(white[holds]) < 1e-6).all()
    assert walks.mean() > 0.1
    normal = fresh[walks] / (0.2 * math.sqrt(1 - 0.8**2)), white[walks] / math.sqrt(4e-3 * 0.5)
    numbers = np.concatenate(normal, axis=1)
    bound = 4 / math.sqrt(len(numbers))
    assert np.abs(np.corrcoef(numbers.T) - np.eye(4)).max() < bound
    assert np.abs(numbers.mean(0)).max() < bound
    assert np.abs(numbers.std(0) - 1).max() < bound
    for wanted, columns in ((old[..., WAY] + new[..., STEP], WAY), (adrift, [ExchangeColumn.step_adrift])):
        np.testing.assert_allclose(new[..., columns].squeeze(), wanted, rtol=1e-6)
    for column, more in ((ExchangeColumn.adrift, adrift), (ExchangeColumn.elapsed, 0.5)):
        np.testing.assert_allclose(new[..., column], old[..., column] + more, rtol=1e-6)
    check(after["own"], moved(before["own"], new[..., STEP], adrift, np.full(adrift.shape, 0.5)))
    others = [ExchangeColumn.step_adrift, ExchangeColumn.adrift, ExchangeColumn.elapsed]
    unchanged(after, before, {"own": EVERY, "exchange": [*BIAS, *STEP, *WAY, *others]})


def test_an_auv_is_told_the_boats_filter(fleet):
    """It moves that on by all it has measured since the reply of which the filter is."""
    before, after = fleet.before, fleet.after(navigation.tell)
    exchange = before["exchange"]
    adrift, elapsed = exchange[..., ExchangeColumn.adrift], exchange[..., ExchangeColumn.elapsed]
    check(after["own"], moved(before["track"], exchange[..., WAY], adrift, elapsed))
    rest = [c for c in EVERY if c not in {*STATE, *np.ravel(COVARIANCE)}]
    np.testing.assert_array_equal(after["own"][..., rest], before["track"][..., rest])
    unchanged(after, before, {"own": EVERY})


def test_what_a_reply_carries(fleet):
    """A quarter of the last step lies after its departure."""
    before, after = fleet.before, fleet.after(_send)
    old, new = before["exchange"], after["exchange"]
    wanted = {
        "sent_way_x": old[..., ExchangeColumn.way_x] - old[..., ExchangeColumn.step_x] / 4,
        "sent_way_y": old[..., ExchangeColumn.way_y] - old[..., ExchangeColumn.step_y] / 4,
        "sent_adrift": old[..., ExchangeColumn.adrift] - old[..., ExchangeColumn.step_adrift] / 4,
        "sent_elapsed": old[..., ExchangeColumn.elapsed] - 0.125,
        "sent_velocity_x": old[..., ExchangeColumn.step_x] / 0.5,
        "sent_velocity_y": old[..., ExchangeColumn.step_y] / 0.5,
        "sent_heads_for": before["auv"][..., AuvColumn.target],
        "sent_hovers": before["auv"][..., AuvColumn.hover],
    }
    for name, value in wanted.items():
        np.testing.assert_allclose(new[..., getattr(ExchangeColumn, name)], value, rtol=1e-5, atol=1e-6, err_msg=name)
    unchanged(after, before, {"exchange": [getattr(ExchangeColumn, name) for name in wanted]})


def test_what_a_boat_makes_of_a_reply(fleet):
    """Its filter moves to the time when the reply left; what was measured after that is still to come."""
    before, after = fleet.before, fleet.after(navigation.hear)
    old, new = before["exchange"], after["exchange"]
    way = old[..., [ExchangeColumn.sent_way_x, ExchangeColumn.sent_way_y]]
    adrift, elapsed = old[..., ExchangeColumn.sent_adrift], old[..., ExchangeColumn.sent_elapsed]
    check(after["track"], moved(before["track"], way, adrift, elapsed))
    rejected = before["track"][..., tracker.REJECTED_AGE] + elapsed
    np.testing.assert_allclose(after["track"][..., tracker.REJECTED_AGE], rejected, rtol=1e-6)
    wanted = {
        "way_x": old[..., ExchangeColumn.way_x] - way[..., 0],
        "way_y": old[..., ExchangeColumn.way_y] - way[..., 1],
        "adrift": old[..., ExchangeColumn.adrift] - adrift,
        "elapsed": old[..., ExchangeColumn.elapsed] - elapsed,
        **{
            name: old[..., getattr(ExchangeColumn, f"sent_{name}")]
            for name in ("velocity_x", "velocity_y", "heads_for", "hovers")
        },
    }
    for name, value in wanted.items():
        np.testing.assert_allclose(new[..., getattr(ExchangeColumn, name)], value, rtol=1e-5, atol=1e-5, err_msg=name)
    changed = [getattr(ExchangeColumn, name) for name in wanted]
    unchanged(after, before, {"exchange": changed, "track": EVERY})


def test_where_an_auv_is_expected(fleet):
    """On from the track by the last velocity and the current while a Gauss–Markov velocity lasts."""
    before, after = fleet.before, fleet.after(navigation.expect)
    x, P = moments(before["track"])
    exchange = before["exchange"]
    t = exchange[..., ExchangeColumn.elapsed] / 25.0
    reach = 25.0 * (1 - np.exp(-t))
    velocity = exchange[..., [ExchangeColumn.velocity_x, ExchangeColumn.velocity_y]] + x[..., 2:]
    F = np.zeros((WORLDS, AUVS, 2, 4))
    F[..., [0, 1], [0, 1]] = 1.0
    F[..., [0, 1], [2, 3]] = reach[..., None]
    C = F @ P @ np.swapaxes(F, -1, -2)
    C[..., [0, 1], [0, 1]] += (0.7 * 25.0**2 * (2 * t - 3 + 4 * np.exp(-t) - np.exp(-2 * t)))[..., None]
    place = [EstimateColumn.x, EstimateColumn.y]
    spread = [EstimateColumn.covariance_xx, EstimateColumn.covariance_xy, EstimateColumn.covariance_yy]
    wanted = np.stack([C[..., 0, 0], C[..., 0, 1], C[..., 1, 1]], -1)
    np.testing.assert_allclose(
        after["estimate"][..., place], x[..., :2] + reach[..., None] * velocity, rtol=1e-4, atol=1e-3
    )
    np.testing.assert_allclose(after["estimate"][..., spread], wanted, rtol=1e-3, atol=1e-3)
    unchanged(after, before, {"estimate": [*place, *spread]})


def test_both_filters_begin_at_the_estimate(fleet):
    """In an unknown current, with a bias in its stationary state; nothing has been measured."""
    before, after = fleet.before, fleet.after(navigation.begin)
    estimate = before["estimate"]
    for name in ("track", "own"):
        x, P = moments(after[name])
        np.testing.assert_array_equal(x[..., :2], estimate[..., [EstimateColumn.x, EstimateColumn.y]])
        np.testing.assert_array_equal(x[..., 2:], 0)
        names = ("covariance_xx", "covariance_xy", "covariance_xy", "covariance_yy")
        place = np.stack([estimate[..., getattr(EstimateColumn, each)] for each in names], -1)
        np.testing.assert_array_equal(P[..., :2, :2].reshape(WORLDS, AUVS, 4), place)
        np.testing.assert_allclose(P[..., 2:, 2:], 9e-3 * np.eye(2) + np.zeros((WORLDS, AUVS, 2, 2)), rtol=1e-6)
        assert (P[..., :2, 2:] == 0).all()
    bias = after["exchange"][..., BIAS].reshape(-1, 2) / 0.2
    bound = 4 / math.sqrt(len(bias))
    assert np.abs(bias.std(0) - 1).max() < bound
    assert np.abs(bias.mean(0)).max() < bound
    assert abs(np.corrcoef(bias.T)[0, 1]) < bound
    assert (np.delete(after["exchange"], BIAS, -1) == 0).all()


@pytest.mark.parametrize(("sensor", "column"), [(Sensor.none, "estimate"), (Sensor.water, "own")])
def test_where_an_auv_takes_itself_to_be(fleet, sensor, column):
    @ti.func
    def read(worlds: ti.template(), w, k):
        place = navigation.own_position(worlds, w, k)
        worlds.auv[w, k, AuvColumn.x] = place[0]
        worlds.auv[w, k, AuvColumn.y] = place[1]

    after = fleet.after(read, SimpleNamespace(sensor=sensor))
    places = {
        "own": fleet.before["own"][..., [tracker.X, tracker.Y]],
        "estimate": fleet.before["estimate"][..., [EstimateColumn.x, EstimateColumn.y]],
    }
    np.testing.assert_array_equal(after["auv"][..., [AuvColumn.x, AuvColumn.y]], places[column])
