"""Several boats: which one serves an AUV, where each begins and goes, and how they share the acoustic channel."""

import math

import numpy as np
import pytest
import torch

from tests.kernels.planning.reference import best_by_dense_search, log_objective
from tests.links import CODED, EVERY_STEP
from usvauv.env import Scenario, ScenarioError, World
from usvauv.env.world.mission_parameters import link_table
from usvauv.kernels.mission.columns import AuvColumn, BoatColumn, EstimateColumn, ExchangeColumn, ForesightColumn, Reply
from usvauv.kernels.planning import objectives, search
from usvauv.kernels.positioning import tracker, usbl

TEAMS = ["area.width=400", "area.length=400", "auv.count=4", "boat.count=2"]
TWO = [*EVERY_STEP, *TEAMS, "task=station-keeping"]
ONE = [*EVERY_STEP, *TEAMS, "boat.count=1"]
IN_TURN = [*TEAMS, "channel.schedule=turns", "nodes.target_rule=tour"]
CHANNEL = [*CODED, *TEAMS, "task=station-keeping"]
APART = "hold:50,200,350,200"


def world_of(changes, usv, worlds=4, seed=1):
    world = World(Scenario.load("ideal", changes), worlds, seed, usv)
    world.reset()
    return world


def step(world, auvs=None):
    """One step at random commands; then AUVs are put in the places (K, 2) given, of which the boats know."""
    generator = torch.Generator().manual_seed(int(world.state()["clock"][0, 1]))
    world.step((2 * torch.rand((world.num_worlds, world.num_auvs, 2), generator=generator) - 1).to(world.device))
    if auvs is not None:
        put(world, auvs)


def put(world, auvs):
    for table in (world.auv, world.estimate):
        table[..., :2] = auvs.to(world.device)


def exchanges(world, auvs, steps):
    """Exchanges of AUVs that stay in places (K, 2): those heard, by which boat, and that reply, each (steps, W, K)."""
    put(world, auvs)
    seen = []
    for _ in range(steps):
        step(world, auvs)
        heard = (world.auv[..., AuvColumn.fix_flags].int() & usbl.DETECTED) > 0
        replies = world.exchange[..., ExchangeColumn.reply] != Reply.none
        seen.append((heard, world.auv[..., AuvColumn.fix_boat].clone(), replies))
    return (torch.stack(each).cpu() for each in zip(*seen, strict=True))


def server(world):
    return world.estimate[..., EstimateColumn.served_by].long()


def places(world):
    return world.boat[..., BoatColumn.span("x", "y")]


class TestService:
    def test_boats_begin_in_the_middle_of_groups(self):
        """Every boat has AUVs, which are those nearest to it, and begins at their mean."""
        world = world_of([*IN_TURN, "auv.count=6", "boat.count=3"], "belief", worlds=300)
        by, auvs = server(world), world.auv[..., :2]
        assert torch.equal(by, torch.cdist(auvs, places(world)).argmin(-1))
        for b in range(3):
            own = (by == b)[..., None]
            assert own.any(1).all()
            mean = (auvs * own).sum(1) / own.sum(1)
            torch.testing.assert_close(mean, places(world)[:, b], atol=1e-3, rtol=0)

    def test_an_auv_changes_to_a_boat_that_is_clearly_nearer(self):
        """It stays with either as long as the other is not nearer by a tenth of its distance, 300 m apart."""
        world = world_of(TWO, APART)
        border = 300 / (2 - 0.1)
        way = (10, 0), (150, 0), (border - 4, 0), (border + 4, 1), (150, 1), (304 - border, 1), (296 - border, 0)
        for away, expected in way:
            auvs = torch.tensor([[50.0 + away, 200.0]]).expand(4, 2)
            put(world, auvs)
            step(world, auvs)
            assert (server(world) == expected).all(), away


