"""How a boat fixes an AUV, and what it then knows of it: beside NumPy, for two boats and three AUVs in random states.

Most signals are so strong that their noise is a millimetre, while all other errors are large. Rays, and the covariances
of an offset, are those of `usvauv.kernels.positioning`, which has tests of its own.
"""

import math
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
import taichi as ti
import torch
from scipy import stats

from tests.kernels.mission.stub import StubWorlds, unchanged
from tests.kernels.mission.test_navigation import COVARIANCE, STATE, moments
from usvauv.kernels.mission import channel, fixes, navigation, reception, serving
from usvauv.kernels.mission.columns import (
    AuvColumn,
    BoatColumn,
    EstimateColumn,
    ExchangeColumn,
    Refraction,
    Reply,
    Schedule,
    Sensor,
)
from usvauv.kernels.positioning import acoustic_link, coded_pulse, codes, rays, reflections, tracker, usbl
from usvauv.kernels.positioning.acoustic_link import Accuracy, Sonar, link_table
from usvauv.kernels.positioning.layered_water import layer_table, sound_speed
from usvauv.kernels.positioning.validation import GATE
from usvauv.kernels.types import array1, array2, array3, mat3, vec3

WORLDS, AUVS, BOATS = 400, 3, 2
NUMBERS = {
    "step": 0.5,
    "tilt": 1.0,
    "attitude_error": 0.02,
    "alignment_error": 0.03,
    "heading_error": 0.04,
    "sound_speed_error": 0.01,
    "lever_arm_error": 0.5,
    "separation_boat": 90.0,
    "latency": 0.2,
    "propagates": 1.0,
    "sound_speed": 1480.0,
    "auv_speed": 3.0,
    "current_variance": 9e-3,
    "correlation_time": 40.0,
    "gnss_error": 0.4,
    "gnss_time": 60.0,
    "velocity_walk": 4e-3,
    "velocity_variance": 0.7,
    "velocity_memory": 25.0,
}
C = NUMBERS["sound_speed"]
ACCURACY = Accuracy(attitude=0.02, alignment=0.03, heading=0.04, sound_speed=0.01, position=0.8)
PLACE = [EstimateColumn.x, EstimateColumn.y]
SPREAD = [EstimateColumn.covariance_xx, EstimateColumn.covariance_xy, EstimateColumn.covariance_yy]
FIX, HEARD = [AuvColumn.fix_x, AuvColumn.fix_y], [AuvColumn.heard_x, AuvColumn.heard_y]
OF_FIX = [AuvColumn.covariance_xx, AuvColumn.covariance_xy, AuvColumn.covariance_yy]
SHALLOW, DEEP = 1520.0, 1440.0
LAYERS = layer_table(np.array([-20.0, 0.0, 200.0]), np.array([SHALLOW, SHALLOW, DEEP]))


def program(**choices) -> SimpleNamespace:
    """What is compiled: a fleet that fixes AUVs by the statistical model, and what is chosen."""
    plain = {"waveform": False, "multipath": False, "refraction": Refraction.none, "turns": False, "tracker": False,
             "schedule": Schedule.every_step}  # fmt: skip
    return SimpleNamespace(**{**plain, "sensor": Sensor.none, "fleet": True, **choices})


