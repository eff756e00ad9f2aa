"""The page of `eval --report`: its numbers, that it needs nothing else, and what it does in a browser."""

import base64
import html
import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from tests.usvauv_cli.web_report.pages import (
    CHROMIUM,
    Elements,
    check_alone,
    check_figures,
    in_browser,
)
from tests.usvauv_env.record.made_traces import following, keeping_station, synthetic_trace
from usvauv import play, policies
from usvauv.cli.evaluation.comparison import COUNTS, Comparison
from usvauv.cli.evaluation.comparison_tables import column_tables, sentences
from usvauv.cli.web_report import page
from usvauv.cli.web_report.episodes import (
    ERRORS,
    Recordings,
    error_quantiles,
    front_episodes,
)
from usvauv.env import Scenario, run_episodes
from usvauv.env.record.metrics import EpisodeMetrics, episode_metrics, usable
from usvauv.env.storage.result_tables import Combination, read_rows
from usvauv.kernels.errors import UserError

EPISODES = 3


def compared(rows: list[EpisodeMetrics]) -> Comparison:
    """The comparison of rows, by combination."""
    batch: dict[Combination, list] = {}
    for row in rows:
        batch.setdefault(Combination(row.policy, row.usv, row.targets), []).append(row.columns())
    comparison = Comparison(list(batch), kept=front_episodes(len(batch)))
    comparison.add(batch)
    return comparison


