"""Statistics of a study beside scipy's and plain counting; its tables and page, of results that are written here."""

import html
import json
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from tests.usvauv_cli.web_report.pages import CHROMIUM, Elements, check_alone, check_figures, in_browser
from usvauv.cli.sweep import results, summary
from usvauv.cli.sweep.run_folder import FAILURE, MADE, RESULT
from usvauv.cli.sweep.study import Evaluation, Study, read
from usvauv.cli.sweep.summary import improvement, interquartile_mean, interval, mean, median, normalised
from usvauv.env.record.metrics import EpisodeMetrics
from usvauv.env.storage.result_tables import read_rows, write_rows
from usvauv.policies import checkpoint

DRAW = np.random.default_rng(3)
ONE, OTHER = ([DRAW.normal(shift, 1.0, 10) for _ in range(3)] for shift in (0.4, 0.0))
FIGURES = {"scores", "aggregates", "profiles", "improvement", "learning"}
STUDY = """
[common]
scenario = ["ideal", "extreme"]
seed = [0, 1, 2]
[[runs]]
policy = ["clear", "straight"]
[[runs]]
algorithm = "sac"
name = "<b>sac & co $_{ $ 海"
[evaluation]
episodes = 4
"""


@pytest.mark.parametrize("runs", [1, 2, 3, 5, 10])
def test_interquartile_mean_is_scipys(runs):
    scores = [task[:runs] for task in ONE]
    assert interquartile_mean(scores) == pytest.approx(stats.trim_mean(np.concatenate(scores), 0.25))


def test_improvement_is_mann_whitneys():
    tied = [np.round(task) for task in ONE], [np.round(task[:7]) for task in OTHER]
    expected = np.mean([stats.mannwhitneyu(a, b).statistic / (len(a) * len(b)) for a, b in zip(*tied, strict=True)])
    assert improvement(*tied) == pytest.approx(expected)
    assert improvement(ONE, ONE) == 0.5


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
    assert np.isnan(interval(mean, [np.array([2.0])])[1:]).all()  # one run has no interval


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


@pytest.mark.parametrize("seeds", [1, 5])
def test_differences_are_paired_by_world(seeds):
    """Of several trainings the interval is that of their means, of one that of its episodes, less those not known."""
    draw = np.random.default_rng(4)
    base = draw.normal(0, 9, (seeds, 6))
    values = {"a": base, "b": base + draw.normal(2, 0.3, (seeds, 6)), "c": base + draw.normal(0, 0.3, (seeds, 6))}
    values["b"][0, 2] = np.nan
    table = [
        {
            "task": "x",
            "method": name,
            "training_seed": str(seed),
            "episode": str(episode),
            "ec": str(each[seed, episode]),
        }
        for name, each in values.items()
        for seed, episode in product(range(seeds), range(6))
    ]
    found = summary.differences(table, "ec", {"x": 0})
    assert [(row["method"], row["over"]) for row in found] == [("b", "a"), ("c", "a")]
    for row in found:
        less = values[row["method"]] - base
        independent = np.nanmean(less, axis=1) if seeds > 1 else less[0][~np.isnan(less[0])]
        interval = stats.ttest_1samp(independent, 0).confidence_interval(0.95)
        assert (row["difference"] - row["half"], row["difference"] + row["half"]) == pytest.approx(tuple(interval))
        assert row["sentence"].endswith(", of one run each") == (seeds == 1)
    assert found[0]["sentence"].startswith("EC is ")
    assert " W higher with b than with a" in found[0]["sentence"]
    assert found[1]["sentence"].startswith("EC: no difference beyond chance between c and a (")
    on_one_sea = summary.differences(table, "ec", {"x": 1})
    assert (on_one_sea[0]["half"] is None) == (seeds == 1)
    apart = [row for row in table if (row["method"] == "a") != (row["training_seed"] == "0")]
    assert seeds == 1 or summary.differences(apart, "ec", {"x": 0})[0]["difference"] is None


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


def score(place: int, episode: int) -> float:
    return 1.0 + 0.1 * place + 0.01 * episode


def perform(study: Study, folder: Path) -> None:
    """Results of all runs, as if they had been done."""
    plain = {"policy": "1", "usv": "fim", "targets": "", "scenario": "here", "of_task": {"jain": 0.5}}
    fields = [name for name in EpisodeMetrics.__annotations__ if name not in plain]
    for number, piece in enumerate(study.runs):
        place = piece.place(folder)
        rows = [
            EpisodeMetrics(**{**dict.fromkeys(fields, 0.5), **plain, "arps": score(number, e), "episode": e}).columns()
            for e in range(study.evaluation.episodes)
        ]
        write_rows(place / RESULT, list(rows[0]), rows)
        (place / MADE).write_text(json.dumps({"seconds": 1234.4}))
        if piece.definition["training"]:
            history = [{"steps": steps, "arps": number + steps / 100} for steps in (0, 50, 100)]
            content = {"format": checkpoint.FORMAT, "history": history}
            checkpoint.write(place / "last.safetensors", {checkpoint.TRAINING: (content, {})})


