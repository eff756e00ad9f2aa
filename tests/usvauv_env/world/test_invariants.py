"""What holds in every world at every step, whatever is done in it, and that no world depends on those beside it."""

import math
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.links import EVERY_STEP
from tests.slowly import slowly
from usvauv.env import Scenario, World, plugins
from usvauv.kernels import runtime
from usvauv.kernels.mission.columns import AuvColumn, BoatColumn, EstimateColumn, NodeColumn
from usvauv.kernels.mission.worlds import STATE

PLUGIN = Path(__file__).parents[3] / "examples" / "plugins" / "task.py"
RACE = ["current.circulation_min=400", "current.circulation_max=800"]
RACE += ["current.core_radius_min=40", "current.core_radius_max=40"]
CASES = {
    "extreme": ("extreme", ["nodes.start_backlog=5000"], "fim"),
    "in a strong current": ("extreme", ["auv.count=4", *RACE], "fim"),
    "paper-extreme": ("paper-extreme", [], "hold:100,100"),
    "station-keeping": ("station-keeping", [], "fim"),
}


def wild(world: World, generator: torch.Generator) -> torch.Tensor:
    """Actions anywhere in their range, a third of them at its corners."""
    action = 2 * torch.rand((world.num_worlds, world.num_auvs, 2), generator=generator) - 1
    corner = torch.rand((world.num_worlds, world.num_auvs, 1), generator=generator) < 0.3
    return torch.where(corner, action.sign(), action).to(world.device)


def assert_sound(world: World, current: torch.Tensor) -> None:
    """Everything that must hold after any step, in a current (W, K, 2) at its beginning, m/s."""
    scenario = world.scenario
    width, length = scenario.area.width, scenario.area.length
    for name in (*STATE, "reward", "reward_terms"):
        assert torch.isfinite(getattr(world, name)).all(), name

    def of(column: int) -> torch.Tensor:
        return world.auv[..., column]

    for table, x, y in (
        (world.auv, AuvColumn.x, AuvColumn.y),
        (world.boat, BoatColumn.x, BoatColumn.y),
        (world.boat, BoatColumn.goal_x, BoatColumn.goal_y),
        (world.node, NodeColumn.x, NodeColumn.y),
    ):
        assert table[..., x].min() >= 0
        assert table[..., x].max() <= width
        assert table[..., y].min() >= 0
        assert table[..., y].max() <= length
    travelling = of(AuvColumn.hovering) == 0
    hotel, hovering = (scenario.auv.hotel, scenario.auv.hotel) if scenario.auv.drag else (15, 105)  # the paper's, W
    assert of(AuvColumn.power).min() >= hotel
    assert (of(AuvColumn.power)[~travelling] >= hovering).all()
    assert (of(AuvColumn.power)[of(AuvColumn.border) == 1] >= hovering).all()
    travelling &= of(AuvColumn.border) == 0
    speed = torch.hypot(of(AuvColumn.water_x), of(AuvColumn.water_y))[travelling]
    if not scenario.auv.speed_lag:
        assert (speed >= scenario.auv.speed_min * (1 - 1e-5)).all()
    assert (speed <= scenario.auv.speed_max * (1 + 1e-5) + 7 * scenario.auv.speed_noise).all()
    for name in ("hover", "service_rate", "delivered", "cargo", "position_error"):
        assert of(getattr(AuvColumn, name)).min() >= 0, name
    assert set(of(AuvColumn.border).unique().tolist()) <= {0.0, 1.0}
    moved = torch.hypot(of(AuvColumn.moved_x), of(AuvColumn.moved_y))
    left = (current.norm(dim=-1) - scenario.auv.speed_max).clamp(min=0) * scenario.mission.step
    assert ((moved - left)[of(AuvColumn.border) == 1] <= 1e-4).all()
    target = of(AuvColumn.target)
    assert (target == target.round()).all()
    assert target.min() >= 0
    assert target.max() < scenario.targets
    backlog = world.node[..., NodeColumn.backlog]
    assert backlog.min() >= 0
    assert backlog.max() <= scenario.nodes.buffer
    for table, columns in ((world.auv, AuvColumn), (world.estimate, EstimateColumn)):
        xx, xy, yy = (table[..., getattr(columns, f"covariance_{name}")].double() for name in ("xx", "xy", "yy"))
        assert (xx >= 0).all()
        assert (yy >= 0).all()
        assert (xy * xy <= xx * yy * (1 + 1e-4) + 1e-12).all()
    travelled = torch.hypot(world.boat[..., BoatColumn.moved_x], world.boat[..., BoatColumn.moved_y])
    assert travelled.max() < math.hypot(width, length)


@pytest.mark.parametrize("case", CASES)
def test_holds_whatever_is_done(case):
    name, changes, usv = CASES[case]
    world = World(Scenario.load(name, changes), num_worlds=100, seed=1, usv=usv)
    generator = torch.Generator().manual_seed(1)
    world.reset()
    refused = 0
    for step in range(60):
        current = world.current().clone()
        world.step(wild(world, generator))
        assert_sound(world, current)
        refused += int(world.auv[..., AuvColumn.border].sum())
        if step % 20 == 19:
            world.reset(torch.rand(100, generator=generator) < 0.2)
    assert refused > 0


@pytest.fixture
def _plugin(own_registries):
    """The plugin's task, gone after the test."""
    plugins.load(PLUGIN)


