"""Figures of the panel beside NumPy: metrics so far, who was heard, ways ahead, fixes, section, reward, errors."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tests.usvauv_env.made_traces import synthetic_trace, with_second_boat
from tests.usvauv_env.test_frames import LAYOUT, stations
from usvauv.env.record.metrics import target_distance
from usvauv.env.render import depth_section, popups, shapes, side_panel, style, symbols
from usvauv.env.render.depth_section import DepthSection
from usvauv.env.render.exchanges import HEARD_FRAMES, PING_FRAMES, Exchanges
from usvauv.env.render.fix_insets import FixInsets
from usvauv.env.render.frame_layout import MapView, Rectangle, nice
from usvauv.env.render.itinerary import NEXT, Itinerary
from usvauv.env.render.map import TRAIL
from usvauv.env.render.painter import Look, Painter
from usvauv.env.render.popups import FRAMES, Popups
from usvauv.env.render.running_metrics import MEDIAN_WINDOW, RunningMetrics, _heading, _service_share, figures
from usvauv.env.render.scene import track
from usvauv.env.scenario.sea import Area
from usvauv.kernels.positioning import usbl


def random():
    """The same numbers in each test, in whichever order they run."""
    return np.random.default_rng(7)


class TestRunning:
    STEPS, STEP = 150, 0.5

    @pytest.fixture(scope="class")
    @classmethod
    def trace(cls):
        trace = with_second_boat(synthetic_trace(steps=cls.STEPS, worlds=2, auvs=3, area=(300.0, 200.0)))
        mission = trace.scenario.mission.model_copy(update={"step": cls.STEP})
        boats = trace.boat_position.copy()
        boats[50:80, :, 1] += 0.4 * cls.STEP * np.arange(30)[:, None, None] * (-0.6, 0.8)
        boats[80:, :, 1] = boats[79, :, 1]
        return replace(
            trace,
            scenario=trace.scenario.model_copy(update={"mission": mission}),
            reward_names=("a", "b"),
            reward_terms=random().normal(size=(cls.STEPS, 2, 3, 2)),
            boat_position=boats,
            collisions=random().integers(0, 3, (cls.STEPS, 2)).astype(np.int16),
            estimate=trace.auv_position + random().normal(size=trace.estimate.shape) * (1.0, 3.0),
        )

    def test_series_are_those_of_the_definitions(self, trace):
        running, window = RunningMetrics.of(trace), round(MEDIAN_WINDOW / self.STEP)
        error = np.hypot(*np.moveaxis(trace.estimate - trace.auv_position, -1, 0))[:, 0]
        target = trace.node_position[0][trace.target[:, 0]]
        off = np.linalg.norm(target - trace.auv_position[:, 0], axis=-1)
        np.testing.assert_allclose(target_distance(trace)[:, 0], off)
        for t in (0, 1, 17, window - 1, window, 149):
            late, until = slice(max(0, t - window + 1), t + 1), slice(0, t + 1)
            assert running.sdr[t] == pytest.approx(trace.service_rate[until, 0].sum())
            assert running.services[t] == (trace.service_rate[until, 0] > 0).sum()
            assert running.delivered[t] == pytest.approx(trace.delivered[until, 0].sum())
            assert running.full_now[t] == trace.overflowing[t, 0]
            assert running.off_target[t] == pytest.approx(off[t].mean())
            assert running.power[t] == pytest.approx(trace.power[t, 0].sum())
            np.testing.assert_allclose(running.error_median[t], np.median(error[late], axis=0))
            np.testing.assert_allclose(running.reward[t], trace.reward_terms[late, 0].sum(1).mean(0))

    def test_figures_of_stations(self, trace):
        still = stations(trace)
        running = RunningMetrics.of(still)
        for t in (0, 40, 149):
            said = {name: f"{value:{form}}" for name, value, form in figures(still, running, t)}
            assert said == {
                "off station, m": f"{running.off_target[t]:.2f}",
                "in the mean, m": f"{running.off_target[: t + 1].mean():.2f}",
                "power now, W": f"{trace.power[t, 0].sum():.0f}",
                "EC, W": f"{running.ec[t]:.1f}",
                "AUVs too close": str(trace.collisions[: t + 1, 0].sum()),
            }

    def test_a_boat_points_along_its_way_and_keeps_its_heading_at_rest(self, trace):
        heading = RunningMetrics.of(trace).boat_heading[:, 1]
        way = math.atan2(0.8, -0.6)
        np.testing.assert_allclose(np.cos(heading[:80] - way), 1, atol=1e-6)
        np.testing.assert_allclose(np.cos(heading[80:] - way), 1, atol=1e-6)
        moves = np.diff(trace.boat_position[:, 0, 0], axis=0, prepend=trace.boat_position[:1, 0, 0])
        for t in (3, 4, 5, 60, 149):
            last = moves[max(0, t - 4) : t + 1].mean(0)
            if np.hypot(*last) > 0.02 * self.STEP:
                assert RunningMetrics.of(trace).boat_heading[t, 0] == pytest.approx(math.atan2(last[1], last[0]))

    def test_vectors_that_are_too_short_keep_the_direction(self):
        velocity = np.zeros((6, 2, 2))
        velocity[2, 0], velocity[4, 0], velocity[5, 0] = (0.0, 1.0), (-1.0, 0.0), (0.5, 0.0)
        velocity[3, 0] = 0.1, 0.0  # too short
        north, west = math.pi / 2, math.pi
        assert _heading(velocity, 0.5)[:, 0].tolist() == [north, north, north, north, west, west]
        assert _heading(velocity, 0.5)[:, 1].tolist() == [0] * 6

    def test_services_fill_their_rings_from_the_first_step_to_the_last(self):
        hovering = np.array([[0, 1, 1, 1, 1, 1, 0, 1, 1], [1, 0, 0, 1, 0, 1, 1, 1, 1]], bool).T
        completed = np.array([[0, 0, 0, 1, 0, 1, 0, 0, 0], [1, 0, 0, 0, 0, 0, 1, 1, 0]], bool).T
        expected = [[0, 1 / 3, 2 / 3, 1, 1 / 2, 1, 0, 1 / 2, 1], [1, 0, 0, 1, 0, 1 / 2, 1, 1, 1]]
        np.testing.assert_allclose(_service_share(hovering, completed).T, expected)


class TestExchanges:
    def test_pings_and_echoes_are_those_of_the_flags(self):
        steps, flags = 90, np.array([usbl.SILENT, 0, usbl.DETECTED, usbl.DETECTED | 64])
        trace = with_second_boat(synthetic_trace(steps=steps, auvs=3, nodes=2, sea=False))
        chosen = random().choice(flags, (steps, 1, 3), p=[0.9, 0.04, 0.03, 0.03]).astype(np.uint8)
        chosen[:4] = usbl.SILENT
        chosen[4:30, 0, 0] = 0
        by = random().integers(0, 2, (steps, 1, 3)).astype(np.int8)
        exchanges = Exchanges(replace(trace, fix_flags=chosen, fix_boat=by))
        begins = {0: [], 1: []}
        for t in range(steps):
            for boat in (0, 1):
                asked = any(not chosen[t, 0, k] & usbl.SILENT and by[t, 0, k] == boat for k in range(3))
                if asked and (not begins[boat] or t - begins[boat][-1] >= PING_FRAMES):
                    begins[boat].append(t)
            shares = [(t - begins[boat][-1]) / PING_FRAMES if begins[boat] else 1 for boat in (0, 1)]
            assert exchanges.ping(t) == [share if share < 1 else None for share in shares]
            for k in range(3):
                heard = [row for row in range(t + 1) if chosen[row, 0, k] & usbl.DETECTED]
                boat, fresh = exchanges.heard(t, k)
                assert fresh == (pytest.approx(math.exp((heard[-1] - t) / HEARD_FRAMES)) if heard else 0)
                assert not heard or boat == by[heard[-1], 0, k]

    def test_the_way_ahead_is_that_of_the_targets(self):
        steps = 30
        target = np.sort(random().integers(0, 9, (steps, 1, 2)), axis=0).astype(np.int16)
        hovering = random().integers(0, 2, (steps, 1, 2)).astype(np.int8)
        trace = replace(synthetic_trace(steps=steps), target=target, hovering=hovering)
        itinerary = Itinerary(trace)
        for t in range(steps):
            for auv in range(2):
                at = max(t - 1, 0) if hovering[t, 0, auv] else t
                later = [target[s, 0, auv] for s in range(at + 1, steps) if target[s, 0, auv] != target[s - 1, 0, auv]]
                assert itinerary.node(t, auv) == target[at, 0, auv]
                assert itinerary.after(t, auv) == later[:NEXT]

    @pytest.mark.parametrize("step", [0.25, 1.0, 4.0])
    @pytest.mark.parametrize("t", [0, 1, 30, 59, 60, 61, 500, 2000])
    def test_a_trail_is_two_minutes_in_at_most_sixty_even_pieces(self, t, step):
        steps = track(t, step)
        assert steps[-1] == t
        assert steps[0] == max(0, t - round(TRAIL / step))
        pieces = np.diff(steps)
        assert len(pieces) == min(steps[-1] - steps[0], 60)
        assert len(pieces) == 0 or pieces.max() - pieces.min() <= 1


class TestInsets:
    LENS = Rectangle(60, 40, 460, 200)

    def insets(self, trace, box=LENS, layout=LAYOUT):
        return FixInsets(trace, RunningMetrics.of(trace), layout, box, MapView(Area(), Rectangle(0, 0, 400, 400)))

    @pytest.mark.parametrize(
        ("count", "size", "columns"),
        [
            (1, (460, 200), 1),
            (4, (600, 120), 4),
            (3, (150, 560), 1),
            (4, (300, 330), 2),
            (5, (400, 300), 3),
            (7, (300, 420), 3),
        ],
    )
    def test_are_as_large_as_fits_in_rows_that_keep_apart(self, count, size, columns):
        box = Rectangle(60, 40, *size)
        insets = self.insets(synthetic_trace(steps=3, auvs=count, sea=False, vortices=0), box)
        centres, radius = np.array(insets._centres), insets._radius
        rows = -(-count // columns)
        for k, (x, y) in enumerate(centres):
            assert x == pytest.approx(box.left + (k % columns + 0.5) * box.width / columns)
            assert y == pytest.approx(box.top + k // columns * box.height / rows + radius)
        assert 2 * radius < min(box.width / columns, box.height / rows - 20)
        assert 2 * radius > 0.85 * min(box.width / columns, box.height / rows - 30)

    def test_scale_shows_most_fixes_and_ellipses(self):
        for factor in (0.2, 5.0):
            trace = synthetic_trace(steps=200, auvs=2, sea=False, vortices=0)
            fix = trace.heard_position + random().normal(size=trace.fix.shape)
            insets = self.insets(replace(trace, fix=fix, estimate_covariance=factor**2 * trace.estimate_covariance))
            away = np.hypot(*np.moveaxis(fix - trace.heard_position, -1, 0))
            longest = 2 * factor * math.sqrt(np.linalg.eigvalsh([[0.09, 0.03], [0.03, 0.04]]).max())
            reach = max(np.quantile(away, 0.96), longest)
            assert 0.8 < reach * insets._scale / insets._radius < 1
            assert insets.ring == nice(insets.ring)
            assert 0.3 < insets.ring * insets._scale / insets._radius <= 0.76

    def recorded(self, trace, t, monkeypatch, **changes):
        made = {"dots": [], "fix": [], "stroke": []}
        monkeypatch.setattr(shapes, "dots", lambda *a: made["dots"].append(a[1:]))
        monkeypatch.setattr(symbols, "fix", lambda *a: made["fix"].append(a[1]))
        monkeypatch.setattr(shapes, "stroke", lambda *a, **k: made["stroke"].append(a[1]))
        insets = self.insets(replace(trace, **changes))
        insets.draw(np.zeros((720, 1280, 3), np.uint8), t)
        return insets, made

    def test_fixes_estimates_and_ellipses_are_at_their_offsets_north_up(self, monkeypatch):
        trace = synthetic_trace(steps=150, auvs=2, sea=False, vortices=0)
        errors = random().normal(size=trace.fix.shape) * (0.2, 0.7)
        errors[100:110, 0, 0] = np.nan
        fix, estimate = trace.heard_position + errors, trace.auv_position + np.array([0.3, -0.2])
        insets, made = self.recorded(trace, 120, monkeypatch, fix=fix, estimate=estimate)
        for auv in (0, 1):
            centres, _, tints = made["dots"][auv]
            offsets = errors[61:121, 0, auv] * insets._scale * (1, -1)
            with np.errstate(invalid="ignore"):
                within = np.hypot(*offsets.T) < insets._radius - 2
            np.testing.assert_allclose(centres, insets._centres[auv] + offsets[within], atol=1e-3)
            weight = np.abs(tints - style.SEA[0]).sum(1)
            assert (np.diff(weight) >= 0).all()
            assert weight[-1] > 2 * weight[0]
            away = tints[-1] / np.array(style.auv_colour(auv))
            assert away.max() < 1.3
            np.testing.assert_allclose(made["fix"][auv], insets._centres[auv] + insets._scale * np.array([0.3, 0.2]))
        outlines = [points for points in made["stroke"] if len(points) > 10]
        for auv, points in enumerate(outlines):
            east, south = ((points - insets._centres[auv]) / insets._scale).T
            inverse = np.linalg.inv([[0.09, 0.03], [0.03, 0.04]])
            np.testing.assert_allclose(
                inverse[0, 0] * east**2 - 2 * inverse[0, 1] * east * south + inverse[1, 1] * south**2, 4
            )
        assert len(outlines) == 2

    def test_what_is_too_far_is_not_drawn_and_ellipses_end_at_the_rim(self, monkeypatch):
        trace = synthetic_trace(steps=100, auvs=1, sea=False, vortices=0)
        far, covariance = trace.auv_position.copy(), trace.estimate_covariance.copy()
        far[99] += 50.0
        covariance[99] = 400.0, 0.0, 1e-4
        insets, made = self.recorded(
            trace,
            99,
            monkeypatch,
            fix=far,
            heard_position=trace.auv_position,
            estimate=far,
            estimate_covariance=covariance,
        )
        assert made["fix"] == []
        assert len(made["dots"][0][0]) == 59
        away = np.hypot(*(next(p for p in made["stroke"] if len(p) > 10) - insets._centres[0]).T)
        assert away.max() == pytest.approx(insets._radius)
        assert (away > 0.99 * insets._radius).sum() > 20

    @pytest.mark.parametrize(
        ("error", "words"),
        [(0.123, "0.12"), (9.993, "9.99"), (9.996, "10.0"), (99.94, "99.9"), (99.96, "100"), (250.4, "250")],
    )
    def test_captions_have_three_digits_below_their_inset(self, page, error, words):
        trace = synthetic_trace(steps=2, auvs=2, sea=False, vortices=0)
        trace = replace(trace, estimate=trace.auv_position + np.array([0.0, error]))
        for box, form in ((self.LENS, "AUV {}: {} m off"), (Rectangle(60, 40, 140, 100), "{}: {} m")):
            page.words.clear()
            insets = self.insets(trace, box)
            insets.draw(np.zeros((720, 1280, 3), np.uint8), 0)
            assert [each.text for each in page.words] == [form.format(k, words) for k in (1, 2)]
            for centre, each in zip(insets._centres, page.words, strict=True):
                assert each.position[0] == centre[0]
                assert each.place[1] > centre[1] + insets._radius
                assert each.place[3] < box.bottom + 2
                assert each.place[2] - each.place[0] <= box.width / 2

    def test_still_parts_are_discs_rings_and_the_truth_in_their_middle(self):
        trace = synthetic_trace(steps=50, auvs=2, sea=False, vortices=0)
        insets, picture = self.insets(trace), np.full((720, 1280, 3), 200, np.uint8)
        insets.draw_still(picture)
        for auv, centre in enumerate(insets._centres):
            x, y = np.rint(centre).astype(int)
            ray = picture[y + 8, x:].astype(int)
            assert (picture[y, x] > 245).all()
            assert (np.abs(ray[6:12] - style.SEA[0]) < 3).all()
            rim, ring = insets._radius, insets.ring * insets._scale
            for radius, ink in ((rim, style.auv_colour(auv)), (ring, style.DARK.line)):
                near = ray[int(math.sqrt(radius**2 - 64)) - 1 :][:4]
                assert np.abs(near - ink).max(1).min() < 40
            assert (ray[int(rim) + 4] == 200).all()


class TestSection:
    BOX = Rectangle(100, 100, 500, 200)

    def section(self, trace, t=0):
        picture = np.zeros((720, 1280, 3), np.uint8)
        section = DepthSection(picture, trace, self.BOX, LAYOUT)
        section.draw(picture, t)
        return picture, section

    def test_the_sea_is_that_of_the_first_boats_row(self, page):
        trace = synthetic_trace(steps=3, area=(400.0, 100.0))
        y, x = np.mgrid[0:20, 0:64]
        surface = np.broadcast_to(3 * x / 63 - 1 + 0.1 * y, (3, 20, 64)).astype(np.float32)
        boats = np.broadcast_to(np.array([120.0, 61.0]), trace.boat_position.shape)
        _, section = self.section(replace(trace, surface=surface, boat_position=boats))
        water = page.fills[0][0]
        room = section._box
        line, foot = water[:-2], water[-2:]
        assert line[0, 0] == room.left
        assert line[-1, 0] == pytest.approx(room.right)
        share = (line[:, 0] - room.left) / room.width
        middle = room.top + 0.5 * room.height  # half for the sea, between its highest crest and deepest trough
        above = float(surface.max())
        np.testing.assert_allclose(
            line[:, 1], room.top + (1 - (3 * share + 0.2) / above) * (middle - room.top) / 2, atol=0.02
        )
        np.testing.assert_allclose(foot, [(room.right, room.bottom - 1), (room.left, room.bottom - 1)])
        assert any(len(points) == 2 and (points == foot).all() for points, *_ in page.strokes)
        assert section._row(-trace.scenario.area.depth) == pytest.approx(room.bottom - 1)
        beyond = replace(trace, surface=surface, boat_position=boats + np.array([0.0, 1000.0]))
        assert np.isfinite(
            DepthSection(np.zeros((720, 1280, 3), np.uint8), beyond, self.BOX, LAYOUT)._elevation(0)
        ).all()

    def test_without_a_recorded_sea_it_is_level_with_the_boat(self, page):
        trace = synthetic_trace(steps=3, sea=False)
        heave = np.broadcast_to(np.array([0.7, 0.3, 0.4]), trace.boat_surface.shape)
        _, section = self.section(replace(trace, boat_surface=heave))
        np.testing.assert_allclose(page.fills[0][0][:-2, 1], section._row(0.7))
        tilt = math.degrees(math.atan(0.5))
        heading, motion = page.words
        assert (heading.text, motion.text) == (
            "Section from the south: boat, AUVs, nodes",
            f"heave +0.70 m · tilt {tilt:.1f}°",
        )
        assert self.BOX.right - motion.position[0] == heading.position[0] - self.BOX.left
        assert (motion.position[1], motion.size) == (heading.position[1], heading.size)
        page.words.clear()
        self.section(
            replace(
                with_second_boat(trace), boat_surface=-with_second_boat(replace(trace, boat_surface=heave)).boat_surface
            )
        )
        assert [words.text.split(" · ")[0] for words in page.words] == [
            "Section from the south: boats, AUVs, nodes",
            "heave −0.70 m",
        ]

    def test_nodes_lie_on_the_bed_and_a_deeper_auv_lowers_it(self, monkeypatch):
        made = []
        monkeypatch.setattr(depth_section.shapes, "dots", lambda *a: made.append(a[1]))
        trace = synthetic_trace(steps=3, area=(400.0, 100.0), nodes=7)
        _, section = self.section(trace)
        room = section._box
        np.testing.assert_allclose(made[0][:, 0], room.left + trace.node_position[0, :, 0] / 400 * room.width)
        np.testing.assert_allclose(made[0][:, 1], room.bottom - 2)
        area = trace.scenario.area.model_copy(update={"depth": 0.5 * trace.scenario.auv.depth})
        _, shallow = self.section(replace(trace, scenario=trace.scenario.model_copy(update={"area": area})))
        assert shallow._row(-trace.scenario.auv.depth) == pytest.approx(room.bottom - 1)

    def test_a_hull_is_as_wide_as_its_deck_and_has_its_keel_below(self):
        trace = synthetic_trace(steps=3)
        _, section = self.section(replace(trace, boat_surface=0 * trace.boat_surface))
        hull = section._boat_outlines(0)[0]
        x, y = section._column(trace.boat_position[0, 0, 0, 0]), section._row(0.0)
        assert (hull[0, 0] + hull[1, 0]) / 2 == pytest.approx(x)
        assert (hull[2, 0] + hull[3, 0]) / 2 == pytest.approx(x)
        assert hull[0, 1] == hull[1, 1] < y < hull[2, 1] == hull[3, 1]
        assert np.ptp(hull[:2, 0]) > np.ptp(hull[2:, 0])

    def test_the_line_to_who_was_heard_fades(self, page):
        trace = with_second_boat(synthetic_trace(steps=40))
        trace.fix_flags[:] = usbl.SILENT
        trace.fix_flags[3, 0, 1] = usbl.DETECTED
        inks = []
        for t in (2, 3, 5, 9, 39):
            page.strokes.clear()
            _, section = self.section(trace, t)
            auv = section._column(trace.auv_position[t, 0, 1, 0]), section._row(-trace.scenario.auv.depth)
            found = [s for s in page.strokes if len(s[0]) == 2 and np.allclose(s[0][1], auv)]
            inks += [np.abs(np.array(ink) - section._water).sum() for _, ink, _ in found]
            assert len(found) == (t in (3, 5, 9))
            for points, *_ in found:
                np.testing.assert_allclose(points[0], section._boat_outlines(t)[1].mean(0))
        assert inks[0] > inks[1] > inks[2] > 0


class TestSidePanel:
    @pytest.mark.parametrize(
        ("view", "size"), [("map", (1280, 720)), ("both", (1280, 720)), ("map", (640, 360)), ("both", (720, 1280))]
    )
    def test_cards_share_the_panel_with_equal_gaps(self, view, size):
        painter = Painter(synthetic_trace(steps=2), size, Look(view))
        boxes, panel, unit = painter.panel._boxes, painter.layout.panel, painter.layout.unit
        names = [*boxes]
        assert names[:2] == ["title", "tiles"]
        assert ("reward" in names) == (panel.height >= 500 * unit)
        assert ("perspective" in names) == (view == "both") != ("fixes" in names)
        assert ("section" in names) == ("reward" in names and view == "map")
        assert {(box.left, box.width) for box in boxes.values()} == {(panel.left, panel.width)}
        edges = [*boxes.values()]
        assert edges[0].top == panel.top
        assert edges[-1].bottom == panel.bottom
        gaps = {below.top - above.bottom for above, below in pairwise(edges)}
        assert len(gaps) == 1
        assert 3 * unit < gaps.pop() < 10 * unit
        main = boxes["perspective" if view == "both" else "fixes"]
        assert main.height > max(box.height for name, box in boxes.items() if box is not main)

    @pytest.mark.parametrize(
        ("sizes", "shown"),
        [
            ((1, 7, 2, 6, 0.5, 5, 4), "bcdfg"),
            ((3, 0, 2, 0, 0, 0, 0), "ac"),
            ((0, 0, 0, 0, 0, 0, 0), "a"),
            ((3, 0, 2), "ac"),
            ((1, 2, 3, 4, 5), "abcde"),
        ],
    )
    def test_the_largest_terms_of_the_reward_are_shown_in_their_order(self, page, sizes, shown):
        trace = synthetic_trace(steps=60)
        terms = np.sign(random().normal(size=(60, 1, 2, 1))) * np.array(sizes, float)
        terms[:, :, 1] = terms[:, :, 0]
        trace = replace(trace, reward_names=tuple(f"term {x}" for x in "abcdefg"[: len(sizes)]), reward_terms=terms)
        painter = Painter(trace, (1280, 720))
        painter.frame(45)
        said = [words.text for words in page.words]
        assert [text[-1] for text in said if text.startswith("term ")] == [*shown]
        values = terms[16:46, 0].sum(1).mean(0)
        expected = [f"{values['abcdefg'.index(x)]:+.2f}".replace("-", "−") for x in shown]
        numbers = [
            words for words in page.words if words.text[0] in "+−" and words.text[1].isdigit() and words.text[-1] != "m"
        ]
        assert [words.text for words in numbers] == expected
        names = [words for words in page.words if words.text.startswith("term ")]
        title = next(words for words in page.words if words.text == "reward a step,")
        assert {words.position[1] for words in (*names, title)} == {title.position[1]}
        box, bars = painter.panel._boxes["reward"], painter.panel._bars
        for name, number in zip(names, numbers, strict=True):
            assert name.position[1] == number.position[1]
            assert name.size == number.size
            assert name.place[2] < number.place[0]
        tracks = [
            line for line, ink, _ in page.strokes if ink == style.DARK.line and line[0, 1] == line[1, 1] == box.top + 30
        ]
        assert [line[0, 0] for line in tracks] == [words.position[0] for words in names]
        assert [line[1, 0] for line in tracks] == [words.position[0] for words in numbers]
        assert all(words.position[1] < box.top + 30 < box.bottom for words in names)
        assert tracks[-1][1, 0] == pytest.approx(box.right - 10)
        series = np.abs(painter.panel._running.reward[:, painter.panel._terms])
        if any(sizes):
            assert (series <= bars._scale).mean() >= 0.95
            assert bars._scale > 0.9 * np.quantile(series, 0.97)

    @pytest.mark.parametrize("filtered", [False, True])
    def test_errors_are_dots_and_their_median_a_line(self, page, filtered):
        trace = synthetic_trace(steps=80, auvs=1)
        tracker = trace.scenario.tracker.model_copy(update={"enabled": filtered})
        navigation = trace.scenario.navigation.model_copy(update={"sensor": "none"})
        trace = replace(
            trace,
            scenario=trace.scenario.model_copy(update={"tracker": tracker, "navigation": navigation}),
            estimate=trace.auv_position + random().normal(size=trace.estimate.shape),
        )
        painter = Painter(trace, (1280, 720))
        for t in range(80):
            painter.panel.advance(t)
        plot, running = painter.panel._error_plot, painter.panel._running
        error = running.position_error
        low, high = plot._values
        assert (error >= low).mean() > 0.95
        assert 0.98 < (error <= high).mean() < 1.0
        assert (error < low).any()
        assert plot.x(trace.time[-1]) == plot.box.right - 1
        for t in (20, 50, 75):
            row, column = round(float(plot.y(running.error_median[t, 0]))), round(float(plot.x(trace.time[t])))
            assert np.abs(painter._still[row, column].astype(int) - style.DARK.auv(0)).max() < 60
        said = [words.text for words in page.words]
        of, dots = ("estimates", "step") if filtered else ("fixes", "fix")
        assert f"Position error of the {of}, m" in said
        assert f"dots: each {dots} · line: median of 30 s" in said

    @pytest.mark.parametrize("error", [0.3, 400.0])
    def test_the_scale_of_the_fixes_is_told_beside_that_of_the_map(self, monkeypatch, error):
        told = []
        monkeypatch.setattr(side_panel, "write_heading", lambda *given: told.append(given[3:]))
        trace = synthetic_trace(steps=5, auvs=1)
        trace = replace(trace, fix=trace.heard_position + np.array([error, 0.0]))
        insets = Painter(trace, (1280, 720)).panel._insets
        scale = insets.magnification
        assert (scale < 1) == (error > 100)
        words = f"{scale:.0f} × magnified" if scale > 1 else f"{1 / scale:.0f} × smaller than on the map"
        assert (f"Fixes around the true position, {words}", f"inner ring {insets.ring:g} m") in told


class TestPopups:
    def written(self, monkeypatch, t, node=(200.0, 150.0), delivered=1.234, box=None, done=5):
        made = []
        monkeypatch.setattr(
            popups,
            "write",
            lambda image, text, position, size, colour, **k: made.append((text, position, size, colour, k)),
        )
        trace = synthetic_trace(steps=80, auvs=1, nodes=3)
        data = np.zeros((80, 1, 1))
        data[done] = delivered
        trace = replace(
            trace, delivered=data, target=np.ones((80, 1, 1), np.int16), hovering=np.zeros((80, 1, 1), np.int8)
        )
        nodes = np.array([(0.0, 0.0), node, (0.0, 0.0)])
        Popups(trace, Itinerary(trace), 1.0).draw(
            np.zeros((300, 400, 3), np.uint8), box or Rectangle(0, 0, 400, 300), t, nodes, 12.0, np.full((1, 2), -900.0)
        )
        return made

    def test_words_rise_from_their_node_and_fade(self, monkeypatch):
        places, opacities = [], []
        for t in range(5, 5 + FRAMES, 4):
            shadow, words = self.written(monkeypatch, t)
            assert (words[0], words[3]) == ("+1.23 Mbit", style.auv_colour(0))
            assert shadow[3] == style.OUTLINE
            assert np.subtract(shadow[1], words[1]).tolist() == [1, 1]
            assert words[1][0] == 200
            assert words[4]["anchor"] == "centre"
            places.append(words[1][1])
            opacities.append(words[4]["opacity"])
        assert places[0] < 150 - 12
        assert (np.diff(places) < 0).all()
        np.testing.assert_allclose(np.diff(places), places[1] - places[0])
        assert opacities[0] == 1
        assert (np.diff(opacities) < 0).all()
        assert 0 < opacities[-1] < 0.4
        assert self.written(monkeypatch, 4) == self.written(monkeypatch, 5 + FRAMES) == []
        assert self.written(monkeypatch, 4 + FRAMES) != []
        assert self.written(monkeypatch, 20, done=0) != []

    def test_words_stay_within_the_box(self, monkeypatch):
        box = Rectangle(20, 30, 300, 200)
        for node in ((22.0, 100.0), (318.0, 100.0), (100.0, 32.0)):
            _, (text, (x, y), size, *_) = self.written(monkeypatch, 30, node, box=box)
            half = popups.text_width(text, size, bold=True) / 2
            assert box.left <= x - half < x + half <= box.right
            assert y - size > box.top
            assert x == node[0] or half == pytest.approx(min(x - box.left, box.right - x))
