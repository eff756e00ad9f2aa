"""The batched world: random numbers, states, starts and what is refused."""

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from usvauv.env import Scenario, ScenarioError, World
from usvauv.env.record.recorder import record
from usvauv.kernels import runtime
from usvauv.kernels.mission.columns import AuvColumn, BoatColumn, NodeColumn
from usvauv.kernels.mission.worlds import STATE


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
    return {name: getattr(world, name).cpu().numpy().copy() for name in names} | {"total": total.cpu().numpy()}


@pytest.fixture(scope="module")
def extreme():
    return Scenario.load("extreme")


class TestRandomNumbers:
    def test_seeds_of_their_own_go_on_from_a_state_and_with_other_parameters(self):
        """Also across the end of an episode."""
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
            seen = []
            for step in range(6):
                if step == 3:
                    world.reset()
                observation, reward, *_ = world.step(torch.zeros(world.num_worlds, 2, 2))
                seen += [each[-1].flatten().clone() for each in (observation, reward, world.vortex)]
            found.append(torch.cat(seen))
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
            "from tests.usvauv_env.world.test_world import run; from usvauv.env import Scenario, World;"
            "r = run(World(Scenario.load('extreme'), 19, seed=3), 40);"
            "print(hashlib.sha256(b''.join(r[n].tobytes() for n in sorted(r))).hexdigest())"
        )
        digests = {
            subprocess.run(
                [sys.executable, "-c", script, threads],
                capture_output=True,
                text=True,
                check=True,
                cwd=Path(__file__).parents[3],
            ).stdout.splitlines()[-1]
            for threads in ("1", "3")
        }
        assert len(digests) == 1


class TestState:
    def test_rebound_tensors_are_refused(self, extreme):
        """The kernels would go on with the old ones; written in place they count."""
        world = World(extreme, num_worlds=2, seed=1)
        world.reset()
        with pytest.raises(AttributeError, match=r"World\.boat: cannot be rebound"):
            world.boat = world.boat.clone()
        with pytest.raises(AttributeError, match="sea"):
            world.sea = None
        world.boat[..., BoatColumn.x] = 20.0
        world.step(torch.zeros(2, 2, 2))
        assert (world.boat[..., BoatColumn.x] < 30).all()

    def test_parameters_that_may_change_and_one_that_may_not(self):
        world = World(Scenario.load("extreme"), num_worlds=2)
        louder = Scenario.load("extreme", ["acoustics.source_level=190"])
        world.set_parameters(louder)
        assert world.scenario is world.site.scenario is louder
        with pytest.raises(ScenarioError, match=r"^area\.depth = 130\.0: cannot change while worlds run; what may"):
            world.set_parameters(Scenario.load("extreme", ["area.depth=130"]))

    def test_rewind_begins_the_first_episode_again(self, extreme):
        world = World(extreme, num_worlds=3, seed=2)
        first = run(world, 5)
        second = run(world, 5)
        world.rewind()
        again = run(world, 5)
        assert (first["node"] != second["node"]).any()
        assert (first["node"][0] != first["node"][1]).any()
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

    @pytest.mark.parametrize("worlds", [4, 70])  # one after another, and side by side
    def test_what_a_mask_spares_keeps_its_numbers(self, extreme, worlds):
        """Also where arrays are copied to a device, on which another world of the same size has been at work."""
        world, other = (World(extreme, worlds, seed) for seed in (1, 2))
        world.reset()
        world.step(torch.zeros(worlds, 2, 2))
        other.reset()
        spared = torch.arange(worlds, device=world.device) % 2 == 0
        world.observation[spared] = 0.25
        arrays = {name: getattr(world, name) for name in STATE}
        before = {name: array.clone() for name, array in arrays.items() if len(array) == worlds}
        world.reset(~spared)
        for name, array in before.items():
            assert torch.equal(arrays[name][spared], array[spared]), name
        assert (world.node != before["node"]).flatten(1).any(1).equal(~spared)

    @pytest.mark.parametrize(("equations", "edge"), [("linear", "east"), ("linear", "north"), ("nonlinear", "north")])
    def test_long_waves_carry_the_vehicles(self, equations, edge):
        """Without vortices and storm: the solver's own velocity, bilinear between its cells, at AUVs and boat.

        The boat lies on the solver's elevation and its slopes. Waves of 75 s and more are resolved to a thousandth; the
        transports are half a substep (0.04 s) old.
        """
        only = ["current.count=0", "storm.spectrum=none", "sea.realisations=2", "area.length=140"]
        only += [f"sea.equations={equations}", f"sea.forced_edge={edge}", "sea.radiating_edges=[]", "sea.cell_size=4"]
        only += ["sea.forcing=elevation", "sea.irregular_rms=2", "sea.drag=0.002"]
        world = World(Scenario.load("extreme", [*only, "boat.top_speed=1e-3"]), num_worlds=64, seed=2)
        world.reset()
        for _ in range(20):
            world.step(torch.rand(64, 2, 2, generator=torch.Generator().manual_seed(0)))
        fields = np.stack(world.sea.velocity(), axis=-1)
        cells = np.array([world.sea.dx, world.sea.dy])
        boat = world.boat[..., BoatColumn.span("x", "y")].cpu().numpy()
        place = np.concatenate([world.auv[..., AuvColumn.span("x", "y")].cpu().numpy(), boat], axis=1)
        water = world.boat[..., BoatColumn.span("current_x", "current_y")].cpu().numpy()
        found = np.concatenate([world.current().cpu().numpy(), water], axis=1)
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
        found = world.boat[:, 0, BoatColumn.span("elevation", "slope_y")].cpu().numpy()
        assert (np.abs(expected).max(0) > 0).sum() > 1  # waves along an edge have one slope
        np.testing.assert_array_less(np.abs(found - expected).max(0), 0.02 * np.abs(expected).max(0) + 1e-7)


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        *(({"num_worlds": wrong}, "^num_worlds = .*: must be a whole number") for wrong in (0, 2.0, 1 << 23)),
        *(({"first_world": wrong}, "^first_world = .*: must be a whole") for wrong in (-1, 1 << 32, None)),
        ({"usv": 5}, "^usv = 5: must be text"),
        ({"seed": -1}, "seed = -1"),
        ({"num_worlds": 3, "seed": [1, 2]}, "seed: 2 for 3 worlds; must be one for all, or one for each"),
        ({"num_worlds": 2, "seed": [1, 2], "first_world": 3}, "first_world = 3: must be 0"),
        ({"num_worlds": 2, "fine_sea": True}, "exactly one"),
    ],
)
def test_bad_arguments(extreme, arguments, match):
    with pytest.raises(ScenarioError, match=match):
        World(extreme, **arguments)