ALONE = {
    "losses": ("extreme", ["auv.count=4", "usbl.packet_loss=0.2"], "fim"),
    "nonlinear": ("extreme", ["sea.equations=nonlinear", "sea.radiating_edges=['west']"], "fim"),
    "station-keeping": ("station-keeping", ["auv.count=5"], "fim"),
    "plugin": ("extreme", [*EVERY_STEP, "task=survey"], "hold:0,200"),
    "torpedo": ("extreme-torpedo", ["auv.action=fins"], "centroid"),
}
SEEDS = (4, (1 << 64) - 1, 4 + (1 << 32), 4)


@pytest.mark.usefixtures("_plugin")
@pytest.mark.parametrize("case", slowly(ALONE, "plugin", "torpedo"))
def test_alone_as_in_a_batch(case):
    """World 9 has the same bits in another batch, where others are reset in between, and alone and brought back.

    Worlds 9 and 2 share a sea; the batch that begins at 5 goes round the end of the pool of 7 seas.
    """
    name, changes, usv = ALONE[case]
    scenario = Scenario.load(name, [*changes, "sea.realisations=7"])
    found = []
    for first, count in ((0, 12), (5, 6), (9, 1)):
        world = World(scenario, num_worlds=count, seed=4, usv=usv, first_world=first)
        own = 9 - first
        shape = 25, 12, world.num_auvs, world.action_size
        actions = 2 * torch.rand(shape, generator=torch.Generator().manual_seed(5)) - 1
        history = [world.reset()[own].clone()]
        for step, action in enumerate(actions[:, first : first + count]):
            if step == 12:
                world.reset(torch.arange(count) != own)
                if count == 1:
                    state = world.state()
                    world.step(-action)
                    world.load_state(state)
            observation, reward, *_, info = world.step(action)
            history += [observation[own].clone(), reward[own].clone(), info["measures"][own].clone()]
        history += [getattr(world, each)[own].clone() for each in ("auv", "node", "boat", "estimate")]
        found.append(history)
    for other in found[1:]:
        for one, same in zip(found[0], other, strict=True):
            assert torch.equal(one, same)


MANY = {
    "extreme": ("extreme", ["auv.count=5", "usbl.packet_loss=0.2"], None),
    "two boats": ("wide", ["boat.count=2", "channel.schedule=turns"], None),
    "torpedo": ALONE["torpedo"],
    "Otter and torpedoes": ("wide-torpedo", ["boat.model=otter", "boat.vessel=otter", "auv.count=9"], None),
    "paper": ("paper-extreme", [], None),
    "greedy": ("extreme", ["planner.objective=a"], "fim-greedy"),
    "plugins": ("extreme", ["observation.extra=['backlog']", "nodes.target_rule=oldest"], "above:1"),
}


@pytest.mark.cpu("many worlds side by side")
@pytest.mark.parametrize("case", slowly(MANY, "extreme", "greedy", "two boats", "paper", "Otter and torpedoes"))
@pytest.mark.usefixtures("own_registries")
def test_alone_as_among_many(case, monkeypatch):
    """So many worlds that several are side by side in vectors: the first, one between and the last have equal bits."""
    name, changes, usv = MANY[case]
    for part in ("observation_term", "target_rule", "boat_strategy") if case == "plugins" else ():
        plugins.load(PLUGIN.with_stem(part))
    scenario = Scenario.load(name, [*changes, "sea.realisations=8"])
    with monkeypatch.context() as patch:
        patch.setattr(runtime, "FEW_TASKS", 0)
        many = World(scenario, 301, seed=3, usv=usv)
    alone = {own: World(scenario, 1, seed=3, first_world=own, usv=usv) for own in (0, 9, 300)}
    for world in (many, *alone.values()):
        world.reset()
    generator = torch.Generator().manual_seed(1)
    for _ in range(25):
        action = 2 * torch.rand((301, many.num_auvs, many.action_size), generator=generator) - 1
        many.step(action)
        for own, world in alone.items():
            world.step(action[own : own + 1])
            for each in ("auv", "estimate", "exchange", "track", "own", "boat", "node", "observation", "reward"):
                among, by_itself = getattr(many, each), getattr(world, each)
                assert len(among) == 1 or torch.equal(among[own], by_itself[0]), each  # 1 where it is not used


@pytest.mark.parametrize("case", slowly(["losses", "torpedo"], "torpedo"))
def test_each_with_a_seed_of_its_own_as_alone(case):
    """Two episodes of worlds of different seeds, two of them of the same one: the bits of each seed's world 0."""
    name, changes, usv = ALONE[case]
    scenario = Scenario.load(name, [*changes, "mission.duration=12"])

    def history(world: World) -> list[torch.Tensor]:
        states, generator = [], torch.Generator().manual_seed(5)
        for _ in range(2):
            states.append(world.reset().clone())
            for _ in range(world.steps):
                action = 2 * torch.rand((1, world.num_auvs, world.action_size), generator=generator) - 1
                observation, reward, *_, info = world.step(action.expand(world.num_worlds, -1, -1))
                states += [observation.clone(), reward.clone(), info["measures"].clone()]
            states += [getattr(world, each).clone() for each in ("auv", "node", "boat", "estimate", "vortex")]
        return states

    together = World(scenario, len(SEEDS), SEEDS, usv)
    assert len(together.storm.k) == len(set(SEEDS))
    states = history(together)
    for own, seed in enumerate(SEEDS[:-1]):
        for one, same in zip(states, history(World(scenario, 1, seed, usv)), strict=True):
            np.testing.assert_array_equal(one[own], same[0])
    for state in states:
        np.testing.assert_array_equal(state[0], state[3])
    assert not (states[0][0] == states[0][1]).all()
    assert not (states[0][0] == states[0][2]).all()