class TestFixes:
    ERRORS = (
        *("usbl.gnss_error=3", "usbl.heading_error=0.005", "usbl.alignment_error=0.005", "usbl.attitude_error=0.005"),
        *("usbl.lever_arm_error=0.5", "reward.collaboration=2"),
    )

    def test_are_those_of_a_boat_alone_in_its_place(self):
        """An AUV's fix by the boat that serves it is bit for bit that of a world with this boat only."""
        both = world_of(TWO, APART, worlds=20)
        alone = [world_of([*TWO, "boat.count=1"], f"hold:{x},200", worlds=20) for x in (50, 350)]
        counts = np.zeros(2, int)
        for _ in range(30):
            for world in (both, *alone):
                step(world)
            assert torch.equal(both.auv[..., AuvColumn.fix_boat].long(), server(both))
            for b in range(2):
                own = server(both) == b
                counts[b] += int(own.sum())
                for column in (*range(AuvColumn.fix_x, AuvColumn.heard_y + 1), AuvColumn.covariance_xx):
                    assert torch.equal(both.auv[..., column][own], alone[b].auv[..., column][own])
        assert (counts > 300).all()

    def test_each_boat_has_errors_of_its_own(self):
        """Errors of the first are the same as of one boat alone; errors of the second are drawn apart."""
        both = world_of([*TWO, *self.ERRORS], APART, worlds=100)
        alone = world_of([*TWO, *self.ERRORS, "boat.count=1"], "hold:50,200", worlds=100)
        for _ in range(3):
            step(both)
            step(alone)
        own = server(both) == 0
        fix = AuvColumn.span("fix_x", "fix_y")
        assert torch.equal(both.auv[..., fix][own], alone.auv[..., fix][own])
        gnss = both.boat[..., BoatColumn.span("gnss_x", "gnss_y")]
        assert torch.equal(gnss[:, 0], alone.boat[:, 0, BoatColumn.span("gnss_x", "gnss_y")])
        correlation = torch.corrcoef(gnss.transpose(0, 1).reshape(2, -1))[0, 1]
        assert abs(correlation) < 4 / math.sqrt(200)
        error = both.auv[..., fix] - both.auv[..., AuvColumn.span("heard_x", "heard_y")]
        by = gnss.gather(1, server(both)[..., None].expand(-1, -1, 2))
        assert (error - by).square().mean() < 0.5 * error.square().mean()

    def test_a_boat_that_serves_nobody_changes_nothing(self):
        """The second boat is in a corner, the AUVs are all nearer to the first."""
        central = [*TWO, "auv.start_margin=160"]
        worlds = [
            world_of([*central, f"boat.count={count}"], usv, worlds=6)
            for count, usv in ((1, "hold:200,200"), (2, "hold:200,200,0,0"))
        ]
        for _ in range(20):
            for world in worlds:
                step(world)
        one, two = worlds
        assert (server(two) == 0).all()
        for name in ("auv", "estimate", "exchange", "observation", "reward"):
            assert torch.equal(getattr(one, name), getattr(two, name)), name
        assert torch.equal(one.boat[:, 0], two.boat[:, 0])


class TestChannel:
    LONG = (*CHANNEL, "channel.turn_around=1.2")
    AUVS = torch.tensor([[60.0, 200.0], [330.0, 200.0], [350.0, 180.0], [370.0, 200.0]])

    @pytest.mark.slow
    def test_boats_ask_in_turn_and_one_at_a_time(self):
        """The one AUV of the first boat has half the exchanges, the three of the other a sixth each."""
        world = world_of([*self.LONG, "channel.schedule=turns"], APART)
        steps = 240
        heard, by, replies = exchanges(world, self.AUVS, steps)
        assert (heard.sum(-1) <= 1).all()
        assert (replies.sum(-1) <= 1).all()
        counts = heard.sum(0).float()
        # The sound's way, the turn-around and the signal, exchange after exchange: 105 m of slant range on average.
        lasts = 2 * 103 / 1500 + 1.2 + 0.01
        total = counts.sum(1)
        assert (total - steps / lasts).abs().max() < 4
        torch.testing.assert_close(
            counts, total[:, None] * torch.tensor([1 / 2, 1 / 6, 1 / 6, 1 / 6]), atol=1.1, rtol=0
        )
        assert set(np.diff(by[:, 0][heard[:, 0]])) == {-1.0, 1.0}

    @pytest.mark.slow
    def test_all_at_once_by_each_boat_in_turn(self):
        """Each AUV is heard by the boat that has asked; the exchange lasts until the reply of the farthest."""
        world = world_of([*self.LONG, "channel.schedule=all"], APART)
        heard, by, _ = exchanges(world, self.AUVS, 100)
        farthest = math.hypot(320, 100)
        for k in range(4):
            order = by[:, 0, k][heard[:, 0, k]]
            assert len(order) == pytest.approx(100 / (2 * farthest / 1500 + 1.21), abs=3)
            assert set(np.diff(order)) == {-1.0, 1.0}

    def test_a_boat_far_from_all_does_not_jump_the_queue(self):
        """No AUV is located twice in a step: the near boat waits for the next one, and the far one for the near one."""
        world = world_of([*CHANNEL, "channel.turn_around=0.6", "channel.schedule=slots"], APART)
        auvs = torch.tensor([[40.0, 200.0], [60.0, 200.0], [50.0, 190.0], [50.0, 210.0]])
        heard, by, _ = exchanges(world, auvs, 40)
        order = by[:, 0, 0][heard[:, 0, 0]]
        assert len(order) > 25
        assert set(np.diff(order)) == {-1.0, 1.0}


