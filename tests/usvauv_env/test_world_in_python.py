"""What a world does between two launches of its kernels, here stubs: seas, clocks, masks, states, words."""

import math

import numpy as np
import pytest
import torch

from usvauv.env import Scenario, ScenarioError, World
from usvauv.env.site.site import Site
from usvauv.env.world import world as module
from usvauv.env.world.boat_strategies import boat_strategies
from usvauv.env.world.observation import observation_terms
from usvauv.env.world.water import WorldWater, first_vortices
from usvauv.kernels.errors import DivergenceError
from usvauv.kernels.flow.vortex import Vortex
from usvauv.kernels.mission.columns import (
    AuvColumn,
    BoatColumn,
    EstimateColumn,
    ExchangeColumn,
    ForesightColumn,
    NodeColumn,
)
from usvauv.kernels.mission.target_rules import target_rules
from usvauv.kernels.positioning import pulse, tracker
from usvauv.kernels.types import Level

RECKONS = ("navigation.sensor=ground", "channel.schedule=all")
WAVES = ("sea.forced_edge=west", "sea.regular_amplitude=0.2", "sea.regular_period=60", "storm.spectrum=pm")


pytestmark = pytest.mark.cpu("what runs in Python")
BIND = World._bind


@pytest.fixture(autouse=True)
def stubs(monkeypatch):
    """In place of the kernels: a reset begins the next episode of the chosen, a step counts."""

    def bind(world: World) -> None:
        def reset() -> None:
            chosen = world._chosen.bool()
            world._clock[chosen, 0] += 1
            world._clock[chosen, 1] = 0

        def step() -> None:
            world._clock[:, 1] += 1

        world._reset, world._step = reset, step

    monkeypatch.setattr(World, "_bind", bind)


def make(*changes: str, num_worlds: int = 2, seed=3, usv: str | None = None, **others) -> World:
    area = ("area.width=300", "area.length=200", "auv.count=2", "navigation.sensor=none", "channel.schedule=every-step")
    scenario = Scenario.load("ideal", [*area, "sea.cell_size=25", *changes])
    return World(scenario, num_worlds, seed, usv, **others)


def steps(world: World, count: int) -> None:
    for _ in range(count):
        world.step(torch.zeros(world.num_worlds, world.num_auvs, 2))


class TestSeas:
    def test_each_world_sails_on_its_own(self):
        """Alone, and as a part of a batch, which solves all of the batch's."""
        changes, own = "sea.realisations=4", [(3, (5 + w) % 4) for w in range(3)]
        part, alone = (make(changes, num_worlds=3, first_world=5, batch=batch) for batch in (8, None))
        for world in (part, alone):
            assert [world._water.seas[sea] for sea in world._water.sea_index] == own
        assert part._water.seas == [(3, sea) for sea in range(4)]
        assert len(alone._water.seas) == 3
        with pytest.raises(ScenarioError, match="batch = 7: must be at least first_world"):
            make(changes, num_worlds=3, first_world=5, batch=7)
        assert part._water.seas_of(2) == [(3 + 2 * 2**64, sea) for sea in range(4)]

    def test_one_fine_sea_for_one_world(self):
        fine = make("sea.fine_cells=24", num_worlds=1, fine_sea=True)
        assert (fine.sea.nx, fine.sea.ny) == (24, 16)
        coarse = make()
        assert (coarse.sea.nx, coarse.sea.ny) == (12, 8)

    @pytest.mark.parametrize(("step", "interval"), [(1.0, 1.0), (0.1, 0.3), (2.0, 0.5), (0.7, 3.0)])
    def test_long_waves_are_as_late_as_the_mission_or_later(self, step, interval):
        """By less than an update, without one too many for a rounding error; the storm is as late."""
        world = make(*WAVES, f"mission.step={step}", f"sea.update_interval={interval}")
        world.reset()
        for done in range(13):
            updates = world.sea.time / interval
            assert updates == pytest.approx(math.ceil(round(done * step / interval, 6)))
            assert world.storm.time == pytest.approx(done * step)
            steps(world, 1)

    def test_begin_anew_when_all_are_reset(self, monkeypatch):
        """Not at the first reset, for which they are made; not for some; always for all."""
        begun = []
        begin = WorldWater.begin
        monkeypatch.setattr(WorldWater, "begin", lambda water, episode: (begun.append(episode), begin(water, episode)))
        world = make(*WAVES)
        world.reset()
        steps(world, 2)
        world.reset(torch.tensor([False, True]))
        assert world._clock.tolist() == [[0, 2], [1, 0]]
        assert begun == [0]
        world.reset()
        assert world._clock.tolist() == [[1, 0], [2, 0]]
        assert begun == [0, 1]
        assert world.sea.time == world.storm.time == 0
        world.rewind()
        world.reset()
        assert (begun, world._clock[:, 0].tolist()) == ([0, 1, 0], [0, 0])
        world.rewind()
        world.reset()
        assert begun == [0, 1, 0]  # the sea has not moved

    def test_real_current_stays_after_its_end(self, monkeypatch):
        class Flow:
            times, start = np.array([0.0, 2.5]), "2020-01-02T03:00:00"
            velocity = np.zeros((2, len(Level.names), 3, 4, 2), np.float32)

            def at(self, t: float) -> np.ndarray:
                return np.full((len(Level.names), 3, 4, 2), t, np.float32)

        monkeypatch.setattr(Site, "current", Flow())
        world = make()
        world.reset()
        for done in range(5):
            assert (world._water.stream == min(done, 2.5)).all()
            assert world._water.stream.shape == (len(Level.names), 3, 4, 2)
            steps(world, 1)
        assert make("mission.step=0.5")._water.stream.shape == (len(Level.names), 3, 4, 2)


