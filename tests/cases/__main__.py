"""Print all cases, and what the boundaries reflect, as Markdown."""

import math

from tests.cases import LINEAR, Case
from tests.cases.nonlinear import CASES
from tests.cases.reflection import Packet


def rows(case: Case) -> list[str]:
    """One row of the table for each quantity."""
    lines = []
    for n, (quantity, measured) in enumerate(case.measure().items()):
        errors = ", ".join(f"{error:.2g}" for error in measured.errors)
        orders = ", ".join("—" if math.isnan(order) else f"{order:.2f}" for order in measured.orders)
        name, formula, source = (case.name, case.formula, case.source) if n == 0 else ("", "", "")
        cells = ", ".join(map(str, case.resolutions)) if n == 0 else ""
        wanted = case.tolerance[quantity]
        bounds = "{} to {}".format(*case.order[quantity]) if quantity in case.order else ""
        texts = [name, formula, source, cells, quantity, errors, f"{wanted:g}", orders or "—", bounds]
        lines.append("| " + " | ".join(text.replace("|", "\\|") for text in texts) + " |")
    return lines


def reflections() -> list[str]:
    """Reflection by boundary, cells to a wave and angle: measured (theory)."""
    angles = 0, 30, 45, 60
    lines = ["| boundary | cells to a wave | " + " | ".join(f"{a}°" for a in angles) + " |", "| --- " * 6 + "|"]
    for points in (10, 20, 40):
        found = (Packet(points, angle).run() for angle in angles)
        texts = (f"{100 * measured:.3f}% ({100 * theory:.3f}%)" for measured, theory in found)
        lines.append(f"| radiating | {points} | " + " | ".join(texts) + " |")
    return lines


def main() -> None:
    head = "| case | truth | source | cells | of | errors | tolerance | order | order wanted |"
    for title, cases in (("Linear", LINEAR), ("Nonlinear", CASES)):
        print(f"\n### {title}\n\n{head}\n{'| --- ' * 9}|")
        for case in cases:
            print("\n".join(rows(case)))
    print("\n### Reflection\n")
    print("\n".join(reflections()))


if __name__ == "__main__":
    main()
