"""States that cannot be: found while a world runs, and refused when one is loaded."""

import math

import numpy as np
import pytest
import torch

from usvauv.env import Scenario, ScenarioError, World
from usvauv.env.sea.simulation import SeaSimulation
from usvauv.kernels import runtime
from usvauv.kernels.errors import DivergenceError
from usvauv.kernels.mission.columns import AuvColumn, BoatColumn

WORLDS = 4


def until_seen(step):
    """One step; on a graphics card two, because what one wrote is looked at in the next."""
    for _ in range(1 if runtime.start().on_cpu else 2):
        step()
        runtime.synchronize()


@pytest.fixture
def world():
    at_once = ["auv.speed_lag=0", "auv.speed_noise=0"]
    world = World(Scenario.load("extreme", at_once), WORLDS, 0, first_world=10)
    world.reset()
    world.step(torch.zeros(WORLDS, 2, 2))
    return world


@pytest.mark.parametrize(
    ("array", "value"),
    [("auv", math.nan), ("node", math.inf), ("vortex", math.nan)],
)
def test_a_state_that_is_not_finite_stops_the_step(world, array, value):
    """Wherever it is; the message names the world, the quantity and the time."""
    column = {"auv": AuvColumn.x, "node": 2, "vortex": 3}.get(array, 0)
    values = getattr(world, array)
    values.view(WORLDS, -1)[2, column] = value
    with pytest.raises(DivergenceError, match=r"^world 12 at [23] s: \S.* is (nan|inf|-inf|1e\+\d+)[^\n]*$"):
        until_seen(lambda: world.step(torch.zeros(WORLDS, 2, 2)))


@pytest.mark.parametrize(("column", "bound"), [("arm_ahead", 1e3), ("mounting_roll", -7.0)])
def test_a_step_ends_at_what_a_state_is_refused_for(world, column, bound):
    """At the bound itself neither does."""
    number = BoatColumn.names.index(column)
    world.boat[2, 0, number] = bound
    world.load_state(world.state())
    until_seen(lambda: world.step(torch.zeros(WORLDS, 2, 2)))
    world.boat[2, 0, number] = np.nextafter(np.float32(bound), np.float32(2 * bound)).item()
    rule = rf"world {{}}: {column} of boat 0 is \S+: must be from \S+ to \S+$"
    with pytest.raises(ScenarioError, match=rule.format(2)):
        world.load_state(world.state())
    with pytest.raises(DivergenceError, match=rule.format(r"12 at \d s")):
        until_seen(lambda: world.step(torch.zeros(WORLDS, 2, 2)))


@pytest.mark.cpu("many worlds side by side")
def test_a_state_among_many_is_looked_at(monkeypatch):
    """The first world, one at the end of those that step together, and the last; the end of an array too."""
    with monkeypatch.context() as patch:
        patch.setattr(runtime, "FEW_TASKS", 0)
        many = World(Scenario.load("extreme", ["sea.realisations=4"]), 301)
    many.reset()
    for own in (0, 31, 300):
        for array, value in (("node", 2.0), ("vortex", -1.0), ("belief", -1.0), ("track", math.nan)):
            getattr(many, array).view(301, -1)[own, -1] = value
            with pytest.raises(DivergenceError, match=rf"^world {own} at 1 s: "):
                many.step(torch.zeros(301, 2, 2))
            many.reset()
    many.step(torch.zeros(301, 2, 2))


@pytest.mark.parametrize("value", [500.0, -500.0])
def test_a_sea_that_runs_away_stops_the_step(world, value):
    world.sea.eta[0, 5] = value
    rule = r"^sea of world 1\d: the elevation is \S+ m at [23] s: must be within 120 m$"
    with pytest.raises(DivergenceError, match=rule):
        until_seen(lambda: world.step(torch.zeros(WORLDS, 2, 2)))


@pytest.mark.parametrize("equations", ["linear", "nonlinear"])
def test_a_sea_that_runs_away_names_the_worlds_on_it(equations):
    """World 10 + i sails on sea i modulo 2."""
    changes = [f"sea.equations={equations}", "sea.realisations=2", "sea.cell_size=20"]
    world = World(Scenario.load("extreme", changes), WORLDS, 0, first_world=10)
    world.reset()
    state = world.state()
    fields = state["sea"].clone()
    if equations == "linear":  # seas lie side by side along the last axis
        fields[..., 1] = math.nan
    else:
        fields[1] = math.nan
    world.sea.load_state(fields, state["sea_clock"])
    with pytest.raises(DivergenceError, match=r"^sea of worlds 11, 13: "):
        until_seen(lambda: world.step(torch.zeros(WORLDS, 2, 2)))


@pytest.mark.parametrize("equations", ["linear", "nonlinear"])
def test_a_sea_alone_that_runs_away_stops(equations):
    sea = SeaSimulation(Scenario.load("extreme", [f"sea.equations={equations}"]), 0, (20, 20), 1.0)
    sea.advance()
    fields, clock = sea.long_waves.state()
    sea.long_waves.load_state(fields * math.nan, clock)
    with pytest.raises(DivergenceError, match=r"^the sea: [^\n]* s[^\n]*$"):
        until_seen(sea.advance)


