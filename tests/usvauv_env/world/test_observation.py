"""What is written of observations and actions, for any number of AUVs, beside the layouts themselves."""

import math
import re
from pathlib import Path

import pytest
import torch

from usvauv.env import Scenario, World
from usvauv.env.sea.water import current_bound
from usvauv.env.site.site import Site
from usvauv.env.world.agents import observed
from usvauv.env.world.observation_layout import ObservationLayout
from usvauv.kernels.mission.observation import observation_terms, quantities
from usvauv.kernels.mission.tasks.task import tasks


@pytest.mark.parametrize("num_auvs", [1, 2, 5])
def test_the_table_of_the_docs_holds_for_any_number_of_auvs(num_auvs):
    """Its expressions in K, at that K, are first and last index of each term where all terms are present."""
    assert tasks["tracking-plain"].observation == ("track", "outlook")  # which so are registered
    layout = ObservationLayout(num_auvs, 0, tuple(observation_terms))
    page = (Path(__file__).parents[3] / "docs" / "interfaces.md").read_text(encoding="utf-8")
    table = page.partition("\n| index | term | ")[2].partition("\n\n")[0]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()[2:]]
    assert [row[1].strip("`") for row in rows] == list(layout.terms)
    for row, (name, place) in zip(rows, layout, strict=True):
        term, texts = observation_terms[name], observation_terms[name].quantities(2)
        low, high = (str(x).replace("inf", "c").replace(".0", "").replace("-", "−") for x in (term.low, term.high))
        written = texts[0] if len(texts) == 1 else f"{texts[0]}; …; {texts[-1]}"
        assert row[2:] == [written, term.unit, f"{low} … {high}", term.condition]
        ends = []
        for text in row[0].split(" … "):
            slope, constant = re.fullmatch(r"(\d*K)?([+−]?\d+)?", text).groups()
            times = int(slope[:-1] or 1) if slope else 0
            ends.append(times * num_auvs + int((constant or "0").replace("−", "-")))
        assert "+0" not in row[0]
        if place.stop > place.start:
            assert (ends[0], ends[-1]) == (place.start, place.stop - 1), name


def test_bounds_are_those_of_the_units():
    """Positions in the area's diagonal, shares from 0 to 1, speeds from 0 and velocities from −c to the bound c."""
    changes = ["auv.count=3", "area.width=300", "observation.current=profile"]
    site = Site(Scenario.load("extreme", changes))
    rows = observed(site)
    layout = ObservationLayout.of(site.scenario)
    assert [row.index for row in rows] == list(range(layout.size))
    largest = current_bound(site)
    expected = {"others": 2.0, "target": 2.0, "position": 2.0, "current": largest, "current_profile": largest}
    for name, place in layout:
        for row, text in zip(rows[place], quantities(name, 3, layout.num_nodes), strict=True):
            assert row.quantity == text
            assert row.high == pytest.approx({**expected, "current_speed": largest}.get(name, 1.0))
            assert row.low == pytest.approx(-expected[name] if name in expected else 0.0)
            if name in ("others", "target", "position"):
                assert f"{math.hypot(300, site.scenario.area.length):.6g} m" in row.unit
    assert len(rows[layout.slice("others")]) == 4
    assert [row.quantity[0] for row in rows[layout.slice("others")]] == list("xyxy")


def test_a_step_is_overwritten_by_the_next_one_and_its_clone_is_not():
    world = World(Scenario.load("ideal"), 2)
    world.reset()
    action = torch.ones(2, world.num_auvs, 2, device=world.device)
    first = world.step(action)
    kept = first.clone()
    observation, reward, horizon_ended, truncated, info = kept
    assert torch.equal(first.observation, observation)
    second = world.step(-action)
    assert first.observation is second.observation
    assert not torch.equal(first.observation, observation)
    assert not torch.equal(first.info["measures"], info["measures"])
    assert reward.shape == horizon_ended.shape == truncated.shape == (2, world.num_auvs)
    assert info["reward_terms"].sum(-1).allclose(reward)
