"""What commands print fits 80 columns, and no number is cut."""

import io
import re
from dataclasses import replace

import pytest
import torch
from rich.console import Console

from tests.usvauv_env.record.test_trace import random_trace
from usvauv.cli import terminal
from usvauv.cli.commands import training_table
from usvauv.cli.commands.simulate import mission_summary
from usvauv.cli.evaluation.comparison import Comparison
from usvauv.cli.evaluation.comparison_tables import COLUMNS as HEADED
from usvauv.cli.evaluation.comparison_tables import OF_BATTERIES, OF_STATIONS, metrics_tables
from usvauv.cli.evaluation.ranking import FEW, ahead
from usvauv.env import Scenario
from usvauv.env.record.metrics import COLUMNS, FIGURES, OF_TARGETS, EpisodeMetrics, episode_metrics
from usvauv.env.storage.result_tables import Combination
from usvauv.policies import TrainingConfig
from usvauv.policies.algorithms import Batch, Sizes, algorithms

LONG = [f"runs/a/very/long/folder/of/many/runs/number-{n}/best" for n in range(12)]
OF_TASK = ("lost_mbit", "aoi_mean", "aoi_peak", "aoi_largest", "jain", "joule_per_mbit")


def episodes(policies, boats, targets):
    """Two episodes each with figures as wide as −12345.67 ± 1234.56."""
    rows = []
    for boat in boats:
        for rule in targets:
            for policy in policies:
                for episode, value in enumerate((-12345.67 - 872.96, -12345.67 + 872.96)):
                    about = {"scenario": "extreme", "policy": policy, "usv": boat, "targets": rule}
                    about |= {"seed": 0, "episode": episode, "of_task": dict.fromkeys(OF_TASK, value)}
                    rows.append(EpisodeMetrics(**(dict.fromkeys(FIGURES, value) | about)))
    assert set(about) | set(FIGURES) == {*COLUMNS, "of_task"}
    return rows


def test_a_summary_names_spent_batteries_and_the_boats_energy(capsys):
    trace = replace(random_trace(), scenario=Scenario.load("ideal", ["auv.count=4", "boat.count=2"]))
    mission_summary(replace(episode_metrics(trace)[1], boat_energy_wh=123.4), trace)
    said = " ".join(capsys.readouterr().out.split())
    assert "; boats 123 Wh; 2 AUVs with a spent battery, the first after 14 s position error" in said


def tables_of(rows, scenario, wide):
    """Print the tables of rows in a scenario."""
    batch = {}
    for row in rows:
        batch.setdefault(Combination(row.policy, row.usv, row.targets), []).append(row.columns())
    comparison = Comparison(list(batch))
    comparison.add(batch)
    metrics_tables(comparison, Scenario.load(scenario), 0, wide, "arps", ahead(comparison, "arps"))


@pytest.mark.parametrize("policies", [["clear"], LONG], ids=["one", "many"])
@pytest.mark.parametrize("boats", [["fim"], ["fim", "hold:300,300;100,100;500,500"]])
@pytest.mark.parametrize("targets", [[""], ["tour", "a-rule-of-a-plugin-with-a-long-name:12"]])
@pytest.mark.parametrize("scenario", ["extreme", "station-keeping"])
def test_tables_of_eval_fit_and_no_number_is_cut(capsys, policies, boats, targets, scenario):
    tables_of(episodes(policies, boats, targets), scenario, wide=False)
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    text = "\n".join(lines)
    assert not re.search(r"[\d.±−]…|…[\d.]+ ±", re.sub(r"\S*[a-z:/]\S*", "", text))
    spreads = re.findall(r"−1234[56]\.?\d* ± 123[45]\.?\d*", text)
    combinations = len(policies) * len(boats) * len(targets)
    assert len(spreads) == 5 * combinations
    assert text.count("±") == 5 * combinations + (1 if combinations == 1 else 2), "of equal ones +0 is said alone"
    said = " ".join(text.split())
    if combinations > FEW:
        assert f"; {combinations - 1} others are within chance of it" in said
    else:
        assert said.count("equal in every world") == combinations - 1
    for name in (*policies, *boats, *targets):
        assert name in text


