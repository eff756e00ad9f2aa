"""Vehicles with dynamics in worlds: actions, depth, determinism, what is refused."""

import math

import numpy as np
import pytest
import torch

from usvauv import policies
from usvauv.env import Scenario, ScenarioError, World
from usvauv.env.record.recorder import record
from usvauv.kernels.errors import DivergenceError
from usvauv.kernels.mission.columns import AuvColumn, BodyColumn
from usvauv.kernels.vehicles.fleet import Fleet
from usvauv.kernels.vehicles.vehicle import Body, Command, Surroundings
from usvauv.policies.frames import frames

TORPEDO = ["auv.model=torpedo", "nodes.service=passing", "mission.duration=60"]


def torpedo(worlds: int, seed: int, *overrides: str) -> World:
    """In the storm of `extreme`, 100 m deep; observations have the depth as with fins: one compilation serves all."""
    observed = 'observation.extra=["attitude", "motion", "depth"]'
    place = ["area.depth=120", "auv.depth=100"]
    scenario = Scenario.load("extreme-torpedo", ["mission.duration=60", observed, *place, *overrides])
    return World(scenario, worlds, seed, usv="centroid")


def north_west(world: World) -> torch.Tensor:
    action = torch.zeros(world.num_worlds, world.num_auvs, world.action_size, device=world.device)
    action[..., 0], action[..., 1] = -0.6, 0.6
    return action


@pytest.fixture(scope="module")
def trace():
    world = torpedo(3, 2, "area.width=2000", "area.length=2000", "auv.start_margin=300")
    return record(world, lambda _: north_west(world), "north-west")


def test_it_turns_to_its_course_and_keeps_its_depth(trace):
    heading = trace.auv_attitude[-20:, ..., 0]
    assert np.abs(np.angle(np.exp(1j * (heading - 0.75 * math.pi)))).max() < 0.05
    way = trace.auv_velocity[-20:].mean(axis=0)
    np.testing.assert_allclose(np.arctan2(way[..., 1], way[..., 0]), 0.75 * math.pi, atol=0.05)
    assert np.sqrt(np.mean(np.square(trace.auv_depth[20:] - 100.0))) < 0.5
    assert not trace.auv_touched.any()
    assert trace.power[-1].min() > 15.0


def test_it_moves_as_vehicles_alone_in_the_same_water():
    """Across an eddy: Lamb and Oseen's velocity and gradient, by NumPy, in the vehicles' axes.

    The next one is 100 km away, and waves there are none.
    """
    circulation, core, middle, action = 500.0, 80.0, np.array([300.0, 300.0]), np.array([-0.6, 0.5])
    eddy = [f"current.circulation_{end}={circulation}" for end in ("min", "max")]
    eddy += [f"current.core_radius_{end}={core}" for end in ("min", "max")]
    eddy += ["current.centres=[[300.0, 300.0]]", "current.alternate=false", "current.count=0", "auv.battery=1000"]
    eddy += ["current.period=100000", "current.decay_depth=0", "storm.spectrum=none", "sea.irregular_rms=0"]
    place = ["area.width=600", "area.length=600", "auv.start_margin=200", "auv.depth_noise=0"]
    world = torpedo(3, 5, "auv.vehicle=none", *place, *eddy)
    world.reset()
    auvs = Fleet(world.num_worlds * world.num_auvs)
    begun = world.body.reshape(auvs.count, -1).double().cpu().numpy()
    of_a_step = ("north", "east", "energy", "time", "surfaced", "grounded")
    auvs.set(**{name: begun[:, getattr(BodyColumn, name)] for name in Body.members if name not in of_a_step})
    speed = world.scenario.auv.speed_max * np.linalg.norm(action)
    auvs.set(Command, heading=np.arctan2(*action), speed=speed, depth=100.0, altitude=5.0)
    auvs.set(Surroundings, bed=120.0)
    second = auvs.flight(20, 0.05, commanded=True)
    at = world.auv[..., AuvColumn.span("x", "y")].reshape(-1, 2).double().cpu().numpy()
    for _ in range(30):
        world.step(torch.tensor(action, dtype=torch.float32, device=world.device).expand(3, 2, 2))
        x, y = (at - middle).T
        r2 = x * x + y * y
        left = np.exp(-r2 / core**2)
        f = circulation / (2 * math.pi * r2) * (1 - left)  # velocity (−y, x) f, and its slope over r²
        slope = circulation / (2 * math.pi * r2) * left / core**2 - f / r2
        auvs.set(Surroundings, north=x * f, east=-y * f, depth=auvs.numpy("depth"), nn=2 * x * y * slope)
        auvs.set(Surroundings, ne=f + 2 * x * x * slope, en=-f - 2 * y * y * slope, ee=-2 * x * y * slope)
        auvs.set(**dict.fromkeys(of_a_step, 0.0))
        second()
        at = at + np.stack((auvs.numpy("east"), auvs.numpy("north")), -1)
    assert np.ptp(x * f) > 0.1
    np.testing.assert_allclose(world.auv[..., AuvColumn.span("x", "y")].reshape(-1, 2).cpu(), at, atol=0.01)
    np.testing.assert_allclose(world.body[..., BodyColumn.depth].reshape(-1).cpu(), auvs.numpy("depth"), atol=2e-3)
    np.testing.assert_allclose(world.body[..., BodyColumn.r].reshape(-1).cpu(), auvs.numpy("r"), atol=2e-4)


