"""Boats with dynamics in worlds: about their goals, under actions, as planners reckon, with their array and trace."""

import math

import numpy as np
import pytest
import torch

from tests.usvauv_env.world.boats.test_boat_motion import PLACE, sailed
from usvauv.env import Scenario, ScenarioError, World
from usvauv.env.record.recorder import record
from usvauv.env.scenario.team import Otter
from usvauv.env.world.boat_speed import top_speed
from usvauv.kernels.errors import DivergenceError
from usvauv.kernels.mission.columns import AuvColumn, BoatColumn, EstimateColumn
from usvauv.kernels.vehicles import otter_numbers
from usvauv.kernels.vehicles.otter import HullColumn

SECTIONS = {
    "area": {"width": 1000, "length": 1000},
    "boat": {"model": "otter", "top_speed": 2, "dead_band": 4},
    "auv": {"count": 1},
    "usbl": {},
}


def world_of(usv, num_worlds, **sections):
    merged = {name: SECTIONS.get(name, {}) | sections.get(name, {}) for name in SECTIONS | sections}
    world = World(Scenario.from_dict({"task": "station-keeping", **merged}), num_worlds, 4, usv)
    world.reset()
    world.boat[..., PLACE] = 500.0
    return world


@pytest.mark.parametrize(("current", "wind"), [((0.0, 0.0), 0.0), ((0.3, -0.2), 0.0), ((0.2, 0.3), 12.0)])
def test_it_arrives_without_overshoot_and_stays_within_the_dead_band(current, wind):
    """From all sides, with the bow to the north."""
    world = world_of("hold:500,500", 8, acoustics={"wind": wind}, storm={"direction": 2.0})
    way = np.stack([np.cos(np.arange(8) * math.pi / 4), np.sin(np.arange(8) * math.pi / 4)], -1)
    world.boat[:, 0, PLACE] = torch.from_numpy(500 + 80 * way).float()
    places = sailed(world, 240, current) - 500
    left = (places * way).sum(-1)
    assert left.min() > -6
    assert np.linalg.norm(places[-60:], axis=-1).max() < 5
    assert np.abs(np.diff(places[-60:], axis=0)).max() < 0.1  # no cycle about it


@pytest.mark.parametrize("name", ["damping_surge", "damping_sway", "damping_yaw", "damping_turn", "length"])
def test_however_fast_it_is_damped_it_goes_no_faster(name):
    most = next(allowed.le for allowed in Otter.model_fields[name].metadata if hasattr(allowed, "le"))
    world = world_of("hold:900,500", 1, otter={name: most})
    places = sailed(world, 20, (0.0, 0.0))
    assert np.linalg.norm(np.diff(places, axis=0), axis=-1).max() < 2.1


@pytest.mark.parametrize("numbers", [{"lateral_area": 50}, {"lateral_area": 20}, {"added_sway": 5000}])
def test_whatever_the_wind_does_to_it_it_is_slower_than_the_wind(numbers):
    world = world_of("hold:900,500", 2, otter=numbers, acoustics={"wind": 30})
    sailed(world, 40, (0.0, 0.0))
    u, v = world.hull[..., HullColumn.span("u", "v")].abs().amax(dim=(0, 1)).tolist()
    assert u < 6
    assert 0 < v < 15
    world.load_state(world.state())


def test_a_boat_that_goes_faster_than_any_ends_the_run():
    """Against such damping it turns by one propeller at full thrust. The message names it, not an AUV."""
    world = world_of("hold:900,100", 2, otter={"most_ahead": 1000, "damping_yaw": 10000})
    with pytest.raises(DivergenceError, match=r"^world \d at \d+ s: \w+ of the hull of boat 0 is \S+: must be from "):
        sailed(world, 60)


def test_a_boat_too_fast_for_any_substep_is_refused():
    """In a gale; the message names a number of several, and what is allowed beside the others."""
    numbers = {"wind_yaw": 1, "lateral_area": 50, "added_yaw": 0, "inertia": 1, "centre": 0}
    rule = r"^otter: \w+ = \S+: moves too fast for substeps of 0.5 ms in a wind of 40 m/s: must be at (le|mo)[^\n]+$"
    world_of("hold:900,100", 1, otter=numbers, acoustics={"wind": 2})
    with pytest.raises(ScenarioError, match=rule):
        world_of("hold:900,100", 1, otter=numbers, acoustics={"wind": 40})