class Made:
    """An evaluation of two boat strategies, its traces, and its page."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.scenario = Scenario.load("extreme", ["mission.duration=60"])
        self.rows, self.traces, self.recordings = [], [], Recordings(2)
        for usv in ("fim", "hold:0,0"):
            self.rows += run_episodes(
                self.scenario, policies.named("straight"), episodes=EPISODES, seed=4, usv=usv, on_trace=self.take
            )
        page.write(folder, self.scenario, 4, compared(self.rows), self.recordings)
        self.text = (folder / "index.html").read_text(encoding="utf-8")

    def take(self, trace, first):
        self.traces.append(trace)
        self.recordings.add(trace, first)


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Made:
    return Made(tmp_path_factory.mktemp("report"))


def embedded(text: str) -> dict:
    """The JSON of the player."""
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.DOTALL)[1])


def decoded(array: dict) -> np.ndarray:
    numbers = np.frombuffer(base64.b64decode(array["data"]), f"<u{array['bits'] // 8}")
    return array["low"] + array["step"] * numbers.reshape(array["shape"]).astype(float)


class TestRecordings:
    def test_quantiles_of_errors(self, made):
        """Over the fixes, and over the positions, of all episodes, to the width of a class."""
        for trace, recording in zip(made.traces, made.recordings.values(), strict=True):
            error = np.linalg.norm(trace.fix - trace.heard_position, axis=-1)[usable(trace)]
            found = error_quantiles(recording.fixes.sum(axis=0), (0.05, 0.5, 0.95))
            assert found == pytest.approx(np.quantile(error, [0.05, 0.5, 0.95]), rel=0.08)
            assert recording.fixes.sum() == len(error)
            error = np.linalg.norm(trace.estimate - trace.auv_position, axis=-1)
            found = error_quantiles(recording.positions.sum(axis=0), (0.05, 0.5, 0.95))
            assert found == pytest.approx(np.quantile(error, [0.05, 0.5, 0.95]), rel=0.08)
            assert recording.positions.sum() == error.size
            last = error_quantiles(recording.positions[59 * 100 // 60], (0.5,))[0]
            assert last == pytest.approx(np.median(error[-1:]), rel=0.5)
        assert np.isnan(error_quantiles(np.zeros((2, len(ERRORS) - 1)), (0.5,))).all()


class TestPage:
    def test_tables_have_the_scores(self, made):
        tables = Elements(made.text).tables
        expected = column_tables(made.scenario, compared(made.rows))
        assert len(tables) == len(expected) == 3
        fim, hold = ([row.columns() for row in made.rows if row.usv == usv] for usv in ("fim", "hold:0,0"))
        for table, shown in zip(tables, expected.values(), strict=True):
            assert [row[0].split("\n") for row in table[1:]] == [
                ["straight", f"{u} · tour"] for u in ("fim", "hold:0,0")
            ]
            for cell, column in zip(table[2][1:], shown, strict=True):
                if column.name in COUNTS or any(math.isnan(row[column.name]) for row in fim + hold):
                    continue
                mean, difference = cell.split("\n")
                own, other = (np.array([row[column.name] for row in rows], float) for rows in (hold, fim))
                for text, values in ((mean, own), (difference, own - other)):
                    numbers = [float(part.replace("−", "-").replace(",", "")) for part in text.split(" ± ")]
                    half = stats.t.ppf(0.975, EPISODES - 1) * stats.sem(values)
                    exact, digits = [values.mean(), half], len(text.partition(" ")[0].partition(".")[2])
                    assert numbers == pytest.approx(exact[: len(numbers)], abs=0.501 * 0.1**digits), (column, text)
                    assert len(numbers) == 2 or half == 0

    def test_the_head_says_who_is_ahead(self, made):
        head, comparison = made.text.partition("</header>")[0], compared(made.rows)
        assert f"<li>{sentences(comparison, 'delivered_mbit')[0]}</li>" in head

    def test_needs_nothing_else(self, made):
        check_alone(made.folder)

    def test_figures_are_described_and_follow_the_theme(self, made):
        check_figures(made.folder, {"ages", "errors", "front", "trajectories"})

    def test_names_are_escaped(self, made, tmp_path):
        name, recordings = "</script><b>policy & 1", Recordings(2)
        for trace in made.traces:
            recordings.add(replace(trace, policy=name), 0)
        rows = [replace(row, policy=name) for row in made.rows]
        text = page.write(tmp_path, made.scenario, 4, compared(rows), recordings).read_text(encoding="utf-8")
        assert "<b>policy" not in text
        assert len(embedded(text)["episodes"]) == 2

    def test_says_how_it_was_made(self, made):
        said = html.unescape(made.text)
        assert made.scenario.to_toml() in said
        for words in ("Python 3.", "usvauv ", "taichi 1.7.4", "torch 2", "numpy ", "kernels on", "seed 4;"):
            assert words in said

    def test_is_the_same_again(self, made, tmp_path):
        page.write(tmp_path, made.scenario, 4, compared(made.rows), made.recordings)
        for path in made.folder.iterdir():
            assert path.read_bytes() == (tmp_path / path.name).read_bytes()


class TestPlayer:
    def test_data_are_those_of_the_trace(self, made):
        """Within half of the step that each array states."""
        data = embedded(made.text)
        assert data["area"] == [200, 200]
        assert [episode["name"] for episode in data["episodes"]] == ["fim", "hold:0,0"]
        for episode, trace in zip(data["episodes"], made.traces, strict=True):
            expected = {
                "time": trace.time,
                "auv": trace.auv_position[:, 0],
                "estimate": trace.estimate[:, 0],
                "target": trace.target[:, 0],
                "hovering": trace.hovering[:, 0],
                "boat": trace.boat_position[:, 0],
                "node": trace.node_position[:1],
                "fill": trace.backlog[:, 0] / 5000,
                "data": np.cumsum(trace.delivered[:, 0].sum(axis=1)),
                "energy": np.cumsum(trace.power[:, 0].sum(axis=1)) / 3600,
            }
            for name, values in expected.items():
                step = episode[name]["step"]
                assert decoded(episode[name]).shape == values.shape
                assert np.abs(decoded(episode[name]) - values).max() <= 0.5001 * step + 1e-6
            assert max(episode[name]["step"] for name in ("auv", "estimate", "boat")) < 0.01
            centre, circulation, core = map(decoded, episode["vortex"])
            period = trace.scenario.current.period  # a vortex that leaves comes in on the other side
            apart = centre - trace.vortex[:, 0, :, :2]
            assert np.abs(apart - period * np.round(apart / period)).max() < 0.01
            deep = math.exp(-trace.scenario.auv.depth / trace.scenario.current.decay_depth)
            assert circulation == pytest.approx(deep * trace.vortex[:, 0, :, 2], abs=0.01)
            assert core == pytest.approx(trace.vortex[:, 0, :, 3], abs=0.01)


def test_of_targets_that_move_it_shows_estimates_errors_and_where_they_get(tmp_path):
    """Estimates are 1.2 m off; all is within 600 m of a sea of 2400 m."""
    trace = following(synthetic_trace(steps=40, auvs=3, nodes=2, area=(600.0, 600.0)))
    recordings = Recordings(1)
    recordings.add(trace, 0)
    page.write(tmp_path, trace.scenario, 0, compared(episode_metrics(trace)), recordings)
    text = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "Errors of targets and positions" in text
    (recording,) = recordings.values()
    assert error_quantiles(recording.targets.sum(axis=0), (0.01, 0.99)) == pytest.approx(1.2, rel=0.06)
    data = embedded(text)
    (episode,) = data["episodes"]
    assert decoded(episode["tracked"]) == pytest.approx(trace.node_estimate[:, 0], abs=0.01)
    west, south, width, length = data["shown"]
    ways = [getattr(trace, name)[:, 0] for name in ("auv_position", "boat_position", "node_way")]
    shown = np.concatenate(ways, axis=1) - (west, south)
    assert (shown >= 0).all()
    assert (shown <= (width, length)).all()
    assert max(width, length) < 1000


def test_stations_have_no_figures_of_data(tmp_path):
    """And one episode has no intervals."""
    trace = keeping_station(synthetic_trace(steps=8))
    recordings = Recordings(1)
    recordings.add(trace, 0)
    page.write(tmp_path, trace.scenario, 0, compared(episode_metrics(trace)), recordings)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["errors.pdf", "index.html", "trajectories.pdf"]
    text = (tmp_path / "index.html").read_text(encoding="utf-8")
    for words in ("Mbit", "Age of data", "±"):
        assert words not in text.partition("<script>")[0].partition("<h2>How it was made")[0], words
    assert "off station, m" in text


def test_a_figure_that_no_episode_has_is_a_dash(run_usvauv, tmp_path):
    """Two steps are too short for a service, and fixes that never arrive have no error to draw."""
    none = ["--set", "mission.duration=2", "--set", "usbl.packet_loss=0.999999", "--episodes", 2, "--usv", "hold:0,0"]
    code, said, _ = run_usvauv("eval", "ideal", "--policy", "straight", *none, "--report", "deep/er", "--wide")
    assert code == 0
    folder = tmp_path / "deep" / "er"
    assert f"report: {folder / 'index.html'}\n" in said
    *_, line = (line for line in said.splitlines() if line.startswith("straight"))
    assert re.split("  +", line.rstrip())[-5:] == ["–", "0.00 ± 0.00", "–", "–", "2 ± 0"]
    (row, _) = read_rows(tmp_path / "metrics.csv")
    assert [row[name] for name in ("fix_error_median", "fix_error_rms", "fix_wrapped")] == ["nan"] * 3
    assert sorted(path.stem for path in folder.glob("*.pdf")) == ["ages", "errors", "front", "trajectories"]
    text = (folder / "index.html").read_text(encoding="utf-8")
    _, ages, fixes = Elements(text).tables
    assert ages[1][-1] == "–"
    assert fixes[1][5] == "–"
    assert "nan" not in "".join(cell for row in ages + fixes for cell in row)


TRY = """
  const [canvas, second] = document.querySelectorAll("canvas"), slider = document.getElementById("time"), pictures = {};
  const look = (name) => { pictures[name] = canvas.toDataURL(); };
  const away = () => second.getBoundingClientRect().width;
  const beside = [away(), canvas.getBoundingClientRect().width, second.toDataURL() !== canvas.toDataURL()];
  const change = (id, values, kind) => {
    Object.assign(document.getElementById(id), values);
    document.getElementById(id).dispatchEvent(new Event(kind));
  };
  const scrub = (share) => change("time", { value: +slider.min + share * (slider.max - slider.min) }, "input");
  scrub(0); look("start");
  scrub(0.5); look("middle");
  const said = [...document.querySelectorAll("output")].map((each) => each.value);
  change("other", { value: 0 }, "change");
  const same = second.toDataURL() === canvas.toDataURL();
  change("other", { value: -1 }, "change");
  scrub(0); look("start"); scrub(0.5); look("middle");
  const alone = away();
  change("current", { checked: true }, "change"); look("current");
  change("magnify", { value: 1 }, "change"); look("true size");
  change("episode", { value: 1 }, "change"); look("other");
  change("episode", { value: 0 }, "change");
  change("current", { checked: false }, "change");
  scrub(0); look("start with true size");
  const play = document.getElementById("play"), before = +slider.value, words = [play.textContent];
  play.click(); words.push(play.textContent);
  await new Promise((resolve) => setTimeout(resolve, 1000));
  play.click(); words.push(play.textContent);
  const different = new Set(Object.values(pictures)).size;
  const scrolls = [...document.querySelectorAll(".scroll")].filter((each) => each.scrollWidth > each.clientWidth);
  return { different, said, beside, same, alone, words, scrolls: scrolls.length, played: slider.value - before };
