"""What a world is made of, without its kernels: seeds and seas, arrays, strategies of boats, and what it refuses."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from usvauv.env import Scenario, ScenarioError
from usvauv.env.world import arrays, global_state
from usvauv.env.world.adjustable import ADJUSTABLE, DECISIONS, check_adjustable, check_continues
from usvauv.env.world.boat_agent import LONGEST, boat_observed, observe_boats
from usvauv.env.world.boat_strategies import BoatStrategy, StrategyChoice, boat_strategies
from usvauv.env.world.observation import POSITION_BOUND, ObservationLayout, quantities, table
from usvauv.env.world.seeds import Seeds
from usvauv.env.world.state_check import LATEST, check_state
from usvauv.env.world.water import WorldWater
from usvauv.kernels.mission.boat_strategies import FIM
from usvauv.kernels.mission.columns import (
    AuvColumn,
    BeliefColumn,
    BoatColumn,
    EstimateColumn,
    ExchangeColumn,
    ForesightColumn,
    NodeColumn,
    TallyColumn,
)
from usvauv.kernels.mission.observation import BEAM_ANGLE, BEAM_CELL
from usvauv.kernels.positioning import tracker

AREA = ("area.width=300", "area.length=200")
TRACKS = ("tracker.enabled=true",)
RECKONS = ("navigation.sensor=ground", "channel.schedule=all")


def scenario(*changes: str) -> Scenario:
    """Without reckoning and channel unless they are asked for."""
    return Scenario.load("ideal", [*AREA, "navigation.sensor=none", "channel.schedule=every-step", *changes])


class TestSeeds:
    def test_worlds_of_one_seed_and_a_seed_for_each(self):
        one = Seeds.of(7, 3, 5)
        assert (one.seed.tolist(), one.index.tolist(), one.common()) == ([7, 7, 7], [5, 6, 7], 7)
        for several in ([4, 2, 4], np.array([4, 2, 4])):
            each = Seeds.of(several, 3)
            assert (each.seed.tolist(), each.index.tolist()) == ([4, 2, 4], [0, 0, 0])
            assert each.common(slice(1, 2)) == 2

    def test_all_64_bits_count(self):
        keys = Seeds.of(0x80000001FFFFFFFE, 2, 3).keys()
        assert keys.dtype == np.int32
        assert keys.view(np.uint32).tolist() == [[0xFFFFFFFE, 0x80000001, 3], [0xFFFFFFFE, 0x80000001, 4]]
        assert Seeds.of((1 << 64) - 1, 1).seed[0] == (1 << 64) - 1
        for wrong in (1 << 64, -1, 1.0):
            with pytest.raises(ScenarioError, match="must be a whole number from 0 to"):
                Seeds.of(wrong, 1)

    @pytest.mark.parametrize("realisations", [1, 3, 4])
    def test_each_world_sails_on_its_seeds_sea_of_its_own_index(self, realisations):
        seeds = Seeds(np.array([9, 7, 9, 7, 9], np.uint64), np.array([0, 1, 5, 6, 4]))
        seas, which = seeds.seas(realisations)
        expected = [(s, i % realisations) for s, i in zip([9, 7, 9, 7, 9], [0, 1, 5, 6, 4], strict=True)]
        assert [seas[sea] for sea in which] == expected
        assert seas == sorted(set(expected))

    def test_worlds_that_are_apart_have_no_seed_in_common(self):
        for apart in (slice(0, 3, 2), slice(None, None, -1)):
            with pytest.raises(ScenarioError, match="each world has one of its own"):
                Seeds.of(7, 3).common(apart)


class TestArrays:
    @pytest.mark.parametrize(
        ("changes", "foresees", "unused"),
        [
            ((), False, ("track", "own", "exchange", "foresight")),
            ((), True, ("track", "own", "exchange")),
            (TRACKS, False, ("own", "exchange", "foresight")),
            (RECKONS, False, ("foresight",)),
            (RECKONS, True, ()),
        ],
    )
    def test_shapes(self, changes, foresees, unused):
        """By worlds, AUVs, boats, nodes and vortices; one row of the unused."""
        teams = ("auv.count=3", "boat.count=2", "nodes.count=9", "current.count=4", "nodes.information=visits")
        s = scenario(*teams, *changes)
        found = arrays.shapes(s, 5, foresees)
        assert arrays.unused(s, foresees) == unused
        expected = {
            "auv": (5, 3, len(AuvColumn.names)),
            "node": (5, 9, len(NodeColumn.names)),
            "vortex": (5, 4, 4),
            "boat": (5, 2, len(BoatColumn.names)),
            "tally": (5, len(TallyColumn.names)),
            "estimate": (5, 3, len(EstimateColumn.names)),
            "track": (5, 3, tracker.COLUMNS),
            "own": (5, 3, tracker.COLUMNS),
            "exchange": (5, 3, len(ExchangeColumn.names)),
            "foresight": (5, 3, len(ForesightColumn.names)),
            "belief": (5, 1, 9, len(BeliefColumn.names)),
            "observation": (5, 3, ObservationLayout.of(s).size),
            "reward": (5, 3),
            "reward_terms": (5, 3, len(s.task_definition.reward_names)),
        }
        assert found == {name: (1, 1, shape[-1]) if name in unused else shape for name, shape in expected.items()}

    def test_knowledge_of_ones_own_and_no_vortex(self):
        found = arrays.shapes(scenario("auv.count=3", "nodes.count=9", "nodes.information=own-visits"), 5, False)
        assert found["belief"] == (5, 3, 9, len(BeliefColumn.names))
        assert found["vortex"] == (5, 1, 4)

    def test_side_by_side(self):
        """Each begins at a multiple of 16 numbers and shares none with another."""
        shapes = {"a": (4, 4), "b": (17,), "c": (1, 3, 5), "d": (2, 16)}
        assert [arrays.room(shape) for shape in shapes.values()] == [16, 32, 16, 32]
        numbers, parts = arrays.side_by_side(shapes, torch.device("cpu"))
        assert (numbers.shape, numbers.dtype) == ((96,), torch.float32)
        assert not numbers.any()
        for value, (part, shape) in enumerate(zip(parts, shapes.values(), strict=True), 1):
            assert part.shape == shape
            assert (part.storage_offset() * part.element_size()) % 64 == 0
            part.fill_(value)
        assert [int((numbers == value).sum()) for value in range(5)] == [96 - 80, 16, 17, 15, 32]


class TestAdjustable:
    DIFFERENT = (
        "current.circulation_min=1 current.circulation_max=2 storm.significant_height=3 sea.irregular_rms=0.1"
        " acoustics.source_level=150 channel.interval=2"
    )

    def test_what_may_change_while_worlds_run(self):
        before = scenario("sea.forced_edge=west")
        assert len(self.DIFFERENT.split()) == len(ADJUSTABLE)
        check_adjustable(before, scenario("sea.forced_edge=west", *self.DIFFERENT.split()))
        check_adjustable(before, before)
        with pytest.raises(ScenarioError, match=r"^area\.depth = 130\.0: cannot change while worlds run; what may"):
            check_adjustable(before, scenario("sea.forced_edge=west", "area.depth=130"))
        with pytest.raises(ScenarioError, match=r"^name = 'other': cannot change"):
            check_adjustable(before, before.model_copy(update={"name": "other"}))

    def test_what_may_differ_from_a_world_that_is_continued(self):
        before, other = scenario(), scenario("boat.strategy=centroid", "nodes.target_rule=nearest")
        check_continues(before, other)
        assert set(DECISIONS) == {"boat.strategy", "nodes.target_rule"}
        for change in (self.DIFFERENT.split()[2], "auv.depth=90"):
            with pytest.raises(ScenarioError, match="must be as in the world that is continued"):
                check_continues(before, scenario(change))


class TestState:
    OWN = {  # noqa: RUF012
        "auv": torch.zeros(2, 3, len(AuvColumn.names)),
        "tally": torch.zeros(2, len(TallyColumn.names)),
        "belief": torch.zeros(2, 1, 30, len(BeliefColumn.names)),
        "clock": torch.zeros(2, 2, dtype=torch.int32),
        "sea": torch.zeros(4),
        "sea_clock": torch.zeros(3, dtype=torch.float64),
        "sea_episode": torch.zeros(2, dtype=torch.int64),
    }
    SCENARIO = scenario("auv.count=3")

    def with_value(self, name: str, place: tuple[int, ...], value: float) -> dict[str, torch.Tensor]:
        changed = self.OWN[name].clone()
        changed[place] = value
        return {**self.OWN, name: changed}

    @pytest.mark.parametrize(
        ("name", "place", "value"),
        [
            *(("clock", (1, 0), value) for value in (-1, LATEST)),
            *(("sea_clock", (2,), value) for value in (0.0, 0.5, LATEST)),
            *(("sea_episode", (1,), value) for value in (0, LATEST)),
            ("auv", (1, 2, AuvColumn.x), 300.0),
        ],
    )
    def test_taken(self, name, place, value):
        check_state(self.with_value(name, place, value), self.OWN, self.SCENARIO)

    @pytest.mark.parametrize(
        ("name", "place", "value", "said"),
        [
            ("clock", (1, 0), -2, "clock has -2: must be a whole number from -1 to 1000000000"),
            ("clock", (0, 1), LATEST + 1, r"clock has 1e\+09: must be a whole number from -1 to"),
            ("sea_clock", (2,), -0.5, "sea_clock has -0.5: must be from 0 to 1000000000"),
            ("sea_clock", (2,), 2e9, r"sea_clock has 2e\+09: must be from"),
            ("sea_episode", (1,), -1, "sea_episode has -1: must be a whole number from 0 to"),
            ("auv", (1, 2, AuvColumn.x), 301.0, "world 1: x of AUV 2 is 301: must be from 0 to 300"),
            ("auv", (0, 1, AuvColumn.y), -3.0, "world 0: y of AUV 1 is -3: must be from 0 to 200"),
            ("tally", (1, TallyColumn.overflowing), 31.0, "world 1: overflowing of the tally is 31: must be a?"),
            ("belief", (1, 0, 4, 0), math.nan, "world 1: .* of the belief, of all or of AUV 0 is nan: must be"),
        ],
    )
    def test_refused(self, name, place, value, said):
        with pytest.raises(ScenarioError, match=f"^state of the world: {said}"):
            check_state(self.with_value(name, place, value), self.OWN, self.SCENARIO)

    @pytest.mark.parametrize(
        ("change", "said"),
        [
            (lambda own: own.pop("sea"), "sea is missing"),
            (lambda own: own.update(more=own["sea"]), "more is unknown"),
            (lambda own: own.update(sea=own["sea"][1:]), r"sea has shape \(3,\): must be \(4,\)"),
            (lambda own: own.update(sea=own["sea"].double()), "sea is torch.float64: must be torch.float32"),
        ],
    )
    def test_of_another_world(self, change, said):
        given = dict(self.OWN)
        change(given)
        with pytest.raises(ScenarioError, match=f"^state of the world: {said}$"):
            check_state(given, self.OWN, self.SCENARIO)


class TestStrategies:
    def test_name_and_numbers(self):
        assert StrategyChoice.parse(None, scenario("boat.strategy=centroid")).name == "centroid"
        found = StrategyChoice.parse("hold:12.50,7", scenario())
        assert (found.name, found.numbers) == ("hold:12.5,7", (12.5, 7.0))
        two = scenario("boat.count=2")
        assert StrategyChoice.parse("hold:1,2,3,4", two).numbers == (1, 2, 3, 4)
        assert StrategyChoice.parse("hold:1,2", two).numbers == (1, 2)

    @pytest.mark.parametrize("point", ["0,0", "300,200", "0,200", "300,0"])
    def test_points_up_to_the_borders(self, point):
        assert StrategyChoice.parse(f"hold:{point}", scenario()).numbers == tuple(map(float, point.split(",")))

    def test_points_on_the_earth(self):
        """The area's corner, and one minute of latitude, some 1853 m, north of it."""
        place = ["area.length=4000", "water.longitude=5", "water.latitude=45", "boat.count=2"]
        found = StrategyChoice.parse("hold:45N,5E,45.0166666667N,5E", scenario(*place)).numbers
        assert found[:3] == pytest.approx((0, 0, 0), abs=0.01)
        assert found[3] == pytest.approx(1852.2, abs=1)

    @pytest.mark.parametrize(
        ("text", "changes", "said"),
        [
            ("fim:3", (), "usv: 'fim:3': allowed are fim, .*belief, agent, hold:X,Y"),
            ("hold", (), "expected hold:X,Y, for example hold:100,100$"),
            ("hold:1,inf", (), "expected hold:X,Y"),
            ("hold:200,201", (), r"point must lie in the area \[0, 300\] × \[0, 200\]"),
            ("hold:301,100", (), "must lie in the area"),
            ("hold:-1,100", (), "must lie in the area"),
            ("hold:1,2,3,-4", ("boat.count=2",), "must lie in the area"),
            ("fim-horizon", (), "^usv: 'fim-horizon': gone since 0.3$"),
            (None, ("boat.strategy=learned:a/b",), "^boat.strategy: 'learned:a/b': gone since 0.3$"),
            ("belief", (), "needs navigation.sensor to be ground or water"),
            ("visit", (), "needs navigation.sensor to be ground or water"),
            (None, ("boat.strategy=agent",), "boat.strategy: 'agent' foresees AUVs"),
        ],
    )  # fmt: skip
    def test_refused(self, text, changes, said):
        with pytest.raises(ScenarioError, match=said):
            StrategyChoice.parse(text, scenario(*changes))

    def test_those_that_look_ahead_are_taken_where_they_can(self):
        assert StrategyChoice.parse("belief", scenario(*RECKONS)).numbers == ()

    def test_numbers_of_a_file(self, monkeypatch):
        """The strategy is shown as it was given."""

        def read(path: str) -> tuple[float, ...]:
            if path != "good":
                raise ValueError(f"{path}: is no such file")
            return 4.0, 5.0

        monkeypatch.setitem(boat_strategies._items, "own", BoatStrategy(FIM, read=read))
        found = StrategyChoice.parse("own:good", scenario())
        assert (found.name, found.numbers) == ("own:good", (4.0, 5.0))
        with pytest.raises(ScenarioError, match=r"^usv: bad: is no such file$"):
            StrategyChoice.parse("own:bad", scenario())


