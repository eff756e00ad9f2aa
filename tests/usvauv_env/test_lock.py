"""One process at a time in a folder."""

import errno
import os
import re
import runpy
import signal
import subprocess
import sys
from io import FileIO
from types import SimpleNamespace

import pytest

from usvauv.env import lock
from usvauv.env.files import OutputError
from usvauv.env.lock import NAME, locked

HOLD = """
import sys, time, pathlib
from usvauv.env.lock import locked
with locked(pathlib.Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(600)
"""


def test_a_second_process_is_refused_by_the_id_of_the_first_and_its_death_opens_the_folder(tmp_path):
    with subprocess.Popen([sys.executable, "-c", HOLD, tmp_path], stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout.readline() == "held\n"
        named = re.escape(f"{tmp_path}: process {holder.pid} is writing there")
        with pytest.raises(OutputError, match=named), locked(tmp_path):
            pytest.fail("two processes in one folder")
        holder.send_signal(signal.SIGKILL)
    assert (tmp_path / NAME).read_text() == str(holder.pid)
    with locked(tmp_path):
        assert (tmp_path / NAME).read_text() == str(os.getpid())
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_names_a_living_process_locks_nothing(tmp_path):
    (tmp_path / NAME).write_text(str(os.getppid()))  # of a killed process whose id is in use again
    with locked(tmp_path):
        pass


def test_a_folder_that_is_gone_is_named(tmp_path):
    with pytest.raises(OutputError, match="gone: cannot be written"), locked(tmp_path / "gone"):
        pass


def test_without_locks_nobody_is_kept_out(tmp_path, monkeypatch):
    """A file system that knows none; another refusal is the system's."""
    number = errno.ENOLCK

    def refuse(file):
        raise OSError(number, "refused")

    monkeypatch.setattr(lock, "_acquire", refuse)
    with locked(tmp_path):
        assert (tmp_path / NAME).read_text() == str(os.getpid())
    number = errno.EIO
    with pytest.raises(OutputError, match=f"{tmp_path}: cannot be written: Input/output error"), locked(tmp_path):
        pass
    number = errno.EAGAIN
    (tmp_path / NAME).write_text("12")
    with pytest.raises(OutputError, match=f"{tmp_path}: process 12 is writing there"), locked(tmp_path):
        pass


@pytest.mark.parametrize("new", [True, False])
def test_a_file_that_its_holder_has_removed_locks_nothing(tmp_path, monkeypatch, new):
    """It is opened anew, whether or not another process has made one since: two would hold files of one name."""
    acquire, opened = lock._acquire, []

    def removed_meanwhile(file):
        acquire(file)
        opened.append(file)
        if len(opened) == 1:
            (tmp_path / NAME).unlink()
            if new:
                (tmp_path / "other").write_text("")
                (tmp_path / "other").rename(tmp_path / NAME)

    monkeypatch.setattr(lock, "_acquire", removed_meanwhile)
    with locked(tmp_path):
        assert [file.closed for file in opened] == [True, False]
        assert os.fstat(opened[1].fileno()).st_ino == (tmp_path / NAME).stat().st_ino
    assert opened[1].closed
    assert list(tmp_path.iterdir()) == []


def test_the_id_of_a_longer_one_leaves_no_digits(tmp_path):
    (tmp_path / NAME).write_text("9" * 20)
    with locked(tmp_path):
        assert (tmp_path / NAME).read_text() == str(os.getpid())


def test_all_may_hold_the_lock_of_a_folder_that_all_may_write(tmp_path):
    before = os.umask(0)
    try:
        with locked(tmp_path):
            assert (tmp_path / NAME).stat().st_mode & 0o777 == 0o666
    finally:
        os.umask(before)


def test_what_windows_is_asked_for(tmp_path, monkeypatch):
    """One byte behind the process id, which others read."""
    asked = []
    windows = SimpleNamespace(
        LK_NBLCK=2, locking=lambda number, mode, count: asked.append((os.lseek(number, 0, os.SEEK_CUR), mode, count))
    )
    monkeypatch.setitem(sys.modules, "msvcrt", windows)
    monkeypatch.setattr(sys, "platform", "win32")
    acquire = runpy.run_path(lock.__file__)["_acquire"]
    monkeypatch.undo()
    with FileIO(tmp_path / NAME, "w+") as file:
        acquire(file)
    ((place, mode, count),) = asked
    assert place > 20
    assert (mode, count) == (windows.LK_NBLCK, 1)


def test_the_id_stands_first_wherever_locking_has_led(tmp_path, monkeypatch):
    monkeypatch.setattr(lock, "_acquire", lambda file: file.seek(lock.FAR))
    with locked(tmp_path):
        assert (tmp_path / NAME).read_text() == str(os.getpid())
