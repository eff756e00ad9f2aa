"""The lowest versions that `pyproject.toml` states, and the newest, with each Python that it allows, under test.

    python -m pip install uv pip-audit
    python -m tests.trials.versions                                   # all of them, all tests
    python -m tests.trials.versions --python 3.11 --resolution lowest-direct tests/kernels tests/usvauv_env

Each combination gets a virtual environment of its own. pip installs torch as `constraints.txt` pins it, so that the
lowest version of torch is only tested where the pin is changed, and uv the rest. What cannot be tried is skipped with
one line: a Python or a torch that cannot be had, and, without `--gigabytes`, a torch that would bring accelerator
libraries of that size, as the registry's build for Linux does; a folder or index with a CPU build is named by pip's own
settings.

The installed versions are then held against the advisories that pip-audit knows, where these can be reached.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
PYTHONS = ("3.11", "3.12", "3.13")
RESOLUTIONS = ("lowest-direct", "highest")
PINNED = ["--constraint", "constraints.txt", "torch"]
ACCELERATORS = ("nvidia-", "cuda-", "triton")


def uv(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "uv", *arguments], cwd=ROOT, capture_output=True, text=True, check=False
    )


def interpreter(python: str) -> str | None:
    """The interpreter of a version, among those on the path and those of pyenv."""
    pyenv = sorted(Path.home().glob(f".pyenv/versions/{python}.*/bin/python"))
    for candidate in (shutil.which(f"python{python}"), *map(str, pyenv)):
        if candidate and not subprocess.run([candidate, "--version"], capture_output=True, check=False).returncode:
            return candidate
    return None


def audited(python: Path) -> str:
    """What pip-audit says of the packages of an environment."""
    if not importlib.util.find_spec("pip_audit"):
        return "advisories: pip-audit is not installed"
    frozen = [line for line in uv("pip", "freeze", "--python", str(python)).stdout.splitlines() if "==" in line]
    with tempfile.NamedTemporaryFile("w", suffix=".txt") as file:
        file.write("\n".join(line.partition("+")[0] for line in frozen))
        file.flush()
        command = [sys.executable, "-m", "pip_audit", "--no-deps", "--disable-pip", "--format", "json", "-r", file.name]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    try:
        packages = json.loads(done.stdout)["dependencies"]
    except (ValueError, KeyError):
        return f"advisories: none could be had: {done.stderr.strip().splitlines()[-1:]}"
    known = [package for package in packages if "vulns" in package]
    found = [f"{p['name']} {p['version']}: {', '.join(v['id'] for v in p['vulns'])}" for p in known if p["vulns"]]
    return "\n".join([f"advisories: {len(known)} of {len(packages)} packages looked up, {len(found)} with any", *found])


def torch_packages(python: Path) -> list[str]:
    """What pip would install for torch, as `constraints.txt` pins it; nothing where it finds none."""
    command = [str(python), "-m", "pip", "install", "--dry-run", "--quiet", "--report", "-", *PINNED]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        return []
    return [each["metadata"]["name"] for each in json.loads(done.stdout)["install"]]


def tried(python: str, resolution: str, tests: list[str], workers: int, gigabytes: bool) -> bool:
    """Install and test one combination; whether nothing failed."""
    title = f"Python {python}, {resolution}"
    found = interpreter(python)
    if found is None:
        print(f"{title}: skipped, no interpreter here", flush=True)
        return True
    options = ["--resolution", resolution, "--constraints", "constraints.txt", "--only-binary", ":all:"]
    compiled = ["--quiet", "--no-header", "--extra", "test", "pyproject.toml"]
    resolved = uv("pip", "compile", "--python-version", python, *options, *compiled)
    if resolved.returncode:
        print(f"{title}: cannot be resolved: {resolved.stderr.strip()}", flush=True)
        return False
    with tempfile.TemporaryDirectory() as place:
        environment = Path(place) / "venv"
        own = environment / "bin" / "python"
        uv("venv", "--quiet", "--seed", "--python", found, str(environment))
        packages = torch_packages(own)
        heavy = sum(name.startswith(ACCELERATORS) for name in packages)
        if not packages or (heavy and not gigabytes):
            why = f"torch would bring {heavy} accelerator packages" if packages else "torch cannot be had"
            print(f"{title}: resolves; not tested, {why}", flush=True)
            return True
        subprocess.run([str(own), "-m", "pip", "install", "--quiet", *PINNED], cwd=ROOT, check=True)
        source = ["--no-binary", "usvauv", "--editable", ".[test]"]
        installed = uv("pip", "install", "--quiet", "--python", str(own), *options, *source)
        if installed.returncode:
            print(f"{title}: cannot be installed: {installed.stderr.strip()}", flush=True)
            return False
        named = os.environ | {"PYTHONPATH": str(ROOT), "PATH": f"{own.parent}{os.pathsep}{os.environ['PATH']}"}
        options = ["-q", "-n", str(workers), "-p", "no:cacheprovider", "-W", "default"]
        command = [str(own), "-m", "pytest", *options, *tests]
        done = subprocess.run(command, cwd=ROOT, env=named, capture_output=True, text=True, check=False)
        lines = done.stdout.strip().splitlines()
        failed = [line for line in lines if line.startswith(("FAILED", "ERROR"))]
        counts = (line for line in reversed(lines) if re.match(r"\d+ (failed|passed|skipped|errors?)\b", line))
        ended = next(counts, done.stderr[-500:])
        print("\n".join([f"{title}: {ended}", *failed, audited(own)]), flush=True)
    return done.returncode == 0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--python", action="append", help="all that are allowed by default")
    parser.add_argument("--resolution", action="append", choices=RESOLUTIONS, help="both by default")
    parser.add_argument("--workers", type=int, default=2, help="processes that run tests")
    parser.add_argument("--gigabytes", action="store_true", help="also with a torch that brings accelerator libraries")
    parser.add_argument("tests", nargs="*", default=["tests"])
    chosen = parser.parse_args()
    results = [
        tried(python, resolution, chosen.tests, chosen.workers, chosen.gigabytes)
        for python in chosen.python or PYTHONS
        for resolution in chosen.resolution or RESOLUTIONS
    ]
    sys.exit(not all(results))


if __name__ == "__main__":
    main()
