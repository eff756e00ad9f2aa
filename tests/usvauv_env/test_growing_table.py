"""A table that grows by batches, is cut anywhere, and is taken up again."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from usvauv.env.record.metrics import COLUMNS
from usvauv.env.storage.files import OutputError
from usvauv.env.storage.tables import Combination, GrowingTable, write_rows
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


def fill(out, resume, batches=BATCHES):
    """Go on to the end; returns the batches that were appended."""
    appended = []
    with GrowingTable(out, resume, COLUMNS) as table:
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
        table.finish()
    return appended


@pytest.fixture
def whole(tmp_path):
    """What `write_rows` makes of all rows, by combination."""
    rows = [row for which in PAIR for first, count in BATCHES for row in rows_of(which, first, count)]
    write_rows(tmp_path / "whole.csv", COLUMNS, rows)
    return (tmp_path / "whole.csv").read_bytes()


def partial_of(out, batches=BATCHES):
    """The partial file of some batches, as a process leaves it that is killed before the end."""
    with GrowingTable(out, False, COLUMNS) as table:
        table.begin(ABOUT)
        for first, count in batches:
            for which in PAIR:
                assert table.take(which, first, count) is None
                table.append(which, rows_of(which, first, count))
        return table.path.read_bytes()


def test_the_end_is_the_table_of_all_rows(tmp_path, whole):
    out = tmp_path / "m.csv"
    assert len(fill(out, resume=False)) == 6
    assert out.read_bytes() == whole
    assert sorted(path.name for path in tmp_path.iterdir()) == ["m.csv", "whole.csv"]


def test_wherever_it_is_cut_the_end_is_the_same(tmp_path, whole):
    """Batches that are whole are kept, no others."""
    data = partial_of(tmp_path / "a.csv")
    out = tmp_path / "m.csv"
    left = {}
    for length in [*range(0, len(data), 397), *range(len(data) - 5, len(data) + 1)]:
        (tmp_path / "m.csv.partial").write_bytes(data[:length])
        left[length] = fill(out, resume=True)
        assert out.read_bytes() == whole
    sizes = [len(appended) for appended in left.values()]
    assert sizes == sorted(sizes, reverse=True)
    assert set(sizes) == {0, 1, 2, 3, 4, 5, 6}
    assert (len(left[len(data) - 1]), left[len(data)]) == (1, [])


def test_other_numbers_of_episodes_keep_the_batches_that_are_the_same(tmp_path, whole):
    data = partial_of(tmp_path / "a.csv")
    out = tmp_path / "m.csv"
    for batches, expected in ((((0, 4), (4, 2)), 2), (((0, 4), (4, 4)), 0), (((0, 4), (4, 4), (8, 4), (12, 1)), 4)):
        (tmp_path / "m.csv.partial").write_bytes(data)
        assert len(fill(out, resume=True, batches=batches)) == expected
        rows = [row for which in PAIR for first, count in batches for row in rows_of(which, first, count)]
        write_rows(tmp_path / "expected.csv", COLUMNS, rows)
        assert out.read_bytes() == (tmp_path / "expected.csv").read_bytes()


def test_rows_are_on_the_disk_when_the_process_is_killed(tmp_path, whole):
    child = """
import os, pathlib, signal, sys
from tests.usvauv_env.test_growing_table import *
with GrowingTable(pathlib.Path(sys.argv[1]), False, COLUMNS) as table:
    table.begin(ABOUT)
    for which in PAIR:
        table.append(which, rows_of(which, 0, 4))
    os.kill(os.getpid(), signal.SIGKILL)
