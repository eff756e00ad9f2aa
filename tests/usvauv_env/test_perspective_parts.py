"""What is in the perspective view: scene, what lies below, vehicles, sound and lines of worth."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tests.usvauv_env.made_traces import synthetic_trace, with_second_boat
from usvauv.env.render import perspective, style, symbols
from usvauv.env.render.camera import Camera, Swing
from usvauv.env.render.canvas import Canvas
from usvauv.env.render.exchanges import Exchanges
from usvauv.env.render.frame_layout import Layout, Rectangle
from usvauv.env.render.itinerary import Itinerary
from usvauv.env.render.map import SIGMAS
from usvauv.env.render.perspective import PerspectiveView
from usvauv.env.render.reply_field import EVERY, LEVELS, ReplyField
from usvauv.env.render.running_metrics import RunningMetrics
from usvauv.env.render.scene import Scene, track
from usvauv.env.render.sea_layers import COLOURS
from usvauv.env.render.sound import Sound
from usvauv.env.render.wave_sheet import Columns, look
from usvauv.env.scenario import Scenario
from usvauv.kernels.positioning import usbl

SIDES = (300.0, 160.0)
BOX = Rectangle(30, 20, 640, 460)
LAYOUT = Layout.fit(1280, 720, Scenario.load("extreme").area)


def mission(**changes):
    trace = with_second_boat(synthetic_trace(steps=40, auvs=3, nodes=9, area=SIDES, vortices=0, sea=False, seed=3))
    off = np.array([(6.0, 3.0), (-7.0, 5.0), (5.0, -9.0)])
    trace = replace(
        trace,
        hovering=0 * trace.hovering,
        estimate=trace.auv_position + 2 * off,
        foreseen_position=trace.auv_position - 3 * off,
        estimate_covariance=np.zeros_like(trace.estimate_covariance) + np.array([6.0, 2.0, 4.0]),
        boat_goal=trace.boat_position + np.array([(60.0, 40.0), (-40.0, 90.0)]),
        delivered=0 * trace.delivered,
    )
    trace.fix_flags[:] = usbl.SILENT
    trace.fix_flags[26:28, 0] = usbl.DETECTED
    return replace(trace, **changes)


def view_of(trace):
    return PerspectiveView(trace, RunningMetrics.of(trace), BOX, LAYOUT)


def found(lines, expected):
    """How many of the lines are through the points expected."""
    expected = np.asarray(expected, float)
    return sum(np.shape(line) == expected.shape and np.allclose(line, expected) for line in lines)


class TestScene:
    SCENE = Scene((300.0, 160.0), 2.0, 0.5, -50.0, -40.0, -50.0)

    def test_places_are_relative_to_the_middle_at_their_heights(self):
        flat = np.array([[(0.0, 0.0), (300.0, 160.0)], [(200.0, 20.0), (150.0, 80.0)]])
        up = np.array([[1.0, 2.0], [3.0, 4.0]])
        np.testing.assert_array_equal(
            self.SCENE.place(flat, up), [[(-150, -80, 1), (150, 80, 2)], [(50, -60, 3), (0, 0, 4)]]
        )

    def test_what_floats_is_on_the_surface_between_its_cells(self):
        x, y = (np.arange(60) + 0.5) * 5 - 150, ((np.arange(16) + 0.5) * 10 - 80)[:, None]
        heights = (0.02 * x - 0.05 * y + 1).astype(np.float32)
        flat = np.random.default_rng(0).uniform((-145, -74), (145, 74), (50, 2))
        afloat = self.SCENE.afloat(flat, heights)
        np.testing.assert_allclose(afloat[:, 2], 0.02 * flat[:, 0] - 0.05 * flat[:, 1] + 1, atol=0.01)
        np.testing.assert_array_equal(afloat[:, :2], flat)
        beyond = self.SCENE.afloat(np.array([(-400.0, -300.0), (400.0, 300.0)]), heights)
        np.testing.assert_allclose(beyond[:, 2], [heights[0, 0], heights[-1, -1]])

    def test_scales_make_small_waves_and_flat_areas_visible_and_no_more(self):
        for width, limit in ((300.0, 0.2), (300.0, 5.0), (5000.0, 1.0), (40.0, 0.01), (19000.0, 0.01)):
            scenario = Scenario.load("extreme", [f"area.width={width}", "area.length=40", "auv.start_separation=1"])
            scene = Scene.of(scenario, limit)
            assert scene.heights in (1, 2, 5, 10, 20, 50, 100)
            share = scene.heights * limit / width
            assert share >= 0.012 or scene.heights == 100
            assert scene.heights == 1 or share < 0.03 or limit < 0.02
            assert -scene.bed == scene.depths * 120
            assert -scene.auvs == scene.depths * 100
            assert -scene.bed / width >= 0.3 or scene.depths == 1
            assert -scene.bed / width <= max(0.75, 120 / width if scene.depths == 1 else 0)


class TestBelow:
    def test_all_of_an_auv_is_where_the_camera_sees_it(self, drawn):
        trace, t = mission(), 30
        view = view_of(trace)
        camera, scene, itinerary = view.camera(t), view.scene, Itinerary(trace)
        view.draw(np.zeros((720, 1280, 3), np.uint8), t)
        auvs, nodes = (
            scene.place(trace.auv_position[:, 0], scene.auvs),
            scene.place(trace.node_position[0], scene.nodes),
        )
        lines = [points for points, *_ in drawn["line"]]
        pieces = [points for points, *_ in drawn["pieces"]]
        for k in range(3):
            place = auvs[t, k]
            trail = next(points for points, ink, *_ in drawn["trail"] if ink == style.auv_colour(k))
            np.testing.assert_allclose(trail, auvs[track(t, 1.0), k])
            foot = np.array([*place[:2], scene.bed])
            assert found(lines, [place, foot]) == 1
            assert found([centre for centre, *_ in drawn["circle"]], foot) == 1
            stops = [itinerary.node(t, k), *itinerary.after(t, k)]
            for a, b in pairwise(stops):
                assert found(lines, nodes[[a, b]]) == 1
            outline = next(
                points
                for points in lines
                if len(points) == 65
                and np.allclose(points[:-1, :2].mean(0), trace.estimate[t, 0, k] - np.array(SIDES) / 2)
            )
            offsets = (outline[:, :2] + np.array(SIDES) / 2 - trace.estimate[t, 0, k]) / SIGMAS
            inverse = np.linalg.inv([[6.0, 2.0], [2.0, 4.0]])
            np.testing.assert_allclose(np.einsum("ni,ij,nj->n", offsets, inverse, offsets), 1)
            assert (outline[:, 2] == place[2]).all()
            np.testing.assert_array_equal(outline[0], outline[-1])
            begin, node = camera.pixel(place), camera.pixel(nodes[stops[0]])
            assert any(
                np.allclose(each[0, 0], begin)
                and np.cross([*(node - begin), 0], [*(each[-1, 1] - begin), 0])[2] == pytest.approx(0, abs=1e-4)
                for each in pieces
                if each.ndim == 3
            )
        for name, places in (("fix", trace.estimate), ("foreseen", trace.foreseen_position)):
            expected = camera.pixel(scene.place(places[t, 0], scene.auvs))
            order = np.argsort(-camera.away(auvs[t]))
            np.testing.assert_allclose([at for at, *_ in drawn[name]], expected[order])
        for text, at, *_ in drawn["badge"]:
            pixel = camera.pixel(auvs[t, int(text) - 1])
            assert 12 < np.hypot(*(at - pixel)) < 26
            assert at[0] > pixel[0]
            assert at[1] < pixel[1]
        assert [text for text, *_ in drawn["badge"]] == ["1", "2", "3"]

    def test_services_are_circles_that_fill(self, drawn):
        trace = mission()
        hovering = trace.hovering.copy()
        hovering[27:31, 0, 1] = 1
        trace = replace(trace, hovering=hovering)
        view = view_of(trace)
        view.draw(np.zeros((720, 1280, 3), np.uint8), 28)
        node = view.scene.place(trace.node_position[0, trace.target[27, 0, 1]], view.scene.nodes)
        dim, full = [each for each in drawn["circle"] if np.allclose(each[0], node)]
        assert dim[1] == full[1] == max(trace.scenario.auv.hover_radius, 0.04 * 300)
        assert full[2] == style.auv_colour(1)
        assert full[4] == pytest.approx(0.5)
        assert len(dim) == 3

    def test_bodies_are_drawn_far_to_near_with_their_headings(self, drawn):
        trace, t = mission(), 30
        view, running = view_of(trace), RunningMetrics.of(trace)
        view.draw(np.zeros((720, 1280, 3), np.uint8), t)
        camera = view.camera(t)
        auvs, boats = drawn["body"][:3], drawn["body"][3:]
        for found, places, headings in (
            (auvs, view._below.auvs[t], running.heading[t]),
            (boats, view.boats[t], running.boat_heading[t]),
        ):
            order = np.argsort(-camera.away(places))
            for (_, place, axes, length), k in zip(found, order, strict=True):
                np.testing.assert_allclose(place, places[k])
                np.testing.assert_allclose(axes[0], [math.cos(headings[k]), math.sin(headings[k]), 0], atol=1e-9)
                assert 10 < length < 40
        assert {length for *_, length in auvs} < {length - 1 for *_, length in boats} or auvs[0][3] < boats[0][3]

    def test_nodes_stand_on_stalks_and_near_ones_hide_the_far(self, drawn, monkeypatch):
        trace, made = mission(), []
        monkeypatch.setattr(symbols.NodeGauges, "draw", lambda gauges, _, *rest: made.append((gauges._radius, *rest)))
        view = view_of(trace)
        view.draw(np.zeros((720, 1280, 3), np.uint8), 30)
        camera = view.camera(30)
        nodes = view.scene.place(trace.node_position[0], view.scene.bed)
        order = np.argsort(-camera.away(nodes))
        stalks = drawn["pieces"][2][0]
        np.testing.assert_allclose(stalks[:, 0], camera.pixel(nodes))
        np.testing.assert_allclose([at for _, at, *_ in made], stalks[order, 1])
        np.testing.assert_allclose(
            [share for _, _, share, *_ in made], trace.backlog[30, 0][order] / trace.scenario.nodes.buffer
        )
        radii = np.array([radius for radius, *_ in made])
        assert (np.diff(radii) >= 0).all()
        assert radii[0] < radii[-1]
        np.testing.assert_allclose(np.hypot(*(stalks[:, 1] - stalks[:, 0]).T)[order], 1.5 * radii)
        assert (stalks[:, 1, 1] < stalks[:, 0, 1]).all()
        assert {pulse for *_, pulse in made} == {0.5 + 0.5 * math.sin(0.35 * 30)}
        assert np.allclose([age for *_, age, _ in made], view._below._age[30][order])

    @pytest.mark.parametrize("task", ["data-collection", "station-keeping"])
    def test_stations_have_no_age(self, task):
        trace = mission()
        scenario = trace.scenario.model_copy(update={"task": task})
        age = view_of(replace(trace, scenario=scenario, target=0 * trace.target))._below._age
        assert age.any() == (task == "data-collection")


class TestAfloat:
    def test_wake_and_way_lie_on_the_water(self, drawn):
        trace, t = mission(), 30
        surface = np.broadcast_to(np.linspace(-2, 4, 40, dtype=np.float32)[:, None], (40, 40, 60)).copy()
        trace = replace(trace, surface=surface)
        view = view_of(trace)
        view.draw(np.zeros((720, 1280, 3), np.uint8), t)
        camera, scene, (heights, _) = view.camera(t), view.scene, view.surface(t)
        for boat in range(2):
            places = scene.place(trace.boat_position[track(t, 1.0), 0, boat], 0.0)[:, :2]
            wakes = [points for points, ink, *_ in drawn["trail"] if ink == style.BOAT]
            assert found(wakes, scene.afloat(places, heights)) == 1
            goal = scene.place(trace.boat_goal[t, 0, boat], 0.0)[None, :2]
            end = camera.pixel(scene.afloat(goal, heights))[0]
            assert found([at for at, *_ in drawn["cross"]], end) == 1
            ways = [points for points, ink, *_ in drawn["pieces"] if ink == style.BOAT and points.shape[1] == 2]
            way = next(points for points in ways if np.allclose(points[-1, 1], end))
            begin = camera.pixel(scene.afloat(view.boats[t, boat][None, :2], heights))[0]
            np.testing.assert_allclose(way[0, 0], begin)
            gaps = np.diff(way.reshape(-1, 2) @ (end - begin))
            assert (gaps > 0).all()
        assert len(drawn["cross"]) == 2
        np.testing.assert_allclose(view.boats[..., 2], scene.heights * trace.boat_surface[:, 0, :, 0])

    @pytest.mark.parametrize("unit", [1, 2])
    def test_near_goals_are_not_drawn(self, drawn, unit):
        trace = mission()
        layout, box = (
            Layout.fit(1280 * unit, 720 * unit, trace.scenario.area),
            Rectangle(*(unit * side for side in BOX)),
        )
        view = PerspectiveView(trace, RunningMetrics.of(trace), box, layout)
        camera = view.camera(1)
        aside = np.append(camera.right, 0.0)
        counts = []
        for pixels in (18, 22):
            goal = trace.boat_position.copy()
            for boat in range(2):
                place = view.boats[1, boat]
                metres = pixels * unit / np.hypot(*(camera.pixel(place + aside) - camera.pixel(place)))
                goal[1, 0, boat] += metres * camera.right
            drawn.clear()
            changed = replace(trace, boat_goal=goal)
            picture = np.zeros((unit * 720, unit * 1280, 3), np.uint8)
            PerspectiveView(changed, RunningMetrics.of(changed), box, layout).draw(picture, 1)
            counts.append(len(drawn.get("cross", [])))
        assert counts == [0, 2]

    def test_the_surface_lies_translucent_over_what_is_below(self):
        camera = Swing.around(SIDES, 4.0, -50.0, (600, 400)).middle
        columns = Columns.of(camera, SIDES, 640)
        sheet = look(camera, columns, SIDES, np.zeros((20, 30), np.float32), 460)
        ground, colours = np.full((460, 640, 3), 50, np.uint8), np.full((20, 30, 3), 200, np.uint8)
        perspective._paint_surface(ground, columns, sheet, colours)
        opacity = (ground[round(sheet.shore.mean()) - 4, 320, 0] - 50) / 150
        assert 0.6 < opacity < 0.9
        assert sorted(set(ground.ravel().tolist())) == [50, round(50 + 150 * perspective.OPACITY)]
        for i in range(4, len(columns.x) - 4, 11):
            rows = np.flatnonzero(ground[:, round(columns.x[i]), 0] > 50)
            assert rows[0] == pytest.approx(sheet.horizon[i], abs=2.5)
            assert rows[-1] == pytest.approx(sheet.shore[i], abs=2.5)

    def test_the_room_is_lightest_above_its_middle_and_alike_at_both_sides(self):
        room = perspective._backdrop(301, 161).astype(int)
        assert np.abs(room - room[:, ::-1]).max() <= 2
        light = room.sum(-1)
        assert light[60, 150] > light[0, 150] > light[-1, 150]
        assert light[60, 150] > light[60, 0] > light[-1, 0]
        np.testing.assert_allclose(room[60, 150], style.colour("#1d3346"), atol=2)
        rows = light.mean(1)
        assert rows.argmax() == pytest.approx(0.375 * 160, abs=8)
        assert (room[-1, 0] >= np.array(style.DARK.background) - 1).all()

    def test_the_scale_of_heights_stands_between_its_ends(self, page):
        trace = synthetic_trace(steps=3, area=SIDES)
        view = view_of(trace)
        said = {words.text: words for words in page.words}
        high, low, note = said["+5 m"], said["sea surface  −5"], said["true to scale, vehicles enlarged"]
        highest = np.flatnonzero((view._backdrop[:30] == COLOURS[255].astype(np.uint8)).all(-1).any(0))
        lowest = np.flatnonzero((view._backdrop[:30] == COLOURS[0].astype(np.uint8)).all(-1).any(0))
        assert low.place[2] < lowest.min() < highest.max() < high.place[0]
        assert lowest.min() - low.place[2] == pytest.approx(high.place[0] - highest.max(), abs=2.5)
        assert high.position[0] == note.position[0] < BOX.width
        assert BOX.width - note.position[0] == pytest.approx(BOX.height - note.position[1], abs=2)
        rows = np.flatnonzero((view._backdrop == COLOURS[255].astype(np.uint8)).all(-1).any(1))
        assert high.place[1] <= rows.min() + 2 < rows.max() - 4 < high.position[1]
        for size, shown in (((300, 150), True), ((180, 200), False), ((300, 149), False)):
            page.words.clear()
            PerspectiveView(trace, RunningMetrics.of(trace), Rectangle(0, 0, *size), LAYOUT)
            said = {words.text for words in page.words}
            assert ("+5 m" in said) == shown
            assert any("vehicles enlarged" in text or text.endswith("…") for text in said) == (size[1] >= 150)

    def test_each_frame_is_drawn_over_the_room(self):
        view = view_of(mission())
        pictures = [np.full((720, 1280, 3), ink, np.uint8) for ink in (0, 77)]
        for picture in pictures:
            view.draw(picture, 3)
        boxes = [BOX.of(picture) for picture in pictures]
        np.testing.assert_array_equal(*boxes)
        np.testing.assert_array_equal(boxes[0][:40, :20], view._backdrop[:40, :20])


class TestSound:
    @pytest.mark.parametrize("t", [26, 29, 34, 39])
    def test_pings_are_spheres_and_who_is_heard_has_a_line(self, drawn, t):
        trace = mission()
        scene = Scene.of(trace.scenario, 0.0)._replace(depths=0.5, bed=-60.0, auvs=-50.0)
        boats, auvs = scene.place(trace.boat_position[:, 0], 1.0), scene.place(trace.auv_position[:, 0], scene.auvs)
        sound, exchanges = Sound(trace, scene, boats, auvs), Exchanges(trace)
        camera = Camera(1.9, 800.0, 300.0, 900.0, (320.0, 200.0))
        canvas = Canvas(np.zeros((480, 640, 3), np.uint8), camera)
        sound.draw_below(canvas, t, 2)
        lines = drawn.pop("line", [])
        direct = [points for points, *_ in lines if len(points) == 2]
        for k in range(3):
            boat, fresh = exchanges.heard(t, k)
            assert found(direct, [boats[t, boat], auvs[t, k]]) == (0.85 * fresh > 0.1)
        running = [(b, share) for b, share in enumerate(exchanges.ping(t)) if share]
        arcs = [points for points, *_ in lines if len(points) > 2]
        assert bool(arcs) == bool(running)
        heights = np.full((20, 30), 1.5, np.float32)
        sound.draw_afloat(canvas, t, heights, 2)
        circles = [points for points, *_ in drawn.pop("line", [])]
        radii = {}
        for boat, share in running:
            way = np.linalg.norm((auvs[t] - boats[t, boat]) / (1, 1, 0.5), axis=1).max()
            radii[boat] = share * way
        seen = set()
        for points in arcs:
            away = [np.linalg.norm((points - boats[t, boat]) / (1, 1, 0.5), axis=1) for boat in radii]
            boat = next(boat for boat, each in zip(radii, away, strict=True) if np.allclose(each, radii[boat]))
            flat = points[:, :2] - boats[t, boat, :2]
            plane = next(
                name
                for name in ("right", "forward")
                if np.allclose(
                    np.cross(np.pad(flat, ((0, 0), (0, 1))), [*getattr(camera, name), 0])[:, 2], 0, atol=1e-6
                )
            )
            seen.add((boat, plane))
            assert (points[:, 2] <= boats[t, boat, 2] + 1e-9).all()
            assert (points[:, 2] >= scene.bed - 1e-6).all()
            assert (np.abs(points[:, :2]) <= np.array(SIDES) / 2 + 1e-6).all()
        assert len(seen) == 2 * len(radii) or not radii
        for points in circles:
            away = [np.hypot(*(points[:, :2] - boats[t, boat, :2]).T) for boat in radii]
            assert any(np.allclose(each, radii[boat]) for boat, each in zip(radii, away, strict=True))
            assert (points[:, 2] == 1.5).all()
        assert bool(circles) or not radii

    def test_lines_and_spheres_fade(self, drawn):
        trace = mission()
        scene = Scene.of(trace.scenario, 0.0)
        boats, auvs = scene.place(trace.boat_position[:, 0], 1.0), scene.place(trace.auv_position[:, 0], scene.auvs)
        sound, heard, rings = Sound(trace, scene, boats, auvs), [], []
        canvas = Canvas(np.zeros((480, 640, 3), np.uint8), Camera(1.9, 800.0, 300.0, 900.0, (320.0, 200.0)))
        for t in (27, 29, 33):
            drawn.clear()
            sound.draw_below(canvas, t, 2)
            for kind, length in ((heard, True), (rings, False)):
                inks = [ink for points, ink, _ in drawn["line"] if (len(points) == 2) == length]
                kind.append(np.abs(np.subtract(inks[0], (0x56, 0x3B, 0x12))).sum())  # from the colour of deep water
        assert heard[0] > heard[1] > heard[2]
        assert rings[0] > rings[1] > rings[2]


class TestField:
    def field(self, width=300.0, length=600.0):
        wide = [f"area.width={width}", f"area.length={length}", "channel.data_ratio=18", "acoustics.source_level=139"]
        trace = synthetic_trace(steps=9, auvs=2, nodes=2, vortices=0, sea=False)
        foreseen = np.zeros_like(trace.estimate)
        foreseen[:, 0] = (75.0, 150.0), (225.0, 525.0)
        foreseen[6:, 0, 0] += 90.0
        covariance = np.zeros_like(trace.estimate_covariance)
        covariance[:, 0, 0], covariance[:, 0, 1] = (200.0, 90.0, 400.0), (150.0, 50.0, 50.0)
        scenario = Scenario.load("extreme", [*wide, "nodes.count=2"])
        return ReplyField(replace(trace, scenario=scenario, foreseen_position=foreseen, estimate_covariance=covariance))

    def test_an_area_that_is_not_square_has_its_own_grid(self):
        field = self.field()
        share = field.share(2)
        assert share.shape == (41, 21)
        np.testing.assert_allclose([share[10, 5], share[35, 15]], [0.75, 0.25], atol=0.01)
        assert self.field(600.0, 300.0).share(2).shape == (21, 41)

    def test_lines_lie_where_the_field_has_their_level_and_are_made_every_few_steps(self):
        field = self.field()
        share = field.share(3)
        lines = field.lines(3)
        assert tuple(level for level, _ in lines) == LEVELS
        assert any(found for _, found in lines)
        for level, found in lines:
            for line in found:
                for x, y in line:
                    column, row = min(int(x / 15), 19), min(int(y / 15), 39)
                    p, q = x / 15 - column, y / 15 - row
                    a, b, c, d = share[row : row + 2, column : column + 2].ravel()
                    assert (1 - q) * ((1 - p) * a + p * b) + q * ((1 - p) * c + p * d) == pytest.approx(level, abs=0.02)
        assert EVERY == 3
        assert field.lines(5) is field.lines(4) is lines
        assert field.lines(6) is not lines
        moved = np.concatenate(dict(field.lines(6))[0.4])
        np.testing.assert_allclose(moved.mean(0) - np.concatenate(dict(lines)[0.4]).mean(0), 90.0, atol=60)
        assert np.allclose(np.concatenate(dict(field.lines(5))[0.4]), np.concatenate(dict(lines)[0.4]))

    @pytest.mark.parametrize(
        ("low", "high", "shown"), [(0.8, 1.0, True), (0.81, 1.0, False), (0.0, 0.2, True), (0.0, 0.19, False)]
    )
    def test_there_are_none_where_all_or_hardly_anything_is_heard(self, low, high, shown):
        field = self.field()
        field.share = lambda _: np.linspace(low, high, 41 * 21).reshape(41, 21)
        assert bool(field.lines(3)) == shown
