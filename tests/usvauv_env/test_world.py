"""The batched world: the two promises about random numbers, and the rules of the task step by step."""

import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.links import EVERY_STEP
from usvauv.env import Scenario, ScenarioError, World
from usvauv.env.record.recorder import record
from usvauv.env.sea.build import build_short_waves
from usvauv.env.site.site import Site
from usvauv.kernels import runtime
from usvauv.kernels.flow import airy
from usvauv.kernels.mission.columns import AuvColumn, BoatColumn, EstimateColumn, NodeColumn, TallyColumn
from usvauv.kernels.types import Level


def steer(observation: torch.Tensor, num_auvs: int = 2, share: float = 0.7) -> torch.Tensor:
    """Head for the target at a share of full speed."""
    offset = observation[..., 2 * (num_auvs - 1) : 2 * num_auvs]
    return share * offset / offset.norm(dim=-1, keepdim=True).clamp_min(1e-9)


def run(world: World, steps: int) -> dict[str, np.ndarray]:
    """Everything the world holds after some steps of `steer`, and the sum of rewards."""
    observation = world.reset()
    total = torch.zeros_like(world.reward)
    for _ in range(steps):
        observation, reward, *_ = world.step(steer(observation, world.num_auvs))
        total += reward
    names = ("auv", "node", "vortex", "boat", "estimate", "observation", "reward_terms")
    return {name: getattr(world, name).numpy().copy() for name in names} | {"total": total.numpy()}


@pytest.fixture(scope="module")
def extreme():
    return Scenario.load("extreme")


class TestRandomNumbers:
    def test_a_world_is_the_same_alone_and_in_a_batch(self, extreme):
        together = run(World(extreme, num_worlds=37, seed=5), 60)
        alone = run(World(extreme, num_worlds=1, seed=5, first_world=23), 60)
        for name, value in alone.items():
            np.testing.assert_array_equal(value[0], together[name][23], err_msg=name)

    def test_seeds_of_their_own_go_on_from_a_state_and_with_other_parameters(self):
        scenario, slower = (Scenario.load("extreme", [f"current.circulation_max={value}"]) for value in (260, 150))
        together, again, alone = (World(scenario, np.size(own), own) for own in ([3, 8], [3, 8], 8))
        for world in (together, alone):
            world.reset()
            for _ in range(2):
                world.step(torch.zeros(world.num_worlds, 2, 2))
        again.load_state(together.state())
        found = []
        for world in (together, again, alone):
            world.set_parameters(slower)
            for _ in range(3):
                observation, *_ = world.step(torch.zeros(world.num_worlds, 2, 2))
            found.append(torch.cat([observation[-1].flatten(), world.vortex[-1].flatten()]))
        assert torch.equal(found[0], found[1])
        assert torch.equal(found[0], found[2])

    def test_seeds_of_their_own_have_no_trace_in_common(self, extreme):
        world = World(extreme, 3, [5, 6, 5])
        assert world.seeds.common(slice(1, 2)) == 6
        for chosen in (slice(None), slice(0, 3, 2)):
            with pytest.raises(ScenarioError, match="seed: each world has one of its own; must be one for all"):
                world.seeds.common(chosen)
        with pytest.raises(ScenarioError, match="seed: each world has one of its own"):
            record(world, lambda observation: pytest.fail("a step was made"), "straight")
        assert World(extreme, 3, 5, first_world=2).seed == 5

    @pytest.mark.cpu("number of threads")
    def test_the_same_in_the_calling_thread_and_in_all(self, extreme, monkeypatch):
        worlds = 3 * runtime.ITERATIONS  # more than a thread takes at a time
        alone = run(World(extreme, worlds, seed=3), 40)
        monkeypatch.setattr(runtime, "FEW_TASKS", 0)
        together = run(World(extreme, worlds, seed=3), 40)
        assert all(np.array_equal(alone[name], together[name]) for name in alone)

    @pytest.mark.slow
    @pytest.mark.cpu("number of threads")
    def test_same_for_one_thread_and_three(self):
        script = (
            "import sys, hashlib; from usvauv.kernels import runtime; runtime.FEW_TASKS, runtime.ITERATIONS = 0, 4;"
            "runtime.start('cpu', threads=int(sys.argv[1]));"
            "from tests.usvauv_env.test_world import run; from usvauv.env import Scenario, World;"
            "r = run(World(Scenario.load('extreme'), 19, seed=3), 40);"
            "print(hashlib.sha256(b''.join(r[n].tobytes() for n in sorted(r))).hexdigest())"
        )
        digests = {
            subprocess.run(
                [sys.executable, "-c", script, threads],
                capture_output=True,
                text=True,
                check=True,
                cwd=Path(__file__).parents[2],
            ).stdout.splitlines()[-1]
            for threads in ("1", "3")
        }
        assert len(digests) == 1

    def test_seeds_and_worlds_and_episodes_differ(self, extreme):
        world = World(extreme, num_worlds=3, seed=0)
        world.reset()
        first = world.node.clone()
        world.reset()
        second = world.node.clone()
        world.reset()
        assert not torch.equal(first, second)
        assert not torch.equal(second, world.node)
        assert not torch.equal(first[0], first[1])
        other = World(extreme, num_worlds=3, seed=1)
        other.reset()
        assert not torch.equal(first, other.node)

    def test_high_half_of_the_seed_counts(self, extreme):
        worlds = [World(extreme, 1, seed=seed) for seed in (7, 7 + (1 << 32))]
        for world in worlds:
            world.reset()
        assert not torch.equal(worlds[0].node, worlds[1].node)


