"""Files that appear when they are complete, one process at a time in a folder, text files within bounds."""

import errno
import fcntl
import json
import os
import re
import signal
import subprocess
import sys
from contextlib import nullcontext

import h5py
import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from usvauv.env import Scenario
from usvauv.env.storage.files import (
    LARGEST,
    LOCK,
    THIS_HOST,
    OutputError,
    TextFileError,
    atomic_write,
    check_place,
    check_plain,
    hdf5_file,
    locked,
    parse_text,
    read_text,
)


def test_the_file_appears_when_the_block_ends(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("older")
    with atomic_write(path) as partial:
        partial.write_text("newer")
        assert path.read_text() == "older"
    assert path.read_text() == "newer"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("ending", [KeyboardInterrupt, RuntimeError, OSError])
def test_an_older_file_outlives_what_is_cut_short(tmp_path, ending):
    path = tmp_path / "a.txt"
    path.write_text("older")

    def write() -> None:
        with atomic_write(path) as partial:
            partial.write_text("half")
            raise ending

    with pytest.raises(OutputError if ending is OSError else ending):
        write()
    assert path.read_text() == "older"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("place", ["missing/a.txt", "file/a.txt", "folder"])
def test_a_place_that_takes_no_file_is_named_before_work_begins(tmp_path, place):
    (tmp_path / "file").write_text("")
    (tmp_path / "folder").mkdir()
    with pytest.raises(OutputError) as caught, atomic_write(tmp_path / place):
        pytest.fail("the block ran")
    assert str(caught.value).startswith(f"{tmp_path / place}: cannot be written: ")
    assert "\n" not in str(caught.value)


def test_what_a_dead_process_left_is_removed_and_what_a_living_one_writes_is_not(tmp_path):
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    dead, living = (tmp_path / f"a.txt.{THIS_HOST}-{number}.partial" for number in (ended.pid, os.getppid()))
    others = tmp_path / f"b.txt.{THIS_HOST}-{ended.pid}.partial"
    for path in (dead, living, others):
        path.touch()
    with atomic_write(tmp_path / "a.txt") as partial:
        partial.write_text("whole")
    assert sorted(tmp_path.iterdir()) == sorted([tmp_path / "a.txt", living, others])


def test_a_link_stays_a_link_and_a_device_a_device(tmp_path):
    (tmp_path / "link").symlink_to("file")
    with atomic_write(tmp_path / "link") as partial:
        partial.write_text("whole")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "file").read_text() == "whole"
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OutputError, match="pipe: cannot be written"), atomic_write(tmp_path / "pipe"):
        pytest.fail("the block ran")


@pytest.mark.parametrize("kind", ["symbolic", "dangling", "partial", "hard"])
@pytest.mark.parametrize("write", ["lock", "file"])
def test_nothing_outside_is_written_through_a_link(tmp_path, write, kind):
    folder, outside = tmp_path / "folder", tmp_path / "outside"
    folder.mkdir()
    name = LOCK if write == "lock" else "a.txt"
    if kind == "partial":
        name = f"{name}.{THIS_HOST}-{os.getpid()}.partial"
    if kind != "dangling":
        outside.write_text("a letter")
    (os.link if kind == "hard" else os.symlink)(outside, folder / name)
    harmless = kind == "partial" or (write, kind) == ("file", "hard")
    with nullcontext() if harmless else pytest.raises(OutputError, match=f"^{folder}/{name}: "):
        if write == "lock":
            with locked(folder):
                pass
        else:
            with atomic_write(folder / "a.txt") as partial:
                partial.write_text("whole")
    assert outside.exists() == (kind != "dangling")
    assert kind == "dangling" or outside.read_text() == "a letter"


def test_asking_for_a_place_leaves_it_as_it_is(tmp_path):
    (tmp_path / "a.txt").write_text("older")
    check_place(tmp_path / "a.txt")
    check_place(tmp_path / "b.txt")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["older"]
    with pytest.raises(OutputError, match="cannot be written: Is a directory"):
        check_place(tmp_path)


class TestSizeLimit:
    """The system refuses to write more than so many bytes; every library says it in another way."""

    @pytest.mark.parametrize(
        "write", [lambda path: path.write_bytes(bytes(5000)), lambda path: save_file({"a": torch.zeros(5000)}, path)]
    )
    def test_of_python_and_of_safetensors(self, size_limit, tmp_path, write):
        path = tmp_path / "a"
        path.write_text("older")
        with size_limit(), pytest.raises(OutputError) as caught, atomic_write(path) as partial:
            write(partial)
        assert str(caught.value) == f"{path}: cannot be written: File too large"
        assert path.read_text() == "older"
        assert list(tmp_path.iterdir()) == [path]

    def test_hdf5(self, size_limit, tmp_path):
        path = tmp_path / "a"
        path.write_text("older")
        refused = pytest.raises(OutputError, match="a: cannot be written: File too large")
        with size_limit(), refused, hdf5_file(path) as disk, h5py.File(disk, "w") as file:
            file["x"] = np.zeros(5000)
        assert path.read_text() == "older"
        assert list(tmp_path.iterdir()) == [path]


