"""The map: mirrored missions, what is drawn when and where."""

import math
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from tests.usvauv_env.made_traces import synthetic_trace, with_second_boat
from usvauv.env.render import map as mission_map
from usvauv.env.render import style, symbols
from usvauv.env.render.exchanges import Exchanges
from usvauv.env.render.frame_layout import Layout, Rectangle
from usvauv.env.render.map import REFRESH, SIGMAS, TRAIL, MissionMap
from usvauv.env.render.running_metrics import RunningMetrics
from usvauv.kernels.positioning import usbl

WIDTH, LENGTH = 320.0, 200.0
PLACES = (
    "auv_position",
    "fix",
    "heard_position",
    "estimate",
    "own_position",
    "foreseen_position",
    "boat_position",
    "boat_goal",
    "node_position",
)


def mission(**changes):
    """Two boats and three AUVs, one of them hovering, that are far from where they are taken and foreseen to be."""
    trace = with_second_boat(
        synthetic_trace(steps=40, auvs=3, nodes=9, area=(WIDTH, LENGTH), vortices=0, sea=False, seed=3)
    )
    hovering, completed = np.zeros_like(trace.hovering), np.zeros_like(trace.service_rate)
    hovering[30, 0, 2] = completed[30, 0, 2] = 1
    boats = trace.boat_position.copy()
    boats[:, :, 1] += np.arange(40)[:, None, None] * (-0.9, 0.5)
    trace = replace(trace, boat_position=boats)
    off = np.array([(6.0, 3.0), (-7.0, 5.0), (5.0, -9.0)])
    trace = replace(
        trace,
        hovering=hovering,
        service_rate=completed,
        delivered=0 * trace.delivered,
        backlog=0 * trace.backlog,
        estimate=trace.auv_position + off,
        foreseen_position=trace.auv_position - 1.5 * off,
        estimate_covariance=np.zeros_like(trace.estimate_covariance) + np.array([60.0, 20.0, 40.0]),
        boat_goal=trace.boat_position + np.array([(30.0, 20.0), (-40.0, 30.0)]),
    )
    trace.fix_flags[:] = usbl.SILENT
    trace.fix_flags[26:28, 0] = usbl.DETECTED
    return replace(trace, **changes)


def mirrored(trace):
    """East and west exchanged."""
    places = {name: getattr(trace, name) * (-1, 1) + np.array([WIDTH, 0.0]) for name in PLACES}
    turned = {
        "estimate_covariance": trace.estimate_covariance * (1, -1, 1),
        "auv_velocity": trace.auv_velocity * (-1, 1),
    }
    return replace(trace, **places, **turned)


def transposed(trace):
    """East and north exchanged."""
    area = trace.scenario.area.model_copy(update={"width": LENGTH, "length": WIDTH})
    names = (*PLACES, "auv_velocity", "estimate_covariance")
    swapped = {name: getattr(trace, name)[..., ::-1] for name in names}
    return replace(trace, scenario=trace.scenario.model_copy(update={"area": area}), **swapped)


def layout_of(trace, unit=1):
    area = trace.scenario.area
    layout = Layout.fit(1280 * unit, 720 * unit, area)
    return replace(layout, map=Rectangle(0, 0, round(2.5 * unit * area.width), round(2.5 * unit * area.length)))


def view_of(trace, unit=1):
    return MissionMap(trace, RunningMetrics.of(trace), layout_of(trace, unit))


def picture_of(trace, t=30):
    box = layout_of(trace).map
    picture = np.zeros((box.height, box.width, 3), np.uint8)
    view_of(trace).draw(picture, t)
    return picture


class Recorder:
    """In place of a translucent layer: what is drawn on it, in order."""

    def __init__(self):
        self.made = []

    def __getattr__(self, name):
        return lambda *arguments, **_: self.made.append((name, *arguments)) if name not in ("clear", "blend") else None

    def of(self, name):
        return [rest for kind, *rest in self.made if kind == name]