class TestState:
    def test_rebound_tensors_are_refused(self, extreme):
        """The kernels would go on with the old ones; written in place they count."""
        world = World(extreme, num_worlds=2, seed=1, usv="hold:90,90")
        world.reset()
        with pytest.raises(AttributeError, match=r"World\.boat: cannot be rebound"):
            world.boat = world.boat.clone()
        with pytest.raises(AttributeError, match="sea"):
            world.sea = None
        world.boat[..., BoatColumn.x] = 20.0
        world.step(torch.zeros(2, 2, 2))
        assert (world.boat[..., BoatColumn.x] < 30).all()

    def test_saved_and_restored_bit_for_bit(self, extreme):
        """Also into another world object, and across the end of an episode."""
        scenario = Scenario.load("extreme", ["mission.duration=40"])
        world = World(scenario, num_worlds=5, seed=2)
        run(world, 40)
        observation = world.reset()
        for _ in range(15):
            observation, *_ = world.step(steer(observation))
        saved = world.state()
        futures = []
        for carrier in (world, world, World(scenario, num_worlds=5, seed=2)):
            carrier.load_state(saved)
            observation, rewards = carrier.observation, []
            for _ in range(40):
                observation, reward, _, truncated, _ = carrier.step(steer(observation))
                rewards.append(reward.clone())
                if truncated.all():
                    observation = carrier.reset()
            futures.append(torch.stack(rewards))
        assert torch.equal(futures[0], futures[1])
        assert torch.equal(futures[0], futures[2])

    def test_parameters_that_may_change_and_one_that_may_not(self):
        world = World(Scenario.load("ideal", EVERY_STEP), num_worlds=2)
        louder = Scenario.load("ideal", [*EVERY_STEP, "acoustics.source_level=150"])
        world.set_parameters(louder)
        assert world.scenario is world.site.scenario is louder
        with pytest.raises(ScenarioError, match=r"^area\.depth = 130\.0: cannot change while worlds run; what may"):
            world.set_parameters(Scenario.load("ideal", [*EVERY_STEP, "area.depth=130"]))

    def test_rewind_begins_the_first_episode_again(self, extreme):
        world = World(extreme, num_worlds=3, seed=2)
        first = run(world, 5)
        second = run(world, 5)
        world.rewind()
        again = run(world, 5)
        assert (first["node"] != second["node"]).any()
        for name, value in first.items():
            np.testing.assert_array_equal(value, again[name], err_msg=name)