def test_a_uniform_current_is_a_moving_frame():
    """Adrift in a current c and a wind w as in still water and a wind w − c, carried besides by c."""
    current, wind = np.array([0.4, -0.3]), 9.0 * np.array([math.cos(2.0), math.sin(2.0)])
    ends = []
    for flow, blowing in ((current, wind), (np.zeros(2), wind - current)):
        world = world_of(
            "hold:500,500",
            1,
            boat={"top_speed": 1e-4},
            acoustics={"wind": float(np.linalg.norm(blowing))},
            storm={"direction": math.atan2(blowing[1], blowing[0])},
        )
        world.hull[0, 0, : HullColumn.r + 1] = torch.tensor([0.4, 1.2, -0.3, 0.2])
        places = sailed(world, 15, flow.tolist())[-1, 0] - 15 * flow
        ends.append(np.concatenate([places, world.hull[0, 0, : HullColumn.r + 1].cpu().numpy()]))
    np.testing.assert_allclose(ends[0], ends[1], atol=2e-3)
    assert np.abs(ends[0][:2] - 500).max() > 1.5


def test_its_future_depends_on_its_state_alone():
    sections = {"task": "station-keeping", "storm": {"spectrum": "jonswap"}, "sea": {"realisations": 4}}
    world, part = (
        World(Scenario.from_dict(SECTIONS | sections), n, 5, "hold:400,600", first_world=first)
        for n, first in ((4, 0), (2, 2))
    )
    for some in (world, part):
        some.reset()
    later = sailed(world, 20)
    np.testing.assert_array_equal(sailed(part, 20), later[:, 2:])
    state = world.state()
    first = sailed(world, 5)
    world.load_state(state)
    np.testing.assert_array_equal(sailed(world, 5), first)
    for column in range(len(HullColumn.names)):  # each decides it
        changed = {name: value.clone() for name, value in state.items()}
        changed["hull"][:, 0, column] += 0.5
        world.load_state(changed)
        assert (sailed(world, 5) != first).any(), HullColumn.names[column]


def fixes_at(world, heading):
    """Errors (W, 2), covariances (W, 3) of fixes in which all is turned by a heading, anticlockwise from east."""
    world.rewind()
    world.reset()
    world.boat[..., PLACE] = 500.0
    c, s = math.cos(heading), math.sin(heading)
    world.auv[..., AuvColumn.x], world.auv[..., AuvColumn.y] = 500 + 60 * c - 20 * s, 500 + 60 * s + 20 * c
    world.hull[..., HullColumn.heading] = 0.5 * math.pi - heading
    world.step(torch.tensor([c, s]).expand(world.num_worlds, 1, 2).contiguous())
    auv = world.auv[:, 0].double().cpu().numpy()
    error = auv[:, AuvColumn.span("fix_x", "fix_y")] - auv[:, AuvColumn.span("heard_x", "heard_y")]
    return error, auv[:, AuvColumn.span("covariance_xx", "covariance_yy")]


def test_the_array_turns_with_the_boat():
    """All turned alike, errors of fixes and their covariances turn with it: mounting, compass, lever arm, attitude.

    And they fit each other at any heading: the normalised squared error has the mean 2.
    """
    errors = {"attitude_error": 0.01, "alignment_error": 0.02, "heading_error": 0.03, "lever_arm_error": 0.5}
    world = world_of("hold:500,500", 512, boat={"top_speed": 1e-4}, usbl=errors)
    error, covariance = fixes_at(world, 0.0)
    assert np.sqrt((error**2).mean()) > 1
    for heading in (0.7, 2.9):
        turn = np.array([[math.cos(heading), -math.sin(heading)], [math.sin(heading), math.cos(heading)]])
        found, spread = fixes_at(world, heading)
        np.testing.assert_allclose(found, error @ turn.T, atol=5e-3)
        matrix, turned = (c[:, [0, 1, 1, 2]].reshape(-1, 2, 2) for c in (covariance, spread))
        np.testing.assert_allclose(turned, turn @ matrix @ turn.T, rtol=1e-3, atol=1e-3)
        squared = np.einsum("ni,nij,nj->n", found, np.linalg.inv(turned), found)
        assert squared.mean() == pytest.approx(2, abs=4 * 2 / math.sqrt(512))


