"""What the site is made of: fields, commands, pictures. `.ci/run` builds the site itself."""

import re
from pathlib import Path

from docs import pictures, reference_pages
from usvauv.env import Scenario

ROOT = Path(__file__).parents[1]


def test_fields_of_a_scenario_have_rows():
    rows = re.findall(r"^\| `([\w.]+)` \| ([^|]*) \| ([^|]*) \|", reference_pages.scenario_fields(), re.MULTILINE)
    fields = [f"{name}.{field}" for name, section in Scenario() for field in getattr(type(section), "model_fields", ())]
    assert [name for name, *_ in rows if "." in name] == fields


def test_every_command_has_its_options():
    page = reference_pages.command_line()
    commands = re.findall(r"^## `usvauv ([\w-]+)`$", page, re.MULTILINE)
    assert {"simulate", "train", "eval", "plan", "sea", "doctor"} < set(commands)
    assert page.count("* `--help`") == len(commands)


def test_pictures_are_for_light_and_dark_pages():
    for page in (ROOT / "docs").glob("*.md"):
        text = page.read_text(encoding="utf-8")
        shown = pictures.PICTURE.findall(text)
        assert len(shown) == text.count("<picture>")
        for dark, _, light in shown:
            assert dark == light.replace("-light.", "-dark.")
            assert all((page.parent / name).is_file() for name in (dark, light)), page.name
    source = ['a <picture><source media="(prefers-color-scheme: dark)" srcset="x-dark.png">']
    source[0] += '<img alt="X" src="x-light.png"></picture> b'
    pictures.convert(None, "page", source)
    assert re.findall(r"```{image} (\S+)\n:alt: X\n:class: (\S+)\n```", source[0]) == [
        ("x-light.png", "only-light"),
        ("x-dark.png", "only-dark"),
    ]