class TestStep:
    def test_ends_of_an_episode_and_of_the_horizon(self):
        for ends in (False, True):
            world = make("mission.duration=3", f"reward.service_terminates={str(ends).lower()}")
            world.reset()
            world.auv[0, 1, AuvColumn.service_rate] = 2.0
            for done in range(1, 4):
                *_, horizon, truncated, info = world.step(torch.zeros(2, 2, 2))
                assert horizon.tolist() == [[False, ends], [False, False]]
                assert truncated.tolist() == [[done == 3] * 2] * 2
            assert torch.equal(info["measures"], world.auv[..., AuvColumn.power : AuvColumn.position_error + 1])
            assert world.measure_names == AuvColumn.names[AuvColumn.power : AuvColumn.position_error + 1]
            assert torch.equal(world.current(), world.auv[..., AuvColumn.current_x : AuvColumn.current_y + 1])
            world.reset()
            assert world._clock[:, 1].tolist() == [0, 0]

    def test_actions_of_another_form_are_refused(self):
        world = make()
        world.reset()
        for wrong in (torch.zeros(2, 1, 2), torch.full((2, 2, 2), math.inf), torch.full((2, 2, 2), math.nan)):
            with pytest.raises(ValueError, match=r"^action"):
                world.step(wrong)
        with pytest.raises(ScenarioError, match="boat_action: given, but the boat's strategy is 'fim'"):
            world.step(torch.zeros(2, 2, 2), torch.zeros(2, 1, 2))
        assert world._clock[:, 1].tolist() == [0, 0]
        world.step(torch.full((2, 2, 2), 0.25))
        assert (world._action == 0.25).all()

    @pytest.mark.parametrize("drifts", [False, True])
    def test_boats_are_steered_to_where_their_velocity_leads(self, drifts):
        """Top speed times the action, whose norm is at most one, and with the current where they drift."""
        boats = ("boat.count=2", "boat.top_speed=3", f"boat.drifts={str(drifts).lower()}", "mission.step=0.5")
        world = make(*boats, *RECKONS, usv="agent")
        world.reset()
        world.boat[..., : len(BoatColumn.names)] = torch.arange(2 * 2 * len(BoatColumn.names)).view(2, 2, -1)
        before = world.boat.clone()
        action = torch.tensor([[[0.3, -0.4], [3.0, 4.0]], [[0.0, 1.0], [-1.0, 1.0]]])
        world.step(torch.zeros(2, 2, 2), action)
        shorter = action / action.norm(dim=-1, keepdim=True).clamp(min=1)
        place, current = (
            before[..., [BoatColumn.x, BoatColumn.y]],
            before[..., BoatColumn.span("current_x", "current_y")],
        )
        expected = place + 0.5 * (3 * shorter + drifts * current)
        torch.testing.assert_close(world.boat[..., [BoatColumn.goal_x, BoatColumn.goal_y]], expected)
        with pytest.raises(ScenarioError, match="boat_action: missing"):
            world.step(torch.zeros(2, 2, 2))
        for wrong in (torch.zeros(2, 1, 2), torch.full((2, 2, 2), math.nan)):
            with pytest.raises(ValueError, match=r"^boat_action"):
                world.step(torch.zeros(2, 2, 2), wrong)


