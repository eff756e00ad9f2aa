"""The map of a mission: what is drawn where, and how it tells what is there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.usvauv_env.made_traces import paint, place, synthetic_trace
from usvauv.env.render import shapes, style
from usvauv.env.render.frames import Painter
from usvauv.env.render.layout import MapView, Rectangle
from usvauv.env.render.map import error_axes
from usvauv.env.render.sea import CurrentStreaks, SeaSurface
from usvauv.env.scenario import Scenario
from usvauv.env.scenario.sea import Area


class TestMap:
    @pytest.mark.parametrize("area", [(200.0, 200.0), (400.0, 150.0), (120.0, 300.0)])
    def test_auv_is_where_it_should_be(self, area):
        trace = synthetic_trace(steps=3, auvs=1, nodes=1, area=area, vortices=0, sea=False)
        for x, y in ((0.3, 0.7), (0.6, 0.2)):
            at = np.array([x * area[0], y * area[1]])
            moved = replace(
                trace,
                auv_position=np.broadcast_to(at, (3, 1, 1, 2)),
                fix=np.broadcast_to(at, (3, 1, 1, 2)),
                node_position=np.array([[[0.95 * area[0], 0.95 * area[1]]]]),
                hovering=np.zeros((3, 1, 1), np.int8),
                delivered=np.zeros((3, 1, 1)),
            )
            frame, painter = paint(moved, 0)
            row, column = place(painter, *at, area)
            reach = 14
            around = frame[row - reach : row + reach + 1, column - reach : column + reach + 1]
            rows, columns = np.nonzero((around == style.auv_colour(0)).all(-1))
            assert len(rows) > 20
            # The body's middle lies a little ahead of the position, which is the middle of the whole outline.
            assert abs(rows.mean() - reach) < 5
            assert abs(columns.mean() - reach) < 5

    def test_headings_point_the_right_way(self):
        picture = np.zeros((80, 80, 3), np.uint8)
        shapes.auv(picture, np.array([40.0, 40.0]), np.pi / 2, 60, (255, 255, 255), 4)
        rows = np.nonzero((picture == 255).all(-1))[0]
        band = np.nonzero(picture[:, 40].max(-1) < 60)[0]
        assert rows.min() < 14  # the nose in the north, at the top
        assert ((band > 15) & (band < 35)).any()  # and the dark band near it

    def test_ellipse_axes_are_those_of_the_covariance(self):
        for covariance in ((0.09, 0.03, 0.04), (4.0, -1.9, 1.0), (1.0, 0.0, 0.25), (0.0, 0.0, 0.0)):
            xx, xy, yy = covariance
            axes = error_axes(np.array(covariance))
            np.testing.assert_allclose(axes.T @ axes / 4, [[xx, xy], [xy, yy]], atol=1e-12)
            values = np.linalg.eigvalsh([[xx, xy], [xy, yy]])
            np.testing.assert_allclose(np.hypot(axes[:, 0], axes[:, 1]), 2 * np.sqrt(np.maximum(values, 0)), atol=1e-7)

    def test_two_sigma_ellipse_holds_86_per_cent(self):
        covariance = np.array([[0.09, 0.03], [0.03, 0.04]])
        axes = error_axes(np.array([0.09, 0.03, 0.04]))
        fixes = np.random.default_rng(0).multivariate_normal([0, 0], covariance, 20000)
        inside = (np.linalg.solve(axes.T, fixes.T) ** 2).sum(0) < 1
        assert inside.mean() == pytest.approx(0.8647, abs=0.01)

    def test_node_colour_tells_the_backlog(self):
        trace = synthetic_trace(steps=2, auvs=1, nodes=3, sea=False, vortices=0)
        trace = replace(
            trace,
            node_position=np.array([[[50.0, 50.0], [100.0, 50.0], [150.0, 50.0]]]),
            backlog=np.broadcast_to([0.0, 2500.0, 5000.0], (2, 1, 3)),
            auv_position=np.full((2, 1, 1, 2), 180.0),
            fix=np.full((2, 1, 1, 2), 180.0),
            target=np.zeros((2, 1, 1), np.int16),
            boat_position=np.full((2, 1, 1, 2), 150.0),
            boat_goal=np.full((2, 1, 1, 2), 150.0),
        )
        frame, painter = paint(trace, 0)
        aside = round(0.35 * painter.map._node_radius)
        for x, share, colour in zip((50.0, 100.0, 150.0), (0.0, 0.5, 1.0), style.GAUGE, strict=True):
            row, column = place(painter, x, 50.0)
            empty = style.mix(style.OUTLINE, colour, 0.35)
            left, right = (frame[row, column + side].astype(int) for side in (-aside, aside))  # clockwise from the top
            assert np.abs(right - (colour if share > 0 else empty)).max() < 12
            assert np.abs(left - (colour if share > 0.5 else empty)).max() < 12
        halo = (frame == style.FULL).all(-1).sum()
        calm, _ = paint(replace(trace, backlog=np.broadcast_to([0.0, 2500.0, 4990.0], (2, 1, 3))), 0)
        assert halo > (calm == style.FULL).all(-1).sum() + 10

    def test_ring_of_a_node_brightens_with_the_age_of_its_data(self):
        steps = 400  # nobody visits node 1; node 0 is served in step 199
        trace = synthetic_trace(steps=steps, auvs=1, nodes=2, sea=False, vortices=0)
        hovering, target = np.zeros((steps, 1, 1), np.int8), np.zeros((steps, 1, 1), np.int16)
        hovering[198:200], target[199:] = 1, 1
        served = np.zeros((steps, 1, 1))
        served[199] = 0.25
        trace = replace(
            trace,
            node_position=np.array([[[50.0, 50.0], [150.0, 50.0]]]),
            auv_position=np.full((steps, 1, 1, 2), 180.0),
            fix=np.full((steps, 1, 1, 2), 180.0),
            hovering=hovering,
            target=target,
            service_rate=served,
            backlog=np.full((steps, 1, 2), 100.0),
            boat_position=np.full((steps, 1, 1, 2), 150.0),
        )
        radius = round(0.92 * Painter(trace, (1280, 720)).map._node_radius)

        def rings(t: int) -> list[float]:
            frame, painter = paint(trace, t, (1280, 720))
            rows = [place(painter, x, 50.0) for x in (50.0, 150.0)]
            return [float(frame[row, column - radius].mean()) for row, column in rows]

        (first, other), (fresh, old) = rings(150), rings(250)
        assert first == pytest.approx(other, abs=3)
        assert fresh < 0.7 * first < 0.7 * old

    def test_rings_of_stations_stay_as_they_are(self):
        trace = replace(
            synthetic_trace(steps=400, auvs=1, nodes=1, sea=False), scenario=Scenario.load("station-keeping")
        )
        assert (Painter(trace, (640, 360)).map._age == 0).all()

    def test_line_leads_to_the_next_nodes_and_no_further(self):
        steps, nodes = (
            12,
            np.array([[[20.0, 20.0], [20.0, 60.0], [60.0, 60.0], [60.0, 20.0], [100.0, 20.0], [100.0, 60.0]]]),
        )
        trace = synthetic_trace(steps=steps, auvs=1, nodes=6, sea=False, vortices=0)
        trace = replace(
            trace,
            node_position=nodes,
            auv_position=np.full((steps, 1, 1, 2), 180.0),
            fix=np.full((steps, 1, 1, 2), 180.0),
            hovering=np.zeros((steps, 1, 1), np.int8),
            target=(np.arange(steps)[:, None, None] // 2).astype(np.int16),
            service_rate=np.zeros((steps, 1, 1)),
            delivered=np.zeros((steps, 1, 1)),
            boat_position=np.full((steps, 1, 1, 2), 180.0),
            boat_goal=np.full((steps, 1, 1, 2), 180.0),
        )
        legs = [(nodes[0, i] + nodes[0, i + 1]) / 2 for i in range(5)]
        staying = replace(trace, target=np.zeros_like(trace.target))

        def drawn(t: int) -> list[bool]:
            frame, painter = paint(trace, t, (1280, 720))
            difference = np.abs(frame.astype(int) - paint(staying, t, (1280, 720))[0]).max(-1)
            places = [place(painter, *leg) for leg in legs]
            return [bool(difference[row - 2 : row + 3, column - 2 : column + 3].max() > 20) for row, column in places]

        assert drawn(0) == [True, True, True, False, False]
        assert drawn(3) == [False, True, True, True, False]  # from node 1 on
        assert drawn(steps - 1) == [False] * 5

    def test_sea_is_brighter_where_it_is_higher_and_north_is_up(self):
        view = MapView(Area(), Rectangle(0, 0, 100, 100))
        rising = np.broadcast_to(np.linspace(-1, 1, 50, dtype=np.float32)[:, None], (50, 50))
        surface = SeaSurface(rising[None], view)
        assert surface.limit == 1
        picture = np.zeros((100, 100, 3), np.uint8)
        surface.paint(picture, 0)
        assert picture[5].mean() > picture[50].mean() > picture[94].mean()

    def test_relief_is_lit_from_the_north_west(self):
        view = MapView(Area(), Rectangle(0, 0, 120, 120))
        y, x = np.mgrid[-1:1:60j, -1:1:60j]
        hill = np.exp(-6 * (x**2 + y**2)).astype(np.float32)
        surface = SeaSurface(hill[None], view)
        picture = np.zeros((120, 120, 3), np.uint8)
        surface.paint(picture, 0)
        north_west, south_east = picture[42, 42].mean(), picture[77, 77].mean()  # equally high
        assert north_west > south_east + 5

    VORTEX = np.array([[80.0, 120.0, 200.0, 30.0], [20.0, 30.0, -150.0, 40.0]])
    STREAM = np.array([[[0.1, 0.2], [0.3, 0.2]], [[0.1, -0.2], [0.3, -0.2]]])  # 0.1 + 0.2 x/200, 0.2 − 0.4 y/200

    def current(self, vortex: np.ndarray, points: np.ndarray) -> np.ndarray:
        expected = np.stack([0.1 + 0.001 * points[:, 0], 0.2 - 0.002 * points[:, 1]], 1)
        for x0, y0, circulation, radius in vortex:
            dx, dy = points[:, 0] - x0, points[:, 1] - y0
            r2 = dx**2 + dy**2
            turn = circulation / (2 * np.pi * r2) * -np.expm1(-r2 / radius**2)
            expected += np.stack([-turn * dy, turn * dx], 1)
        return expected

    def drift(self, streaks: CurrentStreaks) -> tuple[np.ndarray, np.ndarray]:
        """Where particles are (m) and how far they move in half a second (m), those that move visibly."""
        seen = []

        class Recorder:
            def white_lines(self, lines: np.ndarray, *_: object) -> None:
                seen.append(lines)

        streaks.draw(Recorder(), 10.0, 1)
        streaks.draw(Recorder(), 10.5, 1)
        first, second = seen[0][:, 0], seen[2][:, 0]
        moving = (np.hypot(*(second - first).T) > 0) & (np.hypot(*(first - seen[0][:, -1]).T) > 5)
        metres = (second - first)[moving] * (1 / 3, -1 / 3)
        return np.stack([first[moving, 0] + 0.5, 599.5 - first[moving, 1]], 1) / 3, metres

    @pytest.mark.parametrize("moved", [False, True])
    def test_streaks_drift_with_the_current(self, moved):
        view = MapView(Area(), Rectangle(0, 0, 600, 600))
        vortex = self.VORTEX
        streaks = CurrentStreaks(vortex, self.STREAM, 200.0, 200.0, view, 1.0)
        points = np.random.default_rng(0).uniform(0, 200, (4000, 2))
        assert streaks.fastest == pytest.approx(np.hypot(*self.current(vortex, points).T).max(), rel=0.1)
        if moved:
            vortex = vortex + np.array([30.0, -40.0, 0.0, 10.0])
            streaks.update(vortex, self.STREAM)
        places, metres = self.drift(streaks)
        inside = ((places > 0) & (places < 200)).all(axis=1)  # outside, the stream is that of the edge
        close = np.hypot(*(metres - 0.5 * self.current(vortex, places)).T) < 0.05
        assert inside.sum() > 100
        assert close[inside].mean() > 0.97  # the rest ended its life in between

    def test_streaks_follow_the_stream(self):
        view = MapView(Area(), Rectangle(0, 0, 600, 600))
        streaks = CurrentStreaks(self.VORTEX[:0], self.STREAM, 200.0, 200.0, view, 1.0)
        streaks.update(self.VORTEX[:0], -self.STREAM)
        places, metres = self.drift(streaks)
        inside = ((places > 0) & (places < 200)).all(axis=1)
        close = np.hypot(*(metres + 0.5 * self.current(self.VORTEX[:0], places)).T) < 0.05
        assert close[inside].mean() > 0.97

    def test_no_current_no_streaks(self):
        view = MapView(Area(), Rectangle(0, 0, 600, 600))
        streaks = CurrentStreaks(np.zeros((0, 4)), np.zeros((0, 0, 2)), 200.0, 200.0, view, 1.0)
        assert streaks.fastest == 0
