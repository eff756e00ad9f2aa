"""The boat's foresight and its rollouts: against the tracker's filter, and in missions."""

import math

import pytest
import taichi as ti
import torch

from usvauv import policies
from usvauv.env import Scenario, ScenarioError, World
from usvauv.kernels.mission.columns import AuvColumn, BoatColumn, ExchangeColumn, ForesightColumn
from usvauv.kernels.positioning import tracker
from usvauv.kernels.types import array1, array2, array3, vec3

WIDE = ["nodes.count=60", "boat.vessel=none", "boat.response_time=3", "boat.top_speed=2"]  # a slow boat
VARIANCE, TAU, R = 0.01, 300.0, 16.0


@ti.kernel
def drift_and_fix(factors: array1, track: array3, scalars: array2):
    """A track by the tracker, and (a, b, c) of it by the planner, over the same drift and the same fix."""
    drift = tracker.Drift(way=factors[0], kept=factors[1], position=factors[2], cross=factors[3], current=factors[4])
    for n in range(track.shape[0]):
        a, b, c = tracker.drifted(track[n, 0, tracker.XX], track[n, 0, tracker.XU], track[n, 0, tracker.UU], drift)
        scalars[n, 0], scalars[n, 1], scalars[n, 2] = tracker.fixed(a, b, c, R)
        tracker.drift(track, n, 0, ti.math.vec2(0.0, 0.0), factors[5], VARIANCE, TAU)
        place = ti.math.vec2(track[n, 0, tracker.X], track[n, 0, tracker.Y])
        tracker.update(track, n, 0, place, vec3(R, 0.0, R), VARIANCE, 3.0)


@pytest.mark.parametrize("time", [5.0, 200.0])
def test_uncertainty_is_the_trackers(device, time):
    f = 1.0 - math.exp(-time / TAU)
    spread = VARIANCE * TAU**2 * (2 * time / TAU - 3 + 4 * math.exp(-time / TAU) - math.exp(-2 * time / TAU))
    factors = [TAU * f, 1 - f, spread, VARIANCE * TAU * f * f, VARIANCE * f * (2 - f), time]
    track = torch.zeros((2, 1, tracker.COLUMNS), device=device)
    for n, (a, b, c) in enumerate([(4.0, 0.1, 0.01), (900.0, 2.0, 0.02)]):
        for columns, number in (((tracker.XX, tracker.YY), a), ((tracker.XU, tracker.YV), b)):
            track[n, 0, list(columns)] = number
        track[n, 0, [tracker.UU, tracker.VV]] = c
    scalars = torch.zeros((2, 3), device=device)
    drift_and_fix(torch.tensor(factors, device=device), track, scalars)
    by_tracker = track[:, 0, [tracker.XX, tracker.XU, tracker.UU]]
    assert torch.allclose(scalars, by_tracker, rtol=2e-4)


def fly(world, steps, policy="pace"):
    act = policies.load(policy, world).act
    observation = world.reset()
    for _ in range(steps):
        observation, *_ = world.step(act(observation))
        yield world


class TestForesight:
    def test_it_is_nearer_than_where_the_auv_was_heard(self):
        world = World(Scenario.load("wide", [*WIDE, "boat.strategy=visit"]), 24, 4)
        assert world.strategy.name == "visit"
        foreseen_error, last_error = [], []
        for step, _ in enumerate(fly(world, 400)):
            if step % 20 == 0:
                elapsed = world.exchange[..., ExchangeColumn.elapsed]
                out = (elapsed > 60) & (elapsed < 180)
                true = world.auv[..., :2]
                foreseen_error.append((world.foresight[..., :2] - true).norm(dim=-1)[out])
                last_error.append((world.track[..., :2] - true).norm(dim=-1)[out])
        foreseen_error, last_error = torch.cat(foreseen_error), torch.cat(last_error)
        assert len(foreseen_error) > 200
        assert foreseen_error.median() < 0.5 * last_error.median()


class TestMissions:
    def test_visits_go_to_the_least_certain(self):
        world = World(Scenario.load("wide", WIDE), 8, 3, "visit")
        for _ in fly(world, 100):
            pass
        goal = world.boat[:, 0, BoatColumn.goal_x : BoatColumn.goal_y + 1]
        away = (world.foresight[..., :2] - goal[:, None]).norm(dim=-1)
        elapsed = world.exchange[..., ExchangeColumn.elapsed]
        chosen = away.argmin(dim=1)
        assert (away.min(dim=1).values < 10).all()
        # The log's bias drifts alike in all AUVs: the least certain one is among those not heard for longest.
        longest = elapsed.gather(1, chosen[:, None])[:, 0] / elapsed.max(dim=1).values
        assert longest.median() > 0.9

    def test_belief_visits_an_auv_that_wind_lets_it_reach(self):
        """Two AUVs wait 450 m away, one against a leeway of 1.7 m/s; the boat makes 2 m/s through the water."""
        changes = ["auv.count=2", "boat.windage=0.08", "current.count=0", "area.width=1400", "area.length=1400"]
        world = World(Scenario.load("wide", [*WIDE, *changes]), 64, 5, "belief")
        world.reset()
        for k, side in enumerate((450.0, -450.0)):  # the storm comes from the east
            place = torch.tensor([700.0 + side, 700.0], device=world.device)
            for array in (world.auv, world.track, world.estimate, world.foresight):
                array[:, k, :2] = place
        world.foresight[..., ForesightColumn.speed] = 0.01
        world.boat[:, 0, BoatColumn.x : BoatColumn.y + 1] = 700.0
        world.step(torch.zeros(64, 2, 2, device=world.device))
        visits = world.boat[:, 0, BoatColumn.visits]
        assert (visits == 1).sum() > 10 * (visits == 0).sum()

    @pytest.mark.slow
    def test_belief_keeps_auvs_on_their_way_that_centroid_loses(self):
        """Data and longest silence in the same 24 worlds, 600 s."""
        results = {}
        for boat in ("centroid", "belief"):
            world = World(Scenario.load("wide", WIDE), 24, 5, boat)
            data, silence = 0.0, 0.0
            for step, _ in enumerate(fly(world, 600)):
                if boat == "belief" and step == 0:  # it plans at once, and goes to different AUVs
                    assert (world.boat[:, 0, BoatColumn.planned] == world.scenario.mission.step).all()
                    assert len(world.boat[:, 0, BoatColumn.visits].unique()) > 1
                data += world.auv[..., AuvColumn.delivered].sum(1).double()
                silence = torch.maximum(
                    torch.as_tensor(silence), world.exchange[..., ExchangeColumn.elapsed].max(dim=1).values
                )
            results[boat] = data.cpu().numpy(), silence.cpu().numpy()
        gain = results["belief"][0] - results["centroid"][0]
        assert gain.mean() > 3 * gain.std(ddof=1) / math.sqrt(len(gain))
        assert results["belief"][1].mean() < 0.8 * results["centroid"][1].mean()

    def test_what_it_cannot_do_is_refused(self):
        for boat in ("belief", "visit"):  # AUVs that do not reckon are not foreseen
            with pytest.raises(ScenarioError, match=f"'{boat}' foresees AUVs .* needs navigation\\.sensor"):
                World(Scenario.load("wide", ["navigation.sensor=none", f"boat.strategy={boat}"]))
        with pytest.raises(ScenarioError, match=r"^boat\.strategy: 'drift': allowed are fim"):
            World(Scenario.load("wide", ["boat.strategy=drift"]))