class TestPlaces:
    @pytest.mark.parametrize(("changes", "usv"), [((), None), (RECKONS, None), (RECKONS, "belief")])
    def test_where_auvs_take_themselves_and_are_foreseen_to_be(self, changes, usv):
        world = make(*changes, usv=usv)
        world.estimate[:] = torch.arange(world.estimate.numel()).view_as(world.estimate)
        world.own[:] = -1 - torch.arange(world.own.numel()).view_as(world.own).float()
        world.foresight[:] = 0.5 + torch.arange(world.foresight.numel()).view_as(world.foresight)
        told = world.estimate[..., [EstimateColumn.x, EstimateColumn.y]]
        own = world.own[..., [tracker.X, tracker.Y]] if changes else told
        assert torch.equal(world.own_position, own)
        foreseen = world.foresight[..., [ForesightColumn.x, ForesightColumn.y]] if usv else told
        assert torch.equal(world.foreseen_position, foreseen)

    def test_foresight_begins_with_what_was_told_last(self):
        world = make(*RECKONS, "reference.straight_speed=1.7", usv="belief")
        track, exchange = torch.zeros_like(world.track), torch.zeros_like(world.exchange)
        track[..., tracker.X], track[..., tracker.Y] = torch.tensor([-5.0, 400.0]), torch.tensor([150.0, 230.0])
        exchange[..., ExchangeColumn.heads_for], exchange[..., ExchangeColumn.hovers] = 7.0, 4.0
        found = world._told({"track": track, "exchange": exchange})[0]
        expected = torch.zeros_like(found)
        expected[:, ForesightColumn.x], expected[:, ForesightColumn.y] = (
            torch.tensor([0.0, 300.0]),
            torch.tensor([150.0, 200.0]),
        )
        expected[:, ForesightColumn.heads_for], expected[:, ForesightColumn.hovers] = 7.0, 4.0
        expected[:, ForesightColumn.speed] = 1.7
        torch.testing.assert_close(found, expected)


class TestGoingOn:
    def test_a_state_is_a_copy_and_brings_everything_back(self):
        world = make(*WAVES)
        world.reset()
        steps(world, 3)
        world.auv[..., AuvColumn.x] = 42.0
        state = world.state()
        elevation = world.sea.elevation()
        world.auv[..., AuvColumn.x] = 7.0
        world.reset()
        steps(world, 5)
        world.load_state(state)
        assert (world.auv[..., AuvColumn.x] == 42).all()
        assert world._clock.tolist() == [[0, 3], [0, 3]]
        assert (world._water.episode, world._water.steps) == (0, 3)
        assert world.sea.time == world.storm.time == 3
        np.testing.assert_array_equal(world.sea.elevation(), elevation)
        assert state["sea_episode"].tolist() == [0, 3]

    def test_of_another_world_all_but_its_plans(self):
        """Tours are this rule's, of this world's reset; a foresight is made where the other has none."""
        other, world = make(*RECKONS), make(*RECKONS, "nodes.target_rule=nearest", usv="belief")
        other.reset()
        steps(other, 4)
        for number, one in enumerate((other, world), 1):
            one.node[..., NodeColumn.tour] = one.node[..., NodeColumn.successor] = number
            one.node[..., NodeColumn.owner] = number % 2
        other.node[..., NodeColumn.backlog] = 11.0
        world.continue_from(other)
        assert (world.node[..., NodeColumn.backlog] == 11).all()
        for column, own in ((NodeColumn.tour, 2), (NodeColumn.successor, 2), (NodeColumn.owner, 0)):
            assert (world.node[..., column] == own).all()
        assert world._clock.tolist() == other._clock.tolist() == [[0, 4], [0, 4]]
        assert (world.foresight[..., ForesightColumn.speed] == world.scenario.reference.straight_speed).all()

    def test_with_other_circulations(self):
        """Those that an episode would have begun with, wherever the vortices are now; otherwise they stay."""
        first, then = (
            ("current.count=3", f"current.circulation_min={low}", f"current.circulation_max={low + 2}")
            for low in (1, 10)
        )
        world = make(*first)
        world.reset()
        steps(world, 2)
        world.vortex[:] = 5.0
        world.set_parameters(make(*first, "acoustics.source_level=150").scenario)
        assert (world.vortex == 5).all()
        other = make(*then).scenario
        world.set_parameters(world.scenario.model_copy(update={"current": other.current}))
        drawn = first_vortices(other, 3)[0, :, Vortex.Gamma]
        assert torch.equal(world.vortex[0, :, Vortex.Gamma], drawn)
        assert (drawn.abs() >= 10).all()
        assert (world.vortex[..., [Vortex.x, Vortex.y, Vortex.delta]] == 5).all()

    def test_not_with_a_state_that_cannot_be(self):
        world = make()
        world.reset()
        with pytest.raises(ScenarioError, match=r"^state of the world: auv is missing$"):
            world.load_state({name: value for name, value in world.state().items() if name != "auv"})

    def test_with_other_parameters(self):
        world = make(*WAVES)
        world.reset()
        steps(world, 4)
        louder = Scenario.from_dict(
            {**world.scenario.to_dict(), "acoustics": {**world.scenario.to_dict()["acoustics"], "source_level": 150}}
        )
        before = world._constants["link"].clone()
        world.set_parameters(louder)
        assert world.scenario is louder
        assert world.site.scenario is louder
        assert not torch.equal(world._constants["link"], before)
        assert world.storm.time == 4


