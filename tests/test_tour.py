"""The tours run: README's first, as one script in an empty folder, and after it the quick lines of docs/tour.md."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
README, TOUR = ROOT / "README.md", ROOT / "docs" / "tour.md"
SHORTER = {  # what is added to the lines of a command, so that they take seconds; nothing else is changed
    "simulate": "--duration 10",
    "eval": "--episodes 2 --set mission.duration=10",
    "train": "--steps 256 --worlds 16 --set mission.duration=10",
    "sea": "--duration 5",
}
pytestmark = pytest.mark.timeout(1500)  # a dozen commands, which all import and compile: minutes on a busy machine


def lines(page: Path, *headings: str) -> list[str]:
    """The commands of sections in their order; a Python block that begins with a file's name becomes that file."""
    found = []
    for heading in headings:
        _, _, text = page.read_text(encoding="utf-8").partition(f"\n## {heading}\n")
        section = text.partition("\n## ")[0]
        for file, code, command in re.findall(
            r"^```python\n# (\S+\.py)\n(.*?)^```$|^    (usvauv [^\n]*)$", section, re.M | re.S
        ):
            found.append(command if command else f"cat > {file} <<'END'\n{code}END")
    return found


def short(line: str) -> str:
    command, _, _ = line.partition(" #")
    words = command.split()
    added = SHORTER.get(words[1], "") if words[0] == "usvauv" else ""
    return f"{command.rstrip()} {added}".rstrip() if added else line


def made(commands: list[str]) -> list[str]:
    """The files and folders that lines say they write."""
    return re.findall(r"(?:--(?:out|trace|report)| >) (\S+)", "\n".join(commands))


@pytest.fixture(scope="module")
def toured(tmp_path_factory) -> Path:
    """The folder in which the first tour was made: as one shell script, which ends at the first line that fails."""
    folder = tmp_path_factory.mktemp("tour")
    start = f'set -eux\nusvauv() {{ "{sys.executable}" -m usvauv.cli "$@"; }}\n'
    script = start + "\n".join(map(short, lines(README, "A first tour")))
    done = subprocess.run(["sh", "-c", script], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr + done.stdout
    return folder


def test_the_first_tour_runs(toured):
    names = made(lines(README, "A first tour"))
    assert len(names) >= 8
    assert [name for name in names if not (toured / name).exists()] == []


def test_the_quick_lines_of_the_tour_run_after_it(toured, run_usvauv, monkeypatch):
    """In this process, which has imported everything already."""
    monkeypatch.chdir(toured)
    commands = lines(TOUR, "A closer look", "Without a mission")
    for line in commands:
        code, _, error = run_usvauv(*shlex.split(short(line), comments=True)[1:])
        assert code == 0, f"{line}: {error}"
    assert [name for name in made(commands) if not (toured / name).exists()] == []