def test_a_vehicle_with_a_spent_battery_glides_to_rest():
    """Its propeller stops and its fins turn back; drag takes its speed; it says so in a trace, and costs nothing."""
    world = torpedo(2, 3, "auv.battery=0.3")
    trace = record(world, lambda _: north_west(world), "north-west")
    spent = trace.auv_charge == 0
    first = spent.argmax(axis=0)
    assert (first > 3).all()
    assert (first < 50).all()
    assert (trace.power == 0)[1:][spent[:-1]].all()
    energy = (trace.power.sum(axis=0) * world.scenario.mission.step) / 3600
    np.testing.assert_allclose(energy, 0.3, rtol=0.2)
    assert (energy >= 0.3).all()
    np.testing.assert_allclose(trace.auv_fins[-1], 0.0, atol=1e-3)
    speed = np.linalg.norm(trace.auv_velocity, axis=-1)
    assert (speed[-1] < 0.5 * np.take_along_axis(speed, first[None], 0)).all()


def test_the_depth_sensor_errs_and_the_vehicle_follows_it():
    """Errors of the given standard deviation from the first step on; what it takes for its depth stays near 100 m."""
    world, noise = torpedo(32, 6, "auv.depth_noise=2.0"), []
    world.reset()
    for _ in range(60):
        world.step(north_west(world))
        noise.append(world.body[..., BodyColumn.sensor_error].clone())
    for error in (noise[0], noise[-1]):
        assert error.std() == pytest.approx(2.0, rel=0.2)
    off = world.body[..., BodyColumn.depth] - 100.0
    assert off.std() > 0.5
    assert torch.corrcoef(torch.stack((off.ravel(), noise[-1].ravel())))[0, 1] < -0.3


def test_an_action_commands_the_depth():
    world = torpedo(2, 1, "auv.action=vector-depth", "auv.depth_min=80")
    world.reset()
    action = north_west(world)
    action[..., 2] = 0.0  # half way, 90 m
    for _ in range(60):
        world.step(action)
    depth = world.body[..., BodyColumn.depth]
    assert (depth - 90.0).abs().max() < 1.5
    torch.testing.assert_close(world.auv[..., AuvColumn.depth_error], depth - 100.0, atol=1e-4, rtol=0)


def test_fins_turn_it_to_starboard_and_down():
    world = torpedo(2, 1, "auv.action=fins", "auv.variation=0.2")
    world.reset()
    assert world.action_size == 3
    assert len(world.body[..., BodyColumn.mass].unique()) == 4
    action = torch.tensor([0.3, 0.2, 0.7], device=world.device).expand(2, 2, 3)
    for _ in range(8):
        world.step(action)
    assert (world.body[..., BodyColumn.r] > 0.02).all()
    assert (world.auv[..., AuvColumn.depth_error] > 0.5).all()


