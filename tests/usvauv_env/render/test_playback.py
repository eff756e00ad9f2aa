"""Moments between the steps of a mission: sea, vehicles, what a frame differs by from the next, a moving view."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch

from tests.usvauv_env.record.made_traces import synthetic_trace
from usvauv.env import Scenario, Trace, World
from usvauv.env.record.recorder import record
from usvauv.env.render.frames import frames_of
from usvauv.env.render.layout import Layout, Rectangle
from usvauv.env.render.mission import Playback, RecordedSea, Series, Vehicle
from usvauv.env.render.views.boat_view import BoatView
from usvauv.env.render.views.perspective import PerspectiveView
from usvauv.kernels.errors import UserError

STEPS = 12
STORM = ["sea.fine_cells=128", f"mission.duration={STEPS}"]


def still(observation: torch.Tensor) -> torch.Tensor:
    return torch.zeros(1, 2, 2)


@pytest.fixture(scope="module")
def trace() -> Trace:
    """A mission in the storm of `extreme`, with its sea."""
    return record(World(Scenario.load("extreme", STORM), 1, 3, fine_sea=True), still, "still", surface=True)


def vehicles(trace: Trace) -> dict[str, np.ndarray]:
    """What a trace has of vehicles that move, by name."""
    names = "boat_position", "boat_heading", "boat_goal", "auv_position", "auv_velocity", "estimate"
    return {name: getattr(trace, name) for name in (*names, "foreseen_position", "estimate_covariance")}


class TestSea:
    def test_at_a_step_it_is_the_recorded_one(self, trace):
        sea = RecordedSea(trace)
        for t in (0, 5, 3, STEPS - 1):
            np.testing.assert_array_equal(sea.at(t), trace.surface[t])

    def test_in_between_it_is_that_of_a_simulation_with_half_the_step(self, trace):
        """Its solver is another one, with intervals half as long; the sea agrees to a centimetre in waves of 6.5 m.

        The mean of the recorded seas before and after would be off by more than twenty times that.
        """
        scenario = Scenario.load("extreme", [*STORM, "mission.step=0.5", "sea.update_interval=0.5"])
        world, sea = World(scenario, 1, 3, fine_sea=True), RecordedSea(trace)
        world.reset()
        for half in range(1, 2 * STEPS + 1):
            world.step(still(world.observation))
            t = half / 2 - 1
            if 1 <= t <= STEPS - 3:
                apart = np.abs(sea.at(t) - world.surface(128)).max()
                assert apart < 0.01, t
                if half % 2:
                    mean = (trace.surface[int(t)] + trace.surface[int(t) + 1]) / 2
                    assert np.abs(mean - world.surface(128)).max() > 20 * apart

    def test_on_a_finer_grid_it_is_the_sum_of_its_waves_and_the_long_ones(self, trace):
        x, y = np.linspace(40.0, 60.0, 21), np.linspace(120.0, 130.0, 11)
        a, kx, ky, omega, phase = trace.storm.T[:, :, None, None]
        waves = (a * np.cos(kx * x + ky * y[:, None] - omega * (1.0 + 4.4) + phase)).sum(axis=0)
        long = RecordedSea(trace).on(4.4, x, y) - waves
        assert np.ptp(long) < 0.03, "hardly changes over 20 m"
        assert abs(long.mean()) < 0.5
        pixels = (np.arange(128) + 0.5) * 200 / 128
        np.testing.assert_allclose(RecordedSea(trace).on(4.4, pixels, pixels), RecordedSea(trace).at(4.4), atol=1e-4)

    def test_there_are_no_waves_on_land(self, trace):
        surface = np.array(trace.surface)
        surface[:, :, :64] = 0.0  # as recorded on a shore
        x, y = np.array([20.0, 60.0]), np.array([30.0, 90.0, 150.0])
        for speed_up in (1.0, 30.0):
            sea = RecordedSea(replace(trace, surface=surface), speed_up)
            for t in (4.0, 4.4):
                np.testing.assert_allclose(sea.at(t)[:, :62], 0.0, atol=1e-5)
                np.testing.assert_allclose(sea.on(t, x, y), 0.0, atol=1e-5)

    def test_without_a_record_of_the_storm_it_is_between_the_recorded_ones(self, trace):
        sea = RecordedSea(replace(trace, storm=np.zeros((0, 5))))
        near = sea.at(5.001)
        np.testing.assert_allclose(near, trace.surface[5], atol=0.02)
        assert not np.array_equal(near, trace.surface[5])
        nothing = RecordedSea(replace(trace, surface=np.zeros((0, 0, 0), np.float32)))
        assert nothing.at(2.5).size == 0
        assert not nothing.on(2.5, np.arange(3.0), np.arange(2.0)).any()

    def test_in_fast_motion_a_frame_is_like_the_one_before_and_boats_are_afloat(self, trace):
        sea, plain = RecordedSea(trace, speed_up=30.0), RecordedSea(trace)
        for t in range(STEPS - 1):
            both = np.array([[which.at(t).ravel(), which.at(t + 1).ravel()] for which in (sea, plain)])
            fast, true = (np.corrcoef(pair)[0, 1] for pair in both)
            assert fast > 0.99 > 0.9 > true
            assert both[0].std() > 0.5 * both[1].std()
        place, floating = trace.boat_position[:, 0], trace.boat_surface[:, 0]
        shown = sea.under(place, floating, place)
        for t in (0, 7, STEPS - 1):
            x, y = place[t, 0]
            around = sea.on(t, np.array([x - 1, x, x + 1]), np.array([y - 1, y, y + 1]))
            slopes = (around[1, 2] - around[1, 0]) / 2, (around[2, 1] - around[0, 1]) / 2
            np.testing.assert_allclose(shown[t, 0], (around[1, 1], *slopes), atol=0.03)
        np.testing.assert_array_equal(plain.under(place, floating, place), floating)

    def test_in_fast_motion_waves_do_not_move_a_boat_to_and_fro(self, trace):
        """A circle of 2 m in the storm's period, on a straight way: the way remains, but for the ends."""
        t = np.arange(120)
        way = np.stack([20 + 0.8 * t, 60 + 0.3 * t], 1)
        turn = 2 * np.pi * t / RecordedSea(trace).period
        circling = way + 2 * np.stack([np.cos(turn), np.sin(turn)], 1)
        made = synthetic_trace(steps=120)
        boat = replace(made, boat_position=circling[:, None, None], storm=trace.storm)
        inner = slice(20, 100)
        np.testing.assert_allclose(Playback(boat, speed_up=30.0).boats.values[inner, 0], way[inner], atol=0.15)
        np.testing.assert_array_equal(Playback(boat).boats.values[:, 0], circling)

    def test_in_fast_motion_a_map_is_like_the_one_before(self, trace):
        """AUVs go 1.5 m and the boat 0.8 m a frame, in a storm with a current and pings; one with vehicles held."""
        t = np.arange(STEPS)[:, None, None, None]
        held = {name: np.repeat(value[:1], STEPS, axis=0) for name, value in vehicles(trace).items()}
        auvs, boats = np.array([[60.0, 50.0], [140.0, 150.0]]), np.array([[90.0, 100.0]])
        places = auvs + t * np.array([[1.5, 0.0], [0.0, 1.5]])
        way = dict.fromkeys(("auv_position", "estimate", "foreseen_position"), places)
        boat = boats + t * np.array([0.7, 0.4])
        moved = held | way | {"boat_position": boat, "boat_goal": boat + 30.0}
        for changed, least in ((held, 0.993), (moved, 0.93)):
            frames, shown = frames_of([replace(trace, **changed)], (640, 360), speed_up=30.0), []
            for step in range(STEPS):
                shown.append(frames.layout.map.of(frames.frame(step)).mean(axis=-1).ravel())
            alike = [np.corrcoef(one, other)[0, 1] for one, other in pairwise(shown)]
            assert np.mean(alike) > least

    def test_in_fast_motion_numbers_stay_for_some_frames_and_are_those_of_the_last(self):
        made = synthetic_trace(steps=47)
        frames, seen = frames_of([made], (640, 360), speed_up=30.0), []
        boxes = [frames.layout.boxes[name] for name in ("title", "tiles")]
        for t in range(47):
            picture = frames.frame(t)
            seen.append(np.concatenate([box.of(picture).ravel() for box in boxes]))
        changes = [t for t in range(1, 47) if (seen[t] != seen[t - 1]).any()]
        assert changes == [6, 16, 26, 36, 46]
        last = frames_of([made], (640, 360), speed_up=30.0, pace=1 / 30).frame(46)
        np.testing.assert_array_equal(seen[-1], np.concatenate([box.of(last).ravel() for box in boxes]))

    def test_in_fast_motion_a_vehicle_turns_calmly_and_keeps_its_heading_where_it_gets_nowhere(self):
        """An AUV goes east, circles on the spot for 60 steps, then goes north; its turn takes a third of a second."""
        made = synthetic_trace(steps=120, auvs=1)
        angle = np.concatenate([np.zeros(30), 0.7 * np.arange(60), np.full(30, np.pi / 2)])
        velocity = 2.0 * np.stack([np.cos(angle), np.sin(angle)], -1)[:, None, None]
        spinning = replace(made, auv_velocity=velocity.astype(np.float32))
        heading = Playback(spinning, speed_up=30.0).attitude.values[:, 0, 0]
        assert np.abs(np.diff(heading)).max() < 0.25
        np.testing.assert_allclose(heading[:20], 0.0, atol=0.01)
        assert np.ptp(heading[40:80]) < 0.1
        np.testing.assert_allclose(np.remainder(heading[-10:], 2 * np.pi), np.pi / 2, atol=0.01)
        true = Playback(spinning, pace=1 / 30).attitude.values[:, 0, 0]
        assert np.abs(np.remainder(true - angle + np.pi, 2 * np.pi) - np.pi).max() < 1e-5


