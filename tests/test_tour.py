"""The tours run: README's first, in an empty folder, and after it, in a slow test, the quick lines of docs/tour.md."""

import re
import shlex
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
README, TOUR = ROOT / "README.md", ROOT / "docs" / "tour.md"
SHORTER = {  # what is added to the lines of a command, so that they take seconds; nothing else is changed
    "simulate": "--duration 10",
    "eval": "--episodes 2 --set mission.duration=10",
    "train": "--steps 256 --worlds 16 --set mission.duration=10",
    "sea": "--duration 2",
}
pytestmark = pytest.mark.timeout(1500)  # two dozen commands: minutes on a busy machine


def lines(page: Path, *headings: str) -> list[tuple[str, str]]:
    """The commands of sections in their order; a Python block that begins with a file's name is that file's text."""
    found = []
    for heading in headings:
        _, _, text = page.read_text(encoding="utf-8").partition(f"\n## {heading}\n")
        section = text.partition("\n## ")[0]
        for file, code, command in re.findall(
            r"^```python\n# (\S+\.py)\n(.*?)^```$|^    usvauv ([^\n#]*)", section, re.M | re.S
        ):
            found.append((file, code or command.strip()))
    return found


@pytest.mark.parametrize("whole", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["README", "both"])
def test_the_tours_run(tmp_path, run_usvauv, monkeypatch, whole):
    monkeypatch.setattr(sys, "path", [*sys.path])  # which gets the working directory
    monkeypatch.delitem(sys.modules, "mine", raising=False)  # of another test
    commands = lines(README, "A first tour")
    if whole:
        commands += lines(TOUR, "A closer look", "Without a mission")
    for file, text in commands:
        if file:
            (tmp_path / file).write_text(text)
            continue
        command, _, into = text.partition(" > ")
        words = shlex.split(command)
        code, out, error = run_usvauv(*words, *SHORTER.get(words[0], "").split())
        assert code == 0, f"{text}: {error}"
        if into:
            (tmp_path / into).write_text(out)
    made = re.findall(r"--(?:out|trace|report) (\S+)", "\n".join(text for file, text in commands if not file))
    assert len(made) >= (12 if whole else 4)
    assert [name for name in made if not (tmp_path / name).exists()] == []
