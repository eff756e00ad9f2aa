"""The autopilot of the torpedo on the vehicle itself: steps, limits, bed and surface, currents, other numbers."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from usvauv.kernels.vehicles.fleet import Body, Command, Fleet, Memory, Surroundings
from usvauv.kernels.vehicles.gains import NUMBERS as GAINS
from usvauv.kernels.vehicles.numbers import NUMBERS

SPEEDS = (0.8, 1.2, 1.8, 2.5)
FACTORS = [*itertools.product((0.8, 1.2), repeat=3), (1.0, 1.0, 1.0)]  # on mass, drag, fins
EVERY = 0.2  # s
LIMIT = NUMBERS["fin_limit"].default
STEP = np.pi / 2


def fleet(count, numbers=None, water=None, **command):
    """Vehicles trimmed at a command; the water is at rest and deep unless `water` says otherwise."""
    flown = Fleet(count, numbers=numbers)
    start = {"heading": 0.0, "speed": 1.5, "depth": 50.0, "altitude": 0.0} | command
    flown.set(Command, **start)
    flown.set(Surroundings, **{"depth": start["depth"], "bed": 1000.0} | (water or {}))
    flown.trim()
    return flown


def every_kind():
    """Speeds and factors (mass, drag, fins), each with each."""
    cases = np.array([(speed, *factors) for speed in SPEEDS for factors in FACTORS])
    return cases[:, 0], dict(zip(("mass", "drag", "fins"), cases[:, 1:].T, strict=True))


def fly(flown, seconds, before=None):
    """What is recorded each `EVERY` seconds, (steps, vehicles); `before(t)` is called ahead of each."""
    go = flown.flight(round(EVERY / flown.substep), commanded=True)
    rows = []
    for step in range(round(seconds / EVERY)):
        if before:
            before(step * EVERY)
        go()
        rows.append({name: flown.numpy(name) for name in Body.members})
    track = {name: np.stack([row[name] for row in rows]) for name in Body.members}
    q0, q1, q2, q3 = (track[f"q{i}"] for i in range(4))
    track["heading"] = np.unwrap(np.arctan2(2 * (q1 * q2 + q0 * q3), 1 - 2 * (q2**2 + q3**2)), axis=0)
    track["pitch"] = np.arcsin(2 * (q0 * q2 - q3 * q1))
    return track


def angle(difference):
    return (difference + np.pi) % (2 * np.pi) - np.pi


@pytest.fixture(scope="module")
def steps():
    """What follows steps of heading, speed and depth, of all speeds and factors: tracks by name, and the speeds."""
    speed, factors = every_kind()
    tracks = {}
    for name, seconds, step in (
        ("heading", 80, {"heading": STEP}),
        ("depth 10", 120, {"depth": 60.0}),
        ("depth 50", 300, {"depth": 100.0}),
        ("up", 120, {"depth": 35.0}),
        ("faster", 60, {"speed": speed + 0.3}),
    ):
        flown = fleet(len(speed), None, factors, speed=np.minimum(speed, 1.9) if name == "faster" else speed)
        fly(flown, 10)  # until what other numbers disturb has gone
        flown.set(Command, **step if name != "faster" else {"speed": np.minimum(speed, 1.9) + 0.3})
        tracks[name] = fly(flown, seconds)
    return tracks, speed


class TestSteps:
    def test_heading_settles_without_overshoot(self, steps):
        tracks, speed = steps
        off = np.degrees(tracks["heading"]["heading"] - STEP)
        assert off.max() < 0.5
        late = np.arange(1, len(off) + 1)[:, None] * EVERY > 25.0 / speed + 4.0  # an arc of 8 m, and the approach
        assert np.abs(off[late]).max() < 2.0
        assert np.abs(off[-1]).max() < 0.1
        assert np.abs(tracks["heading"]["depth"] - 50.0).max() < 0.25

    @pytest.mark.parametrize(("name", "wanted"), [("depth 10", 60.0), ("depth 50", 100.0), ("up", 35.0)])
    def test_depth_settles_without_overshoot(self, steps, name, wanted):
        tracks, speed = steps
        step = wanted - 50.0
        beyond = (tracks[name]["depth"] - wanted) * np.sign(step)
        assert beyond.max() < 0.2
        assert np.abs(beyond[:, speed > 1.0]).min(0).max() < 0.01
        late = np.arange(1, len(beyond) + 1)[:, None] * EVERY > (abs(step) / 0.34 + 20.0) / speed + 2.0
        assert np.abs(beyond[late & (speed > 1.0)]).max() < 0.5
        assert np.abs(beyond[-1]).max() < 0.2
        assert np.degrees(np.abs(angle(tracks[name]["heading"]))).max() < 1.5

    def test_speed_settles(self, steps):
        tracks, speed = steps
        off = tracks["faster"]["u"] - np.minimum(speed, 1.9) - 0.3
        assert off.max() < 0.1
        assert np.abs(off[-1]).max() < 0.02

    def test_limits_are_kept(self, steps):
        tracks, _ = steps
        for track in tracks.values():
            assert np.abs(track["rudder"]).max() <= LIMIT * 1.0001
            assert np.abs(track["stern"]).max() <= LIMIT * 1.0001
            assert track["propeller"].max() <= NUMBERS["propeller_limit"].default * 1.0001
            assert np.abs(track["pitch"]).max() < GAINS["pitch_limit"].default + np.radians(5)

    def test_both_sides_alike(self):
        """Without the propeller's torque, which heels the hull to port."""
        turn = np.array([0.5, -0.5, 1.5, -1.5, 3.0, -3.0])
        flown = fleet(6, {"torque_0": 0.0, "torque_1": 0.0})
        flown.set(Command, heading=turn, depth=55.0)
        track = fly(flown, 40)
        for name in ("heading", "east", "rudder", "v", "r", "p"):
            np.testing.assert_allclose(track[name][:, ::2], -track[name][:, 1::2], atol=2e-4)
        for name in ("north", "depth", "stern", "u", "propeller"):
            np.testing.assert_allclose(track[name][:, ::2], track[name][:, 1::2], atol=2e-4)