def test_numbers_of_any_type_count_worlds_and_a_scenario_goes_by_name(extreme):
    one, other = (
        World("extreme", np.int32(1), np.uint64(5), first_world=np.int64(3)),
        World(extreme, 1, 5, first_world=3),
    )
    assert torch.equal(one.reset(), other.reset())


class TestBegin:
    def test_a_step_needs_a_reset_of_all_worlds(self, extreme):
        world, other, still = World(extreme, 2), World(extreme, 2), torch.zeros(2, 2, 2)
        for begin in (lambda: None, world.rewind, lambda: world.load_state(other.state())):
            begin()
            for refused in (lambda: world.step(still), lambda: world.reset([True, False])):
                with pytest.raises(ScenarioError, match="begun: call reset"):
                    refused()
            assert not world.begun
            world.reset(np.array([True, True]))
            world.step(still)
        with pytest.raises(ScenarioError, match=r"^continue_from: in the other world .*: call reset first$"):
            world.continue_from(other)

    @pytest.mark.parametrize(
        "mask",
        [
            *([True], [1, 0], [[True, True]], [None, True]),
            np.ma.masked_array([True, True], [True, False]),
        ],
    )
    def test_a_mask_is_a_bool_for_each_world(self, extreme, mask):
        world = World(extreme, 2)
        world.reset()
        with pytest.raises(ScenarioError, match=r"^mask .*: must be"):
            world.reset(mask)


@pytest.fixture(scope="module")
def coarse():
    return World(Scenario.load("extreme", ["sea.cell_size=20"]), 2, seed=1)


AT_ONCE = pytest.mark.cpu("actions that a step looks at before it begins")


class TestAction:
    """What a step takes in place of a contiguous tensor of float32, and how it refuses the rest."""

    @pytest.mark.parametrize(
        "given",
        [
            lambda action: action.cpu().numpy().astype(np.float64)[::-1][::-1],
            lambda action: action.tolist(),
            lambda action: action.double().requires_grad_(),
            lambda action: action.repeat(1, 1, 2)[..., :2],
            lambda action: action.to(torch.int8),
        ],
    )
    def test_the_same_numbers_are_the_same_step(self, coarse, given):
        action = torch.tensor([1.0, 0.0]).expand(2, 2, 2).contiguous()
        found = []
        for each in (action, given(action)):
            coarse.rewind()
            coarse.reset()
            found.append(coarse.step(each).clone())
        assert torch.equal(found[0].observation, found[1].observation)
        assert torch.equal(found[0].reward, found[1].reward)

    @pytest.mark.parametrize(
        ("action", "said"),
        [
            (np.zeros((1, 2, 2)), r"has shape \(1, 2, 2\): must be \(2, 2, 2\)"),
            ([[1, 2], [3]], "must be real numbers of shape"),
            ("north", "must be real numbers of shape"),
            (np.zeros((2, 2, 2), complex), "must be real numbers"),
            (np.zeros((2, 2, 2), "datetime64[s]"), "must be"),
            (np.full((2, 2, 2), 0.5, object), "must be"),
            (np.ma.masked_array(np.zeros((2, 2, 2)), True), "must be"),
            (torch.zeros(2, 2, 2, device="meta"), "must be"),
            pytest.param(np.full((2, 2, 2), np.nan), "must be finite", marks=AT_ONCE),
            pytest.param(torch.full((2, 2, 2), 1e300, dtype=torch.float64), "must be finite", marks=AT_ONCE),
        ],
    )
    def test_anything_else_is_refused_in_words(self, coarse, action, said):
        coarse.reset()
        with pytest.raises(ScenarioError, match=f"^action.*{said}"):
            coarse.step(action)


@pytest.mark.parametrize(("auvs", "nodes"), [(1, 1), (2, 1), (16, 500)])
def test_other_team_sizes(auvs, nodes):
    sizes = [f"auv.count={auvs}", f"nodes.count={nodes}", "usbl.carriers=[18000]"]  # with which all are compiled alike
    world = World(Scenario.load("extreme", sizes), num_worlds=3)
    state = run(world, 30)
    assert all(np.isfinite(value).all() for value in state.values())
