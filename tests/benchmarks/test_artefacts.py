"""The list of what makes the docs' figures and tables is complete, and its commands are those of the pages."""

import re
import subprocess

import pytest

from benchmarks.artefacts import ARTEFACTS, ROOT

DOCS = ROOT / "docs"
IN_A_VIEWER = {"report.png", "export-mcap.png", "export-rerun.png"}  # taken by hand


def test_every_picture_has_a_command():
    tracked = subprocess.run(["git", "ls-files", "docs"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    pictures = {name.removeprefix("docs/") for name in tracked.splitlines() if name.endswith((".png", ".webp", ".csv"))}
    made = [name for artefact in ARTEFACTS.values() for name in artefact.pictures]
    assert sorted(made) == sorted(pictures - IN_A_VIEWER)


def test_every_study_that_a_page_names_is_made_for_it():
    made = {match for each in ARTEFACTS.values() for command in each.commands for match in _programs(command)}
    for page in DOCS.glob("*.md"):
        for program in _programs(" ".join(page.read_text(encoding="utf-8").split())):
            assert program in made, f"{page.name}: {program}"


@pytest.mark.parametrize("name", ARTEFACTS)
def test_the_page_names_the_command(name):
    artefact = ARTEFACTS[name]
    page = ROOT / artefact.page if artefact.page == "README.md" else DOCS / artefact.page
    text = " ".join(page.read_text(encoding="utf-8").split())
    command = re.sub(r" (?:--out|--learned|--report) \S+", "", artefact.commands[-1])
    assert command in re.sub(r" (?:--out|--learned|--report) [^\s`]+", "", text), command


def _programs(text):
    """Modules of studies, benchmarks and cases, and targets of `usvauv reproduce`."""
    found = re.findall(r"python -m ((?:benchmarks\.(?!gpu|artefacts)|tests\.cases)[\w.]*\w)", text)
    return found + re.findall(r"usvauv reproduce (?!all --quick)\w+ --out", text)
