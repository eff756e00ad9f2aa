"""Letters that a terminal does not have, in those that each has: ² as 2, σ as sigma, → as ->."""

from __future__ import annotations

import codecs
import re
import unicodedata

PLAIN = "usvauv.plain"  # handler of errors of an encoding
SIGNS = {
    **dict.fromkeys("−–—‐⁻₋─━╺╸", "-"),
    "×": "x",
    "·": ".",
    "±": "+/-",
    "→": "->",
    "°": " deg",
    "≤": "<=",
    "≥": ">=",
    "∞": "inf",
    "√": "sqrt",
    "µ": "u",
    "’": "'",
    "′": "'",
    "“": '"',
    "”": '"',
    "″": '"',
    "•": "*",
    "│": "|",
}
GREEK = re.compile(r"GREEK (SMALL|CAPITAL) LETTER (\w+)")


def plain(letter: str) -> str:
    """A letter in ASCII; `?` for one of another script."""
    greek = GREEK.fullmatch(unicodedata.name(letter, ""))
    if greek:
        return greek[2].lower() if greek[1] == "SMALL" else greek[2].capitalize()
    return SIGNS.get(letter) or unicodedata.normalize("NFKD", letter).encode("ascii", "ignore").decode() or "?"


def _replaced(error: UnicodeError) -> tuple[str | bytes, int]:
    """The first letter that cannot be encoded, made plain; a byte of a file's name that is no text stays as it is."""
    assert isinstance(error, UnicodeEncodeError)
    letter = error.object[error.start]
    if "\udc80" <= letter <= "\udcff" and not error.encoding.startswith(("utf-16", "utf-32")):
        return bytes([ord(letter) - 0xDC00]), error.start + 1
    return plain(letter), error.start + 1


codecs.register_error(PLAIN, _replaced)
