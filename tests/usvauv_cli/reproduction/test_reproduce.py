"""`usvauv reproduce`: statistics by hand, the paper's numbers, the folder, the page."""

from __future__ import annotations

import csv
import dataclasses
import math
import re
import statistics
from pathlib import Path

import numpy as np
import pytest

from tests.usvauv_cli.sweep.work import Here
from usvauv import policies
from usvauv.cli.reproduction import collaboration, fig4, learning, page, paper
from usvauv.cli.reproduction.paper import FULL, METHODS, Settings, heuristic, learned
from usvauv.env import Scenario
from usvauv.env.storage.result_tables import read_rows, write_rows
from usvauv.env.world.observation_layout import ObservationLayout

SAME = "observation.current=speed"  # so that all methods share what is compiled
TINY_RUN = {"num_worlds": 4, "hidden": (8,), "batch": 16, "warmup": 40, "n_step": 2, "replay": 400}
TINY = Settings(
    methods=tuple(
        dataclasses.replace(
            method,
            config=dataclasses.replace(method.config, **TINY_RUN),
            learning=(*method.learning, SAME),
            testing=(*method.testing, SAME),
        )
        for method in METHODS
        if method.key != "td3"  # learns in the worlds of DDPG
    ),
    seeds=(1,),
    steps=160,
    evaluations=2,
    judged=2,
    episodes=2,
    fix_episodes=2,
    wide_episodes=2,
    overrides=("mission.duration=20", "nodes.count=20"),
)
BOATS = ("fim", "hold:100,100")
ESC = paper.CONDITIONS["ESC"]


def reproduce(target: str, folder: Path, settings: Settings = TINY) -> Path:
    return page.reproduce(target, settings, folder, Here, 1, f"usvauv reproduce {target} --out DIR")


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A folder in which everything is reproduced, and its page; with two boats and the paper's scenarios alone."""
    folder = tmp_path_factory.mktemp("whole")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(paper, "STRATEGIES", BOATS)
        patch.setattr(fig4, "SCENARIOS", tuple(paper.CONDITIONS.values()))
        return folder, reproduce("all", folder)


def test_statistics_by_hand():
    def episode(run, arps, updates):
        others = dict.fromkeys(("sdr", "ec", "services", "delivered_mbit", "collisions", "border"), "6")
        return {"run": run, "usv": "fim", "updates": updates, "arps": arps, "collaboration": "2"} | others

    first = [episode("0", "1", "0"), episode("0", "3", "0")]
    second = [episode("1", "5", "9"), episode("1", "11", "9")]
    row = learning.pool("sac", "SAC", "ISC", "ESC", [first, second])
    assert (row["row"], row["runs"], row["untrained_runs"], row["episodes"]) == ("SAC (ESC)", 2, 1, 4)
    assert (row["arps_mean"], row["arps_without_eq5_mean"]) == (5.0, 3.0)
    assert row["arps_sd"] == pytest.approx(math.sqrt((16 + 4 + 0 + 36) / 3))
    assert row["arps_runs_sd"] == pytest.approx(math.sqrt(2 * 3.0**2))  # means 2 and 8
    assert [row[f"sdr_{what}"] for what in ("mean", "sd", "paper", "paper_sd")] == [6.0, 0.0, 5.58, 2.35]

    level = fig4.level(ESC, "fim", [{"median": f"{m}", "p95": f"{10 * m}"} for m in (1, 2, 9)])
    assert (level["episodes"], level["median"], level["p95"], level["paper"]) == (3, 2.0, 20.0, 0.002)
    assert 1.0 <= level["low95"] <= 2.0 <= level["high95"] <= 9.0

    runs = [
        {"method": method, "condition": "ISC", "run": run, "steps": steps, "ec": ec}
        for method, run, steps, ec in (
            ("sac", 0, 0, 1.0), ("sac", 0, 10, 2.0), ("sac", 1, 0, 3.0), ("sac", 1, 10, 6.0), ("ddpg", 0, 0, 100.0),
        )
    ]  # fmt: skip
    np.testing.assert_array_equal(learning.band(runs, "sac", "ISC", "ec"), [[0, 10], [2, 4], [1, 2], [3, 6]])


def test_tables_and_figures_are_there(whole):
    results = whole[0] / paper.RESULTS
    rows = {name: read_rows(results / f"{name}.csv") for name in ("table2", "fig3", "fig4a", "fig4b")}
    counts = {name: len(of) for name, of in rows.items()}
    assert counts == {"table2": 2 * (2 * 4 + 3), "fig3": 2 * 2 * 3, "fig4a": 2 * 3 * 20, "fig4b": 2 * 3}
    assert len(read_rows(results / "fig4b-over-time.csv")) == 2 * 3 * 20
    for name in rows:
        light, dark = ((results / f"{name}-{theme}.png").read_bytes() for theme in ("light", "dark"))
        assert light[:4] == dark[:4] == b"\x89PNG"
        assert light != dark
        assert (results / f"{name}.pdf").read_bytes().startswith(b"%PDF")


