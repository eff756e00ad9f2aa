"""`usvauv reproduce`: statistics by hand, the paper's numbers, nothing done twice, stopping and going on, the page."""

from __future__ import annotations

import csv
import dataclasses
import json
import math
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import torch

from usvauv import policies
from usvauv.cli.reproduction import fig3, fig4b, fixes, paper, pool, settings, table2, targets
from usvauv.cli.reproduction.runs import TESTED, Heuristic, Learned
from usvauv.cli.reproduction.settings import FULL, METHODS, QUICK, Settings
from usvauv.env.storage.tables import read_rows, write_rows
from usvauv.kernels.errors import UserError
from usvauv.policies import TrainingConfig, checkpoint

COMMAND = [sys.executable, "-c", "from usvauv.cli.app import main; main()"]
TINY_RUN = {"num_worlds": 4, "hidden": (8,), "batch": 16, "warmup": 40, "n_step": 2, "replay": 400}
TINY = Settings(
    methods=tuple(dataclasses.replace(m, config=dataclasses.replace(m.config, **TINY_RUN)) for m in METHODS),
    seeds=(0, 1),
    steps=160,
    evaluations=2,
    judged=2,
    episodes=2,
    fix_episodes=2,
    overrides=("mission.duration=20",),
)
ESC = paper.CONDITIONS["ESC"]


