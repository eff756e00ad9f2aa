"""Fixtures of the commands."""

import functools
import json

import pytest


@pytest.fixture
def refused(run_usvauv):
    """Run a command that is refused: what its one line says, of which standard output has nothing."""

    def run(*arguments):
        code, out, error = run_usvauv(*arguments)
        assert (code, out, error.count("\n"), error[:7]) == (2, "", 1, "error: ")
        return error[7:]

    return run


@pytest.fixture
def plan(run_usvauv):
    """Run `usvauv plan` in an empty folder: exit code, stdout, stderr."""
    return functools.partial(run_usvauv, "plan")


@pytest.fixture
def solve(plan):
    """The JSON that `usvauv plan` prints, when it prints that and its warnings, and nothing else."""

    def run(*arguments):
        code, stdout, stderr = plan(*arguments, "--json", "-")
        result = json.loads(stdout)
        assert (code, stderr) == (0, "".join(f"warning: {line}\n" for line in result["warnings"]))
        return result

    return run