class TestStart:
    def test_ranges(self, extreme):
        world = World(extreme, num_worlds=2000, seed=1)
        world.reset()
        xy = world.auv[..., AuvColumn.span("x", "y")]
        assert xy.min() >= 10
        assert xy.max() <= 190
        assert (xy[:, 0] - xy[:, 1]).norm(dim=-1).min() >= 20
        nodes = world.node
        assert nodes[..., NodeColumn.span("x", "y")].min() >= 10
        assert nodes[..., NodeColumn.span("x", "y")].max() <= 190
        assert set(nodes[..., NodeColumn.rate].unique().tolist()) == {3, 5, 8, 12}
        backlog = nodes[..., NodeColumn.backlog]
        assert backlog.min() == 0
        assert backlog.max() == 1000
        # mean of a uniform start within five standard errors
        assert abs(backlog.mean() - 500) < 5 * 1000 / math.sqrt(12 * backlog.numel())

    def test_what_a_mask_spares_keeps_its_numbers(self, extreme):
        """Also where arrays are copied to a device, on which another world of the same size has been at work."""
        world, other = World(extreme, num_worlds=4, seed=1), World(extreme, num_worlds=4, seed=2)
        world.reset()
        other.reset()
        spared = torch.tensor([True, False, True, False], device=world.device)
        world.observation[spared] = 0.25
        world.reset(~spared)
        flow = torch.full((4, 5, 5, 2), 0.25, device=world.device)
        world.current_field(flow, ~spared)
        for values in (world.observation, flow):
            kept = (values == 0.25).flatten(1).all(1)
            assert torch.equal(kept, spared)

    @pytest.mark.parametrize(("equations", "edge"), [("linear", "east"), ("linear", "north"), ("nonlinear", "north")])
    def test_long_waves_carry_the_vehicles(self, equations, edge):
        """Without vortices and storm: the solver's own velocity, bilinear between its cells, at AUVs and boat.

        The boat lies on the solver's elevation and its slopes. Waves of 75 s and more are resolved to a thousandth; the
        transports are half a substep (0.04 s) old.
        """
        only = ["current.count=0", "storm.spectrum=none", "sea.realisations=2", "sea.start_rms=0", "area.length=140"]
        only += [f"sea.equations={equations}", f"sea.forced_edge={edge}"]
        world = World(Scenario.load("extreme", [*only, "boat.top_speed=1e-3"]), num_worlds=64, seed=2)
        world.reset()
        for _ in range(20):
            world.step(torch.rand(64, 2, 2, generator=torch.Generator().manual_seed(0)))
        fields = np.stack(world.sea.velocity(), axis=-1)
        cells = np.array([world.sea.dx, world.sea.dy])
        boat = world.boat[..., BoatColumn.span("x", "y")].numpy()
        place = np.concatenate([world.auv[..., AuvColumn.span("x", "y")].numpy(), boat], axis=1)
        water = world.boat[..., BoatColumn.span("current_x", "current_y")].numpy()
        found = np.concatenate([world.current().numpy(), water], axis=1)
        p = place / cells - 0.5
        low = np.clip(np.floor(p).astype(int), 0, np.array(fields.shape[2:0:-1]) - 2)
        (a, b), (j, i) = np.moveaxis(p - low, -1, 0)[..., None], np.moveaxis(low, -1, 0)
        sea = (np.arange(64) % 2)[:, None]

        def at_places(fields):
            south = (1 - a) * fields[sea, i, j] + a * fields[sea, i, j + 1]
            north = (1 - a) * fields[sea, i + 1, j] + a * fields[sea, i + 1, j + 1]
            return (1 - b) * south + b * north

        expected = at_places(fields)
        assert np.abs(expected).max() > 0.05
        assert np.abs(found - expected).max() < 0.01 * np.abs(expected).max()
        surface = world.sea.elevation()
        slope_y, slope_x = np.gradient(surface, *cells[::-1], axis=(1, 2))
        expected = at_places(np.stack([surface, slope_x, slope_y], -1))[:, -1]
        found = world.boat[:, 0, BoatColumn.span("elevation", "slope_y")].numpy()
        assert (np.abs(expected).max(0) > 0).sum() > 1  # waves along an edge have one slope
        np.testing.assert_array_less(np.abs(found - expected).max(0), 0.02 * np.abs(expected).max(0) + 1e-7)


