"""The tables and the page of a study, made of results that are written here."""

import dataclasses
import html
import json
from pathlib import Path

import numpy as np
import pytest

from tests.usvauv_cli.pages import CHROMIUM, Elements, check_alone, check_figures, in_browser
from usvauv.cli.sweep import report, results
from usvauv.cli.sweep.run import FAILURE, MADE, RESULT
from usvauv.cli.sweep.study import Study, read
from usvauv.env.record.metrics import EpisodeMetrics
from usvauv.env.storage.tables import read_rows, write_rows

LARGEST = 3_000_000  # bytes of a page
FIGURES = {"scores", "aggregates", "profiles", "improvement", "learning"}
STUDY = """
[common]
scenario = ["ideal", "extreme"]
seed = [0, 1, 2]
[[runs]]
policy = ["clear", "straight"]
[[runs]]
algorithm = "sac"
name = "<b>sac & co"
[evaluation]
episodes = 4
"""


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
            (place / "last").mkdir()
            history = [{"steps": steps, "arps": number + steps / 100} for steps in (0, 50, 100)]
            (place / "last" / "training.json").write_text(json.dumps({"history": history}))


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
        results.write(self.study, folder)
        self.text = (folder / "report" / "index.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Made:
    return Made(tmp_path_factory.mktemp("study"))


def test_scores_are_those_of_the_runs(made):
    scores, aggregates, pairs, _ = Elements(made.text).tables
    assert scores[0] == ["method", "ideal", "extreme"]
    assert [row[0] for row in scores[1:]] == ["clear", "straight", "<b>sac & co"]
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
    check_alone(made.folder / "report")
    check_figures(made.folder / "report", FIGURES)
    assert "<b>sac" not in made.text
    assert "<i>last" not in made.text
    assert "&lt;b&gt;sac &amp; co in extreme ends at 17.0 [16.0, 18.0]" in made.text  # of 15, 16 and 17


def test_says_how_it_was_made(made):
    said = html.unescape(made.text)
    assert STUDY.strip() in said
    for words in ("Python 3.", "usvauv ", "taichi 1.7.4", "kernels on cpu"):
        assert words in said


def test_is_the_same_again(made, capsys):
    before = {path: path.read_bytes() for path in (made.folder / "report").iterdir()}
    results.write(made.study, made.folder)
    assert {path: path.read_bytes() for path in (made.folder / "report").iterdir()} == before


def test_without_any_result_there_is_a_page_of_failures(made, tmp_path, capsys):
    (tmp_path / "report").mkdir()
    (tmp_path / "report" / "scores.pdf").touch()
    results.write(made.study, tmp_path)
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
    results.write(study, tmp_path)
    assert "results.csv; there is no Parquet file without pyarrow (extra 'scale')\n" in capsys.readouterr().out
    assert not (tmp_path / "results.parquet").exists()


@pytest.mark.slow
def test_the_largest_page_is_below_its_bound(made, tmp_path):
    methods, tasks = report.MOST_METHODS + 20, report.MOST_TASKS + 6
    one = {"runs": 1, "value": 1234.5678, "low": 1000.1, "high": 2000.1}
    long = [f"</script><b>a method & its many settings {'x' * 80} {i}" for i in range(methods)]
    found = {
        **made.study.evaluation.model_dump(),
        "tasks": {f"a scenario and its changes {'y' * 60} {t}": dict.fromkeys(long, one) for t in range(tasks)},
        "aggregates": {method: dict.fromkeys(("iqm", "median", "mean"), one) for method in long},
        "profiles": {method: [{"above": t / 40, **one} for t in range(41)] for method in long},
        "improvement": [{"method": long[0], "over": other, **one} for other in long[1:]],
    }
    pieces = [dataclasses.replace(piece, method=long[0], task=next(iter(found["tasks"]))) for piece in made.study.runs]
    runs = tuple(pieces[i % 18] for i in range(report.MOST_RUNS + 100))
    study = Study(made.study.path, "#" * 10**6, runs, made.study.evaluation, made.study.resources)
    for piece in pieces:
        piece.place(tmp_path).mkdir(parents=True)
        (piece.place(tmp_path) / FAILURE).write_text("<" * 5000)
    text = report.write(tmp_path, study, found).read_text(encoding="utf-8")
    assert len(text.encode()) < LARGEST
    assert "<b>a method" not in text
    assert f"300 of {methods} methods, 24 of {tasks} tasks, 300 of {methods - 1} pairs, 1000 of 1100 runs." in text


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
