"""Numbers in words: durations, sizes and counts."""

from __future__ import annotations


def duration(seconds: float, rough: bool = False) -> str:
    """A time in the units that fit: "7.5 s", "30 s", "16 min 40 s", "2 h 5 min".

    Args:
        seconds: the time.
        rough: it is an estimate, of 1 s at least: "17 min".
    """
    if rough:
        seconds = max(seconds if seconds < 120 else 60 * round(seconds / 60), 1)
    elif seconds < 10:
        return f"{seconds:.3g} s"
    whole = round(seconds)
    if whole >= 5400:
        parts = (whole // 3600, "h"), (whole // 60 % 60, "min")
    elif whole >= (120 if rough else 60):
        parts = (whole // 60, "min"), (whole % 60, "s")
    else:
        parts = ((whole, "s"),)
    return " ".join(f"{number} {unit}" for number, unit in parts if number)


def size(count: float) -> str:
    """Bytes to three digits, in one unit."""
    for unit, length in (("GB", 1e9), ("MB", 1e6)):
        if count >= 0.95 * length:
            return f"{count / length:.3g} {unit}"
    return f"{max(count / 1e3, 1):.0f} kB"


def counted(number: int, noun: str, plural: str = "") -> str:
    """A number of things: "1 step", "0 steps", "12,000 steps"."""
    return f"{number:,} {noun if number == 1 else plural or f'{noun}s'}"
