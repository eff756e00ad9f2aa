"""Reading TOML and JSON files from anywhere: of bounded size and depth, with whatever is wrong as one kind of error."""

from __future__ import annotations

import codecs
import json
import os
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

LARGEST = {"TOML": 2**20, "JSON": 2**26}  # bytes
DEEPEST = 32  # sections and lists in one another
# Keys of dots that Python's parser would take a time for that grows with the square of their number.
TOO_DEEP = re.compile(rf"""(?<![\w-])(?:(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*\.[ \t]*){{{DEEPEST}}}""")
PARSERS = {"TOML": tomllib.loads, "JSON": json.loads}


class TextFileError(ValueError):
    """Why a text file or its content cannot be used, in words that follow on the file's name."""


def read(path: str | Path, language: str) -> dict[str, Any]:
    """The content of a file of a language in `LARGEST`.

    Raises:
        FileNotFoundError: there is none.
        TextFileError: it cannot be read, is too large, or `parse` refuses it.
    """
    if not os.path.isfile(path):  # false, unlike an error, for paths that no system allows; a pipe would not end
        raise FileNotFoundError(f"{path}: is no file")
    try:
        with open(path, "rb") as file:
            content = file.read(LARGEST[language] + 1)
        if len(content) > LARGEST[language]:
            raise TextFileError(f"has more than {LARGEST[language]:,} bytes")
    except OSError as error:
        raise TextFileError(f"cannot be read: {error.strerror}") from None
    return parse(decoded(content), language)


def decoded(content: bytes) -> str:
    """The text of a file in UTF-8, or in UTF-16 as PowerShell's `>` writes it, with or without a byte-order mark.

    Raises:
        TextFileError: it is in neither.
    """
    mark = content[:2]
    if mark in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        encoding = "utf-16"
    elif b"\0" in mark:  # beside a letter of ASCII, with which files begin
        encoding = "utf-16-be" if mark[:1] == b"\0" else "utf-16-le"
    else:
        encoding = "utf-8-sig"
    try:
        return content.decode(encoding)
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        wrong = f"byte {content[error.start]:#04x} in line {line} is not {'UTF-16' if '16' in encoding else 'UTF-8'}"
        raise TextFileError(f"{wrong}; save the file as UTF-8") from None


def parse(text: str, language: str) -> dict[str, Any]:
    """The table that a text in a language of `LARGEST` stands for.

    Raises:
        TextFileError: it is not of the language, no table, or `check_plain` refuses it.
    """
    if language == "TOML" and TOO_DEEP.search(text):
        raise TextFileError("not valid TOML: nested too deep")
    try:
        content = PARSERS[language](text.replace("\r\n", "\n"))
    except RecursionError:
        raise TextFileError(f"not valid {language}: nested too deep") from None
    except Exception as error:  # the parsers also raise ValueError of other kinds, for numbers of many digits
        raise TextFileError(f"not valid {language}: {error}") from None
    if not isinstance(content, dict):
        raise TextFileError(f"not a table of {language} but {type(content).__name__}")
    check_plain(content)
    return content


def check_plain(content: Any) -> None:
    """Refuse sections and lists nested deeper than `DEEPEST`, and text that cannot be written to a file.

    Raises:
        TextFileError: there is one.
    """
    level = [content]
    for _ in range(DEEPEST):
        inner: list[Any] = []
        for value in level:
            if isinstance(value, Mapping):
                inner += [*value, *value.values()]
            elif isinstance(value, list | tuple):
                inner += value
            elif isinstance(value, str) and not is_text(value):
                raise TextFileError(f"holds {value!r}, which is not text")
        level = inner
        if not level:
            return
    raise TextFileError("nested too deep")


def is_text(text: str) -> bool:
    """Whether a file in UTF-8 can hold it; names of files need not be such text."""
    return readable(text) == text


def readable(text: str) -> str:
    """The text, what is none in it as Python writes it."""
    return text.encode("utf-8", "backslashreplace").decode()