def fleet(
    device: torch.device,
    *,
    level: float = 240.0,
    spacing: float = 0.02,
    accuracy: Accuracy = ACCURACY,
    **numbers: float,
) -> StubWorlds:
    r = np.random.default_rng(11)
    sonar = Sonar(
        source_level=level,
        path="transponder",
        spreading=20.0,
        absorption=lambda f: 4.0,
        signal="code",
        bandwidth=4000.0,
        spacing=spacing,
        sound_speed=C,
        ambient_noise=lambda f, shipping, wind: 20.0,
        own_noise=lambda f: 25.0,
        accuracy=accuracy,
    )
    shapes = {"auv": (AUVS, AuvColumn), "boat": (BOATS, BoatColumn), "estimate": (AUVS, EstimateColumn)}
    arrays = {name: r.uniform(0.5, 1, (WORLDS, count, len(of.names))) for name, (count, of) in shapes.items()}
    auv, boat, estimate = arrays.values()
    boat[..., [BoatColumn.x, BoatColumn.y]] = r.uniform(-200, 200, (WORLDS, BOATS, 2))
    boat[..., [BoatColumn.moved_x, BoatColumn.moved_y]] = r.uniform(-3, 3, (WORLDS, BOATS, 2))
    boat[..., BoatColumn.elevation] = r.uniform(-4, 4, (WORLDS, BOATS))
    boat[..., [BoatColumn.slope_x, BoatColumn.slope_y]] = r.uniform(-0.3, 0.3, (WORLDS, BOATS, 2))
    boat[..., [BoatColumn.gnss_x, BoatColumn.gnss_y]] = r.normal(size=(WORLDS, BOATS, 2))
    boat[..., BoatColumn.effort] = r.choice([0.2, 1.0], (WORLDS, BOATS))
    by = estimate[..., EstimateColumn.served_by] = r.integers(0, BOATS, (WORLDS, AUVS))
    away = r.uniform(-1, 1, (WORLDS, AUVS, 2)) * r.choice([80.0, 400.0], (WORLDS, AUVS, 1))
    auv[..., : AuvColumn.y + 1] = np.take_along_axis(boat[..., :2], by[..., None].astype(int), 1) + away
    auv[..., [AuvColumn.moved_x, AuvColumn.moved_y]] = r.uniform(-2, 2, (WORLDS, AUVS, 2))
    estimate[..., PLACE] = auv[..., :2] + r.normal(size=(WORLDS, AUVS, 2)) * r.choice([3.0, 60.0], (WORLDS, AUVS, 1))
    estimate[..., SPREAD] = np.stack([r.uniform(5, 90, (WORLDS, AUVS)) for _ in SPREAD], -1) * [1, 0.05, 1]
    estimate[..., EstimateColumn.age] = r.choice([0.5, 4.0, 30.0], (WORLDS, AUVS))
    track = r.uniform(0, 1, (WORLDS, AUVS, tracker.COLUMNS))
    root = r.normal(size=(WORLDS, AUVS, 4, 4)) * [[5.0], [6.0], [0.2], [0.1]]
    P = root @ np.swapaxes(root, -1, -2)
    for i in range(4):
        for j in range(4):
            track[..., COVARIANCE[i][j]] = P[..., i, j]
    track[..., STATE] = np.concatenate([estimate[..., PLACE], r.uniform(-0.5, 0.5, (WORLDS, AUVS, 2))], -1)
    track[..., tracker.ADRIFT] = r.integers(0, 2, (WORLDS, AUVS))
    track[..., tracker.REJECTIONS] = 0.0
    link = link_table([25e3 + 2000 * k for k in range(AUVS)], sonar)
    exchange = r.uniform(0.5, 2.0, (WORLDS, AUVS, len(ExchangeColumn.names)))
    exchange[..., ExchangeColumn.reply] = r.choice([Reply.sent, Reply.sent, Reply.lost], (WORLDS, AUVS))
    exchange[..., [ExchangeColumn.sent_x, ExchangeColumn.sent_y]] = auv[..., :2] + r.uniform(-2, 2, (WORLDS, AUVS, 2))
    others = {"track": track, "exchange": exchange, "layers": LAYERS, "link": link}
    return StubWorlds(device, {**NUMBERS, **numbers}, worlds=WORLDS, auvs=AUVS, boats=BOATS, **arrays, **others)


@ti.func
def write_pose(worlds: ti.template(), w):
    """The poses of the arrays of all boats, boat b's into the observation of AUV b."""
    for b in range(worlds.boat.shape[1]):
        pose = reception.array_pose(worlds, w, b)
        for i in ti.static(range(3)):
            for j in ti.static(range(3)):
                worlds.observation[w, b, 3 * i + j] = pose.axes[i, j]
                worlds.observation[w, b, 9 + 3 * i + j] = pose.measured[i, j]
        for c in ti.static(range(2)):
            worlds.observation[w, b, 18 + c] = pose.displaced[c]
        worlds.observation[w, b, 20] = pose.slowness
        worlds.observation[w, b, 21] = pose.effort
        worlds.observation[w, b, 22] = pose.boat


@ti.func
def take(worlds: ti.template(), w):
    for b in range(2 if ti.static(worlds.program.fleet) else 1):
        fixes.take_fixes(worlds, w, b)
    write_pose(worlds, w)


AGE = 0.3  # s, of replies


@ti.func
def receive(worlds: ti.template(), w):
    for k in range(AUVS):
        pose = reception.array_pose(worlds, w, serving.server(worlds, w, k))
        channel.receive(worlds, pose, w, k, AGE)
        fixes.finish(worlds, pose, w, k)
    write_pose(worlds, w)


@ti.func
def hear(worlds: ti.template(), w):
    for k in range(AUVS):
        navigation.hear(worlds, w, k)


@ti.func
def expect(worlds: ti.template(), w):
    for k in range(AUVS):
        navigation.expect(worlds, w, k)