def recorded(trace, t, unit=1):
    view = view_of(trace, unit)
    view._overlay = Recorder()
    box = layout_of(trace, unit).map
    view.draw(np.zeros((box.height, box.width, 3), np.uint8), t)
    return view, view._overlay


@pytest.mark.parametrize("task", ["data-collection", "station-keeping"])
def test_a_mirrored_or_transposed_mission_has_a_mirrored_or_transposed_map(monkeypatch, task):
    """But for words; pies and rings of progress are empty or full."""
    monkeypatch.setattr(symbols, "badge", lambda *_: None)
    trace = mission()
    if task == "station-keeping":
        trace = replace(trace, scenario=trace.scenario.model_copy(update={"task": task}), target=0 * trace.target)
        trace = replace(trace, node_position=trace.node_position[:, :3])
    picture = picture_of(trace)
    for other in (picture_of(mirrored(trace))[:, ::-1], np.swapaxes(picture_of(transposed(trace))[::-1, ::-1], 0, 1)):
        difference = np.abs(other.astype(int) - picture).max(-1)
        assert (difference > 100).sum() < 60
        assert (difference > 40).sum() < 500
    assert (np.abs(picture.astype(int) - style.SEA[2]).max(-1) > 40).sum() > 4000


class TestMap:
    def test_trails_are_two_minutes_long_and_fade_towards_the_oldest(self):
        trace = with_second_boat(
            synthetic_trace(steps=300, auvs=2, nodes=3, area=(WIDTH, LENGTH), vortices=0, sea=False)
        )
        for t in (0, 1, 7, 60, 290):
            view, overlay = recorded(trace, t)
            first = max(0, t - round(TRAIL))
            for place, ink in (
                *((trace.boat_position[:, 0, b], style.BOAT) for b in range(2)),
                *((trace.auv_position[:, 0, k], style.auv_colour(k)) for k in range(2)),
            ):
                pixels = view.view.pixel(place)
                mine = [
                    (lines[0], opacity)
                    for lines, colour, opacity, _ in overlay.of("strokes")
                    if colour == ink
                    and len(lines) == 1
                    and any(np.abs(pixels[first : t + 1] - lines[0][0]).max(1) < 1e-9)
                    and any(np.abs(pixels[first : t + 1] - lines[0][-1]).max(1) < 1e-9)
                ]
                if t == 0:
                    assert all(np.ptp(line, axis=0).max() == 0 for line, _ in mine)
                    continue
                joined = np.concatenate([mine[0][0][:1], *(line[1:] for line, _ in mine)])
                np.testing.assert_allclose(joined, pixels[first : t + 1])
                opacities = [opacity for _, opacity in mine]
                assert opacities == sorted(opacities)
                assert 0.2 < opacities[-1] <= 1
                if t == 290:
                    assert opacities[0] < 0.25 * opacities[-1]
                    assert len(mine) <= mission_map.TRAIL_PIECES
                elif t == 7:
                    assert opacities[0] > 0.9 * opacities[-1]

    def test_a_trail_of_a_short_step_has_few_points(self):
        trace = synthetic_trace(steps=1500, auvs=1, nodes=3, area=(WIDTH, LENGTH), vortices=0, sea=False)
        short = trace.scenario.mission.model_copy(update={"step": 0.1})
        view, overlay = recorded(replace(trace, scenario=trace.scenario.model_copy(update={"mission": short})), 1400)
        lines = [lines[0] for lines, colour, *_ in overlay.of("strokes") if colour == style.auv_colour(0)]
        trail = [line for line in lines if len(line) > 10]
        assert 100 < sum(len(line) for line in trail) < 130
        pixels = view.view.pixel(trace.auv_position[:, 0, 0])
        np.testing.assert_allclose([trail[0][0], trail[-1][-1]], pixels[[200, 1400]])

    def test_ellipses_are_closed_and_as_large_as_their_covariance(self):
        trace = mission()
        small = trace.estimate_covariance.copy()
        small[:, 0, 1] = 1e-4
        view, overlay = recorded(replace(trace, estimate_covariance=small), 30)
        scale = view.view.per_metre * SIGMAS
        found = [
            lines[0]
            for lines, *_ in overlay.of("strokes")
            if len(lines[0]) > 40 and (lines[0][0] == lines[0][-1]).all()
        ]
        assert len(found) == 2
        inverse = np.linalg.inv([[60.0, 20.0], [20.0, 40.0]])
        for auv, outline in zip((0, 2), found, strict=True):
            east, north = ((outline - view.view.pixel(trace.estimate[30, 0, auv])) * (1, -1) / scale).T
            np.testing.assert_allclose(np.einsum("in,ij,jn->n", [east, north], inverse, [east, north]), 1)

    def test_pings_reach_the_farthest_auv_and_lines_fade(self):
        trace, lit = mission(), []
        for t in (26, 29, 35, 39):
            view, overlay = recorded(trace, t)
            exchanges, view = Exchanges(trace), view.view
            auvs, boats = view.pixel(trace.auv_position[t, 0]), view.pixel(trace.boat_position[t, 0])
            rings = [ring for ring in overlay.of("ring") if ring[2] == style.BOAT]
            expected = [(boats[b], s) for b, s in enumerate(exchanges.ping(t)) if s is not None]
            assert len(rings) == len(expected)
            for (centre, radius, _, opacity, *_), (boat, share) in zip(rings, expected, strict=True):
                np.testing.assert_allclose(centre, boat)
                assert radius == pytest.approx(share * np.hypot(*(auvs - boat).T).max())
                assert 0.1 < opacity < 0.5
            for auv in range(3):
                boat, fresh = exchanges.heard(t, auv)
                lines = [
                    opacity
                    for line, ink, opacity, _ in overlay.of("strokes")
                    if len(line[0]) == 2 and np.allclose(line[0], [boats[boat], auvs[auv]])
                ]
                assert len(lines) == 1
                lit.append(lines[0] / fresh)
        np.testing.assert_allclose(lit, lit[0])
        assert 0.2 < lit[0] <= 1
        fading = [ring[3] for t in (26, 29, 35) for ring in recorded(trace, t)[1].of("ring")[:1]]
        assert fading[0] > fading[1] > fading[2]

    def test_ways_to_later_nodes_are_fainter(self):
        trace = mission(target=(np.arange(40)[:, None, None] // 5 + np.arange(3)).astype(np.int16) % 9)
        for t in (3, 30):
            view, overlay = recorded(trace, t)
            nodes = view.view.pixel(trace.node_position[0])
            for auv in range(3):
                stops = [view._itinerary.node(t, auv), *view._itinerary.after(t, auv)]
                opacities = [
                    opacity
                    for leg in pairwise(stops)
                    for line, ink, opacity, _ in overlay.of("strokes")
                    if ink == style.auv_colour(auv) and len(line[0]) == 2 and np.allclose(line[0], nodes[[*leg]])
                ]
                assert len(opacities) == len(stops) - 1 > (2 if t == 3 else 0)
                assert opacities == sorted(opacities, reverse=True)
                assert len({*opacities}) == len(opacities)
                assert min(opacities) > 0.1
                assert max(opacities) < 0.7

    def test_services_have_a_ring_and_ways_a_dashed_line(self):
        trace = mission()
        for t in (29, 30):
            view, overlay = recorded(trace, t)
            nodes, auvs = view.view.pixel(trace.node_position[0]), view.view.pixel(trace.auv_position[t, 0])
            discs = overlay.of("disc")
            assert len(discs) == (t == 30)
            dashed = [(pieces, ink) for pieces, ink, *_ in overlay.of("strokes") if len(pieces) > 1]
            assert len(dashed) == 2 + (t == 29)
            for pieces, ink in dashed:
                auv = [style.auv_colour(k) for k in range(3)].index(ink)
                np.testing.assert_allclose(pieces[0][0], auvs[auv])
                way = nodes[trace.target[t, 0, auv]] - auvs[auv]
                last = pieces[-1][1] - auvs[auv]
                assert np.cross([*way, 0], [*last, 0])[2] == pytest.approx(0, abs=1e-6)
                assert 0 <= np.hypot(*way) - np.hypot(*last) < 6
                assert np.hypot(*(pieces[0][1] - pieces[0][0])) == pytest.approx(
                    np.hypot(*(pieces[1][0] - pieces[0][1]))
                )
        (centre, radius, ink, _), (_, inner, *_) = discs[0], overlay.of("ring")[-1]
        np.testing.assert_allclose(centre, nodes[trace.target[29, 0, 2]])
        assert ink == style.auv_colour(2)
        assert 0.3 * radius < inner < radius

    @pytest.mark.parametrize(("hover", "by_metres"), [(1.0, False), (20.0, True)])
    def test_the_ring_of_a_service_is_as_wide_as_it_is_near_or_as_its_node(self, hover, by_metres):
        trace = mission()
        auv = trace.scenario.auv.model_copy(update={"hover_radius": hover})
        view = view_of(replace(trace, scenario=trace.scenario.model_copy(update={"auv": auv})))
        if by_metres:
            assert view._hover_radius == pytest.approx(hover * view.view.per_metre)
        else:
            assert view._node_radius + 2 < view._hover_radius < view._node_radius + 12

    def test_lines_of_worth_are_at_their_metres_and_brighter_where_it_is_more(self, monkeypatch):
        view, _ = recorded(mission(), 0)
        line = np.array([(10.0, 20.0), (50.0, 90.0)])
        view._field = SimpleNamespace(lines=lambda t: [(0.2, [line]), (0.8, [line, 2 * line])])
        view._overlay = Recorder()
        view._draw_field(0)
        (first, ink, faint, _), (second, _, bright, _) = view._overlay.of("strokes")
        np.testing.assert_allclose(first, [view.view.pixel(line)])
        np.testing.assert_allclose(second, [view.view.pixel(line), view.view.pixel(2 * line)])
        assert ink == style.FIELD
        assert 0 < faint < 0.5 * bright < 0.5
        drawn = []
        monkeypatch.setattr(view, "_draw_field", drawn.append)
        view.draw(np.zeros((720, 1280, 3), np.uint8), 3)
        assert drawn == [3]

    @pytest.mark.parametrize("unit", [1, 2])
    def test_places_too_near_to_be_told_apart_are_drawn_once(self, monkeypatch, unit):
        """Below five pixels of the design of a fix or a foreseen place, twenty of a goal, at any size."""
        drawn = []
        for name in ("fix", "foreseen", "cross"):
            monkeypatch.setattr(symbols, name, lambda _, at, *rest, name=name: drawn.append((name, at)))
        trace = mission()
        metre = 1 / 2.5
        for fix, foreseen, goal, expected in (
            (4.9, 9.8, 19.9, ""),
            (5.1, 10.3, 20.1, "fix fix fix foreseen foreseen foreseen cross cross"),
            (-5.1, -5.1, 0, "fix " * 3),
        ):
            drawn.clear()
            away = np.array([0.6, 0.8]) * metre
            changed = replace(
                trace,
                estimate=trace.auv_position + fix * away,
                foreseen_position=trace.auv_position + foreseen * away,
                boat_goal=trace.boat_position + goal * away,
            )
            recorded(changed, 30, unit)
            assert sorted(name for name, _ in drawn) == sorted(expected.split())
            view = view_of(changed, unit).view
            places = {"fix": changed.estimate, "foreseen": changed.foreseen_position, "cross": changed.boat_goal}
            for name, where in places.items():
                found = [at for each, at in drawn if each == name]
                if found:
                    np.testing.assert_allclose(found, view.pixel(where[30, 0]))

    def test_dashes_lead_to_goals_and_to_foreseen_places(self, page):
        trace = mission()
        view = recorded(trace, 30)[0].view
        for ink, begins, ends in (
            *((style.BOAT, trace.boat_position[30, 0, b], trace.boat_goal[30, 0, b]) for b in range(2)),
            *(
                (style.mix(style.auv_colour(k), style.OUTLINE, 0.5), at[30, 0, k], trace.auv_position[30, 0, k])
                for k, at in enumerate([trace.foreseen_position] * 3)
            ),
        ):
            begin, end = view.pixel(begins), view.pixel(ends)
            way = (end - begin) / np.hypot(*(end - begin))
            mine = [line for line, colour, _ in page.strokes if colour == ink and len(line) == 2]
            mine = [line for line in mine if np.allclose(np.abs((line - begin) @ (-way[1], way[0])), 0, atol=1e-6)]
            np.testing.assert_allclose(mine[0][0], begin)
            assert 0 <= (end - mine[-1][1]) @ way <= 3.001
            assert len(mine) == pytest.approx(np.hypot(*(end - begin)) / 6, abs=1)

    def test_numbers_are_beside_their_auvs(self, monkeypatch):
        badges = []
        monkeypatch.setattr(symbols, "badge", lambda _, text, at, *rest: badges.append((text, at)))
        view, _ = recorded(mission(), 30)
        assert [text for text, _ in badges] == ["1", "2", "3"]
        for (_, at), auv in zip(badges, view.view.pixel(mission().auv_position[30, 0]), strict=True):
            assert 12 < np.hypot(*(at - auv)) < 25
            assert at[0] > auv[0]
            assert at[1] < auv[1]

    def test_vehicles_and_rings_are_drawn_with_their_headings_and_shares(self, monkeypatch):
        made = {"auv": [], "boat": [], "progress_ring": []}
        for name, found in made.items():
            monkeypatch.setattr(symbols, name, lambda *arguments, found=found: found.append(arguments[1:]))
        trace = mission()
        view, _ = recorded(trace, 30)
        running = RunningMetrics.of(trace)
        for name, places, headings in (
            ("auv", trace.auv_position, running.heading),
            ("boat", trace.boat_position, running.boat_heading),
        ):
            np.testing.assert_allclose([each[0] for each in made[name]], view.view.pixel(places[30, 0]))
            np.testing.assert_allclose([each[1] for each in made[name]], headings[30])
        ((centre, radius, share, ink, *_),) = made["progress_ring"]
        np.testing.assert_allclose(centre, view.view.pixel(trace.node_position[0, trace.target[29, 0, 2]]))
        assert (radius, share, ink) == (view._hover_radius, 1.0, style.auv_colour(2))

    def test_streaks_are_those_of_the_latest_field_made_anew_every_few_steps(self):
        trace = mission()
        half = trace.scenario.mission.model_copy(update={"step": 0.5})
        trace = replace(trace, scenario=trace.scenario.model_copy(update={"mission": half}))
        vortex = np.zeros((40, 1, 1, 4)) + np.array([100.0, 90.0, 200.0, 30.0])
        vortex[:, 0, 0, 0] += np.arange(40)
        view = view_of(replace(trace, vortex=vortex))
        made, drawn = [], []
        view.streaks.update = lambda vortex, stream: made.append(vortex[0, 0] - 100)
        view.streaks.draw = lambda overlay, time, width: drawn.append(time)
        picture = np.zeros((720, 1280, 3), np.uint8)
        for t in (0, 1, 2, 3, 4, 5, 6, 20, 21, 5, 6):
            view.draw(picture, t)
        assert REFRESH == 3
        assert made == [0, 3, 6, 20, 5]
        step = min(0.5, view.streaks.tail / 4)
        np.testing.assert_allclose(drawn, step * np.array([0, 1, 2, 3, 4, 5, 6, 20, 21, 5, 6]))

    def test_of_many_nodes_each_is_smaller(self):
        radii = []
        for nodes in (1, 40, 400, 4000):
            trace = mission()
            many = {
                "node_position": np.zeros((1, nodes, 2)),
                "backlog": np.zeros((40, 1, nodes)),
                "target": 0 * trace.target,
            }
            radii.append(view_of(replace(trace, **many))._node_radius)
        assert 8 < radii[0] < 12
        assert radii[0] >= radii[1] > radii[2] >= radii[3] > 2.5
        spacing = math.sqrt(800 * 500 / 400)
        assert radii[2] == pytest.approx(spacing / 7, rel=0.1)