class TestMotion:
    def test_velocity_through_water_plus_current(self, extreme):
        world = World(extreme, num_worlds=200, seed=4)
        world.reset()
        before = world.auv.clone()
        world.step(torch.full((200, 2, 2), 0.5))
        after = world.auv
        speed = 2.2 * math.sqrt(0.5)
        expected = (
            before[..., AuvColumn.span("x", "y")]
            + speed * torch.tensor([1.0, 1.0]) / math.sqrt(2)
            + before[..., AuvColumn.span("current_x", "current_y")]
        )
        moving = (after[..., AuvColumn.hovering] == 0) & (after[..., AuvColumn.border] == 0)
        assert moving.sum() > 300
        torch.testing.assert_close(after[..., AuvColumn.span("x", "y")][moving], expected[moving], rtol=0, atol=2e-5)

    @pytest.mark.parametrize(
        ("action", "speed"), [((0.1, 0.0), 1.2), ((1.0, 1.0), 2.2), ((0.0, -0.75), 1.65), ((0.0, 0.0), 1.2)]
    )
    def test_speed_stays_in_its_limits(self, extreme, action, speed):
        world = World(extreme, num_worlds=8, seed=4)
        world.reset()
        world.step(torch.tensor(action).expand(8, 2, 2).contiguous())
        water = world.auv[..., AuvColumn.span("water_x", "water_y")].norm(dim=-1)
        travelling = world.auv[..., AuvColumn.hovering] == 0
        torch.testing.assert_close(water[travelling], torch.full_like(water[travelling], speed))

    def test_polar_action(self):
        world = World(Scenario.load("ideal", ["auv.action=polar"]), num_worlds=1, seed=4)
        world.reset()
        world.step(torch.tensor([[[0.5, 0.0], [-1.0, 1.0]]]))
        water = world.auv[0, :, AuvColumn.span("water_x", "water_y")]
        torch.testing.assert_close(water, torch.tensor([[0.0, 1.7], [-2.2, 0.0]]), atol=1e-5, rtol=0)

    def test_a_move_across_the_border_is_refused_and_counted(self):
        world = World(Scenario.load("ideal"), num_worlds=1, seed=0)
        world.reset()
        refused = 0.0
        for _ in range(200):
            world.step(torch.tensor([[[1.0, 0.0], [0.0, 1.0]]]))
            refused += world.measures()[0, :, world.measure_names.index("border")].sum().item()
            position = world.auv[..., AuvColumn.span("x", "y")]
            assert position.min() >= 0
            assert position.max() <= 200
        assert refused > 50

    def test_the_boat_keeps_to_its_top_speed(self):
        scenario = Scenario.load("ideal", ["boat.top_speed=1.5"])
        world = World(scenario, num_worlds=16, seed=0)
        observation = world.reset()
        before = world.boat[:, 0, BoatColumn.span("x", "y")].clone()
        for _ in range(100):
            observation, *_ = world.step(steer(observation))
            moved = (world.boat[:, 0, BoatColumn.span("x", "y")] - before).norm(dim=-1)
            assert moved.max() <= 1.5 + 1e-4
            before = world.boat[:, 0, BoatColumn.span("x", "y")].clone()


def storm_at(world: World, xy: torch.Tensor, level: int) -> torch.Tensor:
    """Storm (η, η_x, η_y, u, v, w) at the point (x, y) of each world; world w sails on sea w."""
    return airy.sample(world.storm.wave, xy[:, None].contiguous(), level)[:, 0]