class TestHeading:
    def test_the_shorter_way_round(self):
        begin, end = np.radians([170.0, -170.0, 10.0, -100.0]), np.radians([-170.0, 170.0, -10.0, 130.0])
        flown = fleet(4, heading=begin)
        flown.set(Command, heading=end + 2 * np.pi * np.array([0, 1, -3, 0]))
        heading = fly(flown, 40)["heading"]
        turned = heading - heading[0]
        np.testing.assert_allclose(np.degrees(turned[-1]), [20.0, -20.0, -20.0, -130.0], atol=1.0)
        assert np.abs(np.degrees(turned)).max() < 131.0
        np.testing.assert_allclose(angle(heading[-1] - end), 0.0, atol=np.radians(0.2))

    def test_turns_keep_their_radius(self):
        flown = fleet(len(SPEEDS), speed=np.array(SPEEDS))
        track = fly(flown, 24, lambda t: flown.set(Command, heading=track_ahead(flown)))
        radius = track["u"] / np.abs(track["r"])
        np.testing.assert_allclose(radius[-1], GAINS["turn_radius"].default * NUMBERS["length"].default, rtol=0.05)


def track_ahead(flown):
    """A heading always 1.5 rad to starboard."""
    q0, q1, q2, q3 = (flown.numpy(f"q{i}") for i in range(4))
    return np.arctan2(2 * (q1 * q2 + q0 * q3), 1 - 2 * (q2**2 + q3**2)) + 1.5


