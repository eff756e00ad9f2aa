"""A mission in the batched world: motion, storm, task, reward and observation, step by step."""

import math

import numpy as np
import pytest
import torch

from tests.links import EVERY_STEP
from tests.usvauv_env.world.test_world import run, steer
from usvauv.env import Scenario, World
from usvauv.env.sea.water import build_short_waves
from usvauv.env.site.site import Site
from usvauv.kernels.flow import airy
from usvauv.kernels.mission.columns import AuvColumn, BoatColumn, EstimateColumn, NodeColumn, TallyColumn
from usvauv.kernels.types import Level


@pytest.fixture(scope="module")
def extreme():
    return Scenario.load("extreme")


AT_ONCE = ["auv.vehicle=none", "auv.battery=1000", "auv.speed_lag=0", "auv.speed_noise=0", "auv.depth_noise=0"]


class TestMotion:
    def test_velocity_through_water_plus_current(self):
        world = World(Scenario.load("extreme", AT_ONCE), num_worlds=200, seed=4)
        world.reset()
        before = world.auv.clone()
        world.step(torch.full((200, 2, 2), 0.5))
        after = world.auv
        speed = 2.2 * math.sqrt(0.5)
        expected = (
            before[..., AuvColumn.span("x", "y")]
            + speed * torch.tensor([1.0, 1.0], device=world.device) / math.sqrt(2)
            + before[..., AuvColumn.span("current_x", "current_y")]
        )
        moving = (after[..., AuvColumn.hovering] == 0) & (after[..., AuvColumn.border] == 0)
        assert moving.sum() > 300
        torch.testing.assert_close(after[..., AuvColumn.span("x", "y")][moving], expected[moving], rtol=0, atol=2e-5)


def storm_at(world: World, xy: torch.Tensor, level: int) -> torch.Tensor:
    """Storm (η, η_x, η_y, u, v, w, u_z, v_z) at the point (x, y) of each world; world w sails on sea w."""
    return airy.sample(world.storm.wave, world.storm.since, xy[:, None].contiguous(), level)[:, 0]


