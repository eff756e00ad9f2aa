"""One process at a time in a folder."""

import os
import re
import signal
import subprocess
import sys

import pytest

from usvauv_env.files import OutputError
from usvauv_env.lock import NAME, locked

HOLD = """
import sys, time, pathlib
from usvauv_env.lock import locked
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