class TestWords:
    def test_a_fault_names_world_quantity_and_time(self):
        world = make("mission.step=0.5", first_world=7)
        world.reset()
        steps(world, 3)
        world._clock[0, 1] = 99
        world.node[1, 4, NodeColumn.y] = math.nan
        with pytest.raises(DivergenceError, match=r"^world 8 at 2 s: y of node 4 is nan: must be from 0 to 200$"):
            steps(world, 1)

    def test_a_fault_that_is_none_any_more(self):
        assert make()._first_fault() == (0, "its state was not finite")

    def test_plugins_are_named_where_something_fails(self, monkeypatch):
        """In a fault, and where their Taichi functions cannot be compiled; an error of our own stays as it is."""

        def fails(*arguments):
            raise SyntaxError("no such name")

        monkeypatch.setattr(module, "Launch", fails)
        monkeypatch.setattr(World, "_bind", BIND)
        with pytest.raises(SyntaxError, match="no such name"):
            make()
        for registry, name in ((target_rules, "nearest"), (observation_terms, "border"), (boat_strategies, "centroid")):
            monkeypatch.setitem(registry._files, name, f"/mine/{name}.py")
        said = "usv 'centroid' of /mine/centroid.py, .*'nearest' of /mine/nearest.py, .*'border' of /mine/border.py"
        with pytest.raises(ScenarioError, match=f"^{said}: .*no such name"):
            make("nodes.target_rule=nearest", usv="centroid")
        monkeypatch.setattr(World, "_bind", lambda world: None)
        world = make("nodes.target_rule=nearest", usv="centroid")
        world.boat[0, 0, BoatColumn.x] = -1e30
        with pytest.raises(DivergenceError, match=rf"world 0 at .* \(uses {said}\)$"):
            world._stop_at_fault()

    def test_a_term_of_the_observation_is_named(self):
        world = make()
        place = world.observation_layout.slice("position")
        world.observation[1, 0, place.start] = math.inf
        assert world._first_fault() == (1, "observation 'position' of AUV 0 is inf")

    def test_memory_is_that_of_the_arrays(self, monkeypatch):
        asked = []
        monkeypatch.setattr(module, "require", lambda *given: asked.append(given[:2]))
        pulses = pulse.Pulses(torch.zeros(3, 1), torch.zeros(3, 1, 6), torch.zeros(3))
        monkeypatch.setattr(module.tables, "pulse_tables", lambda *given: pulses)
        changes = ("usbl.model=waveform", "auv.count=3", "boat.count=2", "nodes.target_rule=rollout:90")
        world = make(*changes, *RECKONS, num_worlds=5, usv="belief")
        ((room, words),) = asked
        held = (world._constants[name] for name in ("workspace", "pulse_noise"))
        assert room == 4 * (module.WORKSPACE * world._numbers.numel() + sum(part.numel() for part in held))
        assert world._constants["pulse_noise"].shape == (5, 6, 8)
        assert words == "num_worlds = 5 of 3 AUVs"

    def test_what_is_not_of_single_worlds(self):
        always = ("sea", "sea_clock", "sea_episode")
        assert make(*RECKONS, usv="belief").common_state == always
        assert make().common_state == (*always, "track", "own", "exchange", "foresight")

    def test_where_terms_begin(self):
        world = make("observation.current=vector")
        first = [place.start for _, place in world.observation_layout]
        assert world._constants["observation_first"].tolist() == first
        assert world._constants["key"].tolist() == [[3, 0, 0], [3, 0, 1]]

    def test_elevation_is_that_of_long_waves_and_storm(self):
        world = make(*WAVES, "sea.realisations=2", num_worlds=3)
        world.reset()
        steps(world, 3)
        x, y = (np.arange(12) + 0.5) * 25, (np.arange(8) + 0.5) * 25
        for sea, found in ((1, world.surface(12, 1)), (0, world.surface(12))):  # world 0's by default
            expected = world.sea.elevation()[sea] + world.storm.elevation(sea, x, y)
            np.testing.assert_allclose(found, expected, atol=1e-6)
        np.testing.assert_array_equal(world.long_waves(12)[0], world.sea.elevation()[0])