@pytest.mark.parametrize("step", [0.2, 1.0])
def test_helm_steers_by_fins_to_its_target_at_its_depth_and_speed(step):
    """It is what commands fins where no policy is named, and what a network begins as."""
    world = torpedo(4, 1, "auv.action=fins", f"mission.step={step}", "auv.speed_max=2.5")
    assert policies.default(world.scenario) == "helm"
    policy, frame = policies.load("helm:1.4", world), frames["fins"](world.scenario)
    observation, ahead = world.reset(), []
    for _ in range(round(60 / step)):
        action = policy.act(observation)
        observation = world.step(action).observation
        heading = observation[..., policy.layout.slice("attitude")][..., :2]
        ahead.append((heading * policy.bearing(observation)).sum(-1))
    assert torch.stack(ahead)[-round(30 / step) :].median() > math.cos(0.2)
    assert (world.body[..., BodyColumn.depth] - 100.0).abs().max() < 1.0
    assert world.body[..., BodyColumn.u].cpu() == pytest.approx(1.4, abs=0.1)
    begun = policies.load(frame.start, world).act(observation)
    torch.testing.assert_close(frame.decode(observation, torch.zeros_like(begun)), begun)
    assert (frame.decode(observation, torch.full_like(begun, 0.1)) >= begun).all()


def test_it_stays_in_the_area():
    world = torpedo(4, 3, "mission.duration=200")
    world.reset()
    borders = 0.0
    for _ in range(200):
        world.step(north_west(world))
        borders += world.auv[..., AuvColumn.border].sum().item()
    assert borders < 0.06 * 200 * 8  # commanded into a corner all the time, with currents above 1 m/s


@pytest.mark.parametrize(
    "numbers",
    [("torpedo.roll_damping=5", "auv.variation=0.5"), ("torpedo.cross_drag=3", "auv.variation=0.5"), ("buoyancy=450",)],
)
def test_fast_motion_takes_shorter_substeps(numbers):
    """It keeps its course where substeps of the model's would be unstable, or rises as fast as its drag lets it."""
    world = torpedo(2, 1, *(each if "." in each else f"torpedo.{each}" for each in numbers))
    world.reset()
    for _ in range(60):
        world.step(north_west(world))
    body = world.body[..., BodyColumn.u : BodyColumn.r + 1].abs()
    assert (body < torch.tensor([9.0, 2.0, 2.0, 3.0, 2.0, 2.0], device=world.device)).all()
    world.load_state(world.state())


def test_a_vehicle_faster_than_any_ends_the_run():
    world = torpedo(2, 1, "auv.action=fins", "torpedo.propeller_limit=60")
    rule = r"^world \d at \d+ s: p of the body of AUV \d is \S+: must be from -20 to 20$"
    with pytest.raises(DivergenceError, match=rule):
        record(world, lambda _: torch.ones(2, 2, 3), "full")


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["auv.model=torpedo"], 'nodes.service = "hover": a torpedo cannot hover: must be "passing"'),
        (["auv.model=torpdo"], "torpedo"),
        (["auv.action=fins"], "needs a model with dynamics"),
        (['observation.extra=["attitude"]'], "needs an auv.model with dynamics"),
        ([*TORPEDO, "torpedo.diameter=1.6"], "^extreme: torpedo: length = 1.6: must be above the diameter, 1.6 m$"),
        (
            [*TORPEDO, "torpedo.weight_below=0"],
            r"torpedo: weight_below = 0: the propeller's torque spins the hull: must be at least 0.00\d+ with",
        ),
        (
            [*TORPEDO, "torpedo.rudder_area=5", "auv.variation=0.3"],
            "torpedo: rudder_area = 5: moves too fast for substeps of 1 ms: must be at most 1.[0-9]+ with the other",
        ),
    ],
)
def test_refused(overrides, message):
    with pytest.raises(ScenarioError, match=message):
        Scenario.load("extreme", overrides)