class TestSizes:
    def test_of_the_global_state_and_of_what_a_boat_observes(self):
        s = scenario("auv.count=3", "boat.count=2", "nodes.count=9")
        assert global_state.size(s) == 3 * (2 + 2 + 2) + 2 * 2 + 9
        rows = boat_observed(s)
        assert [row.index for row in rows] == list(range(2 + 2 + 3 * 5))
        assert {row.unit for row in rows} == {f"area's diagonal, {math.hypot(300, 200):.6g} m", "300 s", "1"}
        away = POSITION_BOUND
        each = [(-away, away), (-away, away), (0, 1), (0, LONGEST), (0, 1)]
        assert [(row.low, row.high) for row in rows] == [(0, 1)] * 2 + [(-1, 1)] * 2 + each * 3
        assert [row.quantity[:5] for row in rows[:4]] == ["own x", "own y", "x of ", "y of "]
        for k in range(3):
            assert all(f"AUV {k}" in row.quantity for row in rows[4 + 5 * k : 9 + 5 * k])
        assert "other boat 1" in rows[2].quantity

    def test_bounds_and_texts_in_the_table_of_terms(self):
        rows = {row[2].strip(" `"): row for row in (line.split("|") for line in table().splitlines()[2:])}
        for name, unit, bounds, text in (
            ("others", "D", "−2 … 2", f"{quantities('others', 2)[0]}; …; {quantities('others', 2)[1]}"),
            ("overflow", "1", "0 … 1", quantities("overflow", 2)[0]),
            ("current_speed", "m/s", "0 … c", quantities("current_speed", 2)[0]),
            ("current", "m/s", "−c … c", "current at the AUV, x; …; current at the AUV, y"),
        ):
            assert [rows[name][column].strip() for column in (3, 4, 5)] == [text, unit, bounds]

    def test_of_the_terms_of_an_observation(self):
        layout = ObservationLayout(3, ("others", "border", "current_profile"))
        assert dict(layout) == {"others": slice(0, 4), "border": slice(4, 5), "current_profile": slice(5, 17)}
        assert (layout.size, layout.slice("border"), "border" in layout, "target" in layout) == (
            *(17, slice(4, 5), True, False),
        )

    def test_beams_of_a_profile_are_told_apart(self):
        """By two distances, the nearer first, and from right to left, each with both components."""
        texts = iter(quantities("current_profile", 2))
        for reach in (BEAM_CELL, 2 * BEAM_CELL):
            for beam in (-BEAM_ANGLE, 0, BEAM_ANGLE):
                for axis in "xy":
                    said = f"current {reach:g} m away, {beam:g} rad to the left of the target's bearing, {axis}"
                    assert next(texts) == said
        assert next(texts, None) is None


