"""Random inputs: some of `tests.trials.fuzz` and `tests.trials.scenarios`, and a link that carries nothing."""

import random

import pytest
import torch

from tests.slowly import slowly
from tests.trials.fuzz import run_case
from tests.trials.scenarios import LONGEST, effort, random_overrides, run
from usvauv.env import Scenario, ScenarioError, World
from usvauv.kernels.mission.columns import AuvColumn


@pytest.mark.parametrize("seed", slowly(range(4), 1, 2, 3))
def test_what_a_scenario_takes_runs(seed):
    """Three that are not refused: finite, nobody outside, power above 0."""
    source, done = random.Random(seed), 0
    while done < 3:
        overrides = random_overrides(source)
        try:
            scenario = Scenario.load("extreme", overrides)
        except ScenarioError:
            continue
        if effort(scenario, 3) < 0.02 * LONGEST:
            assert run(scenario, seed, 3) is None, overrides
            done += 1


def test_a_link_that_carries_nothing_holds_its_auv():
    """At 200 kHz over 11 km the rate is below every number of single precision; the AUV hovers on."""
    weak = ["nodes.source_power=1e-6", "nodes.frequency=200000", "area.depth=11000", "auv.hover_radius=300"]
    world = World(Scenario.load("extreme", weak), 2, 0)
    world.reset()
    for _ in range(5):
        world.step(torch.zeros(2, 2, 2))
    hover = world.auv[..., AuvColumn.hover]
    assert ((hover > world.scenario.mission.duration) & hover.isfinite()).all()


@pytest.mark.parametrize(
    ("kind", "count"),
    [("toml", 30), ("override", 100), ("learn", 200), ("checkpoint", 10), ("plan", 12), ("attributes", 8)],
)
def test_inputs_are_accepted_or_refused_in_words(tmp_path, kind, count):
    outcomes = {number: run_case(kind, 5, number, tmp_path) for number in range(count)}
    assert {n: outcome for n, outcome in outcomes.items() if outcome not in ("accepted", "refused")} == {}
    assert "refused" in outcomes.values()
