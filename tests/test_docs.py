"""README and docs: snippets run, commands parse, and each file, name and dependency that they speak of is there."""

import ast
import csv
import importlib.util
import pkgutil
import re
import shlex
import textwrap
import tomllib
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import pytest
import typer

from tests.import_graph import sources
from usvauv import env
from usvauv.cli.app import parser
from usvauv.env import plugins

ROOT = Path(__file__).parents[1]
PAGES = [*(ROOT / name for name in ("README.md", "CONTRIBUTING.md")), *sorted((ROOT / "docs").glob("*.md"))]
SCENARIOS = sorted(path.stem for path in (Path(env.__file__).parent / "scenarios").glob("*.toml"))
NAMED = re.compile(rf"""(["'])(?:{"|".join(SCENARIOS)})\1""")  # a scenario's name in quotation marks
PLACE = re.compile(
    r"(?:src|kernels|usvauv_env|policies|usvauv_cli|tests|benchmarks|examples|docs)(?:/[\w./-]*|[.](?!md)[\w.]*\w)"
    r"|usvauv[.](?!plugins)[\w.]*\w"
)


def blocks(text: str) -> Iterator[str]:
    """Code of a page: fenced blocks and blocks that are indented by four spaces after an empty line."""
    fence = re.compile(r"^```\w*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
    yield from fence.findall(text)
    indented = re.compile(r"(?<=\n\n)(?:    .*\n|\n(?=    ))+")
    yield from (textwrap.dedent(block).strip() + "\n" for block in indented.findall(fence.sub("", text)))


def spans(text: str) -> list[str]:
    """Code within the sentences of a page, on one line each."""
    return [" ".join(span.split()) for span in re.findall(r"(?<!`)`([^`]+)`(?!`)", text)]


def is_python(block: str) -> bool:
    return re.search(r"^(?:import|from) \w", block, re.MULTILINE) is not None


def is_call(span: str) -> bool:
    """Whether a span can be run as it stands: a call of a public function with a scenario's name."""
    return re.match(r"(?:gymnasium|usvauv\.env|policies)\.[\w.]+\(", span) is not None and bool(NAMED.search(span))


def snippets() -> Iterator:
    """Python of each page as it stands, and in slow tests with every other scenario for those that it names."""
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        found = [block for block in blocks(text) if is_python(block) and page.stem != "extending"]  # files of plugins
        found += re.findall(r'python -c "(.*)"', text)
        calls = [span for span in spans(text) if is_call(span)]
        if calls:
            found.append(
                "\n".join(["import gymnasium, usvauv.env.interfaces.torchrl_env; from usvauv import policies", *calls])
            )
        if found:
            yield pytest.param(found, id=page.stem)
        for number, code in enumerate(found):
            if NAMED.search(code):
                rest = [other for name in SCENARIOS if (other := NAMED.sub(f'"{name}"', code)) != code]
                yield pytest.param(rest, id=f"{page.stem}-{number}-others", marks=pytest.mark.slow)


def commands() -> Iterator:
    """Command lines of each page that begin with `usvauv` or `python`."""
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        shell = "\n".join(block for block in blocks(text) if not is_python(block)).replace("\\\n", " ")
        for line in dict.fromkeys(
            part.strip() for whole in [*shell.splitlines(), *spans(text)] for part in whole.split("&&")
        ):
            if re.match(r"(?:usvauv|python) ", line) and "…" not in line:
                words = shlex.split(line.partition(" > ")[0], comments=True)
                yield pytest.param(words, id=f"{page.stem}: {' '.join(words)[:60]}")


@pytest.mark.usefixtures("own_registries")
@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("codes", list(snippets()))
def test_python_runs(tmp_path, monkeypatch, codes):
    monkeypatch.chdir(tmp_path)
    for code in codes:
        exec(code, {})


@pytest.mark.parametrize("command", list(commands()))
def test_commands_parse(monkeypatch, command):
    monkeypatch.setattr(plugins, "load", lambda path: None)
    program, *arguments = command
    if program == "usvauv":
        group = typer.main.get_command(parser())
        try:
            context = group.make_context("usvauv", list(arguments))
            name, subcommand, rest = group.resolve_command(context, [*context._protected_args, *context.args])
            subcommand.make_context(name, rest, parent=context)
        except Exception as error:
            if type(error).__name__ != "Exit":  # `--help` and `--version`
                raise
    elif arguments[0] == "-m":
        assert importlib.util.find_spec(arguments[1]) is not None
    elif arguments[0] != "-c":
        assert (ROOT / arguments[0]).is_file()


def named_places() -> Iterator:
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        links = re.findall(r"\]\((?!http)([^)#]+)", text)
        yield from (pytest.param(page.parent / link, id=f"{page.stem}: {link}") for link in dict.fromkeys(links))
        for span in dict.fromkeys(match[0] for span in spans(text) if (match := PLACE.match(span))):
            yield pytest.param(ROOT / span if "/" in span else span, id=f"{page.stem}: {span}")


@pytest.mark.parametrize("place", list(named_places()))
def test_what_is_named_exists(place):
    if isinstance(place, Path):
        assert place.exists()
    else:
        pkgutil.resolve_name(place)


def test_the_table_has_every_dependency_and_no_other():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    extras = project["project"]["optional-dependencies"]
    stated = [*project["project"]["dependencies"], *project["build-system"]["requires"], *chain(*extras.values())]
    parts = (re.fullmatch(r"([\w-]+)(?:\[[\w,]+\])?(.*)", each) for each in stated)
    expected = {(part[1], part[2]) for part in parts if part[1] != project["project"]["name"]}
    with (ROOT / "docs" / "data" / "dependencies.csv").open(encoding="utf-8") as table:
        rows = [(row["package"], row["bound"]) for row in csv.DictReader(table)]
    assert sorted(rows) == sorted(expected)
    assert len(rows) == len(set(rows))


def test_docstrings_begin_with_their_subject():
    """What a function gives is named, not "the same" or "those" of another."""
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef)
    without = re.compile(r"(?:Of|Those|As|The same)\b")
    found = [
        f"{name}: {text[:60]}"
        for name, path in sources().items()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, documented) and without.match(text := ast.get_docstring(node) or "")
    ]
    assert found == []