"""
    out = tmp_path / "m.csv"
    done = subprocess.run([sys.executable, "-c", child, out], check=False)
    assert done.returncode == -signal.SIGKILL
    assert len(fill(out, resume=True)) == 4
    assert out.read_bytes() == whole


def test_a_batch_drops_all_that_followed_in_the_file(tmp_path):
    """At once, so that rows of another run are not taken for its own after a further stop."""
    (tmp_path / "m.csv.partial").write_bytes(partial_of(tmp_path / "a.csv"))
    with GrowingTable(tmp_path / "m.csv", True, COLUMNS) as table:
        for which in PAIR:
            assert table.take(which, 0, 4)
        for which in PAIR:
            assert table.take(which, 4, 1) is None
            table.append(which, rows_of(which, 4, 1))
        assert table.path.read_bytes() == partial_of(tmp_path / "b.csv", ((0, 4), (4, 1)))


@pytest.mark.parametrize("wrong", [b"much", b"", b"1e999", b"\xff", b"1,1", b'"' + 200_000 * b"1" + b'"'])
def test_a_row_that_is_none_is_made_again_with_its_batch(tmp_path, whole, wrong):
    out = tmp_path / "m.csv"
    lines = partial_of(out).split(b"\n")
    before = lines[-2].split(b",")
    lines[-2] = b",".join([*before[:-2], wrong, before[-1]])
    (tmp_path / "m.csv.partial").write_bytes(b"\n".join(lines))
    assert fill(out, True) == [(PAIR[1], 8)]
    assert out.read_bytes() == whole


@pytest.mark.parametrize("kind", ["pipe", "folder", "link"])
def test_what_is_no_file_is_refused(tmp_path, kind):
    path = tmp_path / "m.csv.partial"
    if kind == "link":
        (tmp_path / "other").write_bytes(partial_of(tmp_path / "a.csv"))
    {"pipe": os.mkfifo, "folder": Path.mkdir, "link": lambda path: path.symlink_to("other")}[kind](path)
    for resume in (False, True):
        with pytest.raises(OutputError, match=r"m\.csv\.partial: is no file of its own; remove it$"):
            GrowingTable(tmp_path / "m.csv", resume, COLUMNS)


def test_without_rows_nothing_is_left(tmp_path):
    with GrowingTable(tmp_path / "m.csv", False, COLUMNS) as table:
        table.begin(ABOUT)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "m.csv.partial").write_bytes(b"# usvauv eval {")  # of a process that was killed with the first row
    with GrowingTable(tmp_path / "m.csv", True, COLUMNS) as table:
        assert table.about is None
    assert list(tmp_path.iterdir()) == []


def test_what_is_there_is_never_overwritten(tmp_path):
    out = tmp_path / "m.csv"
    with pytest.raises(UserError, match=r"m\.csv\.partial: is not there"):
        GrowingTable(out, True, COLUMNS)
    data = partial_of(out)
    with pytest.raises(UserError, match=r"m\.csv\.partial: holds episodes .* --resume"):
        GrowingTable(out, False, COLUMNS)
    for resume in (False, True):
        for other in (
            b"mine\n",
            data.replace(b'"batch"', b'"batch'),
            data.replace(b"scenario,policy", b"a,b"),
            data.replace(b",arps,", b",\xff,"),
            *(data.replace(b'"batch": 4', b'"batch": ' + wrong) for wrong in (b"0", b"true", b"4.0", b"null", b'"4"')),
            data.replace(b'{"seed": 3}', b"5"),
            data.replace(b'{"seed": 3}', 5000 * b"[" + 5000 * b"]"),
        ):
            assert other != data
            (tmp_path / "m.csv.partial").write_bytes(other)
            with pytest.raises(OutputError, match=r"m\.csv\.partial: (is not of|its first lines are damaged)"):
                GrowingTable(out, resume, COLUMNS)
            assert (tmp_path / "m.csv.partial").read_bytes() == other


def test_one_process_at_a_time(tmp_path):
    out = tmp_path / "m.csv"
    with (
        GrowingTable(out, False, COLUMNS),
        pytest.raises(OutputError, match=r"m\.csv\.partial: another process is writing there"),
    ):
        GrowingTable(out, True, COLUMNS)