class TestBedAndSurface:
    SLOPES = np.array([0.0, -0.1, -0.2, -0.3, 0.1, 0.3])  # of the bed's depth, over the way north

    def test_altitude_is_kept_over_a_sloping_bed(self):
        for speed in (1.0, 2.2):
            water = {"bed": 200.0, "bed_n": self.SLOPES, "depth": 180.0}
            flown = fleet(6, None, water, speed=speed, depth=180.0, altitude=5.0)
            flown.set(Command, depth=1000.0)
            track = fly(flown, 120)
            altitude = 200.0 + self.SLOPES * track["north"] - track["depth"]
            assert altitude.min() > 4.9
            ahead = GAINS["bed_ahead"].default * NUMBERS["length"].default
            # The path is steeper than the fins hold the hull where the bed falls fast and the vehicle is slow.
            kept = slice(0, 5) if speed < 2 else slice(0, 6)
            expected = 5.0 + np.maximum(-self.SLOPES, 0) * ahead / np.cos(np.arctan(self.SLOPES))
            np.testing.assert_allclose(altitude[-1][kept], expected[kept], atol=0.35)

    def test_a_current_across_the_slope_counts(self):
        """Going north over a bed that rises to the east, in a current that sets east."""
        flown = fleet(2, None, {"bed": 60.0, "bed_e": -0.2, "east": [0.0, 0.8], "depth": 50.0}, altitude=5.0)
        flown.set(Command, depth=1000.0)
        track = fly(flown, 100)
        altitude = 60.0 - 0.2 * track["east"] - track["depth"]
        assert track["east"][-1, 1] > 70
        assert altitude.min() > 4.9

    @pytest.mark.parametrize(("wanted", "above"), [(1000.0, 60.0 - GAINS["least_altitude"].default), (-50.0, 1.0)])
    def test_neither_bed_nor_surface_is_met(self, wanted, above):
        speed, factors = every_kind()
        flown = fleet(len(speed), None, factors | {"bed": 60.0, "depth": 30.0}, speed=speed, depth=30.0)
        flown.set(Command, depth=wanted)
        track = fly(flown, 200)
        assert track["surfaced"].max() == track["grounded"].max() == 0
        beyond = (track["depth"] - above) * np.sign(wanted)
        assert beyond.max() < 0.2
        assert np.abs(beyond[-1][speed > 1]).max() < 0.05

    def test_a_dive_that_has_begun_is_caught(self):
        room = np.array([3.0, 5.0, 8.0])
        flown = fleet(3, None, {"bed": 50.0 + room})
        flown.set(Body, q0=np.cos(0.2), q2=-np.sin(0.2))
        flown.set(Command, depth=1000.0)
        track = fly(flown, 30)
        assert (50.0 + room - track["depth"]).min() > 0.9

    def test_a_bed_that_comes_up_at_once(self):
        flown = fleet(2, speed=[1.0, 2.0])
        flown.set(Command, depth=150.0)
        fly(flown, 40)
        bed = flown.numpy("depth") + 2.0
        flown.set(Surroundings, bed=bed)
        assert (bed - fly(flown, 40)["depth"]).min() > 0.8

    def test_water_too_shallow_for_both(self):
        flown = fleet(2, None, {"bed": [4.0, 1.5], "depth": [2.5, 0.7]}, depth=[2.5, 0.7], altitude=5.0)
        track = fly(flown, 60)
        assert track["surfaced"].max() == track["grounded"].max() == 0
        np.testing.assert_allclose(track["depth"][-1], [1.0, 0.75], atol=0.05)


class TestIntegrals:
    def test_none_winds_up_at_a_limit(self):
        """A speed that the propeller does not give, a depth that the bed forbids, a pitch that the fins do not hold."""
        flown = fleet(3, None, {"bed": [1000.0, 60.0, 1000.0]})
        flown.set(Command, speed=[4.0, 1.5, 0.5], depth=[50.0, 500.0, 200.0])
        fly(flown, 120)
        for name, bound in (("speed_integral", 0.1), ("depth_integral", 0.15), ("heading_integral", 0.02)):
            assert np.abs(flown.numpy(name, Memory)).max() < bound
        flown.set(Command, speed=1.5, depth=flown.numpy("depth"))
        track = fly(flown, 60)
        assert track["u"][50:, 0].min() > 1.4
        flown.set(Command, depth=50.0)
        track = fly(flown, 200)
        assert (track["depth"] - 50.0)[:, 1].min() > -0.2
        np.testing.assert_allclose(track["depth"][-1], 50.0, atol=0.05)

    def test_lift_of_a_vehicle_that_is_not_trimmed_is_learned(self):
        flown = fleet(len(SPEEDS), {"buoyancy": 2.0}, speed=np.array(SPEEDS))
        track = fly(flown, 200)
        np.testing.assert_allclose(track["depth"][-1][1:], 50.0, atol=0.05)

    def test_a_given_memory_gives_the_same_substep_twice(self):
        """Nothing is remembered outside `Memory`."""
        flown = fleet(2)
        flown.set(Command, heading=1.0, depth=60.0)
        fly(flown, 3)
        kept = flown.state.clone(), flown.memory.clone()
        first = fly(flown, 1)
        flown.state[:], flown.memory[:] = kept
        second = fly(flown, 1)
        np.testing.assert_array_equal(first["depth"], second["depth"])
        np.testing.assert_array_equal(first["heading"], second["heading"])


