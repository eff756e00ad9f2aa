"""What commands print fits 80 columns, and no number is cut."""

import re

import pytest

from usvauv.cli import report
from usvauv.cli.evaluation.comparison import Comparison
from usvauv.cli.tables import COLUMNS as HEADED
from usvauv.cli.tables import OF_STATIONS
from usvauv.env import Scenario
from usvauv.env.record.metrics import COLUMNS, FIGURES, EpisodeMetrics
from usvauv.env.storage.tables import Combination

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


def tables_of(rows, scenario, wide):
    """Print the tables of rows in a scenario."""
    batch = {}
    for row in rows:
        batch.setdefault(Combination(row.policy, row.usv, row.targets), []).append(row.columns())
    comparison = Comparison(list(batch))
    comparison.add(batch)
    report.metrics_tables(comparison, Scenario.load(scenario), 0, wide)


@pytest.mark.parametrize("policies", [["clear"], LONG], ids=["one", "many"])
@pytest.mark.parametrize("boats", [["fim"], ["fim", "hold:300,300;100,100;500,500"]])
@pytest.mark.parametrize("targets", [[""], ["tour", "learned:some/folder/of/mine/targets.json"]])
@pytest.mark.parametrize("scenario", ["extreme", "station-keeping"])
def test_tables_of_eval_fit_and_no_number_is_cut(capsys, policies, boats, targets, scenario):
    tables_of(episodes(policies, boats, targets), scenario, wide=False)
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    text = "\n".join(lines)
    assert not re.search(r"[\d.±-]…|…[\d.]+ ±", re.sub(r"\S*[a-z:/]\S*", "", text))
    spreads = re.findall(r"-1234[56]\.?\d* ± 123[45]\.?\d*", text)
    combinations = len(policies) * len(boats) * len(targets)
    assert len(spreads) == 5 * combinations
    assert text.count("±") == 5 * combinations + (1 if combinations == 1 else 2), "of equal ones +0 is said alone"
    assert len(re.findall(r"equal\s+in\s+every\s+world", text)) == combinations - 1
    for name in (*policies, *boats, *targets):
        assert name in text


def test_wide_tables_have_every_figure_of_the_task(capsys):
    tables_of(episodes(LONG, ["fim"], ["tour"]), "extreme-torpedo", wide=True)
    text = capsys.readouterr().out
    assert max(map(len, text.splitlines())) > 80
    means, _, differences = text.partition("\nless ")
    assert means.count(LONG[0]) == 3
    assert differences.count(f"\n{LONG[1]} ") == 3
    shown = (re.split("  +", line.strip())[1:] for line in means.splitlines() if line.startswith("policy "))
    assert len([heading for line in shown for heading in line]) == len(HEADED) - len(OF_STATIONS)