@pytest.mark.parametrize("array", ["auv", "belief", "sea"])
def test_all_worlds_begin_anew_after_a_divergence(world, array):
    """Worlds begin anew whether they diverged or not."""
    other = World(world.scenario, WORLDS, 0, first_world=10)
    other.reset()
    (world.sea.eta if array == "sea" else getattr(world, array))[...] = math.nan
    with pytest.raises(DivergenceError):
        until_seen(lambda: world.step(torch.zeros(WORLDS, 2, 2)))
    world.reset()
    other.reset()
    for _ in range(2):
        assert torch.equal(*(each.step(torch.zeros(WORLDS, 2, 2)).observation for each in (world, other)))
    assert all(torch.equal(value, other.state()[name]) for name, value in world.state().items())


def test_a_world_that_diverged_begins_anew_alone(world):
    world.auv[2] = math.nan
    with pytest.raises(DivergenceError):
        until_seen(lambda: world.step(torch.zeros(WORLDS, 2, 2)))
    with pytest.raises(DivergenceError, match=r"^world 12 at .*"):
        until_seen(lambda: world.reset(torch.arange(WORLDS) == 1))
    world.reset(torch.arange(WORLDS) == 2)
    world.step(torch.zeros(WORLDS, 2, 2))


@pytest.mark.cpu("actions that a step looks at before it begins")
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_an_action_that_is_not_finite_changes_nothing(world, value):
    before = world.state()
    action = torch.zeros(WORLDS, 2, 2)
    action[3, 1, 0] = value
    with pytest.raises(ValueError, match="finite"):
        world.step(action)
    assert all(torch.equal(value, before[name]) for name, value in world.state().items())


def test_an_action_beyond_its_bounds_is_the_nearest_in_its_direction(world):
    """Also where its square overflows single precision."""
    world.step(torch.tensor([3e30, 4e30]).expand(WORLDS, 2, 2))
    velocity = world.auv[..., AuvColumn.water_x : AuvColumn.water_y + 1]
    travelling = world.auv[..., AuvColumn.hovering] == 0
    expected = torch.tensor([0.6, 0.8], device=world.device) * world.scenario.auv.speed_max
    torch.testing.assert_close(velocity[travelling], expected.expand_as(velocity[travelling]))


@pytest.mark.parametrize("name", ["auv", "vortex", "clock", "sea"])
def test_what_a_state_is_refused_for(world, name):
    """Wrong numbers, shapes, types and names; nothing is changed by a refusal, and the state itself is taken."""
    state = world.state()
    for wrong in (
        {**state, name: state[name].double() * math.nan} if state[name].is_floating_point() else {},
        {**state, name: state[name].flatten()[1:]},
        {**state, name: torch.full_like(state[name], -(2**31) if name in ("clock", "sea_episode") else 1e30)},
        {key: value for key, value in state.items() if key != name},
        {**state, f"{name}s": state[name]},
        {**state, name: state[name].tolist()},
    ):
        with pytest.raises(ScenarioError, match=r"^state of the world: [^\n]+$"):
            world.load_state(wrong)
    assert all(torch.equal(value, state[key]) for key, value in world.state().items())
    world.load_state({key: value.requires_grad_(value.is_floating_point()) for key, value in state.items()})
    assert not any(value.requires_grad for value in world.state().values())


@pytest.mark.parametrize("value", [-1.0, 30.0, 0.5])
def test_a_target_that_is_no_node_is_refused(world, value):
    state = world.state()
    state["auv"][0, 0, AuvColumn.target] = value
    rule = r"^state of the world: world 0: target of AUV 0 is \S+: must be a whole number from 0 to 29$"
    with pytest.raises(ScenarioError, match=rule):
        world.load_state(state)


@pytest.mark.parametrize(("name", "count"), [("extreme", WORLDS), pytest.param("wide", 64, marks=pytest.mark.slow)])
def test_every_run_stays_within_the_ranges_of_its_state(name, count):
    """The ranges are no narrower than what happens."""
    world = World(Scenario.load(name), count, 0)
    world.reset()
    rng = np.random.default_rng(0)
    for _ in range(60):
        action = rng.uniform(-1, 1, (count, world.num_auvs, 2)).astype(np.float32)
        world.step(torch.from_numpy(action))
        world.load_state(world.state())


@pytest.mark.parametrize(("step", "interval"), [(1.0, 1.5), (0.1, 0.3), (0.7, 0.25)])
def test_the_sea_keeps_time_whatever_its_interval(step, interval):
    """Its last update is no earlier than the mission's time, and by less than an interval later."""
    changes = [f"mission.step={step}", f"sea.update_interval={interval}", "sea.cell_size=20"]
    world = World(Scenario.load("extreme", changes), 1, 0)
    world.reset()
    for done in range(1, 31):
        world.step(torch.zeros(1, 2, 2))
        assert -1e-4 < world.sea.time - done * step < interval
