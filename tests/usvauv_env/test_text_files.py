"""Text files: their largest size and depth themselves are allowed, and what is beyond is refused in one line."""

import json
import os

import pytest

from usvauv.env import text_files
from usvauv.env.text_files import TextFileError


def nested(levels):
    """A table with a number below so many levels of tables and lists."""
    content = 1
    for level in range(levels):
        content = {"a": content} if level % 2 else [content, 2]
    return {"a": content}


def test_depth():
    """A table's content counts as one."""
    text_files.check_plain(nested(text_files.DEEPEST - 2))
    with pytest.raises(TextFileError, match=r"^nested too deep$"):
        text_files.check_plain(nested(text_files.DEEPEST - 1))


@pytest.mark.parametrize("place", [{"\ud800": 1}, {"a": "\ud800"}, {"a": [1, ("b", {"c": "\ud800"})]}])
def test_text_that_no_file_can_hold(place):
    with pytest.raises(TextFileError, match=r"holds '\\ud800', which is not text"):
        text_files.check_plain(place)


def test_size(tmp_path, monkeypatch):
    monkeypatch.setitem(text_files.LARGEST, "JSON", 1000)
    path = tmp_path / "a.json"
    path.write_text(json.dumps({"a": "x" * 991}))
    assert path.stat().st_size == 1000
    assert text_files.read(path, "JSON") == {"a": "x" * 991}
    path.write_text(json.dumps({"a": "x" * 992}))
    with pytest.raises(TextFileError, match=r"^has more than 1,000 bytes$"):
        text_files.read(path, "JSON")


@pytest.mark.parametrize(
    ("text", "language", "said"),
    [
        ("[1, 2]", "JSON", "^not a table of JSON but list$"),
        ("{", "JSON", "^not valid JSON: "),
        ("[" * 100_000, "JSON", "^not valid JSON: nested too deep$"),
        ('{"a":' * 40 + "1" + "}" * 40, "JSON", "^nested too deep$"),
        ("a = ", "TOML", "^not valid TOML: "),
    ],
)
def test_what_is_no_table(text, language, said):
    with pytest.raises(TextFileError, match=said):
        text_files.parse(text, language)


def test_ends_of_lines_of_windows():
    assert text_files.parse("a = '''x\r\ny'''\r\n", "TOML") == {"a": "x\ny"}


def test_what_is_no_file(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path, tmp_path / "none", "a\0b"):
        with pytest.raises(FileNotFoundError, match="is no file"):
            text_files.read(path, "TOML")
