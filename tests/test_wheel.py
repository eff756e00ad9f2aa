"""A wheel built from the tree, installed elsewhere and used from outside the checkout."""

import os
import shutil
import subprocess
import sys
import tomllib
from glob import glob
from pathlib import Path
from zipfile import ZipFile

import pytest

ROOT = Path(__file__).parents[1]

MISSION = """
import sys
from importlib.metadata import version
from pathlib import Path

import torch

import usvauv
from usvauv import Scenario, World, policies

assert Path(usvauv.__file__).is_relative_to(sys.argv[1])
world = World(Scenario.load("extreme"), num_worlds=3, seed=0)
policy = policies.load("sac-extreme", world)
action = policy.act(torch.zeros(3, 2, world.observation_size))  # by a kernel, whose source Taichi reads
assert action.isfinite().all()
print(policy.name, version("usvauv"))
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """The wheel of a copy of the tree, because building one leaves files beside the sources."""
    tree = tmp_path_factory.mktemp("tree")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tree)
    for name in ("src", "kernels", "usvauv_env", "policies", "usvauv_cli"):
        shutil.copytree(ROOT / name, tree / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
    pip("wheel", tree, "--no-build-isolation", "--wheel-dir", tree)
    (path,) = tree.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory) -> Path:
    target = tmp_path_factory.mktemp("installed")
    pip("install", "--no-compile", wheel, "--target", target)
    return target


def pip(*arguments: object) -> None:
    command = [
        sys.executable,
        "-m",
        "pip",
        "--disable-pip-version-check",
        *map(str, arguments),
        "--no-deps",
        "--no-index",
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def output(folder: Path, target: Path, *command: object) -> str:
    """What a command prints that is run in an empty folder and finds the package in `target`."""
    environment = {**os.environ, "PYTHONPATH": str(target)}
    done = subprocess.run(
        [sys.executable, *map(str, command)], capture_output=True, text=True, check=False, cwd=folder, env=environment
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_it_holds_each_file_of_the_packages(wheel):
    files = {
        name
        for name in glob("usvauv/**", root_dir=ROOT / "src", recursive=True)  # follows links
        if (ROOT / "src" / name).is_file() and "__pycache__" not in name
    }
    assert "usvauv/py.typed" in files
    with ZipFile(wheel) as archive:
        assert {name for name in archive.namelist() if ".dist-info/" not in name} == files


def test_a_shipped_policy_acts(installed, tmp_path):
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    assert output(tmp_path, installed, "-c", MISSION, installed).splitlines()[-1] == f"sac-extreme {version}"


def test_the_command_lists_the_scenarios(installed, tmp_path):
    shown = output(tmp_path, installed, installed / "bin" / "usvauv", "scenarios")
    names = [path.stem for path in (installed / "usvauv" / "env" / "scenarios").glob("*.toml")]
    assert len(names) >= 5
    assert all(name in shown for name in names)