def test_wide_tables_have_every_figure_of_the_task(capsys):
    tables_of(episodes(LONG, ["fim"], ["tour"]), "extreme-torpedo", wide=True)
    text = capsys.readouterr().out
    assert max(map(len, text.splitlines())) > 80
    means, _, differences = text.partition("\ndifference from ")
    assert means.count(LONG[0]) == 3
    assert differences.count(f"\n{LONG[1]} ") == 3
    others = (*OF_STATIONS, *OF_BATTERIES, *OF_TARGETS)
    shown = (re.split("  +", line.strip())[1:] for line in means.splitlines() if line.startswith("policy "))
    assert len([heading for line in shown for heading in line]) == len(HEADED) - len(others)


def test_a_dumb_terminal_has_whole_numbers_and_lines_of_progress(capsys, monkeypatch):
    monkeypatch.setattr(terminal, "SHOW_AFTER", 0.0)
    monkeypatch.setenv("TERM", "dumb")
    monkeypatch.setenv("FORCE_COLOR", "1")  # the tests' output is taken for a terminal
    tables_of(episodes(LONG, ["fim"], ["tour"]), "extreme-torpedo", wide=True)
    with terminal.progress("simulating", 3) as advance:
        advance(1)
        monkeypatch.setattr(terminal, "LINE_EVERY", 0.0)
        advance(1)
    text, progress = capsys.readouterr()
    assert max(map(len, text.splitlines())) > 80
    assert "…" not in text.replace("/", "")
    assert progress.startswith("simulating: 67%, ")


@pytest.mark.parametrize("algorithm", ["sac", "td3", "ddpg"])
def test_the_table_of_a_training_run_fits_80_by_24(algorithm):
    learner = learner_figures(algorithm)
    reward = {f"a-term-of-a-plugin-{n}": -12345.678 * n for n in range(15)}
    worlds = {"arps": -12345.67, "sdr": 12.34, "ec": 187.21, "services": 123.4, "border": 3.0, "position_error": 12.3}
    evaluation = dict.fromkeys(training_table.TRAINED, -12345.67) | {"margin": -12.345, "margin_half": 0.123}
    figures = {
        **worlds, "steps": 123_456_789, "total": 200_000_000, "eta": 359_999.0, "steps_per_second": 123_456.0,
        "updates": 12_345_678, "evaluation": evaluation, "evaluated_at": 123_456_789, "reward": reward,
        "learner": learner,
    }  # fmt: skip
    console = Console(width=80, height=24, file=io.StringIO(), markup=False)
    console.print(
        training_table.training_table(
            figures, evaluation | {"policy": LONG[0], "start": "clear:80"}, f"{algorithm} in {'x' * 60}"
        )
    )
    text = console.file.getvalue()
    lines = text.splitlines()
    before_learning = training_table.training_table(
        figures | {"updates": 0}, evaluation | {"policy": "", "start": ""}, ""
    )
    console.print(before_learning)
    assert "h left" not in console.file.getvalue().removeprefix(text)
    assert len(lines) <= 22
    assert max(map(len, lines)) <= 80
    assert text.count("-12345.67") == 1 + 2 * len(training_table.TRAINED)
    for name, value in (reward | learner).items():
        assert f"{value:.3g}" in text, name
    assert all(name in text for name in learner)
    for whole in (
        "62%, 100 h left",
        "123,456,789 of 200,000,000",
        "12,345,678 updates",
        "−12.35 ± 0.12; began near clear:80",
    ):
        assert whole in text


def learner_figures(algorithm):
    """The figures of an algorithm's update, each another wide number."""
    learner = algorithms[algorithm](Sizes(1, 3, 2), TrainingConfig(hidden=(4,)), torch.Generator())
    batch = Batch(*(torch.zeros(1, 4, *shape) for shape in ((3,), (2,), (), (), (3,))))
    return {name: -9876.543 / (n + 1) for n, name in enumerate(learner.update(batch))}
