"""What the site is made of: fields with their units, commands, pictures. `.ci/run` builds the site itself."""

import re
from pathlib import Path

from docs import pictures, reference_pages
from usvauv.env import Scenario

ROOT = Path(__file__).parents[1]
PURE = {
    "auv.variation",  # numbers without a unit
    *("storm.gamma", "storm.spreading", "acoustics.water_salinity", "acoustics.ph", "acoustics.shipping"),
    *("usbl.packet_loss", "reward.border", "reward.overflow", "reward.service", "reward.collaboration"),
    "boat.windage",
}


def test_fields_of_a_scenario_have_rows_with_units():
    rows = re.findall(r"^\| `([\w.]+)` \| ([^|]*) \| ([^|]*) \|", reference_pages.scenario_fields(), re.MULTILINE)
    fields = [f"{name}.{field}" for name, section in Scenario() for field in getattr(type(section), "model_fields", ())]
    assert [name for name, *_ in rows if "." in name] == fields
    pure = {name for name, kind, unit in rows if kind == "number" and not unit}
    assert {name for name in pure if not name.startswith(("torpedo.", "otter."))} == PURE  # coefficients


def test_a_row_of_a_field():
    page = reference_pages.scenario_fields()
    assert "| `usbl.carriers` | list of numbers | Hz | 1 to 16 of 100 to 200000 | `[15000.0, 18000.0]` |" in page
    assert "| `usbl.packet_loss` | number |  | 0 to below 1 | `0.0` |" in page
    assert '| `acoustics.wind` | number or text | m/s | 0 to 60 or `storm` | `"storm"` |' in page
    assert "| `auv.depth` | number | m | 0.5 to 11000 | `100.0` | cruise depth |" in page


def test_every_command_has_its_options():
    page = reference_pages.command_line()
    commands = re.findall(r"^## `usvauv ([\w-]+)`$", page, re.MULTILINE)
    assert {"simulate", "train", "eval", "plan", "sea", "doctor"} < set(commands)
    assert page.count("* `--help`") == len(commands)


def test_a_row_of_a_variable_of_a_trace():
    row = "| `delivered` | time, world, auv | Mbit | data of a service completed in this step, else 0 |"
    assert row in reference_pages.trace_variables()


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