class Made:
    """A study of which one run has failed and one was not begun, its tables and its page."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "mine.toml").write_text(STUDY)
        self.study = read(folder / "mine.toml")
        perform(self.study, folder)
        failed, left = (piece.place(folder) for piece in self.study.runs[:2])
        for place in (failed, left):
            (place / RESULT).unlink()
        (failed / FAILURE).write_text("Traceback\n  here\nthe <i>last</i> line\n")
        (left / MADE).unlink()
        results.write_results(self.study, folder)
        self.text = (folder / "report" / "index.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Made:
    return Made(tmp_path_factory.mktemp("study"))


def test_scores_are_those_of_the_runs(made):
    scores, aggregates, pairs, _ = Elements(made.text).tables
    assert scores[0] == ["method", "ideal", "extreme"]
    assert [row[0] for row in scores[1:]] == ["clear", "straight", "<b>sac & co $_{ $ 海"]
    runs = {((piece.method, piece.task), piece.seed): n for n, piece in enumerate(made.study.runs)}
    for row in scores[1:]:
        for task, cell in zip(scores[0][1:], row[1:], strict=True):
            numbers = [n for ((method, of), _), n in runs.items() if (method, of) == (row[0], task) and n > 1]
            value, low, high, count = cell.replace("[", "").replace("]", "").replace(",", "").replace("(of", "").split()
            means = [np.mean([score(n, e) for e in range(4)]) for n in numbers]
            assert float(value) == pytest.approx(np.mean(means), abs=6e-3)
            assert count == f"{len(numbers)})"
            assert (
                len(numbers) == 1 or min(means) - 0.01 <= float(low) <= float(value) <= float(high) <= max(means) + 0.01
            )
    assert len(aggregates) == len(pairs) == 4


def test_runs_have_their_state_seconds_and_last_line(made):
    *_, runs = Elements(made.text).tables
    shown = {row[-1]: row[:-1] for row in runs[1:]}
    assert list(shown) == [piece.key for piece in made.study.runs]
    failed, left, done = (shown[piece.key] for piece in made.study.runs[:3])
    assert failed == ["clear\nideal", "0", "1,234", "failed: the <i>last</i> line"]
    assert left[2:] == ["–", "not run"]
    assert done[2:] == ["1,234", "done"]
    for fact in ("<dt>runs</dt><dd>18<", "<dt>done</dt><dd>16<", "<dt>failed</dt><dd>1<", "<dt>not run</dt><dd>1<"):
        assert fact in made.text


def test_page_needs_nothing_else_and_its_figures_are_described(made):
    said = html.unescape(made.text)
    assert all(words in said for words in (STUDY.strip(), "Python 3.", "taichi 1.7.4", "kernels on cpu"))
    assert "<li>ideal: straight earns 0.100 more reward per step than clear in every world</li>" in said
    check_alone(made.folder / "report")
    check_figures(made.folder / "report", FIGURES)
    assert "<b>sac" not in made.text
    assert "<i>last" not in made.text


def test_is_the_same_again(made, capsys):
    before = {path: path.read_bytes() for path in (made.folder / "report").iterdir()}
    results.write_results(made.study, made.folder)
    assert {path: path.read_bytes() for path in (made.folder / "report").iterdir()} == before


def test_without_any_result_there_is_a_page_of_failures(made, tmp_path, capsys):
    (tmp_path / "report").mkdir()
    (tmp_path / "report" / "scores.pdf").touch()
    results.write_results(made.study, tmp_path)
    text = (tmp_path / "report" / "index.html").read_text(encoding="utf-8")
    assert "<dt>not run</dt><dd>18<" in text
    assert not list((tmp_path / "report").glob("*.pdf"))
    assert not (tmp_path / "results.csv").exists()


def test_parquet_has_the_numbers_and_names_of_the_table(made):
    parquet = pytest.importorskip("pyarrow.parquet", reason="needs the extra scale")
    found = parquet.read_table(made.folder / "results.parquet").to_pylist()
    rows = read_rows(made.folder / "results.csv")
    assert len(found) == len(rows) == 16 * 4
    for one, other in zip(found, rows, strict=True):
        assert {type(one[name]) for name in ("run", "method", "task", "policy", "targets")} == {str}
        assert {type(one[name]) for name in ("arps", "jain")} == {float}
        assert all(str(one[name]) == text or one[name] == float(text) for name, text in other.items())


def test_without_pyarrow_there_is_no_stale_parquet(made, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    study = Study(made.study.path, STUDY, made.study.runs[2:4], made.study.evaluation, made.study.resources)
    perform(study, tmp_path)
    (tmp_path / "results.parquet").touch()
    results.write_results(study, tmp_path)
    assert "results.csv; there is no Parquet file without pyarrow (extra 'scale')\n" in capsys.readouterr().out
    assert not (tmp_path / "results.parquet").exists()


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
@pytest.mark.parametrize("width", [360, 1200])
def test_in_a_browser(made, tmp_path, width):
    """No problem is reported, nothing is wider than the window, and no text of a figure lies on another."""
    overlaps = """
  const texts = [...document.querySelectorAll("figure svg text")], over = [];
  for (const text of texts) for (const other of texts) {
    if (text === other || text.closest("svg") !== other.closest("svg")) continue;
    const a = text.getBoundingClientRect(), b = other.getBoundingClientRect();
    const [x, y] = ["x", "y"].map((k) => Math.min(a[k] + a[k === "x" ? "width" : "height"], b[k] + b[k === "x" ? "width"
      : "height"]) - Math.max(a[k], b[k]));
    if (x > 2 && y > 4) over.push(`${text.textContent} / ${other.textContent}`);
  }
  return { over, texts: texts.length };
"""
    answer = in_browser(made.text, tmp_path, width, overlaps)
    assert answer["texts"] > 20
    assert answer["over"] == []
