"""`usvauv reproduce collaboration`: figures by hand from tables of episodes, the page, and the missions themselves."""

import dataclasses

import pytest

from usvauv.cli.reproduction import collaboration, targets
from usvauv.cli.reproduction.collaboration import AXES, FIGURES, NEAR, PERFECT, Missions
from usvauv.cli.reproduction.settings import FULL
from usvauv.cli.reproduction.work import Work
from usvauv.env.storage.tables import read_rows, write_rows

TINY = dataclasses.replace(FULL, wide_episodes=2, overrides=("mission.duration=20", "nodes.count=20"))


@pytest.fixture
def tables(tmp_path):
    """A folder with tables of two episodes of all missions: perfect fixes 100 and 200 Mbit, `belief` 90 and 150."""
    for missions in collaboration.pieces(TINY):
        data = {"perfect": (100, 200), "belief": (90, 150)}.get(
            missions.name if missions == PERFECT else missions.boat, (80, 110)
        )
        rows = [{**dict.fromkeys(FIGURES, 7.0), "delivered_mbit": value} for value in data]
        write_rows(missions.result(tmp_path), FIGURES, rows)
    return tmp_path


def test_figures_by_hand(tables):
    found = list(collaboration.points(tables))
    assert len(found) == 4 * 5 + 3 * 5 + 3 * 5 + 4 * 4
    centroid = next(p for p in found if (p.axis, p.value, p.boat) == (AXES[0].name, 200, "centroid"))
    assert centroid.share == pytest.approx(95 / 150)
    assert centroid.interval == pytest.approx(1.96 * 15)  # deviation 15 √2 of 2 episodes
    assert (centroid.more, centroid.more_interval) == (25, pytest.approx(1.96 * 15))
    belief = next(p for p in found if p.boat == "belief")
    assert (belief.share, belief.more, belief.more_interval) == (pytest.approx(0.8), 0, 0)
    assert belief.means["outage_longest"] == 7


def test_the_page_needs_no_more_than_the_tables(tables):
    said = []
    page = targets.reproduce("collaboration", TINY, tables, 1, "usvauv reproduce collaboration --out DIR", said.append)
    assert said[0] == "everything is trained and evaluated"
    text = page.read_text()
    for words in ("`centroid` | 95.0 ± 29.4 | 63.3 % | 25.0 ± 29.4", "Number of boats", "bring in 150.0 Mbit"):
        assert words in text
    assert {file.name for file in (tables / "reproduction").iterdir()} == {
        *("collaboration.csv", "collaboration.pdf", "collaboration-dark.png", "collaboration-light.png")
    }
    assert len(read_rows(tables / "reproduction" / "collaboration.csv")) == 66


def test_missions_are_those_of_the_strategy_and_changes(tmp_path):
    missions = Missions("near", "visit", NEAR[1])
    assert missions.left(TINY, tmp_path) > 0
    missions.run(Work(TINY, tmp_path, lambda done: None, lambda: False))
    assert missions.left(TINY, tmp_path) == 0
    rows = read_rows(missions.result(tmp_path))
    assert [(row["scenario"], row["usv"], row["policy"], row["seed"]) for row in rows] == 2 * [
        ("wide", "visit", "pace", "2026")
    ]
    assert all(float(row["aoi_mean"]) > 0 for row in rows)