class TestStorm:
    quiet = (
        "sea.forced_edge=none",
        "sea.irregular_rms=0",
        "current.circulation_min=0",
        "current.circulation_max=0",
    )

    def test_it_lifts_tilts_and_carries_the_boat(self):
        """Nothing but the storm moves here; the boat without lag drifts with the water of the step before."""
        changes = [*self.quiet, "boat.vessel=none", "boat.dead_band=0"]
        world = World(Scenario.load("extreme", changes), num_worlds=16, seed=3)
        run(world, 7)
        place = BoatColumn.span("x", "y")
        world.boat[..., place] = 0.0  # more than 4 m from where it goes
        before = world.boat[:, 0].clone()
        world.step(torch.zeros(16, 2, 2))
        boat = world.boat[:, 0]
        seen = storm_at(world, boat[:, BoatColumn.span("x", "y")], Level.surface)
        seen[:, 3:5] += seen[:, :1] * seen[:, 6:]
        torch.testing.assert_close(boat[:, BoatColumn.span("elevation", "current_y")], seen[:, :5])
        assert seen[:, 0].std() > 0.8
        drift = before[:, BoatColumn.span("current_x", "current_y")]
        moved = (boat - before)[:, place]
        torch.testing.assert_close((moved - drift).norm(dim=1).cpu(), torch.full((16,), 4.0), atol=1e-4, rtol=0)

    def test_it_carries_the_auvs(self):
        """Waves that do not reach down to them are left out; no more than 1e-5 m/s of their motion is missing."""
        world = World(Scenario.load("extreme", [*self.quiet]), num_worlds=16, seed=3)
        run(world, 7)
        for k in range(world.num_auvs):
            seen = storm_at(world, world.auv[:, k, AuvColumn.span("x", "y")], Level.cruise)
            torch.testing.assert_close(world.current()[:, k], seen[:, 3:5], atol=1.1e-5, rtol=0)
        assert world.current().std() > 0.02

    def test_a_boat_adrift_has_the_stokes_drift(self):
        """Σ a² ω k, in deep water, of a long-crested JONSWAP sea that is not steep."""
        changes = [*self.quiet, "area.width=1000", "area.length=1000", "mission.step=0.25", "mission.duration=600"]
        changes += ["storm.significant_height=1", "storm.peak_period=9", "storm.spreading=1000", "sea.realisations=64"]
        changes += ["boat.top_speed=1e-4", "boat.windage=0", "boat.response_time=0", "boat.dead_band=0"]
        world = World(Scenario.load("extreme", [*changes, "nodes.count=2"]), num_worlds=64, seed=5)
        world.reset()
        start = world.boat[:, 0, BoatColumn.span("x", "y")].clone()
        for _ in range(world.steps):
            world.step(torch.zeros(64, 2, 2))
        drift = (world.boat[:, 0, BoatColumn.span("x", "y")] - start).mean(dim=0) / 600
        expected = (world.storm.amplitude**2 * world.storm.omega * world.storm.k).sum(axis=1).mean()
        assert -drift[0].item() == pytest.approx(expected, rel=0.04)
        assert abs(drift[1].item()) < 0.05 * expected

    def test_surface_shows_the_storm_of_the_world_s_own_sea(self):
        scenario = Scenario.load("extreme", self.quiet)
        world = World(scenario, num_worlds=1, seed=3, first_world=5)
        fine = World(scenario, num_worlds=1, seed=3, first_world=5, fine_sea=True)
        for each in (world, fine):
            run(each, 3)
        pool = build_short_waves(Site(scenario), [(3, sea) for sea in range(16)])
        pool.set_time(3.0)
        for each, pixels in ((world, 50), (fine, 128)):
            seen = each.surface(pixels)
            assert len(seen) >= pixels / 2
            x = (np.arange(len(seen)) + 0.5) * 200 / len(seen)
            np.testing.assert_allclose(seen, pool.elevation(5, x, x), atol=1e-5)

    def test_extreme_is_as_it_says(self, extreme):
        """The numbers of the scenario's description, over whole missions of 256 worlds, each on its own sea."""
        assert "heaves by 1.7 m rms and tilts by more than 17° one step in a hundred" in extreme.description
        assert "currents of 0.3 to 0.75 m/s, one in twenty above 1.2 m/s" in extreme.description
        assert 6 <= extreme.storm.significant_height < 9  # WMO sea state 7
        world = World(extreme, num_worlds=256, seed=2)
        observation = world.reset()
        boat, current = [], []
        for _ in range(world.steps):
            observation, *_ = world.step(steer(observation))
            boat.append(world.boat[:, 0].clone())
            current.append(world.current().norm(dim=-1))
        elevation, slope_x, slope_y = torch.stack(boat)[..., BoatColumn.span("elevation", "slope_y")].unbind(-1)
        assert elevation.square().mean().sqrt().item() == pytest.approx(1.67, abs=0.03)
        tilt = np.degrees(np.arctan(torch.hypot(slope_x, slope_y).cpu().numpy()))
        assert np.quantile(tilt, 0.99) == pytest.approx(17, abs=0.7)
        low, high, strong = np.quantile(torch.stack(current).cpu().numpy(), [0.25, 0.75, 0.95])
        assert (low, high, strong) == pytest.approx((0.3, 0.75, 1.2), abs=0.04)