def test_what_boats_observe_and_the_global_state():
    """Number by number, of two worlds with two boats and three AUVs, over a diagonal of 500 m."""
    s = Scenario.load("ideal", ["area.width=300", "area.length=400", "auv.count=3", "boat.count=2", *RECKONS])
    random = torch.Generator().manual_seed(0)

    def numbers(*shape: int) -> torch.Tensor:
        return 400 * torch.rand(shape, generator=random)

    world = SimpleNamespace(
        scenario=s,
        auv=numbers(2, 3, len(AuvColumn.names)),
        boat=numbers(2, 2, len(BoatColumn.names)),
        node=numbers(2, 5, len(NodeColumn.names)),
        estimate=numbers(2, 3, len(EstimateColumn.names)),
        exchange=20 * numbers(2, 3, len(ExchangeColumn.names)),
        track=1e3 * numbers(2, 3, tracker.COLUMNS) - 5e4,
        foreseen_position=numbers(2, 3, 2),
        own_position=numbers(2, 3, 2),
    )
    world.estimate[..., EstimateColumn.served_by] = torch.tensor([[0.0, 1.0, 1.0], [1.0, 0.0, 0.0]])
    world.track[0, 1, [tracker.XX, tracker.YY]] = 9e5
    world.track[1, 2, [tracker.XX, tracker.YY]] = -1.0
    boats, state = observe_boats(world), global_state.global_state(world)
    limited = set()
    for w in range(2):
        auv, boat, node = world.auv[w], world.boat[w], world.node[w]
        for b in range(2):
            x, y = boat[b, BoatColumn.x], boat[b, BoatColumn.y]
            expected = [x, y, boat[1 - b, BoatColumn.x] - x, boat[1 - b, BoatColumn.y] - y]
            for k in range(3):
                track, place = world.track[w, k], world.foreseen_position[w, k]
                deviation = math.sqrt(max(float(track[tracker.XX] + track[tracker.YY]) / 2, 0))
                silence = float(world.exchange[w, k, ExchangeColumn.elapsed]) / 300
                limited |= {(0, deviation == 0), (1, deviation > 500), (2, silence > 10)}
                serves = float(world.estimate[w, k, EstimateColumn.served_by] == b)
                expected += [place[0] - x, place[1] - y, min(deviation, 500.0), 500 * min(silence, 10.0), 500 * serves]
            torch.testing.assert_close(500 * boats[w, b], torch.tensor(expected), rtol=1e-5, atol=1e-3)
        places = auv[:, [AuvColumn.x, AuvColumn.y]]
        expected = [
            *(places / 500).flatten(),
            *((world.own_position[w] - places) / 500).flatten(),
            *auv[:, [AuvColumn.current_x, AuvColumn.current_y]].flatten(),
            *(boat[:, [BoatColumn.x, BoatColumn.y]] / 500).flatten(),
            *(node[:, NodeColumn.backlog] / s.nodes.buffer),
        ]
        torch.testing.assert_close(state[w], torch.stack(expected))
    assert len(limited) == 6  # each limit is met and is not


