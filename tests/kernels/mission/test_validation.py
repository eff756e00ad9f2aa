"""Fixes that cannot be, in a mission: those that lack turns are dropped, and a lost AUV is found again."""

import numpy as np
import torch

from tests.kernels.mission.test_fixes import PLAIN, column, steady, voyage
from usvauv.env import Scenario, World
from usvauv.kernels.mission.columns import AuvColumn
from usvauv.kernels.positioning import usbl


def flags_of(world):
    return world.auv[..., AuvColumn.fix_flags].int()


def moved(world, by):
    """Put AUV 0 of every world elsewhere, `by` m in x and y towards the middle of the area."""
    state = world.state()
    auv = state["auv"].clone()
    place = auv[:, 0, AuvColumn.span("x", "y")]
    auv[:, 0, AuvColumn.span("x", "y")] = place + by * torch.sign(100 - place)
    world.load_state(state | {"auv": auv})


def test_a_wide_array_takes_phases_as_they_are():
    """An odd number of missing turns is told by the residual; with one on each axis the gate alone drops a fix."""
    quiet = ["acoustics.source_level=230", "usbl.propagation=false", "usbl.tilt=false", "storm.spectrum=none"]
    settings = [*quiet, "usbl.spacing=0.08", "sea.irregular_rms=0", "sea.regular_amplitude=0", "auv.depth_noise=0"]
    trace = voyage(settings, usv="hold:0,0", worlds=64, steps=5)
    away = column(trace, "auv_position") - column(trace, "boat_position")
    S = np.sqrt((away**2).sum(-1) + trace.scenario.auv.depth**2)
    turns = np.array([15000, 18000])[:, None] / 1500 * 0.08 * away / S[..., None]
    missing = np.abs(np.round(turns)).sum(-1)
    clear = (np.abs(np.abs(turns - np.round(turns)) - 0.5) > 1e-2).all(-1)
    flagged = (trace.fix_flags & usbl.AMBIGUOUS > 0, trace.fix_flags & usbl.WRAPPED > 0)
    for count in range(3):
        assert (clear & (missing == count)).any()
    np.testing.assert_array_equal(flagged[0][clear & (missing < 2)], (missing == 1)[clear & (missing < 2)])
    np.testing.assert_array_equal(flagged[1][clear], (missing > 0)[clear])
    used = trace.fix_flags & (usbl.DETECTED | usbl.UNUSABLE) == usbl.DETECTED
    assert used[clear & (missing == 0)].all()
    assert not used[clear & (missing == 1)].any()


def test_a_kidnapped_auv_is_found():
    """Once it can have gone that far, at 2 m/s and the fastest water."""
    world = World(Scenario.load("extreme", PLAIN), 16, seed=3, usv="centroid")
    observation = world.reset()
    errors, dropped = [], []
    for step in range(24):
        if step == 8:
            moved(world, 30.0)
            observation = world.observation
        observation = world.step(steady(observation))[0]
        errors.append(world.auv[:, 0, AuvColumn.position_error].cpu().numpy().copy())
        dropped.append((flags_of(world)[:, 0] & usbl.REJECTED > 0).cpu().numpy())
    error, dropped = np.array(errors), np.array(dropped)
    assert np.median(error[:8]) < 1
    assert error[8:10].min() > 25
    assert dropped[8:10].all()
    assert np.all(error[20:] < 4)
    assert dropped[20:].mean() < 0.05