class TestTask:
    def test_node_is_hovered_over_emptied_and_counted(self):
        """Hovering lasts payload · b/C ÷ rate; then, where nothing arrives, the buffer is empty, the rate counted."""
        alone = ["auv.count=1", "usbl.carriers=[18000]"]  # compiled as two AUVs
        scenario = Scenario.load("ideal", [*alone, "nodes.count=2", "nodes.arrival_rates=[0]"])
        world = World(scenario, num_worlds=64, seed=3)
        observation = world.reset()
        hovered = torch.zeros(64, device=world.device)
        done = torch.zeros(64, dtype=torch.bool, device=world.device)
        for _ in range(400):
            target = world.auv[:, 0, AuvColumn.target].long()
            backlog = world.node[torch.arange(64, device=world.device), target, NodeColumn.backlog].clone()
            observation, *_ = world.step(steer(observation, 1))
            measures = dict(zip(world.measure_names, world.measures()[:, 0].unbind(-1), strict=True))
            hovered += torch.where(done, 0.0, measures["hovering"])
            served = (measures["service_rate"] > 0) & ~done
            for w in served.nonzero().flatten().tolist():
                megabits = 2.0 * backlog[w].item() / 5000
                rate = measures["service_rate"][w].item()
                assert measures["delivered"][w].item() == pytest.approx(megabits, rel=1e-5)
                assert hovered[w].item() == max(1, math.ceil(megabits / rate - 1e-4))
                assert world.node[w, target[w], NodeColumn.backlog] == 0
                assert world.auv[w, 0, AuvColumn.target].long() != target[w]
            done |= served
        assert done.all()

    @pytest.mark.slow
    def test_rate_at_a_hundred_metres(self):
        """Shannon's rate over 10 kHz at 20 kHz and 100 m, from the sonar equation written out by hand."""
        link = ["nodes.rate_law=shannon", "nodes.frequency=20000", "nodes.bandwidth=10000"]
        scenario = Scenario.load("ideal", [*EVERY_STEP, *link, *AT_ONCE, "area.depth=200", "auv.count=1"])
        f = 20.0
        alpha = 0.11 * f**2 / (1 + f**2) + 44 * f**2 / (4100 + f**2) + 2.75e-4 * f**2 + 0.003
        densities = (
            17 - 30 * math.log10(f),
            40 + 26 * math.log10(f) - 60 * math.log10(f + 0.03),
            50 + 20 * math.log10(f) - 40 * math.log10(f + 0.4),
            -15 + 20 * math.log10(f),
        )
        noise = 10 * math.log10(sum(10 ** (d / 10) for d in densities)) + 40
        world = World(scenario, num_worlds=16, seed=3)
        observation = world.reset()
        rates = []
        for _ in range(200):
            observation, *_ = world.step(steer(observation, 1))
            rates += [r for r in world.auv[:, 0, AuvColumn.service_rate].tolist() if r > 0]
        assert rates
        for slant in (100.0, math.hypot(100, 6)):
            snr = 10 * math.log10(0.03) + 170.77 - 15 * math.log10(slant) - alpha * slant / 1000 - noise
            limit = 0.01 * math.log2(1 + 10 ** (snr / 10))
            assert min(rates) >= limit - 1e-5 if slant > 100 else max(rates) <= limit + 1e-5

    def test_arrivals_are_poisson_and_a_full_buffer_overflows(self):
        scenario = Scenario.load("ideal", ["nodes.arrival_rates=[8]", "nodes.start_backlog=0", "nodes.buffer=240"])
        world = World(scenario, num_worlds=400, seed=3)
        world.reset()
        world.step(torch.zeros(400, 2, 2))
        first = world.node[..., NodeColumn.backlog].flatten()
        n = first.numel()
        assert first.mean().item() == pytest.approx(8, abs=5 * math.sqrt(8 / n))
        assert first.var().item() == pytest.approx(8, abs=5 * 8 * math.sqrt(2.2 / n))
        for _ in range(60):
            world.step(torch.zeros(400, 2, 2))
        assert world.node[..., NodeColumn.backlog].max() == 240
        assert world.tally[:, TallyColumn.overflowing].min() > 20


