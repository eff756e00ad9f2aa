"""Statistics of a study beside scipy's and plain counting."""

from itertools import product

import numpy as np
import pytest
from scipy import stats

from usvauv.cli.sweep import summary
from usvauv.cli.sweep.study import Evaluation
from usvauv.cli.sweep.summary import improvement, interquartile_mean, interval, mean, median, normalised, profile

DRAW = np.random.default_rng(3)
ONE, OTHER = ([DRAW.normal(shift, 1.0, 10) for _ in range(3)] for shift in (0.4, 0.0))


@pytest.mark.parametrize("runs", [1, 2, 3, 5, 10])
def test_interquartile_mean_is_scipys(runs):
    scores = [task[:runs] for task in ONE]
    assert interquartile_mean(scores) == pytest.approx(stats.trim_mean(np.concatenate(scores), 0.25))


def test_improvement_is_mann_whitneys():
    tied = [np.round(task) for task in ONE], [np.round(task[:7]) for task in OTHER]
    expected = np.mean([stats.mannwhitneyu(a, b).statistic / (len(a) * len(b)) for a, b in zip(*tied, strict=True)])
    assert improvement(*tied) == pytest.approx(expected)
    assert improvement(ONE, ONE) == 0.5


def test_profile_counts_runs():
    levels = np.array([-0.2, 0.3])
    counted = [sum(score > level for task in ONE for score in task) / 30 for level in levels]
    assert profile(ONE, levels) == pytest.approx(counted)
    value, low, high = interval(lambda scores: profile(scores, levels), ONE)
    for i, level in enumerate(levels):
        alone = interval(lambda scores, level=level: profile(scores, np.array([level]))[..., 0], ONE)
        assert (value[i], low[i], high[i]) == pytest.approx(tuple(map(float, alone)))


def test_mean_and_median_are_over_tasks():
    tasks = [np.array([0.0, 2.0]), np.array([4.0]), np.array([8.0, 8.0, 8.0])]
    assert mean(tasks) == pytest.approx(13 / 3)
    assert median(tasks) == 4.0


def test_interval_of_one_task_is_scipys_percentile_bootstrap():
    value, low, high = interval(mean, [ONE[0]], repeats=50_000)
    expected = stats.bootstrap((ONE[0],), np.mean, n_resamples=50_000, method="percentile", rng=1).confidence_interval
    assert value == pytest.approx(ONE[0].mean())
    assert (low, high) == pytest.approx((expected.low, expected.high), abs=0.02)


def test_interval_of_a_difference_draws_both_methods():
    value, low, high = interval(improvement, [ONE[0]], [OTHER[0]], repeats=20_000)

    def share(a, b, axis):
        pairs = (a[..., :, None], b[..., None, :])
        return ((pairs[0] > pairs[1]) + 0.5 * (pairs[0] == pairs[1])).mean((-2, -1))

    samples = (ONE[0], OTHER[0])
    expected = stats.bootstrap(samples, share, n_resamples=20_000, method="percentile", rng=1).confidence_interval
    assert (low, high) == pytest.approx((expected.low, expected.high), abs=0.02)
    assert low < value < high


def test_resampling_stays_within_tasks():
    """Two tasks of equal runs each: nothing varies, unless runs of one are drawn for the other."""
    assert interval(interquartile_mean, [np.full(4, 1.0), np.full(4, 9.0)]) == (5.0, 5.0, 5.0)


def test_one_run_has_no_interval():
    value, low, high = interval(mean, [np.array([2.0])])
    assert value == 2.0
    assert np.isnan([low, high]).all()


def test_scores_are_scaled_within_each_task():
    scaled = normalised([[np.array([1.0, 3.0]), np.array([2.0])], [np.array([7.0, 7.0]), np.array([7.0])]])
    assert [task.tolist() for task in scaled[0]] == [[0.0, 1.0], [0.5]]
    assert [task.tolist() for task in scaled[1]] == [[1.0, 1.0], [1.0]]


def rows(score):
    """Rows of a table: two methods, two tasks, three runs each, four episodes, of which one has no score."""
    for method, task, seed, episode in product("ab", "xy", range(3), range(4)):
        value = float(score(method, task, seed)) if episode else float("nan")
        yield {"run": f"{method}{task}{seed}", "method": method, "task": task, "ec": str(value)}


def test_summary_takes_the_better_direction_and_whole_runs():
    found = summary.scores(rows(lambda method, task, seed: seed + 10 * (method == "b")), "ec")
    assert found["x"]["b"].tolist() == [10.0, 11.0, 12.0]
    results = summary.summary(found, Evaluation(score="ec", better="lower"))
    assert results["tasks"]["x"]["b"]["value"] == 11.0
    assert results["improvement"] == [{"method": "a", "over": "b", "value": 1.0, "low": 1.0, "high": 1.0}]
    assert results["aggregates"]["a"]["mean"]["value"] == pytest.approx(11 / 12)
    profile = {point["above"]: point["value"] for point in results["profiles"]["a"]}
    assert profile[0.75] == 1.0
    assert profile[0.9] == pytest.approx(2 / 3)


def test_of_many_methods_the_best_is_compared_with_the_others():
    found = {task: {f"m{n}": np.array([n, n + 0.5]) for n in range(summary.COMPARED + 1)} for task in "xy"}
    results = summary.summary(found, Evaluation())
    assert [(pair["method"], pair["over"]) for pair in results["improvement"]] == [
        (f"m{summary.COMPARED}", f"m{n}") for n in range(summary.COMPARED)
    ]
    assert {pair["value"] for pair in results["improvement"]} == {1.0}


def test_summary_of_tasks_that_methods_do_not_share(capsys):
    apart = [row for row in rows(lambda method, task, seed: seed) if row["method"] + row["task"] in ("ax", "by")]
    results = summary.summary(summary.scores(apart, "ec"), Evaluation(score="ec"))
    assert results["aggregates"] == {}
    assert results["improvement"] == []
    summary.show(results)
    assert "ec, mean over runs" in capsys.readouterr().out


def test_tables_fit_80_columns(capsys):
    def long(row):
        return {
            **row,
            "method": "a method of a very long name " + row["method"],
            "task": "and such a task " + row["task"],
        }

    found = summary.scores(map(long, rows(lambda method, task, seed: 1e3 * seed)), "ec")
    summary.show(summary.summary(found, Evaluation(score="ec")))
    assert max(map(len, capsys.readouterr().out.splitlines())) <= 80