def test_errors_of_the_array(device):
    """Pitch and roll err anew in each step, mounting, heading, lever arm and speed of sound for the episode."""
    made = fleet(device, tilt=0.5)
    before = made.numbers()["boat"]
    drawn = []
    for step in (7, 8):
        made.arrays["clock"][:, 1] = step
        found = made.after(write_pose)["observation"][:, :BOATS]
        axes, measured = (found[..., first : first + 9].reshape(WORLDS, BOATS, 3, 3) for first in (0, 9))
        slope = 0.5 * before[..., [BoatColumn.slope_x, BoatColumn.slope_y]]
        forward = np.stack([np.ones_like(slope[..., 0]), 0 * slope[..., 0], slope[..., 0]], -1)
        forward /= np.linalg.norm(forward, axis=-1, keepdims=True)
        up = np.stack([-slope[..., 0], -slope[..., 1], np.ones_like(slope[..., 0])], -1)
        up /= np.linalg.norm(up, axis=-1, keepdims=True)  # the water's normal; no part of forward lies along it
        np.testing.assert_allclose(axes, np.stack([forward, np.cross(up, forward), up], -2), atol=1e-5)
        np.testing.assert_allclose(found[..., 21], before[..., BoatColumn.effort], rtol=1e-6)
        np.testing.assert_array_equal(found[..., 22], np.broadcast_to(np.arange(BOATS), (WORLDS, BOATS)))

        def angles(A):
            return (
                np.arcsin(A[..., 0, 2]),
                np.arctan2(A[..., 1, 2], A[..., 2, 2]),
                np.arctan2(A[..., 0, 1], A[..., 0, 0]),
            )

        errors = [a - b for a, b in zip(angles(measured), angles(axes), strict=True)]
        arm = found[..., 18:20] - before[..., [BoatColumn.gnss_x, BoatColumn.gnss_y]]
        drawn.append(np.concatenate([np.stack([*errors, 1 / found[..., 20] - 1], -1), arm], -1))
    np.testing.assert_allclose(drawn[0][..., 2:], drawn[1][..., 2:], atol=1e-4)
    rows = np.concatenate([drawn[0], drawn[1][..., :2]], -1).reshape(WORLDS, -1)  # (BOATS · 8)
    wanted = np.diag([0.02**2 + 0.03**2] * 2 + [0.04**2, 0.01**2, 0.5**2, 0.5**2] + [0.02**2 + 0.03**2] * 2)
    wanted[[0, 1, 6, 7], [6, 7, 0, 1]] = 0.03**2
    deviation = np.tile(np.sqrt(np.diag(wanted)), BOATS)
    found = rows.T @ rows / WORLDS / np.outer(deviation, deviation)
    both = np.kron(np.eye(BOATS), wanted) / np.outer(deviation, deviation)
    assert np.abs(found - both).max() < 5 * math.sqrt(2 / WORLDS)


@ti.kernel
def _judge(link: array2, offset: array2, axes: array2, effort: array1, out: array2):
    for n in range(effort.shape[0]):
        k = n % link.shape[0]
        away = vec3(offset[n, 0], offset[n, 1], offset[n, 2])
        A = mat3(0.0)
        for i in ti.static(range(3)):
            for j in ti.static(range(3)):
                A[i, j] = axes[n, 3 * i + j]
        loss = acoustic_link.further_loss(link, k, away, effort[n])
        out[n, 0] = acoustic_link.phase_deviation(link, k, away.norm(), loss)
        own = usbl.horizontal_covariance(link, k, away, A, out[n, 0])
        common = usbl.systematic_covariance(link, k, away, A)
        for c in ti.static(range(3)):
            out[n, 1 + c] = own[c]
            out[n, 4 + c] = common[c]


@ti.kernel
def _bend(layers: array2, depth: array1, offset: array2, c: ti.f32, out: array2):
    for n in range(depth.shape[0]):
        ray = rays.refracted(layers, depth[n], depth[n], vec3(offset[n, 0], offset[n, 1], offset[n, 2]), c)
        for j in ti.static(range(3)):
            out[n, j] = ray.direction[j]
        out[n, 3] = ray.slant_range
        out[n, 4] = ti.cast(ray.exists, ti.f32)
        out[n, 5] = c / sound_speed(layers, depth[n])