class TestReward:
    def test_terms_by_hand(self):
        unpaid = ["reward.overflow=-0.05", "reward.service=30", "nodes.buffer=1000"]
        scenario = Scenario.load("extreme", unpaid)
        world = World(scenario, num_worlds=64, seed=6)
        observation = world.reset()
        w = scenario.reward
        losses = 0.0
        for _ in range(120):
            node = world.node[..., NodeColumn.span("x", "y")].gather(
                1, world.auv[..., AuvColumn.target].long()[..., None].expand(-1, -1, 2)
            )
            before = (node - world.auv[..., AuvColumn.span("x", "y")]).norm(dim=-1)
            hovering = world.auv[..., AuvColumn.hover] > 0
            observation, reward, _, _, info = world.step(steer(observation))
            auv, boat, tally = world.auv, world.boat, world.tally
            closed = torch.where(hovering, 0.0, before - (node - auv[..., AuvColumn.span("x", "y")]).norm(dim=-1))
            apart = (auv[:, 0, 0:2] - auv[:, 1, 0:2]).norm(dim=-1)
            below = boat[..., BoatColumn.elevation] + 100
            slant = torch.sqrt(
                ((auv[..., AuvColumn.span("x", "y")] - boat[..., BoatColumn.span("x", "y")]) ** 2).sum(-1) + below**2
            )
            expected = torch.stack(
                [
                    w.distance * closed,
                    w.border * auv[..., AuvColumn.border],
                    (w.overflow * tally[:, TallyColumn.overflowing])[:, None].expand(-1, 2),
                    (w.proximity * (12 - apart).clamp_min(0))[:, None].expand(-1, 2),
                    w.service * (auv[..., AuvColumn.service_rate] > 0),
                    w.power * auv[..., AuvColumn.power],
                    w.collaboration * math.hypot(200, 200, 100) / slant,
                    w.data * auv[..., AuvColumn.packets_delivered] * 2e-3,
                    (w.lost * tally[:, TallyColumn.packets_lost] * 1e-3)[:, None].expand(-1, 2),
                ],
                dim=-1,
            )
            torch.testing.assert_close(info["reward_terms"], expected, atol=3e-4, rtol=1e-4)
            torch.testing.assert_close(reward, expected.sum(-1), atol=6e-4, rtol=1e-4)
            losses += expected[..., -1].sum().item()
        assert losses < 0
        assert len(world.reward_names) == expected.shape[-1]

    @pytest.mark.slow
    def test_what_it_rewards(self, extreme):
        """Shuttling between near nodes makes more services and earns less than a tour; circling earns least."""
        scores, services = {}, {}
        for name, targets in (("tour", "tour"), ("shuttle", "greedy:0.1"), ("loiter", "tour")):
            world = World(extreme, num_worlds=32, seed=8, targets=targets)
            observation = world.reset()
            total = served = 0.0
            for _ in range(800):
                action = steer(observation, share=0.75)
                if name == "loiter":
                    offset = observation[..., world.observation_layout.slice("target")] * extreme.area.diagonal
                    distance = offset.norm(dim=-1, keepdim=True)
                    tangent = torch.stack([-offset[..., 1], offset[..., 0]], dim=-1) / distance
                    radial = offset / distance * ((distance - 15) / 10).clamp(-1, 1)
                    action = 0.55 * (tangent + radial) / (tangent + radial).norm(dim=-1, keepdim=True)
                observation, reward, *_ = world.step(action)
                total += reward.sum(dim=1).mean().item()
                served += (world.auv[..., AuvColumn.service_rate] > 0).float().sum(1).mean().item()
            scores[name], services[name] = total / 800, served
        assert services["shuttle"] > 1.5 * services["tour"]
        assert scores["loiter"] < scores["shuttle"] - 0.5
        assert scores["shuttle"] < scores["tour"] - 0.2

    def test_termination_and_truncation(self):
        for name, usv, ends in (("paper-ideal", "hold:100,100", True), ("ideal", None, False)):
            world = World(Scenario.load(name, ["mission.duration=300"]), 16, seed=1, usv=usv)
            observation = world.reset()
            ended = 0
            for step in range(1, 301):
                observation, _, terminated, truncated, _ = world.step(steer(observation))
                served = world.auv[..., AuvColumn.service_rate] > 0
                assert torch.equal(terminated, served if ends else torch.zeros_like(served))
                assert truncated.all() if step == 300 else not truncated.any()
                ended += int(terminated.sum())
            assert (ended > 0) == ends