class TestStorm:
    quiet = (
        "sea.start_rms=0",
        "sea.forced_edge=none",
        "sea.irregular_rms=0",
        "current.circulation_min=0",
        "current.circulation_max=0",
    )

    def test_it_lifts_tilts_and_carries_the_boat(self):
        """Nothing but the storm moves here; the boat drifts with the water of the step before."""
        world = World(Scenario.load("extreme", self.quiet), num_worlds=16, seed=3, usv="hold:60,80")
        run(world, 7)
        before = world.boat[:, 0].clone()
        world.boat[..., BoatColumn.x] = 90.0  # 42 m from where it is to be held
        world.step(torch.zeros(16, 2, 2))
        boat = world.boat[:, 0]
        seen = storm_at(world, boat[:, BoatColumn.span("x", "y")], Level.surface)
        torch.testing.assert_close(boat[:, BoatColumn.span("elevation", "current_y")], seen[:, :5])
        assert seen[:, 0].std() > 0.8
        drift = before[:, BoatColumn.span("current_x", "current_y")]
        moved = boat[:, BoatColumn.span("x", "y")] - torch.stack(
            [torch.full((16,), 90.0), before[:, BoatColumn.y]], dim=1
        )
        torch.testing.assert_close((moved - drift).norm(dim=1), torch.full((16,), 4.0), atol=1e-4, rtol=0)

    def test_surface_shows_the_storm_of_the_world_s_own_sea(self):
        scenario = Scenario.load("extreme", self.quiet)
        world = World(scenario, num_worlds=1, seed=3, first_world=5)
        fine = World(scenario, num_worlds=1, seed=3, first_world=5, fine_sea=True)
        for each in (world, fine):
            run(each, 3)
        pool = build_short_waves(Site(scenario), [(3, sea) for sea in range(16)])
        pool.set_time(3.0)
        for each, cells in ((world, 50), (fine, 128)):
            x = (np.arange(cells) + 0.5) * 200 / cells
            np.testing.assert_allclose(each.surface(cells), pool.elevation(5, x, x), atol=1e-5)

    def test_only_the_seas_that_are_sailed_on_are_solved(self, extreme):
        for worlds, first, seas in ((1, 0, 1), (3, 5, 3), (3, 14, 3), (40, 3, 16)):
            world = World(extreme, worlds, first_world=first)
            assert len(world.storm.k) == seas
            assert world.sea.num_seas == seas

    def test_extreme_is_as_it_says(self, extreme):
        """The numbers of the scenario's description, over whole missions of 256 worlds with all 16 seas.

        (That the long waves' crests are 5 m high stands in `tests/usvauv_env/test_sea.py`.)
        """
        assert "the boat heaves by 2.6 m rms and tilts by more than 14° one step in a hundred" in extreme.description
        assert "currents of 0.3 to 0.7 m/s, one in twenty above 1.15 m/s" in extreme.description
        assert 6 <= extreme.storm.significant_height < 9  # WMO sea state 7
        world = World(extreme, num_worlds=256, seed=2)
        observation = world.reset()
        boat, current = [], []
        for _ in range(world.steps):
            observation, *_ = world.step(steer(observation))
            boat.append(world.boat[:, 0].clone())
            current.append(world.current().norm(dim=-1))
        elevation, slope_x, slope_y = torch.stack(boat)[..., BoatColumn.span("elevation", "slope_y")].unbind(-1)
        assert elevation.square().mean().sqrt() == pytest.approx(2.6, abs=0.15)
        tilt = np.degrees(np.arctan(torch.hypot(slope_x, slope_y).numpy()))
        assert np.quantile(tilt, 0.99) == pytest.approx(14, abs=0.7)
        low, high, strong = np.quantile(torch.stack(current).numpy(), [0.25, 0.75, 0.95])
        assert (low, high, strong) == pytest.approx((0.3, 0.7, 1.15), abs=0.06)