def test_the_page_links_to_what_is_there(whole):
    folder, path = whole
    text = path.read_text()
    links = [*re.findall(r"\]\(([^)]+)\)", text), *re.findall(r'(?:src|srcset)="([^"]+)"', text)]
    assert len(links) >= 4 * 4
    assert all((folder / link).is_file() for link in links)
    assert not any(link.startswith("/") for link in links)
    assert str(folder) not in text
    for words in ("6.63 ± 0.97", "−87.95 ± 12.08", "Seeds of the training runs: 1;", "Time taken", "noise_law"):
        assert words in text


def test_a_policy_is_tested_with_the_observation_that_it_learns_from():
    for method in METHODS:
        definition = learned(FULL, method.key, ESC, 0).definition
        scenarios = [definition["scenario"], *definition["evaluation"]["scenarios"]]
        assert len({tuple(ObservationLayout.of(Scenario.from_dict(each)).terms) for each in scenarios}) == 1, method


def test_the_table_is_of_paired_tests(whole):
    firsts = [learned(FULL, "ddpg", ESC, seed).definition["evaluation"]["first"] for seed in FULL.seeds]
    assert firsts == [0, 40, 80, 120, 160]
    folder = whole[0]
    with (folder / paper.RESULTS / "table2.csv").open() as stream:
        cells = {(row["method"], row["trained_in"], row["tested_in"]): row for row in csv.DictReader(stream)}
    for piece, *row in ((learned(TINY, "ddpg", ESC, 1), "ddpg", "ESC"), (heuristic(TINY, "straight"), "straight", "")):
        tests = [test for test in piece.rows(folder) if test["scenario"] == ESC]
        assert [(test["seed"], test["episode"]) for test in tests] == [("2026", "0"), ("2026", "1")]
        mean = statistics.fmean(float(test["arps"]) for test in tests)
        assert float(cells[*row, "ESC"]["arps_mean"]) == pytest.approx(mean)


def test_curves_are_the_runs_evaluations(whole):
    folder = whole[0]
    rows = [
        row
        for row in learning.curves(TINY, folder)
        if (row["method"], row["condition"], row["run"]) == ("sac", "ESC", 1)
    ]
    assert [row["steps"] for row in rows] == [0, 80, 160]
    assert [row["episode_equivalents"] for row in rows] == [0.0, 4.0, 8.0]
    about = policies.read_run(learned(TINY, "sac", ESC, 1).place(folder))[2]
    assert rows[-1]["arps"] == about["evaluation"]["arps"]


T1 = 12.706205  # Student's t of one degree of freedom, 95 %


class TestCollaboration:
    @pytest.fixture
    def tables(self, tmp_path):
        """A folder with two episodes of all missions: perfect fixes 100 and 200 Mbit, `belief` 90 and 150."""
        perfect = collaboration.missions(TINY, collaboration.CENTRE, collaboration.PERFECT).key
        for piece in collaboration.runs(TINY):
            data = (90, 150) if piece.definition["usv"] == "belief" else (80, 110)
            data = (100, 200) if piece.key == perfect else data
            rows = [{**dict.fromkeys(collaboration.FIGURES, 7.0), "delivered_mbit": value} for value in data]
            write_rows(piece.place(tmp_path) / "episodes.csv", collaboration.FIGURES, rows)
        return tmp_path

    def test_figures_by_hand(self, tables):
        found = list(collaboration.points(TINY, tables))
        assert len(found) == 4 * 5 + 3 * 5 + 3 * 5 + 4 * 4
        axis = collaboration.AXES[0].name
        centroid = next(p for p in found if (p["axis"], p["value"], p["boat"]) == (axis, 210, "centroid"))
        assert centroid["share"] == pytest.approx(95 / 150)
        assert centroid["mbit95"] == pytest.approx(T1 * 15, rel=1e-5)  # deviation 15 √2 of 2 episodes
        assert (centroid["belief_more"], centroid["belief_more95"]) == (25, pytest.approx(T1 * 15, rel=1e-5))
        belief = next(p for p in found if p["boat"] == "belief")
        assert (belief["share"], belief["belief_more"], belief["belief_more95"]) == (pytest.approx(0.8), 0, 0)
        assert belief["outage_longest"] == 7

    def test_the_page_needs_no_more_than_the_tables(self, tables, capsys):
        path = reproduce("collaboration", tables)
        assert capsys.readouterr().out.startswith("nothing to do: 53 runs done already")
        text = path.read_text()
        for words in ("`centroid` | 95.0 ± 190.6 | 63.3 % | 25.0 ± 190.6", "Number of boats", "collect 150.0 Mbit"):
            assert words in text
        names = ("collaboration.csv", "collaboration.pdf", "collaboration-dark.png", "collaboration-light.png")
        assert {file.name for file in (tables / paper.RESULTS).iterdir()} == set(names)
        assert len(read_rows(tables / paper.RESULTS / "collaboration.csv")) == 66