class Eddies:
    """Lamb–Oseen vortices as strong as those of `extreme` at 100 m, and a long swell's orbital motion."""

    FADING = np.exp(-100.0 / 280.0)
    SWELL, OMEGA = 0.08, 0.5  # m/s at that depth, rad/s

    def __init__(self, seed):
        random = np.random.default_rng(seed)
        self.circulation = self.FADING * random.uniform(120, 260, 9) * random.choice([-1, 1], 9)
        self.core = random.uniform(18, 25, 9)
        self.centre = random.uniform(0, 300, (2, 9))

    def velocity(self, place):
        dx, dy = (place[i][..., None] - self.centre[i] for i in (0, 1))
        r2 = dx**2 + dy**2 + 1e-9
        turn = self.circulation / (2 * np.pi * r2) * -np.expm1(-r2 / self.core**2)
        return np.stack(((-turn * dy).sum(-1), (turn * dx).sum(-1)))

    def at(self, place, t):
        h = np.array([[0.01], [0.0]])
        north, east = self.velocity(place)
        nn, en = (self.velocity(place + h) - self.velocity(place - h)) / 0.02
        ne, ee = (self.velocity(place + h[::-1]) - self.velocity(place - h[::-1])) / 0.02
        a, w = self.SWELL, self.OMEGA
        down, rate = a * np.sin(w * t), a * w * np.cos(w * t)
        return {"north": north, "east": east, "down": down, "nn": nn, "ne": ne, "en": en, "ee": ee, "rate_d": rate}


class TestCurrents:
    def test_a_uniform_current_does_not_matter(self):
        still, carried = fleet(2), fleet(2, None, {"north": 0.7, "east": -0.4, "down": 0.0})
        for flown in (still, carried):
            flown.set(Command, heading=[2.0, -1.0], depth=57.0)
        first, second = fly(still, 40), fly(carried, 40)
        t = EVERY * np.arange(1, 201)[:, None]
        np.testing.assert_allclose(second["north"] - 0.7 * t, first["north"], atol=2e-3)
        np.testing.assert_allclose(second["east"] + 0.4 * t, first["east"], atol=2e-3)
        np.testing.assert_allclose(second["depth"], first["depth"], atol=1e-3)

    def test_course_and_depth_are_kept_in_eddies(self):
        """Course through the water within 3° rms and depth within 0.5 m rms, at each speed and with each number off."""
        speed, factors = every_kind()
        count, random = len(speed), np.random.default_rng(5)
        heading, place = random.uniform(-np.pi, np.pi, count), random.uniform(0, 300, (2, count))
        flown = fleet(count, None, factors, speed=speed, heading=heading, depth=100.0)
        eddies, seconds, off, deep, flow = Eddies(1), 120, [], [], []
        for t in range(seconds):
            around = eddies.at(place, float(t))
            flown.set(Surroundings, depth=flown.numpy("depth"), **around)
            flown.set(Body, north=0.0, east=0.0, time=0.0)
            track = fly(flown, 1)
            place = place + np.stack((track["north"][-1], track["east"][-1]))
            off.append(angle(track["heading"] + np.arctan2(track["v"], track["u"]) - heading))
            deep.append(track["depth"] - 100.0)
            flow.append(np.hypot(around["north"], around["east"]))
        assert np.median(flow) > 0.25
        assert np.max(flow) > 0.9
        course = np.degrees(np.sqrt(np.mean(np.square(np.concatenate(off)), 0)))
        depth = np.sqrt(np.mean(np.square(np.concatenate(deep)), 0))
        assert course.max() < 3.0
        assert np.median(course) < 1.0
        assert depth.max() < 0.35


class TestYoYo:
    def test_it_goes_between_two_depths_at_twenty_degrees(self):
        flown = fleet(3, depth=2.0, speed=np.array([1.0, 1.5, 2.0]))
        track = fly(flown, 200, lambda t: flown.set(Command, depth=20.0 if t < 100 else 2.0))
        assert np.abs(track["depth"][-1] - 2.0).max() < 0.05
        assert np.abs(track["depth"].max(0) - 20.0).max() < 0.2
        steepest = np.degrees(track["pitch"]).min(0), np.degrees(track["pitch"]).max(0)
        assert np.abs(steepest[0] + 24).max() < 5
        assert np.abs(steepest[1] - 24).max() < 5
