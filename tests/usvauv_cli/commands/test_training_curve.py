"""The curve of a training run in the terminal."""

import math

from usvauv.cli.commands.training_curve import HEIGHT, WIDTH, curve


def plotted(margins, half=0.5):
    rows = [{"steps": 1000 * i, "margin": margin, "margin_half": half} for i, margin in enumerate(margins)]
    return curve(rows, "clear")


def marks(lines):
    """Row and column of each mean, by column."""
    found = [(row, column) for row, line in enumerate(lines[1:-1]) for column, mark in enumerate(line) if mark == "●"]
    return sorted(found, key=lambda place: place[1])


def test_it_rises_where_the_margin_does_and_crosses_the_heuristic():
    lines = plotted([-1.0, 0.0, 1.0, 2.0])
    assert len(lines) == HEIGHT + 2 <= 12
    assert max(map(len, lines)) <= 9 + WIDTH < 80
    rows, columns = zip(*marks(lines), strict=True)
    assert list(rows) == sorted(rows, reverse=True)
    assert [column - columns[0] for column in columns] == [round(i * (WIDTH - 1) / 3) for i in range(4)]
    (heuristic,) = [row for row, line in enumerate(lines[1:-1]) if "┄" in line]
    assert "0.00 ┤" in lines[1 + heuristic]
    assert rows[1] == heuristic
    assert lines[1].startswith("  +2.50 ┤")
    assert lines[HEIGHT].startswith("  −1.50 ┤")
    assert lines[-1].endswith("3,000 world-steps")


def test_intervals_are_as_long_as_they_are():
    """One of ± 1 about a margin that stays at 0 spans all rows; without one there is only the mean."""
    whole, alone = (sum("│" in line for line in plotted([0.0, 0.0], half)[1:-1]) for half in (1.0, math.nan))
    assert (whole, alone) == (HEIGHT - 1, 0)


def test_one_evaluation_is_no_curve():
    assert plotted([1.0]) == curve([{"steps": 0, "arps": 1.0}, {"steps": 9, "arps": 1.0}], "clear") == []