@pytest.mark.parametrize(("pixels", "factor"), [(7, 1), (6, 2), (4, 2), (3, 3), (2, 4)])
def test_long_waves_are_averaged_over_whole_blocks(pixels, factor):
    """Of the world's own sea, 7 × 5 cells of 3 × 2 m; what does not fill a block is left out in the north and east."""
    seas = np.random.default_rng(0).normal(size=(3, 5, 7)).astype(np.float32)
    own = SimpleNamespace(elevation=lambda: seas, dx=3.0, dy=2.0)
    water = SimpleNamespace(long_waves=own, sea_index=torch.tensor([0, 2]))
    found, x, y = WorldWater.mean_elevation(water, pixels, 1)
    rows, columns = 5 // factor, 7 // factor
    assert found.shape == (rows, columns) == (len(y), len(x))
    for i in range(rows):
        for j in range(columns):
            block = seas[2, i * factor : (i + 1) * factor, j * factor : (j + 1) * factor]
            assert found[i, j] == pytest.approx(block.mean(), abs=1e-6)
            middle = 3 * np.arange(j * factor, (j + 1) * factor) + 1.5, 2 * np.arange(i * factor, (i + 1) * factor) + 1
            assert (x[j], y[i]) == pytest.approx([each.mean() for each in middle])


@pytest.mark.parametrize(
    ("count", "said"),
    [(1, "sea of world 4"), (2, "sea of worlds 4, 7"), (8, "4, 7, 10, 13, 16, 19, 22, 25"), (10, "25 and 2 more")],
)
def test_a_sea_is_named_by_its_worlds(count, said):
    """Eight of them at most, counted from the first world."""
    water = SimpleNamespace(sea_index=torch.tensor([1, 0, 0] * count), _first_world=4)
    assert WorldWater.named(water, 1).endswith(said)
