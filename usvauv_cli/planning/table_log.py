"""Fixes in a log that is a table, as programs and spreadsheets write CSV."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence

from usvauv.cli.planning.fixes import LARGEST, BadLine, Contents, Fix, NoFix, geographic, number
from usvauv.kernels.errors import UserError
from usvauv.kernels.positioning.usbl import UNUSABLE

METRES, DEGREES = ("x", "y"), ("latitude", "longitude")
COLUMNS = ("time", "auv", *METRES, *DEGREES, "depth", "flags", "world")
SHORT = {"lat": "latitude", "lon": "longitude", "long": "longitude", "lng": "longitude"}
NEEDED = "time, auv, depth and x, y or latitude, longitude, in s, m and degrees"
SEPARATORS = ",;\t "
PREAMBLE = 20  # lines among which the header is
FEWEST = 3  # columns by which a line is known as a header
UNIT = re.compile(r"[\s._]*[(\[{]\s*(°|[^\W\d_]+)[^)\]}]*[)\]}]?\W*$|[\s._]+(°|[^\W\d_]+)\W*$")
SECONDS = {"s", "sec", "secs", "second", "seconds", "utc", "unix", "epoch"}
LENGTHS = {"m", "meter", "meters", "metre", "metres"}
ANGLES = {"°", "deg", "degree", "degrees", "decimal", "wgs", "n", "e"}
UNITS = {"time": SECONDS, "depth": LENGTHS} | dict.fromkeys(METRES, LENGTHS) | dict.fromkeys(DEGREES, ANGLES)
COMMA = re.compile(r"[-+]?\d+,\d+(?:[eE][-+]?\d+)?")
SHOWN = 20  # characters of a value that is named


def read(lines: Sequence[str]) -> Contents | None:
    """The fixes, what is bad and what is left out of a table; None if it is none.

    Lines before the header are passed over. Its columns may be quoted, in capitals and with units; they are separated
    by commas, semicolons, tabs or spaces. A first column without a heading, as of R's row names, is passed over.

    Raises:
        UserError: a column is missing or there twice, a number has a decimal comma, or the fixes are of several worlds.
    """
    headers = (
        (start, separator, _header(line, separator))
        for start, line in enumerate(lines[:PREAMBLE])
        for separator in SEPARATORS
    )
    found = next((each for each in headers if len(set(each[2]) & set(COLUMNS)) >= FEWEST), None)
    if found is None:
        return None
    start, separator, header = found
    where = METRES if set(METRES) <= set(header) else DEGREES
    missing = [name for name in ("time", "auv", *where, "depth") if name not in header]
    if missing:
        raise UserError(f"no column {', '.join(missing)}; it needs {NEEDED}")
    twice = [name for name, count in Counter(header).items() if count > 1 and name in COLUMNS]
    if twice:
        raise UserError(f"column {twice[0]} is there twice")
    contents, worlds = Contents(), set[str]()
    for k, line in enumerate(lines[start + 1 :], start + 2):
        if not line.strip(SEPARATORS):
            continue
        try:
            cells = _cells(line, separator)
            if k == start + 2 and len(cells) == len(header) + 1 and cells[0] == "1" and line.lstrip()[0] == '"':
                header.insert(0, "")
            while len(cells) > len(header) and not cells[-1]:
                cells.pop()
            if len(cells) != len(header):
                raise BadLine(f"{len(cells)} fields, the header has {len(header)}")
            row = dict(zip(header, cells, strict=True))
            worlds.add(row.get("world", ""))
            contents.fixes.append(_fix(row, where))
        except BadLine as error:
            contents.bad.append(f"{k}: {error}")
        except NoFix as error:
            contents.left_out[str(error)] += 1
        except UserError as error:
            raise UserError(f"line {k}: {error}") from None
        if len(worlds) > 1:
            raise UserError("fixes of several episodes, see its column world; keep one")
    return contents


def _cells(line: str, separator: str) -> list[str]:
    """The fields of a line.

    Raises:
        BadLine: a field is longer than 131,072 characters.
    """
    try:
        row = next(csv.reader([line.strip(" ")], delimiter=separator, skipinitialspace=True))
    except csv.Error as error:
        raise BadLine(str(error)) from None
    return [cell.strip() for cell in row]


def _header(line: str, separator: str) -> list[str]:
    """The columns that the headings of a line name, without capitals and units; none if it cannot be a header."""
    try:
        names = [name.casefold() for name in _cells(line, separator)]
    except BadLine:
        return []
    while names and not names[-1]:
        names.pop()
    plain = [_plain(name) for name in names]
    return [name if name in COLUMNS or short in names else short for name, short in zip(names, plain, strict=True)]


def _plain(name: str) -> str:
    """A heading without its unit, and the short name in full; as it is, where its column has other units."""
    unit = UNIT.search(name)
    plain = (name[: unit.start()] if unit else name).strip(" ._")
    plain = SHORT.get(plain, plain)
    return name if unit and (unit[1] or unit[2]) not in UNITS.get(plain, {unit[1]}) else plain


def _fix(row: dict[str, str], where: tuple[str, str]) -> Fix:
    first, second, time, depth = (_number(name, row[name]) for name in (*where, "time", "depth"))
    if int(_number("flags", row.get("flags") or "0")) & UNUSABLE:
        raise NoFix("not usable by its flags")
    if not row["auv"]:
        raise BadLine("no name of an AUV")
    if where == METRES:
        return Fix(row["auv"], time, depth, (first, second))
    return Fix(row["auv"], time, depth, (0.0, 0.0), geographic(first, second))


def _number(name: str, text: str) -> float:
    try:
        return number(text)
    except ValueError:
        value = repr(text if len(text) <= SHOWN else text[:SHOWN] + "…")
    if COMMA.fullmatch(text):
        raise UserError(f"{name} {value} has a decimal comma; numbers have a decimal point")
    raise BadLine(f"{name} {value} is no number of at most {LARGEST:g}")
