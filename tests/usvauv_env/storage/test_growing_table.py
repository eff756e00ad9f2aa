"""A table that grows by batches, is cut anywhere, and is taken up again."""

import os
from itertools import product
from pathlib import Path

import pytest

from usvauv.env.record.metrics import COLUMNS
from usvauv.env.storage.files import OutputError
from usvauv.env.storage.result_tables import ABOUT as DEFINITION
from usvauv.env.storage.result_tables import Combination, growing_table, write_rows
from usvauv.kernels.errors import UserError

ABOUT = {"definition": {"seed": 3}, "batch": 4}
PAIR = (Combination("straight", "fim", "tour"), Combination('runs/a, "b"\nc', "fim", "tour"))
BATCHES = ((0, 4), (4, 4), (8, 2))


def rows_of(which, first, count):
    """Rows whose figures have all their digits, and one NaN."""
    about = {"scenario": "ideal", "seed": 3, "fix_wrapped": float("nan"), **which._asdict()}
    return [
        {name: (about | {"episode": e}).get(name, (e + 1) / 7 + len(which.policy) / 3) for name in COLUMNS}
        for e in range(first, first + count)
    ]


def fill(out, resume, batches=BATCHES, finish=True):
    """Go on to the end, which may leave the table as a process does that is stopped; returns what was appended."""
    appended = []
    with growing_table(out, resume) as table:
        if table.about is None:
            table.begin(ABOUT)
        assert table.about == ABOUT
        for first, count in batches:
            for which in PAIR:
                rows, taken = rows_of(which, first, count), table.take(which, first, count)
                if taken is None:
                    table.append(which, rows)
                    appended.append((which, first))
                else:
                    assert taken == [{name: str(value) for name, value in row.items()} for row in rows]
        assert table.count == 2 * sum(count for _, count in batches)
        if finish:
            table.finish()
    return appended


def whole(path, batches=BATCHES):
    """What `write_rows` makes of all rows, by combination."""
    rows = [row for which in PAIR for first, count in batches for row in rows_of(which, first, count)]
    write_rows(path, COLUMNS, rows)
    return path.read_bytes()


@pytest.mark.parametrize("left", range(7))
def test_wherever_it_is_cut_the_end_is_the_same(tmp_path, left):
    out = tmp_path / "m.csv"
    fill(out, resume=False, finish=False)
    for number, (first, count) in list(product(range(2), BATCHES))[left:]:
        (tmp_path / "m.csv.partial" / f"{number}-{first}-{count}.csv").unlink()
    assert len(fill(out, resume=True)) == 6 - left
    assert out.read_bytes() == whole(tmp_path / "whole.csv")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["m.csv", "whole.csv"]


@pytest.mark.parametrize(
    ("batches", "made"), [(((0, 4), (4, 2)), 2), (((0, 4), (4, 4)), 0), (((0, 4), (4, 4), (8, 4), (12, 1)), 4)]
)
def test_other_numbers_of_episodes_keep_the_batches_that_are_the_same(tmp_path, batches, made):
    out = tmp_path / "m.csv"
    fill(out, resume=False, finish=False)
    assert len(fill(out, resume=True, batches=batches)) == made
    assert out.read_bytes() == whole(tmp_path / "whole.csv", batches)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["m.csv", "whole.csv"]


@pytest.mark.parametrize("kind", ["pipe", "file", "link", "folder"])
def test_what_is_there_is_never_overwritten(tmp_path, kind):
    path, other = tmp_path / "m.csv.partial", tmp_path / "other" / "mine.csv"
    other.parent.mkdir()
    other.write_text("mine")
    {"pipe": os.mkfifo, "file": Path.touch, "link": lambda path: path.symlink_to("other"), "folder": Path.mkdir}[kind](
        path
    )
    if kind == "folder":
        other = other.rename(path / "mine.csv")
    for resume in (False, True):
        with pytest.raises(OutputError, match=r"m\.csv\.partial: "), growing_table(tmp_path / "m.csv", resume):
            pass
    assert other.read_text() == "mine"


def test_only_what_is_there_is_resumed(tmp_path):
    out = tmp_path / "m.csv"
    with pytest.raises(UserError, match=r"m\.csv\.partial: does not exist"), growing_table(out, True):
        pass
    with growing_table(out, False) as table:
        table.begin(ABOUT)
        with pytest.raises(OutputError, match=r"m\.csv\.partial: process \d+ is writing"), growing_table(out, True):
            pass
    assert list(tmp_path.iterdir()) == []
    fill(out, resume=False, finish=False)
    with pytest.raises(UserError, match=r"m\.csv\.partial: holds .* --resume .*, --force "), growing_table(out, False):
        pass
    (tmp_path / "m.csv.partial" / DEFINITION).write_text("{")
    with pytest.raises(OutputError, match=r"evaluation\.json: not valid JSON.*; remove"), growing_table(out, True):
        pass
    with growing_table(out, False, force=True) as table:
        assert table.about is None
    assert list(tmp_path.iterdir()) == []


def test_what_a_killed_process_left_before_its_first_batch_is_in_nobodys_way(tmp_path):
    (tmp_path / "m.csv.partial").mkdir()
    for left in (".lock", "evaluation.json.there-1.partial", "0-0-2.csv.there-1.partial"):
        (tmp_path / "m.csv.partial" / left).touch()
    fill(tmp_path / "m.csv", resume=False)
    assert [path.name for path in tmp_path.iterdir()] == ["m.csv"]