class TestObservation:
    def test_layout(self):
        vortices = ["current.count=9", "current.circulation_min=120", "current.circulation_max=260"]
        world = World(Scenario.load("ideal", ["auv.count=3", *vortices]), num_worlds=16, seed=1)
        run(world, 40)
        assert world.observation_size == 13
        o, own, diagonal = world.observation, world.own_position, math.hypot(200, 200)
        others = world.estimate[..., EstimateColumn.span("x", "y")]  # as the boat has them
        assert o.shape == (16, 3, 2 * 2 + 6 + 3)
        torch.testing.assert_close(o[:, 1, 0:2], (others[:, 0] - own[:, 1]) / diagonal)
        torch.testing.assert_close(o[:, 1, 2:4], (others[:, 2] - own[:, 1]) / diagonal)
        target = world.auv[:, 1, AuvColumn.target].long()
        node = world.node[torch.arange(16), target, 0:2]
        torch.testing.assert_close(o[:, 1, 4:6], (node - own[:, 1]) / diagonal)
        torch.testing.assert_close(o[:, 1, 6:8], own[:, 1] / diagonal)
        torch.testing.assert_close(o[:, 1, 8], world.auv[:, 1, AuvColumn.border])
        torch.testing.assert_close(o[:, 1, 9], world.tally[:, TallyColumn.overflowing] / 30)
        torch.testing.assert_close(o[..., 10], world.current().norm(dim=-1))
        torch.testing.assert_close(o[..., 11:13], world.current())

    def test_profile(self):
        """The profile is that of nine vortices over the area whose images are 100 km away."""
        only = ["storm.spectrum=none", "sea.irregular_rms=0"]
        alone = ["current.period=100000", "current.decay_depth=0"]
        world = World(Scenario.load("extreme", [*only, *alone]), num_worlds=4, seed=1)
        world.reset()
        world.vortex[..., :2] = 200 * torch.rand((4, 9, 2), generator=torch.Generator().manual_seed(1))
        for _ in range(20):
            world.step(torch.full((4, 2, 2), 0.3))
        target = world.auv[0, 0, AuvColumn.target].long()
        world.auv[0, 0, AuvColumn.span("x", "y")] = world.node[0, target, NodeColumn.span("x", "y")]
        world.auv[0, 0, AuvColumn.hover] = 30.0  # it stays at its target, where the beams point to the east
        o = world.step(torch.zeros(4, 2, 2))[0].double().cpu().numpy()
        assert o.shape == (4, 2, world.observation_size) == (4, 2, 23)
        towards = o[..., world.observation_layout.slice("target")]
        assert (np.linalg.norm(towards, axis=-1) == 0.0).tolist() == [[True, False], *[[False, False]] * 3]
        towards[0, 0] = 1.0, 0.0
        bearing = towards / np.linalg.norm(towards, axis=-1, keepdims=True)
        for point, (reach, turn) in enumerate((reach, turn) for reach in (25.0, 50.0) for turn in (-1.0, 0.0, 1.0)):
            c, s = math.cos(turn), math.sin(turn)
            beam = np.stack((c * bearing[..., 0] - s * bearing[..., 1], s * bearing[..., 0] + c * bearing[..., 1]), -1)
            place = world.auv[..., AuvColumn.span("x", "y")].double().cpu().numpy() + reach * beam
            expected = np.zeros((4, 2, 2))
            for w in range(4):
                for x0, y0, circulation, core in world.vortex[w].double().cpu().numpy():
                    dx, dy = place[w, :, 0] - x0, place[w, :, 1] - y0
                    r2 = dx**2 + dy**2
                    turning = circulation / (2 * math.pi * r2) * (1 - np.exp(-r2 / core**2))
                    expected[w] += np.stack((-turning * dy, turning * dx), -1)
            found = o[..., 11 + 2 * point : 13 + 2 * point]
            np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-4)
