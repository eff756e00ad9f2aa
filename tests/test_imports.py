"""Packages import downwards only, rooms and modules not in circles, and Taichi is imported by the kernels alone."""

import re
import subprocess
import sys

import pytest

from tests.import_graph import PACKAGES, ROOT, circle, imported, module_graph, room_graph, sources


def test_no_import_leads_upwards():
    def floor(name: str) -> int:
        package = ".".join(name.split(".")[:2])
        return PACKAGES.index(package) if package in PACKAGES else len(PACKAGES)

    upwards = [
        (name, target) for name, targets in module_graph().items() for target in targets if floor(target) > floor(name)
    ]
    assert upwards == []


def test_each_module_is_imported_by_one_name():
    """From the repository's root the folders can also be imported, as second modules with registries of their own."""
    folders = {(ROOT / "src" / package.replace(".", "/")).resolve().name for package in PACKAGES}
    second = re.compile(rf"^\s*(?:from|import) (?:{'|'.join(folders)})\b", re.MULTILINE)
    others = [path for name in ("tests", "benchmarks", "examples") for path in (ROOT / name).rglob("*.py")]
    files = [*sources().values(), *others]
    assert [path for path in files if second.search(path.read_text(encoding="utf-8"))] == []


@pytest.mark.parametrize(
    ("library", "places", "parts"),
    [
        ("taichi", {"usvauv.kernels"}, 2),
        ("matplotlib", {"usvauv.env.render.style", "usvauv.env.render.figures"}, 4),
    ],
)
def test_these_places_alone_import(library, places, parts):
    importers = {
        ".".join(name.split(".")[:parts])
        for name, path in sources().items()
        for target in imported(path)
        if target.partition(".")[0] == library
    }
    assert importers == places


def test_libraries_are_loaded_when_they_are_used():
    """torch with the first public name; those for NetCDF and pictures by what reads the one or draws the other."""
    code = """
import sys, usvauv
print({*usvauv.__all__} <= {*dir(usvauv)}, "torch" in sys.modules)
import usvauv.policies, usvauv.env, usvauv.cli.evaluation.comparison_tables, usvauv.cli.sweep.run_folder
print({"xarray", "h5py", "matplotlib"} & {*sys.modules})
from usvauv import *
from usvauv.extend import *
print({*usvauv.__all__} <= {*globals()}, "torch" in sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.split() == ["True", "False", "set()", "True", "True"]


COMMANDS = {
    "--help": 0,
    "simulate --help": 0,
    "scenarios": 0,
    "policies": 0,
    "boats": 0,
    "targets": 0,
    "scenarios wide-torpedo --set nodes.target_rule=rate:20 --set boat.model=otter": 0,
    "simulate nosuch": 2,
    "simulate --speed 2": 2,
    "eval wide --set nodes.target_rule=rate:a": 2,
    "train extreme-torpedo --set torpedo.length=0.3 --set torpedo.diameter=1": 2,
    "live --set acoustics.absorption=none --set task=none --set channel.schedule=none": 2,
    "sea --set auv.model=submarine": 2,
    "plan nosuch": 2,
}


def test_lists_help_and_refusals_wait_for_no_library():
    program = """
import sys
from usvauv.cli.app import run
for arguments in sys.argv[1:]:
    sys.argv = ["usvauv", *arguments.split()]
    print(arguments, run(), {"torch", "taichi"} & {*sys.modules}, sep="|", file=sys.stderr)
"""
    done = subprocess.run([sys.executable, "-c", program, *COMMANDS], capture_output=True, text=True, cwd=ROOT)
    told = [line for line in done.stderr.splitlines() if "|" in line]
    assert told == [f"{arguments}|{code}|set()" for arguments, code in COMMANDS.items()], done.stderr


def test_no_circle_of_modules():
    assert circle(module_graph()) == []


def test_no_circle_of_rooms():
    assert circle(room_graph(module_graph())) == []