HOLD = """
import sys, time, pathlib
from usvauv.env.storage.files import locked
with locked(pathlib.Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(600)
"""


class TestLock:
    def test_a_second_process_is_refused_by_the_id_of_the_first_and_its_death_opens_the_folder(self, tmp_path):
        with subprocess.Popen([sys.executable, "-c", HOLD, tmp_path], stdout=subprocess.PIPE, text=True) as holder:
            assert holder.stdout.readline() == "held\n"
            named = re.escape(f"{tmp_path}: process {holder.pid} is writing there")
            with pytest.raises(OutputError, match=named), locked(tmp_path):
                pytest.fail("two processes in one folder")
            holder.send_signal(signal.SIGKILL)
        assert (tmp_path / LOCK).read_text() == str(holder.pid)
        with locked(tmp_path):
            assert (tmp_path / LOCK).read_text() == str(os.getpid())
        assert list(tmp_path.iterdir()) == []

    @pytest.mark.parametrize("left", [str(os.getppid()), "9" * 20])
    def test_a_file_that_names_a_living_process_or_a_longer_id_locks_nothing(self, tmp_path, left):
        (tmp_path / LOCK).write_text(left)
        with locked(tmp_path):
            assert (tmp_path / LOCK).read_text() == str(os.getpid())

    @pytest.mark.parametrize(("number", "said"), [(errno.ENOLCK, None), (errno.EIO, "cannot be written: Input/output")])
    def test_a_file_system_without_locks_keeps_nobody_out(self, tmp_path, monkeypatch, number, said):
        def refuse(file, operation):
            raise OSError(number, "refused")

        monkeypatch.setattr(fcntl, "flock", refuse)
        with pytest.raises(OutputError, match=said) if said else nullcontext(), locked(tmp_path):
            assert (tmp_path / LOCK).read_text() == str(os.getpid())

    def test_a_file_that_its_holder_has_removed_locks_nothing(self, tmp_path, monkeypatch):
        """It is opened anew where another process has made one since: two would hold files of one name."""
        flock, opened = fcntl.flock, []

        def removed_meanwhile(file, operation):
            flock(file, operation)
            opened.append(os.fstat(file).st_ino)
            if len(opened) == 1:
                (tmp_path / LOCK).unlink()
                (tmp_path / LOCK).write_text("")

        monkeypatch.setattr(fcntl, "flock", removed_meanwhile)
        with locked(tmp_path):
            assert (tmp_path / LOCK).stat().st_ino == opened[1]
        assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("place", [{"\ud800": 1}, {"a": "\ud800"}, {"a": [1, ("b", {"c": "\ud800"})]}])
def test_text_that_no_file_can_hold(place):
    with pytest.raises(TextFileError, match=r"holds '\\ud800', which is not text"):
        check_plain(place)


def test_size(tmp_path, monkeypatch):
    monkeypatch.setitem(LARGEST, "JSON", 1000)
    path = tmp_path / "a.json"
    path.write_text(json.dumps({"a": "x" * 991}))
    assert path.stat().st_size == 1000
    assert read_text(path, "JSON") == {"a": "x" * 991}
    path.write_text(json.dumps({"a": "x" * 992}))
    with pytest.raises(TextFileError, match=r"^has more than 1,000 bytes$"):
        read_text(path, "JSON")


@pytest.mark.parametrize(
    ("text", "language", "said"),
    [
        ("[1, 2]", "JSON", "^not a table of JSON but list$"),
        ("{", "JSON", "^not valid JSON: "),
        ("[" * 100_000, "JSON", "^not valid JSON: nested too deep$"),
        ('{"a":' * 40 + "1" + "}" * 40, "JSON", "^nested too deep$"),
        ("a = ", "TOML", "^not valid TOML: "),
    ],
)
def test_what_is_no_table(text, language, said):
    with pytest.raises(TextFileError, match=said):
        parse_text(text, language)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
def test_text_with_a_mark_and_as_powershell_writes_it(tmp_path, encoding):
    path = tmp_path / "a.toml"
    path.write_bytes("name = 'Größe 海'\r\ndescription = '''x\r\ny'''\r\n[auv]\r\ncount = 3\r\n".encode(encoding))
    scenario = Scenario.load(str(path))
    assert (scenario.name, scenario.description, scenario.auv.count) == ("Größe 海", "x\ny", 3)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("\n# Größe".encode("latin-1"), "byte 0xf6 in line 2 is not UTF-8"),
        ("name = 'a'".encode("utf-16")[:-1], "byte 0x27 in line 1 is not UTF-16"),
    ],
)
def test_text_in_another_encoding_is_one_line(tmp_path, run_usvauv, content, said):
    (tmp_path / "a.toml").write_bytes(content)
    assert run_usvauv("scenarios", "a.toml") == (2, "", f"error: a.toml: {said}; save the file as UTF-8\n")
