"""The page of dependencies names those of `pyproject.toml`, with their bounds."""

import re
import tomllib
from itertools import chain
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_the_page_has_every_dependency_and_no_other():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    extras = project["project"]["optional-dependencies"]
    stated = [*project["project"]["dependencies"], *project["build-system"]["requires"], *chain(*extras.values())]
    parts = (re.fullmatch(r"([\w-]+)(?:\[[\w,]+\])?(.*)", each) for each in stated)
    expected = {(part[1], part[2]) for part in parts if part[1] != project["project"]["name"]}
    page = (ROOT / "docs" / "dependencies.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| ([\w-]+) \| ([=><][^|]*) \|", page, re.MULTILINE)
    assert sorted(rows) == sorted(expected)
    assert len(rows) == len(set(rows))