class Expected:
    """Fixes of all AUVs by NumPy, (WORLDS, AUVS, …), each by the boat that serves it."""

    def __init__(self, made: StubWorlds, before: dict, poses: np.ndarray, chosen: SimpleNamespace) -> None:
        self.made, self.chosen = made, chosen
        estimate, self.auv = before["estimate"], before["auv"]
        self.by = estimate[..., EstimateColumn.served_by].astype(int) * chosen.fleet

        def own(rows: np.ndarray) -> np.ndarray:
            return np.take_along_axis(rows, self.by[..., None], 1)

        self.boat, pose = own(before["boat"]), own(poses)
        self.axes, self.measured = (pose[..., first : first + 9].reshape(WORLDS, AUVS, 3, 3) for first in (0, 9))
        self.displaced, self.slowness, self.effort = pose[..., 18:20], pose[..., 20], pose[..., 21]
        self.z = -(90.0 + self.boat[..., BoatColumn.elevation])
        self.true = self.auv[..., : AuvColumn.y + 1]
        self.kappa = before["link"][:, acoustic_link.KAPPA]

    def back(self, age: np.ndarray | float) -> np.ndarray:
        """Where the boats were some time before the end of the step."""
        moved = self.boat[..., [BoatColumn.moved_x, BoatColumn.moved_y]]
        return self.boat[..., :2] - np.asarray(age)[..., None] / 0.5 * moved

    def device(self, *arrays: np.ndarray) -> list[torch.Tensor]:
        to = self.made.arrays["p"]
        return [to.new_tensor(a.reshape(WORLDS * AUVS, -1).squeeze(-1) if a.ndim == 2 else a.reshape(WORLDS * AUVS, -1))
                for a in arrays]  # fmt: skip

    def judged(self, offset: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Phase deviation, covariance of a fix's own errors and of those in common at offsets from the array."""
        out = self.made.arrays["p"].new_zeros((WORLDS * AUVS, 7))
        _judge(self.made.arrays["link"], *self.device(offset, self.axes, self.effort), out)
        found = out.double().cpu().numpy().reshape(WORLDS, AUVS, 7)
        return found[..., 0], found[..., 1:4], found[..., 4:]

    def hear(self, here: np.ndarray, there: np.ndarray) -> None:
        """What comes of signals that left `there`."""
        offset = np.concatenate([there - here, self.z[..., None]], -1)
        S = np.linalg.norm(offset, axis=-1)
        direction, path, self.exists = offset / S[..., None], S, np.ones((WORLDS, AUVS), bool)
        self.length = np.ones((WORLDS, AUVS))
        if self.chosen.refraction != Refraction.none:
            out = self.made.arrays["p"].new_zeros((WORLDS * AUVS, 6))
            depth, away = self.device(-self.boat[..., BoatColumn.elevation], offset)
            _bend(self.made.arrays["layers"], depth, away, C, out)
            bent = out.double().cpu().numpy().reshape(WORLDS, AUVS, 6)
            direction, path, self.exists = bent[..., :3], bent[..., 3], bent[..., 4] > 0
            if self.chosen.refraction == Refraction.corrected:
                self.length = bent[..., 5]
        self.here = here
        self.range = self.slowness * path
        self.body = self.slowness[..., None] * (self.axes @ direction[..., None])[..., 0]
        self.phase = self.kappa[:, None] * self.body[..., :2]

    def located(self, phase: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Offsets by phase differences, and whether these have no real depth."""
        across = phase / self.kappa[:, None]
        square = self.length**2 - (across**2).sum(-1)
        vector = np.concatenate([across, -np.sqrt(np.maximum(square, 0))[..., None]], -1)
        vector = (np.swapaxes(self.measured, -1, -2) @ vector[..., None])[..., 0]
        if self.chosen.refraction != Refraction.corrected:
            return self.range[..., None] * vector, square < 0
        depth, arrival = self.device(-self.boat[..., BoatColumn.elevation],
                                     np.concatenate([vector[..., :2], -np.ones_like(vector[..., :1]),
                                                     self.range[..., None]], -1))  # fmt: skip
        place = rays.positions(self.made.arrays["layers"], depth, arrival, C)
        return place.double().cpu().numpy().reshape(WORLDS, AUVS, 3), square < 0

    def squared(self, innovation: np.ndarray, *covariances: np.ndarray) -> np.ndarray:
        """Normalised innovation squared."""
        c = sum(covariances)[..., [0, 1, 1, 2]].reshape(WORLDS, AUVS, 2, 2)
        return np.einsum("wki,wkij,wkj->wk", innovation, np.linalg.inv(c), innovation)

    def turned(self, expected: np.ndarray, covariance: np.ndarray, reach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Phases with the whole turns of the least badness, and by how much the next one is worse."""
        wrapped = self.phase - 2 * math.pi * np.round(self.phase / (2 * math.pi))
        odd = np.round((self.phase - wrapped) / (2 * math.pi)).sum(-1) % 2
        best, second = np.full((WORLDS, AUVS), 1e30), np.full((WORLDS, AUVS), 1e30)
        phase = wrapped.copy()
        for m in range(-2, 3):
            for n in range(-2, 3):
                candidate = wrapped + 2 * math.pi * np.array([m, n])
                possible = ((m + n) % 2 == odd) & (np.linalg.norm(candidate, axis=-1) <= self.length * self.kappa)
                offset, _ = self.located(candidate)
                sigma, own, _ = self.judged(offset)
                away = offset[..., :2] - expected
                away *= np.maximum(1 - reach / np.linalg.norm(away, axis=-1), 0)[..., None]
                S2 = (offset**2).sum(-1)
                error = np.linalg.norm(offset[..., :2], axis=-1) - np.sqrt(np.maximum(S2 - self.z**2, 0))
                variance = S2 * ((sigma / self.kappa) ** 2 + 0.02**2 + 0.01**2)
                badness = np.minimum(self.squared(away, covariance, own), 2 * GATE) + error**2 / variance
                badness = np.where(possible, badness, 1e30)
                better = badness < best
                second = np.where(better, best, np.minimum(badness, second))
                best = np.where(better, badness, best)
                phase[better] = candidate[better]
        return phase, second - best


CASES = {
    "straight": program(),
    "late, by a tracker": program(tracker=True),
    "bent and wide": program(refraction=Refraction.ignored, turns=True),
    "one boat, corrected, wide, by a tracker": program(
        refraction=Refraction.corrected, turns=True, tracker=True, fleet=False
    ),
    "replies": program(schedule=Schedule.all),
    "replies that tell a way": program(schedule=Schedule.all, sensor=Sensor.ground, turns=True),
}


@pytest.mark.parametrize("chosen", CASES.values(), ids=CASES)
def test_fixes_and_what_is_known_by_them(device, chosen):
    made, other = (fleet(device, spacing=0.06 if chosen.turns else 0.02) for _ in range(2))
    replies, reckons = chosen.schedule == Schedule.all, chosen.sensor != Sensor.none
    before, after = made.numbers(), made.after(receive if replies else take, chosen)
    its = Expected(made, before, after["observation"], chosen)
    estimate, track, exchange = before["estimate"], before["track"], before["exchange"]
    place, spread = estimate[..., PLACE], estimate[..., SPREAD]
    x, P = moments(track)
    lost = np.zeros((WORLDS, AUVS), bool)
    reach = 3.0 * estimate[..., EstimateColumn.age]
    lag, carried = np.zeros((WORLDS, AUVS)), np.zeros((WORLDS, AUVS, 2))
    if replies:
        lost = exchange[..., ExchangeColumn.reply] == Reply.lost
        there = exchange[..., [ExchangeColumn.sent_x, ExchangeColumn.sent_y]]
        its.hear(its.back(AGE + 0 * reach), there)
    else:
        now = np.sqrt(((its.true - its.back(0 * reach)) ** 2).sum(-1) + its.z**2)
        age = 0.2 + now / C
        there = its.true - age[..., None] / 0.5 * its.auv[..., [AuvColumn.moved_x, AuvColumn.moved_y]]
        its.hear(its.back(0.2 + 0 * age), there)
    if chosen.tracker:
        lag = age * track[..., tracker.ADRIFT]
        carried = lag[..., None] * track[..., [tracker.WATER_X, tracker.WATER_Y]]
        x, P = moved(x, P, -carried, -lag)
        place, spread, reach = x[..., :2], P[..., [0, 0, 1], [0, 1, 1]], 0 * reach
    if reckons:
        reach = 0 * reach + 3.0 * (0.5 + AGE)
        told = moments(other.after(hear)["track"])
        x, P = np.where(lost[..., None], x, told[0]), np.where(lost[..., None, None], P, told[1])
    phase, doubt = its.phase, np.full((WORLDS, AUVS), 1e30)
    if chosen.turns:
        phase, doubt = its.turned(place - its.here, spread, reach)
    offset, horizontal = its.located(phase)
    flags = np.full((WORLDS, AUVS), usbl.DETECTED)
    flags |= np.where(np.abs(phase - its.phase).max(-1) > math.pi, usbl.WRAPPED, 0)
    flags |= np.where(horizontal, usbl.NO_DEPTH, 0) | np.where(doubt < GATE, usbl.AMBIGUOUS, 0)
    flags = np.where(lost, usbl.LOST, np.where(its.exists, flags, usbl.NO_RAY))
    _, own, common = its.judged(offset)
    fix = its.here + its.displaced + offset[..., :2]
    R = own + common * chosen.fleet
    filtered = chosen.tracker or reckons
    innovation = fix - (x[..., :2] if filtered else place)
    if not filtered:
        innovation *= np.maximum(1 - reach / np.linalg.norm(innovation, axis=-1), 0)[..., None]
    squared = its.squared(innovation, P[..., [0, 0, 1], [0, 1, 1]] if filtered else spread, R)
    usable = flags & (usbl.DETECTED | usbl.UNUSABLE) == usbl.DETECTED
    used = usable & (squared <= GATE)
    flags |= np.where(usable & ~used, usbl.REJECTED, 0)
    # What hangs on a rounding is left out.
    clear = (np.abs(squared / GATE - 1) > 0.02) & (np.abs(doubt - GATE) > 0.2) & (doubt > 0.1)
    auv, new = after["auv"], after["estimate"]
    assert clear.mean() > 0.9
    assert min(used[clear].mean(), (flags & usbl.REJECTED > 0)[clear].mean()) > 0.1
    np.testing.assert_array_equal(auv[..., AuvColumn.fix_flags][clear], flags[clear])
    np.testing.assert_array_equal(auv[..., AuvColumn.fix_boat], its.by)
    np.testing.assert_allclose(auv[..., HEARD], there, atol=1e-3)
    np.testing.assert_allclose(auv[..., FIX][clear], fix[clear], atol=0.03)
    np.testing.assert_allclose(auv[..., OF_FIX][clear], (own + common)[clear], rtol=0.01, atol=0.05)
    aged = estimate[..., EstimateColumn.age] + 0.5
    if filtered:
        H = np.eye(2, 4)
        gain = P @ H.T @ np.linalg.inv(P[..., :2, :2] + R[..., [0, 1, 1, 2]].reshape(WORLDS, AUVS, 2, 2))
        better = x + (gain @ innovation[..., None])[..., 0], P - gain @ H @ P
        took = used[..., None]
        x, P = moved(np.where(took, better[0], x), np.where(took[..., None], better[1], P), carried, lag)
        found = moments(after["track"])
        np.testing.assert_allclose(found[0][clear], x[clear], atol=0.03)
        np.testing.assert_allclose(found[1][clear], P[clear], rtol=2e-3, atol=0.05)
        place, spread = x[..., :2], P[..., [0, 0, 1], [0, 1, 1]]
        if reckons:
            for name in ("track", "exchange"):
                other.arrays[name].copy_(made.arrays[name])
            expected = other.after(expect)["estimate"]
            place, spread = expected[..., PLACE], expected[..., SPREAD]
        _, _, more = its.judged(np.concatenate([place - its.boat[..., :2], its.z[..., None]], -1))
        spread = spread + more
    else:
        place, spread = np.where(used[..., None], fix, place), np.where(used[..., None], own + common, spread)
        aged -= used * estimate[..., EstimateColumn.age]
    np.testing.assert_allclose(new[..., PLACE][clear], place[clear], atol=0.03)
    np.testing.assert_allclose(new[..., SPREAD][clear], spread[clear], rtol=0.01, atol=0.05)
    np.testing.assert_allclose(new[..., EstimateColumn.age][clear], aged[clear])
    np.testing.assert_allclose(new[..., EstimateColumn.separation], -its.z, rtol=1e-6)
    error = np.linalg.norm(new[..., PLACE] - its.true, axis=-1)
    np.testing.assert_allclose(auv[..., AuvColumn.position_error], error, atol=1e-3)
    columns = [AuvColumn.fix_flags, AuvColumn.fix_boat, AuvColumn.position_error, *FIX, *HEARD, *OF_FIX]
    changed = {"auv": columns, "estimate": [*PLACE, *SPREAD, EstimateColumn.age, EstimateColumn.separation]}
    if filtered:
        changed["track"] = list(range(tracker.COLUMNS))
    if replies:
        assert (after["exchange"][..., ExchangeColumn.reply] == Reply.none).all()
        assert (after["exchange"][..., ExchangeColumn.over] == 1).all()
        changed["exchange"] = [ExchangeColumn.reply, ExchangeColumn.over]
    if reckons:
        changed["exchange"] = list(range(len(ExchangeColumn.names)))
    unchanged(after, before, {**changed, "observation": list(range(40))})


def test_a_track_is_carried_by_what_was_commanded(device):
    """Where the AUV neither hovered nor was refused; the positions that fixes show move with the boat's own error."""
    made = fleet(device)
    r = np.random.default_rng(2)
    made.arrays["auv"][..., [AuvColumn.hovering, AuvColumn.border]] = torch.from_numpy(
        np.eye(3)[r.integers(0, 3, (WORLDS, AUVS))][..., :2]
    ).to(made.arrays["auv"])

    @ti.func
    def predict(worlds: ti.template(), w):
        for k in range(AUVS):
            fixes.predict(worlds, w, k)

    before, after = made.numbers(), made.after(predict)
    auv, track = before["auv"], after["track"]
    adrift = 1 - auv[..., AuvColumn.hovering] - auv[..., AuvColumn.border]
    water = adrift[..., None] * auv[..., [AuvColumn.water_x, AuvColumn.water_y]]
    x, P = moved(*moments(before["track"]), 0.5 * water, 0.5 * adrift)
    P[..., [0, 1], [0, 1]] += 2 * 0.4**2 * (1 - math.exp(-0.5 / 60))
    for found, wanted in zip(moments(track), (x, P), strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-4, atol=1e-4)
    np.testing.assert_array_equal(after["estimate"][..., PLACE], track[..., [tracker.X, tracker.Y]])
    np.testing.assert_array_equal(track[..., tracker.ADRIFT], adrift)
    np.testing.assert_allclose(track[..., [tracker.WATER_X, tracker.WATER_Y]], water)
    unchanged(after, before, {"track": list(range(tracker.COLUMNS)), "estimate": PLACE})


@pytest.mark.parametrize("deviation", [0.0, 0.3])
def test_the_current_of_the_next_step(device, deviation):
    """It forgets, as a Gauss–Markov process; a reading of it corrects all of the state, with a noise of its own."""
    made = fleet(device, current_reading=deviation)

    @ti.func
    def prepare(worlds: ti.template(), w):
        for k in range(AUVS):
            fixes.prepare_next_step(worlds, w, k)

    before, after = made.numbers(), made.after(prepare)
    x, P = moments(before["track"])
    F = np.diag([1, 1, *[math.exp(-0.5 / 40)] * 2])
    x, P = x @ F, F @ P @ F + np.diag([0, 0, 1, 1]) * 9e-3 * (1 - math.exp(-1 / 40))
    new = moments(after["track"])
    if deviation:
        gain = P[..., 2:] @ np.linalg.inv(P[..., 2:, 2:] + deviation**2 * np.eye(2))
        read = (np.linalg.inv(gain[..., 2:, :]) @ (new[0] - x)[..., 2:, None])[..., 0] + x[..., 2:]
        error = (read - before["auv"][..., [AuvColumn.current_x, AuvColumn.current_y]]) / deviation
        well = np.linalg.det(gain[..., 2:, :]) > 1e-3
        errors = error[well].T
        assert np.abs(np.corrcoef(errors) - np.eye(2)).max() < 0.15
        assert np.abs(errors.mean(1)).max() < 0.15
        assert np.abs(errors.std(1) - 1).max() < 0.15
        x = x + (gain @ (read - x[..., 2:])[..., None])[..., 0]
        P = P - gain @ P[..., 2:, :]
    else:
        well = np.ones((WORLDS, AUVS), bool)
    assert well.sum() > 300
    np.testing.assert_allclose(new[0][well], x[well], atol=2e-3)
    np.testing.assert_allclose(new[1][well], P[well], rtol=1e-3, atol=1e-3)
    unchanged(after, before, {"track": list(range(tracker.COLUMNS))})


def test_a_deployed_auv_is_known_to_a_centimetre_but_for_what_fixes_have_in_common(device):
    @ti.func
    def begin(worlds: ti.template(), w):
        for k in range(AUVS):
            b = serving.server(worlds, w, k)
            fixes.begin_estimate(worlds, reception.array_pose(worlds, w, b), w, k)
        write_pose(worlds, w)

    made = fleet(device)
    before, after = made.numbers(), made.after(begin, program())
    its = Expected(made, before, after["observation"], program())
    away = before["estimate"][..., PLACE] - its.boat[..., :2]
    _, _, common = its.judged(np.concatenate([away, its.z[..., None]], -1))
    wanted = common + 0.01**2 * np.array([1, 0, 1])
    np.testing.assert_allclose(after["estimate"][..., SPREAD], wanted, rtol=1e-4, atol=1e-3)
    unchanged(after, before, {"estimate": SPREAD, "observation": list(range(40))})


ERRORS = ("attitude_error", "alignment_error", "heading_error", "sound_speed_error", "lever_arm_error")


def test_noise_is_as_large_as_the_covariance_and_weak_signals_are_missed(device):
    """A boat at full speed makes a noise of its own."""
    none = dict.fromkeys((*ERRORS, "latency", "propagates"), 0.0)
    made = fleet(device, level=105.0, accuracy=Accuracy(), **none)
    made.arrays["estimate"][..., EstimateColumn.age] = 1e4  # no fix is too far from there
    before, after = made.numbers(), made.after(take, program())
    its = Expected(made, before, after["observation"], program())
    away = its.true - its.back(0.0)
    sigma, own, _ = its.judged(np.concatenate([away, its.z[..., None]], -1))
    heard = after["auv"][..., AuvColumn.fix_flags].astype(int) & usbl.DETECTED > 0
    squared = its.squared(after["auv"][..., FIX] - its.true - its.displaced, own)
    strength = math.sqrt(8) / sigma
    threshold = math.sqrt(8 + 8 * acoustic_link.CODE_ENERGY)
    P = stats.norm.sf(threshold - np.sqrt(strength**2 + 7))
    assert abs(heard.sum() - P.sum()) < 4 * math.sqrt((P * (1 - P)).sum())
    assert (P * (1 - P)).sum() > 20
    near = (np.linalg.norm(away, axis=-1) < 80) & (strength > threshold + 3)
    for effort in (0.2, 1.0):
        each = squared[near & np.isclose(its.effort, effort)]
        assert each.mean() == pytest.approx(2.0, abs=10 / math.sqrt(len(each)))
        assert len(each) > 100


class Paths(NamedTuple):
    """How sound comes."""

    multipath: bool
    refraction: int


class Heard(NamedTuple):
    """What `reception.sounds` reads of the worlds."""

    program: Any
    p: Any
    link: Any
    layers: Any
    mirrored_layers: Any
    pulses: Any
    boat: Any


@ti.kernel
def _hear(program: ti.template(), p: array1, link: array2, layers: array2, mirrored: array2, envelope: array2,
          output: array3, rate: array1, boat: array3, offset: array2, around: array2, out: array3):  # fmt: skip
    worlds = ti.static(Heard(program, p, link, layers, mirrored, coded_pulse.Pulses(envelope, output, rate), boat))
    for n in range(offset.shape[0]):
        away = vec3(offset[n, 0], offset[n, 1], offset[n, 2])
        axes = usbl.array_axes(ti.math.vec2(0.1, -0.2))
        S = away.norm()
        body = 0.98 * (axes @ away) / S
        pose = reception.ArrayPose(boat=1, axes=axes, measured=axes, displaced=0.0, slowness=0.98, effort=0.0)
        arrival = reception.Arrival(offset=away, body=body, slant_range=S, path=0.98 * S, loss=0.0)
        found = reception.sounds(worlds, pose, arrival, n, 1)
        limits = reflections.Boundaries(
            array_depth=around[n, 0],
            water_depth=around[n, 1],
            roughness=around[n, 2],
            density=around[n, 3],
            speed=around[n, 4],
            absorption=around[n, 5],
        )
        profile = ti.static(reflections.Profile(layers, mirrored, around[n, 6], 1480.0, S))
        chosen = ti.static(
            reflections.Surroundings(
                limits if program.multipath else None, profile if program.refraction != Refraction.none else None
            )
        )
        wanted = coded_pulse.sounds(worlds.pulses, link, 1, 0.98 * S * body, 0.98 * S, away, axes, chosen)
        for row in ti.static(range(12)):
            for c in ti.static(range(3)):
                out[n, row, c] = found[row, c]
                out[n, row, 3 + c] = wanted[row, c]


@pytest.mark.parametrize(
    ("multipath", "refraction"), [(False, Refraction.none), (True, Refraction.none), (True, Refraction.corrected)]
)
def test_what_reflects_is_the_water_where_the_boat_is(device, multipath, refraction):
    """The array stays at its depth below the surface, and rises with it over the bottom."""
    around = {"array_depth": 3.0, "water_depth": 150.0, "roughness": 0.02, "bottom_density": 1.5, "bottom_speed": 1.1}
    made = fleet(device, **around, bottom_absorption=0.8)
    r = np.random.default_rng(4)
    elevation = made.numbers()["boat"][:50, 1, BoatColumn.elevation]
    numbers = np.array([*around.values(), 0.8, 0.0]) + np.outer(elevation, [0, 1, 0, 0, 0, 0, -1])
    offset = np.concatenate([r.uniform(-80, 80, (50, 2)), r.uniform(-100, -80, (50, 1))], 1)
    mirrored = layer_table(np.array([-20.0, 0.0, 150.0, 300.0]), np.array([SHALLOW, SHALLOW, 1460.0, SHALLOW]))
    pulses = coded_pulse.pulses(codes.codes(AUVS, 32), [25e3, 27e3, 29e3], 4000.0, 8, device)
    given = [made.arrays["p"].new_tensor(array) for array in (offset, numbers)]
    out = torch.zeros((50, 12, 6), device=device)
    tables = [made.arrays[name] for name in ("p", "link", "layers")] + [torch.from_numpy(mirrored).to(device), *pulses]
    _hear(Paths(multipath, refraction), *tables, made.arrays["boat"], *given, out)
    assert (out[:, 4:].abs().amax((1, 2)) > 0).all() == multipath
    torch.testing.assert_close(out[..., :3], out[..., 3:], rtol=1e-4, atol=2e-3)


def moved(x: np.ndarray, P: np.ndarray, carried: np.ndarray, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """State and covariance of position and current after a time in which the current carries the AUV."""
    F = np.eye(4) + time[..., None, None] * np.eye(4, k=2)
    x = (F @ x[..., None])[..., 0]
    x[..., :2] += carried
    return x, F @ P @ np.swapaxes(F, -1, -2)
