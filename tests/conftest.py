"""Fixtures that tests of more than one module use."""

import sys

import pytest
import torch

from kernels import runtime
from usvauv_cli import app


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--arch", default="auto", help="Where the kernels run: auto, cpu, cuda or vulkan.")


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("--arch") != "auto":
        runtime.start(config.getoption("--arch"))


@pytest.fixture(scope="session")
def device() -> torch.device:
    """Torch device of the kernels. Taichi runs from here on."""
    return runtime.start().device


@pytest.fixture
def run_usvauv(tmp_path, monkeypatch, capfd):
    """Function that runs `usvauv` in this process and an empty folder: exit code, standard output, standard error."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["usvauv", *map(str, arguments)])
        return app.run(), *capfd.readouterr()

    return run