"""


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
@pytest.mark.parametrize("width", [360, 1280])
def test_in_a_browser(made, tmp_path, width):
    """No problem is reported, the player draws what it is asked for, two episodes side by side at first, and neither
    the page nor a table is wider than the window.
    """
    answer = in_browser(made.text, tmp_path, width, TRY)
    assert answer["different"] == 6
    assert answer["words"] == ["Play", "Pause", "Play"]
    assert answer["played"] > 0
    first, other = answer["said"]
    assert re.fullmatch(r"fim · 0:30 min · [\d.]+ Wh · [\d.]+ Mbit · estimates off by [\d.]+, [\d.]+ m", first)
    assert other.startswith("hold:0,0 · 0:30 min · ")
    across, own, unlike = answer["beside"]
    assert (across, unlike) == (own, True)
    assert (answer["same"], answer["alone"]) == (True, 0)
    assert answer["scrolls"] == 0


def in_cell(*traces) -> str:
    """The page in the cell of a notebook."""
    ((tag, attributes),) = Elements(play(*traces)._repr_html_()).found
    assert tag == "iframe"
    return attributes["srcdoc"]


def test_a_cell_of_a_notebook_has_the_player_and_needs_nothing_else(made):
    text = in_cell(*made.traces)
    assert not [name for _, given in Elements(text).found for name in given if name in ("src", "href")]
    assert "default-src 'none'" in html.unescape(text)
    shown, expected = embedded(text), embedded(made.text)
    assert [each["name"] for each in shown["episodes"]] == ["fim", "hold:0,0"]
    assert shown == expected, "so short an episode is kept whole in both"
    with pytest.raises(UserError, match="0 areas"):
        play()
    elsewhere = Scenario.load("extreme", ["area.width=300"])
    with pytest.raises(UserError, match="2 areas"):
        play(made.traces[0], replace(made.traces[0], scenario=elsewhere))
