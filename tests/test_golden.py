"""Short missions come to what they came to; see `tests.golden`."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests import golden


def test_as_written_down():
    """Every number within its tolerance, and every bit on a processor and with versions of a digest."""
    kept = json.loads(golden.FILE.read_text(encoding="utf-8"))
    digest, numbers = golden.traced()
    differ = golden.deviations(kept["numbers"], numbers)
    renew = "if results are meant to change: python -m tests.golden --renew"
    assert all(difference <= golden.TOLERANCE for difference in differ.values()), f"{differ}; {renew}"
    if kept["versions"] == golden.versions() and golden.processor() in kept["digests"]:
        assert digest == kept["digests"][golden.processor()], renew


@pytest.mark.slow
def test_as_without_the_passes_that_other_tests_leave_out():
    """A mission whose kernels are compiled as users' are has the bits of one that is compiled as `conftest` says."""
    code = "from tests import golden; print(golden.traced(['tracked'])[0])"
    as_shipped = {name: value for name, value in os.environ.items() if name != "TI_ADVANCED_OPTIMIZATION"}
    command = [sys.executable, "-c", code]
    root = Path(__file__).parents[1]
    done = subprocess.run(command, cwd=root, env=as_shipped, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == golden.traced(["tracked"])[0]