class TestPlans:
    def test_fim_plans_for_the_auvs_that_a_boat_serves(self):
        """The goals are those of the search over these alone, near the maximum between searches everywhere."""
        world = world_of(TWO, "fim", worlds=3)
        scenario = world.scenario
        link = torch.from_numpy(link_table(world.site)).to(world.device)
        code = objectives.objective_code(scenario.planner.measurement, scenario.planner.objective)
        for _ in range(5):
            known, last = world.estimate[..., :3].clone(), world.boat[..., BoatColumn.span("goal_x", "goal_y")].clone()
            step(world)
            for w in range(3):
                for b in range(2):
                    own = server(world)[w] == b
                    best = search.plan_batch(
                        link[own].contiguous(),
                        known[w : w + 1, own].contiguous(),
                        code=code,
                        width=400.0,
                        length=400.0,
                        start=last[w : w + 1, b].contiguous(),
                    )
                    goal = world.boat[w, b, BoatColumn.span("goal_x", "goal_y")]
                    torch.testing.assert_close(goal, best[0, :2], atol=0.2, rtol=0)

    def test_fim_leaves_a_lower_maximum_within_four_seconds(self):
        """Its goal is above one AUV, while two others are close together and far away."""
        world = world_of([*ONE, "auv.count=3", "auv.depth=30"], "fim")
        auvs = torch.tensor([[40.0, 200.0], [40.0, 200.0], [360.0, 200.0]])
        step(world, auvs)
        goal = world.boat[..., BoatColumn.span("goal_x", "goal_y")]
        goal[...] = auvs[-1].to(world.device)
        east = []
        for _ in range(4):
            step(world, auvs)
            east.append(float(goal[..., 0].mean()))
        assert east[0] > 300
        assert east[-1] < 100

    def test_fim_finds_the_best_place_for_64_auvs(self):
        """It leaves the smaller of two groups; no place of a dense grid, polished, is better by 1e-5 in ln."""
        world = world_of([*ONE, "auv.count=64", "auv.depth=30", "auv.start_separation=10"], "fim")
        code = objectives.objective_code(world.scenario.planner.measurement, world.scenario.planner.objective)
        groups = torch.tensor([[60.0, 200.0]] * 24 + [[340.0, 200.0]] * 40)
        auvs = groups + 20 * torch.rand(64, 2, generator=torch.Generator().manual_seed(0))
        step(world, auvs)
        goal = world.boat[:, 0, BoatColumn.span("goal_x", "goal_y")]
        goal[...] = auvs[0].to(world.device)
        while int(world.state()["clock"][0, 1]) < 4:
            known = world.estimate[..., :3].clone().cpu()
            step(world, auvs)
        link = torch.from_numpy(link_table(world.site))
        reached = log_objective(goal.double().cpu(), known.double(), link.double(), code)
        assert (best_by_dense_search(known, link, code, 400.0) - reached).max() < 1e-5

    def test_belief_visits_its_own_auvs(self):
        """And a state that is brought back has the same future."""
        world = world_of(IN_TURN, "belief", 8, 3)
        counts = torch.zeros(2)
        for done in range(40):
            step(world)
            index = world.boat[..., BoatColumn.visits].long()
            foreseen = world.foresight[..., : ForesightColumn.y + 1]
            place = foreseen.gather(1, index.clamp_min(0)[..., None].expand(-1, -1, 2))
            goal = world.boat[..., BoatColumn.span("goal_x", "goal_y")]
            goes = index >= 0
            own = server(world).gather(1, index.clamp_min(0)) == torch.arange(2, device=world.device)
            assert (place - goal)[goes & own].abs().max() < 0.1
            if done > 5:
                counts += torch.tensor([int((goes & own).sum()), int(goes.sum())])
        assert counts[1] > 100
        assert counts[0] > 0.95 * counts[1]
        state = world.state()
        for b in range(2):
            goals = []
            for share in (1, 30):  # the uncertainty of the AUVs of the other boat
                world.load_state(state)
                world.track[..., tracker.XX : tracker.VV + 1][server(world) != b] *= share
                world.boat[..., BoatColumn.planned] = -1e3  # plan anew
                step(world)
                goals.append(world.boat[:, b, BoatColumn.span("goal_x", "goal_y")].clone())
            assert torch.equal(*goals)
        world.load_state(state)
        step(world)
        after = world.state()
        world.load_state(state)
        step(world)
        assert all(torch.equal(value, after[name]) for name, value in world.state().items())
        state["estimate"][1, 2, EstimateColumn.served_by] = 2
        with pytest.raises(
            ScenarioError, match="served_by of the estimate of AUV 2 is 2: must be a whole number from 0 to 1"
        ):
            world.load_state(state)


@pytest.mark.parametrize(
    ("changes", "usv", "words"),
    [
        (["boat.count=2"], "hold:1,2,3", "expected hold:X,Y, for example hold:100,100 or hold:100,100,100,100"),
        ([], "hold:1,inf", "expected hold:X,Y"),
        ([], "fim:3", "usv: 'fim:3': allowed are fim, .*belief, agent, hold:X,Y"),
        ([], "fim-horizon", "^usv: 'fim-horizon': was removed in 0.3$"),
        (EVERY_STEP, "belief", "needs navigation.sensor to be ground"),
    ],
)
def test_refusals(changes, usv, words):
    with pytest.raises(ScenarioError, match=words):
        World(Scenario.load("ideal", changes), 1, usv=usv)