class TestTask:
    def test_node_is_hovered_over_emptied_and_counted(self):
        """Hovering lasts payload · b/C ÷ rate; then, where nothing arrives, the buffer is empty, the rate counted."""
        scenario = Scenario.load("ideal", ["auv.count=1", "nodes.count=2", "nodes.arrival_rates=[0]"])
        world = World(scenario, num_worlds=64, seed=3)
        observation = world.reset()
        hovered = torch.zeros(64)
        done = torch.zeros(64, dtype=torch.bool)
        for _ in range(400):
            target = world.auv[:, 0, AuvColumn.target].long()
            backlog = world.node[torch.arange(64), target, NodeColumn.backlog].clone()
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

    def test_rate_at_a_hundred_metres(self):
        """Shannon's rate over 10 kHz at 20 kHz and 100 m, from the sonar equation written out by hand."""
        scenario = Scenario.load("ideal", [*EVERY_STEP, "area.depth=200", "auv.count=1"])
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

    def test_targets_are_shared_by_no_two_auvs(self, extreme):
        world = World(Scenario.load("extreme", ["auv.count=6"]), num_worlds=32, seed=3)
        observation = world.reset()
        for _ in range(150):
            observation, *_ = world.step(steer(observation, 6))
            for targets in world.auv[..., AuvColumn.target].tolist():
                assert len(set(targets)) == 6

    def test_target_rule(self):
        world = World(Scenario.load("ideal"), num_worlds=64, seed=3, targets="greedy:0.015")
        world.reset()
        node, fix = world.node, world.estimate[:, 0, 0:2]
        distance = (node[..., NodeColumn.span("x", "y")] - fix[:, None]).norm(dim=-1)
        value = node[..., NodeColumn.rate] * node[..., NodeColumn.backlog] / 5000 - 0.015 * distance
        assert torch.equal(world.auv[:, 0, AuvColumn.target].long(), value.argmax(dim=1))


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
        for name, ends in (("paper-ideal", True), ("ideal", False)):
            world = World(Scenario.load(name, ["mission.duration=300"]), num_worlds=16, seed=1)
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
        scenario = Scenario.load("extreme", ["auv.count=3", "observation.current=vector"])
        world = World(scenario, num_worlds=16, seed=1)
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
        only = ["storm.spectrum=none", "sea.irregular_rms=0", "observation.current=profile"]
        scenario = Scenario.load("extreme", only)
        world = World(scenario, num_worlds=4, seed=1)
        run(world, 20)
        target = world.auv[0, 0, AuvColumn.target].long()
        world.auv[0, 0, AuvColumn.span("x", "y")] = world.node[0, target, NodeColumn.span("x", "y")]
        world.auv[0, 0, AuvColumn.hover] = 30.0  # it stays at its target, where the beams point to the east
        o = world.step(torch.zeros(4, 2, 2))[0].double().numpy()
        assert o.shape == (4, 2, world.observation_size) == (4, 2, 23)
        towards = o[..., world.observation_layout.slice("target")]
        assert (np.linalg.norm(towards, axis=-1) == 0.0).tolist() == [[True, False], *[[False, False]] * 3]
        towards[0, 0] = 1.0, 0.0
        bearing = towards / np.linalg.norm(towards, axis=-1, keepdims=True)
        for point, (reach, turn) in enumerate((reach, turn) for reach in (25.0, 50.0) for turn in (-1.0, 0.0, 1.0)):
            c, s = math.cos(turn), math.sin(turn)
            beam = np.stack((c * bearing[..., 0] - s * bearing[..., 1], s * bearing[..., 0] + c * bearing[..., 1]), -1)
            place = world.auv[..., AuvColumn.span("x", "y")].double().numpy() + reach * beam
            expected = np.zeros((4, 2, 2))
            for w in range(4):
                for x0, y0, circulation, core in world.vortex[w].double().numpy():
                    dx, dy = place[w, :, 0] - x0, place[w, :, 1] - y0
                    r2 = dx**2 + dy**2
                    turning = circulation / (2 * math.pi * r2) * (1 - np.exp(-r2 / core**2))
                    expected[w] += np.stack((-turning * dy, turning * dx), -1)
            found = o[..., 11 + 2 * point : 13 + 2 * point]
            np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"num_worlds": 0}, "num_worlds = 0"),
        ({"seed": -1}, "seed = -1"),
        ({"num_worlds": 3, "seed": [1, 2]}, "seed: 2 for 3 worlds; must be one for all, or one for each"),
        ({"num_worlds": 2, "seed": [1, 2.0]}, r"seed = 2\.0: must be a whole number"),
        ({"num_worlds": 2, "seed": [1, 2], "first_world": 3}, "first_world = 3: must be 0"),
        ({"num_worlds": 2, "seed": [1, 2], "batch": 4}, "seed: 2 for 4 worlds"),
        ({"usv": "hold:300,0"}, "area"),
        ({"usv": "hold:1"}, "hold:X,Y"),
        ({"usv": "circle"}, "allowed are fim"),
        ({"num_worlds": 2, "fine_sea": True}, "exactly one"),
    ],
)
def test_bad_arguments(extreme, arguments, match):
    with pytest.raises(ScenarioError, match=match):
        World(extreme, **arguments)


@pytest.mark.parametrize(("auvs", "nodes"), [(1, 1), (2, 1), (16, 500)])
def test_other_team_sizes(auvs, nodes):
    world = World(Scenario.load("extreme", [f"auv.count={auvs}", f"nodes.count={nodes}"]), num_worlds=3)
    state = run(world, 30)
    assert all(np.isfinite(value).all() for value in state.values())


@pytest.mark.slow
def test_memory_is_flat_over_a_million_steps(extreme):
    """A thousand episodes of a thousand steps: what the process holds does not grow."""

    def resident():
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGESIZE")

    if not Path("/proc/self/statm").exists():
        pytest.skip("no /proc here")
    world, still = World(extreme, 1, seed=1), torch.zeros(1, 2, 2)
    sizes = []
    for episode in range(1000):
        world.reset()
        for _ in range(world.steps):
            world.step(still)
        if episode % 100 == 99:
            sizes.append(resident())
    assert sizes[-1] - sizes[0] < 2e6