class TestSeries:
    def test_vehicles_move_evenly_where_their_speed_changes_evenly(self):
        t = np.arange(9.0)
        way = Series(np.stack([3 + 2 * t - 0.25 * t**2, -t], 1), smooth=True)
        for moment in (1.0, 3.25, 6.999, 8.0):
            np.testing.assert_allclose(way.at(moment), [3 + 2 * moment - 0.25 * moment**2, -moment], atol=1e-12)
        np.testing.assert_allclose(way.until(4.5, np.array([2, 4]))[:, 1], [-2, -4, -4.5])
        assert way.until(4.0, np.array([2, 4])).shape == (2, 2)
        np.testing.assert_allclose(Series(t**2).at(2.5), 6.5, err_msg="linear")


class TestFrames:
    @pytest.mark.parametrize("follow", ["", "usv", "auv:2"])
    def test_frames_depend_on_the_moment_alone(self, trace, follow):
        one, other = (frames_of([trace], (640, 360), "sea", "dark", 4.0, 0.2, follow) for _ in range(2))
        for t in (0.2, 1.4, 2.6):
            kept = one.frame(t).copy()
        np.testing.assert_array_equal(other.frame(2.6), kept)


class TestFollowing:
    BOX = Rectangle(10, 20, 600, 300)

    def test_the_vehicle_is_in_the_middle_of_the_view(self, trace):
        play, layout = Playback(trace), Layout(640, 360, 0.8, {})
        vehicle = Vehicle.parse("auv:2", trace.scenario)
        view = PerspectiveView(play, self.BOX, layout, vehicle)
        for t in (0.0, 4.3):
            place = np.append(vehicle.way(trace).at(t) - 100.0, -trace.scenario.auv.depth * view.scene.depths)
            np.testing.assert_allclose(view.camera(t).pixel(place), (300, 150), atol=1e-9)

    def test_beside_a_boat_the_sea_is_the_storm_and_goes_on_beyond_the_area(self, trace):
        """Its elevation and slopes near the boat; the area ends 100 m from it at most."""
        play = Playback(trace)
        view = BoatView(play, self.BOX, Layout(640, 360, 0.8, {}), 0)
        camera, t = view.camera(4.3), 4.3
        shown = view.surface(t, camera)
        a, kx, ky, phase = play.sea.storm(t).T[:, :, None]
        seen = np.flatnonzero(np.abs(view.ahead - view.ahead.mean()) < 200)[[40, 60]]
        for row in seen:
            for column in (80, 96, 120):
                x, y = camera.eye + view.ahead[row] * camera.forward + view.across[column] * camera.right
                turn = kx * x + ky * y + phase
                east, north = ((-a * k * np.sin(turn)).sum() for k in (kx, ky))
                slopes = np.stack([camera.right, camera.forward]) @ (east, north)
                found = shown[row, column]
                assert found[0] == pytest.approx((a * np.cos(turn)).sum(), abs=0.1)
                np.testing.assert_allclose(found[1:3], slopes, atol=0.04)
        far = view.ahead > 1000.0
        assert far.any()

    def test_beside_a_boat_it_is_in_view_under_a_level_horizon(self, trace):
        view = BoatView(Playback(trace), self.BOX, Layout(640, 360, 0.8, {}), 0)
        for t in (0.0, 4.3, 9.9):
            place = np.append(trace.boat_position[0, 0, 0], 0.0)
            x, y = view.camera(t).pixel(place)
            assert 100 < x < 500
            assert 100 < y < 300
        made = synthetic_trace(steps=3, sea=False)
        calm = replace(made, boat_position=np.full_like(made.boat_position, 100.0))
        picture = frames_of([calm], (640, 360), "sea", follow="usv").frame(1)
        box = frames_of([calm], (640, 360), "sea", follow="usv").layout.boxes["perspective"]
        red = box.of(picture)[:, :40, 2]  # left of the boat
        rows = red[: round(0.3 * box.height)], red[round(0.7 * box.height) : round(0.85 * box.height)]
        assert rows[0].mean() > rows[1].mean() + 20, "sky above, sea below"

    def test_a_map_shows_a_third_around_it_and_ends_at_the_border(self):
        made = synthetic_trace(steps=8)
        boat = np.linspace((100.0, 100.0), (198.0, 60.0), 8)[:, None, None]
        frames = frames_of([replace(made, boat_position=boat)], (640, 360), follow="usv")
        frames.frame(0)
        np.testing.assert_allclose(frames.map.view.bounds, [[100 - 200 / 6] * 2, [100 + 200 / 6] * 2])
        frames.frame(7)
        np.testing.assert_allclose(frames.map.view.bounds, [[200 - 200 / 3, 60 - 200 / 6], [200, 60 + 200 / 6]])
        box = frames.layout.map
        middle = box.right - 0.5, box.top + 0.5 * box.height - 0.5
        np.testing.assert_allclose(frames.map.view.pixel(np.array([200.0, 60.0])), middle)

    @pytest.mark.parametrize("name", ["", "boat", "usv:2", "usv:0", "auv", "auv:0", "auv:3", "auv:1 ", "auv:01"])
    def test_a_vehicle_that_is_not_there_is_refused(self, name):
        with pytest.raises(UserError, match=r"must be usv, or auv:1 to auv:2"):
            Vehicle.parse(name, Scenario.load("extreme"))