def test_it_gets_as_far_as_planners_reckon():
    """They take it to turn on the spot at its greatest rate, then to go at top speed: right within 3 s, to any side."""
    world = world_of("hold:800,500", 8)
    turns = torch.arange(8) * math.pi / 4
    world.hull[:, 0, HullColumn.heading] = 0.5 * math.pi - turns
    gone = np.linalg.norm(sailed(world, 80) - [800, 500], axis=-1)
    seconds = 1 + (gone > 200).sum(0)  # until it is 100 m nearer
    off = np.abs(np.remainder(turns.numpy() + math.pi, 2 * math.pi) - math.pi)
    assert np.abs(seconds - (off / world.scenario.otter.turn_rate + 100 / 2)).max() < 3
    assert seconds.max() > seconds.min() + 8


@pytest.mark.slow
def test_the_goals_of_fim_greedy_are_all_reached_in_the_same_time():
    """Towards an AUV far to the east they lie twice as far ahead as astern."""
    world = world_of("fim-greedy", 8, area={"width": 3000})
    heading = 0.5 * math.pi - torch.arange(8) * math.pi / 4
    world.hull[:, 0, HullColumn.heading] = heading
    world.auv[..., AuvColumn.span("x", "y")] = torch.tensor([2500.0, 500.0])
    world.estimate[..., EstimateColumn.span("x", "y")] = torch.tensor([2500.0, 500.0])
    sailed(world, 1)
    goal = world.boat[:, 0, BoatColumn.span("goal_x", "goal_y")].cpu() - 500
    assert goal[0].tolist() == pytest.approx([48, 0], abs=2)
    assert goal[4].tolist() == pytest.approx([24, 0], abs=2)
    away = world_of("hold:500,500", 8)
    away.hull[:, 0, HullColumn.heading] = heading
    away.boat[:, 0, PLACE] = 500 - goal
    seconds = (np.linalg.norm(sailed(away, 60) - 500, axis=-1) > 10).sum(0)
    assert np.ptp(seconds) <= 6


def test_it_does_what_its_action_asks_for():
    """Velocity through the water is the action times the top speed, which is that of its thrust at most."""
    sections = {"navigation": {"sensor": "ground"}, "channel": {"schedule": "all"}, "boat": {"top_speed": 9}}
    world = world_of("agent", 2, **sections)
    most = top_speed(world.site)
    assert most == otter_numbers.top_speed(world.scenario.otter.model_dump()) == pytest.approx(3.087, rel=2e-3)
    action = torch.tensor([[[0.4, 0.3]], [[-0.3, 0.0]]])
    sailed(world, 40, (0.2, 0.1), action)
    water = world.boat[..., BoatColumn.span("water_x", "water_y")].cpu()
    torch.testing.assert_close(water, most * action, atol=0.08, rtol=0)


def test_its_heading_is_in_the_trace():
    world = world_of("hold:200,300", 8)
    trace = record(world, lambda seen: torch.zeros(8, 1, 2), "still", steps=60)
    assert trace.boat_heading[-1, 0, 0] == pytest.approx(0.5 * math.pi - world.hull[0, 0, 0].item(), abs=1e-5)
    water = world.boat[0, 0, BoatColumn.span("water_x", "water_y")].cpu().numpy()
    ahead = [math.cos(trace.boat_heading[-1, 0, 0]), math.sin(trace.boat_heading[-1, 0, 0])]
    assert water @ ahead == pytest.approx(world.hull[0, 0, HullColumn.u].item(), abs=1e-4)
    assert np.abs(np.diff(trace.boat_heading[:, 0, 0])).max() < 1  # not reduced to one turn