def reproduce(target: str, folder: Path, wanted: Settings = TINY) -> Path:
    return targets.reproduce(target, wanted, folder, 1, f"usvauv reproduce {target} --out DIR", lambda words: None)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A folder in which everything is reproduced, and its page."""
    folder = tmp_path_factory.mktemp("whole")
    return folder, reproduce("all", folder)


class TestNumbers:
    def test_the_papers_are_the_papers(self):
        printed = """
            DDPG ISC 6.63±0.97 73.72±1.11 -80.70±6.94
            DDPG ESC 6.35±1.57 77.23±0.89 -82.28±7.41
            SAC ISC 5.97±2.66 111.57±13.23 -87.86±13.10
            SAC ESC 5.58±2.35 117.76±17.30 -89.58±15.22
        """
        for line in printed.strip().splitlines():
            method, condition, *cells = line.split()
            ours = paper.printed(method.lower(), condition)
            for name, cell in zip(("sdr", "ec", "arps"), cells, strict=True):
                assert ours[name] == tuple(map(float, cell.split("±")))
        for condition in ("ISC", "ESC"):
            assert paper.printed("baseline", condition) == {
                "sdr": (5.93, 3.51), "ec": (112.30, 10.56), "arps": (-87.95, 12.08),
            }  # fmt: skip
        assert paper.printed("td3", "ISC") == {}
        assert paper.FIG_4B == {"fim": 0.002, "hold:100,100": 0.003, "hold:0,0": 0.1}

    def test_statistics_by_hand(self):
        def episode(run, arps, sdr, updates):
            figures = dict.fromkeys(("ec", "services", "delivered_mbit", "collisions", "border"), "1")
            return {
                "run": run,
                "usv": "fim",
                "updates": updates,
                "arps": arps,
                "sdr": sdr,
                "collaboration": "2",
            } | figures

        first = [episode("0", "1", "6", "0"), episode("0", "3", "6", "0")]
        second = [episode("1", "5", "6", "9"), episode("1", "11", "6", "9")]
        row = table2.pool("sac", "SAC", "ISC", "ESC", [first, second])
        assert (row.name, row.runs, row.untrained_runs, row.episodes) == ("SAC (ESC)", 2, 1, 4)
        assert row.mean["arps"] == 5.0
        assert row.sd["arps"] == pytest.approx(math.sqrt((16 + 4 + 0 + 36) / 3))
        assert row.runs_sd["arps"] == pytest.approx(math.sqrt(2 * 3.0**2))  # means 2 and 8
        assert row.mean["arps_without_eq5"] == 3.0
        assert (row.mean["sdr"], row.sd["sdr"]) == (6.0, 0.0)
        assert row.printed["sdr"] == (5.58, 2.35)

    def test_level_by_hand(self, tmp_path):
        path = fixes.results(tmp_path, ESC, "fim")[1]
        rows = [dict(zip(fixes.OVER_EPISODES, (0, w, m, 10 * m), strict=True)) for w, m in enumerate((1, 2, 9))]
        write_rows(path, fixes.OVER_EPISODES, rows)
        level = fig4b.level(tmp_path, ESC, "fim")
        assert (level.episodes, level.median, level.p95, level.paper) == (3, 2.0, 20.0, 0.002)
        assert 1.0 <= level.low <= 2.0 <= level.high <= 9.0

    def test_band_is_mean_worst_and_best_run(self):
        rows = [
            {"method": "sac", "condition": "ISC", "run": run, "steps": steps, "ec": ec}
            for run, steps, ec in ((0, 0, 1.0), (0, 10, 2.0), (1, 0, 3.0), (1, 10, 6.0))
        ]
        other = [{"method": "ddpg", "condition": "ISC", "run": 0, "steps": 0, "ec": 100.0}]
        np.testing.assert_array_equal(fig3.band(rows + other, "sac", "ISC", "ec"), [[0, 10], [2, 4], [1, 2], [3, 6]])


class TestSettings:
    def test_the_full_one_has_five_seeds(self):
        assert len(set(FULL.seeds)) >= 5
        assert QUICK.steps * len(QUICK.seeds) < 0.1 * FULL.steps * len(FULL.seeds)
        assert {method.key for method in FULL.methods} == {"ddpg", "sac", "td3", "baseline", "data"}

    def test_baseline_is_maisac(self):
        baseline = FULL.method("baseline")
        config = baseline.config
        assert (config.algorithm, config.learning_rate, config.gamma, config.tau) == ("sac", 3e-4, 0.99, 0.01)
        assert (config.shared, baseline.usv) == (False, "hold:100,100")
        learning, tested = (FULL.scenario(ESC, changes) for changes in (baseline.learning, baseline.testing))
        assert (learning.observation.current, learning.reward.collaboration) == ("none", 0.0)
        assert (tested.observation.current, tested.reward.collaboration) == ("none", 0.1)

    def test_changed_settings_are_refused(self, tmp_path):
        settings.record(TINY, tmp_path)
        settings.record(TINY, tmp_path)
        with pytest.raises(UserError, match=r"was begun with steps = 160, now it would be 161"):
            settings.record(dataclasses.replace(TINY, steps=161), tmp_path)
        faster = dataclasses.replace(TINY.methods[1], config=TrainingConfig(**{**TINY_RUN, "gamma": 0.5}))
        changed = dataclasses.replace(TINY, methods=(TINY.methods[0], faster, *TINY.methods[2:]))
        with pytest.raises(UserError, match=r"methods\[1\]\.config\.gamma = 0\.99, now it would be 0\.5;"):
            settings.record(changed, tmp_path)
        longer = dataclasses.replace(TINY, overrides=("mission.duration=21",))
        with pytest.raises(UserError, match="now it would be"):
            settings.record(longer, tmp_path)

    def test_a_changed_scenario_is_refused(self, tmp_path):
        settings.record(TINY, tmp_path)
        path = tmp_path / settings.RECORD
        recorded = json.loads(path.read_text())
        recorded["scenarios"][ESC]["reward"]["service"] = 11.0
        path.write_text(json.dumps(recorded))
        with pytest.raises(UserError, match=rf"scenarios\.{ESC}\.reward\.service = 11\.0, now it would be 12\.0"):
            settings.record(TINY, tmp_path)


class TestWhole:
    def test_tables_have_their_columns(self, whole):
        results = whole[0] / "reproduction"
        for name, columns, rows in (
            ("table2", table2.COLUMNS, 4 * len(METHODS) + 3 * 2),
            ("fig3", fig3.COLUMNS, 2 * 2 * 2 * 3),
            ("fig4b", fig4b.SUMMARY, 2 * 5),
            ("fig4b-over-time", fig4b.TIMES, 2 * 5 * 20),
            ("fig4a", ("scenario", "time", "vehicle", "x", "y"), 2 * 3 * 20),
        ):
            with (results / f"{name}.csv").open() as stream:
                read = list(csv.DictReader(stream))
            assert tuple(read[0]) == columns
            assert len(read) == rows
        for name in targets.FIGURES:
            light, dark = ((results / f"{name}-{theme}.png").read_bytes() for theme in ("light", "dark"))
            assert light[:4] == dark[:4] == b"\x89PNG"
            assert light != dark
            assert (results / f"{name}.pdf").read_bytes().startswith(b"%PDF")

    def test_the_page_links_to_what_is_there(self, whole):
        folder, page = whole
        text = page.read_text()
        links = [*re.findall(r"\]\(([^)]+)\)", text), *re.findall(r'(?:src|srcset)="([^"]+)"', text)]
        assert len(links) >= 4 * 4
        assert all((folder / link).is_file() for link in links)
        assert not any(link.startswith("/") for link in links)
        assert str(folder) not in text
        for words in ("6.63 ± 0.97", "−87.95 ± 12.08", "Seeds of the training runs: 0, 1", "Time taken", "noise_law"):
            assert words in text

    def test_tests_are_paired_and_complete(self, whole):
        folder = whole[0]
        run = Learned("ddpg", ESC, 1, True)
        rows = read_rows(run.results(folder)[ESC])
        assert tuple(rows[0]) == TESTED
        straight = read_rows(Heuristic("straight", ESC).result(folder))
        assert [row["episode"] for row in straight] == ["0", "1", "2", "3"]
        assert [row["episode"] for row in rows] == ["2", "3"]  # the second run's
        assert {row["seed"] for row in rows + straight} == {"2026"}

    def test_nothing_is_done_twice(self, whole, monkeypatch):
        folder, page = whole
        kept = {
            path: path.stat().st_mtime_ns
            for part in ("runs", "evaluations")
            for path in (folder / part).rglob("*")
            if path.is_file()
        }
        monkeypatch.setattr(policies.Trainer, "train", lambda *_: pytest.fail("trained again"))
        monkeypatch.setattr(pool, "_alone", lambda *_: pytest.fail("worked again"))
        before = page.read_text()
        assert reproduce("all", folder) == page
        assert {path: path.stat().st_mtime_ns for path in kept} == kept
        timeless = re.compile("Time taken.*")
        assert timeless.sub("", page.read_text()) == timeless.sub("", before)

    def test_a_missing_evaluation_alone_is_made_again(self, whole):
        folder = whole[0]
        path = Learned("sac", ESC, 0, True).results(folder)["paper-ideal"]
        before = path.read_bytes()
        path.unlink()
        assert sum(piece.left(TINY, folder) > 0 for piece in targets.needed(("table2",), TINY)) == 1
        reproduce("table2", folder)
        assert path.read_bytes() == before

    def test_curves_are_the_runs_evaluations(self, whole):
        folder = whole[0]
        rows = [
            row
            for row in fig3.curves(TINY, folder)
            if (row["method"], row["condition"], row["run"]) == ("sac", "ESC", 1)
        ]
        assert [row["steps"] for row in rows] == [0, 80, 160]
        assert [row["episode_equivalents"] for row in rows] == [0.0, 4.0, 8.0]
        about = policies.read_run(folder / "runs" / f"sac-{ESC}-1")[2]
        assert rows[-1]["arps"] == about["evaluation"]["arps"]


def interrupting(after: int):
    """What stops work after so many reports, as Ctrl-C would."""
    reports = 0

    def advance(units: float) -> None:
        nonlocal reports
        reports += 1
        if reports == after:
            os.kill(os.getpid(), signal.SIGINT)

    return advance


def test_a_stopped_run_goes_on_bit_for_bit(tmp_path, monkeypatch):
    run = Learned("ddpg", ESC, 0, False)
    pool.run([run], TINY, tmp_path / "one", 1, print)
    in_one_go = run.place(tmp_path / "one")

    # During training; the evaluation of the untrained policy takes the first 20 reports.
    monkeypatch.setattr("usvauv.policies.training.trainer.WINDOW", 5)
    folder = tmp_path / "two"
    with pytest.raises(KeyboardInterrupt):
        pool._alone([run], TINY, folder, interrupting(22))
    left = run.left(TINY, folder)
    assert 0 < left < run.left(TINY, tmp_path / "none")
    pool.run([run], TINY, folder, 1, print)
    assert run.left(TINY, folder) == 0
    assert policies.read_history(run.place(folder)) == policies.read_history(in_one_go)
    for part in ("best", "last"):
        one, two = (
            checkpoint.read(place / f"{part}.safetensors", checkpoint.POLICY)[1]
            for place in (in_one_go, run.place(folder))
        )
        assert all(torch.equal(one[name], two[name]) for name in one)


def test_an_interrupted_evaluation_leaves_no_table(tmp_path):
    piece = Heuristic("straight", ESC)
    with pytest.raises(KeyboardInterrupt):
        pool._alone([piece], TINY, tmp_path, interrupting(7))
    assert not piece.result(tmp_path).exists()
    assert list(tmp_path.rglob("*.partial")) == []


@pytest.mark.slow
def test_processes_do_what_one_does(tmp_path, whole, monkeypatch):
    plugin, loaded_by = tmp_path / "plugin.py", tmp_path / "loaded_by"
    plugin.write_text(f"import os\nwith open({str(loaded_by)!r}, 'a') as file: print(os.getpid(), file=file)")
    monkeypatch.setattr("usvauv.env.plugins.loaded", lambda: [plugin])
    pieces = [Heuristic("straight", ESC), Heuristic("crab", "paper-ideal")]
    pool.run(pieces, TINY, tmp_path, 2, print)
    assert len(set(loaded_by.read_text().split())) == 2
    for piece in pieces:
        assert piece.result(tmp_path).read_bytes() == piece.result(whole[0]).read_bytes()


def test_command_refuses_what_is_no_target(run_usvauv):
    code, _, stderr = run_usvauv("reproduce", "table3", "--out", "a")
    assert (code, stderr) == (2, "error: table3: must be one of table2, fig3, fig4a, fig4b, all, collaboration\n")


@pytest.mark.slow
def test_ctrl_c_ends_all_processes_cleanly(tmp_path):
    command = [*COMMAND, "reproduce", "fig3", "--quick", "--out", "b", "--jobs", "2"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        assert "training runs" in running.stdout.readline()
        while not list((tmp_path / "b" / "runs").glob("*/last.safetensors")):
            time.sleep(0.05)
        running.send_signal(signal.SIGINT)
        said, complaints = running.communicate(timeout=300)
    assert running.returncode == 130
    assert "Traceback" not in complaints
    assert "go on with: usvauv reproduce fig3 --quick --out b" in said
    runs = list((tmp_path / "b" / "runs").glob("*/last.safetensors"))
    assert runs
    assert all(policies.read_run(path.parent)[2]["steps"] > 0 for path in runs)
