"""Fixes that cannot be, in a mission: wraps are undone, doubtful fixes dropped, and a lost AUV is found again."""

import math

import numpy as np
import pytest
import torch

from tests.kernels.mission.test_fixes import PLAIN, column, steady, voyage
from usvauv.env import Scenario, World
from usvauv.kernels.mission.columns import AuvColumn, EstimateColumn
from usvauv.kernels.positioning import usbl

WIDE = "usbl.spacing=0.06"


def flags_of(world):
    return world.auv[..., AuvColumn.fix_flags].int()


def moved(world, by):
    """Put AUV 0 of every world elsewhere, `by` m in x and y towards the middle of the area."""
    state = world.state()
    auv = state["auv"].clone()
    place = auv[:, 0, AuvColumn.span("x", "y")]
    auv[:, 0, AuvColumn.span("x", "y")] = place + by * torch.sign(100 - place)
    world.load_state(state | {"auv": auv})


@pytest.mark.parametrize(
    "settings",
    [
        [],
        ["tracker.enabled=true"],
        ["usbl.packet_loss=0.3", "usbl.latency=0.3"],
        ["usbl.spacing=0.11", "tracker.enabled=true"],
    ],
    ids=str,
)
def test_wraps_are_undone(settings):
    """From a corner most directions have phase differences beyond π, and no fix that is used is wrong."""
    trace = voyage([WIDE, *settings], usv="hold:0,0", worlds=8)
    away = column(trace, "auv_position") - column(trace, "boat_position")
    S = np.sqrt((away**2).sum(-1) + 100**2)
    carriers = np.array([15000, 18000]) * 2 * math.pi / 1500 * trace.scenario.usbl.spacing
    assert (np.abs(carriers[:, None] * away / S[..., None]).max(-1) > math.pi).mean() > 0.3
    heard = trace.fix_flags & usbl.DETECTED > 0
    used = heard & (trace.fix_flags & usbl.UNUSABLE == 0)
    assert not np.any(trace.fix_flags[used] & usbl.WRAPPED)
    assert used.sum() > 0.99 * heard.sum()
    off = np.linalg.norm(trace.estimate - trace.auv_position, axis=-1)
    assert off.max() < (40 if "usbl.packet_loss=0.3" in settings else 8)


@pytest.mark.parametrize("tracked", [False, True])
def test_a_kidnapped_auv_is_found(tracked):
    """Without a tracker once it can have gone that far, at 2.2 m/s and the fastest water; with one by three fixes."""
    scenario = Scenario.load("extreme", [*PLAIN, WIDE, f"tracker.enabled={str(tracked).lower()}"])
    world = World(scenario, 16, seed=3, usv="hold:60,60")
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
    if tracked:
        assert np.all(error[10] < 4)


def test_without_a_prediction_two_directions_alike_are_dropped():
    """d = 0.8 λ, both phase differences near π: that AUV may as well be opposite, at the same depth."""
    calm = ["storm.spectrum=none", "sea.irregular_rms=0", "sea.regular_amplitude=0"]
    settings = [*PLAIN, "usbl.spacing=0.08", "usbl.tilt=false", "current.count=0", *calm, "auv.count=1"]
    world = World(Scenario.load("extreme", settings), 4, seed=1, usv="hold:0,0")
    world.reset()
    cosine = math.pi / (2 * math.pi * 15000 * 0.08 / 1500)
    place = 100 * cosine / math.sqrt(1 - 2 * cosine**2)
    for age, dropped in ((1.0, False), (1e4, True)):
        state = world.state()
        auv, estimate = state["auv"].clone(), state["estimate"].clone()
        auv[..., AuvColumn.span("x", "y")] = place
        estimate[..., EstimateColumn.span("x", "y")] = place + 1.0
        estimate[..., EstimateColumn.age] = age
        world.load_state(state | {"auv": auv, "estimate": estimate})
        world.step(torch.zeros(4, 1, 2))
        assert ((flags_of(world) & usbl.AMBIGUOUS > 0) == dropped).all()
        still = (world.estimate[..., EstimateColumn.span("x", "y")] == place + 1.0).all(-1)
        assert (still == dropped).all()
        assert (world.estimate[..., EstimateColumn.age] == (age + 1 if dropped else 1)).all()
